"""What the core sees of the world: the newest reading of each source with its age in ticks.

An age of 0 means that the reading arrived in this tick. A source that was never received has `NEVER_TICKS`.
"""

from typing import NamedTuple

from firmware_py.core.measurements import Measurements
from firmware_py.interface.enums import AxisState, OperatorRequest


class AccelerometerInput(NamedTuple):
    """Striker in its low and high range, and housing, along the striker's axis; gravity and bias included."""

    low_m_s2: float
    high_m_s2: float
    housing_m_s2: float
    age_ticks: int


class EncoderInput(NamedTuple):
    """The drive's crank position, circular or running on, and its own estimate of the speed."""

    position_rev: float
    velocity_rev_s: float
    age_ticks: int


class DriveInput(NamedTuple):
    """The drive's state. `age_ticks` is that of its heartbeat.

    `disarm_reason` is of an error that still stands, else 0: the drive keeps the reason of a cleared one.
    """

    axis_state: AxisState
    axis_error: int
    disarm_reason: int
    age_ticks: int


class PowerInput(NamedTuple):
    """What the drive measures of current, supply and temperature; `age_ticks` of the oldest of the three."""

    current_a: float
    voltage_v: float
    inverter_degc: float
    motor_degc: float
    age_ticks: int


class OperatorInput(NamedTuple):
    """What the operator wants. `target_ratio` is Ω over the nominal natural frequency.

    `target_impulse_n_s` is what an impact is to give; 0: the ratio alone counts.
    """

    request: OperatorRequest
    target_ratio: float
    target_impulse_n_s: float
    age_ticks: int


class GaitInput(NamedTuple):
    """The wearer's shank and foot, where sensors for them are fitted: never received otherwise.

    The shank's rate is positive where its top goes forward; both switches are closed on the ground.
    """

    shank_rate_rad_s: float
    along_m_s2: float
    heel: bool
    toe: bool
    age_ticks: int


class Inputs(NamedTuple):
    """Everything a tick reads. `elapsed_ticks` ≥ 1 counts from the last tick: more after an overrun."""

    elapsed_ticks: int
    accelerometer: AccelerometerInput
    measurements: Measurements
    encoder: EncoderInput
    drive: DriveInput
    power: PowerInput
    operator: OperatorInput
    gait: GaitInput
    estop: bool
