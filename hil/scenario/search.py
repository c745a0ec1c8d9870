"""What `vibrohil falsify` varies in a scenario: the tables [[search]], one for each key."""

from typing import Any, Self

from pydantic import Field, model_validator

from hil.scenario.settings import split_key
from plant_sim.tables.table import Table

MOST_KEYS = 100
"""Most keys of a search: more need more runs than anybody waits for."""


class SearchTable(Table):
    """One value that a search varies: any number between two bounds, or one of a list."""

    key: str = Field(
        description="the value's dotted key as in --set, such as script.faults.0.at_s, or delay_s, which "
        "delays the first fault (without one the last command) and all that follows"
    )
    low: Any = Field(default=None, description="the lowest value; whole numbers if both bounds are whole")
    high: Any = Field(default=None, description="the highest value")
    choices: list[Any] | None = Field(
        default=None, min_length=2, description="the values to choose from, instead of low and high"
    )

    @model_validator(mode="after")
    def _has_two_bounds_or_choices(self) -> Self:
        split_key(self.key)
        bounds = [one for one in (self.low, self.high) if one is not None]
        if self.choices is not None and not bounds:
            if any(isinstance(one, list | dict) for one in self.choices):
                raise ValueError(f"search {self.key!r}: choices must be numbers, texts, true or false")
            return self
        if self.choices is not None or len(bounds) != 2:
            raise ValueError(f"search {self.key!r}: give low and high, or choices")
        if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in bounds):
            raise ValueError(
                f"search {self.key!r}: low and high must be numbers; give choices of other values"
            )
        if not self.low < self.high:
            raise ValueError(f"search {self.key!r}: low = {self.low} is not below high = {self.high}")
        return self
