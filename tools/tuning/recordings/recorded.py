"""Logs of sampled modules from the bench's compiled loop: the frames of each tick, and the truth.

Such a log differs from a run's: it has no candump text, and no frame is late or lost.
"""

from typing import NamedTuple

from plant_sim.arrays import FloatArray
from tools.campaign.campaign import Cell, scenario_of
from tools.campaign.modules import script
from tools.campaign.run import run
from tools.campaign.sampling import Sampled
from tools.tuning.recordings.readings import Ticks


class Truth(NamedTuple):
    """Position and velocity of the striker at t_k, shape (n,)."""

    x_m: FloatArray
    v_m_s: FloatArray


RECEIVED = (
    "inputs.accelerometer.low_m_s2",
    "inputs.accelerometer.high_m_s2",
    "inputs.accelerometer.housing_m_s2",
    "inputs.encoder.position_rev",
    "inputs.encoder.velocity_rev_s",
)


def record(cell: Cell, sampled: Sampled, duration_s: float) -> tuple[Ticks, Truth]:
    """Run the closed loop from power-up on; return the sensors' frames and the truth."""
    scenario = scenario_of(
        "recorded", sampled.tables, cell.firmware, script(cell), duration_s, sampled.run_seed
    )
    done = run(scenario, scenario.seed, RECEIVED)
    ticks = Ticks(scenario.period_s, *(done.firmware[name].copy() for name in RECEIVED))
    return ticks, Truth(done.true("x_m"), done.true("v_m_s"))
