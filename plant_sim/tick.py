"""A module that kernels advance tick by tick under a held torque; its memory keeps its time."""

from plant_sim.kernels import subroutine
from plant_sim.solvers.adaptive.adaptive import DONE, call_advance
from plant_sim.solvers.adaptive.state_layout import Run

MOST_IMPACTS = 16_384
"""Room for the impacts since they were last taken: those of some seconds of chatter."""


@subroutine(inline=True)
def move(run: Run, torque_n_m: float, dt_s: float) -> int:
    """Advance by `dt_s` under constant torque; return the solver's status.

    BUFFER_FULL: there is no room for more impacts; after they are taken, the same call continues.
    """
    progress = run.memory[0].progress
    progress.torque_n_m, progress.duration_s = torque_n_m, dt_s
    progress.start_s = progress.t_s + progress.t_rest_s
    status = call_advance(run)
    if status == DONE:
        progress.elapsed_s = progress.elapsed_low_s = 0.0
        t_s = progress.t_s
        progress.t_s = t_s + dt_s
        progress.t_rest_s += (t_s - progress.t_s) + dt_s  # Neumaier's sum: a day of ticks adds up to a day
    return status
