"""Logs of sampled modules, made by the campaigns' compiled loop: what goes over CAN by tick, and the truth.

What such a log has less than one of the bench: no candump text, and no frame is ever late or lost. The
frames' values are the same, quantised and saturated as the codec does it.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.step import Config
from hil.operator import Command
from plant_sim.scene import Scene
from plant_sim.solvers.memory import IMPACT_TIME
from tools.campaign import columns
from tools.campaign.run import run
from tools.tuning.readings import Ticks

FloatArray = NDArray[np.float64]


class Truth(NamedTuple):
    """The striker at t_k, shape (n,), and when it touched down."""

    x_m: FloatArray
    v_m_s: FloatArray
    impacts_s: FloatArray


def record(
    scene: Scene, config: Config, commands: Sequence[Command], duration_s: float, noise: np.random.Generator
) -> tuple[Ticks, Truth]:
    """A closed loop's log, from power-up on, in a process that compiles the firmware."""
    done = run(scene, config, commands, duration_s, noise, traced=True)
    trace = done.trace
    ticks = Ticks(
        config.tick_s,
        trace[:, columns.TRACE_LOW],
        trace[:, columns.TRACE_HIGH],
        trace[:, columns.TRACE_HOUSING],
        trace[:, columns.TRACE_POSITION],
        trace[:, columns.TRACE_VELOCITY],
    )
    truth = Truth(trace[:, columns.TRACE_X], trace[:, columns.TRACE_V], done.impacts[:, IMPACT_TIME])
    return ticks, truth
