"""`can.log`: every frame of a run in candump's format, which python-can and cantools read."""

from collections.abc import Iterable
from pathlib import Path

from firmware_py.interface.frame import Frame

CHANNEL = "can0"
FRAME_NAMES = [f" {CHANNEL} {can_id:03X}#" for can_id in range(0x800)]
FLUSHED_BYTES = 1 << 18


class CanLog:
    """Appends `(seconds.micros) channel ID#DATA` lines."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w", buffering=FLUSHED_BYTES, encoding="ascii")

    def write(self, t_us: int, frames: Iterable[Frame]) -> None:
        """Write frames that were on the bus at `t_us`."""
        seconds, micros = divmod(t_us, 1_000_000)
        stamp = f"({seconds}.{micros:06})"
        lines = [f"{stamp}{FRAME_NAMES[can_id]}{data.hex().upper()}\n" for can_id, data in frames]
        self._file.write("".join(lines))

    def flush(self) -> None:
        """Pass the buffered lines to the operating system."""
        self._file.flush()

    def close(self) -> None:
        """Write the buffered lines and close the file."""
        self._file.close()

    def __enter__(self) -> "CanLog":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
