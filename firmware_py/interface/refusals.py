"""The sentences with which one frame's codec refuses data and records."""

import math
from numbers import Integral, Real
from typing import Any

from firmware_py.interface.errors import FrameError, FrameErrorReason
from firmware_py.interface.float32 import FLOAT32_MAX, float32_of
from firmware_py.interface.layout import Layout, Signal, SignalKind


def unusable(layout: Layout, data: bytes, reason: FrameErrorReason) -> FrameError:
    """Data that the decoder refuses for `reason`, with the signal that is to blame."""
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
    """A record that the encoder refuses, with its first field that cannot be sent."""
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
