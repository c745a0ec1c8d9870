"""Resynchronisation of the firmware's process after a pause: it waits for a sample of the current tick.

The firmware uses the samples that have waited, each at the time given by its counter, and assigns the newest
to its current tick. After a pause, for example a host stall, the receive queue may hold only old samples, and
the current ones may arrive a moment later. The accelerometer's rolling counter distinguishes them: it counts
the sensors' ticks, so during the pause it must have advanced as far as the clock, within the one tick by
which either loop may be late. After a pause of nearly a full turn of the counter, 256 ticks, no waiting
sample is used; the samples of the next tick are current.
"""

from collections.abc import Sequence

from firmware_py.interface.frame import Frame
from firmware_py.shell.catching_up import (
    ACCELEROMETER,
    COUNTER_MODULUS,
    LONGEST_DATED_TICKS,
    is_sampled,
    sample_counter,
)

PATIENCE_TICKS = 25
"""Longest wait for a current sample after a pause, in ticks; then the sensors count as silent."""

AT_ONCE, AT_LAST = (0, 1), (0, 1, -1)
"""Accepted deviations of a counter in ticks, best first: this tick's sample, then the next tick's, which may
also have arrived. The previous tick's comes last, since it would leave the firmware a tick behind."""

STEADY_SAMPLES = 2
"""Largest number of samples per tick from sensors in steady operation. If no more arrive, they are current
regardless of their counter, since the counter before the pause may have been assigned to a wrong tick."""


class Resync:
    """Collects frames from the end of a pause until a sample of the current tick is among them.

    `last_frames`: the frames of `last_tick`, the last tick with a sample before the pause. `early`: the
    frames of the next tick's sample, if it has already arrived.
    """

    def __init__(self, last_tick: int, last_frames: Sequence[Frame]) -> None:
        counters = [counter for counter in map(sample_counter, last_frames) if counter is not None]
        self._last_tick = last_tick
        self._lead = counters[-1] - last_tick if counters else None
        self._left_ticks = PATIENCE_TICKS
        self._gathered: list[Frame] = []
        self.early: list[Frame] = []
        self.elapsed_ticks = 0
        self.is_fresh = False

    def begin_tick(self, tick: int, elapsed_ticks: int, frames: Sequence[Frame]) -> None:
        """Begin another tick of the loop with the frames that have arrived."""
        is_first = self.elapsed_ticks == 0
        self.elapsed_ticks += elapsed_ticks
        self._left_ticks -= 1
        self._gathered += frames
        if is_first and tick - self._last_tick >= LONGEST_DATED_TICKS:
            self._gathered = self._without_samples()
            return
        samples = sum(frame.can_id == ACCELEROMETER for frame in frames)
        self._look(tick, AT_ONCE)
        self.is_fresh = self.is_fresh or (not is_first and 0 < samples <= STEADY_SAMPLES)

    def take(self, tick: int, frames: Sequence[Frame]) -> None:
        """Add the frames that arrived during the wait for the sample of `tick`."""
        self._gathered += frames
        self._look(tick, AT_LAST)

    @property
    def frames(self) -> list[Frame]:
        """The frames for the firmware, in the order of arrival; samples only if one of them is current."""
        return self._gathered if self.is_fresh else self._without_samples()

    @property
    def is_over(self) -> bool:
        """Whether the firmware may continue: with a current sample, or because the wait has ended."""
        return self.is_fresh or self._left_ticks <= 0

    def _without_samples(self) -> list[Frame]:
        return [frame for frame in self._gathered if not is_sampled(frame)]

    def _look(self, tick: int, jitters: Sequence[int]) -> None:
        """Search for the sample of `tick` within `jitters`; any sample if no earlier counter is known."""
        places = {sample_counter(frame): place for place, frame in enumerate(self._gathered)}
        places.pop(None, None)
        if self._lead is None:
            self.is_fresh = bool(places)
            return
        now = self._lead + tick
        near = [
            places[(now + jitter) % COUNTER_MODULUS]
            for jitter in jitters
            if (now + jitter) % COUNTER_MODULUS in places
        ]
        self.is_fresh = bool(near)
        if near:
            self._hold_back(near[0])

    def _hold_back(self, own: int) -> None:
        """Move the samples after the accelerometer's frame at index `own` to `early`."""
        first_id = next(frame.can_id for frame in self._gathered if is_sampled(frame))
        later = self._gathered[own + 1 :]
        begins = [place for place, frame in enumerate(later, own + 1) if frame.can_id == first_id]
        if begins:
            rest = self._gathered[begins[0] :]
            self.early = [frame for frame in rest if is_sampled(frame)]
            self._gathered[begins[0] :] = [frame for frame in rest if not is_sampled(frame)]
