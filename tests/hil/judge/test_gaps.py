"""Which figures a gap makes doubtful, and how many of a run's gaps a person is shown."""

from types import SimpleNamespace

import pytest

from hil.judge.checks import Check
from hil.judge.evaluation import doubt
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


GAP = SimpleNamespace(
    gaps=[Gap(1.0, 1.1, "plant")], log=SimpleNamespace(frames_lost=0), hold_start_s=0.5, hold_end_s=9.0
)


@pytest.mark.parametrize(
    "name", ["held_s", "log.frames_lost", "loops.plant.ticks", "tick_us.p99", "overruns"]
)
def test_figures_of_the_bench_itself_are_judged_in_spite_of_a_gap(name: str) -> None:
    assert doubt(Check(name=name, high=9.0), GAP) is None


@pytest.mark.parametrize("name", ["held_speed_rad_s", "overruns_of_mine", "log.mine", "login"])
def test_a_users_own_figure_is_none_of_the_bench_whatever_its_name(name: str) -> None:
    own = Check(name=name, high=9.0, expression="max(plant.omega_rad_s)")
    assert doubt(own, GAP) == "the host held up the plant from 1.000 s to 1.100 s"
