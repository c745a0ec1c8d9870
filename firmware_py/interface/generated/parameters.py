"""The record of the parameters: written by `generate.py`; do not edit.

Their source is `parameters.toml`, which gives unit, bounds and meaning of each. Counts and
switches are ints, all others floats.
"""

from typing import NamedTuple


class Control(NamedTuple):
    """The table `control`."""

    tick_s: float


class Ceiling(NamedTuple):
    """The table `ceiling`."""

    torque_n_m: float
    current_a: float
    speed_rad_s: float
    sensor_watchdog_s: float
    link_watchdog_s: float
    force_n: float
    impulse_n_s: float
    temperature_degc: float
    voltage_v: float


class Striker(NamedTuple):
    """The table `striker`."""

    mass_kg: float
    spring_n_m: float
    rest_length_m: float


class Drive(NamedTuple):
    """The table `drive`."""

    amplitude_m: float


class Friction(NamedTuple):
    """The table `friction`."""

    b_n_s_m: float
    mu: float


class Stop(NamedTuple):
    """The table `stop`."""

    position_m: float
    restitution: float
    contact_s: float


class Crank(NamedTuple):
    """The table `crank`."""

    zero_rad: float
    bandwidth_rad_s: float
    largest_disturbance_rad_s2: float


class Sensor(NamedTuple):
    """The table `sensor`."""

    low_full_scale_m_s2: float
    high_full_scale_m_s2: float
    high_offset_m_s2: float
    bandwidth_hz: float
    high_offset_s: float
    housing_weight: float
    housing_offset_s: float


class Estimator(NamedTuple):
    """The table `estimator`."""

    model_std_m_s2: float
    velocity_noise_m_s: float
    stop_std_m: float
    touch_down_jitter_s: float
    restitution_std: float
    initial_model_std_m_s2: float
    largest_model_std_m_s2: float
    model_learning_s: float
    model_memory_s: float
    still_s: float
    coarse_std_m: float
    gate_sigmas: float
    gate_s: float


class Detector(NamedTuple):
    """The table `detector`."""

    floor_m_s2: float
    refractory_s: float


class Start(NamedTuple):
    """The table `start`."""

    lowest_ratio: float
    highest_ratio: float
    capture_ratio: float
    dip_ratio: float
    rise_s: float
    again_s: float
    stop_s: float
    confirm_periods: int
    missing_periods: int
    lost_periods: int
    dwell_periods: int
    attempts: int
    free_ratio: float
    approach_ratio: float
    approach_s: float
    retreat_ratio: float


class Motor(NamedTuple):
    """The table `motor`."""

    inertia_kg_m2: float
    viscous_n_m_s: float
    dry_n_m: float


class Speed(NamedTuple):
    """The table `speed`."""

    gain_p_n_m_s: float
    gain_i_n_m: float
    load_share: float
    torque_limit_n_m: float
    torque_rate_n_m_s: float
    current_limit_a: float


class Limit(NamedTuple):
    """The table `limit`."""

    speed_rad_s: float
    overspeed_rad_s: float
    drive_speed_rad_s: float
    current_a: float
    inverter_degc: float
    motor_degc: float
    lowest_degc: float
    lowest_v: float
    highest_v: float
    impulse_n_s: float
    position_std_m: float
    stall_share: float
    overcurrent_s: float
    voltage_s: float
    estimate_s: float
    stall_s: float
    standstill_rad_s: float
    standstill_s: float
    force_n: float
    stretch_m: float
    takeover_s: float


class Watchdog(NamedTuple):
    """The table `watchdog`."""

    sensor_s: float
    encoder_s: float
    drive_s: float
    operator_s: float
    frozen_s: float
    enable_s: float
    gait_s: float
    proof_required: int


class Hold(NamedTuple):
    """The table `hold`."""

    lowest_ratio: float
    highest_phase_deg: float
    gain_phase: float
    impulse_slope_n_s: float
    largest_step: float
    rate_1_s: float
    lowest_impulse_n_s: float
    highest_impulse_n_s: float
    refusing_periods: int


class Gait(NamedTuple):
    """The table `gait`."""

    follow: int
    lowest_ratio: float
    centre_ratio: float
    highest_ratio: float
    hysteresis: float
    window_start: float
    window_end: float
    lowest_confidence: float
    gain_1_s: float
    largest_trim: float
    rate_1_s: float
    still_s: float
    gain_learning: float
    overdue: float
    margin: float
    surprise: float
    surprise_spread: float
    impulse_tolerance: float


class SpinDown(NamedTuple):
    """The table `spin_down`."""

    longest_s: float
    share: float
    gain: float


class Bus(NamedTuple):
    """The table `bus`."""

    drive_node: int
    own_node: int


class Wiring(NamedTuple):
    """The table `wiring`."""

    torque_reversed: int
    striker_reversed: int
    low_exchanged: int


class Parameters(NamedTuple):
    """All parameters, by table and key."""

    control: Control
    ceiling: Ceiling
    striker: Striker
    drive: Drive
    friction: Friction
    stop: Stop
    crank: Crank
    sensor: Sensor
    estimator: Estimator
    detector: Detector
    start: Start
    motor: Motor
    speed: Speed
    limit: Limit
    watchdog: Watchdog
    hold: Hold
    gait: Gait
    spin_down: SpinDown
    bus: Bus
    wiring: Wiring
