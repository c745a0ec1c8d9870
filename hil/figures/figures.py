"""Computes all figures of a run from its traces alone, with the same code for lockstep and real time.

Truth is the plant's trace and its located impacts; the estimate is the firmware's trace. Of the firmware's
signals the figures use only the hold (mode RUN), its commands, faults, detections and estimates.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.interface.enums import Mode, Regime
from firmware_py.shell.builds import is_build
from hil.bus.base import OWN_BUSES
from hil.figures import detection, faults
from hil.figures.estimate_error import estimate_errors
from hil.figures.gait import gait_figures
from hil.figures.gaps import gaps_of
from hil.figures.gate import gate_figures
from hil.figures.hold import Window, hold_motion, hold_window
from hil.figures.records import (
    DetectorFigures,
    EstimateFigures,
    FeltFigures,
    Figures,
    Latency,
    LogFigures,
    LoopFigures,
    Loops,
    MemoryFigures,
    SpeedFigures,
    Spread,
    TrueImpact,
    no_figures,
)
from hil.record.rrd.rates import slow_rows
from hil.record.run_traces import RunTraces, column, read_run
from hil.record.state_timeline import lower_name
from hil.record.traces.stored_trace import Records
from hil.roster import AGAIN, names
from hil.timing.clock import IMPORTED, TICK_S
from hil.timing.pacemaker import Hold
from plant_sim.arrays import FloatArray

LONGEST_WORK_P99_US = 500.0
"""Longest work of a loop: half a tick, which leaves the other half to the other loop."""
LONGEST_HOLD_MS = 3.0
"""Shortest stall that disturbs the controlled motion even if it is rare: an impact lasts 10 ms, and its
detection takes a few ticks."""
OVERRUN_FRACTION = 1e-3
"""Allowed overruns in addition to twice those of a bare sleep loop, as a share of the ticks due."""
OVERRUN_FRACTION_UML = 1e-2
"""The same share under user-mode Linux, where a system call takes about 12 µs and a bare loop overruns."""


# --- parts -------------------------------------------------------------------------------------------


def spread(values: FloatArray) -> Spread:
    """Quantiles of the finite values."""
    finite = values[np.isfinite(values)]
    if len(finite) == 0:
        return no_figures(Spread)
    p50, p99 = np.percentile(finite, [50.0, 99.0])
    return Spread(float(p50), float(p99), float(finite.max()))


def rms(errors: FloatArray) -> float | None:
    """Root mean square; None without errors."""
    return float(np.sqrt(np.mean(errors**2))) if len(errors) else None


def loop_figures(records: Records, period_s: float, is_from_bus: bool) -> LoopFigures:
    """A loop's timing from its own trace; skipped ticks are the numbers missing in its ticks from 0 on.

    Of a trace that is made from frames on the bus, which has no ticks before the firmware's first heartbeat,
    they are those missing from its first tick on. A duration of 0 was not measured, as in lockstep.
    """
    tick = column(records, "tick")
    first = int(tick[0]) if is_from_bus and len(tick) else 0
    work_us, wake_us = column(records, "work_us"), column(records, "wake_latency_us")
    half_tick_us = 0.5e6 * period_s
    has_cpu = "cpu_us" in (records.dtype.names or ())
    own_us = column(records, "cpu_us") if has_cpu else work_us
    held = np.diff(tick) - 1.0
    longest = int(np.argmax(held)) if len(held) else None
    return LoopFigures(
        ticks=len(tick),
        overruns=int(tick[-1]) + 1 - first - len(tick) if len(tick) else 0,
        late_wakeups=int(np.count_nonzero(wake_us > half_tick_us)),
        long_work=int(np.count_nonzero(own_us > half_tick_us)),
        longest_hold_ms=None if longest is None else 1e3 * period_s * float(held[longest]),
        longest_hold_at_s=None if longest is None else period_s * (float(tick[longest]) + 1.0),
        work_us=spread(work_us[work_us > 0.0]),
        wake_us=spread(wake_us[wake_us > 0.0]),
    )


def both_loops(traces: RunTraces, period_s: float, is_imported: bool) -> Loops:
    """The timing of both loops; what an own controller has done is known from the bus."""
    is_own = not is_build(traces.run.get("firmware", "compiled"))
    return Loops(
        loop_figures(traces.plant, period_s, is_imported),
        loop_figures(traces.firmware, period_s, is_imported or is_own),
    )


def has_met_timing(
    loops: Loops, baseline_overruns: int | None, under_uml: bool, held_ms: Sequence[float] = ()
) -> bool:
    """Whether both loops met their overrun and work limits, and neither stalled for `LONGEST_HOLD_MS`.

    `held_ms`: the holds of a run in which time is held; each tick held counts as an overrun.
    """
    held = int(sum(held_ms))
    if max(held_ms, default=0.0) >= LONGEST_HOLD_MS:
        return False
    for loop in (loops.plant, loops.firmware):
        due = loop.ticks + loop.overruns
        granted = OVERRUN_FRACTION_UML * due if under_uml else OVERRUN_FRACTION * due
        if loop.ticks == 0 or loop.overruns + held > 2 * (baseline_overruns or 0) + granted:
            return False
        if loop.long_work > granted:
            return False
        if (loop.longest_hold_ms or 0.0) >= LONGEST_HOLD_MS:
            return False
        if loop.work_us.p99 is None or loop.work_us.p99 > LONGEST_WORK_P99_US:
            return False
    return True


def peak_force(plant: Records, impacts: Records) -> float | None:
    """The largest force on the stop in N, in located impacts or between them; None with a rigid stop."""
    located = column(impacts, "peak_force_n")
    if len(located) and not np.isfinite(located).any():
        return None
    sampled = column(plant, "stop_force_n")
    forces = np.concatenate([located[np.isfinite(located)], sampled[np.isfinite(sampled)]])
    return float(forces.max()) if len(forces) else None


def peaks_by_turn(crank_rad: FloatArray, values: FloatArray) -> FloatArray:
    """The largest of `values` in each whole turn of the crank, shape (turns,); inputs of shape (ticks,)."""
    turns = np.floor(np.unwrap(crank_rad) / (2.0 * np.pi))
    starts = np.flatnonzero(np.diff(turns) > 0.0) + 1
    if len(starts) < 2:
        return np.zeros(0)
    return np.maximum.reduceat(values[: starts[-1]], starts[:-1])


def felt_figures(traces: RunTraces, hold: Window | None) -> FeltFigures:
    """Peak force on the wearer in the run, and per turn of the crank in the settled half of the hold."""
    plant = traces.plant
    if not traces.is_worn or len(plant) == 0:
        return no_figures(FeltFigures)
    force_n = np.abs(column(plant, "felt_force_n"))
    peak_n = float(force_n.max())
    if hold is None:
        return FeltFigures(peak_n, None, None)
    late = hold.second_half().holds(column(plant, "t_s"))
    peaks_n = peaks_by_turn(column(plant, "crank_rad")[late], force_n[late])
    if len(peaks_n) == 0:
        return FeltFigures(peak_n, None, None)
    return FeltFigures(peak_n, float(peaks_n.min()), float(peaks_n.max()))


def energy_residual(plant: Records) -> float | None:
    """|Work of drive and housing − change of stored energy − losses| over the sum of their magnitudes."""
    plant = slow_rows(plant)  # the records in which the log has the energies
    if len(plant) == 0:
        return None
    names = ("drive_work_j", "stored_j", "friction_j", "impact_loss_j", "housing_work_j", "ankle_j")
    changes = [float(np.diff(column(plant, name)[[0, -1]])[0]) for name in names]
    drive, stored, friction, loss, housing, ankle = changes
    exchanged = sum(map(abs, changes))
    left = drive - stored - friction - loss + housing - ankle
    return abs(left) / exchanged if exchanged > 0.0 else 0.0


def estimate_figures(plant: Records, firmware: Records, hold: Window | None) -> EstimateFigures:
    """Errors of the estimate at tick k against the truth at t_k, the sampling instant of its sensors."""
    if hold is None or len(plant) == 0:
        return no_figures(EstimateFigures)
    inside = firmware[hold.holds(column(firmware, "t_s"))]
    errors = estimate_errors(plant, inside)
    nis = column(inside, "state.estimator.nis")
    return EstimateFigures(
        x_rmse_m=rms(errors.x_m),
        v_rmse_m_s=rms(errors.v_m_s),
        x_worst_m=float(np.max(np.abs(errors.x_m))) if len(errors.x_m) else None,
        nis_mean=float(np.mean(nis)) if len(nis) else None,
    )


def detector_figures(plant: Records, impacts: Records, firmware: Records) -> DetectorFigures:
    """Compare detections, timed by the reporting tick, with the touch-downs while the firmware ran."""
    if len(plant) == 0 or len(firmware) == 0:
        return no_figures(DetectorFigures)
    seen, pairs, due, slept_through, counts = detection.compare(impacts, firmware)
    quantiles = np.percentile(1e3 * pairs.latency_s, [50.0, 95.0]) if len(pairs.latency_s) else None
    return DetectorFigures(
        precision=float(np.mean(~pairs.false[counts])) if counts.any() else None,
        recall=float(np.mean(pairs.found[due])) if due.any() else None,
        latency_ms=no_figures(Latency) if quantiles is None else Latency(*map(float, quantiles)),
        speed_rmse_m_s=rms(detection.speed_errors(pairs, seen, impacts)),
        slept_through=int(slept_through.sum()),
    )


def speed_figures(plant: Records, firmware: Records, hold: Window | None) -> SpeedFigures:
    """The true crank speed against the firmware's target."""
    if hold is None:
        return no_figures(SpeedFigures)
    late = hold.second_half()
    omega = column(plant, "omega_rad_s")[late.holds(column(plant, "t_s"))]
    target = column(firmware, "outputs.target_omega_rad_s")[late.holds(column(firmware, "t_s"))]
    if len(omega) == 0 or target.mean() == 0.0 or omega.mean() == 0.0:
        return no_figures(SpeedFigures)
    return SpeedFigures(
        mean_rad_s=float(omega.mean()),
        error=float(omega.mean() / target.mean() - 1.0),
        ripple=float(0.5 * np.ptp(omega) / omega.mean()),
    )


# --- whole run -------------------------------------------------------------------------------------------


def memory_figures(outcome: Mapping[str, Any]) -> MemoryFigures:
    """Growth of memory as recorded by the bench, if the run was long enough."""
    growth_mb = dict(outcome.get("memory_growth_mb", {}))
    recorder_mb = growth_mb.pop("recorder", None)
    return MemoryFigures(
        nodes_growth_mb=max(growth_mb.values(), default=None),
        recorder_growth_mb_min=None
        if recorder_mb is None
        else recorder_mb / (float(outcome["memory_watched_s"]) / 60.0),
    )


def senders_of(run: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The counts of the nodes that send, from the content of run.json."""
    return [one for name, one in run.get("nodes", {}).items() if name.removesuffix(AGAIN) in names()]


def refusals_of(run: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """The counts of those that hand frames to the bus: the nodes that send, and the adapter's bridge."""
    return [*senders_of(run), *([run["bridge"]] if "bridge" in run else [])]


def log_figures(traces: RunTraces, clock: str) -> LogFigures:
    """The frames that the recorder has lost, those of others, and those that no node could send.

    In lockstep all are recorded, and the bus model counts the frames that are not sent. In real time the bus
    counts lost frames, and nodes the frames that they could not send. On the run's own bus every frame that a
    node has sent was on the bus, so that those which are neither recorded nor counted are lost as well.
    """
    if clock == "lockstep":
        errors = traces.bus_errors
        if len(errors) == 0:
            return LogFigures(0, None, 0)
        is_counted = "unsent" in errors.dtype.names  # earlier logs do not have it
        return LogFigures(0, None, int(column(errors, "unsent")[-1]) if is_counted else None)
    nodes = traces.run.get("nodes", {})
    if "recorder" not in nodes:
        return no_figures(LogFigures)
    recorded, lost = nodes["recorder"]["frames"], nodes["recorder"]["lost"]
    counts_losses = traces.run.get("counts_losses", False)
    if any("sent" not in nodes.get(name, {}) for name in names()):
        return LogFigures(lost if counts_losses else None, None, None)
    unsent = sum(one["unsent"] for one in refusals_of(traces.run))
    if not counts_losses:
        return LogFigures(None, None, unsent)
    missing = sum(one["sent"] for one in senders_of(traces.run)) - unsent - recorded - lost
    uncounted = max(0, missing) if traces.run.get("bus") in OWN_BUSES else 0
    return LogFigures(lost + uncounted, max(0, -missing), unsent)


def impact_count(traces: RunTraces) -> int | None:
    """The number of true touch-downs; None without truth, and where a log that was cut has lost them."""
    counted = len(traces.impacts)
    has_all = bool(traces.outcome) or counted > 0
    return counted if has_all and len(traces.plant) else None


def figures_from(traces: RunTraces) -> Figures:
    """All figures of one run."""
    plant, firmware, impacts = traces.plant, traces.firmware, traces.impacts
    run, outcome = traces.run, traces.outcome
    period_s = float(run.get("period_s", TICK_S))
    clock = str(run.get("clock", "lockstep"))
    loops = both_loops(traces, period_s, clock == IMPORTED)
    baseline = outcome.get("baseline_overruns")
    under_uml = bool(run.get("user_mode_linux", False))
    time_held = tuple(Hold(**one) for one in outcome.get("holds", []))
    held_ms = [1e3 * one.whole_s for one in time_held]
    hold = hold_window(firmware)
    motion = hold_motion(plant, impacts, hold)
    end = faults.drive_end(plant, firmware)
    impacts_t_s, impacts_v_m_s = column(impacts, "t_s"), column(impacts, "v_m_s")
    before = impacts_v_m_s[impacts_t_s < hold.start_s] if hold is not None else impacts_v_m_s
    reported = column(firmware, "outputs.regime")
    if hold is not None:
        reported = reported[hold.holds(column(firmware, "t_s"))]
    mode = column(firmware, "outputs.mode")
    last_tick = max(
        (float(column(records, "tick")[-1]) for records in (plant, firmware) if len(records)), default=-1
    )
    duration_s = float(run.get("duration_s", (last_tick + 1.0) * period_s))
    elapsed_s = outcome.get("wall_s")
    return Figures(
        scenario=str(run.get("scenario", "")),
        clock=clock,
        bus=str(run.get("bus", "")),
        kernel_can=bool(run.get("kernel_can", False)),
        real_time=has_met_timing(loops, baseline, under_uml, held_ms) if clock == "real" else None,
        time=str(run.get("time", "strict")) if clock == "real" else None,
        held_s=outcome.get("held_s"),
        own_late_s=outcome.get("own_late_s"),
        time_held=time_held,
        gaps=tuple(gaps_of(traces, period_s)),
        duration_s=duration_s,
        ticks=loops.firmware.ticks,
        overruns=loops.plant.overruns + loops.firmware.overruns,
        baseline_overruns=baseline,
        late_wakeups=loops.plant.late_wakeups + loops.firmware.late_wakeups,
        long_work=loops.plant.long_work + loops.firmware.long_work,
        tick_us=loops.firmware.work_us,
        wake_us=loops.firmware.wake_us,
        loops=loops,
        bus_load=traces.bus.load.mean(duration_s),
        realtime_factor=duration_s / float(elapsed_s) if elapsed_s else None,
        memory=memory_figures(outcome),
        log=log_figures(traces, clock),
        impacts=tuple(
            TrueImpact(float(t), float(v)) for t, v in zip(impacts_t_s, impacts_v_m_s, strict=True)
        ),
        impact_count=impact_count(traces),
        impacts_reported=len(detection.select_reported(firmware)),
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
        fault=lower_name(faults.first_fault(firmware)),
        latched=faults.latched_figures(plant, firmware, period_s),
        final_mode=lower_name(Mode(int(mode[-1]))) if len(mode) else "none",
        motor_torque_after_stop_n_m=faults.torque_after(plant, end),
        safe_state=faults.safe_state_figures(plant, firmware, impacts, end),
        after_fault=faults.fault_figures(traces, hold),
        gate=gate_figures(traces),
        energy_residual=energy_residual(plant),
    )


def figures_of(run_dir: Path) -> Figures:
    """All figures of the run in `run_dir`."""
    return figures_from(read_run(run_dir))
