"""Campaigns without a closed loop: samples, conditions, statistics, goals."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from hil.processes.signals import Interrupted
from hil.runs import bench
from plant_sim.scene import Scene, load_scene
from tools.campaign import processes
from tools.campaign.campaign import Cell, Goal, Outcome, Plan
from tools.campaign.campaigns import CAMPAIGNS, trial_of
from tools.campaign.paired import compare
from tools.campaign.reference import goes_on
from tools.campaign.results import result_of
from tools.campaign.sampling import MISMATCH, sample
from tools.campaign.statistics import distribution, wilson
from tools.campaign.walk import course_of, find_end_s, find_missing, sample_walk
from tools.cli import run
from tools.commands.campaign import campaign as campaign_command
from tools.commands.campaign import kept_of, printed
from tools.output import (
    EXIT_BAD_INPUT,
    EXIT_CHECK_FAILED,
    EXIT_INTERRUPTED,
    EXIT_NOTHING_RAN,
    BadInputError,
    exit_of,
    plain,
    show_tables,
)

ESTIMATE = CAMPAIGNS["estimate"]


SEED = 20_000


def plan_of(name: str, *settings: str) -> Plan:
    return CAMPAIGNS[name].plan(settings, SEED)


# --- samples -----------------------------------------------------------------------------------------


def sampled_scene(cell: Cell, trial: int, numbers: Mapping[str, float] = MISMATCH) -> Scene:
    return load_scene(sample(cell.scene, numbers, 20_000, trial).tables)


def test_a_trial_samples_the_same_module_every_time_and_another_trial_another() -> None:
    cell = plan_of("start-up").cells[0]
    first, again, other = (sample(cell.scene, MISMATCH, 20_000, trial) for trial in (3, 3, 4))
    assert first == again
    assert first.tables["striker"]["spring_n_m"] != other.tables["striker"]["spring_n_m"]
    assert first.run_seed != other.run_seed


def test_samples_fill_their_ranges_and_stay_inside() -> None:
    cell = next(cell for cell in plan_of("start-up").cells if cell.values[0] == "stribeck")
    scenes = [sampled_scene(cell, trial) for trial in range(300)]
    parts = [scene.parts() for scene in scenes]
    for values, middle, width in (
        ([part.striker.spring_n_per_m for part in parts], 70.0, 1.4),
        ([scene.striker.rest_length_m for scene in scenes], 0.12, 1e-3),
        ([part.stop.position_m for part in parts], 0.18, 3e-4),
        ([part.friction.mu for part in parts], 0.15, 0.015),
        ([scene.stop.restitution for scene in scenes], 0.5, 0.05),
        ([scene.sensors.striker_low.bias_m_s2 for scene in scenes], 0.0, 0.05 * 9.80665),
        ([scene.initial.v_m_s for scene in scenes], 0.0, 0.8),
        ([scene.drive.phase_rad for scene in scenes], np.pi, np.pi),
    ):
        offsets = np.abs(np.array(values) - middle)
        assert offsets.max() <= width * (1.0 + 1e-12)
        assert offsets.max() > 0.9 * width
    starts = np.array([scene.initial_x_m - scene.striker.rest_length_m for scene in scenes])
    room = np.array([part.stop.position_m - part.striker.rest_length_m for part in parts])
    assert starts.min() < -0.09
    assert (starts <= np.minimum(0.06, room)).all()


def test_parameters_keep_the_nominal_numbers() -> None:
    for cell in plan_of("start-up").cells:
        truth = sampled_scene(cell, 0)
        assert "striker" not in cell.firmware
        assert truth.striker.spring_n_m != 70.0
        assert cell.firmware["drive"]["amplitude_m"] == truth.drive.amplitude_m  # known but for `hold`


def test_a_campaign_may_set_its_own_mismatch() -> None:
    _, cells, numbers, *_ = plan_of("hold", "campaign.mismatch_spring=0.0", "campaign.ratios=1.2")
    assert [cell.ratio for cell in cells] == [1.2]
    assert (numbers["mismatch_spring"], numbers["mismatch_amplitude"]) == (0.0, 0.03)
    assert sampled_scene(cells[0], 1, numbers).striker.spring_n_m == 70.0


# --- conditions --------------------------------------------------------------------------------------


def test_settings_reach_scene_parameters_and_conditions() -> None:
    _, cells, numbers, *_ = plan_of(
        "start-up",
        'campaign.laws=["viscous", "coulomb"]',
        "campaign.ratios=[1.1, 1.2]",
        "campaign.duration_s=9.0",
        "scene.stop.contact_s=0.02",
        "firmware.start.rise_s=3.0",
    )
    assert [cell.name for cell in cells] == [
        "viscous r=1.1",
        "viscous r=1.2",
        "coulomb r=1.1",
        "coulomb r=1.2",
    ]
    assert numbers["duration_s"] == 9.0
    assert all(cell.scene["stop"]["contact_s"] == 0.02 for cell in cells)
    assert cells[2].firmware == {
        "friction": {"b_n_s_m": 0.0, "mu": 0.15},
        "drive": {"amplitude_m": 0.03},
        "start": {"rise_s": 3.0},
    }


def test_settings_that_make_no_sense_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, reason in (
        (["--set", "campaign.ratioz=1.1"], "campaign.ratios"),
        (["--set", 'campaign.laws="sticky"'], "viscous"),
        (["--set", 'campaign.ratios="fast"'], "campaign.ratios: 'fast' is no number of at least 0"),
        (["--set", "campaign.impulses=[0.5, -0.5]"], "campaign.impulses: -0.5 is no number"),
        (["--set", "scene.stop.law='rigid'"], "contact_s"),
        (["--set", "scene.drive.model='dq-motor'"], "set scene.drive.model = 'motor'"),
        (["--set", "scene.stop.position_m=0.0"], "scene.stop.position_m = 0, as sampled "),
        (["--keep", "1"], "0 … 0"),
        (["--keep", "successes"], "wanted failures, all, or a trial's number"),
    ):
        assert run(["campaign", "hold", "--trials", "1", *arguments, "--json"]) == EXIT_BAD_INPUT
        assert reason in json.loads(capsys.readouterr().out)["error"]


def test_impacts_last_only_if_there_are_some() -> None:
    """At one turn in ten seconds the judged seconds are shorter than the longest gap that is permitted."""
    for omega_rad_s in (0.6, 6.0):
        period_s = 2.0 * np.pi / omega_rad_s
        assert not goes_on(np.zeros(0), 60.0, omega_rad_s)
        assert not goes_on(np.array([40.0]), 60.0, omega_rad_s)
        assert goes_on(np.arange(0.0, 60.0, period_s), 60.0, omega_rad_s, judged_s=2.0 * period_s)


def test_kept_are_failures_one_trial_or_all() -> None:
    fine, lost = Outcome(0, 0), Outcome(1, 0, why="ends in fault")
    unfit = Outcome(2, 0, eligible=False, why="no impact attractor at this speed")
    kept = {keep: kept_of([fine, lost, unfit], keep) for keep in (None, "failures", "2", "02", "all")}
    assert kept == {None: [], "failures": [1], "2": [2], "02": [2], "all": [0, 1, 2]}


# --- statistics --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("successes", "trials"), [(0, 10), (9, 10), (500, 3000), (3000, 3000)])
def test_wilson_bounds(successes: int, trials: int) -> None:
    """They are the shares that lie as far from the one observed as the normal quantile says: Wilson 1927."""
    share, low, high = wilson(successes, trials)
    assert share == successes / trials
    assert 0.0 <= low <= share <= high <= 1.0
    for bound in (low, high):
        spread = bound * (1.0 - bound) / trials
        assert (bound - share) ** 2 == pytest.approx(norm.ppf(0.975) ** 2 * spread, rel=1e-9)


def test_the_bounds_of_quantiles_cover_them() -> None:
    """Of 1,000 samples of 150 exponential values, p50 = ln 2 and p95 = ln 20; 95 % less four deviations."""
    covered = np.zeros(2)
    for seed in range(1000):
        spread = distribution(np.random.default_rng(seed).exponential(size=150))
        assert spread is not None
        covered[0] += spread.p50_low <= np.log(2.0) <= spread.p50_high
        covered[1] += spread.p95_low <= np.log(20.0) <= spread.p95_high
    assert np.all(covered >= 922)
    assert np.all(covered < 1000)


def test_of_nothing_there_is_no_distribution() -> None:
    assert distribution(np.array([np.nan])) is None


# --- results -----------------------------------------------------------------------------------------


def outcome(trial: int, x_rmse: float, **changes: Any) -> Outcome:
    return Outcome(
        trial,
        trial % 2,
        simulated_s=30.0,
        compute_s=0.03,
        metrics={"x_rmse": x_rmse, "v_rmse": 0.001},
        **changes,
    )


def judged(x_rmse: float, seed: int = 20_000) -> dict[str, Any]:
    cells = plan_of("estimate").cells
    outcomes = [outcome(trial, x_rmse + 0.001 * trial) for trial in range(20)]
    outcomes[5].why = "the estimate is no number"
    outcomes[6].eligible, outcomes[6].why = False, "no time in RUN"
    return plain(result_of(ESTIMATE, cells, outcomes, seed, wall_s=1.0))


def test_a_result_has_what_the_command_promises() -> None:
    result = judged(0.5)
    assert (result["trials"], result["eligible"], result["success"]) == (20, 19, 18)
    assert result["failures"] == [
        {"trial": 5, "seed": 20_000, "cell": "coulomb-0.2 r=0.95", "why": "the estimate is no number"}
    ]
    assert result["ineligible"] == {"no time in RUN": 1}
    assert {"p50", "p95", "worst", "unit"} <= set(result["metrics"]["x_rmse"])
    assert result["metrics"]["x_rmse"]["worst"] == pytest.approx(0.519)
    assert result["realtime_factor_a_core"] == pytest.approx(1000.0)
    json.dumps(result, allow_nan=False)


def test_goals_are_met_or_missed() -> None:
    good, bad = judged(0.5), judged(0.95)
    assert good["passed"]
    assert not bad["passed"]
    missed = [goal["figure"] for goal in bad["goals"] if goal["passed"] is False]
    assert missed == ["viscous x_rmse p50"]  # the dry goal lies higher


def test_nothing_measured_passes_nothing() -> None:
    cells = plan_of("estimate").cells
    outcomes = [Outcome(trial, trial % 2, eligible=False, why="no time in RUN") for trial in range(4)]
    result = result_of(ESTIMATE, cells, outcomes, 20_000, wall_s=1.0)
    assert result["passed"] is None
    assert exit_of(result) == EXIT_NOTHING_RAN
    assert [goal["passed"] for goal in result["goals"]] == [None] * 3


def test_a_goal_that_was_not_measured_is_not_passed() -> None:
    cells = plan_of("estimate").cells
    result = result_of(ESTIMATE, cells, [outcome(0, 0.5)], 20_000, wall_s=1.0)  # no trial in the second cell
    assert [goal["passed"] for goal in result["goals"]] == [True, True, None]
    assert exit_of(result) == EXIT_NOTHING_RAN
    missed = result_of(ESTIMATE, cells, [outcome(0, 2.0)], 20_000, wall_s=1.0)
    assert exit_of(missed) == EXIT_CHECK_FAILED


@pytest.mark.parametrize(("trials", "applies"), [(299, False), (1800, True)])
def test_the_number_of_eligible_trials_is_a_goal_of_a_full_campaign_only(trials: int, applies: bool) -> None:
    recover = CAMPAIGNS["recover"]
    outcomes = [
        Outcome(trial, trial % 2, metrics={"recovery": 5.0}, eligible=trial < 200) for trial in range(trials)
    ]
    result = result_of(recover, plan_of("recover").cells, outcomes, 20_000, wall_s=1.0)
    assert ("eligible" in [goal["figure"] for goal in result["goals"]]) == applies
    assert result["passed"] is not applies  # of 1,800 trials 300 must be eligible


def test_trials_that_are_left_out_end_no_full_campaign_well() -> None:
    """A judge that leaves out whatever goes wrong would otherwise pass on the rest."""
    for campaign in CAMPAIGNS.values():
        cells = plan_of(campaign.name).cells
        outcomes = [Outcome(n, n % len(cells), eligible=False, why="lost") for n in range(campaign.trials)]
        result = result_of(campaign, cells, outcomes, 20_000, wall_s=1.0)
        assert ("eligible", False) in [(goal["figure"], goal["passed"]) for goal in result["goals"]]


def test_a_goal_applies_only_if_its_condition_is_in_the_campaign() -> None:
    cells = plan_of("estimate").cells[:1]
    assert cells[0].name.startswith("viscous")
    result = result_of(ESTIMATE, cells, [outcome(0, 0.5)], 20_000, wall_s=1.0)
    assert [goal["figure"] for goal in result["goals"]] == ["viscous x_rmse p50", "viscous v_rmse p50"]
    assert result["passed"]


def test_a_campaign_that_is_not_judged_says_which_goal_lacks_what() -> None:
    cells = plan_of("estimate").cells
    result = result_of(ESTIMATE, cells, [outcome(0, 0.5)], 20_000, wall_s=1.0)
    assert result["passed"] is None
    assert len(result["not_judged"]) == 1
    assert result["not_judged"][0].endswith(": no eligible trial of 1 has this figure")
    goals = tuple(replace(goal, full_size=True) for goal in ESTIMATE.goals)
    (reason,) = result_of(replace(ESTIMATE, goals=goals), cells, [outcome(0, 0.5)], 20_000, 1.0)["not_judged"]
    assert f"want {ESTIMATE.trials} trials" in reason
    assert result_of(ESTIMATE, cells[:1], [outcome(0, 0.5)], 20_000, wall_s=1.0)["not_judged"] == []


def test_trials_of_two_parameter_sets_are_compared_in_pairs() -> None:
    """Modules differ by much more than the parameters change; only the pairs show the change."""
    dice = np.random.default_rng(1)
    modules = dice.normal(10.0, 3.0, 200)
    before = [Outcome(n, 0, metrics={"x": x}, why="lost" if n < 30 else "") for n, x in enumerate(modules)]
    after = [
        Outcome(n, 0, metrics={"x": x + 0.1 + 0.02 * dice.normal()}, why="lost" if n % 20 == 19 else "")
        for n, x in enumerate(modules)
    ]
    before[150].eligible = False
    after[151].metrics["x"] = math.nan
    success, metric = compare(before, after[::-1], {"x": "mm"})
    assert (success["figure"], success["pairs"], success["baseline"]) == ("success", 199, 169 / 199)
    assert success["value"] == 189 / 199
    assert 0.0 < success["low"] < success["value"] - success["baseline"] < success["high"] < 0.2
    assert success["differs"]
    assert (metric["figure"], metric["unit"], metric["pairs"]) == ("x", "mm", 198)
    assert 0.09 < metric["low"] < 0.1 < metric["high"] < 0.11
    assert metric["differs"]
    alike = compare(before, before, {})
    assert [one["differs"] for one in alike] == [False, False]
    assert compare(before, [], {}) == []
    few = [Outcome(n, 0, metrics={"x": 2.0}) for n in range(6)]
    more = [Outcome(n, 0, metrics={"x": 3.0}) for n in range(6)]
    assert [one["differs"] for one in compare(few, more, {})] == [False, True]
    assert [one["differs"] for one in compare(few[:5], more, {})] == [False, False], "no 95 % bounds of 5"


def test_a_campaign_compares_a_parameter_file_with_the_defaults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def run_all(plan: Plan, count: int, *_: Any) -> list[Outcome]:
        tuned = "gain_p_n_m_s" in plan.cells[0].firmware.get("speed", {})
        return [
            Outcome(n, n % len(plan.cells), metrics={"steady_v": 0.9 + 0.01 * n + 0.05 * tuned})
            for n in range(count)
        ]

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(processes, "run_all", run_all)
    monkeypatch.setattr(bench, "prepare", lambda *_: None)
    Path("tuned.toml").write_text(
        'format = 1\n[parameters."speed.gain_p_n_m_s"]\nvalue = 0.02\nunit = "N m s"\n'
    )
    for sets, change in (
        (["--parameters", "tuned.toml", "--baseline", "default"], 0.05),
        (["--baseline", "tuned.toml"], -0.05),
        (["--set", "firmware.speed.gain_p_n_m_s=0.02", "--baseline", "default"], 0.05),
        (["--set", "firmware.speed.gain_i_n_m=1", "--baseline", "tuned.toml"], -0.05),
    ):
        run(["campaign", "start-up", "--trials", "20", "--json", *sets])
        result = json.loads(capsys.readouterr().out)
        assert result["changed"] == [one for one in sets[1::2] if one not in ("default", result["baseline"])]
        _, metric = result["differences"]
        assert (metric["figure"], metric["differs"]) == ("steady_v", True)
        assert [metric["low"], metric["high"]] == pytest.approx([change, change])
    run(["campaign", "start-up", "--trials", "20", *sets])
    shown = " ".join(capsys.readouterr().out.split())
    for text in (
        "changed firmware.speed.gain_i_n_m=1",
        "too few trials: if all 1 of stribeck r=1.1 succeed",
        "differences (value − baseline: 95 % interval from … to)",
    ):
        assert text in shown
    assert run(["campaign", "start-up", "--baseline", "default"]) == EXIT_BAD_INPUT
    assert "the same parameters as this campaign" in capsys.readouterr().err


def test_the_help_names_every_key_of_every_campaign() -> None:
    text = " ".join((campaign_command.__doc__ or "").split())
    for one in CAMPAIGNS.values():
        for key in (*one.sampler.axes, *one.numbers):
            assert re.search(rf"\b{key}\b", text), f"{one.name}: {key}"
        for known in one.sampler.axes.values():
            assert all(value in text for value in known or ())


def test_the_regression_bound_decides_and_what_is_wanted_is_shown(
    capsys: pytest.CaptureFixture[str],
) -> None:
    campaign = replace(ESTIMATE, goals=(Goal("x_rmse", "worst", high=2.0, wanted=1.0, reason="it is wet"),))
    cells = plan_of("estimate").cells
    met = result_of(campaign, cells, [outcome(0, 1.9)], 20_000, wall_s=1.0)
    worse = result_of(campaign, cells, [outcome(0, 2.1)], 20_000, wall_s=1.0)
    assert (met["passed"], worse["passed"]) == (True, False)
    show_tables(printed(met))
    shown = " ".join(capsys.readouterr().out.split())
    assert "≤ 2 yes a regression bound; wanted 1, missed: it is wet" in shown
    assert "PASSED" in shown


def test_every_goal_that_is_known_to_be_missed_has_its_bound_and_its_reason() -> None:
    for campaign in CAMPAIGNS.values():
        for goal in campaign.goals:
            if goal.wanted is not None:
                assert goal.reason
                bound = goal.high if goal.high is not None else goal.low
                assert bound is not None
                assert bound != goal.wanted


def test_seeds_of_tuning_are_marked() -> None:
    assert judged(0.5, seed=9_999)["tuning_seed"]
    assert not judged(0.5, seed=10_000)["tuning_seed"]


def test_f1_counts_misses_and_false_alarms_alike() -> None:
    cells = plan_of("detect").cells
    outcomes = [
        Outcome(trial, trial, shares={"recall": (99, 99 + trial % 2), "precision": (100, 100)})
        for trial in range(len(cells))
    ]
    result = result_of(CAMPAIGNS["detect"], cells, outcomes, 20_000, wall_s=1.0)
    hits, misses = 99 * 11, 5
    assert result["shares"]["f1"]["value"] == pytest.approx(2 * hits / (2 * hits + misses))
    assert result["shares"]["recall"]["value"] == pytest.approx(hits / (hits + misses))


def test_a_sampled_housing_swings_within_its_range_and_leaves_all_else_as_it_was() -> None:
    cell = plan_of("detect").cells[0]
    for trial in range(50):
        level = sampled_scene(cell, trial)
        shaken = sampled_scene(cell, trial, {**MISMATCH, "swing_m_s2": 0.5})
        assert level.housing is None
        assert shaken.housing is not None
        assert shaken.striker == level.striker
        assert shaken.housing.harmonic is not None
        assert 0.0 < shaken.housing.harmonic.amplitude_m_s2 <= 0.5


# --- walks -------------------------------------------------------------------------------------------

WALK = CAMPAIGNS["walk"]


def test_the_cells_of_a_walk_are_modules_and_courses() -> None:
    _, cells, numbers, *_ = plan_of("walk")
    assert [cell.name for cell in cells] == [
        "walking steady",
        "walking change",
        "walking stop",
        "walking stumble",
        "table1 steady",
        "table1 stop",
        "table1 stumble",
    ]
    assert numbers["walk_s"] == 70.0
    assert cells[0].firmware["striker"]["spring_n_m"] == cells[0].scene["striker"]["spring_n_m"] == 720.0
    assert all(cell.firmware["gait"]["follow"] == 1.0 for cell in cells)
    # 300 trials of each condition.
    assert WALK.trials == 300 * len(cells)
    names = [cell.name for cell in cells]
    assert all(goal.where in ("", *names) for goal in WALK.goals)


def test_a_walk_s_cells_can_be_chosen_and_changed() -> None:
    settings = [
        "campaign.presets='table1'",
        "campaign.courses=['stop', 'change']",
        "firmware.spin_down.gain=2.0",
    ]
    cells = plan_of("walk", *settings).cells
    assert [cell.name for cell in cells] == ["table1 stop", "table1 change"]
    assert cells[0].firmware["spin_down"]["gain"] == 2.0
    for setting, message in (
        ("campaign.presets='gait'", "'gait' is none of walking, table1"),
        ("campaign.courses='hop'", "'hop' is none of steady"),
        ("campaign.speed=1", "campaign.speed"),
        ("campaign.courses=[]", "campaign.courses has no value"),
        ("campaign.mismatch_spring=-1", "campaign.mismatch_spring = -1: wanted a number of at least 0"),
        ("campaign.walk_s=nan", "campaign.walk_s = nan: wanted a number of at least 0"),
        ("campaign.mismatch_bias_g=1e308", r"mismatch_bias_g = 1e\+308: wanted at most 1e\+09"),
        ("campaign.mismatch_damping=1.2", r"mismatch_damping = 1\.2: wanted at most 1"),
    ):
        with pytest.raises(BadInputError, match=message):
            plan_of("walk", setting)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        (
            "campaign.mismatch_restitution=0.9",
            r"trial \d+ of estimate, as sampled: stop\.restitution = .*campaign\.",
        ),
        (
            "campaign.mismatch_stop_m=1.0",
            r"scene\.stop\.position_m = 0\.18, as sampled -.*behind all starts; .*mismatches",
        ),
    ],
)
def test_a_trial_whose_sampled_values_are_refused_is_named_with_what_to_change(setting, message) -> None:
    plan = plan_of("estimate", setting)
    with pytest.raises(BadInputError, match=message):
        _ = [trial_of(plan, number) for number in range(60)]


def test_swapped_bounds_of_a_kick_are_refused() -> None:
    swapped = "campaign.kick_low_m_s=2.0"
    with pytest.raises(BadInputError, match=r"kick_low_m_s = 2\.0 is above campaign\.kick_high_m_s = 1\.4"):
        plan_of("recover", swapped)
    assert plan_of("recover", swapped, "campaign.kick_high_m_s=2.0").numbers["kick_low_m_s"] == 2.0


def test_a_change_of_cadence_is_a_fifth_in_five_strides_and_back() -> None:
    cells = {cell.name: cell for cell in plan_of("walk").cells}
    for seed in range(40):
        course = course_of(cells["walking change"], WALK.numbers, np.random.default_rng(seed))
        (_, first), (begins_s, _), (ends_s, second), *_, (_, last) = course.paces
        assert max(first, second) / min(first, second) == pytest.approx(1.2)
        assert (ends_s - begins_s) * 0.5 * (first + second) == pytest.approx(5.0)
        assert last == first
        assert min(first, second) >= 0.5
        assert max(first, second) <= 1.0
        stop = course_of(cells["table1 stop"], WALK.numbers, np.random.default_rng(seed))
        assert stop.paces[-1][1] == 0.0
        assert 20.0 <= stop.paces[-1][0] <= 23.0
        assert 0.78 <= stop.paces[0][1] <= 0.82


def test_a_walk_is_sampled_with_its_mismatch_and_starts_at_rest() -> None:
    _, cells, numbers, *_ = plan_of("walk")
    cell = cells[3]
    sampled, course = sample_walk(cell, numbers, 20_000, 3)
    again, _ = sample_walk(cell, numbers, 20_000, 3)
    assert sampled == again
    scene = load_scene(sampled.tables)
    assert scene.initial.v_m_s == 0.0
    assert scene.striker.spring_n_m != 720.0
    assert [stumble.at_s for stumble in scene.gait.stumble] == course.stumbles
    assert find_end_s(scene.parts(3).housing) == pytest.approx(course.stumbles[0], abs=2.0)


# --- finished batches --------------------------------------------------------------------------------


class Batches:
    """Trials that ran in this process, and the number of trials after which Ctrl-C interrupts them once."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.chdir(folder)
        monkeypatch.setattr(processes, "run_batch", self.run)
        self.ran: list[int] = []
        self.interrupted_after: int | None = None

    def run(self, batch: processes.Batch) -> list[Outcome]:
        if self.interrupted_after is not None and len(self.ran) > self.interrupted_after:
            self.interrupted_after = None
            raise Interrupted("interrupted by Ctrl-C")
        self.ran.extend(batch.trials)
        return [Outcome(trial, 0, metrics={"x": 0.1 * trial}) for trial in batch.trials]

    def interrupt(self, plan: Plan, trials: int) -> None:
        """Run a campaign and interrupt it after 40 trials."""
        self.interrupted_after = 40
        with pytest.raises(Interrupted):
            processes.run_all(plan, trials, workers=1)


def test_an_interrupted_campaign_keeps_what_is_finished_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batched, plan = Batches(tmp_path, monkeypatch), plan_of("start-up")
    batched.interrupt(plan, 200)
    outcomes = processes.run_all(plan, 200, workers=1)
    assert [(one.trial, one.metrics["x"]) for one in outcomes] == [(n, 0.1 * n) for n in range(200)]
    assert sorted(batched.ran) == list(range(200))
    assert list((tmp_path / "runs").iterdir()) == []


def test_an_interrupted_campaign_writes_the_scenarios_of_the_trials_that_have_ended(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Batches(tmp_path, monkeypatch).interrupted_after = 2
    command = ["campaign", "start-up", "--trials", "8", "--workers", "1", "--keep", "all", "--json"]
    assert run(command) == EXIT_INTERRUPTED
    assert json.loads(capsys.readouterr().out) == {"error": "interrupted by Ctrl-C"}
    assert [path.stem for path in sorted(tmp_path.glob("runs/*/*.toml"))] == [
        f"start-up-20260-{trial}" for trial in range(3)
    ]


def test_a_campaign_of_another_size_leaves_what_is_finished(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batched, plan = Batches(tmp_path, monkeypatch), plan_of("start-up")
    batched.interrupt(plan, 200)
    finished = list(batched.ran)
    processes.run_all(plan, 8, workers=1)
    batched.ran.clear()
    processes.run_all(plan, 200, workers=1)
    assert sorted(finished + batched.ran) == list(range(200))


def test_the_same_campaign_twice_at_once_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    plan = plan_of("start-up")

    def run_batch(batch: processes.Batch) -> list[Outcome]:
        with pytest.raises(BadInputError, match="in use by the same campaign"):
            processes.run_all(plan, 2, workers=1)
        return [Outcome(trial, 0) for trial in batch.trials]

    monkeypatch.setattr(processes, "run_batch", run_batch)
    assert len(processes.run_all(plan, 2, workers=1)) == 2
    assert list((tmp_path / "runs").iterdir()) == []


def test_an_interrupted_campaign_without_a_finished_batch_leaves_no_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    batched = Batches(tmp_path, monkeypatch)
    batched.interrupted_after = -1
    with pytest.raises(Interrupted):
        processes.run_all(plan_of("start-up"), 2, workers=1)
    assert list((tmp_path / "runs").iterdir()) == []


def test_missing_impacts_are_reported_with_their_interval():
    turns_s = np.arange(0.0, 60.0, 0.2)
    impacts = np.array([(t_s,) for t_s in turns_s if not 40.1 < t_s < 41.1], np.dtype([("t_s", float)]))
    done: Any = SimpleNamespace(turns_s=turns_s, impacts=impacts)
    assert find_missing(done, (0.0, 60.0)) == "impacts missing from 40.0 to 41.2 s"
    assert find_missing(done, (0.0, 39.0)) == ""
