"""The inbox: the received frames that wait for a tick, and the period to which each belongs.

    receive(inbox, frame)                                      for each frame, when it arrives
    advance(inbox, newest, ticks, elapsed_ticks, most_ticks)   when time passes; the number of ticks to run
    end_period(inbox)                                          after each of these ticks

`inbox` is memory of `SIZE` integers that is changed in place: a list if interpreted, a pointer if compiled.
It keeps the newest `CAPACITY` frames that the firmware receives. An E-stop is a mark beside them that no
number of other frames displaces; it acts in the next tick that is run.

After missed periods one tick is run for each of them, on that period's frames. Frames carry no time of
reception, so the accelerometer's rolling counter dates them: it advances by one in each period of the
sensors. A sample that was sent before a pause is therefore not taken for a new one.
"""

from firmware_py.interface.arrivals import Arrival
from firmware_py.interface.frame import ACCEPTED, WordFrame
from firmware_py.interface.framing import counter_of
from firmware_py.interface.generated import kinds, unpacking
from firmware_py.interface.generated.received import RECEIVED_IDS

CAPACITY = 256
"""A power of two. A period brings at most 2.4 frames on average, so that the inbox holds 0.1 s, twice the
time after which the drive's own watchdog has ended the torque."""

ESTOP, PERIODS, TAKEN, RECEIVED, FRAMES_AT = range(5)
"""Members: whether an E-stop has arrived; the periods still to be run, 0 if none was missed; the numbers of
frames taken and received since power-up; the frames, a header and a word each."""
SIZE = FRAMES_AT + 2 * CAPACITY
LENGTH_BIT, BEGINS_BIT, BEHIND_BIT = 11, 15, 16
"""Lowest bits of a header's parts above the identifier: the length, whether the frame begins a sample, and
the time from its period to the present one in ticks."""
ID_MASK, LENGTH_MASK = (1 << LENGTH_BIT) - 1, (1 << BEGINS_BIT - LENGTH_BIT) - 1
BEGINS = 1 << BEGINS_BIT

COUNTER_MODULUS = 1 << kinds.ACCELEROMETER.counter_bits
MOST_EARLY_TICKS = 3
"""Largest number of ticks by which the firmware's clock may lag behind the sensors'."""
LONGEST_DATED_TICKS = COUNTER_MODULUS - 1 - MOST_EARLY_TICKS
"""Longest time between two samples that their counters give."""


def index_of(number: int) -> int:
    """Index in the inbox of the header of the frame with this number."""
    return FRAMES_AT + 2 * (number & CAPACITY - 1)


def frame_at(inbox: list[int], index: int) -> WordFrame:
    """The frame whose header is at this index."""
    header = inbox[index]
    return WordFrame(header & ID_MASK, header >> LENGTH_BIT & LENGTH_MASK, inbox[index + 1])


def behind_ticks(inbox: list[int]) -> int:
    """The time from the period that the next tick runs to the present one."""
    return max(inbox[PERIODS] - 1, 0)


def receive(inbox: list[int], frame: WordFrame) -> None:
    """Keep a frame that the firmware receives; a full inbox loses its oldest frame, and never an E-stop."""
    can_id, length, word = frame
    if can_id == kinds.DRIVE_ESTOP.can_id and length == kinds.DRIVE_ESTOP.length:
        inbox[ESTOP] = 1
    elif can_id in RECEIVED_IDS:
        index = index_of(inbox[RECEIVED])
        inbox[index], inbox[index + 1] = can_id | length << LENGTH_BIT, word
        inbox[RECEIVED] += 1
        inbox[TAKEN] = max(inbox[TAKEN], inbox[RECEIVED] - CAPACITY)


def advance(inbox: list[int], newest: Arrival, ticks: int, elapsed_ticks: int, most_ticks: int) -> int:
    """Let `elapsed_ticks` periods pass since the last call; return the number of ticks to run now.

    `newest`: the newest accelerometer frame that a tick has accepted. `ticks`: those run since power-up. If
    more than `most_ticks` were missed, nothing is caught up: all frames belong to the present period, and the
    silence before it lets the watchdogs stop the motor.
    """
    periods = min(inbox[PERIODS] + max(elapsed_ticks, 0), most_ticks + 1)
    if periods > 1:
        age_ticks = ticks + periods - newest.tick
        is_dated = age_ticks <= LONGEST_DATED_TICKS
        mark_samples(inbox)
        due = (newest.counter + age_ticks) % COUNTER_MODULUS if is_dated else -1
        date_frames(inbox, periods if periods <= most_ticks else 1, due)
    inbox[PERIODS] = min(periods, most_ticks)
    return inbox[PERIODS]


def mark_samples(inbox: list[int]) -> None:
    """Mark the frames that begin a sample: an accelerometer frame and its encoder frame in any order.

    The other frames join the sample that they follow, or else the first one.
    """
    has_accelerometer = has_encoder = False
    for number in range(inbox[TAKEN], inbox[RECEIVED]):
        index = index_of(number)
        can_id = inbox[index] & ID_MASK
        is_accelerometer = can_id == kinds.ACCELEROMETER.can_id
        is_encoder = can_id == kinds.ENCODER_ESTIMATES.can_id
        begins = (is_accelerometer and has_accelerometer) or (is_encoder and has_encoder)
        has_accelerometer = is_accelerometer or (has_accelerometer and not begins)
        has_encoder = is_encoder or (has_encoder and not begins)
        inbox[index] = inbox[index] & BEGINS - 1 | (BEGINS if begins or number == inbox[TAKEN] else 0)


def sample_counter(frame: WordFrame) -> int:
    """The rolling counter of an accelerometer frame; −1 for another or a damaged frame."""
    can_id, length, word = frame
    if can_id != kinds.ACCELEROMETER.can_id:
        return -1
    _, reason = unpacking.unpack_accelerometer(length, word)
    return counter_of(kinds.ACCELEROMETER, word) if reason == ACCEPTED else -1


def date_frames(inbox: list[int], periods: int, due: int) -> None:
    """Find the period of each waiting frame, the last of `periods` being the present one.

    `due`: the counter of the sample that is due in the present period; −1: that of the newest sample. Each
    sample belongs to the period that its counter gives; one without an accelerometer frame lies one period
    before its successor. Samples from before the first period belong to the first one, so that the gate
    judges them too, and samples of later periods to the present one.
    """
    behind, counter, end = -1, -1, inbox[RECEIVED]
    for back in range(inbox[RECEIVED] - inbox[TAKEN]):
        number = inbox[RECEIVED] - 1 - back
        index = index_of(number)
        counter = max(counter, sample_counter(frame_at(inbox, index)))
        if inbox[index] & BEGINS:
            if counter < 0:
                behind += 1
            else:
                due = counter if due < 0 else due
                late_ticks = (due - counter) % COUNTER_MODULUS
                behind = late_ticks if late_ticks <= LONGEST_DATED_TICKS else 0
            for one in range(number, end):
                inbox[index_of(one)] |= min(max(behind, 0), periods - 1) << BEHIND_BIT
            counter, end = -1, number


def end_period(inbox: list[int]) -> None:
    """Remove what the tick has taken: the E-stop, and the frames of its period."""
    behind = behind_ticks(inbox)
    if behind > 0:
        for number in range(inbox[TAKEN], inbox[RECEIVED]):
            index = index_of(number)
            if inbox[index] >> BEHIND_BIT == behind:
                inbox[index] = 0
    else:
        inbox[TAKEN] = inbox[RECEIVED]
    inbox[PERIODS], inbox[ESTOP] = behind, 0
