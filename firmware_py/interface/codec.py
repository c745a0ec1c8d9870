"""Records to frames and back: one codec per frame (`codec.ACCELEROMETER` …), and `encode` and `decode`.

The generated functions with error messages, for the bench. `vibro.dbc` is read only for messages and for the
description of signals, because cantools takes a second to import.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from numbers import Integral, Real
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from firmware_py.interface.float32 import FLOAT32_MAX, float32_of
from firmware_py.interface.frame import (
    ACCEPTED,
    Frame,
    FrameError,
    FrameErrorReason,
    WordFrame,
    bytes_of,
    word_of,
)
from firmware_py.interface.framing import FrameKind, counter_of
from firmware_py.interface.generated import kinds, packing, records, unpacking

if TYPE_CHECKING:
    from firmware_py.interface.dbc import Layout, Signal

__all__ = ["CODECS", "CODEC_BY_ID", "FrameCodec", "FrameError", "FrameErrorReason", "decode", "encode"]

R = TypeVar("R", bound=tuple[Any, ...])


@dataclass(frozen=True, slots=True)
class FrameCodec(Generic[R]):
    """One frame: the conversion between its record and its bytes.

    `pack` and `unpack` are the functions of packing.py and unpacking.py, which return a status; `encode` and
    `decode` raise `FrameError` and name the invalid signal.
    """

    record: type[R]
    kind: FrameKind
    pack: Callable[[R, int], tuple[WordFrame, bool]]
    unpack: Callable[[int, int], tuple[R, FrameErrorReason]]

    @property
    def can_id(self) -> int:
        """The identifier in `vibro.dbc`."""
        return self.kind.can_id

    @property
    def length(self) -> int:
        """The number of data bytes."""
        return self.kind.length

    @property
    def period_s(self) -> float | None:
        """The period; None for a frame that is sent on an event."""
        return self.kind.period_s or None

    @property
    def protected(self) -> bool:
        """Whether the frame carries a rolling counter and a CRC-8."""
        return self.kind.counter_bits > 0

    @property
    def layout(self) -> "Layout":
        """The description of the frame in `vibro.dbc`."""
        from firmware_py.interface.dbc import layouts  # noqa: PLC0415 - imports cantools

        return layouts()[self.record.__name__]

    @property
    def sender(self) -> str | None:
        """The sender; None: any client of the drive."""
        return self.layout.sender

    @property
    def signals(self) -> "dict[str, Signal]":
        """The signals by name, without counter and CRC."""
        return self.layout.signals

    def encode(self, record: R, counter: int = 0) -> Frame:
        """Return the frame. `counter` counts the frames of this identifier; its lowest bits are sent.

        Quantities saturate at full scale, so that a clipped reading decodes to exactly `signals[field].low`
        or `.high`; NaN, infinities and unlisted values are refused.
        """
        try:
            frame, sendable = self.pack(record, counter)
            data = bytes_of(frame.word, self.length)
        except (TypeError, ValueError, OverflowError, struct.error) as error:
            raise find_encoding_error(self.layout, record) from error
        if not sendable:
            raise find_encoding_error(self.layout, record)
        return Frame(self.can_id, data)

    def decode(self, data: bytes) -> R:
        """Return the record; refuse a wrong length or CRC, unlisted values, counts out of range and floats
        that are not finite.
        """
        record, reason = self.unpack(len(data), word_of(data))
        if reason is not ACCEPTED:
            raise find_decoding_error(self.layout, data, reason)
        return record

    def counter(self, data: bytes) -> int:
        """Return the rolling counter of data that were decoded without an error."""
        if not self.protected:
            raise TypeError(f"{self.record.__name__} carries no counter; look at .protected first")
        return counter_of(self.kind, word_of(data))


def find_decoding_error(layout: "Layout", data: bytes, reason: FrameErrorReason) -> FrameError:
    """The error for data that the decoder refuses for `reason`; it names the invalid signal."""
    title = f"{layout.name} (0x{layout.can_id:03X})"
    if reason is FrameErrorReason.LENGTH:
        return FrameError(
            reason,
            f"{title}: {len(data)} data bytes, wanted {layout.length}; "
            f"hold the sender's frame layout against vibro.dbc",
        )
    if reason is FrameErrorReason.CRC:
        return FrameError(reason, f"{title}: CRC of {data.hex(' ')} does not match; drop the frame")
    word = int.from_bytes(data, "little")
    for signal in layout.signals.values():
        counts = word >> signal.start & (1 << signal.bits) - 1
        if signal.is_signed and not signal.is_float and counts >> signal.bits - 1:
            counts -= 1 << signal.bits
        value = float32_of(counts) if signal.is_float else counts
        found = find_signal_error(layout.name, signal, value, is_counts=True)
        if found is not None:
            return found
    raise AssertionError(f"{title}: refused for {reason.name}, but every signal of {data.hex(' ')} is well")


def find_encoding_error(layout: "Layout", record: tuple[Any, ...]) -> FrameError:
    """The error for a record that the encoder refuses; it names the first field that cannot be sent."""
    for signal, value in zip(layout.signals.values(), record, strict=False):
        found = find_signal_error(layout.name, signal, value, is_counts=False)
        if found is not None:
            return found
    wanted = ", ".join(layout.signals)
    return FrameError(
        FrameErrorReason.NOT_A_NUMBER, f"{layout.name}: cannot send {record!r}, wanted {wanted}"
    )


def find_signal_error(frame: str, signal: "Signal", value: object, is_counts: bool) -> FrameError | None:
    where = f"{frame}.{signal.name}"
    quantity = signal.is_float or (signal.kind.value == "Quantity" and not is_counts)
    if not isinstance(value, Real):
        return refuse_type(where, value, "a number")
    if not math.isfinite(value):
        return FrameError(FrameErrorReason.NOT_FINITE, f"{where}: {value}, wanted a finite number")
    if quantity:
        wanted = f"a float32 (up to {FLOAT32_MAX:.4g})"
        too_large = signal.is_float and abs(float(value)) > FLOAT32_MAX
        return FrameError(FrameErrorReason.RANGE, f"{where}: {value}, wanted {wanted}") if too_large else None
    if not isinstance(value, Integral):
        return refuse_type(where, value, "a whole number (int)")
    return find_range_error(where, signal, int(value))


def find_range_error(where: str, signal: "Signal", number: int) -> FrameError | None:
    if signal.values:
        if number in signal.values:
            return None
        wanted = ", ".join(str(known) for known in sorted(signal.values))
        message = f"{where}: value {number}, wanted one of {wanted} (VAL_ in vibro.dbc)"
        return FrameError(FrameErrorReason.ENUMERATION, message)
    if signal.low_counts <= number <= signal.high_counts:
        return None
    wanted = f"{signal.low_counts} to {signal.high_counts}"
    return FrameError(FrameErrorReason.RANGE, f"{where}: {number} counts, wanted {wanted}")


def refuse_type(where: str, value: object, wanted: str) -> FrameError:
    return FrameError(
        FrameErrorReason.NOT_A_NUMBER, f"{where}: {value!r} is {type(value).__name__}, wanted {wanted}"
    )


def to_camel(name: str) -> str:
    """`SET_INPUT_TORQUE` as `SetInputTorque`."""
    return "".join(map(str.capitalize, name.split("_")))


CODEC_BY_NAME: dict[str, FrameCodec[Any]] = {
    name: FrameCodec(
        getattr(records, to_camel(name)),
        kind,
        getattr(packing, f"pack_{name.lower()}"),
        getattr(unpacking, f"unpack_{name.lower()}"),
    )
    for name, kind in vars(kinds).items()
    if isinstance(kind, FrameKind)
}
CODECS: dict[type[Any], FrameCodec[Any]] = {one.record: one for one in CODEC_BY_NAME.values()}
CODEC_BY_ID: dict[int, FrameCodec[Any]] = {one.can_id: one for one in CODECS.values()}


globals().update(CODEC_BY_NAME)  # `codec.ACCELEROMETER` …


def __getattr__(name: str) -> FrameCodec[Any]:
    """The type of the codecs by name, for a type checker; reached only by a name that is no frame."""
    raise AttributeError(f"no frame {name} in vibro.dbc; there are {', '.join(CODEC_BY_NAME)}")


def encode(record: tuple[Any, ...], counter: int = 0) -> Frame:
    """Pack any record of the bus; `counter` is ignored for frames without a rolling counter."""
    codec = CODECS.get(type(record))
    if codec is None:
        raise TypeError(f"{type(record).__name__} is no record of the bus; add it to vibro.dbc")
    return codec.encode(record, counter)


def decode(frame: Frame) -> Any:
    """Unpack any frame of the bus into its record; raise `FrameError` for an invalid or unknown frame."""
    codec = CODEC_BY_ID.get(frame.can_id)
    if codec is None:
        raise FrameError(
            FrameErrorReason.UNKNOWN_ID, f"no frame 0x{frame.can_id:03X} in vibro.dbc; ignore it"
        )
    return codec.decode(frame.data)
