"""What a gap is, which figures it makes doubtful, and how many of a run's gaps a person is shown."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from hil.figures.gaps import Gap, doubt_of, find_announced, gaps_in, gaps_of, longest_gaps, longest_holds
from hil.judge.evaluation import doubt
from hil.record.run_faults import RunFault
from hil.record.run_traces import RunTraces
from hil.scenario.checks import Check
from hil.timing.pacemaker import Hold


def trace(t_s: list[float], cpu_us: list[float] | None = None) -> Any:
    columns = {"t_s": t_s} | ({} if cpu_us is None else {"cpu_us": cpu_us})
    records = np.zeros(len(t_s), [(name, float) for name in columns])
    for name, values in columns.items():
        records[name] = values
    return records


@pytest.mark.parametrize(
    ("t_s", "cpu_us", "announced", "is_gap"),
    [
        # With periods of 1 ms a gap lacks 3 ms or more.
        ([0.0, 0.001, 0.005], None, [], True),
        ([0.0, 0.001, 0.0049], None, [], False),
        # The node's own work before and after it is not the host's.
        ([0.0, 0.001, 0.006], [0.0, 1000.0, 0.0], [], True),
        ([0.0, 0.001, 0.006], [9000.0, 500.0, 600.0], [], False),
        ([0.0, 0.001, 0.002, 0.007], [9000.0, 0.0, 500.0, 500.0], [], True),
        # A fault of the scenario that overlaps it is its cause.
        ([0.0, 0.001, 0.005], None, [(0.0, 0.001), (0.005, 1.0)], True),
        ([0.0, 0.001, 0.005], None, [(0.0, 0.0011)], False),
        ([0.0, 0.001, 0.005], None, [(0.0, 0.0005), (0.0049, 1.0)], False),
    ],
)
def test_a_gap_is_time_that_neither_the_scenario_nor_the_nodes_own_work_took(
    t_s: list[float], cpu_us: list[float] | None, announced: list[tuple[float, float]], is_gap: bool
) -> None:
    found = list(gaps_in("plant", trace(t_s, cpu_us), 0.001, announced))
    assert found == ([Gap(t_s[-2], t_s[-1], "plant")] if is_gap else [])


def test_a_fault_of_the_scenario_announces_the_silence_of_its_own_process() -> None:
    faults = [
        RunFault("paused", "firmware", True, 3.0, 4.0, ""),
        RunFault("killed", "firmware", True, 6.0, None, ""),
        RunFault("killed", "plant", True, 7.0, None, ""),
        RunFault("stuck", "firmware", False, 8.0, None, ""),
    ]
    run = {"faults": [fault._asdict() for fault in faults]}
    assert find_announced("firmware", run) == [pytest.approx((2.9, 4.1)), pytest.approx((5.9, math.inf))]


LATE = RunTraces(
    plant=trace([0.0, 0.001, 2.0]),
    firmware=trace([0.0, 1.0]),
    operator=trace([0.0, 0.012, 0.024, 1.5]),
    outcome={"cut_s": 2.5, "cut_by": "plant"},
)


@pytest.mark.parametrize(
    ("run", "outcome", "gaps"),
    [
        ({"clock": "lockstep"}, LATE.outcome, []),
        ({"clock": "real", "time": "held"}, {}, []),
        ({"clock": "real", "time": "held"}, LATE.outcome, [Gap(2.5, None, "plant")]),
        (
            {"clock": "real"},
            LATE.outcome,
            [Gap(0.0, 1.0, "firmware"), Gap(0.001, 2.0, "plant"), Gap(0.024, 1.5, "operator")],
        ),
    ],
)
def test_strict_time_has_the_gaps_of_all_three_loops_and_held_time_that_which_cut_the_run(
    run: dict[str, str], outcome: dict[str, Any], gaps: list[Gap]
) -> None:
    """The operator's period is 10 ms: ticks 12 ms apart are no gap."""
    traces = RunTraces(LATE.plant, LATE.firmware, operator=LATE.operator, run=run, outcome=outcome)
    assert gaps_of(traces, 0.001) == gaps


@pytest.mark.parametrize(
    ("window_s", "to_s", "is_doubted"),
    [
        # The gap begins at 1 s. What it has disturbed lasts 2 s longer.
        ((0.0, 0.99), 1.5, False),
        ((0.0, 1.0), 1.5, True),
        ((3.5, 9.0), 1.5, True),
        ((3.51, 9.0), 1.5, False),
        ((50.0, 60.0), None, True),
    ],
)
def test_a_gap_makes_figures_doubtful_from_its_beginning_to_2_s_after_its_end(
    window_s: tuple[float, float], to_s: float | None, is_doubted: bool
) -> None:
    assert (doubt_of(window_s, [Gap(1.0, to_s, "plant")]) is not None) is is_doubted


def test_the_five_longest_holds_are_shown_in_order_of_time() -> None:
    holds = [Hold(float(at_s), "plant", 0.1, 0.01 * at_s) for at_s in range(10)]
    assert longest_holds(holds[::-1]) == [hold.in_words for hold in holds[5:]]


def test_the_longest_gaps_are_shown_in_order_of_time_below_their_number() -> None:
    gaps = [Gap(at_s, at_s + 0.001 * (3 + at_s), "plant") for at_s in map(float, range(10))] + [
        Gap(10.0, None, "firmware")
    ]
    head, *shown = longest_gaps(gaps)
    assert head == "the host held up processes in 11 intervals, the longest of which follow"
    assert len(shown) == 5
    assert longest_gaps(gaps[:5])[0].startswith("the host held up the plant from 0.000 s")
    assert shown[0] == "the host held up the plant from 6.000 s to 6.009 s"
    assert shown[-1] == "the host held up the firmware from 10.000 s and the run was ended"


def test_few_gaps_are_all_shown() -> None:
    assert longest_gaps([Gap(1.95, 1.981, "plant")]) == ["the host held up the plant from 1.950 s to 1.981 s"]


GAP = SimpleNamespace(
    gaps=[Gap(1.0, 1.1, "plant")], log=SimpleNamespace(frames_lost=0), hold_start_s=0.5, hold_end_s=9.0
)


@pytest.mark.parametrize(
    ("name", "hold_s", "is_doubted"),
    [
        ("impact_v_m_s", (0.5, 9.0), True),
        ("impact_v_m_s", (3.2, 9.0), False),
        ("impact_v_m_s", (0.5, 0.9), False),
        ("impact_v_m_s", (None, None), True),
        ("peak_force_n", (3.2, 9.0), True),
        ("peak_force_n", (None, None), True),
        # Figures of the bench itself are judged in spite of a gap.
        ("held_s", (0.5, 9.0), False),
        ("log.frames_lost", (0.5, 9.0), False),
        ("loops.plant.ticks", (0.5, 9.0), False),
        ("tick_us.p99", (0.5, 9.0), False),
        ("overruns", (0.5, 9.0), False),
    ],
)
def test_a_gap_in_its_window_makes_a_figure_of_the_motion_doubtful(
    name: str, hold_s: tuple[float | None, float | None], is_doubted: bool
) -> None:
    figures = SimpleNamespace(gaps=GAP.gaps, log=GAP.log, hold_start_s=hold_s[0], hold_end_s=hold_s[1])
    found = doubt(Check(name=name, high=9.0), figures)
    assert found == ("the host held up the plant from 1.000 s to 1.100 s" if is_doubted else None)


@pytest.mark.parametrize("name", ["held_speed_rad_s", "overruns_of_mine", "log.mine", "login"])
def test_a_users_own_figure_is_none_of_the_bench_whatever_its_name(name: str) -> None:
    own = Check(name=name, high=9.0, expression="max(plant.omega_rad_s)")
    assert doubt(own, GAP) == "the host held up the plant from 1.000 s to 1.100 s"
