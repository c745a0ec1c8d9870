"""`parameters.toml`, the only source of the firmware's parameters, and the module generated from it.

    python -m firmware_py.interface.sources.parameter_table

writes `core/parameter_values.py`, the parameters in the firmware's subset, because a microcontroller reads no
TOML and has no names. A test compares the checked-in file with the output of this module.
"""

import textwrap
import tomllib
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from firmware_py.interface.enums import ParameterTier
from firmware_py.interface.sources.write import write

SOURCE = Path(__file__).with_name("parameters.toml")
TARGET = Path(__file__).parents[2] / "core" / "parameter_values.py"


class Parameter(NamedTuple):
    """One parameter of `parameters.toml`."""

    name: str
    tier: ParameterTier
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    whole: bool = False
    at_most: str | None = None

    @property
    def field(self) -> str:
        """The parameter's name in `Parameters`: `stop_position_m` for `stop.position_m`."""
        return self.name.replace(".", "_")


def _parameter(
    name: str,
    *,
    tier: str,
    unit: str,
    low: float,
    high: float,
    default: float,
    meaning: str,
    whole: bool = False,
    at_most: str | None = None,
) -> Parameter:
    bounds = (float(low), float(high), float(default))
    return Parameter(name, ParameterTier[tier.upper()], unit, *bounds, meaning, whole, at_most)


TABLE: tuple[Parameter, ...] = tuple(
    _parameter(f"{block}.{key}", **entry)
    for block, entries in tomllib.loads(SOURCE.read_text(encoding="utf-8")).items()
    for key, entry in entries.items()
)
"""All parameters, in the order of their indices."""

INDEX: dict[str, int] = {parameter.name: index for index, parameter in enumerate(TABLE)}

HEADER = '''"""The parameters in the firmware's subset: written by `parameter_table.py`; do not edit.

Their source is `parameters.toml` of interface/sources, which gives the meaning of each. All are
floats, including counts and switches.
"""

from typing import NamedTuple


'''


def _column(head: str, values: Iterable[object]) -> str:
    """The text of `head(…)` with all values, in as few lines as possible."""
    lines = textwrap.wrap(", ".join(map(str, values)), width=104)
    return "\n".join(("# fmt: off", f"{head}(", *(f"    {line}" for line in lines), ")", "# fmt: on\n"))


def source() -> str:
    """The text of `core/parameter_values.py`, before formatting."""
    pairs = [(index, INDEX[one.at_most]) for index, one in enumerate(TABLE) if one.at_most]
    return "\n".join(
        (
            HEADER,
            "class Parameters(NamedTuple):",
            '    """One value of each parameter, in the order of their indices."""\n',
            *(f"    {one.field}: float" for one in TABLE),
            "\n",
            f"COUNT = {len(TABLE)}\n",
            _column("DEFAULTS = Parameters", (one.default for one in TABLE)),
            _column("LOW = ", (one.low for one in TABLE)),
            _column("HIGH = ", (one.high for one in TABLE)),
            _column("TIERS = ", (one.tier.value for one in TABLE))
            + '"""`ParameterTier` of each parameter."""\n',
            _column("WHOLE = ", (int(one.whole) for one in TABLE))
            + '"""1 for a parameter that is a count, else 0."""\n',
            _column("ORDERED = ", pairs)
            + '"""Pairs of indices: the first parameter may not exceed the second."""\n',
        )
    )


if __name__ == "__main__":
    write(TARGET, source())
