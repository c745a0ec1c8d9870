"""The cells of a campaign: the combinations of its axes' values, each with the tables for `--set`."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

from hil.scenario.settings import apply_settings
from tools.output import BadInputError

BASE_SCENE = "table1-motor-soft"

Axes = Mapping[str, Collection[Any] | None]
"""The axes that span the cells, by the key of `--set campaign.KEY`: the known values, or None for numbers."""

Condition = tuple[Sequence[Any], ...]
"""Values of each axis, which are combined."""


@dataclass(frozen=True)
class Cell:
    """A condition: its values of the axes, the mean of the true parameters, the firmware's parameters, and
    the operator's request."""

    name: str
    """Name in tables and goals."""
    values: tuple[Any, ...]
    scene: Mapping[str, Any]
    firmware: Mapping[str, Any]
    ratio: float = 1.1
    impulse_n_s: float = 0.0


def listed(value: Any) -> Sequence[Any]:
    """Return the values of a setting, which may be a list or one value."""
    return value if isinstance(value, list) else [value]


def cells_of(
    axes: Axes,
    cell: Callable[..., Cell],
    conditions: Sequence[Condition],
    numbers: Mapping[str, Any],
    settings: Sequence[str],
) -> tuple[list[Cell], dict[str, Any]]:
    """Return the cells of a campaign and its numbers, both after the `--set` changes.

    `cell` makes a cell from a value of each axis. If a setting names an axis, one condition replaces all: the
    first with the values of the settings. Raises BadInputError for an unknown key or value.
    """
    table = {**dict.fromkeys(axes), **numbers}
    own = [setting for setting in settings if setting.startswith("campaign.")]
    changed = apply_settings({"campaign": table}, own)["campaign"]
    for name in sorted(set(changed) - set(table)):
        raise BadInputError(
            f"--set campaign.{name} is no number of this campaign; wanted one of "
            f"{', '.join(f'campaign.{one}' for one in table)}"
        )
    chosen = [changed.pop(axis) for axis in axes]
    if chosen != [None] * len(axes):
        pairs = zip(chosen, conditions[0], strict=True)
        conditions = [tuple(otherwise if one is None else listed(one) for one, otherwise in pairs)]
    cells = []
    for values in (values for condition in conditions for values in product(*condition)):
        for (axis, known), value in zip(axes.items(), values, strict=True):
            if known is not None and value not in known:
                raise BadInputError(f"campaign.{axis}: {value!r} is none of {', '.join(known)}")
        nominal = cell(*values)
        document = {"campaign": {}, "scene": nominal.scene, "firmware": nominal.firmware}
        after = apply_settings(document, settings)
        cells.append(replace(nominal, scene=after["scene"], firmware=after["firmware"]))
    return cells, changed
