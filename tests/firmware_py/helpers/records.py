"""Healthy inputs and quick changes of nested records, for tests."""

from typing import Any

from firmware_py.core.inputs import (
    AccelerometerInput,
    DriveInput,
    EncoderInput,
    GaitInput,
    Inputs,
    OperatorInput,
    PowerInput,
)
from firmware_py.core.measurements import NOTHING_MEASURED
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import AxisState, OperatorRequest

HEALTHY = Inputs(
    accelerometer=AccelerometerInput(0.0, 0.0, 0.0, 0),
    measurements=NOTHING_MEASURED,
    encoder=EncoderInput(0.0, 0.0, 0, 1),
    drive=DriveInput(AxisState.IDLE, 0, 0, 0),
    power=PowerInput(0.0, 24.0, 30.0, 30.0, 0),
    operator=OperatorInput(OperatorRequest.IDLE, 1.3, 0.0, 0, NEVER_TICKS),
    gait=GaitInput(0.0, True, True, NEVER_TICKS),
    estop=False,
)


def replaced(record: Any, path: str, value: Any) -> Any:
    """`record` with the field at the dotted `path` set to `value`."""
    name, _, rest = path.partition(".")
    inner = replaced(getattr(record, name), rest, value) if rest else value
    return record._replace(**{name: inner})


def leaves(record: Any, prefix: str = "") -> dict[str, Any]:
    """All fields of nested records by dotted name."""
    flat: dict[str, Any] = {}
    for name, value in zip(record._fields, record, strict=True):
        if hasattr(value, "_fields"):
            flat.update(leaves(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat
