"""`parameters.toml`, the only source of the firmware's parameters; `generate.py` makes their record of it."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from firmware_py.interface.enums import ParameterTier

SOURCE = Path(__file__).with_name("parameters.toml")


PROTECTED = ("ceiling", "limit", "watchdog")
"""Tables of the parameters on which safety rests: they are only read over the bus."""


class Parameter(NamedTuple):
    """One parameter of `parameters.toml`: `table` and `key` are the two parts of its name."""

    table: str
    key: str
    tier: ParameterTier
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    whole: bool = False
    at_most: str | None = None
    while_running: bool = False

    @property
    def name(self) -> str:
        """The dotted name, `stop.position_m`: the same in files, in messages and in the firmware's code."""
        return f"{self.table}.{self.key}"

    @property
    def is_calibrated(self) -> bool:
        """Whether it may be written over the bus: a tuning parameter on which no safety rests."""
        return self.tier is ParameterTier.TUNING and self.table not in PROTECTED


def read_parameter(table: str, key: str, entry: dict[str, Any]) -> Parameter:
    """One entry of the file. Raises TypeError and KeyError for fields that it lacks or must not have."""
    numbers = {name: float(entry[name]) for name in ("low", "high", "default")}
    return Parameter(table, key, **entry | numbers | {"tier": ParameterTier[entry["tier"].upper()]})


TABLE: tuple[Parameter, ...] = tuple(
    read_parameter(table, key, entry)
    for table, entries in tomllib.loads(SOURCE.read_text(encoding="utf-8")).items()
    for key, entry in entries.items()
)
"""All parameters, in the order of their indices."""

INDEX: dict[str, int] = {parameter.name: index for index, parameter in enumerate(TABLE)}


def record_name(table: str) -> str:
    """`SpinDown` for the table `spin_down`."""
    return table.title().replace("_", "")
