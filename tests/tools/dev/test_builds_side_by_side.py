"""The builds' decisions side by side."""

from typing import Any

import numpy as np
import pytest

from firmware_py.core.estimation import kalman
from firmware_py.interface.enums import Fault, Mode
from hil.scenario.scenario import load_scenario
from tools.dev import builds
from tools.dev.builds import Decisions, decisions_of, differences

TRACE = np.dtype([("tick", int), ("outputs.mode", int), ("outputs.fault", int), ("outputs.impact", bool)])


def decided(shift: int = 0, fault: Fault = Fault.NONE, impacts: tuple[int, ...] = (70, 80)) -> Decisions:
    """Of a run of 100 ticks that is ready at 10 and runs from 50 on."""
    trace = np.zeros(100, TRACE)
    trace["tick"] = np.arange(100)
    trace["outputs.mode"][10:] = Mode.READY
    trace["outputs.mode"][50 + shift :] = Mode.RUN
    trace["outputs.fault"][90:] = fault
    trace["outputs.impact"][list(impacts)] = True
    return decisions_of(trace)


def test_decisions_are_changes_of_mode_and_fault_and_impacts() -> None:
    found = decided(fault=Fault.OVERSPEED)
    assert found.modes.tolist() == [
        [10, Mode.READY, Fault.NONE],
        [50, Mode.RUN, Fault.NONE],
        [90, Mode.RUN, Fault.OVERSPEED],
    ]
    assert found.impacts.tolist() == [[70], [80]]


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (decided(shift=2), "modes: python decides [50, 3, 0], compiled [52, 3, 0]"),
        (decided(fault=Fault.OVERSPEED), "modes: python decides None, compiled [90, 3, 7]"),
        (decided(impacts=(70, 82)), "impacts: python decides [80], compiled [82]"),
        (decided(impacts=(70,)), "impacts: python decides [80], compiled None"),
    ],
)
def test_what_differs_by_more_than_a_tick_is_reported(other: Decisions, reason: str) -> None:
    assert differences(decided(), decided(shift=1, impacts=(69, 81))) == []
    assert differences(decided(), other) == [reason]


SHORT = [
    "script.commands=[{at_s=0.5,request='run',target_ratio=1.1},{at_s=10.0,request='idle'}]",
    "script.duration_s=12.0",
]


def test_the_builds_decide_alike() -> None:
    scenario = load_scenario("soft-start-multistable", SHORT)
    of_python = builds.decide(scenario, 1, builds.Beside)
    assert len(of_python.impacts) > 5
    assert differences(of_python, builds.decide(scenario, 1, "compiled")) == []


def test_a_byte_that_differs_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    def off(*arguments: Any) -> kalman.StateEstimate:
        one = predict(*arguments)
        return one._replace(v_m_s=one.v_m_s + 1e-3)

    predict = kalman.predict_written_out
    monkeypatch.setattr(kalman, "predict_written_out", off)
    with pytest.raises(builds.DifferentBytesError, match="python sends"):
        builds.decide(load_scenario("soft-start-multistable", SHORT), 1, builds.Beside)
