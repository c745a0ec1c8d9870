"""The result of a tuning command: parameters, figures of merit and warnings."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from firmware_py.shell.parameters import BY_NAME


class Value(NamedTuple):
    """A tuned parameter and its range from `low` to `high`, which `Tuning.range_is` defines."""

    value: float
    unit: str
    low: float
    high: float


class Merit(NamedTuple):
    """A figure of merit; `meaning` explains a name that is no common term of the field."""

    value: float
    unit: str
    meaning: str = ""

    def as_json(self) -> dict[str, Any]:
        """The figure's table, without a meaning if it has none."""
        return {key: value for key, value in self._asdict().items() if value != ""}


@dataclass(frozen=True)
class Tuning:
    """The result of a tuning command.

    `source`: the data, or the specification of a design; `range_is`: the definition of the values' ranges.
    `default_as_good`: whether the defaults together perform as well on fresh trials; None for a tuning whose
    values are compared one by one.
    """

    command: str
    source: str
    seed: int | None
    range_is: str
    parameters: dict[str, Value]
    figures_of_merit: dict[str, Merit]
    warnings: tuple[str, ...] = ()
    default_as_good: bool | None = None

    @property
    def values(self) -> dict[str, float]:
        """The values of the parameters by name."""
        return {name: value.value for name, value in self.parameters.items()}

    def as_json(self) -> dict[str, Any]:
        """The command's JSON object."""
        return {
            "command": self.command,
            "source": self.source,
            "seed": self.seed,
            "range_is": self.range_is,
            "parameters": {name: value._asdict() for name, value in self.parameters.items()},
            "figures_of_merit": {name: merit.as_json() for name, merit in self.figures_of_merit.items()},
            "warnings": list(self.warnings),
            "default_as_good": self.default_as_good,
        }


def make_value(name: str, value: float, low: float | None = None, high: float | None = None) -> Value:
    """A value with its parameter's unit; without bounds it is known exactly."""
    return Value(value, BY_NAME[name].unit, value if low is None else low, value if high is None else high)
