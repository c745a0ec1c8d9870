"""Base class of the tables of a scene file, with the checks of keys and the search for nested tables."""

from collections.abc import Iterator, Mapping
from typing import Any, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator, model_validator
from pydantic_core import PydanticCustomError

from plant_sim.tables.quantities import is_undeclared, quantity_of

STANDARD_GRAVITY_M_S2 = 9.80665
SMALLEST_BESIDE_0 = 1e-15
"""Smallest magnitude of a value other than 0: smaller ones are lost in rounding, and solvers would not
end."""


class Table(BaseModel):
    """A table refuses unknown keys, wrong types, NaN, infinity and unphysical magnitudes; it is immutable."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @classmethod
    def __pydantic_init_subclass__(cls, **keywords: Any) -> None:
        """Raise TypeError for a float that declares no quantity."""
        for name, field in cls.model_fields.items():
            if is_undeclared(field):
                raise TypeError(
                    f"{cls.__name__}.{name} is a float without a quantity; declare it with one of "
                    "plant_sim.tables.quantities, such as Length, or Number"
                )

    @model_validator(mode="before")
    @classmethod
    def _plain_numbers(cls, data: object) -> object:
        if not isinstance(data, Mapping):
            return data
        return {key: value.item() if isinstance(value, np.generic) else value for key, value in data.items()}

    @field_validator("*", mode="after")
    @classmethod
    def _has_a_physical_size(cls, value: Any, info: ValidationInfo) -> Any:
        if isinstance(value, bool) or not isinstance(value, int | float) or info.field_name is None:
            return value
        field = cls.model_fields[info.field_name]
        quantity, bounds = quantity_of(field), field.metadata
        smallest = 0.0
        if any(getattr(bound, "gt", None) == 0.0 for bound in bounds):
            smallest = quantity.smallest
        elif value != 0.0 and any(getattr(bound, "ge", None) == 0.0 for bound in bounds):
            smallest = SMALLEST_BESIDE_0
        if not smallest <= abs(value) <= quantity.largest:
            raise PydanticCustomError(
                "physical_size",
                "not a size from {smallest} to {largest}",
                {"smallest": f"{smallest:g}", "largest": f"{quantity.largest:g}", "reason": quantity.reason},
            )
        return value


def tables_in(kind: Any) -> Iterator[type[Table]]:
    """A table and all tables nested in it, each once, in the order of their keys; for a union, its
    members."""
    found: dict[type[Table], None] = {}

    def look(one: Any) -> None:
        if not (isinstance(one, type) and issubclass(one, Table)):
            for inner in get_args(one):
                look(inner)
        elif one not in found:
            found[one] = None
            for field in one.model_fields.values():
                look(field.annotation)

    look(kind)
    return iter(found)
