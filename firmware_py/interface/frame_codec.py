"""The codec of one frame, as the bench uses it: the generated packing with identity and errors."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from firmware_py.interface.errors import FrameErrorReason
from firmware_py.interface.frame import Frame, WordFrame, bytes_of, word_of
from firmware_py.interface.layout import Layout, Signal, read_layouts
from firmware_py.interface.refusals import unencodable, unusable

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


def codec_of(
    record: type[R],
    pack: Callable[[R, int], tuple[WordFrame, bool]],
    unpack: Callable[[int, int], tuple[R, FrameErrorReason]],
) -> FrameCodec[R]:
    """The codec of the frame that has the record's name."""
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
    """Fields of a NamedTuple class, in order."""
    return record._fields  # type: ignore[attr-defined,no-any-return]  # every NamedTuple has them
