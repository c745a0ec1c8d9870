"""The sentences with which one frame's codec refuses data and records."""

import math
from numbers import Integral, Real
from typing import Any, NamedTuple

from firmware_py.interface.errors import FrameError, FrameErrorReason
from firmware_py.interface.layout import Layout, Signal, SignalKind

FLOAT32_MAX = 3.4028234663852886e38  # largest finite IEEE 754 binary32


class Refusals(NamedTuple):
    """Errors of one frame; `fields` are its record's, in order."""

    layout: Layout
    fields: tuple[str, ...]

    def wrong_length(self, data: bytes) -> FrameError:
        """Data of another length than the DBC's."""
        return FrameError(
            FrameErrorReason.LENGTH,
            f"{self._title()}: {len(data)} data bytes, wanted {self.layout.length}; "
            f"hold the sender's frame layout against vibro.dbc",
        )

    def wrong_crc(self, data: bytes) -> FrameError:
        """Data that was damaged on its way."""
        return FrameError(
            FrameErrorReason.CRC, f"{self._title()}: CRC of {data.hex(' ')} does not match; drop the frame"
        )

    def not_finite(self, name: str, value: float) -> FrameError:
        """NaN or an infinity, on the bus or in a record."""
        return FrameError(
            FrameErrorReason.NOT_FINITE, f"{self.layout.name}.{name}: {value}, wanted a finite number"
        )

    def unknown_value(self, name: str, value: int) -> FrameError:
        """A value that the enumeration does not list."""
        wanted = ", ".join(str(known) for known in sorted(self.layout.signals[name].values))
        return FrameError(
            FrameErrorReason.ENUMERATION,
            f"{self.layout.name}.{name}: value {value}, wanted one of {wanted} (VAL_ in vibro.dbc)",
        )

    def out_of_range(self, name: str, value: int) -> FrameError:
        """Counts that the signal cannot have."""
        signal = self.layout.signals[name]
        return FrameError(
            FrameErrorReason.RANGE,
            f"{self.layout.name}.{name}: {value} counts, wanted {signal.low_counts} to {signal.high_counts}",
        )

    def unencodable(self, record: tuple[Any, ...], error: Exception) -> FrameError:
        """Find the first field that cannot be sent: the encoder itself only knows that there is one."""
        for name, value in zip(self.fields, record, strict=False):
            found = self._unsendable(self.layout.signals[name], value)
            if found is not None:
                return found
        return FrameError(
            FrameErrorReason.NOT_A_NUMBER,
            f"{self.layout.name}: cannot send {record!r} ({error}), wanted {', '.join(self.fields)}",
        )

    def _unsendable(self, signal: Signal, value: object) -> FrameError | None:
        if not isinstance(value, Real):
            return self._not_a_number(signal, value, "a number")
        number = float(value)
        if not math.isfinite(number):
            return self.not_finite(signal.name, number)
        if signal.is_float:
            return self._exceeds_float32(signal, number) if abs(number) > FLOAT32_MAX else None
        return None if signal.kind is SignalKind.QUANTITY else self._unsendable_integer(signal, value)

    def _unsendable_integer(self, signal: Signal, value: Real) -> FrameError | None:
        if not isinstance(value, Integral):
            return self._not_a_number(signal, value, "a whole number (int)")
        number = int(value)
        if signal.kind is SignalKind.ENUMERATION:
            return None if number in signal.values else self.unknown_value(signal.name, number)
        in_range = signal.low_counts <= number <= signal.high_counts
        return None if in_range else self.out_of_range(signal.name, number)

    def _not_a_number(self, signal: Signal, value: object, wanted: str) -> FrameError:
        return FrameError(
            FrameErrorReason.NOT_A_NUMBER,
            f"{self.layout.name}.{signal.name}: {value!r} is {type(value).__name__}, wanted {wanted}",
        )

    def _exceeds_float32(self, signal: Signal, value: float) -> FrameError:
        return FrameError(
            FrameErrorReason.RANGE,
            f"{self.layout.name}.{signal.name}: {value}, wanted a float32 (up to {FLOAT32_MAX:.4g})",
        )

    def _title(self) -> str:
        return f"{self.layout.name} (0x{self.layout.can_id:03X})"
