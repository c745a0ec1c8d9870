"""The highlights of a run: the run-up, a close-up, and the time of each failed check."""

from collections.abc import Iterable, Sequence

from hil.figures.moments import first, moment_of
from hil.figures.records import Figures
from hil.judge.verdict import CheckResult, Verdict
from hil.record.run_traces import RunTraces
from hil.show.layout import Highlights, Mark

CLOSE_UP_S = 3.0
"""Duration of the close-up: about four to twelve drive periods."""
PASSED = f"check {Verdict.PASSED.words}: "
"""Beginning of the mark of a check that has passed."""


def marks(
    results: Iterable[CheckResult], traces: RunTraces, figures: Figures, verdict: Verdict = Verdict.FAILED
) -> list[Mark]:
    """A mark for each check with this verdict."""
    return [
        Mark(moment_of(result.name, traces, figures), f"check {verdict.words}: {result.sentence}")
        for result in results
        if result.verdict is verdict
    ]


def highlights(traces: RunTraces, figures: Figures, failed: Sequence[Mark]) -> Highlights:
    """The log's initial view: the first failed check, else the end of the run-up, else the end of the run."""
    end_s = figures.duration_s
    at_s = min((mark.t_s for mark in failed), default=figures.hold_start_s)
    start_s = first(traces.operator, "request")
    run_up_end_s = figures.hold_start_s if figures.hold_start_s is not None else end_s
    centre_s = end_s if at_s is None else at_s
    left_s = min(max(centre_s - CLOSE_UP_S / 2.0, 0.0), max(end_s - CLOSE_UP_S, 0.0))
    return Highlights(
        run_up_s=(start_s or 0.0, min(run_up_end_s + CLOSE_UP_S / 2.0, end_s)),
        detail_s=(left_s, left_s + CLOSE_UP_S),
    )
