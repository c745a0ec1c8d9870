"""One sample a tick: a firmware process that wakes up late finds the next tick's sample beside its own.

A sample stands for the instant it was sent at, and does not say which that was. Two at once, where neither
tick before them went without, are this tick's and the next one's: the second waits for its tick. Without that
the crank would seem to have turned for two ticks within one, and to stand in the next.
"""

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame

LONGEST_LAG_TICKS = 3
"""A firmware that woke up late has caught up by then; one that finds a further sample all the same has lost a
tick of its own, and would stay one behind for good."""

ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id


class Alignment:
    """Hands out each tick's frames; no frame waits for longer than one tick."""

    def __init__(self) -> None:
        self._waiting: list[Frame] = []
        self._lag_ticks = 0
        self.had_sample = True
        """Whether there was one in the last tick."""

    @property
    def waits(self) -> bool:
        """Whether frames wait for their tick."""
        return bool(self._waiting)

    def take(self, frames: list[Frame]) -> list[Frame]:
        """The frames of this tick, of those that have arrived and those that waited."""
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
        """Let frames of the next tick wait for it."""
        self._waiting = frames

    def take_all(self, frames: list[Frame]) -> list[Frame]:
        """Everything there is, after skipped ticks."""
        return self._caught_up() + frames
