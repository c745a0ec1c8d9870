"""Outcomes of a running campaign, from which an interrupted campaign continues.

The journal is a file beside the runs. Its name contains a digest of everything on which an outcome depends:
the campaign, its cells, numbers and seed, the firmware's build, every source file and the packages' versions.
The file is removed once the campaign is complete.
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
    """Appends outcomes to the file; `outcomes` starts with those of an earlier, interrupted campaign."""

    def __init__(
        self, campaign: str, cells: Sequence[Cell], numbers: Mapping[str, Any], seed: int, firmware: Build
    ) -> None:
        digest = provenance.key(campaign, cells, dict(numbers), seed, firmware)
        self.path = RUNS / f"campaign-{campaign}-{digest[:16]}.jsonl"
        self.outcomes = self._read()
        self.path.parent.mkdir(exist_ok=True)
        self._file = self.path.open("a", encoding="utf-8")

    def _read(self) -> list[Outcome]:
        """Read the outcomes of complete lines; remove a last line that a kill has cut short."""
        if not self.path.exists():
            return []
        whole, _, cut = self.path.read_bytes().rpartition(b"\n")
        if cut:
            self.path.write_bytes(whole + b"\n" if whole else b"")
        return [Outcome(**json.loads(line)) for line in whole.splitlines()]

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Append new outcomes to the file."""
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
