"""The parameter server: reading and writing one parameter by its index, in the firmware's subset.

    read_parameter(parameters, index) -> (value, tier, status)
    write_parameter(parameters, index, value) -> (parameters, status)

`Parameters` (parameter_values.py) is a NamedTuple of floats in the order of the bus's indices,
with `DEFAULTS` beside it; `configure.config_of(parameters, damaged)` makes the core's Config of it. A refused
write returns the parameters unchanged. The caller decides whether a write is allowed at all: only if nothing
moves. Names, units, files and error messages are handled by the shell (shell/parameters.py).
"""

import math

from firmware_py.core.parameter_values import COUNT, HIGH, LOW, ORDERED, TIERS, WHOLE, Parameters
from firmware_py.interface.enums import ParameterStatus, ParameterTier

BUILD = ParameterTier.BUILD.value
MODULE = ParameterTier.MODULE.value
OK = ParameterStatus.OK
UNKNOWN_INDEX = ParameterStatus.UNKNOWN_INDEX
OUT_OF_RANGE = ParameterStatus.OUT_OF_RANGE
NOT_WRITABLE = ParameterStatus.NOT_WRITABLE


def within_bounds(index: int, value: float) -> bool:
    """Whether `value` is within the parameter's own bounds, and whole if it is a count; NaN is not."""
    if not LOW[index] <= value <= HIGH[index]:
        return False
    return WHOLE[index] == 0 or value == math.floor(value)


def conflict(parameters: Parameters) -> int:
    """Index in `ORDERED` of the first pair whose first parameter exceeds its second; −1 if there is none."""
    for place, (lower, upper) in enumerate(ORDERED):
        if parameters[lower] > parameters[upper]:
            return place
    return -1


def read_parameter(parameters: Parameters, index: int) -> tuple[float, int, ParameterStatus]:
    """The value, its `ParameterTier` and OK; 0, MODULE and UNKNOWN_INDEX if there is no such parameter."""
    if not 0 <= index < COUNT:
        return 0.0, MODULE, UNKNOWN_INDEX
    return parameters[index], TIERS[index], OK


def with_value(parameters: Parameters, index: int, value: float) -> Parameters:
    """`parameters` with `value` at `index`."""
    return Parameters(*(value if place == index else one for place, one in enumerate(parameters)))


def write_parameter(parameters: Parameters, index: int, value: float) -> tuple[Parameters, ParameterStatus]:
    """The parameters with `value` at `index` and OK; or the parameters unchanged and the reason."""
    if not 0 <= index < COUNT:
        return parameters, UNKNOWN_INDEX
    if TIERS[index] == BUILD:
        return parameters, NOT_WRITABLE
    if not within_bounds(index, value):
        return parameters, OUT_OF_RANGE
    written = with_value(parameters, index, value)
    if conflict(written) >= 0:
        return parameters, OUT_OF_RANGE
    return written, OK
