"""The hold of a run: its window, the motion in it, and the capture time of the impact regime."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface.enums import Mode, Regime
from hil.figures import detection, true_regime
from hil.record.run_traces import column
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import BoolArray, FloatArray


class Window(NamedTuple):
    """An interval of simulated time in seconds."""

    start_s: float
    end_s: float

    def holds(self, t_s: FloatArray) -> BoolArray:
        """Mask of the times `t_s` within the window."""
        return (t_s >= self.start_s) & (t_s <= self.end_s)

    def second_half(self) -> "Window":
        """The later half, where transients of the start have died out."""
        return Window(0.5 * (self.start_s + self.end_s), self.end_s)


def hold_window(firmware: Records) -> Window | None:
    """The longest uninterrupted interval of mode RUN, which begins at the end of the run-up."""
    mode, t_s = column(firmware, "outputs.mode"), column(firmware, "t_s")
    running = np.flatnonzero(mode == Mode.RUN)
    if len(running) == 0:
        return None
    spans = np.split(running, np.flatnonzero(np.diff(running) > 1) + 1)
    longest = max(spans, key=lambda span: t_s[span[-1]] - t_s[span[0]])
    return Window(float(t_s[longest[0]]), float(t_s[longest[-1]]))


def commanded_end_s(scenario: Mapping[str, Any], start_s: float) -> float | None:
    """Time at which the script of raw tables ends a hold that began at `start_s`; None without a script.

    The next command that is no RUN ends it, or else the script.
    """
    script = scenario.get("script", {})
    ends_s = [float(one["at_s"]) for one in script.get("commands", []) if one["request"] != "run"]
    ends_s += [float(script["duration_s"])] if "duration_s" in script else []
    return min((one for one in ends_s if one > start_s), default=None)


class HoldMotion(NamedTuple):
    """The true motion of the striker during the hold."""

    regime: Regime
    impacts_per_period: float | None
    capture_s: float | None
    impact_v_m_s: float | None
    impact_impulse_n_s: float | None


def hold_motion(plant: Records, impacts: Records, hold: Window | None) -> HoldMotion:
    """Regime, impacts per turn, capture, typical approach speed and impulse over the hold."""
    if hold is None or len(plant) == 0:
        return HoldMotion(Regime.UNCERTAIN, None, None, None, None)
    strong = detection.select_strong(impacts)
    strong_t_s, strong_v_m_s = column(strong, "t_s"), column(strong, "v_m_s")
    inside, hits = hold.holds(column(plant, "t_s")), hold.holds(strong_t_s)
    t_s, crank_rad = column(plant, "t_s")[inside], column(plant, "crank_rad")[inside]
    periods = true_regime.cut_periods(t_s, crank_rad, strong_t_s[hits])
    regime = true_regime.decide(
        t_s, column(plant, "v_m_s")[inside], periods, strong_t_s[hits], strong_v_m_s[hits]
    )
    turns = float(np.ptp(np.unwrap(crank_rad))) / (2.0 * np.pi) if len(crank_rad) else 0.0
    late = strong[hold.second_half().holds(strong_t_s)]
    period_s = (hold.end_s - hold.start_s) / turns if turns > 0.0 else np.inf
    return HoldMotion(
        regime=regime,
        impacts_per_period=float(periods.counts.mean()) if len(periods.counts) else None,
        capture_s=capture(strong_t_s[strong_t_s <= hold.end_s], hold, period_s),
        impact_v_m_s=float(np.median(column(late, "v_m_s"))) if len(late) else None,
        impact_impulse_n_s=float(np.median(column(late, "impulse_n_s"))) if len(late) else None,
    )


def capture(impacts_t_s: FloatArray, hold: Window, period_s: float) -> float | None:
    """Time of the first impact after which every gap to the end of the hold is at most 1.5 drive periods."""
    if len(impacts_t_s) == 0 or hold.end_s - impacts_t_s[-1] > 1.5 * period_s:
        return None
    breaks = np.flatnonzero(np.diff(impacts_t_s) > 1.5 * period_s)
    return float(impacts_t_s[breaks[-1] + 1 if len(breaks) else 0])
