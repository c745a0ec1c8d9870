"""The first ticks of the firmware's process after a pause, when old samples would pass for new ones.

A sample stands for the instant it was sent at, and does not say which that was. While a loop keeps its pace,
that is this tick. After a pause, of the whole machine say, samples from before it may lie there, and those of
now may take a moment. The accelerometer's rolling counter separates them: it counts the sensors' ticks, so
that over the pause it must have moved as far as the clock has, give or take the one tick that either loop may
be late at any time. After a pause of nearly a turn of the counter, 256 ticks, nothing that lies there is
taken; what comes in the next tick is of now. The bus may have been held up for longer than the loop, and then
all that was sent since the last received sample may lie there.
"""

from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.frame import Frame

PATIENCE_TICKS = 25
"""Ticks after a pause in which nothing is done without a sample of now; then the sensors count as silent."""

AT_ONCE, AT_LAST = (0, 1), (0, 1, -1)
"""Ticks by which a counter may be off, best first: this tick's sample, or the next one's, which may have come
as well; the one before only if none of these comes, as it would leave the firmware a tick behind."""

MODULUS = 1 << codec.ACCELEROMETER.layout.counter_bits
ACCELEROMETER, ENCODER = codec.ACCELEROMETER.can_id, codec.ENCODER_ESTIMATES.can_id

LONGEST_DATED_TICKS = MODULUS - 2
"""Since the last sample: for as long a sample's counter says when it was sent, give or take a tick."""

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


class Waking:
    """Gathers frames from the end of a pause until a sample of the current tick is among them.

    `last_frames` are those of `last_tick`, the last one before the pause that had a sample.
    """

    def __init__(self, last_tick: int, last_frames: Sequence[Frame]) -> None:
        counters = [counter for counter in map(counter_of, last_frames) if counter is not None]
        self._last_tick = last_tick
        self._lead = counters[-1] - last_tick if counters else None
        self._left_ticks = PATIENCE_TICKS
        self._held: list[Frame] = []
        self.frames: list[Frame] = []
        self.elapsed_ticks = 0
        self.is_fresh = False

    def begin_tick(self, tick: int, elapsed_ticks: int, frames: Sequence[Frame]) -> None:
        """Another tick of the loop, with the frames that lie there."""
        is_first = self.elapsed_ticks == 0
        self.elapsed_ticks += elapsed_ticks
        self._left_ticks -= 1
        samples = [frame for frame in frames if frame.can_id == ACCELEROMETER]
        self._keep_others(frames)
        if is_first and tick - self._last_tick >= LONGEST_DATED_TICKS:
            return
        self._keep_newest(self._near(tick, frames, AT_ONCE), frames)
        if self._near(tick, frames, AT_LAST):
            self._held = [frame for frame in frames if frame.can_id in (ACCELEROMETER, ENCODER)]
        elif not is_first and len(samples) <= STEADY_SAMPLES:
            self._keep_newest(samples, frames)

    def _keep_others(self, frames: Sequence[Frame]) -> None:
        self.frames += [frame for frame in frames if frame.can_id not in (ACCELEROMETER, ENCODER)]

    def take(self, tick: int, frames: Sequence[Frame]) -> None:
        """What came while waiting for the samples of `tick`, and last of all those that were held back."""
        self._keep_others(frames)
        held = [*self._held, *frames]
        self._keep_newest(self._near(tick, held, AT_LAST), held)

    def _near(self, tick: int, frames: Sequence[Frame], jitters: Sequence[int]) -> list[Frame]:
        """The sample whose counter is that of `tick`, or nearly; all of them where no counter is known."""
        if self._lead is None:
            return [frame for frame in frames if frame.can_id == ACCELEROMETER]
        now = self._lead + tick
        by_counter = {counter_of(frame): frame for frame in frames if frame.can_id == ACCELEROMETER}
        near = [by_counter.get((now + jitter) % MODULUS) for jitter in jitters]
        return [frame for frame in near if frame is not None][:1]

    def _keep_newest(self, samples: Sequence[Frame], frames: Sequence[Frame]) -> None:
        """Keep the last of `samples`, and the encoder's frame that was sent with it."""
        if samples:
            self.is_fresh = True
            place = max(place for place, frame in enumerate(frames) if frame == samples[-1])
            self.frames += [samples[-1], *[frame for frame in frames[place:] if frame.can_id == ENCODER][:1]]

    @property
    def is_over(self) -> bool:
        """Whether to go on: with a sample of now, or because there is none to be had."""
        return self.is_fresh or self._left_ticks <= 0
