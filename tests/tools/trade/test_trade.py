"""Costs of methods: what is compared with what, on short runs."""

import json
import math
import time
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tools import cli
from tools.trade import control_rate, costs, own
from tools.trade.cases import CASES, Answer, Case, Method, answer, errors_of
from tools.trade.parts import STOPS, scene_with
from tools.trade.peers import heyoka_peer, scipy_peer
from tools.trade.peers.automaton import has_peers, run
from tools.trade.pictures import draw

SHORT = {case.name: Case(case.name, case.base, case.changes, 2.5, case.torque_n_m) for case in CASES}


def test_there_is_a_case_for_each_difficulty() -> None:
    names = {"periodic", "sensitive", "chattering", "sticking", "Stribeck", "motor"}
    assert {case.name for case in CASES} == names
    assert all(has_peers(case.scene.parts()) for case in CASES)


@pytest.mark.parametrize("name", ["sensitive", "Stribeck"])
def test_peers_and_own_solvers_agree(name: str) -> None:
    """scipy, with its own event search, and the adaptive solver agree where both are accurate."""
    case = SHORT[name]
    method, setting, tolerances = scipy_peer.SETTINGS[-1]
    assert (method, setting) == ("scipy DOP853", "1e-10")
    errors = errors_of(case, run(case, scipy_peer.scipy_flow(case, "DOP853", tolerances)), own.truth(case))
    assert errors.impacts == errors.impacts_wanted
    assert errors.error < 1e-8


def test_heyoka_agrees_too() -> None:
    pytest.importorskip("heyoka")
    case = SHORT["Stribeck"]
    errors = errors_of(case, run(case, heyoka_peer.HeyokaFlow(case, 1e-12)), own.truth(case))
    assert errors.impacts == errors.impacts_wanted
    assert errors.error < 1e-9


def test_errors_are_distances_to_the_truth() -> None:
    case = SHORT["periodic"]
    one = np.ones(2)
    truth = answer(np.array([1.0, 2.0]), one, -0.5 * one, 0.1, 0.0)
    late = answer(np.array([1.0, 2.1]), one, -0.5 * one, 0.1, 0.01 * case.scene.natural_rad_s)
    errors = errors_of(case, late, truth)
    assert errors.impact_time_error_s == pytest.approx(0.1)
    assert errors.error == pytest.approx(0.01)
    assert errors.impulse_error == 0.0
    lost = errors_of(case, answer(np.array([1.0]), one[:1], -0.5 * one[:1], 0.1, 0.0), truth)
    assert math.isnan(lost.impact_time_error_s)
    assert (lost.impacts, lost.impacts_wanted) == (1, 2)
    assert lost.impulse_error == pytest.approx(0.5)


def test_the_front_holds_what_nothing_cheaper_beats(tmp_path) -> None:
    case = SHORT["sticking"]
    truth = answer(np.zeros(0), np.zeros(0), np.zeros(0), 0.0, 0.0)
    given = [("adaptive", 1e-3, 1.0), ("stepping", 1e-6, 2.0), ("exact", 1e-4, 3.0)]
    listed = [
        costs.Cost(
            case,
            Method(name, "", lambda: truth),
            errors_of(case, truth._replace(x_end_m=error), truth),
            cost,
        )
        for name, error, cost in given
    ]
    assert [one.method.name for one in costs.pareto(listed)] == ["adaptive", "stepping"]
    wrong = listed[1]._replace(errors=listed[1].errors._replace(impacts=3))
    assert [p.method.name for p in costs.pareto([listed[0], wrong, listed[2]])] == ["adaptive", "exact"]
    draw(listed, tmp_path / "front.svg")
    assert "cheapest for its error" in (tmp_path / "front.svg").read_text(encoding="utf-8")


def test_costs_are_rows_of_json() -> None:
    case = SHORT["sticking"]
    methods = [method for method in own.methods(case, quick=True) if method.name in ("exact", "stepping")]
    rows = [one.row() for one in costs.measure(case, methods, 2, lambda doing: None)]
    assert {"what", "error", "cost", "unit"} <= set(rows[0])
    assert rows[0]["error"] == 0.0
    assert all(row["cost"] > 0.0 for row in rows)
    json.dumps(rows)


def test_a_short_call_is_timed_in_a_row_of_them_and_a_long_one_once() -> None:
    """What the first call takes longer, loading code and data, is not in the row's figure."""
    calls = []

    def quick() -> Answer:
        calls.append(1)
        return empty

    empty = answer(np.zeros(0), np.zeros(0), np.zeros(0), 0.0, 0.0)
    spent = costs.spent_us(quick)
    assert len(calls) > 10
    assert 0.0 < spent < costs.ROW_US

    def slow() -> Answer:
        calls.append(1)
        begun = time.thread_time_ns()
        while time.thread_time_ns() - begun < 1.1e3 * costs.ROW_US:
            pass
        return empty

    calls.clear()
    assert costs.spent_us(slow) >= costs.ROW_US
    assert len(calls) == 1


def test_the_builds_of_the_firmware_estimate_alike() -> None:
    python, compiled = (control_rate.row(1000, build) for build in control_rate.BUILDS)
    assert {"error", "cost", "unit"} <= set(python)
    assert (python["build"], compiled["build"]) == ("python", "compiled")
    assert 0.0 < compiled["error"] < 1e-3
    assert python["error"] == pytest.approx(compiled["error"], rel=1e-3)
    assert min(python["cost"], compiled["cost"]) > 0.0


def test_every_stop_is_met_on_the_orbit() -> None:
    for _, changes in STOPS:
        assert scene_with(changes).parts().drive.omega_rad_s == pytest.approx(1.3 * 9.354143466934854)


def test_a_plot_of_another_kind_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["trade", "--plot", "trade.bmp"]) == 4
    assert "wanted a file ending in .svg or .png or .pdf" in " ".join(capsys.readouterr().err.split())


def test_the_cost_of_a_run_is_without_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first run in a process compiles the loop, or loads it: as if that took 100 s."""
    ns, in_lockstep = [0], control_rate.in_lockstep

    def first_slow(*arguments: Any) -> Any:
        ns[0] += 1_000_000_000 if ns[0] else 100_000_000_000
        return in_lockstep(*arguments)

    monkeypatch.setattr(control_rate, "in_lockstep", first_slow)
    monkeypatch.setattr(control_rate, "time", SimpleNamespace(thread_time_ns=lambda: ns[0]))
    assert control_rate.row(500, "compiled")["cost"] == 1e6 / control_rate.UNTIL_S
