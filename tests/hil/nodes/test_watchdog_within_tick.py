"""A watchdog that expires within a tick: the loop's compiled step against the node, to the bit."""

from typing import Any

import numpy as np
import pytest

from hil.drive import axis
from hil.nodes.closed_loop import Buffers, move_on
from hil.nodes.compiled import kernel
from hil.nodes.plant import PlantNode
from plant_sim.scene import load_scene
from plant_sim.solvers.adaptive.adaptive import DONE, NO_GRID

PERIOD_S = 4e-3


@kernel
def moved(parts, probe, memory, buffers, config, drive, torque_n_m, t_s, t_rest_s, no_grid):
    return move_on(parts, probe, memory, buffers, config, drive, torque_n_m, t_s, t_rest_s, PERIOD_S, no_grid)


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
    lent, no_bytes = ours.plant.lend(), np.zeros(0, np.uint8)
    buffers = Buffers(
        np.zeros((0, 1)),
        no_bytes,
        np.zeros((0, 3), np.int64),
        lent.memory.impacts,
        no_bytes,
        np.zeros(3, int),
    )
    drive, t_s, t_rest_s = ours.drive, lent.t_s, lent.t_rest_s
    for _ in range(10):
        node.publish()
        node.advance([])
        torque_n_m: Any = axis.torque_n_m(ours.drive_config, drive, ours.plant.now.omega_rad_s)
        drive, torque_n_m, t_s, t_rest_s, status = moved(
            *lent[:3], buffers, ours.drive_config, drive, torque_n_m, t_s, t_rest_s, NO_GRID
        )
        ours.plant.take_back(t_s, t_rest_s, torque_n_m, status)
        assert status == DONE
        assert drive == node.drive
        assert (t_s, t_rest_s) == node.plant.lend()[-2:]
        assert ours.plant.state == node.plant.state
        assert ours.plant.energy == node.plant.energy
    assert drive.axis.errors != axis.NO_ERROR
    assert t_rest_s != 0.0
