"""The campaign `walk`: suitable modules of the feasibility table, on courses of walking.

Felt force, pulses and phase are judged from `SETTLED_S` after the capture on, turn by turn and stride by
stride. Pulses after a stop or a stumble count until a pause (`hil.figures.gait.is_following`); pulses
that the leg's own motion causes after the pause are counted separately.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from firmware_py.interface.enums import Mode, Refusal
from firmware_py.interface.generated.parameters import Gait
from hil.figures.detection import WEAKEST_V_M_S
from hil.figures.figures import peaks_by_turn
from hil.figures.gait import PushOff, is_following
from hil.scenario.files import read_scenario
from hil.scenario.scenario import Scenario
from plant_sim.parts.walking import BEGIN_S, FROM_SIZE, KNOCK_M_S2, TO_SIZE, Walking
from plant_sim.scene import read_scene
from plant_sim.sensors.gait import phases_at
from tools.campaign.campaign import (
    Campaign,
    Cell,
    Goal,
    Outcome,
    Plan,
    Sampler,
    Trial,
    scenario_of,
    script_of,
)
from tools.campaign.reference import long_gaps
from tools.campaign.run import Run
from tools.campaign.sampling import MISMATCH, Sampled, sample

COURSES = ("steady", "change", "stop", "stumble")

RUN_S = 0.5
"""Time of the command RUN, s; it can be early because the striker starts at rest."""
STEADY_S = 20.0
"""Earliest time of a stop, a stumble or a change, s: three strides, the soft start, and time to settle."""
LATER_S = (0.0, 3.0)
CHANGE_SHARE, CHANGE_STRIDES = 0.2, 5
BACK_S = 25.0
"""Time between the change of cadence and the change back, s."""
AFTER_S = 10.0
"""Duration of a trial after a stop or a stumble, s."""

SETTLED_S = 5.0
EXPECTED_S = 2.5
"""Time before the leg stands or stumbles from which on the firmware may stop: 1.25 strides at 0.5 Hz."""
SOFTEST_N, HARDEST_N = 10.0, 40.0
HARDER = 1.05
"""Limit of v⁻ after a stop or a stumble, over the steady v⁻; the leg's motion makes impacts uneven."""


@dataclass(frozen=True)
class Preset:
    """A scene, a scenario whose firmware parameters suit it, and the range of cadences that it serves.

    Cadences are in strides a second. `last_pulse_s` is the longest time from a stop or a stumble to the last
    pulse.
    """

    scene: str
    nominal_of: str
    lowest_hz: float
    highest_hz: float
    last_pulse_s: float


PRESETS = {
    "walking": Preset("walking", "a-fifth-more-strides-keep-the-impacts", 0.5, 1.0, 0.8),
    "table1": Preset("table1-walking", "a-steady-walk-has-a-pulse-in-every-push-off", 0.78, 0.82, 2.0),
}
"""Presets from docs/feasibility.md: `walking` serves all cadences, `table1` a narrow band about 0.8 Hz."""


def walk_cell(preset: str, course: str) -> Cell:
    """Return the cell of a preset and a course."""
    scene, firmware = read_scene(PRESETS[preset].scene), read_scenario(PRESETS[preset].nominal_of)["firmware"]
    return Cell(f"{preset} {course}", (preset, course), scene, firmware)


class Course(NamedTuple):
    """Paces (at_s, stride_hz), times of stumbles, and the trial's duration, s."""

    paces: list[tuple[float, float]]
    stumbles: list[float]
    duration_s: float


def course_of(cell: Cell, numbers: Mapping[str, Any], dice: np.random.Generator) -> Course:
    """Sample the walk of a trial: its cadence, and the times of its events."""
    (name, course), at_s = cell.values, STEADY_S + float(dice.uniform(*LATER_S))
    lowest_hz, highest_hz = PRESETS[name].lowest_hz, PRESETS[name].highest_hz
    if course == "change":
        highest_hz = max(highest_hz / (1.0 + CHANGE_SHARE), lowest_hz)
    first_hz = float(dice.uniform(lowest_hz, highest_hz))
    whole_s = float(numbers["walk_s"])
    if course == "stop":
        return Course([(0.0, first_hz), (at_s, 0.0)], [], at_s + AFTER_S)
    if course == "stumble":
        return Course([(0.0, first_hz)], [at_s], at_s + AFTER_S)
    if course == "steady":
        return Course([(0.0, first_hz)], [], whole_s)
    second_hz = first_hz * (1.0 + CHANGE_SHARE)
    if dice.uniform() < 0.5:
        first_hz, second_hz = second_hz, first_hz
    lasts_s = 2.0 * CHANGE_STRIDES / (first_hz + second_hz)
    paces = [
        (0.0, first_hz),
        (at_s, first_hz),
        (at_s + lasts_s, second_hz),
        (at_s + BACK_S, second_hz),
        (at_s + BACK_S + lasts_s, first_hz),
    ]
    return Course(paces, [], whole_s)


def sample_walk(cell: Cell, numbers: Mapping[str, Any], seed: int, trial: int) -> tuple[Sampled, Course]:
    """Sample the truth of a trial and the wearer's walk."""
    course = course_of(cell, numbers, np.random.default_rng([seed, trial, 3]))
    scene = deepcopy(dict(cell.scene))
    scene["gait"] = {
        **scene["gait"],
        "variability": float(numbers["variability"]),
        "pace": [{"at_s": at_s, "stride_hz": hertz} for at_s, hertz in course.paces],
        "stumble": [{"at_s": at_s} for at_s in course.stumbles],
    }
    return sample(scene, numbers, seed, trial, at_rest=True), course


def walk_scenario(plan: Plan, cell: Cell, number: int) -> Scenario:
    """Sample a module and a walk."""
    (tables, seed), course = sample_walk(cell, plan.numbers, plan.seed, number)
    script = script_of(cell, RUN_S, course.duration_s)
    return scenario_of(plan.name_of(number), tables, cell.firmware, script, seed)


def judge_walk(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge a walk: its hold, and its end or the rest of the walk."""
    (preset, course), scenario = trial.cell.values, trial.scenario
    captured = done.first_in(Mode.RUN)
    ends_s = find_end_s(done.parts.housing)
    if done.first_in(Mode.SOFT_START) is None:
        if Refusal.NO_HARMONIC in done.firmware["outputs.refusal"]:
            outcome.leave_out("refused: no whole number of turns a stride within the region")
        else:
            outcome.why = f"never started: {done.last_word}"
        return
    if captured is None or captured.t_s + SETTLED_S > ends_s:
        outcome.why = f"no hold: {done.last_word}"
        return
    hold_s = (captured.t_s, min(find_left_s(done, captured.t_s), scenario.duration_s, ends_s))
    judge_hold(done, scenario.config.p.gait, hold_s, outcome)
    if hold_s[1] < min(scenario.duration_s, ends_s - EXPECTED_S):
        outcome.why = f"not kept: {done.last_word}"
    elif course in ("stop", "stumble"):
        judge_end(done, ends_s, hold_s, PRESETS[preset].last_pulse_s, outcome)
    else:
        outcome.why = find_missing(done, hold_s)


def find_end_s(walking: object) -> float:
    """Return the time at which the leg first stands after walking or stumbles, s; inf if it does neither."""
    assert isinstance(walking, Walking)
    rows = walking.rows
    walks = np.maximum(rows[:, FROM_SIZE], rows[:, TO_SIZE]) > 0.0
    stands = ~walks & (np.cumsum(walks) > 0)
    found = rows[stands | (rows[:, KNOCK_M_S2] > 0.0), BEGIN_S]
    return float(found[0]) if len(found) else float("inf")


def find_left_s(done: Run, since_s: float) -> float:
    """Return the time of the first change of mode after `since_s`, s; inf if there is none."""
    return next((change.t_s for change in done.modes if change.t_s > since_s), float("inf"))


def find_missing(done: Run, hold_s: tuple[float, float]) -> str:
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
    peaks_n = peaks_by_turn(done.true("crank_rad")[ticks], np.abs(done.true("felt_force_n")[ticks]))
    if len(peaks_n):
        in_force = (peaks_n >= SOFTEST_N) & (peaks_n <= HARDEST_N)
        outcome.shares["in_force"] = int(np.sum(in_force)), len(peaks_n)
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
    inside = PushOff(gait.window_start, gait.window_end).holds(phases)
    if len(strikes_s) > 1:
        hits = np.histogram(pulses_s[inside], strikes_s)[0]
        outcome.shares["in_window"] = int(np.sum(hits > 0)), len(hits)
        outcome.metrics["pulses_per_stride"] = float(np.mean(np.histogram(pulses_s, strikes_s)[0]))


def judge_end(
    done: Run, ends_s: float, hold_s: tuple[float, float], latest_s: float, outcome: Outcome
) -> None:
    """Judge the time from a stop or a stumble to the last pulse, and the largest v⁻ after it."""
    pulses = done.impacts[done.impacts["v_m_s"] >= WEAKEST_V_M_S]
    times, speeds = pulses["t_s"], pulses["v_m_s"]
    follows = is_following(times, ends_s, float("inf"))
    steady = (times >= 0.5 * (sum(hold_s))) & (times <= ends_s)
    last_s = float(np.max(times[follows] - ends_s, initial=0.0))
    hardest = float(np.max(speeds[follows], initial=0.0)) / float(np.max(speeds[steady], initial=1e-9))
    outcome.metrics["last_pulse"] = last_s
    outcome.metrics["undriven"] = float(np.count_nonzero(times > ends_s) - np.count_nonzero(follows))
    outcome.metrics["hardest_after"] = hardest
    outcome.metrics["decision"] = find_left_s(done, hold_s[0]) - ends_s
    if last_s > latest_s:
        outcome.why = f"last pulse {last_s:.2f} s after"
    elif hardest > HARDER:
        outcome.why = f"a pulse {hardest:.2f} times as fast as the last steady ones"


WEAK_TURNS = "a few turns are below 10 N"
STUMBLE = "one stumble in 300 is followed by a harder impact"

WALK = Campaign(
    name="walk",
    title="a walk that the crank follows: pulses in late stance, felt force, end of the walk",
    trials=2100,
    judge=judge_walk,
    sampler=Sampler({"presets": PRESETS, "courses": COURSES}, walk_cell, walk_scenario),
    conditions=((("walking",), COURSES), (("table1",), ("steady", "stop", "stumble"))),
    numbers={"walk_s": 70.0, "variability": 0.02, **MISMATCH},
    units={
        "felt_low": "N",
        "felt_high": "N",
        "phase_rmse": "%",
        "pulses_per_stride": "1",
        "last_pulse": "s",
        "hardest_after": "× steady",
        "undriven": "pulses",
        "decision": "s",
    },
    goals=(
        Goal("eligible", low=2090, full_size=True),
        Goal("success", where="walking steady", low=0.99),
        Goal("success", where="walking change", low=0.99),
        Goal("in_force", where="walking steady", low=0.9999, wanted=1.0, reason=WEAK_TURNS),
        Goal("in_force", where="walking change", low=1.0),
        Goal("in_window", where="walking steady", low=0.99),
        Goal("in_window", where="walking change", low=0.95),
        Goal("phase_rmse", "p95", "walking steady", high=2.0),
        Goal("phase_rmse", "p95", "walking change", high=4.0),
        Goal("last_pulse", "worst", "walking stop", high=0.8),
        Goal("last_pulse", "worst", "walking stumble", high=0.8),
        Goal("hardest_after", "worst", "walking stop", high=1.05),
        Goal("hardest_after", "worst", "walking stumble", high=1.115, wanted=1.05, reason=STUMBLE),
        Goal("success", where="table1 steady", low=0.99),
        Goal("in_force", where="table1 steady", low=0.9998, wanted=1.0, reason=WEAK_TURNS),
        Goal("in_window", where="table1 steady", low=0.99),
        Goal("last_pulse", "worst", "table1 stop", high=2.0),
        Goal("last_pulse", "worst", "table1 stumble", high=2.0),
        Goal("hardest_after", "worst", "table1 stop", high=1.05),
        Goal("hardest_after", "worst", "table1 stumble", high=1.053, wanted=1.05, reason=STUMBLE),
    ),
)
