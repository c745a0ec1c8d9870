"""The process that joins an adapter to a hub (`hil.bus.bridge`), as its parent sees it."""

import json
import sys
from dataclasses import replace
from pathlib import Path

from hil.bus.base import BusCounters, BusError
from hil.processes.child import READY, Child


class BridgeProcess(Child):
    """A running bridge; `refresh` reads its reports, without waiting for one."""

    def __init__(self, hub: Path, adapter: str) -> None:
        """Join `adapter`, interface:channel of python-can, to the hub at a socket."""
        super().__init__("bridge", [sys.executable, "-P", "-m", "hil.bus.bridge", str(hub), adapter])
        self._reported_failure = ""
        self.to_adapter, self.from_adapter = BusCounters(), BusCounters()

    def await_adapter(self) -> None:
        """Wait until the adapter is open; raises BusError."""
        line = self.read_line()
        if line != READY:
            raise BusError(line.removeprefix("failed "))

    def refresh(self) -> None:
        """Read the reports that have arrived."""
        self._take(self.read_available())

    def fileno(self) -> int:
        """A descriptor that becomes readable when a report arrives."""
        assert self._process.stdout is not None
        return self._process.stdout.fileno()

    @property
    def failure(self) -> str:
        """Why the adapter, or this process, has failed; empty while they work."""
        self.refresh()
        return self._reported_failure or (super().how_it_ended() if super().ended else "")

    @property
    def ended(self) -> bool:
        """Whether the adapter or this process has failed; this process then still passes last messages."""
        return bool(self.failure)

    def how_it_ended(self) -> str:
        """The adapter's failure, or the end of this process."""
        failure = self._reported_failure
        return f"the adapter has failed ({failure})" if failure else super().how_it_ended()

    def counted_for(self, own: BusCounters) -> BusCounters:
        """The counters of a node that alone uses the adapter: its own and the bridge's."""
        out, back = self.to_adapter, self.from_adapter
        first = own if own.unsent or not out.unsent else out
        return replace(
            own,
            unsent=own.unsent + out.unsent + out.lost,
            first_unsent_ns=first.first_unsent_ns,
            refusal=first.refusal,
            lost=own.lost + back.unsent,
            foreign=own.foreign + back.foreign,
            receive_errors=own.receive_errors + back.receive_errors,
        )

    def stop(self, at_work_s: float = 0.0) -> str:
        """Ask the bridge to end, and read its last report."""
        said = super().stop(at_work_s)
        self._take(said)
        return said

    def _take(self, lines: str) -> None:
        for line in lines.splitlines():
            report = json.loads(line)
            self._reported_failure = report["failure"]
            self.to_adapter = BusCounters(**report["to_adapter"])
            self.from_adapter = BusCounters(**report["from_adapter"])
