"""What the campaign `walk` runs: modules that the feasibility table lets serve, and courses of walking."""

from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

from hil.scenario import read_scenario
from hil.settings import apply_settings
from plant_sim.scene import read_scene
from tools.campaign.cells import Cell
from tools.output import BadInputError

COURSES = ("steady", "change", "stop", "stumble")


@dataclass(frozen=True)
class Preset:
    """A scene, a scenario whose parameters fit it, and the cadences that it serves, strides a second.

    `last_pulse_s`: how long after a stop or a stumble pulses may come.
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
"""Of docs/feasibility.md: `walking` serves all cadences, Table 1's module a narrow band about 0.8."""


@dataclass(frozen=True)
class WalkCell(Cell):
    """One condition of a walk."""

    preset: str
    course: str

    @property
    def name(self) -> str:
        """As tables and goals call it."""
        return f"{self.preset} {self.course}"


def walk_cells(table: Mapping[str, Any], settings: Sequence[str]) -> tuple[list[Cell], dict[str, Any]]:
    """The cells of `table` (conditions, each a preset and its courses) with `--set` changes, and its numbers.

    `campaign.presets` and `campaign.courses` replace the conditions.
    """
    numbers = {key: value for key, value in table.items() if key != "conditions"}
    known = {"presets": None, "courses": None, **numbers}
    changed = apply_settings({"campaign": dict(known), "firmware": {}, "scene": {}}, settings)["campaign"]
    unknown = sorted(set(changed) - set(known))
    if unknown:
        raise BadInputError(
            f"--set campaign.{unknown[0]} is no number of this campaign; wanted one of "
            f"{', '.join(f'campaign.{name}' for name in known)}"
        )
    presets, courses = changed.pop("presets"), changed.pop("courses")
    pairs = [(preset, course) for preset, some in table["conditions"] for course in some]
    if presets is not None or courses is not None:
        chosen = _listed(presets, [preset for preset, _ in table["conditions"]])
        pairs = [(preset, course) for preset in chosen for course in _listed(courses, list(COURSES))]
    return [_cell(preset, course, settings) for preset, course in pairs], changed


def _listed(value: Any, otherwise: list[str]) -> list[str]:
    if value is None:
        return otherwise
    return list(value) if isinstance(value, list) else [value]


def _cell(preset: str, course: str, settings: Sequence[str]) -> WalkCell:
    if preset not in PRESETS:
        raise BadInputError(f"campaign.presets: {preset!r} is none of {', '.join(PRESETS)}")
    if course not in COURSES:
        raise BadInputError(f"campaign.courses: {course!r} is none of {', '.join(COURSES)}")
    own = {
        "campaign": {},
        "scene": deepcopy(read_scene(PRESETS[preset].scene)),
        "firmware": read_scenario(PRESETS[preset].nominal_of)["firmware"],
    }
    own = apply_settings(own, settings)
    return WalkCell("viscous", 1.1, 0.0, own["scene"], own["firmware"], preset, course)
