"""Intervals in which the host held a process up, in held and in strict time, and what cannot be judged then.

A gap is an interval in which a node of the bench, or the operator, did not run although neither the scenario
nor its own work kept it from running. A gap of `SHORTEST_GAP_S` disturbs the motion: an impact lasts 10 ms.
Its effect is taken to last `SETTLING_S`.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from hil.record.run_faults import faults_of
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records
from hil.timing.clock import OPERATOR_PERIOD_S
from hil.timing.pacemaker import Hold

MOST_SHOWN = 5
"""Number of holds and of gaps that are shown to a person; the log has all."""
SHORTEST_GAP_S = 3e-3
SETTLING_S = 2.0
"""Time for which a gap's effect lasts: four drive periods at 2 Hz, in which the impact regime settles again.
The estimate has recovered after 0.2 s."""


@dataclass(frozen=True, slots=True)
class Gap:
    """An interval of simulated time in which a process of the bench was held up."""

    from_s: float
    to_s: float | None
    """None if the run was ended."""
    process: str

    @property
    def in_words(self) -> str:
        """The gap as text: `held up the plant from 1.950 s to 1.981 s`."""
        end = "and the run was ended" if self.to_s is None else f"to {self.to_s:.3f} s"
        return f"held up the {self.process} from {self.from_s:.3f} s {end}"


def gaps_in(
    name: str, records: Records, period_s: float, announced: Sequence[tuple[float, float]]
) -> Iterator[Gap]:
    """The gaps of one process by its trace, without those that overlap an interval of `announced`."""
    t_s = column(records, "t_s")
    missing_s = np.diff(t_s) - period_s
    if "cpu_us" in (records.dtype.names or ()):
        # The record's own work may have caused the gap, or the work between its end and the next record's.
        cpu_s = 1e-6 * column(records, "cpu_us")
        missing_s -= cpu_s[:-1] + cpu_s[1:]
    for index in np.flatnonzero(missing_s >= SHORTEST_GAP_S - 1e-9).tolist():
        from_s, to_s = float(t_s[index]), float(t_s[index + 1])
        if not any(from_s < end_s and begin_s < to_s for begin_s, end_s in announced):
            yield Gap(from_s, to_s, name)


def find_announced(process: str, run: Mapping[str, Any]) -> list[tuple[float, float]]:
    """The intervals in which a fault of the run keeps `process` from running, with a margin of 0.1 s."""
    return [
        (fault.from_s - 0.1, fault.end_s + 0.1)
        for fault in faults_of(run)
        if fault.silences and fault.node == process
    ]


def gaps_of(traces: RunTraces, period_s: float) -> list[Gap]:
    """All gaps of a run in real time, in order of time.

    Where time was held there are none, unless a process was waited for in vain: then the run is cut short.
    """
    run, outcome = traces.run, traces.outcome
    if run.get("clock") != "real":
        return []
    if run.get("time") == "held":
        cut_s = outcome.get("cut_s")
        return [] if cut_s is None else [Gap(float(cut_s), None, str(outcome.get("cut_by")))]
    loops = (
        ("plant", traces.plant, period_s),
        ("firmware", traces.firmware, period_s),
        ("operator", traces.operator, OPERATOR_PERIOD_S),
    )
    found = [
        gap
        for name, records, period in loops
        if len(records)
        for gap in gaps_in(name, records, period, find_announced(name, run))
    ]
    return sorted(found, key=lambda gap: gap.from_s)


def doubt_of(window_s: tuple[float, float], gaps: Sequence[Gap]) -> str | None:
    """Why a figure of the motion, taken over `window_s`, is not judged; None if no gap touches its window."""
    for gap in gaps:
        to_s = math.inf if gap.to_s is None else gap.to_s
        if gap.from_s <= window_s[1] and window_s[0] <= to_s + SETTLING_S:
            return f"the host {gap.in_words}"
    return None


def longest_holds(holds: Sequence[Hold]) -> list[str]:
    """The longest holds of a run as text, in order of time."""
    longest = sorted(holds, key=lambda hold: -hold.whole_s)[:MOST_SHOWN]
    return [hold.in_words for hold in sorted(longest, key=lambda hold: hold.t_s)]


def longest_gaps(gaps: Sequence[Gap]) -> list[str]:
    """The longest gaps of a run as text, in order of time, below the number of all gaps."""
    longest = sorted(gaps, key=lambda gap: gap.from_s - (math.inf if gap.to_s is None else gap.to_s))
    shown = [f"the host {gap.in_words}" for gap in sorted(longest[:MOST_SHOWN], key=lambda gap: gap.from_s)]
    if len(gaps) <= MOST_SHOWN:
        return shown
    return [f"the host held up processes in {len(gaps)} intervals, the longest of which follow", *shown]
