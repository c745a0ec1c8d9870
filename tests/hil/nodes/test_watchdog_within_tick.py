"""A watchdog that expires within a tick: the loop's compiled step against the node, to the bit."""

import numpy as np
import pytest

from hil.drive import axis
from hil.nodes.compiled import kernel
from hil.nodes.plant import PlantNode
from hil.nodes.plant_steps import Module, move_on
from plant_sim.scene import load_scene
from plant_sim.solvers.adaptive.adaptive import NO_GRID

PERIOD_S = 4e-3


moved = kernel(move_on)


def armed_node(left_s: float) -> PlantNode:
    """A node whose axis turns the crank and whose watchdog has `left_s` left."""
    node = PlantNode(load_scene("table1-motor-soft"), 0, PERIOD_S)
    drive, age_s = node.drive, node.drive_config.watchdog_s - left_s
    node.drive = drive._replace(
        axis=drive.axis._replace(state=axis.CLOSED_LOOP),
        setpoint=drive.setpoint._replace(torque_n_m=0.1, age_s=age_s),
    )
    return node


@pytest.mark.parametrize("left_s", [0.0, 1e-3, PERIOD_S - 1e-10, PERIOD_S, 5e-3])
def test_a_tick_of_the_compiled_loop_is_one_of_the_node(left_s: float) -> None:
    node, ours = armed_node(left_s), armed_node(left_s)
    lent = ours.plant.lend()
    module = Module(*lent[:3], NO_GRID, lent.memory.impacts, np.zeros(1, np.int64))
    for _ in range(10):
        node.publish()
        node.advance([])
        torque_n_m = axis.torque_n_m(ours.drive_config, ours.drive, ours.plant.now.omega_rad_s)
        ours.resume(*moved(module, ours.drive_config, ours.state._replace(torque_n_m=torque_n_m), PERIOD_S))
        assert ours.drive == node.drive
        assert ours.plant.lend()[-2:] == node.plant.lend()[-2:]
        assert ours.plant.state == node.plant.state
        assert ours.plant.energy == node.plant.energy
    assert ours.drive.axis.errors != axis.NO_ERROR
