"""Why a run ended as it did: the limit of the latched fault, what broke it off, or its first failed check.

`conditions.toml` has the conditions of each row of docs/safety.md as expressions on the firmware's trace. The
one that exceeds its bound most in the tick of the latch is the cause.
"""

import math
from collections.abc import Mapping
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.core.config import Config
from firmware_py.core.control.start import LONGEST_SEARCH_S
from firmware_py.core.safety.gate import AWAY_FACTOR, DRIVES_OWN, GAPS
from firmware_py.core.safety.gate_limits import CLIPPED_SHARE
from firmware_py.core.safety.liveness import READINGS
from firmware_py.core.safety.monitors import RUNAWAY_RAD_S
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.shell.parameters import DEFAULTS, config_from
from hil.figures.expression import Expression, ExpressionError
from hil.figures.moments import moment_of
from hil.figures.own import ELEMENTWISE
from hil.figures.text import figure_text
from hil.judge.verdict import CheckResult, RunVerdict, Verdict
from hil.record.run_traces import RunTraces, column
from hil.record.state_timeline import lower_name
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import FloatArray
from text_input import parse_toml

BEFORE_S, AFTER_S = 1.0, 0.5
"""Time before and after a cause in which it is shown: two drive periods and one."""


class Condition(NamedTuple):
    """One condition of a fault, as `conditions.toml` describes it."""

    quantity: str
    value: str
    unit: str = ""
    parameter: str | None = None
    bound: str | None = None
    lower: bool = False
    row: str | None = None
    lasting: str | None = None

    def limit(self, config: Config) -> float:
        """The bound in `unit`."""
        return expression(self.bound or f"p.{self.parameter}", None, config).evaluate()

    def row_for(self, fault: Fault) -> str:
        """First cell of the condition's row in docs/safety.md."""
        return fault.name if self.row == "" else self.row or self.quantity

    def measure(self, firmware: Records, config: Config) -> FloatArray:
        """The quantity at each record; raises ExpressionError for a trace without its signals."""
        return expression(self.value, firmware, config).over_time()


@cache
def conditions() -> Mapping[Fault, tuple[Condition, ...]]:
    """The conditions of each fault that is latched; none where no quantity decides."""
    document = parse_toml(Path(__file__).with_name("conditions.toml").read_text(encoding="utf-8"))
    return {
        Fault[name]: tuple(Condition(**one) for one in table["conditions"])
        for name, table in document.items()
    }


def expression(text: str, firmware: Records | None, config: Config) -> Expression:
    """An expression on the firmware's trace, its parameters and the constants of its build."""
    build = {
        "closed_loop": float(AxisState.CLOSED_LOOP_CONTROL),
        "drives_own": DRIVES_OWN,
        "away": AWAY_FACTOR,
        "clipped": CLIPPED_SHARE,
        "gaps": float(GAPS),
        "readings": float(READINGS),
        "reads_housing": float(config.gate.reads_housing),
        "search_s": LONGEST_SEARCH_S,
        "runaway_rad_s": RUNAWAY_RAD_S,
        "implausible_rad_s2": config.monitors.implausible_rad_s2,
        "stop_s": config.monitors.longest.stop_failed * config.tick_s,
    }

    def read(source: str, name: str) -> Any:
        if source == "firmware" and firmware is not None:
            return column(firmware, name)
        return np.float64(build[name] if source == "build" else attrgetter(name)(config.p))

    signals = () if firmware is None else firmware.dtype.names or ()
    names = {"firmware": signals, "p": list(DEFAULTS), "build": list(build)}
    return Expression(text, names, read, {}, ELEMENTWISE)


class Limit(NamedTuple):
    """A limit that was exceeded: its quantity, and that quantity's value at the latch or in the run.

    `bound`: the limit as text or number. `parameter`: of the firmware; None for a bound of the build and for
    checks. `row`: first cell of its row in docs/safety.md; None for checks.
    """

    name: str
    value: Any
    unit: str
    bound: Any
    parameter: str | None
    row: str | None

    @property
    def sentence(self) -> str:
        """`motor current was 13.1 A, limit 12 A (limit.current_a)`."""
        source = "" if self.parameter is None else f" ({self.parameter})"
        value, bound = figure_text(self.value, self.unit), figure_text(self.bound, self.unit)
        return f"{self.name} was {value}, limit {bound}{source}"


class Cause(NamedTuple):
    """Why a run ended as it did, in a sentence; `condition` and `config` belong to a latched fault.

    `rows` of docs/safety.md, by their first cells: of a latched fault whose quantities the log lacks.
    """

    at_s: float
    sentence: str
    limit: Limit | None
    condition: Condition | None = None
    config: Config | None = None
    rows: tuple[str, ...] = ()


def find_cause(traces: RunTraces, verdict: RunVerdict) -> Cause | None:
    """The first of latched fault and failed checks, else the operator's emergency stop; None without any.

    What has failed the run itself, such as the error of an own controller, comes before its checks. A figure
    that the run does not have is a consequence, and the cause only where there is no other.
    """
    firmware = traces.firmware
    latched = np.flatnonzero(column(firmware, "outputs.fault") != Fault.NONE)
    failed = [check for check in verdict.checks if check.verdict is Verdict.FAILED]
    causes = [latched_cause(traces, int(row)) for row in latched[:1]]
    if not verdict.reasons:
        causes += [failed_cause(check, traces, verdict) for check in failed if check.value is not None]
    elif not causes:
        t_s = column(firmware, "t_s")
        return Cause(float(t_s[-1]) if len(t_s) else 0.0, verdict.reasons[0], None)
    causes = causes or [failed_cause(check, traces, verdict) for check in failed]
    if causes:
        return min(causes, key=lambda cause: cause.at_s)
    stopped = np.flatnonzero(column(firmware, "outputs.mode") == Mode.E_STOP)
    if len(stopped) == 0:
        return None
    at_s = float(column(firmware, "t_s")[stopped[0]])
    return Cause(at_s, f"the operator's emergency stop was latched at {at_s:.4f} s", None)


def failed_cause(check: CheckResult, traces: RunTraces, verdict: RunVerdict) -> Cause:
    """A failed check as a cause."""
    limit = Limit(check.name, check.value, check.unit, check.limit, None, None)
    return Cause(moment_of(check.name, traces, verdict.figures), f"the check {check.sentence}", limit)


def latched_cause(traces: RunTraces, row: int) -> Cause:
    """The fault that the firmware latched in this row of its trace, with its limit if the trace shows it.

    A log of a board has few of the firmware's signals. Without a scenario the parameters are the defaults.
    """
    record = traces.firmware[row : row + 1]
    at_s, fault = float(column(record, "t_s")[0]), Fault(int(column(record, "outputs.fault")[0]))
    sentence = f"the firmware latched the fault {lower_name(fault)} at {at_s:.4f} s"
    config = config_from(traces.scenario.get("firmware", {}))
    found = {one: value_in(one, record, config) for one in conditions().get(fault, ())}
    shown = {one: value for one, value in found.items() if value is not None}
    if not shown:
        rows = dict.fromkeys(one.row_for(fault) for one in found)
        return Cause(at_s, sentence, None, rows=tuple(rows))
    best = max(shown, key=lambda one: excess(one, shown[one], config))
    limit = Limit(
        best.quantity, shown[best], best.unit, best.limit(config), best.parameter, best.row_for(fault)
    )
    lasting = ""
    if best.lasting is not None:
        lasting = f" for {figure_text(attrgetter(best.lasting)(config.p), 's')} ({best.lasting})"
    return Cause(at_s, f"{sentence}: {limit.sentence}{lasting}", limit, best, config)


def value_in(condition: Condition, record: Records, config: Config) -> float | None:
    """The quantity of a condition in a record; None if the trace does not have its signals."""
    try:
        return float(condition.measure(record, config)[0])
    except ExpressionError:
        return None


def excess(condition: Condition, value: float, config: Config) -> float:
    """The share of its bound by which a quantity is beyond it; infinite for NaN, and above a bound of 0."""
    bound = condition.limit(config)
    beyond = (value - bound) * (-1.0 if condition.lower else 1.0)
    if math.isnan(beyond):
        return math.inf
    return beyond / abs(bound) if bound != 0.0 else math.inf if beyond > 0.0 else -math.inf
