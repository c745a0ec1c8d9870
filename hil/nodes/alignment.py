"""Assigns one sample to each tick of a firmware process that may wake up late.

A late process finds the next tick's sample beside its own, and a sample carries no time. If two samples have
arrived and the tick before had one, they belong to this tick and the next, and the second waits for its tick.
Otherwise the crank would seem to turn by two ticks in one tick and to stand still in the next.
"""

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame

LONGEST_LAG_TICKS = 3
"""A firmware that woke up late has caught up after this time. If a sample still waits then, the firmware has
lost a tick of its own and would stay one sample behind, so it uses all samples."""

ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id


class Alignment:
    """Returns each tick's frames; no frame waits longer than one tick."""

    def __init__(self) -> None:
        self._waiting: list[Frame] = []
        self._lag_ticks = 0
        self.had_sample = True
        """Whether the last tick had a sample."""

    @property
    def waits(self) -> bool:
        """Whether frames wait for their tick."""
        return bool(self._waiting)

    def take(self, frames: list[Frame]) -> list[Frame]:
        """The frames of this tick among the frames that have arrived and those that waited."""
        samples = [frame.data for frame in frames if frame.can_id == ACCELEROMETER]
        waited = self._waiting
        if waited or (self.had_sample and len(samples) > 1):
            self._waiting = []
            own = None if waited else samples[0]
            now = list(waited)
            for frame in frames:
                next_begins = frame.can_id == ACCELEROMETER and frame.data != own
                early = next_begins or (bool(self._waiting) and frame.can_id == ENCODER)
                (self._waiting if early else now).append(frame)
            self.had_sample = True
            self._lag_ticks = self._lag_ticks + 1 if self._waiting else 0
            return now if self._lag_ticks <= LONGEST_LAG_TICKS else now + self._caught_up()
        self.had_sample = bool(samples)
        return frames

    def _caught_up(self) -> list[Frame]:
        """Remove and return the waiting frames."""
        waited, self._waiting, self._lag_ticks = self._waiting, [], 0
        return waited

    def hold(self, frames: list[Frame]) -> None:
        """Keep frames of the next tick until then."""
        self._waiting = frames

    def take_all(self, frames: list[Frame]) -> list[Frame]:
        """All frames, waiting and new, after skipped ticks."""
        return self._caught_up() + frames
