"""The parameters in the firmware's subset: written by `parameter_table.py`; do not edit.

Their source is `parameters.toml` of interface/sources, which says what each one is. All are
floats, counts and switches too.
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
    estimator_strange_sigmas: float
    estimator_strange_s: float
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
    calm_longest_s: float
    calm_share: float
    calm_gain: float
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
"""`ParameterTier` of each."""

# fmt: off
WHOLE = (
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0,
    0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 1, 1
)
# fmt: on
"""1 for a count."""

# fmt: off
ORDERED = (
    (18, 19), (39, 40), (61, 1), (63, 2), (64, 65), (65, 3), (66, 3), (67, 2), (71, 72), (85, 4), (86, 4),
    (87, 5), (88, 5), (89, 4), (91, 5), (102, 104), (106, 107)
)
# fmt: on
"""Indices: the first may not exceed the second."""


def _chosen(first: bool, one: float, other: float) -> float:
    return one if first else other


def with_value(parameters: Parameters, index: int, value: float) -> Parameters:
    """`parameters`, with `value` in the place of `index`."""
    return Parameters(
        _chosen(index == 0, value, parameters.control_tick_s),
        _chosen(index == 1, value, parameters.ceiling_torque_n_m),
        _chosen(index == 2, value, parameters.ceiling_current_a),
        _chosen(index == 3, value, parameters.ceiling_speed_rad_s),
        _chosen(index == 4, value, parameters.ceiling_sensor_watchdog_s),
        _chosen(index == 5, value, parameters.ceiling_link_watchdog_s),
        _chosen(index == 6, value, parameters.striker_mass_kg),
        _chosen(index == 7, value, parameters.striker_spring_n_m),
        _chosen(index == 8, value, parameters.striker_rest_length_m),
        _chosen(index == 9, value, parameters.drive_amplitude_m),
        _chosen(index == 10, value, parameters.friction_b_n_s_m),
        _chosen(index == 11, value, parameters.friction_mu),
        _chosen(index == 12, value, parameters.stop_position_m),
        _chosen(index == 13, value, parameters.stop_restitution),
        _chosen(index == 14, value, parameters.stop_contact_s),
        _chosen(index == 15, value, parameters.crank_zero_rad),
        _chosen(index == 16, value, parameters.crank_bandwidth_rad_s),
        _chosen(index == 17, value, parameters.crank_largest_disturbance_rad_s2),
        _chosen(index == 18, value, parameters.sensor_low_full_scale_m_s2),
        _chosen(index == 19, value, parameters.sensor_high_full_scale_m_s2),
        _chosen(index == 20, value, parameters.sensor_bandwidth_hz),
        _chosen(index == 21, value, parameters.sensor_high_offset_s),
        _chosen(index == 22, value, parameters.sensor_housing_weight),
        _chosen(index == 23, value, parameters.sensor_housing_offset_s),
        _chosen(index == 24, value, parameters.estimator_model_std_m_s2),
        _chosen(index == 25, value, parameters.estimator_velocity_noise_m_s),
        _chosen(index == 26, value, parameters.estimator_stop_std_m),
        _chosen(index == 27, value, parameters.estimator_touch_down_jitter_s),
        _chosen(index == 28, value, parameters.estimator_restitution_std),
        _chosen(index == 29, value, parameters.estimator_initial_model_std_m_s2),
        _chosen(index == 30, value, parameters.estimator_largest_model_std_m_s2),
        _chosen(index == 31, value, parameters.estimator_model_learning_s),
        _chosen(index == 32, value, parameters.estimator_model_memory_s),
        _chosen(index == 33, value, parameters.estimator_still_s),
        _chosen(index == 34, value, parameters.estimator_coarse_std_m),
        _chosen(index == 35, value, parameters.estimator_strange_sigmas),
        _chosen(index == 36, value, parameters.estimator_strange_s),
        _chosen(index == 37, value, parameters.detector_floor_m_s2),
        _chosen(index == 38, value, parameters.detector_refractory_s),
        _chosen(index == 39, value, parameters.start_lowest_ratio),
        _chosen(index == 40, value, parameters.start_highest_ratio),
        _chosen(index == 41, value, parameters.start_capture_ratio),
        _chosen(index == 42, value, parameters.start_dip_ratio),
        _chosen(index == 43, value, parameters.start_rise_s),
        _chosen(index == 44, value, parameters.start_again_s),
        _chosen(index == 45, value, parameters.start_stop_s),
        _chosen(index == 46, value, parameters.start_confirm_periods),
        _chosen(index == 47, value, parameters.start_missing_periods),
        _chosen(index == 48, value, parameters.start_lost_periods),
        _chosen(index == 49, value, parameters.start_dwell_periods),
        _chosen(index == 50, value, parameters.start_attempts),
        _chosen(index == 51, value, parameters.start_free_ratio),
        _chosen(index == 52, value, parameters.start_approach_ratio),
        _chosen(index == 53, value, parameters.start_approach_s),
        _chosen(index == 54, value, parameters.start_retreat_ratio),
        _chosen(index == 55, value, parameters.motor_inertia_kg_m2),
        _chosen(index == 56, value, parameters.motor_viscous_n_m_s),
        _chosen(index == 57, value, parameters.motor_dry_n_m),
        _chosen(index == 58, value, parameters.speed_gain_p_n_m_s),
        _chosen(index == 59, value, parameters.speed_gain_i_n_m),
        _chosen(index == 60, value, parameters.speed_load_share),
        _chosen(index == 61, value, parameters.speed_torque_limit_n_m),
        _chosen(index == 62, value, parameters.speed_torque_rate_n_m_s),
        _chosen(index == 63, value, parameters.speed_current_limit_a),
        _chosen(index == 64, value, parameters.limit_speed_rad_s),
        _chosen(index == 65, value, parameters.limit_overspeed_rad_s),
        _chosen(index == 66, value, parameters.limit_drive_speed_rad_s),
        _chosen(index == 67, value, parameters.limit_current_a),
        _chosen(index == 68, value, parameters.limit_inverter_degc),
        _chosen(index == 69, value, parameters.limit_motor_degc),
        _chosen(index == 70, value, parameters.limit_lowest_degc),
        _chosen(index == 71, value, parameters.limit_lowest_v),
        _chosen(index == 72, value, parameters.limit_highest_v),
        _chosen(index == 73, value, parameters.limit_impulse_n_s),
        _chosen(index == 74, value, parameters.limit_position_std_m),
        _chosen(index == 75, value, parameters.limit_stall_share),
        _chosen(index == 76, value, parameters.limit_overcurrent_s),
        _chosen(index == 77, value, parameters.limit_voltage_s),
        _chosen(index == 78, value, parameters.limit_estimate_s),
        _chosen(index == 79, value, parameters.limit_stall_s),
        _chosen(index == 80, value, parameters.limit_standstill_rad_s),
        _chosen(index == 81, value, parameters.limit_standstill_s),
        _chosen(index == 82, value, parameters.limit_force_n),
        _chosen(index == 83, value, parameters.limit_stretch_m),
        _chosen(index == 84, value, parameters.limit_takeover_s),
        _chosen(index == 85, value, parameters.watchdog_sensor_s),
        _chosen(index == 86, value, parameters.watchdog_encoder_s),
        _chosen(index == 87, value, parameters.watchdog_drive_s),
        _chosen(index == 88, value, parameters.watchdog_operator_s),
        _chosen(index == 89, value, parameters.watchdog_frozen_s),
        _chosen(index == 90, value, parameters.watchdog_enable_s),
        _chosen(index == 91, value, parameters.watchdog_gait_s),
        _chosen(index == 92, value, parameters.hold_lowest_ratio),
        _chosen(index == 93, value, parameters.hold_highest_phase_deg),
        _chosen(index == 94, value, parameters.hold_gain_phase),
        _chosen(index == 95, value, parameters.hold_impulse_slope_n_s),
        _chosen(index == 96, value, parameters.hold_largest_step),
        _chosen(index == 97, value, parameters.hold_rate_1_s),
        _chosen(index == 98, value, parameters.hold_lowest_impulse_n_s),
        _chosen(index == 99, value, parameters.hold_highest_impulse_n_s),
        _chosen(index == 100, value, parameters.hold_refusing_periods),
        _chosen(index == 101, value, parameters.gait_follow),
        _chosen(index == 102, value, parameters.gait_lowest_ratio),
        _chosen(index == 103, value, parameters.gait_centre_ratio),
        _chosen(index == 104, value, parameters.gait_highest_ratio),
        _chosen(index == 105, value, parameters.gait_hysteresis),
        _chosen(index == 106, value, parameters.gait_window_start),
        _chosen(index == 107, value, parameters.gait_window_end),
        _chosen(index == 108, value, parameters.gait_lowest_confidence),
        _chosen(index == 109, value, parameters.gait_gain_1_s),
        _chosen(index == 110, value, parameters.gait_largest_trim),
        _chosen(index == 111, value, parameters.gait_rate_1_s),
        _chosen(index == 112, value, parameters.gait_still_s),
        _chosen(index == 113, value, parameters.gait_gain_learning),
        _chosen(index == 114, value, parameters.gait_overdue),
        _chosen(index == 115, value, parameters.gait_margin),
        _chosen(index == 116, value, parameters.gait_surprise),
        _chosen(index == 117, value, parameters.gait_surprise_spread),
        _chosen(index == 118, value, parameters.gait_impulse_tolerance),
        _chosen(index == 119, value, parameters.identify_mode),
        _chosen(index == 120, value, parameters.identify_memory),
        _chosen(index == 121, value, parameters.identify_spring_step),
        _chosen(index == 122, value, parameters.identify_friction_step),
        _chosen(index == 123, value, parameters.calm_longest_s),
        _chosen(index == 124, value, parameters.calm_share),
        _chosen(index == 125, value, parameters.calm_gain),
        _chosen(index == 126, value, parameters.bus_drive_node),
        _chosen(index == 127, value, parameters.bus_own_node),
    )
