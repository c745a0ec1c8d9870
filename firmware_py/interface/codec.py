"""Records to frames and back: one codec per frame (`codec.ACCELEROMETER` …), and `encode` and `decode`."""

from typing import Any

from firmware_py.interface.errors import FrameError, FrameErrorReason
from firmware_py.interface.frame import Frame
from firmware_py.interface.frame_codec import FrameCodec
from firmware_py.interface.generated import codecs
from firmware_py.interface.generated.codecs import *  # noqa: F403 - a constant a frame, by the frame's name

__all__ = ["CODECS", "CODEC_BY_ID", "FrameCodec", "FrameError", "FrameErrorReason", "decode", "encode"]

CODECS: dict[type[Any], FrameCodec[Any]] = {
    value.record: value for value in vars(codecs).values() if isinstance(value, FrameCodec)
}
CODEC_BY_ID: dict[int, FrameCodec[Any]] = {codec.can_id: codec for codec in CODECS.values()}


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
