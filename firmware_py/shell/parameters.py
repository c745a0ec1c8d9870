"""The parameters by name: overrides of scenarios and tools, the parameter file, requests over the bus.

`interface/parameters.toml` lists the parameters. A set of values is a dictionary with the dotted name
of every parameter; `parameters_of` makes the firmware's record of it. Values and bounds are compared as
float32, the precision of the bus, so that a bound itself can be written.
"""

import difflib
import math
import zlib
from collections.abc import Mapping
from typing import Any

import tomli_w

from firmware_py.core.config import Config, config_of
from firmware_py.core.conflicts import (
    Conflict,
    conflict_of,
    highest_ratio,
    lowest_ratio,
    nominal_rad_s,
    recovery_s,
    start_s,
)
from firmware_py.core.control.start import LONGEST_SEARCH_S
from firmware_py.core.numbers import TAU
from firmware_py.core.safety.gate_limits import CLIPPED_SHARE
from firmware_py.core.safety.monitors import SLOWEST_RAD_S
from firmware_py.interface.addresses import Addresses, addresses
from firmware_py.interface.enums import ParameterTier
from firmware_py.interface.float32 import FLOAT32_OVERFLOW, float32_bits, float32_of
from firmware_py.interface.generated import parameters as parameter_records
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.parameter_table import TABLE, Parameter, record_name
from text_input import RefusalError, parse_toml

BY_NAME: dict[str, Parameter] = {parameter.name: parameter for parameter in TABLE}
DEFAULTS: dict[str, float] = {parameter.name: parameter.default for parameter in TABLE}
OF_THE_BUILD = [parameter.name for parameter in TABLE if parameter.tier is ParameterTier.BUILD]

DIMENSIONLESS = "1"
"""The unit of a number without one."""


class ParameterError(RefusalError, ValueError):
    """A parameter that does not exist, is not a number or is out of bounds; or an invalid file."""


def parameters_of(values: Mapping[str, float]) -> Parameters:
    """The firmware's `Parameters` from a complete set of values, such as that of `with_overrides`."""
    rows: dict[str, dict[str, float]] = {}
    for one in TABLE:
        value = values[one.name]
        rows.setdefault(one.table, {})[one.key] = int(value) if one.whole else float(value)
    records = {table: getattr(parameter_records, record_name(table))(**row) for table, row in rows.items()}
    return Parameters(**records)


def values_of(p: Parameters) -> dict[str, float]:
    """The complete set of values of a record: the inverse of `parameters_of`."""
    return {one.name: float(getattr(getattr(p, one.table), one.key)) for one in TABLE}


def config_from(overrides: Mapping[str, Any]) -> Config:
    """The core's configuration from the defaults with `overrides`."""
    return config_of(parameters_of(with_overrides(overrides)), False)


# --- one value --------------------------------------------------------------------------------------------


def round_to_float32(value: float) -> float:
    """The float32 nearest to `value`, and `value` itself if it is NaN or beyond the range of float32."""
    return float32_of(float32_bits(value)) if abs(value) < FLOAT32_OVERFLOW else value


def check_value(name: str, value: Any) -> float:
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
    is_within = round_to_float32(parameter.low) <= round_to_float32(value) <= round_to_float32(parameter.high)
    if not is_within or (parameter.whole and not float(value).is_integer()):
        count = "; a count is a whole number" if parameter.whole else ""
        raise ParameterError(f"{name} = {value!r}{unit} is out of bounds; give a value {bounds}{count}")
    return float(value)


def check_in_file(name: str, value: Any) -> float:
    """`check_value` for a value of a parameter file; parameters of the build are refused."""
    if name in OF_THE_BUILD:
        raise ParameterError(
            f"{name} is settled by the build ({value!r} is in a parameter file); remove it from the file"
        )
    return check_value(name, value)


# --- all values together ----------------------------------------------------------------------------------


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted names: `{"stop": {"restitution": 0.4}}` gives `{"stop.restitution": 0.4}`."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping) and (value or f"{prefix}{key}" not in DEFAULTS):
            flat.update(flatten(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def with_overrides(overrides: Mapping[str, Any]) -> dict[str, float]:
    """All parameters: the defaults, replaced by `overrides` (dotted names or nested tables).

    The caller configures the build, so parameters of the tier BUILD are accepted too.
    """
    values = DEFAULTS | {name: check_value(name, value) for name, value in flatten(overrides).items()}
    refuse_conflicts(values)
    return values


def refuse_conflicts(values: Mapping[str, float]) -> None:
    """Raise ParameterError if values that are within their own bounds do not fit together, a line for each.

    See `core.conflicts`, of which the first counts; or values are above their ceilings, or a limit is above
    what can be measured.
    """
    found = [
        f"{one.name} = {values[one.name]:g} exceeds {one.at_most} = {values[one.at_most]:g}; "
        "change one of them"
        for one in TABLE
        if one.at_most and round_to_float32(values[one.name]) > round_to_float32(values[one.at_most])
    ]
    p = parameters_of(values)
    conflict = conflict_of(p)
    if conflict != Conflict.NONE:
        found.append(conflict_text(p, conflict))
    seen_m_s2 = CLIPPED_SHARE * p.sensor.high_full_scale_m_s2 - p.sensor.high_offset_m_s2
    most_n = p.striker.mass_kg * seen_m_s2
    if round_to_float32(p.limit.force_n) > round_to_float32(most_n):
        found.append(
            f"limit.force_n = {p.limit.force_n:g} N exceeds the {most_n:g} N that the high range "
            f"shows on striker.mass_kg = {p.striker.mass_kg:g}; lower the limit to {math.floor(most_n)} N"
        )
    if found:
        raise ParameterError("\n".join(found))


def conflict_text(p: Parameters, conflict: Conflict) -> str:
    """What does not fit together, and the remedy."""
    fails = f"but fails after {LONGEST_SEARCH_S:g} s; lower one of them"
    turn_s, highest = TAU / nominal_rad_s(p), highest_ratio(p)
    if conflict == Conflict.LONG_START:
        return (
            f"a start takes up to {start_s(p, turn_s):.1f} s with start.approach_s = "
            f"{p.start.approach_s:g} s, start.rise_s = {p.start.rise_s:g} s and start.confirm_periods = "
            f"{p.start.confirm_periods} periods of this striker, {fails}"
        )
    if conflict == Conflict.LONG_RECOVERY:
        return (
            f"a recovery takes {recovery_s(p, turn_s):.1f} s with start.lost_periods = "
            f"{p.start.lost_periods}, start.dwell_periods = {p.start.dwell_periods}, start.again_s = "
            f"{p.start.again_s:g} s and start.confirm_periods = {p.start.confirm_periods}, {fails}"
        )
    if conflict == Conflict.FAST_RATIO:
        name = "gait.highest_ratio + gait.margin" if p.gait.follow > 0 else "start.highest_ratio"
        return (
            f"{name} = {highest:g} is a speed of {highest * nominal_rad_s(p):.1f} rad/s for this striker, "
            f"above limit.speed_rad_s = {p.limit.speed_rad_s:g}; lower the ratio to "
            f"{math.floor(1e3 * p.limit.speed_rad_s / nominal_rad_s(p)) / 1e3:g}, or raise the limit"
        )
    if conflict == Conflict.SLOW_RATIO:
        asked = "gait.lowest_ratio - gait.margin" if p.gait.follow > 0 else "start.lowest_ratio"
        name = "start.dip_ratio" if lowest_ratio(p) == p.start.dip_ratio else asked
        return (
            f"{name} = {lowest_ratio(p):g} is a speed of {lowest_ratio(p) * nominal_rad_s(p):.2f} rad/s for "
            f"this striker, and STALL judges only above {SLOWEST_RAD_S:g} rad/s; raise the ratio"
        )
    return (
        f"gait.highest_ratio = {p.gait.highest_ratio:g} with gait.margin = {p.gait.margin:g} exceeds "
        f"start.free_ratio = {p.start.free_ratio:g}; lower one of the first two"
    )


def require_proof(overrides: Mapping[str, Any]) -> dict[str, Any]:
    """`overrides` with the test of the drive's watchdog required before a start, unless they say otherwise.

    For a firmware whose bus may carry a real drive.
    """
    return {"watchdog.proof_required": 1.0} | flatten(overrides)


def addresses_from(values: Mapping[str, Any]) -> Addresses:
    """The module's node numbers, from values or overrides; raises `AddressError` if they are impossible."""
    complete = with_overrides(values)
    return addresses(int(complete["bus.drive_node"]), int(complete["bus.own_node"]))


def select_build(values: Mapping[str, Any]) -> dict[str, float]:
    """The parameters of the build among `values`."""
    return {name: value for name, value in flatten(values).items() if name in OF_THE_BUILD}


# --- the parameter file -----------------------------------------------------------------------------------


def _checksum(values: Mapping[str, float]) -> str:
    text = "".join(f"{name}={values[name]!r}\n" for name in sorted(values))
    return f"{zlib.crc32(text.encode()):08x}"


def format_file(values: Mapping[str, float]) -> str:
    """A complete set of values as TOML with its checksum, without the parameters of the build."""
    filed = {name: value for name, value in values.items() if name not in OF_THE_BUILD}
    document: dict[str, Any] = {"checksum": _checksum(filed)}
    for full_name, value in filed.items():
        block, _, name = full_name.partition(".")
        document.setdefault(block, {})[name] = value
    return tomli_w.dumps(document)


def parse_file(
    text: str, build: Mapping[str, float] | None = None, source: str = "the parameter file"
) -> dict[str, float]:
    """The values of a file that `format_file` made, with the `build`'s parameters, or defaults without them.

    Raises ParameterError if the file is damaged or incomplete, or contains parameters of the build.
    """
    try:
        document = parse_toml(text)
    except ValueError as error:
        raise ParameterError(
            f"{source} is no usable TOML ({error}); write it again with format_file()"
        ) from error
    checksum = document.pop("checksum", None)
    values = {name: check_in_file(name, value) for name, value in flatten(document).items()}
    missing = sorted(set(BY_NAME) - set(OF_THE_BUILD) - set(values))
    if missing:
        raise ParameterError(f"{source} lacks {', '.join(missing)}; write it again with format_file()")
    if checksum != _checksum(values):
        raise ParameterError(
            f"{source} has checksum {checksum!r}, its values give {_checksum(values)!r}: it is damaged or "
            "was edited by hand; write it again with format_file()"
        )
    return with_overrides(values | select_build(build or {}))
