"""The gate's own constants, derived from the parameters once: a commit over the bus never changes them."""

from typing import NamedTuple

from firmware_py.core.numbers import in_ticks
from firmware_py.interface.generated.parameters import Parameters

CLIPPED_SHARE = 0.98
"""Share of the full scale above which a reading may be clipped; such a reading violates the force limit."""

FLIGHT_M_S3 = 300.0
SPRING_M_S = 2.0
"""Rate at which the reading in flight is followed; the spring may change it faster by this speed: a spring
of 70 N/m on 0.8 kg changes it by up to 170 m/s³, a soft stop by 10⁴."""
LONGEST_CONTACT_S = 0.1
"""A longer deviation is no impact: offset or scale of the sensor have changed, which violates the limit."""
SPEED_WINDOW_S = 0.02
"""Time over which the crank's speed is measured from its positions; a frame may be 10 ms late."""
LONGEST_GAP_S = 0.010
"""Longest gap in the samples that is tolerated any number of times; longer ones make the speed loop swing."""

DIFFER_M_S2 = 3.0
"""Allowed beyond the largest offset of the high range: the low range's offset, and the scales of both."""


class GateLimits(NamedTuple):
    """All that the gate knows of the parameters; a commit over the bus never changes it.

    `peak_m_s2` and `change_m_s`: force and impulse over the striker's mass. `flight_m_s3`: rate at which the
    reading in flight is followed. `differ_m_s2`: largest difference of the striker's two ranges. `…_ticks`:
    watchdogs and durations, of which other blocks copy some. `reads_gait`: the crank follows the gait.
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
    reads_gait: bool
    longest_contact_ticks: int
    window_ticks: int
    overcurrent_ticks: int
    voltage_ticks: int
    frozen_ticks: int
    gap_ticks: int


def derive(p: Parameters) -> GateLimits:
    """All that the gate knows of the parameters."""
    tick_s, mass_kg = p.control.tick_s, p.striker.mass_kg
    return GateLimits(
        tick_s=tick_s,
        peak_m_s2=p.limit.force_n / mass_kg,
        change_m_s=p.limit.impulse_n_s / mass_kg,
        clipped_m_s2=CLIPPED_SHARE * p.sensor.high_full_scale_m_s2,
        low_clipped_m_s2=CLIPPED_SHARE * p.sensor.low_full_scale_m_s2,
        differ_m_s2=p.sensor.high_offset_m_s2 + DIFFER_M_S2,
        reads_housing=p.sensor.housing_weight > 0.0,
        flight_m_s3=max(FLIGHT_M_S3, SPRING_M_S * p.striker.spring_n_m / mass_kg),
        torque_n_m=p.speed.torque_limit_n_m,
        speed_rad_s=p.limit.speed_rad_s,
        overspeed_rad_s=p.limit.overspeed_rad_s,
        current_a=p.limit.current_a,
        lowest_v=p.limit.lowest_v,
        highest_v=p.limit.highest_v,
        lowest_degc=p.limit.lowest_degc,
        inverter_degc=p.limit.inverter_degc,
        motor_degc=p.limit.motor_degc,
        sensor_ticks=in_ticks(p.watchdog.sensor_s, tick_s),
        encoder_ticks=in_ticks(p.watchdog.encoder_s, tick_s),
        drive_ticks=in_ticks(p.watchdog.drive_s, tick_s),
        longest_contact_ticks=in_ticks(LONGEST_CONTACT_S, tick_s),
        window_ticks=in_ticks(SPEED_WINDOW_S, tick_s),
        overcurrent_ticks=in_ticks(p.limit.overcurrent_s, tick_s),
        voltage_ticks=in_ticks(p.limit.voltage_s, tick_s),
        operator_ticks=in_ticks(p.watchdog.operator_s, tick_s),
        gait_ticks=in_ticks(p.watchdog.gait_s, tick_s),
        reads_gait=p.gait.follow > 0,
        frozen_ticks=in_ticks(p.watchdog.frozen_s, tick_s),
        gap_ticks=in_ticks(LONGEST_GAP_S, tick_s, 1),
    )
