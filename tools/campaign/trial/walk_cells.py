"""The cells of the campaign `walk`: suitable modules of the feasibility table, and courses of walking."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from hil.scenario.files import read_scenario
from hil.scenario.settings import apply_settings
from plant_sim.scene import read_scene
from tools.campaign.trial.cells import Cell, listed, numbers_after, refuse_unlisted
from tools.campaign.trial.sampling import Sampled, mismatch_of, sample

WalkCondition = tuple[str, Sequence[str]]
"""A preset and its courses."""

COURSES = ("steady", "change", "stop", "stumble")

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


@dataclass(frozen=True)
class WalkCell(Cell):
    """A condition of the campaign `walk`: a preset and a course."""

    preset: str
    course: str

    @property
    def name(self) -> str:
        """Name of the cell in tables and goals."""
        return f"{self.preset} {self.course}"


def walk_cells(
    conditions: Sequence[WalkCondition], numbers: Mapping[str, Any], settings: Sequence[str]
) -> tuple[list[Cell], dict[str, Any]]:
    """Return the cells of the campaign and its numbers, both after the `--set` changes.

    The settings `campaign.presets` and `campaign.courses` replace the conditions. Raises BadInputError for an
    unknown key, preset or course.
    """
    table = {"presets": None, "courses": None, **numbers}
    changed = numbers_after({"campaign": table, "firmware": {}, "scene": {}}, settings)
    presets, courses = changed.pop("presets"), changed.pop("courses")
    if presets is not None or courses is not None:
        chosen = listed(presets, [preset for preset, _ in conditions])
        conditions = [(preset, listed(courses, COURSES)) for preset in chosen]
    return [_cell(preset, course, settings) for preset, some in conditions for course in some], changed


def _cell(preset: str, course: str, settings: Sequence[str]) -> WalkCell:
    refuse_unlisted("presets", preset, PRESETS)
    refuse_unlisted("courses", course, COURSES)
    own = {
        "campaign": {},
        "scene": deepcopy(read_scene(PRESETS[preset].scene)),
        "firmware": read_scenario(PRESETS[preset].nominal_of)["firmware"],
    }
    own = apply_settings(own, settings)
    return WalkCell("viscous", 1.1, 0.0, own["scene"], own["firmware"], preset, course)


class Course(NamedTuple):
    """Paces (at_s, stride_hz), times of stumbles, and the trial's duration, s."""

    paces: list[tuple[float, float]]
    stumbles: list[float]
    duration_s: float


def course_of(cell: WalkCell, numbers: Mapping[str, Any], dice: np.random.Generator) -> Course:
    """Sample the walk of a trial: its cadence, and the times of its events."""
    preset, at_s = PRESETS[cell.preset], STEADY_S + float(dice.uniform(*LATER_S))
    lowest_hz, highest_hz = preset.lowest_hz, preset.highest_hz
    if cell.course == "change":
        highest_hz = max(highest_hz / (1.0 + CHANGE_SHARE), lowest_hz)
    first_hz = float(dice.uniform(lowest_hz, highest_hz))
    whole_s = float(numbers["walk_s"])
    if cell.course == "stop":
        return Course([(0.0, first_hz), (at_s, 0.0)], [], at_s + AFTER_S)
    if cell.course == "stumble":
        return Course([(0.0, first_hz)], [at_s], at_s + AFTER_S)
    if cell.course == "steady":
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


def sampled_walk(cell: WalkCell, numbers: Mapping[str, Any], seed: int, trial: int) -> tuple[Sampled, Course]:
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
