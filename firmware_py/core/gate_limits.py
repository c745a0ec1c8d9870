"""The gate's own block of constants; its values are computed in `configure`."""

from typing import NamedTuple


class GateLimits(NamedTuple):
    """All that the gate knows of the parameters; a commit over the bus never changes it.

    `peak_m_s2` and `change_m_s`: force and impulse over the striker's mass. `flight_m_s3`: rate at which the
    reading in flight is followed. `differ_m_s2`: largest difference of the striker's two ranges. `…_ticks`:
    watchdogs and durations. `gait_ticks` is 0 if the crank does not follow the gait.
    """

    tick_s: float
    peak_m_s2: float
    change_m_s: float
    clipped_m_s2: float
    low_clipped_m_s2: float
    differ_m_s2: float
    reads_housing: bool
    flight_m_s3: float
    torque_n_m: float
    speed_rad_s: float
    overspeed_rad_s: float
    current_a: float
    lowest_v: float
    highest_v: float
    lowest_degc: float
    inverter_degc: float
    motor_degc: float
    sensor_ticks: int
    encoder_ticks: int
    drive_ticks: int
    operator_ticks: int
    gait_ticks: int
    longest_contact_ticks: int
    window_ticks: int
    overcurrent_ticks: int
    voltage_ticks: int
    frozen_ticks: int
    gap_ticks: int
