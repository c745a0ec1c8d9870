"""How many of a run's gaps a person is shown."""

from hil.judge.gaps import MOST_SHOWN, Gap, longest_gaps


def test_the_longest_gaps_are_shown_in_order_of_time_below_their_number() -> None:
    gaps = [Gap(at_s, at_s + 0.001 * (3 + at_s), "plant") for at_s in map(float, range(10))] + [
        Gap(10.0, None, "firmware")
    ]
    head, *shown = longest_gaps(gaps)
    assert head == "the host held up processes in 11 intervals, the longest of which follow"
    assert len(shown) == MOST_SHOWN
    assert shown[0] == "the host held up the plant from 6.000 s to 6.009 s"
    assert shown[-1] == "the host held up the firmware from 10.000 s and the run was ended"


def test_few_gaps_are_all_shown() -> None:
    assert longest_gaps([Gap(1.95, 1.981, "plant")]) == ["the host held up the plant from 1.950 s to 1.981 s"]
