"""Every figure of a run, from its traces alone; the same code for lockstep and real time.

Truth is the plant's trace and its located impacts; the estimate is the firmware's trace. Nothing is taken
from the firmware's word but when it says it holds (mode RUN), what it commands, and what it estimates.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.enums import MOVING, Fault, Mode, Regime
from hil import detection, true_regime
from hil.bus_figures import mean_load
from hil.figure_records import (
    DetectorFigures,
    EstimateFigures,
    FaultFigures,
    FeltFigures,
    Figures,
    LatchedFigures,
    Latency,
    LogFigures,
    Loops,
    LoopTiming,
    MemoryFigures,
    SafeStateFigures,
    SpeedFigures,
    Spread,
    TrueImpact,
)
from hil.gait_figures import gait_figures
from hil.lanes import lower_name
from hil.run_traces import Records, RunTraces, column, read_run

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]

NO_TORQUE_N_M = 1e-3
"""Below this the motor is off: 1/5 of its dry friction, which then holds it."""
SETTLE_S = 0.1
"""Time the motor has to become torque-free after a stop, a fault or a node's death."""
BEFORE_FAULT_S = 0.2
"""The time before a fault in which its cause is looked for: some of the watchdogs on sensors."""
SILENT_S = 0.2
"""A node whose trace ends this long before its partner's has died; ordinary ends lie closer together."""
DEFAULT_PERIOD_S = 1e-3
"""The bus's tick, where the run does not say otherwise."""
LONGEST_WORK_P99_US = 500.0
"""Half a tick: what a loop may need and still leave its partner the other half."""
LONGEST_HOLD_MS = 3.0
"""A loop that is held up for this long has disturbed what it controls, however rarely that happens: an impact
lasts 10 ms, and its detection a few ticks."""
OVERRUN_FRACTION = 1e-3
"""Overruns granted beside twice those of a bare sleep loop, as a fraction of the ticks due."""
OVERRUN_FRACTION_UML = 1e-2
"""Overruns granted under user-mode Linux, where each system call costs some 12 µs and a bare loop slips."""


# --- parts -------------------------------------------------------------------------------------------


class Window(NamedTuple):
    """A span of simulated time, seconds."""

    start_s: float
    end_s: float

    def holds(self, t_s: FloatArray) -> BoolArray:
        """Which of `t_s` lie inside."""
        return (t_s >= self.start_s) & (t_s <= self.end_s)

    def second_half(self) -> "Window":
        """The later half, where transients of the start have died out."""
        return Window(0.5 * (self.start_s + self.end_s), self.end_s)


def spread(values: FloatArray) -> Spread:
    """Quantiles of what is finite."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return Spread(None, None, None)
    p50, p99 = np.percentile(finite, [50.0, 99.0])
    return Spread(float(p50), float(p99), float(finite.max()))


def rms(errors: FloatArray) -> float | None:
    """Root mean square; None of nothing."""
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def loop_timing(records: Records, period_s: float) -> LoopTiming:
    """A loop's timing from its own trace; skipped ticks are what its tick numbers, from 0 on, leave out."""
    tick = column(records, "tick")
    work_us, wake_us = column(records, "work_us"), column(records, "wake_latency_us")
    half_tick_us = 0.5e6 * period_s
    held = np.diff(tick) - 1.0
    longest = int(np.argmax(held)) if len(held) else None
    return LoopTiming(
        ticks=len(tick),
        overruns=int(tick[-1]) + 1 - len(tick) if len(tick) else 0,
        late_wakeups=int(np.count_nonzero(wake_us > half_tick_us)),
        long_work=int(np.count_nonzero(work_us > half_tick_us)),
        longest_hold_ms=None if longest is None else 1e3 * period_s * float(held[longest]),
        longest_hold_at_s=None if longest is None else period_s * (float(tick[longest]) + 1.0),
        work_us=spread(work_us),
        wake_us=spread(wake_us),
    )


def met_its_timing(loops: Loops, baseline_overruns: int | None, under_uml: bool) -> bool:
    """Whether both loops kept up, beside a bare sleep loop, and neither was held up for long at once."""
    for loop in (loops.plant, loops.firmware):
        due = loop.ticks + loop.overruns
        granted = OVERRUN_FRACTION_UML * due if under_uml else OVERRUN_FRACTION * due
        if loop.ticks == 0 or loop.overruns > 2 * (baseline_overruns or 0) + granted:
            return False
        if (loop.longest_hold_ms or 0.0) >= LONGEST_HOLD_MS:
            return False
        if loop.work_us.p99 is None or loop.work_us.p99 > LONGEST_WORK_P99_US:
            return False
    return True


def hold_window(firmware: Records) -> Window | None:
    """The longest unbroken stretch of mode RUN, which begins where the run-up ends."""
    mode, t_s = column(firmware, "outputs.mode"), column(firmware, "t_s")
    running = np.flatnonzero(mode == Mode.RUN)
    if len(running) == 0:
        return None
    spans = np.split(running, np.flatnonzero(np.diff(running) > 1) + 1)
    longest = max(spans, key=lambda span: t_s[span[-1]] - t_s[span[0]])
    return Window(float(t_s[longest[0]]), float(t_s[longest[-1]]))


def peak_force(plant: Records, impacts: Records) -> float | None:
    """The largest force on the stop, of the located impacts or between them; None at a rigid stop."""
    located = column(impacts, "peak_force_n")
    if len(located) and not np.isfinite(located).any():
        return None
    sampled = column(plant, "stop_force_n")
    forces = np.concatenate([located[np.isfinite(located)], sampled[np.isfinite(sampled)]])
    return float(forces.max()) if len(forces) else None


def felt_figures(traces: RunTraces, hold: Window | None) -> FeltFigures:
    """Peaks of the force on the wearer: of the run, and from turn to turn of the crank once settled."""
    plant = traces.plant
    if not traces.is_worn or len(plant) == 0:
        return FeltFigures(None, None, None)
    force_n = np.abs(column(plant, "felt_force_n"))
    peak_n = float(force_n.max())
    if hold is None:
        return FeltFigures(peak_n, None, None)
    late = hold.second_half().holds(column(plant, "t_s"))
    turns = np.floor(np.unwrap(column(plant, "crank_rad")[late]) / (2.0 * np.pi))
    starts = np.flatnonzero(np.diff(turns) > 0.0) + 1
    if len(starts) < 2:
        return FeltFigures(peak_n, None, None)
    whole = force_n[late][: starts[-1]]
    peaks_n = np.maximum.reduceat(whole, starts[:-1])
    return FeltFigures(peak_n, float(peaks_n.min()), float(peaks_n.max()))


def energy_residual(plant: Records) -> float | None:
    """What work of drive and housing − stored − all losses leaves, over the sum of their magnitudes."""
    if len(plant) == 0:
        return None
    names = ("drive_work_j", "stored_j", "friction_j", "impact_loss_j", "housing_work_j", "ankle_j")
    changes = [float(np.diff(column(plant, name)[[0, -1]])[0]) for name in names]
    drive, stored, friction, loss, housing, ankle = changes
    exchanged = sum(map(abs, changes))
    left = drive - stored - friction - loss + housing - ankle
    return abs(left) / exchanged if exchanged > 0.0 else 0.0


def estimate_figures(plant: Records, firmware: Records, hold: Window | None) -> EstimateFigures:
    """Errors of the estimate at tick k against the truth that its sensors were sampled from, at t_k."""
    if hold is None or len(plant) == 0:
        return EstimateFigures(None, None, None, None)
    inside = firmware[hold.holds(column(firmware, "t_s"))]
    _, of_plant, of_firmware = np.intersect1d(
        column(plant, "tick"), column(inside, "tick"), return_indices=True, assume_unique=True
    )
    truth, estimated = plant[of_plant], inside[of_firmware]
    x_error = column(estimated, "state.estimator.x_m") - column(truth, "x_m")
    v_error = column(estimated, "state.estimator.v_m_s") - column(truth, "v_m_s")
    nis = column(estimated, "state.estimator.nis")
    return EstimateFigures(
        x_rmse_m=rms(x_error),
        v_rmse_m_s=rms(v_error),
        x_worst_m=float(np.max(np.abs(x_error))) if len(x_error) else None,
        nis_mean=float(np.mean(nis)) if len(nis) else None,
    )


def detector_figures(plant: Records, impacts: Records, firmware: Records) -> DetectorFigures:
    """Detections, timed by the tick that reports them, against touch-downs while the firmware was alive."""
    nothing = DetectorFigures(None, None, Latency(None, None), None, 0)
    if len(plant) == 0 or len(firmware) == 0:
        return nothing
    alive_until_s = float(column(firmware, "t_s")[-1]) - detection.LONGEST_LATENCY_S
    touch_down_s = column(impacts, "t_s")
    seen = firmware[column(firmware, "outputs.impact") != 0.0]
    detected_s = column(seen, "t_s")
    pairs = detection.match(touch_down_s, detected_s)
    found = np.zeros(len(touch_down_s), bool)
    found[pairs.truth] = True
    due = detection.due(column(impacts, "v_m_s"), column(impacts, "peak_force_n"))
    due &= touch_down_s <= alive_until_s
    slept_through = due & ~found & detection.slept_through(touch_down_s, column(firmware, "t_s"))
    due &= ~slept_through
    judged = detected_s <= alive_until_s
    true_alarms = np.zeros(len(detected_s), bool)
    true_alarms[pairs.detection] = True
    latency_ms = 1e3 * (detected_s[pairs.detection] - touch_down_s[pairs.truth])
    speed_error = (
        column(seen, "outputs.impact_speed_m_s")[pairs.detection] - column(impacts, "v_m_s")[pairs.truth]
    )
    quantiles = np.percentile(latency_ms, [50.0, 95.0]) if len(latency_ms) else None
    return DetectorFigures(
        precision=float(np.mean(true_alarms[judged])) if judged.any() else None,
        recall=float(np.mean(found[due])) if due.any() else None,
        latency_ms=Latency(None, None)
        if quantiles is None
        else Latency(float(quantiles[0]), float(quantiles[1])),
        speed_rmse_m_s=rms(speed_error),
        slept_through=int(slept_through.sum()),
    )


def speed_figures(plant: Records, firmware: Records, hold: Window | None) -> SpeedFigures:
    """The true crank speed against the firmware's target."""
    if hold is None or len(plant) == 0:
        return SpeedFigures(None, None, None)
    late = hold.second_half()
    omega = column(plant, "omega_rad_s")[late.holds(column(plant, "t_s"))]
    target = column(firmware, "outputs.target_omega_rad_s")[late.holds(column(firmware, "t_s"))]
    if len(omega) == 0 or len(target) == 0 or target.mean() == 0.0 or omega.mean() == 0.0:
        return SpeedFigures(None, None, None)
    return SpeedFigures(
        mean_rad_s=float(omega.mean()),
        error=float(omega.mean() / target.mean() - 1.0),
        ripple=float(0.5 * np.ptp(omega) / omega.mean()),
    )


class HoldMotion(NamedTuple):
    """What the true striker did during the hold."""

    regime: Regime
    impacts_per_period: float | None
    capture_s: float | None
    impact_v_m_s: float | None
    impact_impulse_n_s: float | None


def hold_motion(plant: Records, impacts: Records, hold: Window | None) -> HoldMotion:
    """Regime, impacts per turn, capture, typical approach speed and impulse over the hold."""
    if hold is None or len(plant) == 0:
        return HoldMotion(Regime.UNCERTAIN, None, None, None, None)
    strong = impacts[column(impacts, "v_m_s") >= detection.WEAKEST_V_M_S]
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
    """The first impact from which on, to the end of the hold, none lies 1.5 drive periods from the last."""
    if len(impacts_t_s) == 0 or hold.end_s - impacts_t_s[-1] > 1.5 * period_s:
        return None
    breaks = np.flatnonzero(np.diff(impacts_t_s) > 1.5 * period_s)
    return float(impacts_t_s[breaks[-1] + 1 if len(breaks) else 0])


def zero_after(t_s: FloatArray, torque_n_m: FloatArray, since_s: float) -> float | None:
    """Seconds after `since_s` until |torque| stays below what counts as none; None if it never does."""
    later = t_s >= since_s
    if not later.any():
        return None
    pushing = np.flatnonzero(~(np.abs(torque_n_m[later]) < NO_TORQUE_N_M))
    if len(pushing) == 0:
        return 0.0
    if pushing[-1] == np.count_nonzero(later) - 1:
        return None
    return float(t_s[later][pushing[-1] + 1] - since_s)


class DriveEnd(NamedTuple):
    """Why and when the drive was to be off for good."""

    cause: str
    at_s: float


def drive_end(plant: Records, firmware: Records) -> DriveEnd | None:
    """The last end of driving: by a node's death, a fault, an E-stop or a stop; None while still driving."""
    t_s, mode = column(firmware, "t_s"), column(firmware, "outputs.mode")
    driving = np.flatnonzero(np.isin(mode, MOVING))
    if len(driving) == 0:
        return None
    plant_t_s = column(plant, "t_s")
    plant_end_s = float(plant_t_s[-1]) if len(plant_t_s) else 0.0
    last = driving[-1]
    if len(plant) and plant_end_s < t_s[-1] - SILENT_S and plant_end_s <= t_s[last]:
        return DriveEnd("plant-silent", plant_end_s)
    if last < len(mode) - 1:
        after = mode[last + 1]
        cause = "fault" if after == Mode.FAULT else "e-stop" if after == Mode.E_STOP else "stop"
        return DriveEnd(cause, float(t_s[last + 1]))
    if t_s[-1] < plant_end_s - SILENT_S:
        return DriveEnd("firmware-silent", float(t_s[-1]))
    return None


def safe_state_figures(
    plant: Records, firmware: Records, impacts: Records, end: DriveEnd | None
) -> SafeStateFigures:
    """How the drive came to rest after `end`."""
    if end is None:
        return SafeStateFigures(None, None, None, None, None)
    strong = column(impacts, "v_m_s") >= detection.WEAKEST_V_M_S
    return SafeStateFigures(
        cause=end.cause,
        at_s=end.at_s,
        torque_zero_after_s=zero_after(column(plant, "t_s"), column(plant, "motor_torque_n_m"), end.at_s),
        command_zero_after_s=zero_after(
            column(firmware, "t_s"), column(firmware, "outputs.torque_n_m"), end.at_s
        ),
        impacts_after=int(np.count_nonzero(strong & (column(impacts, "t_s") > end.at_s)))
        if len(plant)
        else None,
    )


def first_of_the_script(scenario: Mapping[str, Any]) -> Window | None:
    """The first fault's begin and end; None where the script has no fault."""
    faults = scenario.get("script", {}).get("faults", [])
    if not faults:
        return None
    first = min(faults, key=lambda fault: float(fault["at_s"]))
    at_s = float(first["at_s"])
    return Window(at_s, at_s + float(first.get("duration_s", 0.0)))


def fault_figures(traces: RunTraces, hold: Window | None) -> FaultFigures:
    """What followed the first fault of the script."""
    plant, impacts = traces.plant, traces.impacts
    fault = first_of_the_script(traces.scenario)
    if fault is None or len(plant) == 0 or column(plant, "t_s")[-1] < fault.start_s:
        return FaultFigures(None, None, None, None, None, None, None)
    t_s, torque_n_m = column(plant, "t_s"), column(plant, "motor_torque_n_m")
    speed = column(plant, "omega_rad_s")
    since = t_s >= fault.start_s
    strong = impacts[column(impacts, "v_m_s") >= detection.WEAKEST_V_M_S]
    strong_t_s, forces = column(strong, "t_s"), column(strong, "peak_force_n")
    zero_s = zero_after(t_s, torque_n_m, fault.start_s)
    forces_n = forces[strong_t_s >= fault.start_s]
    hit = forces_n[np.isfinite(forces_n)]
    again_s = None
    if hold is not None and hold.end_s > fault.end_s:
        turning = np.abs(speed[hold.holds(t_s)])
        period_s = 2.0 * np.pi / float(turning.mean()) if len(turning) and turning.mean() > 0.0 else np.inf
        late = strong_t_s[(strong_t_s >= fault.end_s) & (strong_t_s <= hold.end_s)]
        again = capture(late, hold, period_s)
        again_s = None if again is None else again - fault.end_s
    return FaultFigures(
        torque_zero_after_s=zero_s,
        impacts_after_zero=None
        if zero_s is None
        else int(np.count_nonzero(strong_t_s > fault.start_s + zero_s)),
        largest_torque_n_m=float(np.max(np.abs(torque_n_m[since]))),
        largest_speed_rad_s=float(np.max(np.abs(speed[since]))),
        peak_force_n=float(hit.max()) if len(hit) else 0.0 if len(forces_n) == 0 else None,
        impacts_again_after_s=again_s,
        turning_at_end_rad_s=float(speed[t_s > t_s[-1] - 0.5].mean()),
    )


def torque_after(plant: Records, end: DriveEnd | None) -> float | None:
    """The largest |motor torque| from `SETTLE_S` after the end of driving."""
    if end is None:
        return None
    settled = column(plant, "motor_torque_n_m")[column(plant, "t_s") >= end.at_s + SETTLE_S]
    return float(np.max(np.abs(settled))) if len(settled) else None


def first_fault(firmware: Records) -> Fault:
    """The first fault the firmware latched."""
    fault = column(firmware, "outputs.fault")
    latched = fault[fault != Fault.NONE]
    return Fault(int(latched[0])) if len(latched) else Fault.NONE


def held_ms(records: Records, until_s: float, period_s: float) -> float | None:
    """The longest a loop was held up in the time before `until_s`; None without two ticks there."""
    t_s = column(records, "t_s")
    near = (t_s > until_s - BEFORE_FAULT_S) & (t_s <= until_s + period_s)
    ticks = column(records, "tick")[near]
    return 1e3 * period_s * float(np.diff(ticks).max() - 1) if len(ticks) > 1 else None


def latched_figures(plant: Records, firmware: Records, period_s: float) -> LatchedFigures:
    """How the loops kept their pace before the first fault."""
    latched = np.flatnonzero(column(firmware, "outputs.fault") != Fault.NONE)
    if len(latched) == 0:
        return LatchedFigures(None, None, None)
    at_s = float(column(firmware, "t_s")[latched[0]])
    return LatchedFigures(at_s, held_ms(firmware, at_s, period_s), held_ms(plant, at_s, period_s))


# --- whole -------------------------------------------------------------------------------------------


def memory_figures(outcome: Mapping[str, Any]) -> MemoryFigures:
    """The growth of memory that the bench has noted, if the run was long enough."""
    growth_mb = dict(outcome.get("memory_growth_mb", {}))
    recorder_mb = growth_mb.pop("recorder", None)
    return MemoryFigures(
        nodes_growth_mb=max(growth_mb.values(), default=None),
        recorder_growth_mb_min=None
        if recorder_mb is None
        else recorder_mb / (float(outcome["memory_watched_s"]) / 60.0),
    )


def log_figures(traces: RunTraces, clock: str) -> LogFigures:
    """What the recorder lost."""
    if not traces.run.get("counts_losses", clock == "lockstep"):
        return LogFigures(None, None)
    return LogFigures(
        frames_lost=sum(loss.frames for loss in traces.losses),
        lost_s=sum(loss.to_s - loss.from_s for loss in traces.losses),
    )


def figures_from(traces: RunTraces) -> Figures:
    """All figures of one run."""
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    run, outcome = traces.run, traces.outcome
    period_s = float(run.get("period_s", DEFAULT_PERIOD_S))
    clock = str(run.get("clock", "lockstep"))
    loops = Loops(plant=loop_timing(plant, period_s), firmware=loop_timing(firmware, period_s))
    baseline = outcome.get("baseline_overruns")
    under_uml = bool(run.get("user_mode_linux", False))
    hold = hold_window(firmware)
    motion = hold_motion(plant, impacts, hold)
    end = drive_end(plant, firmware)
    impacts_t_s, impacts_v_m_s = column(impacts, "t_s"), column(impacts, "v_m_s")
    before = impacts_v_m_s[impacts_t_s < hold.start_s] if hold is not None else impacts_v_m_s
    reported = column(firmware, "outputs.regime")
    if hold is not None:
        reported = reported[hold.holds(column(firmware, "t_s"))]
    mode = column(firmware, "outputs.mode")
    last_tick = max(
        (float(column(records, "tick")[-1]) for records in (plant, firmware) if len(records)), default=-1
    )
    duration_s = (last_tick + 1.0) * period_s
    elapsed_s = outcome.get("wall_s")
    return Figures(
        scenario=str(run.get("scenario", "")),
        clock=clock,
        bus=str(run.get("bus", "")),
        kernel_can=bool(run.get("kernel_can", False)),
        real_time=met_its_timing(loops, baseline, under_uml) if clock == "real" else None,
        duration_s=duration_s,
        ticks=loops.firmware.ticks,
        overruns=loops.plant.overruns + loops.firmware.overruns,
        baseline_overruns=baseline,
        late_wakeups=loops.plant.late_wakeups + loops.firmware.late_wakeups,
        long_work=loops.plant.long_work + loops.firmware.long_work,
        tick_us=loops.firmware.work_us,
        wake_us=loops.firmware.wake_us,
        loops=loops,
        bus_load=mean_load(traces.bus.length, duration_s),
        realtime_factor=duration_s / float(elapsed_s) if elapsed_s else None,
        memory=memory_figures(outcome),
        log=log_figures(traces, clock),
        losses=tuple(traces.losses),
        impacts=tuple(
            TrueImpact(float(t), float(v)) for t, v in zip(impacts_t_s, impacts_v_m_s, strict=True)
        ),
        impact_count=len(impacts_t_s),
        regime=lower_name(motion.regime),
        regime_estimated=lower_name(Regime(int(reported[-1])) if len(reported) else Regime.UNCERTAIN),
        hold_start_s=hold.start_s if hold else None,
        hold_end_s=hold.end_s if hold else None,
        impacts_per_period=motion.impacts_per_period,
        capture_s=motion.capture_s,
        largest_v_m_s=float(impacts_v_m_s.max()) if len(impacts_v_m_s) else None,
        largest_v_on_the_way_m_s=float(before.max()) if len(before) else None,
        impact_v_m_s=motion.impact_v_m_s,
        impact_impulse_n_s=motion.impact_impulse_n_s,
        peak_force_n=peak_force(plant, impacts),
        felt=felt_figures(traces, hold),
        gait=gait_figures(traces, hold),
        estimate=estimate_figures(plant, firmware, hold),
        detector=detector_figures(plant, impacts, firmware),
        speed=speed_figures(plant, firmware, hold),
        fault=lower_name(first_fault(firmware)),
        latched=latched_figures(plant, firmware, period_s),
        final_mode=lower_name(Mode(int(mode[-1]))) if len(mode) else "none",
        motor_torque_after_stop_n_m=torque_after(plant, end),
        safe_state=safe_state_figures(plant, firmware, impacts, end),
        after_fault=fault_figures(traces, hold),
        energy_residual=energy_residual(plant),
    )


def figures_of(run_dir: Path) -> Figures:
    """All figures of the run in `run_dir`."""
    return figures_from(read_run(run_dir))
