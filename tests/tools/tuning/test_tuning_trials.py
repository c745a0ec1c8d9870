"""What trials of identification come to: shares, errors, and bounds that hold the truth or do not."""

import json

import pytest
from identification_trials import GOAL, Trial, module_of, run_trial, run_trials, summary

from tools.tuning.identification.identify import NORMAL_95


def trial(number: int, named: str = "", b_off: float = 0.0, held: bool = True) -> Trial:
    law, _ = module_of(number)
    return Trial(number, law, named or law, "", {"damping": b_off}, {"damping": held}, {"damping": 1.0})


def test_all_right_is_passed() -> None:
    said = summary([trial(number) for number in range(100)])
    assert said["passed"]
    assert said["named_right"]["hits"] == 100
    assert said["within"]["damping"]["in_bounds"]["value"] == 1.0


def test_errors_beyond_the_limit_miss_the_goal() -> None:
    """One in a hundred may be wrong, two may not."""
    assert GOAL == 0.99
    one_off = [trial(number, b_off=0.051 if number == 7 else 0.001) for number in range(100)]
    two_off = [trial(number, b_off=-0.051 if number in (7, 8) else 0.001) for number in range(100)]
    assert summary(one_off)["passed"]
    assert not summary(two_off)["passed"]
    assert summary(two_off)["within"]["damping"]["worst"] == 0.051


def test_a_wrong_law_is_reported_and_its_parameters_are_not_counted() -> None:
    trials = [trial(0, b_off=0.001), trial(1, named="stribeck", b_off=9.0), trial(2)]
    said = summary(trials)
    assert [one["trial"] for one in said["wrong"]] == [1]
    assert said["within"]["damping"]["n"] == 2
    assert not said["passed"]


def test_bounds_that_miss_the_truth_are_counted() -> None:
    said = summary([trial(number, held=number % 4 != 0) for number in range(40)])
    assert said["within"]["damping"]["in_bounds"]["hits"] == 30


@pytest.mark.parametrize(
    ("number", "why"),
    [
        (6, "the fit of δ = 1 ends beside its minimum unless it also starts from that of δ = 2"),
        (102, "the linear fit's turns are some ticks off, and a wrong sign of v outweighs all other samples"),
    ],
)
def test_a_rise_towards_rest_is_fitted_to_the_noise(number: int, why: str) -> None:
    found = run_trial(40_000, number, 60.0)
    assert found.named == "stribeck", why
    assert all(score < 4.0 for score in found.scores.values()), (why, found.scores)
    assert abs(found.errors["dry"] or 1.0) < 0.002, why


def test_trials_are_recorded_identified_and_judged(pytestconfig: pytest.Config) -> None:
    """With --identification-trials 300 the goals must be met; the summary is printed."""
    count = pytestconfig.getoption("identification_trials")
    found = run_trials(count) if count else run_trials(1, seed=41, seconds=20.0)
    assert found[0].named == "viscous"
    assert abs(found[0].errors["spring"] or 1.0) < 0.005
    assert set(found[0].held) == {"spring", "amplitude", "damping", "stop", "restitution", "contact"}
    for one in found:
        assert one.held == {name: score <= NORMAL_95 for name, score in one.scores.items()}
    if count:
        said = summary(found)
        print(json.dumps(said, indent=1))
        assert said["passed"]
