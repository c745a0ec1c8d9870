"""The codec of one frame for the bench: the generated functions, with metadata and error messages."""

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from numbers import Integral, Real
from typing import Any, Generic, TypeVar

from firmware_py.interface.errors import ACCEPTED, FrameError, FrameErrorReason
from firmware_py.interface.float32 import FLOAT32_MAX, float32_of
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.layout import Layout, Signal, SignalKind, read_layouts

R = TypeVar("R", bound=tuple[Any, ...])

LAYOUTS = read_layouts()


@dataclass(frozen=True, slots=True)
class FrameCodec(Generic[R]):
    """One frame: its sender and period, and the conversion between its record and its bytes.

    `pack` and `unpack` are the functions of packing.py and unpacking.py, which return a status; `encode` and
    `decode` raise `FrameError` and name the invalid signal.
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
        """Return the frame. `counter` counts the frames of this identifier; its lowest bits are sent.

        Quantities saturate at full scale, so that a clipped reading decodes to exactly `signals[field].low`
        or `.high`; NaN, infinities and unlisted values are refused.
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
        if reason is not ACCEPTED:
            raise unusable(self.layout, data, reason)
        return record

    def counter(self, data: bytes) -> int:
        """Return the rolling counter of data that were decoded without an error."""
        if not self.protected:
            raise TypeError(f"{self.record.__name__} carries no counter; look at .protected first")
        return data[-2] >> 8 - self.layout.counter_bits


def codec_of(
    record: type[R],
    pack: Callable[[R, int], tuple[WordFrame, bool]],
    unpack: Callable[[int, int], tuple[R, FrameErrorReason]],
) -> FrameCodec[R]:
    """The codec of the frame with the record's name."""
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
        pack=pack,
        unpack=unpack,
    )


def _fields(record: type[tuple[Any, ...]]) -> tuple[str, ...]:
    """Names of the fields of a NamedTuple class, in order."""
    return record._fields  # type: ignore[attr-defined,no-any-return]  # every NamedTuple has them


def unusable(layout: Layout, data: bytes, reason: FrameErrorReason) -> FrameError:
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
        found = _unsendable(layout.name, signal, value, is_counts=True)
        if found is not None:
            return found
    raise AssertionError(f"{title}: refused for {reason.name}, but every signal of {data.hex(' ')} is well")


def unencodable(layout: Layout, fields: tuple[str, ...], record: tuple[Any, ...]) -> FrameError:
    """The error for a record that the encoder refuses; it names the first field that cannot be sent."""
    for name, value in zip(fields, record, strict=False):
        found = _unsendable(layout.name, layout.signals[name], value, is_counts=False)
        if found is not None:
            return found
    return FrameError(
        FrameErrorReason.NOT_A_NUMBER, f"{layout.name}: cannot send {record!r}, wanted {', '.join(fields)}"
    )


def _unsendable(frame: str, signal: Signal, value: object, is_counts: bool) -> FrameError | None:
    where = f"{frame}.{signal.name}"
    quantity = signal.is_float or (signal.kind is SignalKind.QUANTITY and not is_counts)
    if not isinstance(value, Real):
        return _not_a_number(where, value, "a number")
    if not math.isfinite(value):
        return FrameError(FrameErrorReason.NOT_FINITE, f"{where}: {value}, wanted a finite number")
    if quantity:
        wanted = f"a float32 (up to {FLOAT32_MAX:.4g})"
        too_large = signal.is_float and abs(float(value)) > FLOAT32_MAX
        return FrameError(FrameErrorReason.RANGE, f"{where}: {value}, wanted {wanted}") if too_large else None
    if not isinstance(value, Integral):
        return _not_a_number(where, value, "a whole number (int)")
    return _unlisted(where, signal, int(value))


def _unlisted(where: str, signal: Signal, number: int) -> FrameError | None:
    if signal.kind is SignalKind.ENUMERATION:
        if number in signal.values:
            return None
        wanted = ", ".join(str(known) for known in sorted(signal.values))
        message = f"{where}: value {number}, wanted one of {wanted} (VAL_ in vibro.dbc)"
        return FrameError(FrameErrorReason.ENUMERATION, message)
    if signal.low_counts <= number <= signal.high_counts:
        return None
    wanted = f"{signal.low_counts} to {signal.high_counts}"
    return FrameError(FrameErrorReason.RANGE, f"{where}: {number} counts, wanted {wanted}")


def _not_a_number(where: str, value: object, wanted: str) -> FrameError:
    return FrameError(
        FrameErrorReason.NOT_A_NUMBER, f"{where}: {value!r} is {type(value).__name__}, wanted {wanted}"
    )
