"""Parameters at bounds at which a monitor once could not act in time."""

from itertools import product

import pytest

from firmware_py.interface.enums import Fault
from firmware_py.shell.parameters import BY_NAME
from hil.scenario.scenario import load_scenario
from tools.campaign.run import run
from tools.dev.parameter_sweep import first_tick, last_torque_s, latched_in, pairs_of_safety

WIDE = "an-estimate-too-wide-stops-the-motor"
LATEST_S = 2.1
"""A second of `limit.estimate_s`, and the time in which the deviation grows: 0.6 s with the defaults."""
BOUNDS = (
    ("estimator.gate_s", "high"),
    ("estimator.model_std_m_s2", "low"),
    ("estimator.model_memory_s", "low"),
    ("detector.floor_m_s2", "low"),
)


@pytest.mark.requirement("S-01")
@pytest.mark.parametrize(("bound", "at_s"), [*product(BOUNDS, (5.7, 6.0, 6.3))])
def test_no_bound_of_the_estimator_hides_that_its_deviation_is_too_wide(
    bound: tuple[str, str], at_s: float
) -> None:
    name, side = bound
    value = getattr(BY_NAME[name], side)
    scenario = load_scenario(WIDE, [f"firmware.{name}={value!r}", f"script.faults.0.at_s={at_s}"])
    seen, since = run(scenario, 1), first_tick(scenario)
    assert latched_in(seen, since) == Fault.ESTIMATE_INVALID
    assert last_torque_s(seen, since) <= LATEST_S


def test_the_pairs_of_safety_are_of_parameters_that_a_monitor_or_a_conflict_reads() -> None:
    names = {one.split("=")[0] for pair in pairs_of_safety() for one in pair.split()}
    assert {"start.stop_s", "start.lowest_ratio", "gait.window_end"} <= names
    assert names.isdisjoint({"speed.gain_p_n_m_s", "hold.gain_n_m", "crank.bandwidth_rad_s"})
