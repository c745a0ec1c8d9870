"""Records to frames and back: one `FrameCodec` a record, made from `vibro.dbc` on import."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Generic

from firmware_py.interface import records
from firmware_py.interface.dbc import database
from firmware_py.interface.errors import FrameError, FrameErrorReason
from firmware_py.interface.frame import Frame
from firmware_py.interface.generate import Decoder, Encoder, R, decoder, encoder
from firmware_py.interface.layout import LayoutError, Signal, layout_of

__all__ = ["CODECS", "CODEC_BY_ID", "FrameCodec", "FrameError", "FrameErrorReason", "decode", "encode"]

COUNTER_MODULUS = 16


@dataclass(frozen=True, slots=True)
class FrameCodec(Generic[R]):
    """One frame: who sends it and how often, and the way between its record and its bytes.

    `encode(record, counter=0)` saturates quantities at full scale, so that a clipped reading decodes to
    exactly `signals[field].low` or `.high`; it refuses NaN, infinities and values that are not listed.
    `decode(data)` refuses a wrong length, a wrong CRC, unlisted values, counts out of range and floats that
    are not finite. Both raise `FrameError`.
    """

    record: type[R]
    can_id: int
    length: int
    sender: str | None  # None: any client of the drive
    period_s: float | None  # None: sent on an event
    protected: bool  # carries a rolling counter and a CRC-8
    signals: Mapping[str, Signal]
    encode: Encoder[R]
    decode: Decoder[R]

    def counter(self, data: bytes) -> int:
        """Return the rolling counter, 0…15, of data that has been decoded without an error."""
        if not self.protected:
            raise TypeError(f"{self.record.__name__} carries no counter; look at .protected first")
        return data[-2] >> 4


def _codec(record: type[R]) -> FrameCodec[R]:
    layout = layout_of(database().get_message_by_name(record.__name__))
    fields: tuple[str, ...] = record._fields  # type: ignore[attr-defined]  # every NamedTuple has them
    if set(fields) != set(layout.signals):
        raise LayoutError(
            f"{layout.name}: signals {sorted(layout.signals)}, but the record has {sorted(fields)}"
        )
    return FrameCodec(
        record=record,
        can_id=layout.can_id,
        length=layout.length,
        sender=layout.sender,
        period_s=layout.period_s,
        protected=layout.protected,
        signals=layout.signals,
        encode=encoder(layout, record),
        decode=decoder(layout, record),
    )


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
