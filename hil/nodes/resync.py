"""The first ticks of the firmware's process after a pause: nothing is done until a sample of now has come.

The firmware uses the samples that have waited, each at the time that its counter says, and takes the newest
for that of its tick. After a pause, of the whole machine say, only samples from before it may lie there, and
those of now may take a moment. The accelerometer's rolling counter separates them: it counts the sensors'
ticks, so that over the pause it must have moved as far as the clock has, give or take the one tick that
either loop may be late at any time. After a pause of nearly a turn of the counter, 256 ticks, nothing that
lies there is taken; what comes in the next tick is of now.
"""

from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame
from firmware_py.node.receiver import LONGEST_DATED_TICKS

PATIENCE_TICKS = 25
"""Ticks after a pause in which nothing is done without a sample of now; then the sensors count as silent."""

AT_ONCE, AT_LAST = (0, 1), (0, 1, -1)
"""Ticks by which a counter may be off, best first: this tick's sample, or the next one's, which may have come
as well; the one before only if none of these comes, as it would leave the firmware a tick behind."""

MODULUS = 1 << codec.ACCELEROMETER.layout.counter_bits
ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id

STEADY_SAMPLES = 2
"""No more come in a tick of sensors that keep their pace: they are of now whatever their counter says, as the
one it is compared with may have been misjudged."""


def counter_of(frame: Frame) -> int | None:
    """The rolling counter of an accelerometer frame; None for any other and for a damaged one."""
    if frame.can_id != ACCELEROMETER:
        return None
    try:
        codec.ACCELEROMETER.decode(frame.data)
    except FrameError:
        return None
    return codec.ACCELEROMETER.counter(frame.data)


def is_sampled(frame: Frame) -> bool:
    """Whether a frame is part of a sample, which stands for its own tick."""
    return frame.can_id in (ACCELEROMETER, ENCODER)


class Waking:
    """Gathers frames from the end of a pause until a sample of the current tick is among them.

    `last_frames` are those of `last_tick`, the last one before the pause that had a sample. `early` are the
    frames of the next tick's sample, where that has come as well.
    """

    def __init__(self, last_tick: int, last_frames: Sequence[Frame]) -> None:
        counters = [counter for counter in map(counter_of, last_frames) if counter is not None]
        self._last_tick = last_tick
        self._lead = counters[-1] - last_tick if counters else None
        self._left_ticks = PATIENCE_TICKS
        self._gathered: list[Frame] = []
        self.early: list[Frame] = []
        self.elapsed_ticks = 0
        self.is_fresh = False

    def begin_tick(self, tick: int, elapsed_ticks: int, frames: Sequence[Frame]) -> None:
        """Another tick of the loop, with the frames that lie there."""
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
        """The frames that arrived while waiting for the sample of `tick`."""
        self._gathered += frames
        self._look(tick, AT_LAST)

    @property
    def frames(self) -> list[Frame]:
        """The frames for the firmware, in the order of arrival; old samples only with a present one."""
        return self._gathered if self.is_fresh else self._without_samples()

    @property
    def is_over(self) -> bool:
        """Whether to go on: with a sample of now, or because there is none to be had."""
        return self.is_fresh or self._left_ticks <= 0

    def _without_samples(self) -> list[Frame]:
        return [frame for frame in self._gathered if not is_sampled(frame)]

    def _look(self, tick: int, jitters: Sequence[int]) -> None:
        """Look for the sample of `tick`, or nearly; the newest one where no counter is known before it."""
        places = {counter_of(frame): place for place, frame in enumerate(self._gathered)}
        places.pop(None, None)
        if self._lead is None:
            self.is_fresh = bool(places)
            return
        now = self._lead + tick
        near = [places[(now + jitter) % MODULUS] for jitter in jitters if (now + jitter) % MODULUS in places]
        self.is_fresh = bool(near)
        if near:
            self._hold_back(near[0])

    def _hold_back(self, own: int) -> None:
        """What was sampled after the accelerometer's frame at place `own` is early."""
        first_id = next(frame.can_id for frame in self._gathered if is_sampled(frame))
        later = self._gathered[own + 1 :]
        begins = [place for place, frame in enumerate(later, own + 1) if frame.can_id == first_id]
        if begins:
            rest = self._gathered[begins[0] :]
            self.early = [frame for frame in rest if is_sampled(frame)]
            self._gathered[begins[0] :] = [frame for frame in rest if not is_sampled(frame)]
