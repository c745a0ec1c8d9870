"""Records to frames and back, as the bench uses them: the generated codec with identity and errors."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from firmware_py.interface import records
from firmware_py.interface.errors import FrameError, FrameErrorReason
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.generated import packing, unpacking
from firmware_py.interface.layout import Layout, Signal, read_layouts, snake
from firmware_py.interface.refusals import unencodable, unusable

__all__ = ["CODECS", "CODEC_BY_ID", "FrameCodec", "FrameError", "FrameErrorReason", "decode", "encode"]

R = TypeVar("R", bound=tuple[Any, ...])

LAYOUTS = read_layouts()
_OK = FrameErrorReason.NONE


@dataclass(frozen=True, slots=True)
class FrameCodec(Generic[R]):
    """One frame: who sends it and how often, and the way between its record and its bytes.

    `pack` and `unpack` are the functions of those files, which refuse by status; `encode` and `decode` raise
    `FrameError` with the signal to blame.
    """

    record: type[R]
    layout: Layout
    can_id: int
    length: int
    sender: str | None  # None: any client of the drive
    period_s: float | None  # None: sent on an event
    protected: bool  # carries a rolling counter and a CRC-8
    signals: Mapping[str, Signal]
    pack: Callable[[R, int], tuple[WordFrame, bool]]
    unpack: Callable[[int, int], tuple[R, FrameErrorReason]]

    def encode(self, record: R, counter: int = 0) -> Frame:
        """Return the frame. `counter` counts this identifier's frames; its lowest bits are sent.

        Quantities saturate at full scale, so that a clipped reading decodes to exactly `signals[field].low`
        or `.high`; NaN, infinities and values that are not listed are refused.
        """
        try:
            frame, sendable = self.pack(record, counter)
            data = bytes_of(frame.word, self.length)
        except (TypeError, ValueError, OverflowError, struct.error) as error:
            raise unencodable(self.layout, _fields(self.record), record) from error
        if not sendable:
            raise unencodable(self.layout, _fields(self.record), record)
        return Frame(self.can_id, data)

    def decode(self, data: bytes) -> R:
        """Return the record; refuse a wrong length or CRC, unlisted values, counts out of range and floats
        that are not finite.
        """
        record, reason = self.unpack(len(data), word_of(data))
        if reason is not _OK:
            raise unusable(self.layout, data, reason)
        return record

    def counter(self, data: bytes) -> int:
        """Return the rolling counter of data that has been decoded without an error."""
        if not self.protected:
            raise TypeError(f"{self.record.__name__} carries no counter; look at .protected first")
        return data[-2] >> 8 - self.layout.counter_bits


def _codec(record: type[R]) -> FrameCodec[R]:
    layout = LAYOUTS[record.__name__]
    return FrameCodec(
        record=record,
        layout=layout,
        can_id=layout.can_id,
        length=layout.length,
        sender=layout.sender,
        period_s=layout.period_s,
        protected=layout.protected,
        signals=layout.signals,
        pack=getattr(packing, f"pack_{snake(layout.name)}"),
        unpack=getattr(unpacking, f"unpack_{snake(layout.name)}"),
    )


def _fields(record: type[tuple[Any, ...]]) -> tuple[str, ...]:
    """Fields of a NamedTuple class, in order."""
    return record._fields  # type: ignore[attr-defined,no-any-return]  # every NamedTuple has them


DRIVE_HEARTBEAT = _codec(records.DriveHeartbeat)
DRIVE_ESTOP = _codec(records.DriveEstop)
DRIVE_ERRORS = _codec(records.DriveErrors)
SET_AXIS_STATE = _codec(records.SetAxisState)
ENCODER_ESTIMATES = _codec(records.EncoderEstimates)
SET_CONTROLLER_MODE = _codec(records.SetControllerMode)
SET_INPUT_VELOCITY = _codec(records.SetInputVelocity)
SET_INPUT_TORQUE = _codec(records.SetInputTorque)
SET_LIMITS = _codec(records.SetLimits)
DRIVE_CURRENT = _codec(records.DriveCurrent)
DRIVE_TEMPERATURE = _codec(records.DriveTemperature)
DRIVE_SUPPLY = _codec(records.DriveSupply)
CLEAR_ERRORS = _codec(records.ClearErrors)
SET_ABSOLUTE_POSITION = _codec(records.SetAbsolutePosition)
ACCELEROMETER = _codec(records.Accelerometer)
COARSE_POSITION = _codec(records.CoarsePosition)
GAIT_SENSORS = _codec(records.GaitSensors)
OPERATOR_COMMAND = _codec(records.OperatorCommand)
PARAMETER_REQUEST = _codec(records.ParameterRequest)
FIRMWARE_HEARTBEAT = _codec(records.FirmwareHeartbeat)
STRIKER_ESTIMATE = _codec(records.StrikerEstimate)
REGIME_REPORT = _codec(records.RegimeReport)
IMPACT_EVENT = _codec(records.ImpactEvent)
FAULT_EVENT = _codec(records.FaultEvent)
PARAMETER_VALUE = _codec(records.ParameterValue)
GAIT_REPORT = _codec(records.GaitReport)

CODECS: dict[type[Any], FrameCodec[Any]] = {
    value.record: value for value in tuple(globals().values()) if isinstance(value, FrameCodec)
}
CODEC_BY_ID: dict[int, FrameCodec[Any]] = {codec.can_id: codec for codec in CODECS.values()}


def encode(record: tuple[Any, ...], counter: int = 0) -> Frame:
    """Pack any record of the bus; `counter` is ignored by frames that carry none."""
    codec = CODECS.get(type(record))
    if codec is None:
        raise TypeError(
            f"{type(record).__name__} is no record of the bus; add it to records.py and vibro.dbc"
        )
    return codec.encode(record, counter)


def decode(frame: Frame) -> Any:
    """Unpack any frame of the bus into its record; raise `FrameError` for a bad or an unknown one."""
    codec = CODEC_BY_ID.get(frame.can_id)
    if codec is None:
        raise FrameError(
            FrameErrorReason.UNKNOWN_ID, f"no frame 0x{frame.can_id:03X} in vibro.dbc; ignore it"
        )
    return codec.decode(frame.data)
