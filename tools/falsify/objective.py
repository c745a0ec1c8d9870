"""One run of a search: the margins of the chosen checks, judged as `vibrohil run` judges them."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hil.bus.log.candump_lines import lines_of
from hil.figures.records import CATALOGUE, Origin
from hil.judge.judge import judge
from hil.judge.verdict import CheckResult, RunVerdict, Verdict
from hil.record.candump import parse_candump
from hil.record.run_faults import with_effects
from hil.record.run_traces import RunTraces
from hil.record.traces.firmware_trace import fields_of
from hil.record.traces.precision import TICKED
from hil.record.traces.stored_trace import PackedRecords, is_read_often
from hil.record.traces.trace import columns_of_fields
from hil.run_files import TRACES
from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.checks import Check
from hil.scenario.scenario import Scenario
from text_input import RefusalError
from tools.falsify.space import Space

BROKEN = -1.0
"""The margin of a failed check that has no margin: a text, or a figure that the run does not have."""
LEAST = -10.0
"""Smallest margin; farther beyond a limit counts the same."""


@dataclass(frozen=True)
class Result:
    """Outcome of a run: a margin for each chosen check, None where it gives no direction or is not judged.

    `why`: the reason why the run is not judged or was refused; empty for a judged one.
    """

    margins: tuple[float | None, ...]
    why: str = ""

    @property
    def margin(self) -> float | None:
        """The smallest margin; None for a run that is not judged."""
        if self.why:
            return None
        return min((one for one in self.margins if one is not None), default=1.0)

    @property
    def worst(self) -> int:
        """The place of the smallest margin among the chosen checks."""
        margins = [math.inf if one is None else one for one in self.margins]
        return margins.index(min(margins))


class Task(NamedTuple):
    """A run: its space by its name, and its values."""

    space: str
    values: tuple[Any, ...]


def run_task(spaces: Mapping[str, Space], task: Task) -> dict[str, Any]:
    """Run a task; return the result as JSON can hold it."""
    return asdict(result_at(spaces[task.space], task.values))


def result_at(space: Space, values: Sequence[Any]) -> Result:
    """Run a scenario with these values, and give the margins of the chosen checks."""
    try:
        scenario = space.scenario(values)
        verdict, _ = judged(scenario, [scenario.checks[place] for place in space.chosen], space.own_faults)
    except RefusalError as error:
        return Result((), f"refused: {error}")
    if verdict.reasons:
        return Result(tuple(BROKEN for _ in space.chosen))
    results = [verdict.checks[place] for place in space.chosen]
    if verdict.doubts or all(one.verdict is Verdict.NOT_JUDGED for one in results):
        return Result((), "; ".join(verdict.doubts) or "no check was judged")
    return Result(tuple(map(margin_of, results)))


def margin_of(result: CheckResult) -> float | None:
    """A check's margin as a share; None if it gives no direction."""
    if result.verdict is Verdict.NOT_JUDGED:
        return None
    if result.verdict is Verdict.FAILED:
        share = result.margin_share
        return BROKEN if share is None else max(min(share, -1e-9), LEAST)
    return result.margin_share


def kept_for(checks: Sequence[Check]) -> dict[str, Sequence[str] | None]:
    """The columns that figures and the checks' expressions use, of each trace.

    No figure of a run in lockstep uses the operator's trace, which would cost a step every 10 ms.
    """
    expressions = " ".join(one.expression or "" for one in checks)
    names = [one.name for one in columns_of_fields(fields_of(walks=True))]
    used = [one for one in names if is_read_often(one) or f"firmware.{one}" in expressions]
    return {"plant": None, "impacts": None, "bus_errors": None, "firmware": used}


def judged(
    scenario: Scenario, checks: Sequence[Check], own_faults: int | None = None
) -> tuple[RunVerdict, RunTraces]:
    """Run in compiled lockstep and judge, with the records in memory.

    The frames are kept only if one of `checks` needs them. Of the faults only the first `own_faults` must
    act; one of the others may come where another one leaves it nothing.
    """
    needs_bus = any(one.expression is None and CATALOGUE[one.name].origin is Origin.LOG for one in checks)
    job = Job(scenario, scenario.seed, kept=None if needs_bus else kept_for(scenario.checks))
    kinds: dict[str, np.dtype[np.void]] = {}
    rows = {name: bytearray() for name in TRACES}
    lines: list[bytes] = []
    for segment in segments(job):
        lines.append(lines_of(segment.frames))
        for name in rows.keys() & segment.rows.keys():
            kinds[name] = segment.rows[name].dtype
            rows[name] += segment.rows[name].data  # numpy would copy records column by column
    found: dict[str, Any] = {
        name: PackedRecords(np.frombuffer(rows[name], kind), exact=name not in TICKED)
        for name, kind in kinds.items()
    }
    note: dict[str, Any] = {
        "scenario": scenario.name,
        "clock": "lockstep",
        "period_s": scenario.period_s,
        "faults": [fault.as_record()._asdict() for fault in scenario.faults],
    }
    note["faults"] = with_effects(note, job.outcome.faults_acted)
    for fault in note["faults"][own_faults:] if own_faults is not None else ():
        fault["acted"] = fault["acted"] or None
    traces = RunTraces(
        **found,
        bus=parse_candump(b"".join(lines)),
        run=note,
        outcome={"wall_s": None},
        scenario=scenario.document,
    )
    return judge(traces, Path()), traces
