"""Error of the estimate: the estimate of tick k minus the truth at t_k, when its sensors are sampled."""

from typing import NamedTuple

import numpy as np

from hil.record.run_traces import column
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import FloatArray


class EstimateErrors(NamedTuple):
    """Errors at the ticks that both plant and firmware have, with the plant's times; shapes (n,)."""

    t_s: FloatArray
    x_m: FloatArray
    v_m_s: FloatArray


def estimate_errors(plant: Records, firmware: Records) -> EstimateErrors:
    """Estimate minus truth of position and velocity."""
    _, of_plant, of_firmware = np.intersect1d(
        column(plant, "tick"), column(firmware, "tick"), return_indices=True, assume_unique=True
    )
    truth, estimated = plant[of_plant], firmware[of_firmware]
    return EstimateErrors(
        column(truth, "t_s"),
        column(estimated, "state.estimator.x_m") - column(truth, "x_m"),
        column(estimated, "state.estimator.v_m_s") - column(truth, "v_m_s"),
    )
