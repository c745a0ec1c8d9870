"""Verdicts on a run, on a scenario in several seeds, and what the failures of a suite mean."""

from dataclasses import FrozenInstanceError, replace
from pathlib import Path

import pytest

from hil.judge.failures import failures_of
from hil.judge.judge import judge
from hil.judge.seeds import merge, merge_doubts, worst_of
from hil.judge.verdict import (
    NO_CHECKS,
    NO_SCENARIO,
    CheckResult,
    RunVerdict,
    Verdict,
    trace,
    without_records,
)
from hil.record.run_traces import RunTraces
from hil.scenario.checks import Check

PASSED, FAILED, NOT_JUDGED = Verdict.PASSED, Verdict.FAILED, Verdict.NOT_JUDGED
EMPTY = replace(judge(RunTraces(run={"scenario": "mine"}), Path("mine")), reasons=())
FORCE = Check(name="peak_force_n", high=100.0)


def result(verdict: Verdict, value: float | None = 90.0, **more: object) -> CheckResult:
    return CheckResult("peak_force_n", verdict, value, "N", "≤ 100", **more)


def run(*results: CheckResult, **more: object) -> RunVerdict:
    return replace(EMPTY, checks=results, **more)


@pytest.mark.parametrize(
    ("verdict", "not_judged"),
    [
        (run(), (NO_CHECKS,)),
        (run(doubts=("a stall",)), ("a stall", NO_CHECKS)),
        (run(result(PASSED)), ()),
        (run(result(PASSED), doubts=("a stall",)), ("a stall",)),
        (run(reasons=("killed",)), ()),
        (replace(run(), figures=replace(EMPTY.figures, clock="imported")), (NO_SCENARIO,)),
    ],
)
def test_a_run_without_checks_is_not_judged_unless_it_has_failed(verdict, not_judged):
    assert verdict.not_judged == not_judged


def test_the_reasons_of_a_run_are_its_own_then_its_doubts_then_its_checks():
    checks = (
        result(PASSED),
        result(FAILED, 110.0),
        replace(result(NOT_JUDGED, reason="a stall"), name="felt.peak_n"),
        replace(result(NOT_JUDGED, reason="a stall"), name="overruns"),
    )
    verdict = run(*checks, doubts=("a hold",))
    assert verdict.why_not_passed == [
        "not judged: a hold",
        "peak_force_n is 110 N, wanted ≤ 100 N",
        "felt.peak_n is 90 N, wanted ≤ 100 N: a stall",
        "overruns is 90 N, wanted ≤ 100 N: a stall",
    ]
    assert verdict.reasons_of_checks == ["felt.peak_n, overruns: a stall"]
    assert [one.verdict for one in verdict.by_gravity] == [FAILED, NOT_JUDGED, NOT_JUDGED, PASSED]


@pytest.mark.parametrize(
    ("met", "required", "verdict", "on_requirement"),
    [
        (True, "≤ 120", FAILED, PASSED),
        (False, "≤ 120", FAILED, FAILED),
        (None, "≤ 120", FAILED, NOT_JUDGED),  # of another seed
        (None, None, FAILED, FAILED),
        (None, None, PASSED, PASSED),
        (True, None, PASSED, PASSED),
        (False, None, NOT_JUDGED, NOT_JUDGED),
    ],
)
def test_a_requirement_is_met_by_a_value_within_its_own_limit(met, required, verdict, on_requirement):
    found = result(verdict, meets_requirement=met, required=required)
    assert found.on_its_requirement is on_requirement


def test_a_run_with_a_doubt_is_not_judged_and_proves_no_requirement_whatever_its_checks_say():
    doubted = run(result(PASSED, requirement="P-01"), doubts=("a stall",))
    assert doubted.verdict is NOT_JUDGED
    assert trace([doubted])["P-01"]["verdict"] == "not-judged"
    assert trace([replace(doubted, doubts=())])["P-01"]["verdict"] == "passed"
    assert trace([replace(doubted, reasons=("killed",))])["P-01"]["verdict"] == "failed"


def test_of_a_run_without_records_every_check_has_failed():
    found = without_records({"scenario": "mine", "clock": "real"}, [FORCE], "killed", Path("here"))
    assert (found.verdict, found.reasons, found.folder) == (FAILED, ("killed",), Path("here"))
    none = found.figures
    assert (none.ticks, none.duration_s, none.kernel_can, none.fault) == (0, 0.0, False, "none")
    assert [(one.verdict, one.value, one.reason) for one in found.checks] == [
        (FAILED, None, "nothing is recorded")
    ]


@pytest.mark.parametrize(
    ("frames", "text"),
    [(0, None), (None, None), (7, "can.log lacks 7 frames; incomplete: bus_load")],
)
def test_frames_that_the_log_lacks_are_reported_with_the_figures_that_need_them(frames, text):
    log = replace(EMPTY.figures.log, frames_lost=frames)
    assert run(figures=replace(EMPTY.figures, log=log)).lost_frames == text


@pytest.mark.parametrize(("judged", "name"), [(result(PASSED), "value"), (EMPTY, "checks")])
def test_a_verdict_cannot_be_changed(judged, name):
    with pytest.raises(FrozenInstanceError):
        setattr(judged, name, ())


# --- several seeds ------------------------------------------------------------------------------------------


def test_seeds_that_passed_failed_and_were_not_judged_are_counted_apart():
    merged = merge(
        [FORCE],
        {
            1: run(result(PASSED, 80.0)),
            2: run(result(FAILED, 130.0), folder=Path("second")),
            3: run(result(NOT_JUDGED, 90.0)),
            4: run(result(PASSED, 95.0)),
            5: run(result(FAILED, 120.0)),
        },
    )
    assert (merged.seeds, merged.passed_seeds) == (5, 2)
    assert (merged.failed_seeds, merged.not_judged_seeds) == ((2, 5), (3,))
    (check,) = merged.checks
    assert (check.seed, check.value, check.passed_seeds) == (2, 130.0, 2)
    assert (check.lowest, check.highest) == (80.0, 130.0)
    assert check.values == (80.0, 130.0, 90.0, 95.0, 120.0)
    assert check.margins == (20.0, -30.0, 10.0, 5.0, -20.0)
    assert merged.folder == Path("second")
    assert [one["name"] for one in merged.summary()["failed"]] == ["peak_force_n"]
    assert merge([FORCE], {1: run(result(PASSED))}).summary()["failed"] == []


def test_the_worst_seed_is_a_failed_one_even_if_another_has_the_smaller_margin():
    results = {1: result(NOT_JUDGED, 300.0), 2: result(FAILED, 101.0), 3: result(PASSED, 50.0)}
    assert worst_of(FORCE, results).seed == 2


def test_values_that_are_no_numbers_have_no_range_and_no_margin():
    real_time = Check(name="real_time", equals=True)
    found = worst_of(real_time, {1: result(PASSED, True), 2: result(FAILED, False)})
    assert (found.lowest, found.highest, found.margins) == (None, None, (0.0, None))
    missing = worst_of(FORCE, {1: result(PASSED, 80.0), 2: result(FAILED, None)})
    assert (missing.lowest, missing.highest, missing.margins) == (80.0, 80.0, (20.0, None))


@pytest.mark.parametrize(
    ("met", "of_all"),
    [
        ((True, True), True),
        ((True, False), False),
        ((None, False), False),
        ((True, None), None),
        ((None, None), None),
    ],
)
def test_seeds_meet_a_requirement_if_all_do(met, of_all):
    results = {seed: result(FAILED, meets_requirement=one) for seed, one in enumerate(met)}
    assert worst_of(FORCE, results).meets_requirement is of_all


@pytest.mark.parametrize(
    ("real_time", "of_all"),
    [((True, True), True), ((True, False), False), ((None, None), None)],
)
def test_a_scenario_met_its_timing_if_all_seeds_did(real_time, of_all):
    runs = {
        seed: run(result(PASSED), figures=replace(EMPTY.figures, real_time=one))
        for seed, one in enumerate(real_time)
    }
    assert merge([FORCE], runs).figures.real_time is of_all


def test_a_doubt_of_all_seeds_is_given_once_and_others_with_their_seeds():
    runs = {
        7: run(doubts=("idle", "late")),
        2: run(doubts=("idle",)),
        5: run(doubts=("idle", "late")),
    }
    assert merge_doubts(runs) == ("idle", "seed 5: late", "seed 7: late")


# --- the failures of a suite --------------------------------------------------------------------------------


def test_a_scenario_that_fails_has_the_gravest_meaning_of_its_checks():
    broken = result(FAILED, requirement="P-07", meets_requirement=False, required="≤ 120")
    worded = result(FAILED, requirement="S-11")
    stricter = result(FAILED, requirement="P-04", meets_requirement=True, required="≤ 120")
    uncertain = result(FAILED, requirement="P-04", required="≤ 120")  # another seed was not judged
    passed = result(PASSED, requirement="P-01")
    runs = {
        "all": (broken, worded, stricter),
        "worded": (worded, stricter, passed),
        "own": (stricter, uncertain, result(FAILED, meets_requirement=False), passed),
        "fine": (passed,),
        "doubted": (result(NOT_JUDGED, requirement="P-07", meets_requirement=False),),
    }
    named = {
        name: run(*results, figures=replace(EMPTY.figures, scenario=name)) for name, results in runs.items()
    }
    found = failures_of([*named.values(), replace(named["all"], reasons=("killed",))])
    assert found.broken == {"P-07": ["all"]}
    assert found.without_limit == {"S-11": ["worded"]}
    assert (found.own_limits, found.other) == (["own"], ["all"])
    assert found.sentence == (
        "failed: 1 broke P-07; 1 missed own limits for S-11; 1 missed only own limits; 1 regardless of checks"
    )
    alone = failures_of([replace(named["fine"], reasons=("killed",))])
    assert alone.sentence == "failed: 1 regardless of checks"
    assert failures_of([named["own"]]).sentence == (
        "failed: 1 missed only own limits; none broke a requirement"
    )
    assert failures_of([named["fine"], named["doubted"]]).sentence == ""
