"""The space of a scenario: of its tables [[search]], or without one the default space."""

from collections.abc import Sequence
from copy import deepcopy
from typing import Any

from hil.scenario.checks import Check, requirements
from hil.scenario.files import search_tables
from hil.scenario.limits import without_own_limit
from hil.scenario.scenario import Scenario, load_scenario
from hil.scenario.search import SearchTable
from hil.scenario.settings import Settings
from plant_sim.validation_messages import nearest
from tools.falsify.default_space import default_space, since_s, value_at
from tools.falsify.space import DELAY, SEED, Dimension, Space
from tools.output import BadInputError

UNDER_DISTURBANCES = ("S-", "P-07", "P-15")
"""Beginnings of the requirements that hold whatever disturbs the motion; the others hold in steady motion."""
STEADY = ("S-", "P-")
"""Beginnings of those that hold in a run without a fault."""


def space_of(source: str, wanted: Sequence[str], settings: Settings = ()) -> Space:
    """The space of a scenario; `wanted`: ids of requirements, or none for those that have limits.

    Raises BadInputError for what cannot be searched, and the errors of `load_scenario`.
    """
    for one in wanted:
        if one not in requirements():
            raise BadInputError(
                f"--requirement {one}: {nearest(one, list(requirements()), 'see docs/requirements.md')}"
            )
    scenario = load_scenario(source, settings)
    document = deepcopy(dict(scenario.document))
    document.setdefault("seed", scenario.seed)
    tables = search_tables(source)
    if tables:
        chosen = tuple(k for k, one in enumerate(scenario.checks) if not wanted or one.requirement in wanted)
        return own_space(scenario, document, tables, chosen)
    kinds = kinds_of(scenario, wanted)
    chosen = tuple(k for k, one in enumerate(scenario.checks) if is_chosen(one, wanted, kinds))
    document["checks"] = [without_own_limit(one) for one in scenario.checks]
    return default_space(scenario, document, chosen, kinds is UNDER_DISTURBANCES)


def kinds_of(scenario: Scenario, wanted: Sequence[str]) -> tuple[str, ...]:
    """The requirements that count: with a fault, or if there are only those, those that always hold."""
    ids = wanted or [one.requirement or "" for one in scenario.checks if one.required is not None]
    always = [one for one in ids if one.startswith(UNDER_DISTURBANCES)]
    is_disturbed = bool(always) and (len(always) == len(ids) or (bool(scenario.faults) and not wanted))
    return UNDER_DISTURBANCES if is_disturbed else STEADY


def is_chosen(check: Check, wanted: Sequence[str], kinds: tuple[str, ...]) -> bool:
    """Whether a check counts in the default space.

    The limits that only the scenario has suit its own module alone; they count where they are asked for.
    """
    if wanted:
        return check.requirement in wanted
    if check.requirement is None:
        return True
    return check.requirement.startswith(kinds) and check.required is not None


def own_space(
    scenario: Scenario, document: dict[str, Any], tables: Sequence[SearchTable], chosen: tuple[int, ...]
) -> Space:
    """The space of the tables [[search]]."""
    dimensions: list[Dimension] = []
    for one in tables:
        default = 0.0 if one.key == DELAY else value_at(scenario, document, one.key)
        if default is None:
            raise BadInputError(
                f"search {one.key!r}: the scenario has no such value; give it, or check the key"
            )
        if not isinstance(default, int | float | str):
            raise BadInputError(
                f"search {one.key!r}: it is no single value; give the key of one of its values"
            )
        if one.key in (other.key for other in dimensions):
            raise BadInputError(f"search {one.key!r} is there twice; leave one of them out")
        if "." not in one.key and one.key not in (DELAY, SEED):
            raise BadInputError(f"search {one.key!r}: it cannot be searched; give a dotted key as in --set")
        dimensions.append(Dimension(one.key, default, one.low, one.high, tuple(one.choices or ())))
    return Space(scenario.name, document, tuple(dimensions), chosen, since_s(scenario))


def without_direction(space: Space) -> list[str]:
    """Names of the chosen checks that have no margin: of a required value, or with a limit of 0."""
    bounds = {one.name: one.bounds for one in space.checks}
    return [name for name, one in bounds.items() if one.equals is not None or one.high == 0.0]
