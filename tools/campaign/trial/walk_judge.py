"""The judge of the campaign `walk`: compares the firmware's gait phase and the pulses with the truth.

Felt force, pulses and phase are judged from `SETTLED_S` after the capture on, turn by turn and stride by
stride. Pulses after a stop or a stumble count until a pause (`hil.judge.figures.gait.following`); pulses that
the leg's own motion causes after the pause are counted separately.
"""

import numpy as np

from firmware_py.interface.enums import Fault, Mode
from firmware_py.interface.generated.parameters import Gait
from hil.judge.detection import WEAKEST_V_M_S
from hil.judge.figures.gait import following
from plant_sim.parts.walking import BEGIN_S, FROM_SIZE, KNOCK_M_S2, TO_SIZE, Walking
from plant_sim.sensors.gait import phases_at
from tools.campaign.trial.outcome import Outcome
from tools.campaign.trial.reference import long_gaps
from tools.campaign.trial.run import Run
from tools.campaign.trial.scenarios import Trial
from tools.campaign.trial.walk_cells import PRESETS

SETTLED_S = 5.0
SOFTEST_N, HARDEST_N = 10.0, 40.0
HARDER = 1.05
"""Limit of v⁻ after a stop or a stumble, over the steady v⁻; the leg's motion makes impacts uneven."""


def judge_walk(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge a walk: its hold, and its end or the rest of the walk."""
    (preset, course), scenario = trial.cell.values, trial.scenario
    captured = done.first_in(Mode.RUN)
    ends_s = ended_s(done.parts.housing)
    if done.first_in(Mode.SOFT_START) is None:
        outcome.leave_out("refused: no whole number of turns a stride within the region")
        return
    if captured is None or captured.t_s + SETTLED_S > ends_s:
        outcome.why = f"no hold: {last_word(done)}"
        return
    hold_s = (captured.t_s, min(left_s(done, captured.t_s), scenario.duration_s, ends_s))
    judge_hold(done, scenario.config.p.gait, hold_s, outcome)
    if course in ("stop", "stumble"):
        judge_end(done, ends_s, hold_s, PRESETS[preset].last_pulse_s, outcome)
    elif done.modes[-1].mode != Mode.RUN:
        outcome.why = f"not kept: {last_word(done)}"
    else:
        outcome.why = missing(done, hold_s)


def last_word(done: Run) -> str:
    """Return the last mode of a run, since when it lasts, and its fault, as text."""
    if not done.modes:
        return "never ready"
    last = done.modes[-1]
    fault = f", {last.fault.name.lower()}" if last.fault != Fault.NONE else ""
    return f"{last.mode.name.lower()} since {last.t_s:.1f} s{fault}"


def ended_s(walking: object) -> float:
    """Return the time at which the leg first stands after walking or stumbles, s; inf if it does neither."""
    assert isinstance(walking, Walking)
    rows = walking.rows
    walks = np.maximum(rows[:, FROM_SIZE], rows[:, TO_SIZE]) > 0.0
    stands = ~walks & (np.cumsum(walks) > 0)
    found = rows[stands | (rows[:, KNOCK_M_S2] > 0.0), BEGIN_S]
    return float(found[0]) if len(found) else float("inf")


def left_s(done: Run, since_s: float) -> float:
    """Return the time of the first change of mode after `since_s`, s; inf if there is none."""
    return next((change.t_s for change in done.modes if change.t_s > since_s), float("inf"))


def missing(done: Run, hold_s: tuple[float, float]) -> str:
    """Return the first interval of the hold in which impacts are missing, as text; empty if none are."""
    begin_s, end_s = hold_s[0] + SETTLED_S, hold_s[1]
    turns_s = done.turns_s[(done.turns_s >= begin_s) & (done.turns_s <= end_s)]
    longest_turn_s = float(np.max(np.diff(turns_s), initial=0.0))
    for since_s, until_s in long_gaps(done.impacts["t_s"], begin_s, end_s, longest_turn_s):
        return f"impacts missing from {since_s:.1f} to {until_s:.1f} s"
    return ""


def judge_hold(done: Run, gait: Gait, hold_s: tuple[float, float], outcome: Outcome) -> None:
    """Judge the felt force of each turn, the pulses of each stride, and the error of the gait phase."""
    begin_s, end_s = hold_s[0] + SETTLED_S, hold_s[1]
    ticks = np.arange(round(begin_s / done.tick_s), round(end_s / done.tick_s))
    if len(ticks) == 0:
        return
    turns = np.flatnonzero(np.diff(done.true("crank_rad")[ticks]) < -np.pi) + 1
    if len(turns) > 1:
        felt_n = np.abs(done.true("felt_force_n")[ticks])
        peaks_n = np.maximum.reduceat(felt_n[: turns[-1]], turns[:-1])
        outcome.counts["turns"] = len(peaks_n)
        outcome.counts["turns_in_force"] = int(np.sum((peaks_n >= SOFTEST_N) & (peaks_n <= HARDEST_N)))
        outcome.metrics["felt_low"] = float(np.min(peaks_n))
        outcome.metrics["felt_high"] = float(np.max(peaks_n))
    walking = done.parts.housing
    assert isinstance(walking, Walking)
    truth = phases_at(walking, ticks.astype(np.float64) * done.tick_s)
    error = (done.firmware["state.gait.phase"][ticks] - truth + 0.5) % 1.0 - 0.5
    outcome.metrics["phase_rmse"] = 100.0 * float(np.sqrt(np.mean(error**2)))
    strikes_s = ticks[1:][np.diff(truth) < -0.5] * done.tick_s
    pulses_s = done.impacts[done.impacts["v_m_s"] >= WEAKEST_V_M_S]["t_s"]
    phases = phases_at(walking, pulses_s)
    inside = (phases >= gait.window_start) & (phases <= gait.window_end)
    if len(strikes_s) > 1:
        hits = np.histogram(pulses_s[inside], strikes_s)[0]
        outcome.counts["strides"] = len(hits)
        outcome.counts["strides_hit"] = int(np.sum(hits > 0))
        outcome.metrics["pulses_per_stride"] = float(np.mean(np.histogram(pulses_s, strikes_s)[0]))


def judge_end(
    done: Run, ends_s: float, hold_s: tuple[float, float], latest_s: float, outcome: Outcome
) -> None:
    """Judge the time from a stop or a stumble to the last pulse, and the largest v⁻ after it."""
    pulses = done.impacts[done.impacts["v_m_s"] >= WEAKEST_V_M_S]
    times, speeds = pulses["t_s"], pulses["v_m_s"]
    follows = following(times, ends_s, float("inf"))
    steady = (times >= 0.5 * (sum(hold_s))) & (times <= ends_s)
    last_s = float(np.max(times[follows] - ends_s, initial=0.0))
    hardest = float(np.max(speeds[follows], initial=0.0)) / float(np.max(speeds[steady], initial=1e-9))
    outcome.metrics["last_pulse"] = last_s
    outcome.metrics["undriven"] = float(np.count_nonzero(times > ends_s) - np.count_nonzero(follows))
    outcome.metrics["hardest_after"] = hardest
    outcome.metrics["decision"] = left_s(done, hold_s[0]) - ends_s
    if last_s > latest_s:
        outcome.why = f"last pulse {last_s:.2f} s after"
    elif hardest > HARDER:
        outcome.why = f"a pulse {hardest:.2f} times as fast as the last steady ones"
