"""The cells of the campaign `walk`: suitable modules of the feasibility table, and courses of walking."""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hil.scenario.files import read_scenario
from hil.scenario.operator import Command, Request
from plant_sim.scene import read_scene
from tools.campaign.trial.cells import Axes, Cell
from tools.campaign.trial.sampling import Sampled, mismatch_of, sample
from tools.campaign.trial.scenarios import Plan, Trial, scenario_of

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


WALK_AXES: Axes = {"presets": PRESETS, "courses": COURSES}


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


def sampled_walk(cell: Cell, numbers: Mapping[str, Any], seed: int, trial: int) -> tuple[Sampled, Course]:
    """Sample the truth of a trial and the wearer's walk."""
    course = course_of(cell, numbers, np.random.default_rng([seed, trial, 3]))
    scene = deepcopy(dict(cell.scene))
    scene["gait"] = {
        **scene["gait"],
        "variability": float(numbers["variability"]),
        "pace": [{"at_s": at_s, "stride_hz": hertz} for at_s, hertz in course.paces],
        "stumble": [{"at_s": at_s} for at_s in course.stumbles],
    }
    return sample(scene, mismatch_of(numbers), seed, trial, at_rest=True), course


def walk_trial(plan: Plan, cell: Cell, number: int) -> Trial:
    """Sample a module and a walk."""
    sampled, course = sampled_walk(cell, plan.numbers, plan.seed, number)
    commands = [Command(0.0, Request.IDLE, 0.0), Command(RUN_S, Request.RUN, cell.ratio)]
    name, tables, seed = plan.name_of(number), sampled.tables, sampled.run_seed
    scenario = scenario_of(name, tables, cell.firmware, commands, course.duration_s, seed)
    return Trial(cell, sampled, scenario)
