"""The inputs of the core: the newest reading of each source with its age in ticks.

An age of 0 means that the reading arrived in this tick. A source that was never received has `NEVER_TICKS`.
"""

from typing import NamedTuple

from firmware_py.core.measurements import Measurements
from firmware_py.interface.enums import AxisState, OperatorRequest


class AccelerometerInput(NamedTuple):
    """Acceleration of the striker (low and high range) and of the housing, along the striker's axis.

    Readings include gravity and bias.
    """

    low_m_s2: float
    high_m_s2: float
    housing_m_s2: float
    age_ticks: int


class EncoderInput(NamedTuple):
    """The drive's crank position, circular or counting on, and the drive's estimate of the speed.

    `frames`: the number of different frames in the tick of this reading, which is the last of them.
    """

    position_rev: float
    velocity_rev_s: float
    age_ticks: int
    frames: int


class DriveInput(NamedTuple):
    """The drive's state. `age_ticks` is the age of its heartbeat.

    `disarm_reason` belongs to an error that is still active, else it is 0: the drive itself keeps the reason
    of an error that has been cleared.
    """

    axis_state: AxisState
    axis_error: int
    disarm_reason: int
    age_ticks: int


class PowerInput(NamedTuple):
    """The drive's current, supply voltage and temperatures; `age_ticks` is the age of the oldest reading."""

    current_a: float
    voltage_v: float
    inverter_degc: float
    motor_degc: float
    age_ticks: int


class OperatorInput(NamedTuple):
    """The operator's command. `target_ratio` is Ω over the nominal natural frequency.

    `target_impulse_n_s` is the requested impulse of an impact; 0: no impulse is requested. `stray_ticks` is
    the age of the newest command out of sequence.
    """

    request: OperatorRequest
    target_ratio: float
    target_impulse_n_s: float
    age_ticks: int
    stray_ticks: int


class GaitInput(NamedTuple):
    """The sensors of the wearer's shank and foot; never received if they are not fitted.

    The shank's rate is positive if its top goes forward; both switches are closed on the ground.
    """

    shank_rate_rad_s: float
    heel: bool
    toe: bool
    age_ticks: int


class Inputs(NamedTuple):
    """All inputs of a tick."""

    accelerometer: AccelerometerInput
    measurements: Measurements
    encoder: EncoderInput
    drive: DriveInput
    power: PowerInput
    operator: OperatorInput
    gait: GaitInput
    estop: bool
