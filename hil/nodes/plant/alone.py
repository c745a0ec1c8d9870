"""The ticks of a plant that nobody records and no fault disturbs, each in one compiled call.

Its frames and its motion equal those of `PlantNode`'s own steps, which take two to four times as long.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import register
from firmware_py.interface.frame import Frame
from hil.bus.base import MAX_BURST
from hil.bus.frame_rows import frames_in, put_frames
from hil.nodes.compiled import kernel
from hil.nodes.plant.node import PlantNode
from hil.nodes.plant.steps import (
    MOST_FRAMES,
    Due,
    PlantState,
    Setup,
    encoder_sample,
    move_on,
    obey_frames,
    publish,
)
from plant_sim.kernels import entry_point
from plant_sim.sensors.readings import Readers, SensorReading, read_sensors
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Run

register()

MOST_RECEIVED = 2 * MAX_BURST
"""More frames than one `receive` returns."""


class Module(NamedTuple):
    """What ticks work on: the module, its sensors, its drive and the bench's period."""

    run: Run
    readers: Readers
    setup: Setup
    period_s: float


class Mail(NamedTuple):
    """Frames, as rows of identifier, length and word: `arrived` received ones, and room for those sent."""

    received: NDArray[np.int64]
    arrived: int
    sent: NDArray[np.int64]


@kernel
def whole_tick(
    module: Module, due: Due, noise: NDArray[np.float64], mail: Mail, state: PlantState
) -> tuple[PlantState, SensorReading, int, int]:
    """Publish, obey and advance.

    Returns the node's state, the sensors' reading, the number of frames sent, and the solver's status.
    """
    run, setup, observed = module.run, module.setup, module.run.memory[0].observed
    omega_rad_s, crank_rad = observed[OBSERVED.omega_rad_s], observed[OBSERVED.crank_rad]
    reading = read_sensors(module.readers, run.probe.readings, crank_rad, noise)
    sample = encoder_sample(state.drive, reading)
    state, count = publish(setup, due, observed, state, reading, sample, mail.sent)
    state = obey_frames(setup.drive, state, reading, omega_rad_s, mail.received, mail.arrived)
    drive, status = move_on(run, setup.drive, state.drive, state.torque_n_m, module.period_s)
    return state._replace(tick=state.tick + 1, drive=drive), reading, count, status


class CompiledTicks:
    """Ticks of `node`, whose own steps may come between them."""

    def __init__(self, node: PlantNode) -> None:
        plant = node.plant
        self._node, self._noise = node, np.zeros(4)
        self._module = Module(plant.run, plant.readers, node.setup, node.period_s)
        self._received, self._sent = (np.zeros((most, 3), np.int64) for most in (MOST_RECEIVED, MOST_FRAMES))
        mail = Mail(self._received, 0, self._sent)
        self._tick = entry_point(whole_tick, self._module, node.due(0), self._noise, mail, node.state)

    def step(self, received: Sequence[Frame]) -> list[Frame]:
        """Obey `received` and advance by a tick; return the frames published before."""
        node = self._node
        self._noise[:] = node.plant.noise.next()
        mail = Mail(self._received, put_frames(self._received, 0, received), self._sent)
        state, reading, count, status = self._tick(self._module, node.due(1), self._noise, mail, node.state)
        node.resume(state, status, reading)
        node.note_requests(received)
        return frames_in(self._sent[:count])
