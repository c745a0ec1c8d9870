"""The feasibility table: turns a stride, what counts as lost, hard or soft, and the page of it."""

import csv
import itertools
import json
import math
from pathlib import Path

import numpy as np
import pytest

from plant_sim.result import Impact
from plant_sim.scene import load_scene
from tools.output import plain
from tools.study import feasibility
from tools.study.feasibility import (
    FEASIBLE,
    LEG_IMPACTS,
    LOST,
    NO_REGION,
    NO_TURNS,
    STEP_S,
    TOO_HARD,
    TOO_SOFT,
    Driven,
    Stop,
)

VERDICTS = FEASIBLE, NO_REGION, NO_TURNS, LEG_IMPACTS, LOST, TOO_HARD, TOO_SOFT
"""In the order of the page's columns."""
STOP = Stop("walking", "viscous", 0.03, "compliant")
TABLE1 = Stop("table1", "viscous", 0.03, "stiff")


def impact(t_s: float, v_m_s: float = 0.5) -> Impact:
    return Impact(t_s, v_m_s, -0.2, 0.5, 20.0, 0.0)


def turning(times_s: list[float], felt_n: float = 0.0, seconds: float = 10.0) -> Driven:
    """One turn a second from the middle of the stroke on; a pulse of 25 N after each impact."""
    t_s = STEP_S * np.arange(1, round(seconds / STEP_S) + 1)
    felt = np.full(len(t_s), felt_n)
    for at in times_s:
        felt[(t_s > at + 0.01) & (t_s < at + 0.03)] += 25.0
    return Driven([impact(at) for at in times_s], t_s, 2.0 * math.pi * t_s, felt)


def test_the_scene_that_is_shipped_is_the_tables_module() -> None:
    shipped = load_scene("walking").parts()
    tabled = feasibility.scene(STOP, "outward", 0.8).parts()
    assert shipped.striker == tabled.striker
    assert shipped.stop == pytest.approx(tabled.stop)
    assert shipped.wearer == tabled.wearer
    assert shipped.friction == tabled.friction
    assert shipped.drive.amplitude_m == tabled.drive.amplitude_m


def test_turns_a_stride_lie_in_the_region_nearest_to_its_centre_first() -> None:
    natural_hz = math.sqrt(720.0 / 0.8) / (2.0 * math.pi)
    found = feasibility.harmonics(STOP, 0.5, 0.97, 1.3)
    assert [n for n, _ in found] == [11, 10]
    assert [ratio for _, ratio in found] == pytest.approx([5.5 / natural_hz, 5.0 / natural_hz])
    assert feasibility.harmonics(TABLE1, 1.1, 0.97, 1.3) == []


def test_turns_are_counted_whole_and_from_the_rear_dead_centre_on() -> None:
    """Impacts in the middle of the turns but one, and two in another."""
    run = turning([1.2, 2.2, 4.2, 5.1, 5.3, 6.2, 7.2, 8.2])
    assert feasibility.turns_of(run, 0.0).counts.tolist() == [1, 1, 0, 1, 2, 1, 1, 1, 0]
    assert feasibility.turns_of(run, 4.5).counts.tolist() == [2, 1, 1, 1, 0]


def test_the_region_ends_with_its_turns(monkeypatch: pytest.MonkeyPatch) -> None:
    """A crank that is made faster evenly has an impact in the middle of each turn of a range."""
    t_s = np.arange(0.0, feasibility.SWEEP_S, feasibility.STEP_S)
    slope = (feasibility.HIGH_RATIO - feasibility.LOW_RATIO) / feasibility.SWEEP_S
    natural_rad_s = feasibility.module(*STOP[:2]).natural_rad_s
    crank_rad = natural_rad_s * (feasibility.LOW_RATIO * t_s + 0.5 * slope * t_s**2)
    begins_s = np.interp(2.0 * math.pi * np.arange(1.0, 1000.0) - 0.5 * math.pi, crank_rad, t_s)
    ratios = feasibility.LOW_RATIO + slope * begins_s
    first, last = np.searchsorted(ratios, [1.0, 1.3])
    impacts = [impact(at_s) for at_s in 0.5 * (begins_s[first:last] + begins_s[first + 1 : last + 1])]
    monkeypatch.setattr(feasibility, "drive", lambda *_: Driven(impacts, t_s, crank_rad, 0.0 * t_s))
    wanted = ratios[first], feasibility.TOP_SHARE * ratios[last]
    assert feasibility.region(STOP) == pytest.approx(wanted, abs=2e-5)


def test_grazing_is_no_impact() -> None:
    run = turning([1.2, 2.2])
    run.impacts.append(impact(3.2, 0.5 * feasibility.SOFTEST_M_S))
    assert feasibility.turns_of(run, 0.0).counts.tolist()[:4] == [1, 1, 0, 0]
    assert len(feasibility.pulses_n(run, 0.0)) == 2


def test_a_pulse_is_what_comes_on_top_of_what_was_felt_before() -> None:
    assert feasibility.pulses_n(turning([1.2, 2.2], felt_n=-8.0), 2.0) == pytest.approx([25.0])


@pytest.mark.parametrize(
    ("times_s", "scale", "verdict"),
    [
        ([k + 0.2 for k in range(1, 36)], 1.0, FEASIBLE),
        ([k + 0.2 for k in range(1, 36)], 1.7, TOO_HARD),
        ([k + 0.2 for k in range(1, 36)], 0.3, TOO_SOFT),
        ([k + 0.2 for k in range(1, 36) if k != 20], 1.0, LOST),
        ([], 1.0, LOST),
    ],
)
def test_a_cell_is_judged_by_its_impacts_then_by_its_pulses(
    monkeypatch: pytest.MonkeyPatch, times_s: list[float], scale: float, verdict: str
) -> None:
    run = turning(times_s, seconds=36.0)
    monkeypatch.setattr(feasibility, "drive", lambda *_: run._replace(felt_n=scale * run.felt_n))
    assert feasibility.judge_cell(STOP, "outward", 0.8, 1.0).verdict == verdict


def test_the_first_that_fails_is_the_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(feasibility, "idle_impacts_hz", lambda *_: 1.0)
    assert feasibility.cell(STOP, "up", 0.8, math.nan, math.nan)["verdict"] == NO_REGION
    assert feasibility.cell(TABLE1, "up", 1.1, 0.97, 1.3)["verdict"] == NO_TURNS
    assert feasibility.cell(STOP, "up", 0.8, 0.97, 1.3)["verdict"] == LEG_IMPACTS


def test_the_shipped_module_serves_a_walk_across_the_legs_swing_and_not_within_it() -> None:
    """Measured, at one cadence: the region, then the cells."""
    low, high = feasibility.region(STOP)
    assert (low, high) == pytest.approx((0.97, 1.17), abs=0.03)
    across = feasibility.cell(STOP, "outward", 0.8, low, high)
    assert across["verdict"] == FEASIBLE
    assert across["harmonic"] in (6, 7)
    assert 10.0 <= across["felt_low_n"] <= across["felt_high_n"] <= 40.0
    within = feasibility.cell(STOP, "forward", 1.0, low, high)
    assert within["verdict"] == LEG_IMPACTS
    assert within["idle_impacts_hz"] > feasibility.IDLE_IMPACTS_HZ


def test_the_cells_are_kept_with_what_was_measured(tmp_path: Path) -> None:
    measured = dict.fromkeys(feasibility.CELL, 1.0) | {"ratio": math.nan}
    feasibility.write_cells([measured | {"missed_share": 0.5}], tmp_path / "cells.csv")
    (read,) = csv.DictReader((tmp_path / "cells.csv").read_text("utf-8").splitlines())
    assert read == {name: "" if name == "ratio" else "1" for name in feasibility.CELL}


def test_the_counts_of_the_page_are_those_of_its_cells() -> None:
    page = Path(__file__).parents[3] / "docs" / "feasibility.md"
    rows = list(csv.DictReader((page.parent / "data" / "feasibility.csv").read_text("utf-8").splitlines()))
    assert len(rows) == 864
    text = page.read_text("utf-8")
    for preset, axis in itertools.product(feasibility.MODULES, feasibility.AXES):
        verdicts = [row["verdict"] for row in rows if (row["preset"], row["axis"]) == (preset, axis)]
        counts = [len(verdicts), *(verdicts.count(verdict) for verdict in VERDICTS)]
        assert f"| {preset} | {axis} | {' | '.join(map(str, counts))} |" in text


def test_what_was_not_measured_is_null_for_machines() -> None:
    assert json.dumps(plain({"a": math.nan, "b": 1.0})) == '{"a": null, "b": 1.0}'
