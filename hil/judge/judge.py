"""The verdict on a run from its traces: figures, checks, reasons, doubts."""

from pathlib import Path

from hil.judge.checks import checks_of, evaluate
from hil.judge.figures.figures import figures_from
from hil.judge.figures.moments import moment_of
from hil.judge.reasons import doubts_of, fault_effects, reasons_of
from hil.judge.verdict import RunVerdict, Verdict
from hil.record import provenance
from hil.record.run_traces import RunTraces


def judge(traces: RunTraces, folder: Path) -> RunVerdict:
    """The verdict on a run from its traces; `folder`: the run's folder, which the verdict names."""
    figures = figures_from(traces)
    reasons = tuple(reasons_of(traces))
    checks = tuple(evaluate(checks_of(traces.scenario), figures, traces))
    failures_s = [moment_of(one.name, traces, figures) for one in checks if one.verdict is Verdict.FAILED]
    return RunVerdict(
        figures=figures,
        checks=checks,
        reasons=reasons,
        doubts=() if reasons else tuple(doubts_of(traces)),
        faults=tuple(fault_effects(traces)),
        first_failure_s=min(failures_s, default=None),
        provenance={key: traces.run.get(key) for key in provenance.KEYS},
        folder=folder,
    )
