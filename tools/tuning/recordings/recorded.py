"""Logs of sampled modules from the bench's compiled loop: the frames of each tick.

Such a log differs from a run's: it has no candump text, and no frame is late or lost.
"""

from tools.campaign.campaign import Cell, scenario_of
from tools.campaign.modules import module_script
from tools.campaign.run import Run, run
from tools.campaign.sampling import Sampled
from tools.tuning.recordings.readings import Ticks

RECEIVED = (
    "inputs.accelerometer.low_m_s2",
    "inputs.accelerometer.high_m_s2",
    "inputs.accelerometer.housing_m_s2",
    "inputs.encoder.position_rev",
    "inputs.encoder.velocity_rev_s",
)


def record(cell: Cell, sampled: Sampled, duration_s: float) -> Run:
    """Run the closed loop from power-up on, and keep the sensors' frames."""
    script = module_script(cell, duration_s)
    scenario = scenario_of("recorded", sampled.tables, cell.firmware, script, sampled.run_seed)
    return run(scenario, scenario.seed, RECEIVED)


def read_received(done: Run) -> Ticks:
    """The sensors' frames of a recorded run."""
    return Ticks(done.tick_s, *(done.firmware[name].copy() for name in RECEIVED))
