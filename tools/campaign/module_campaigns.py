"""The campaigns on sampled modules: start-up, estimate, detect, hold, recover; their judges and goals.

A judge compares the run of one trial with the truth.
"""

import math

import numpy as np

from firmware_py.interface.enums import Fault, Mode, Refusal, Regime
from hil.figures import detection, true_regime
from plant_sim.arrays import FloatArray
from tools.campaign import reference
from tools.campaign.campaign import Campaign, Goal, Outcome, Trial
from tools.campaign.modules import MODULES, RUN_S, SETTLED_S
from tools.campaign.run import Run
from tools.campaign.sampling import MISMATCH

TRANSIENT_S = 1.5
"""Time after the command during which impacts may result from the sampled initial state, s."""
SETTLE_S = 5.0
"""Time in mode RUN before the estimate and the regime are judged, s."""
CAPTURED_S = RUN_S + 8.0
"""Time by which a nominal capture is complete, s after power-up."""
KICK_FAULT_S = 1.0
"""An impulse-limit fault within this time after a kick is attributed to the kick, s."""
LATE_IMPACTS = 10
"""Number of last impacts whose mean v⁻ is the steady v⁻; its largest value is taken from twice as many."""
LATE_TURNS = 10
"""Number of last turns of the crank; their median duration gives the speed that is kept."""
TARGET_SHARE = 0.02
"""A turn is at speed if its duration differs from the median of the last turns by at most this share."""
FEWEST_TURNS = 10
"""Fewest turns of the crank from which the true regime is found."""
LEAST_JUDGED_S = 5.0
"""Shortest time in mode RUN for which an estimate is judged, s."""


def find_loss(done: Run, duration_s: float, omega_rad_s: float) -> str:
    """Return why the run does not end in mode RUN with lasting impacts; empty if it does."""
    started = [change for change in done.modes if change.t_s >= RUN_S]
    if not any(change.mode == Mode.SOFT_START for change in started):
        faults = [change.fault.name for change in done.modes if change.fault != Fault.NONE]
        return f"never started{': ' + faults[-1].lower() if faults else ''}"
    if done.modes[-1].mode != Mode.RUN:
        return f"ends in {done.last_word}"
    if not reference.goes_on(done.impacts["t_s"], duration_s, min(omega_rad_s, kept_omega(done))):
        return "in mode RUN, but without lasting impacts at the end"
    return ""


def kept_omega(done: Run) -> float:
    """Return the crank's speed in its last turns, rad/s.

    It is below the requested speed if the firmware keeps a distance from the fold.
    """
    return float(2.0 * np.pi / np.median(np.diff(done.turns_s[-LATE_TURNS - 1 :])))


def energy_j(done: Run, until_s: float) -> float:
    """Return the energy that the crank took after the command to run, J.

    ∫ max(T ω, 0) dt: the motor's negative power is not recovered.
    """
    power_w = done.true("motor_torque_n_m") * done.true("omega_rad_s")
    taken_w = power_w[round(RUN_S / done.tick_s) : round(until_s / done.tick_s)]
    return float(np.sum(np.maximum(taken_w, 0.0)) * done.tick_s)


def judge_start_up(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge a capture of the impact regime: time, energy and overshoot.

    The overshoot is the largest v⁻ on the way, relative to the largest steady v⁻; at low ratios it is
    relative to the largest v⁻ of a slow run-up if that is larger.
    """
    scene, duration_s, omega_rad_s = trial.scenario.scene, trial.scenario.duration_s, trial.omega_rad_s
    attractor = reference.reference(scene, omega_rad_s, trial.seed)
    if not attractor.exists:
        outcome.leave_out("no impact attractor at this speed")
        ended = done.modes[-1]
        refused = bool(np.any(done.firmware["outputs.refusal"] == Refusal.RATIO_TOO_HIGH))
        said = refused or ended.fault in (Fault.START_FAILED, Fault.ATTRACTOR_LOST)
        elsewhere = find_loss(done, duration_s, omega_rad_s) == ""
        outcome.count("no_regime_reported", is_part=said or elsewhere)
        return
    captures = reference.instant_start_captures(scene, omega_rad_s)
    outcome.count("instant_start_captures", is_part=captures)
    has_fault = any(change.fault != Fault.NONE and change.t_s < RUN_S for change in done.modes)
    outcome.count("fault_before_start", is_part=has_fault)
    outcome.why = find_loss(done, duration_s, omega_rad_s)
    captured = done.first_in(Mode.RUN)
    if captured is None:
        return
    outcome.metrics["capture"] = captured.t_s - RUN_S
    outcome.metrics["energy"] = energy_j(done, captured.t_s)
    times, speeds = done.impacts["t_s"], done.impacts["v_m_s"]
    way = speeds[(times > RUN_S + TRANSIENT_S) & (times <= captured.t_s + SETTLE_S)]
    if outcome.why == "" and len(way):
        outcome.metrics["steady_v"] = float(np.mean(speeds[-LATE_IMPACTS:]))
        # On a moving housing the steady impacts differ. If the firmware moved to a safer speed, those at the
        # requested speed count as well.
        steady_m_s = max(float(np.max(speeds[-2 * LATE_IMPACTS :])), attractor.hardest_m_s)
        if trial.cell.ratio >= 1.15:
            outcome.metrics["overshoot"] = float(np.max(way)) / steady_m_s
        else:
            outcome.metrics["overshoot_low_r"] = float(np.max(way)) / max(attractor.path_m_s, steady_m_s)


def judge_estimate(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge the errors of position and velocity in mode RUN, from `SETTLE_S` after a nominal capture on."""
    known = done.firmware
    judged = known["outputs.mode"] == Mode.RUN
    judged[: round((CAPTURED_S + SETTLE_S) / done.tick_s)] = False
    if np.count_nonzero(judged) < LEAST_JUDGED_S / done.tick_s:
        outcome.leave_out(find_loss(done, trial.scenario.duration_s, trial.omega_rad_s) or "no time in RUN")
        return
    x_error = (known["state.estimator.x_m"] - done.true("x_m"))[judged]
    v_error = (known["state.estimator.v_m_s"] - done.true("v_m_s"))[judged]
    outcome.metrics["x_rmse"] = 1e3 * rms(x_error)
    outcome.metrics["v_rmse"] = rms(v_error)
    outcome.metrics["x_worst"] = 1e3 * float(np.max(np.abs(x_error)))
    outcome.metrics["nis"] = float(np.mean(known["state.estimator.nis"][judged]))
    if not np.isfinite(outcome.metrics["x_rmse"]):
        outcome.why = "the estimate is no number"


def rms(values: FloatArray) -> float:
    """Return the root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def judge_detect(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Match detections with true touch-downs from power-up to the end, and judge the reported regime."""
    duration_s = trial.scenario.duration_s
    until_s = duration_s - detection.LONGEST_LATENCY_S
    true_s, speeds = done.impacts["t_s"], done.impacts["v_m_s"]
    pairs = detection.match(true_s, done.detected_s)
    due, hard = true_s <= until_s, speeds >= detection.WEAKEST_V_M_S
    found, alarms, of_hard = pairs.found, pairs.false, hard[pairs.truth]
    missed = true_s[~found & hard & due]
    alarmed = done.detected_s[alarms & (done.detected_s <= until_s)]
    hits, soft_hits = (int(np.count_nonzero(found & of & due)) for of in (hard, ~hard))
    outcome.shares |= {
        "recall": (hits, hits + len(missed)),
        "recall_below_grazing": (soft_hits, int(np.count_nonzero(~hard & due))),
        "precision": (hits + soft_hits, hits + soft_hits + len(alarmed)),
    }
    if of_hard.any():
        outcome.samples["latency"] = (1e3 * pairs.latency_s[of_hard]).tolist()
        reported_m_s = done.detections["outputs.impact_speed_m_s"][pairs.detection]
        outcome.metrics["speed_error"] = rms((reported_m_s - speeds[pairs.truth])[of_hard])
    _judge_regime(done, duration_s, outcome)
    outcome.why = (f"{len(missed)} missed (first at {missed[0]:.3f} s)" if len(missed) else "") + (
        f" {len(alarmed)} false (first at {alarmed[0]:.3f} s)" if len(alarmed) else ""
    )


def _judge_regime(done: Run, duration_s: float, outcome: Outcome) -> None:
    """Compare the regime reported in each period after a settled capture with the true regime."""
    captured = done.first_in(Mode.RUN)
    if captured is None or done.modes[-1].mode != Mode.RUN:
        return
    from_s = captured.t_s + SETTLE_S
    if np.count_nonzero(done.turns_s >= from_s) < FEWEST_TURNS:
        return
    ticks = slice(round(from_s / done.tick_s), round(duration_s / done.tick_s))
    t_s: FloatArray = done.tick_s * np.arange(ticks.start, ticks.stop).astype(np.float64)
    judged = done.impacts[(done.impacts["t_s"] >= t_s[0]) & (done.impacts["t_s"] <= t_s[-1])]
    times, speeds = judged["t_s"], judged["v_m_s"]
    periods = true_regime.cut_periods(t_s, done.true("crank_rad")[ticks], times)
    truth = true_regime.decide(t_s, done.true("v_m_s")[ticks], periods, times, speeds)
    if truth not in (Regime.IMPACT, Regime.NON_IMPACT, Regime.PERIOD_N):
        return
    late = done.firmware[ticks]
    reported = late["outputs.regime"][late["outputs.period_ended"]]
    grazing = len(speeds) > 0 and float(np.mean(speeds)) < detection.WEAKEST_V_M_S
    right = (reported == truth.value) | (grazing & (reported == Regime.UNCERTAIN.value))
    uncertain = reported == Regime.UNCERTAIN.value
    outcome.shares["regime_right"] = int(np.count_nonzero(right)), len(reported)
    outcome.shares["regime_uncertain"] = int(np.count_nonzero(uncertain)), len(reported)


def judge_hold(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge a hold: lasting impacts, their impulse and phase, and the crank's speed."""
    duration_s, omega_rad_s = trial.scenario.duration_s, trial.omega_rad_s
    outcome.why = find_loss(done, duration_s, omega_rad_s)
    held = done.impacts[done.impacts["t_s"] >= SETTLED_S]
    lasts_s = duration_s - SETTLED_S
    if outcome.why == "" and not reference.goes_on(held["t_s"], duration_s, omega_rad_s, lasts_s):
        outcome.why = "impacts missing during the hold"
    if len(held) < 2:
        return
    impulses = held["impulse_n_s"]
    phase_deg = np.degrees((held["crank_rad"] - 0.5 * np.pi + np.pi) % (2.0 * np.pi) - np.pi)
    outcome.metrics["impulse"] = float(np.mean(impulses))
    outcome.metrics["cycle_variation"] = 100.0 * float(np.std(impulses) / np.mean(impulses))
    outcome.metrics["phase"] = float(np.median(phase_deg))
    if trial.cell.impulse_n_s > 0.0:
        error = 100.0 * (float(np.mean(impulses)) / trial.cell.impulse_n_s - 1.0)
        outcome.metrics["impulse_error"] = abs(error)
        if outcome.why == "" and abs(error) > 3.0:
            outcome.why = f"impulse {error:+.1f} % off"
        outcome.metrics["phase_asked"] = float(np.percentile(phase_deg, 95))
        if outcome.why == "" and outcome.metrics["phase_asked"] > 65.0:
            outcome.why = f"impact phase {outcome.metrics['phase_asked']:.0f}°"
    judged = done.firmware["outputs.mode"] == Mode.RUN
    judged[: round(SETTLED_S / done.tick_s)] = False
    if judged.any():
        speeds = done.true("omega_rad_s")[judged]
        mean = float(np.mean(speeds))
        outcome.metrics["ripple"] = 100.0 * float(np.std(speeds)) / mean
        outcome.metrics["speed_error"] = 100.0 * abs(mean / omega_rad_s - 1.0)


def judge_recover(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge the recovery from a kick during the hold.

    Eligible are kicks after which the module at constant crank speed would end without impacts. The metric is
    the time until the crank keeps its speed and impacts last.
    """
    duration_s, omega_rad_s = trial.scenario.duration_s, trial.omega_rad_s
    kicked_s = trial.scenario.faults[0].at_s
    times = done.impacts["t_s"]
    if not reference.goes_on(times[times < kicked_s], kicked_s, omega_rad_s, 5.0):
        outcome.leave_out("no impacts before the kick")
        return
    tripped = [change for change in done.modes if change.fault == Fault.IMPULSE_LIMIT]
    if tripped and 0.0 <= tripped[0].t_s - kicked_s < KICK_FAULT_S:
        outcome.leave_out("the kick's own impact tripped the impulse limit")
        return
    kicked = math.ceil(kicked_s / done.tick_s)
    start = reference.state_at(*(float(done.true(name)[kicked]) for name in ("x_m", "v_m_s", "crank_rad")))
    if not reference.would_be_lost(trial.scenario.scene, start, omega_rad_s):
        outcome.leave_out("the kick did not throw it out")
        return
    outcome.why = find_loss(done, duration_s, omega_rad_s)
    if outcome.why == "":
        outcome.metrics["recovery"] = _back_s(done, kicked_s, omega_rad_s) - kicked_s


def _back_s(done: Run, kicked_s: float, omega_rad_s: float) -> float:
    """Return the time from which the crank keeps its speed and impacts last, s.

    The speed that is kept differs from the target if the firmware keeps a distance from the fold.
    """
    times = done.impacts["t_s"]
    gaps = reference.long_gaps(
        times, kicked_s, float(np.max(times, initial=kicked_s)), 2.0 * np.pi / omega_rad_s
    )
    from_s = gaps[-1, 1] if len(gaps) else kicked_s
    turns = done.turns_s[done.turns_s > kicked_s]
    kept_s = 2.0 * np.pi / kept_omega(done)
    off = np.flatnonzero(np.abs(np.diff(turns) / kept_s - 1.0) > TARGET_SHARE)
    return float(max(from_s, turns[off[-1] + 1] if len(off) else kicked_s))


WET_AND_DRY = ("viscous", "coulomb", "stribeck")
NO_IMPULSE = (0.0,)
RISE = "the first impacts after a soft start are harder than the steady ones"

MODULE_CAMPAIGNS = (
    Campaign(
        name="start-up",
        title="from random states into the impact regime, where one exists",
        trials=4800,
        sampler=MODULES,
        judge=judge_start_up,
        conditions=((WET_AND_DRY, (1.1, 1.2, 1.3, 1.35), NO_IMPULSE),),
        numbers={"duration_s": 32.0, "swing_m_s2": 0.5, **MISMATCH},
        units={
            "capture": "s",
            "energy": "J",
            "overshoot": "× steady",
            "overshoot_low_r": "× slow rise",
            "steady_v": "m/s",
        },
        goals=(
            Goal("eligible", low=3000, full_size=True),
            Goal("success", low=1.0),
            Goal("capture", "p95", high=8.0),
            Goal("overshoot", "worst", high=1.175, wanted=1.05, reason=RISE),
            Goal("overshoot_low_r", "worst", high=1.405, wanted=1.05, reason=RISE),
        ),
    ),
    Campaign(
        name="estimate",
        title="position and velocity in the impact regime",
        trials=300,
        sampler=MODULES,
        judge=judge_estimate,
        conditions=((("viscous",), (1.1,), NO_IMPULSE), (("coulomb-0.2",), (0.95,), NO_IMPULSE)),
        numbers={"duration_s": 30.0, **MISMATCH},
        units={"x_rmse": "mm", "v_rmse": "m/s", "x_worst": "mm", "nis": "1"},
        goals=(
            Goal("eligible", low=240, full_size=True),
            Goal("x_rmse", "p50", "viscous", high=0.9),
            Goal("v_rmse", "p50", "viscous", high=0.010),
            Goal("x_rmse", "p50", "coulomb-0.2", high=3.0),
        ),
    ),
    Campaign(
        name="detect",
        title="touch-downs found, when, and the regime reported",
        trials=440,
        sampler=MODULES,
        judge=judge_detect,
        conditions=(
            (("viscous",), (1.0, 1.1, 1.2, 1.3, 1.35), NO_IMPULSE),
            (("coulomb", "stribeck"), (1.0, 1.1, 1.2), NO_IMPULSE),
        ),
        numbers={"duration_s": 40.0, **MISMATCH},
        units={"latency": "ms", "speed_error": "m/s"},
        goals=(
            Goal("eligible", low=430, full_size=True),
            Goal("f1", low=0.999),
            Goal("latency", "p50", high=1.5),
            Goal("latency", "p95", high=2.5),
            Goal("regime_right", low=0.995),
            Goal("regime_uncertain", high=0.01),
        ),
    ),
    Campaign(
        name="hold",
        title="the impact regime, or a requested impulse, held for a minute",
        trials=700,
        sampler=MODULES,
        judge=judge_hold,
        conditions=(
            (("viscous",), (1.3, 1.4), NO_IMPULSE),
            (("viscous",), (1.3,), (0.65, 0.75, 0.85, 0.95, 1.05)),
        ),
        numbers={"hold_s": 60.0, **MISMATCH, "mismatch_spring": 0.05, "mismatch_amplitude": 0.03},
        units={
            "impulse": "N s",
            "impulse_error": "%",
            "phase": "deg",
            "phase_asked": "deg",
            "ripple": "%",
            "speed_error": "%",
            "cycle_variation": "%",
        },
        goals=(
            Goal("eligible", low=690, full_size=True),
            Goal("success", low=1.0),
            Goal("ripple", "p50", "viscous r=1.3", high=0.2),
            Goal("impulse", "lowest", "viscous r=1.4", low=1.0),
            Goal("impulse_error", "worst", high=3.0),
            Goal("phase_asked", "worst", high=65.0),
        ),
    ),
    Campaign(
        name="recover",
        title="back into the impact regime after a kick out of it",
        trials=1800,
        sampler=MODULES,
        judge=judge_recover,
        conditions=((("viscous",), (1.3, 1.35), NO_IMPULSE),),
        numbers={"duration_s": 50.0, "kick_low_m_s": 0.8, "kick_high_m_s": 1.4, **MISMATCH},
        units={"recovery": "s"},
        goals=(
            Goal("eligible", low=300, full_size=True),
            Goal("success", low=1.0),
            Goal("recovery", "p95", high=8.0),
        ),
    ),
)
