"""The parameters in the firmware's subset: written by `parameter_table.py`; do not edit.

Their source is `parameters.toml` of interface/sources, which gives the meaning of each. All are
floats, including counts and switches.
"""

from typing import NamedTuple


class Parameters(NamedTuple):
    """One value of each parameter, in the order of their indices."""

    control_tick_s: float
    ceiling_torque_n_m: float
    ceiling_current_a: float
    ceiling_speed_rad_s: float
    ceiling_sensor_watchdog_s: float
    ceiling_link_watchdog_s: float
    striker_mass_kg: float
    striker_spring_n_m: float
    striker_rest_length_m: float
    drive_amplitude_m: float
    friction_b_n_s_m: float
    friction_mu: float
    stop_position_m: float
    stop_restitution: float
    stop_contact_s: float
    crank_zero_rad: float
    crank_bandwidth_rad_s: float
    crank_largest_disturbance_rad_s2: float
    sensor_low_full_scale_m_s2: float
    sensor_high_full_scale_m_s2: float
    sensor_bandwidth_hz: float
    sensor_high_offset_s: float
    sensor_housing_weight: float
    sensor_housing_offset_s: float
    estimator_model_std_m_s2: float
    estimator_velocity_noise_m_s: float
    estimator_stop_std_m: float
    estimator_touch_down_jitter_s: float
    estimator_restitution_std: float
    estimator_initial_model_std_m_s2: float
    estimator_largest_model_std_m_s2: float
    estimator_model_learning_s: float
    estimator_model_memory_s: float
    estimator_still_s: float
    estimator_coarse_std_m: float
    estimator_gate_sigmas: float
    estimator_gate_s: float
    detector_floor_m_s2: float
    detector_refractory_s: float
    start_lowest_ratio: float
    start_highest_ratio: float
    start_capture_ratio: float
    start_dip_ratio: float
    start_rise_s: float
    start_again_s: float
    start_stop_s: float
    start_confirm_periods: float
    start_missing_periods: float
    start_lost_periods: float
    start_dwell_periods: float
    start_attempts: float
    start_free_ratio: float
    start_approach_ratio: float
    start_approach_s: float
    start_retreat_ratio: float
    motor_inertia_kg_m2: float
    motor_viscous_n_m_s: float
    motor_dry_n_m: float
    speed_gain_p_n_m_s: float
    speed_gain_i_n_m: float
    speed_load_share: float
    speed_torque_limit_n_m: float
    speed_torque_rate_n_m_s: float
    speed_current_limit_a: float
    limit_speed_rad_s: float
    limit_overspeed_rad_s: float
    limit_drive_speed_rad_s: float
    limit_current_a: float
    limit_inverter_degc: float
    limit_motor_degc: float
    limit_lowest_degc: float
    limit_lowest_v: float
    limit_highest_v: float
    limit_impulse_n_s: float
    limit_position_std_m: float
    limit_stall_share: float
    limit_overcurrent_s: float
    limit_voltage_s: float
    limit_estimate_s: float
    limit_stall_s: float
    limit_standstill_rad_s: float
    limit_standstill_s: float
    limit_force_n: float
    limit_stretch_m: float
    limit_takeover_s: float
    watchdog_sensor_s: float
    watchdog_encoder_s: float
    watchdog_drive_s: float
    watchdog_operator_s: float
    watchdog_frozen_s: float
    watchdog_enable_s: float
    watchdog_gait_s: float
    hold_lowest_ratio: float
    hold_highest_phase_deg: float
    hold_gain_phase: float
    hold_impulse_slope_n_s: float
    hold_largest_step: float
    hold_rate_1_s: float
    hold_lowest_impulse_n_s: float
    hold_highest_impulse_n_s: float
    hold_refusing_periods: float
    gait_follow: float
    gait_lowest_ratio: float
    gait_centre_ratio: float
    gait_highest_ratio: float
    gait_hysteresis: float
    gait_window_start: float
    gait_window_end: float
    gait_lowest_confidence: float
    gait_gain_1_s: float
    gait_largest_trim: float
    gait_rate_1_s: float
    gait_still_s: float
    gait_gain_learning: float
    gait_overdue: float
    gait_margin: float
    gait_surprise: float
    gait_surprise_spread: float
    gait_impulse_tolerance: float
    identify_mode: float
    identify_memory: float
    identify_spring_step: float
    identify_friction_step: float
    spin_down_longest_s: float
    spin_down_share: float
    spin_down_gain: float
    bus_drive_node: float
    bus_own_node: float


COUNT = 128

# fmt: off
DEFAULTS = Parameters(
    0.001, 0.8, 12.0, 40.0, 0.05, 0.45, 0.8, 70.0, 0.12, 0.02, 0.2, 0.0, 0.18, 0.5, 0.01, 0.0, 200.0,
    1600.0, 156.9064, 1961.33, 400.0, 2.0, 1.0, 30.0, 0.016, 3e-05, 0.0003, 0.00025, 0.1, 0.12, 0.25, 2.0,
    0.3, 0.03, 0.002, 6.0, 0.025, 1.5, 0.005, 0.2, 1.45, 0.85, 1.05, 4.0, 2.0, 1.0, 5.0, 3.0, 2.0, 2.0, 3.0,
    1.32, 0.8, 0.6, 0.03, 0.0005, 0.0001, 0.005, 0.05, 0.8, 1.0, 0.6, 60.0, 10.0, 20.0, 25.0, 35.0, 12.0,
    80.0, 90.0, -30.0, 18.0, 30.0, 1.6, 0.05, 0.3, 0.02, 0.15, 1.0, 0.8, 0.3, 0.3, 1500.0, 0.2, 0.5, 0.03,
    0.03, 0.35, 0.35, 0.02, 1.0, 0.2, 1.0, 64.5, 0.15, 2.0, 0.015, 0.03, 0.2, 1.5, 12.0, 0.0, 0.98, 1.12,
    1.3, 0.05, 0.45, 0.6, 0.25, 2.0, 0.15, 0.3, 0.2, 0.05, 0.1, 0.02, 0.03, 4.5, 0.15, 2.0, 30.0, 0.003,
    0.03, 2.0, 0.7, 1.0, 0.0, 1.0
)
# fmt: on

# fmt: off
LOW = (
    0.00025, 0.0, 0.1, 0.1, 0.002, 0.05, 0.001, 0.1, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0001, -7.0, 1.0, 0.0,
    1.0, 1.0, 20.0, 0.01, 0.0, 0.1, 0.0001, 0.0, 1e-06, 0.0, 0.001, 0.0001, 0.0001, 0.01, 0.0, 0.001, 1e-05,
    2.0, 0.0, 0.1, 0.0, 0.01, 0.01, 0.0, 0.1, 0.1, 0.1, 0.1, 1.0, 1.0, 1.0, 1.0, 0.0, 0.1, 0.0, 0.1, 0.0,
    1e-07, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.1, 0.0, 0.0, -100.0, 0.0, 1.0, 0.01,
    0.0001, 0.0, 0.0, 0.0, 0.0, 0.0, 0.001, 0.0, 1.0, 0.01, 0.0, 0.002, 0.002, 0.05, 0.05, 0.002, 0.05,
    0.01, 0.1, 5.0, 0.01, 0.01, 0.0001, 0.0001, 0.0, 0.0, 1.0, 0.0, 0.1, 0.1, 0.1, 0.0, 0.0, 0.0, 0.01, 0.0,
    0.0, 0.001, 0.01, 0.001, 0.01, 0.0, 0.0, 0.0, 0.001, 0.0, 2.0, 1e-05, 1e-05, 0.0, 0.1, 0.0, 0.0, 0.0
)
# fmt: on

# fmt: off
HIGH = (
    0.004, 10.0, 200.0, 200.0, 10.0, 10.0, 100.0, 1000000.0, 1.0, 0.2, 1000.0, 2.0, 1.0, 1.0, 0.2, 7.0,
    1000.0, 100000.0, 10000.0, 100000.0, 100000.0, 10000.0, 1.0, 100000.0, 100.0, 1.0, 0.01, 0.01, 1.0,
    100.0, 100.0, 10000.0, 10.0, 10.0, 0.1, 1000.0, 1.0, 1000.0, 0.2, 10.0, 10.0, 10.0, 10.0, 100.0, 100.0,
    100.0, 100.0, 100.0, 100.0, 100.0, 20.0, 10.0, 1.0, 100.0, 1.0, 1.0, 1.0, 1.0, 10.0, 100.0, 1.5, 10.0,
    100000.0, 100.0, 100.0, 120.0, 200.0, 200.0, 150.0, 200.0, 50.0, 100.0, 100.0, 1000.0, 1.0, 0.9, 10.0,
    10.0, 60.0, 60.0, 10.0, 60.0, 100000.0, 10.0, 60.0, 10.0, 10.0, 10.0, 10.0, 10.0, 60.0, 10.0, 10.0,
    80.0, 1.0, 100.0, 0.1, 1.0, 100.0, 100.0, 1000.0, 1.0, 10.0, 10.0, 10.0, 1.0, 1.0, 1.0, 1.0, 20.0, 0.5,
    1.0, 10.0, 1.0, 1.0, 0.5, 1.0, 100.0, 1.0, 2.0, 10000.0, 0.1, 0.5, 100.0, 1.0, 20.0, 62.0, 60.0
)
# fmt: on

# fmt: off
TIERS = (
    0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 2, 2, 1, 1, 1, 2, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2,
    2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 1, 2, 2, 2, 1, 2, 1, 1, 1, 1, 1, 1, 1,
    1, 1, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 1, 1, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 1, 2, 2, 2,
    2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 2, 0, 0
)
# fmt: on
"""`ParameterTier` of each parameter."""

# fmt: off
WHOLE = (
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 1
)
# fmt: on
"""1 for a parameter that is a count, else 0."""

# fmt: off
ORDERED = (
    (18, 19), (39, 40), (61, 1), (63, 2), (64, 65), (65, 3), (66, 3), (67, 2), (71, 72), (85, 4), (86, 4),
    (87, 5), (88, 5), (89, 4), (91, 5), (102, 104), (106, 107)
)
# fmt: on
"""Pairs of indices: the first parameter may not exceed the second."""
