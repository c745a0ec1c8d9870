"""The parameters by name: overrides of scenarios and tools, the parameter file, and errors in either.

`interface/sources/parameters.toml` lists the parameters; the core's `parameters` reads and writes them by
index.
"""

import difflib
import tomllib
import zlib
from collections.abc import Mapping
from typing import Any

import tomli_w

from firmware_py.core.configure import config_of
from firmware_py.core.parameter_values import ORDERED, Parameters
from firmware_py.core.parameters import conflict, within_bounds
from firmware_py.core.state import Config
from firmware_py.interface.addresses import Addresses, addresses
from firmware_py.interface.enums import ParameterTier
from firmware_py.interface.sources.parameter_table import INDEX, TABLE, Parameter

BY_NAME: dict[str, Parameter] = {parameter.name: parameter for parameter in TABLE}
DEFAULTS: dict[str, float] = {parameter.name: parameter.default for parameter in TABLE}
OF_THE_BUILD = [parameter.name for parameter in TABLE if parameter.tier is ParameterTier.BUILD]

DIMENSIONLESS = "1"
"""The unit of a number without one."""


class ParameterError(ValueError):
    """A parameter that does not exist, is not a number or is out of bounds; or an invalid file."""


def flattened(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted names: `{"stop": {"restitution": 0.4}}` gives `{"stop.restitution": 0.4}`."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flattened(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def checked(name: str, value: Any) -> float:
    """`value` as a float within the bounds of parameter `name`; raise ParameterError otherwise."""
    parameter = BY_NAME.get(name)
    if parameter is None:
        near = difflib.get_close_matches(name, BY_NAME, n=3, cutoff=0.5)
        hint = f"did you mean {' or '.join(near)}?" if near else "docs/reference/parameters.md lists them all"
        raise ParameterError(f"there is no firmware parameter {name!r}; {hint}")
    unit = "" if parameter.unit == DIMENSIONLESS else f" {parameter.unit}"
    bounds = f"from {parameter.low:g} to {parameter.high:g}{unit}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(f"{name} = {value!r} is no number; give one {bounds}")
    if not within_bounds(INDEX[name], float(value)):
        count = "; a count is a whole number" if parameter.whole else ""
        raise ParameterError(f"{name} = {value!r}{unit} is out of bounds; give a value {bounds}{count}")
    return float(value)


def checked_in_file(name: str, value: Any) -> float:
    """`checked` for a value of a parameter file; parameters of the build are refused."""
    if name in OF_THE_BUILD:
        raise ParameterError(
            f"{name} is settled by the build ({value!r} is in a parameter file); remove it from the file"
        )
    return checked(name, value)


def with_overrides(overrides: Mapping[str, Any]) -> dict[str, float]:
    """All parameters: the defaults, replaced by `overrides` (dotted names or nested tables).

    The caller configures the build, so parameters of the tier BUILD are accepted too.
    """
    values = DEFAULTS | {name: checked(name, value) for name, value in flattened(overrides).items()}
    place = conflict(parameters_of(values))
    if place >= 0:
        lower, upper = (TABLE[index].name for index in ORDERED[place])
        raise ParameterError(
            f"{lower} = {values[lower]:g} exceeds {upper} = {values[upper]:g}; change one of them"
        )
    return values


def parameters_of(values: Mapping[str, float]) -> Parameters:
    """The firmware's `Parameters` from a complete set of values, such as that of `with_overrides`."""
    return Parameters(*(values[name] for name in INDEX))


def config_from(overrides: Mapping[str, Any]) -> Config:
    """The core's configuration from the defaults with `overrides`."""
    return config_of(parameters_of(with_overrides(overrides)), False)


def _checksum(values: Mapping[str, float]) -> str:
    text = "".join(f"{name}={values[name]!r}\n" for name in sorted(values))
    return f"{zlib.crc32(text.encode()):08x}"


def written(values: Mapping[str, float]) -> str:
    """A complete set of values as TOML with its checksum, without the parameters of the build."""
    filed = {name: value for name, value in values.items() if name not in OF_THE_BUILD}
    document: dict[str, Any] = {"checksum": _checksum(filed)}
    for full_name, value in filed.items():
        block, _, name = full_name.partition(".")
        document.setdefault(block, {})[name] = value
    return tomli_w.dumps(document)


def read_back(
    text: str, build: Mapping[str, float] | None = None, source: str = "the parameter file"
) -> dict[str, float]:
    """The values of a file that `written` made, with the `build`'s parameters, or defaults without them.

    Raises ParameterError if the file is damaged or incomplete, or contains parameters of the build.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"{source} is no TOML ({error}); write it again with written()") from error
    checksum = document.pop("checksum", None)
    values = {name: checked_in_file(name, value) for name, value in flattened(document).items()}
    missing = sorted(set(BY_NAME) - set(OF_THE_BUILD) - set(values))
    if missing:
        raise ParameterError(f"{source} lacks {', '.join(missing)}; write it again with written()")
    if checksum != _checksum(values):
        raise ParameterError(
            f"{source} has checksum {checksum!r}, its values give {_checksum(values)!r}: it is damaged or "
            "was edited by hand; write it again with written()"
        )
    return with_overrides(values | of_the_build(build or {}))


def addresses_from(values: Mapping[str, Any]) -> Addresses:
    """The module's node numbers, from values or overrides; raises `AddressError` if they are impossible."""
    complete = with_overrides(values)
    return addresses(int(complete["bus.drive_node"]), int(complete["bus.own_node"]))


def of_the_build(values: Mapping[str, Any]) -> dict[str, float]:
    """The parameters of the build among `values`."""
    return {name: value for name, value in flattened(values).items() if name in OF_THE_BUILD}
