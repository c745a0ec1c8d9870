"""Two suites' figures side by side: what is better, what is worse, and what is chance."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from resting import resting

from hil.judge.tolerance import Tolerance, tolerances_from
from hil.suite.changes import FALSE_ALARMS, changes, middle
from tools.cli import run
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED

SEEDS = range(1, 13)
FIGURES = 40


class Compared(str):
    """A text that counts how often it is compared."""

    times = 0

    def __eq__(self, other: object) -> bool:
        Compared.times += 1
        return str.__eq__(self, other)

    __hash__ = str.__hash__


def test_the_middle_of_texts_is_the_most_frequent_and_needs_no_comparison_of_all_pairs() -> None:
    different = [Compared(f"regime {number}") for number in range(1000)]
    assert middle([*different, "impact", "impact"]) == "impact"
    assert Compared.times < 10 * len(different)
    assert middle(["impact", "lost", "lost", None]) == "lost"


def suite(values: np.ndarray[Any, Any]) -> dict[str, Any]:
    """A suite of one scenario with a figure a row, at most 1, and a seed a column."""
    checks = [
        {
            "name": f"figure_{number}",
            "unit": "m",
            "limit": "≤ 1",
            "passed": bool((line <= 1.0).all()),
            "values": line.tolist(),
            "margins": (1.0 - line).tolist(),
        }
        for number, line in enumerate(values)
    ]
    return {"seeds": list(SEEDS), "scenarios": [{"name": "s", "checks": checks}]}


def verdicts(before: dict[str, Any], after: dict[str, Any]) -> dict[str, str]:
    return {one["figure"]: one["verdict"] for one in changes(before, after)}


def noise(rng: np.random.Generator) -> np.ndarray[Any, Any]:
    return rng.normal(0.5, 0.01, (FIGURES, len(SEEDS)))


def test_equal_suites_have_no_change() -> None:
    one = suite(noise(np.random.default_rng(1)))
    assert set(verdicts(one, one).values()) == {"same"}


def test_chance_is_called_a_change_at_most_once_in_a_hundred_comparisons() -> None:
    rng = np.random.default_rng(2)
    alarms = [set(verdicts(suite(noise(rng)), suite(noise(rng))).values()) != {"same"} for _ in range(50)]
    assert np.mean(alarms) <= FALSE_ALARMS


def test_a_figure_that_comes_nearer_to_its_limit_is_worse_and_comes_first() -> None:
    rng = np.random.default_rng(3)
    before, after = noise(rng), noise(rng)
    after[7] += 0.05
    after[9] -= 0.04
    found = changes(suite(before), suite(after))
    assert [(one["figure"], one["verdict"]) for one in found[:2]] == [
        ("figure_7", "worse"),
        ("figure_9", "better"),
    ]
    assert {one["verdict"] for one in found[2:]} == {"same"}


def test_a_figure_that_is_missing_now_is_worse() -> None:
    before, after = suite(noise(np.random.default_rng(4))), suite(noise(np.random.default_rng(4)))
    after["scenarios"][0]["checks"][5] |= {"values": [None] * len(SEEDS), "margins": [None] * len(SEEDS)}
    assert verdicts(before, after)["figure_5"] == "worse"


def one_seed(*values: float, rounding: float = 0.0) -> dict[str, Any]:
    found = suite(np.array(values)[:, None] * (1.0 + rounding))
    return found | {"seeds": [1]}


def test_a_check_that_is_now_missed_comes_before_all_other_changes() -> None:
    before, after = one_seed(0.1, 0.2, 0.999, 1.001), one_seed(0.9, 0.2, 1.001, 0.999)
    found = changes(before, after)
    assert [one["figure"] for one in found] == ["figure_2", "figure_3", "figure_0", "figure_1"]
    assert [one["flipped"] for one in found] == [True, True, False, False]
    assert (found[0]["passed_before"], found[0]["passed_after"]) == (True, False)


def test_a_check_that_is_no_longer_judged_has_flipped() -> None:
    before, after = one_seed(0.1, 0.2), one_seed(0.5, 0.2)
    after["scenarios"][0]["checks"][1]["passed"] = None
    assert changes(before, after)[0]["figure"] == "figure_1"


def test_a_figure_within_its_tolerance_is_equal() -> None:
    before = one_seed(0.1, 0.2, 0.3)
    assert all(one["equal"] for one in changes(before, one_seed(0.1, 0.2, 0.3, rounding=1e-11)))
    assert not any(one["equal"] for one in changes(before, one_seed(0.1, 0.2, 0.3, rounding=1e-3)))
    wider = {"figure_1": Tolerance(0.0, 0.01), "figure_2": Tolerance(1e-2, 0.0)}
    found = changes(before, one_seed(0.1, 0.2, 0.3, rounding=1e-3), wider)
    assert {one["figure"]: one["equal"] for one in found} == {
        "figure_0": False,
        "figure_1": True,
        "figure_2": True,
    }


def test_a_tolerance_does_not_hide_a_check_that_is_now_missed() -> None:
    found = changes(one_seed(0.999), one_seed(1.001), {"*": Tolerance(1.0, 1.0)})
    assert (found[0]["equal"], found[0]["flipped"]) == (False, True)


@pytest.mark.parametrize(
    "setting", ["figure_1", "figure_1=", "figure_1=-1", "figure_1=nan", "other=1", "*=1,2,3"]
)
def test_a_tolerance_that_is_none_is_refused(setting: str) -> None:
    with pytest.raises(ValueError, match=re.escape(setting)):
        tolerances_from([setting], ["figure_1"])


def test_few_seeds_are_not_judged() -> None:
    before, after = suite(np.full((1, 12), 0.5)), suite(np.full((1, 12), 0.6))
    for one in (before, after):
        one["seeds"] = one["seeds"][:3]
    assert verdicts(before, after) == {"figure_0": "differs"}


def test_seeds_that_only_one_suite_has_are_left_out() -> None:
    values = noise(np.random.default_rng(6))
    before, after = suite(values), suite(values[:, ::-1])
    after["seeds"] = after["seeds"][::-1]
    assert set(verdicts(before, after).values()) == {"same"}
    after["seeds"] = [seed + 100 for seed in after["seeds"]]
    assert changes(before, after) == []


@pytest.mark.usefixtures("in_process")
def test_a_suite_is_compared_with_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    resting(tmp_path)
    assert run(["suite", "rests.toml", "--baseline", "previous"]) == EXIT_BAD_INPUT
    assert "there is no suite" in capsys.readouterr().err
    assert run(["suite", "rests.toml"]) == EXIT_PASSED
    changed = ["--set", "script.duration_s=0.4", "--baseline", "previous", "--json"]
    capsys.readouterr()
    assert run(["suite", "rests.toml", *changed]) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert result["changed"] == ["script.duration_s=0.4"]
    assert [(one["figure"], one["equal"]) for one in result["changes"]][-1] == ("impact_count", True)
    assert "Beside the baseline" in Path(result["report"]).read_text()
    assert result["only_in_baseline"] == []


@pytest.mark.usefixtures("in_process")
def test_a_check_or_scenario_that_only_the_baseline_has_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A limit that was loosened since passes without a word otherwise."""
    monkeypatch.chdir(tmp_path)
    loosened = resting(tmp_path)
    resting(tmp_path, "gone")
    assert run(["suite", "rests.toml", "gone.toml", "--out", "before"]) == EXIT_PASSED
    loosened.write_text(loosened.read_text().replace("low = 0", "low = -1"))
    capsys.readouterr()
    assert run(["suite", "rests.toml", "--baseline", "before"]) == EXIT_PASSED
    assert "only in the baseline: rests: impact_count 0 … 9, gone" in capsys.readouterr().out
