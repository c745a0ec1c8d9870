"""A swing that drives the free crank beyond its limit only once the start has begun."""

import pytest

from hil.figures.faults import NO_TORQUE_N_M
from hil.scenario.scenario import load_scenario
from tools.falsify.objective import judged


@pytest.mark.requirement("S-11")
def test_a_swing_beyond_the_limit_in_the_start_ends_it_without_torque() -> None:
    """75 % of 24 rad/s exceed the 17 rad/s at which this start begins; then the swing reaches 27 rad/s."""
    scenario = load_scenario("a-swing-that-grows-is-waited-for", ["firmware.limit.speed_rad_s=24"])
    verdict, _ = judged(scenario, scenario.checks)
    values = {one.name: one.value for one in verdict.checks}
    assert values["fault"] == "overspeed"
    assert values["motor_torque_after_stop_n_m"] < NO_TORQUE_N_M
    assert verdict.figures.safe_state.cause == "fault"
    assert verdict.figures.safe_state.torque_zero_after_s <= 0.1
