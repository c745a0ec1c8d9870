"""A watchdog that expires within a tick: the motor has its torque until then, and none afterwards."""

import pytest

from hil.drive import axis
from hil.nodes.plant.node import PlantNode
from plant_sim.plant import Plant
from plant_sim.scene import load_scene

PERIOD_S = 4e-3
TORQUE_N_M = 0.1
SCENE = load_scene("table1-motor-soft")


def armed_node(left_s: float) -> PlantNode:
    """A node whose axis turns the crank and whose watchdog has `left_s` left."""
    node = PlantNode(SCENE, 0, PERIOD_S)
    drive, age_s = node.drive, node.drive_config.watchdog_s - left_s
    drive = drive._replace(
        axis=drive.axis._replace(state=axis.CLOSED_LOOP),
        setpoint=drive.setpoint._replace(torque_n_m=TORQUE_N_M, age_s=age_s),
    )
    node.state = node.state._replace(drive=drive)
    return node


@pytest.mark.parametrize("left_s", [0.0, 1e-3, PERIOD_S - 1e-10, PERIOD_S, 5e-3])
def test_torque_ends_with_the_watchdog(left_s: float) -> None:
    node, plant = armed_node(left_s), Plant(SCENE, 0)
    for _ in range(10):
        node.publish()
        node.advance([])
        armed_s = left_s if left_s < PERIOD_S - axis.TIME_RESOLUTION_S else PERIOD_S
        plant.advance(TORQUE_N_M, armed_s)
        plant.advance(0.0, PERIOD_S - armed_s)
        left_s = max(0.0, left_s - armed_s)
        assert node.plant.t_s == pytest.approx(plant.t_s, abs=1e-15)
        assert node.plant.state.crank_rad == pytest.approx(plant.state.crank_rad, abs=1e-11)
        assert node.plant.state.omega_rad_s == pytest.approx(plant.state.omega_rad_s, abs=1e-9)
    assert node.drive.axis.errors == axis.AxisError.WATCHDOG_TIMER_EXPIRED
