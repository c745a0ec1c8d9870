"""Which frames a tick of the firmware takes where its process wakes up late."""

import pytest

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, DriveErrors, EncoderEstimates
from hil.nodes.alignment import Alignment


def acceleration(tick: int) -> Frame:
    return codec.ACCELEROMETER.encode(Accelerometer(0.0, 0.0, 0.0), tick)


def sample(tick: int) -> list[Frame]:
    return [acceleration(tick), codec.ENCODER_ESTIMATES.encode(EncoderEstimates(tick / 1024, 2.0))]


ERRORS = codec.DRIVE_ERRORS.encode(DriveErrors(0, 0))


def hand_out(arrivals: list[list[Frame]]) -> list[list[Frame]]:
    alignment = Alignment()
    return [alignment.take(frames) for frames in arrivals]


def test_a_sample_a_tick_passes_as_it_is() -> None:
    arrivals = [[*sample(0), ERRORS], sample(1), [ERRORS, *sample(2)]]
    assert hand_out(arrivals) == arrivals


def test_a_late_wake_up_leaves_the_next_ticks_sample_to_its_tick() -> None:
    assert hand_out([sample(0), [*sample(1), *sample(2), ERRORS], [], sample(3)]) == [
        sample(0),
        [*sample(1), ERRORS],
        sample(2),
        sample(3),
    ]


def test_a_sample_whose_encoder_frame_comes_later_stays_whole() -> None:
    accelerometer, encoder = sample(2)
    assert hand_out([[*sample(1), accelerometer], [encoder]]) == [sample(1), sample(2)]


def test_late_wake_ups_in_a_row_go_on_one_by_one() -> None:
    late = [[*sample(0), *sample(1)], sample(2), sample(3), []]
    assert hand_out(late) == [sample(tick) for tick in range(4)]


def test_late_samples_are_taken_as_soon_as_they_come() -> None:
    arrivals = [sample(0), [], [*sample(1), *sample(2)], sample(3)]
    assert hand_out(arrivals) == arrivals


def test_copies_of_a_sample_do_not_wait() -> None:
    arrivals = [sample(0) * 3, sample(1) * 3]
    assert hand_out(arrivals) == arrivals


@pytest.mark.parametrize("burst", [5, 40])
def test_no_frame_waits_for_longer_than_a_tick_and_none_is_lost(burst: int) -> None:
    alignment = Alignment()
    before: list[Frame] = []
    for tick in range(50):
        arrived = [frame for k in range(burst) for frame in sample(burst * tick + k)]
        taken = alignment.take(arrived)
        assert taken[: len(before)] == before
        rest = taken[len(before) :]
        before = [frame for frame in arrived if frame not in rest]
    assert alignment.take_all([ERRORS]) == [*before, ERRORS]
    assert alignment.take_all([]) == []


def test_a_lag_that_does_not_end_is_caught_up() -> None:
    """The firmware's loop has lost a tick: from then on there is one sample too many."""
    found = hand_out([[*sample(0), *sample(1)], *(sample(tick) for tick in range(2, 8))])
    assert found == [
        sample(0),
        sample(1),
        sample(2),
        [*sample(3), *sample(4)],
        sample(5),
        sample(6),
        sample(7),
    ]
