"""Error of the estimate: the estimate of tick k minus the truth at t_k, when its sensors are sampled."""

from typing import NamedTuple

from hil.record.run_traces import column, pair_by_tick
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import FloatArray


class EstimateErrors(NamedTuple):
    """Errors at the ticks that both plant and firmware have, with the plant's times; shapes (n,)."""

    t_s: FloatArray
    x_m: FloatArray
    v_m_s: FloatArray


def estimate_errors(plant: Records, firmware: Records) -> EstimateErrors:
    """Estimate minus truth of position and velocity."""
    truth, estimated = pair_by_tick(plant, firmware)
    return EstimateErrors(
        column(truth, "t_s"),
        column(estimated, "state.estimator.x_m") - column(truth, "x_m"),
        column(estimated, "state.estimator.v_m_s") - column(truth, "v_m_s"),
    )
