"""A module that kernels advance tick by tick under a held torque; its memory keeps its time."""

from typing import NamedTuple

from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.sensors.sensing import Sensing
from plant_sim.solvers.adaptive.adaptive import DONE, NO_GRID, call_advance, kernel_records
from plant_sim.solvers.adaptive.state_layout import Grid, Memory

MOST_IMPACTS = 16_384
"""Room for the impacts since they were last taken: those of some seconds of chatter."""


class Module(NamedTuple):
    """Parts, the sensors' filters and memory for kernels; `no_grid`: times of samples, of which it has none.

    The first `memory.mode[0].impacts` rows of `memory.impacts` are the impacts since they were last taken.
    """

    parts: Parts
    probe: Sensing
    memory: Memory
    no_grid: Grid


def module_of(parts: Parts, probe: Sensing, memory: Memory) -> Module:
    """The module with these parts, filters and memory (`state_layout.allocate`)."""
    return Module(*kernel_records(parts, probe, memory), NO_GRID)


@subroutine(inline=True)
def move(module: Module, torque_n_m: float, dt_s: float) -> int:
    """Advance by `dt_s` under constant torque; return the solver's status.

    BUFFER_FULL: there is no room for more impacts; after they are taken, the same call continues.
    """
    parts, probe, memory, no_grid = module
    held = memory.held[0]
    held.torque_n_m = torque_n_m
    status = call_advance(parts, probe, memory, torque_n_m, held.t_s + held.t_rest_s, dt_s, no_grid)
    if status == DONE:
        held.elapsed_s = held.elapsed_low_s = 0.0
        t_s = held.t_s
        held.t_s = t_s + dt_s
        held.t_rest_s += (t_s - held.t_s) + dt_s  # Neumaier's sum: a day of ticks adds up to a day
    return status
