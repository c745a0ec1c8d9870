"""What a campaign is: its conditions, the plan of its trials, a trial as a scenario, its outcome, its goals.

A cell is a combination of values on the campaign's axes, with the tables for `--set`. A trial is a sampled
module with the operator's commands and the disturbances; `vibrohil run` repeats it bit for bit and records
all signals.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, Literal, NamedTuple

from firmware_py.shell.builds import Build
from hil.scenario.scenario import Scenario, check_scenario
from hil.scenario.settings import apply_settings
from hil.timing.clock import TICK_S
from plant_sim.tables.quantities import NUMBER
from plant_sim.validation_messages import real
from tools.campaign.run import Run
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


def list_values(value: Any) -> Sequence[Any]:
    """Return the values of a setting, which may be a list or one value."""
    return value if isinstance(value, list) else [value]


def refuse_swapped_bounds(numbers: Mapping[str, Any]) -> None:
    """Raise BadInputError if a lower bound, a number with `_low_` in its name, exceeds its upper bound."""
    for low in (name for name in numbers if "_low_" in name):
        high = low.replace("_low_", "_high_")
        if numbers[low] > numbers[high]:
            raise BadInputError(
                f"campaign.{low} = {numbers[low]} is above campaign.{high} = {numbers[high]}; wanted a lower "
                "bound of at most the upper one"
            )


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
    for name, value in changed.items():
        if not 0.0 <= real(value) < math.inf:
            raise BadInputError(f"campaign.{name} = {value}: wanted a number of at least 0")
        if value > NUMBER.largest:
            raise BadInputError(f"campaign.{name} = {value}: wanted at most {NUMBER.largest:g}")
        if name.startswith("mismatch_") and not name.endswith(("_m", "_g")) and value > 1.0:
            raise BadInputError(f"campaign.{name} = {value}: wanted at most 1")
    refuse_swapped_bounds(changed)
    for axis, value in zip(axes, chosen, strict=True):
        if value == []:
            raise BadInputError(f"campaign.{axis} has no value; wanted one or more")
    if chosen != [None] * len(axes):
        pairs = zip(chosen, conditions[0], strict=True)
        conditions = [tuple(otherwise if one is None else list_values(one) for one, otherwise in pairs)]
    cells = []
    for values in (values for condition in conditions for values in product(*condition)):
        for (axis, known), value in zip(axes.items(), values, strict=True):
            if known is not None and value not in known:
                raise BadInputError(f"campaign.{axis}: {value!r} is none of {', '.join(known)}")
            if known is None and not 0.0 <= real(value) < math.inf:
                raise BadInputError(f"campaign.{axis}: {value!r} is no number of at least 0")
        nominal = cell(*values)
        document = {"campaign": {}, "scene": nominal.scene, "firmware": nominal.firmware}
        after = apply_settings(document, settings)
        cells.append(replace(nominal, scene=after["scene"], firmware=after["firmware"]))
    return cells, changed


class Plan(NamedTuple):
    """What the trials of a campaign have in common."""

    campaign: str
    cells: Sequence[Cell]
    numbers: Mapping[str, Any]
    seed: int
    firmware: Build = "compiled"

    def name_of(self, trial: int) -> str:
        """Return the name of a trial's scenario."""
        return f"{self.campaign}-{self.seed}-{trial}"


class Trial(NamedTuple):
    """A sampled module as a scenario; `seed` generates what a judge samples."""

    cell: Cell
    scenario: Scenario
    seed: tuple[int, ...]

    @property
    def omega_rad_s(self) -> float:
        """Crank speed that the operator requests."""
        return self.scenario.commands[-1].target_ratio * self.scenario.config.nominal.natural_rad_s


def script_of(
    cell: Cell, run_s: float, duration_s: float, faults: Sequence[Mapping[str, Any]] = ()
) -> dict[str, Any]:
    """Return a script: the operator is idle, and from `run_s` on makes the cell's request."""
    run = {"at_s": run_s, "request": "run", "target_ratio": cell.ratio}
    if cell.impulse_n_s > 0.0:
        run["target_impulse_n_s"] = cell.impulse_n_s
    commands = [{"at_s": 0.0, "request": "idle"}, run]
    return {"duration_s": duration_s, "commands": commands, "faults": list(faults)}


def scenario_of(
    name: str, scene: Mapping[str, Any], firmware: Mapping[str, Any], script: Mapping[str, Any], seed: int
) -> Scenario:
    """Return the checked scenario with these tables."""
    document = {"title": name, "scene": scene, "firmware": firmware, "script": script, "seed": seed}
    return check_scenario(document, name)


def first_tick_s(t_s: float) -> float:
    """The first tick that is not before a time, s. The compiled loop's faults begin and end with a tick."""
    return math.ceil(t_s / TICK_S) * TICK_S


@dataclass
class Outcome:
    """Outcome of one trial.

    `why` is empty for a success. An ineligible trial is not counted; its `why` gives the reason. `metrics`
    are one value per trial by name, `shares` (hits among touch-downs, …) are each a part and its whole,
    summed over trials, `samples` are pooled.
    """

    trial: int
    cell: int
    eligible: bool = True
    why: str = ""
    simulated_s: float = 0.0
    compute_s: float = 0.0
    metrics: dict[str, float] = field(default_factory=dict)
    shares: dict[str, tuple[int, int]] = field(default_factory=dict)
    samples: dict[str, list[float]] = field(default_factory=dict)

    def leave_out(self, why: str) -> None:
        """Mark the trial as ineligible."""
        self.eligible, self.why = False, why

    def count(self, share: str, *, is_part: bool) -> None:
        """Count one more of a whole, and if it is, of its part."""
        part, whole = self.shares.get(share, (0, 0))
        self.shares[share] = part + int(is_part), whole + 1


Quantile = Literal["lowest", "p50", "p95", "worst"]


@dataclass(frozen=True)
class Goal:
    """A limit on a figure: a metric's quantile, a share, or the share of successes.

    The goal applies to the cells whose names begin with `where`, taken together; an empty `where` means all
    cells. The figure must be at least `low` or at most `high`, in the unit in which the figure is printed.
    These limits decide the status. If the figure is known to miss the goal, `wanted` is the goal, `low` or
    `high` is a regression bound at the measured value, and `reason` says why the goal is missed.
    """

    figure: str
    quantile: Quantile | None = None
    where: str = ""
    low: float | None = None
    high: float | None = None
    wanted: float | None = None
    reason: str = ""
    full_size: bool = False
    """Whether the goal applies only to a campaign with all of its trials."""


class Sampler(NamedTuple):
    """What a campaign samples: the axes of its conditions, a cell of values on them, a scenario of a cell."""

    axes: Axes
    cell: Callable[..., Cell]
    scenario: Callable[[Plan, Cell, int], Scenario]


@dataclass(frozen=True)
class Campaign:
    """A Monte Carlo campaign: what it samples, how it judges, and its goals.

    `conditions` span the cells over the sampler's axes. `numbers` may be changed by `--set
    campaign.KEY=VALUE`. `units` are the units in which the metrics are printed. `trials` is the number of
    trials that the goals need; with fewer trials a goal of full size does not apply.
    """

    name: str
    title: str
    trials: int
    sampler: Sampler
    judge: Callable[[Trial, Run, Outcome], None]
    conditions: tuple[Condition, ...]
    numbers: Mapping[str, Any]
    units: Mapping[str, str]
    goals: tuple[Goal, ...]

    def plan(self, settings: Sequence[str], seed: int, firmware: Build = "compiled") -> Plan:
        """Return the plan of the trials after the `--set` changes; BadInputError for an unknown one."""
        sampler = self.sampler
        cells, numbers = cells_of(sampler.axes, sampler.cell, self.conditions, self.numbers, settings)
        return Plan(self.name, cells, numbers, seed, firmware)
