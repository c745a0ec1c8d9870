"""The time in a run that explains the result of a check best."""

from collections.abc import Callable

import numpy as np

from hil.figures import detection
from hil.figures.records import Figures
from hil.record.run_traces import RunTraces, column
from hil.record.traces.stored_trace import Records


def first(records: Records, name: str) -> float | None:
    """The time at which a column first differs from zero."""
    at = np.flatnonzero(column(records, name) != 0.0)
    return float(column(records, "t_s")[at[0]]) if len(at) else None


def largest(records: Records, name: str) -> float | None:
    """The time at which a column is largest."""
    values = column(records, name)
    if not np.isfinite(values).any():
        return None
    return float(column(records, "t_s")[int(np.nanargmax(values))])


def first_missed(traces: RunTraces) -> float | None:
    """Time of the first touch-down that should have been detected and was not."""
    found = detection.compare(traces.impacts, traces.firmware)
    return next(iter(column(traces.impacts, "t_s")[found.due & ~found.pairs.found].tolist()), None)


def first_false_alarm(traces: RunTraces) -> float | None:
    """Time of the first detection that belongs to no touch-down."""
    found = detection.compare(traces.impacts, traces.firmware)
    return next(iter(column(found.seen, "t_s")[found.pairs.false & found.counts].tolist()), None)


def worst_reported_speed(traces: RunTraces) -> float | None:
    """Time of the touch-down whose reported approach speed is most wrong."""
    seen, pairs, *_ = detection.compare(traces.impacts, traces.firmware)
    errors_m_s = np.abs(detection.speed_errors(pairs, seen, traces.impacts))
    if not np.isfinite(errors_m_s).any():
        return None
    return float(column(traces.impacts, "t_s")[pairs.truth[int(np.nanargmax(errors_m_s))]])


def moment_of(name: str, traces: RunTraces, figures: Figures) -> float:
    """The time that explains a failed check on the figure `name` best; by default the end of the run."""
    group = name.partition(".")[0]
    looked_up: dict[str, Callable[[], float | None]] = {
        "detector.recall": lambda: first_missed(traces),
        "detector.precision": lambda: first_false_alarm(traces),
        "detector.speed_rmse_m_s": lambda: worst_reported_speed(traces),
        "fault": lambda: first(traces.firmware, "outputs.fault"),
        "peak_force_n": lambda: largest(traces.impacts, "peak_force_n"),
        "felt": lambda: largest(traces.plant, "felt_force_n") if traces.is_worn else None,
        "largest_v_m_s": lambda: largest(traces.impacts, "v_m_s"),
        "tick_us": lambda: largest(traces.firmware, "work_us"),
        "wake_us": lambda: largest(traces.firmware, "wake_latency_us"),
    }
    known = {
        "gait": figures.gait.end_s,
        "safe_state": figures.safe_state.at_s,
        "motor_torque_after_stop_n_m": figures.safe_state.at_s,
        "regime": figures.hold_end_s,
        "impacts_per_period": figures.hold_end_s,
        "impact_v_m_s": figures.hold_end_s,
        "speed": figures.hold_end_s,
        "estimate": figures.hold_end_s,
        "capture_s": figures.hold_start_s,
        "largest_v_on_the_way_m_s": figures.hold_start_s,
    }
    look = looked_up.get(name, looked_up.get(group))
    moment = known.get(name, known.get(group)) if look is None else look()
    return figures.duration_s if moment is None else moment
