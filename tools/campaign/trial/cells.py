"""The cells of a campaign: a friction law, a speed ratio and an impulse each, and the tables for `--set`."""

from collections.abc import Collection, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any, NamedTuple

from hil.scenario.settings import apply_settings
from plant_sim.scene import read_scene
from tools.output import BadInputError

BASE_SCENE = "table1-motor-soft"

Condition = tuple[Sequence[str], Sequence[float], Sequence[float]]
"""Friction laws, speed ratios and impulses, which are combined."""

DRY_AMPLITUDE_M = 0.03
"""Amplitude of the drive with dry friction, m; at 20 mm dry friction holds the striker."""


class Law(NamedTuple):
    """Friction of the true module, and the amplitude of the drive that moves the striker against it."""

    friction: Mapping[str, Any]
    amplitude_m: float = DRY_AMPLITUDE_M

    @property
    def scene(self) -> dict[str, Any]:
        """Base scene with this friction and amplitude."""
        scene = deepcopy(read_scene(BASE_SCENE))
        scene["friction"] = dict(self.friction)
        scene["drive"]["amplitude_m"] = self.amplitude_m
        return scene

    @property
    def nominal(self) -> dict[str, Any]:
        """Nominal parameters of the firmware; of a dry friction law they contain μ only."""
        friction = {name: self.friction.get(name, 0.0) for name in ("b_n_s_m", "mu")}
        return {"friction": friction, "drive": {"amplitude_m": self.amplitude_m}}


LAWS = {
    "viscous": Law({"law": "viscous", "b_n_s_m": 0.2}, 0.02),
    "coulomb": Law({"law": "coulomb", "mu": 0.15}),
    "coulomb-0.2": Law({"law": "coulomb", "mu": 0.2}),
    "coulomb-0.3": Law({"law": "coulomb", "mu": 0.3}),
    "stribeck": Law({"law": "stribeck", "mu": 0.15, "mu_s": 0.2, "v_s_m_s": 0.05, "delta": 1.0}),
}


@dataclass(frozen=True)
class Cell:
    """A condition: the mean of the true parameters, the firmware's parameters, and the operator's request."""

    law: str
    ratio: float
    impulse_n_s: float
    scene: Mapping[str, Any]
    firmware: Mapping[str, Any]

    @property
    def name(self) -> str:
        """Name of the cell in tables and goals."""
        asked = f" {self.impulse_n_s:g} N s" if self.impulse_n_s > 0.0 else ""
        return f"{self.law} r={self.ratio:g}{asked}"


def listed(value: Any, otherwise: Sequence[Any]) -> Sequence[Any]:
    """Return the values of a setting, which may be a list or one value; `otherwise` if it is not set."""
    if value is None:
        return otherwise
    return value if isinstance(value, list) else [value]


def numbers_after(document: dict[str, Any], settings: Sequence[str]) -> dict[str, Any]:
    """Return the table `campaign` of the document after the `--set` changes.

    Raises BadInputError for a key that the table does not have.
    """
    known = list(document["campaign"])
    changed: dict[str, Any] = apply_settings(document, settings)["campaign"]
    for name in sorted(set(changed) - set(known)):
        raise BadInputError(
            f"--set campaign.{name} is no number of this campaign; wanted one of "
            f"{', '.join(f'campaign.{one}' for one in known)}"
        )
    return changed


def refuse_unlisted(key: str, value: str, known: Collection[str]) -> None:
    """Raise BadInputError unless the value of a campaign's key is one of the known ones."""
    if value not in known:
        raise BadInputError(f"campaign.{key}: {value!r} is none of {', '.join(known)}")


def cells_of(
    conditions: Sequence[Condition], numbers: Mapping[str, Any], settings: Sequence[str]
) -> tuple[list[Cell], dict[str, Any]]:
    """Return the cells of a campaign and its numbers, both after the `--set` changes.

    The settings `campaign.laws`, `campaign.ratios` and `campaign.impulses` replace the conditions. Raises
    BadInputError for an unknown key or friction law.
    """
    axes = ("laws", "ratios", "impulses")
    table = {**dict.fromkeys(axes), **numbers}
    changed = numbers_after({"campaign": table, "firmware": {}, "scene": read_scene(BASE_SCENE)}, settings)
    chosen = [changed.pop(axis) for axis in axes]
    if chosen != [None] * len(axes):
        laws, ratios, impulses = map(listed, chosen, conditions[0])
        conditions = [(laws, ratios, impulses)]
    cells = []
    for laws, ratios, impulses in conditions:
        for law in laws:
            refuse_unlisted("laws", law, LAWS)
            own = {"campaign": {}, "scene": LAWS[law].scene, "firmware": LAWS[law].nominal}
            own = apply_settings(own, settings)
            cells += [
                Cell(law, float(ratio), float(impulse), own["scene"], own["firmware"])
                for ratio in ratios
                for impulse in impulses
            ]
    return cells, changed
