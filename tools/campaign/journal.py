"""Outcomes of a running campaign, from which an interrupted campaign continues.

A file beside the runs, named by a digest of all that an outcome depends on: the campaign, its cells, numbers
and seed, the firmware's build, every source file and the packages' versions. It is gone once the campaign is
complete.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from types import TracebackType
from typing import Any, Self

from firmware_py.shell.builds import Build
from hil.record import provenance
from hil.record.run_folder import RUNS
from tools.campaign.trial.cells import Cell
from tools.campaign.trial.outcome import Outcome


class Journal:
    """Appends outcomes, and gives those of an earlier campaign that was interrupted."""

    def __init__(
        self, campaign: str, cells: Sequence[Cell], numbers: Mapping[str, Any], seed: int, firmware: Build
    ) -> None:
        digest = provenance.key(campaign, cells, dict(numbers), seed, firmware)
        self.path = RUNS / f"campaign-{campaign}-{digest[:16]}.jsonl"
        self.outcomes = self._read()
        self.path.parent.mkdir(exist_ok=True)
        self._file = self.path.open("a", encoding="utf-8")

    def _read(self) -> list[Outcome]:
        """The outcomes by whole lines; a kill may have cut the last one short."""
        if not self.path.exists():
            return []
        whole, _, cut = self.path.read_bytes().rpartition(b"\n")
        if cut:
            self.path.write_bytes(whole + b"\n" if whole else b"")
        return [Outcome(**json.loads(line)) for line in whole.splitlines()]

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Write outcomes that have come."""
        self.outcomes += outcomes
        self._file.write("".join(f"{json.dumps(asdict(outcome))}\n" for outcome in outcomes))
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._file.close()
        if kind is None or not self.outcomes:
            self.path.unlink(missing_ok=True)
