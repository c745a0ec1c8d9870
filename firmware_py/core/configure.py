"""The core's Config, computed from the parameters once, before the first tick."""

import math

from firmware_py.core.control import gait, gait_lock, hold, speed, spin_down, start, stride_harmonic
from firmware_py.core.estimation import (
    accelerometer,
    crank,
    detector,
    estimator,
    estimator_state,
    identify,
    striker_model,
)
from firmware_py.core.estimation.kalman import ProcessNoise, Row
from firmware_py.core.measurements import measured
from firmware_py.core.numbers import TAU
from firmware_py.core.parameter_values import Parameters
from firmware_py.core.safety import drive_link, monitors
from firmware_py.core.state import Config
from firmware_py.interface.generated.kinds import GAIT_SENSORS

STANDARD_GRAVITY_M_S2 = 9.80665


def _in_ticks(duration_s: float, tick_s: float) -> int:
    return round(duration_s / tick_s)


def _square(value: float) -> float:
    return value * value


def config_of(parameters: Parameters, damaged: bool) -> Config:
    """The core's configuration for parameters that are within their bounds.

    `damaged`: the parameters replace values that could not be read, and the firmware must not arm.
    """
    p = parameters
    tick_s = p.control_tick_s

    mass_kg = p.striker_mass_kg
    stiffness_1_s2 = p.striker_spring_n_m / mass_kg
    damping_1_s = p.friction_b_n_s_m / mass_kg
    natural_rad_s = math.sqrt(stiffness_1_s2)
    delay_s = math.sqrt(2.0) / (TAU * p.sensor_bandwidth_hz)  # Butterworth, second order, at rest
    restitution = p.stop_restitution
    gain_angle, gain_speed, gain_acceleration = crank.critically_damped_gains(p.crank_bandwidth_rad_s, tick_s)
    crank_config = crank.CrankConfig(
        tick_s=tick_s,
        zero_rad=p.crank_zero_rad,
        bandwidth_rad_s=p.crank_bandwidth_rad_s,
        gain_angle=gain_angle,
        gain_speed=gain_speed,
        gain_acceleration=gain_acceleration,
        largest_disturbance_rad_s2=p.crank_largest_disturbance_rad_s2,
    )
    estimator_config = estimator_state.EstimatorConfig(
        tick_s=tick_s,
        striker=striker_model.NominalStriker(
            stiffness_1_s2=stiffness_1_s2,
            damping_1_s=damping_1_s,
            dry_m_s2=p.friction_mu * STANDARD_GRAVITY_M_S2,
            rest_length_m=p.striker_rest_length_m,
            amplitude_m=p.drive_amplitude_m,
            stop_m=p.stop_position_m,
            restitution=restitution,
        ),
        sensor=accelerometer.NominalSensors(
            low_full_scale_m_s2=p.sensor_low_full_scale_m_s2,
            high_full_scale_m_s2=p.sensor_high_full_scale_m_s2,
            delay_s=delay_s,
            high_offset_rate=min(tick_s / p.sensor_high_offset_s, 1.0),
            housing_weight=p.sensor_housing_weight,
            housing_rate=min(tick_s / p.sensor_housing_offset_s, 1.0),
        ),
        spread=estimator_state.Spread(
            initial_xx=_square(estimator_state.INITIAL_POSITION_STD_M),
            initial_vv=_square(estimator_state.INITIAL_VELOCITY_STD_M_S),
            initial_bb=_square(estimator_state.INITIAL_BIAS_STD_M_S2),
            floor_xx=_square(estimator_state.POSITION_FLOOR_M),
            floor_vv=_square(estimator_state.VELOCITY_FLOOR_M_S),
            floor_bb=_square(estimator_state.BIAS_FLOOR_M_S2),
        ),
        # a_d = a − τ a',  a = −(c/m) (x − …) − (b/m) x',  a' = −(c/m) (x' − x_A') − (b/m) a
        row=Row(
            x=-stiffness_1_s2 * (1.0 + delay_s * damping_1_s),
            v=-damping_1_s * (1.0 + delay_s * damping_1_s) + delay_s * stiffness_1_s2,
            b=1.0,
        ),
        model=striker_model.free_flight(stiffness_1_s2, damping_1_s, tick_s),
        strapdown=estimator.strapdown(tick_s),
        strapdown_noise=ProcessNoise(
            xx=0.0, vv=_square(p.estimator_velocity_noise_m_s), bb=_square(estimator_state.BIAS_NOISE_M_S2)
        ),
        model_noise=ProcessNoise(
            xx=0.0, vv=_square(estimator_state.GAP_NOISE_M_S), bb=_square(estimator_state.BIAS_NOISE_M_S2)
        ),
        contact_noise=ProcessNoise(
            xx=0.0, vv=_square(estimator_state.CONTACT_NOISE_M_S), bb=_square(estimator_state.BIAS_NOISE_M_S2)
        ),
        bend_share=estimator_state.BEND_SHARE,
        noise=estimator_state.AdaptiveNoise(
            floor=_square(p.estimator_model_std_m_s2),
            start=_square(p.estimator_initial_model_std_m_s2),
            ceiling=_square(p.estimator_largest_model_std_m_s2),
            learning_rate=min(tick_s / p.estimator_model_learning_s, 1.0),
            readings_as_one=max(p.estimator_model_memory_s / tick_s, 1.0),
            still_m_s2=estimator_state.STILL_M_S2,
            still_ticks=_in_ticks(p.estimator_still_s, tick_s),
            gate_sigmas=p.estimator_gate_sigmas,
            gate_ticks=_in_ticks(p.estimator_gate_s, tick_s),
        ),
        stop_variance=_square(p.estimator_stop_std_m),
        measured=measured(p),
        touch_down_jitter_s=p.estimator_touch_down_jitter_s,
        separation_jitter_s=estimator_state.SEPARATION_JITTER_S,
        restitution_variance=_square(p.estimator_restitution_std),
        has_flights=p.identify_mode > 0.0,
    )
    detector_config = detector.DetectorConfig(
        tick_s=tick_s,
        floor_m_s2=p.detector_floor_m_s2,
        dry_m_s2=p.friction_mu * STANDARD_GRAVITY_M_S2,
        stop_m=p.stop_position_m,
        growth=detector.contact_growth(mass_kg, p.stop_contact_s, restitution),
        delay_s=delay_s,
        refractory_ticks=_in_ticks(p.detector_refractory_s, tick_s),
        longest_contact_ticks=_in_ticks(detector.LONGEST_CONTACT_S, tick_s),
        newton_contact_ticks=max(round(p.stop_contact_s / tick_s), 1),
        mass_kg=mass_kg,
        restitution=restitution,
    )
    longest_stop_s = max(p.start_stop_s, p.spin_down_longest_s) if p.gait_follow > 0.0 else p.start_stop_s
    return Config(
        tick_s=tick_s,
        drive_link=drive_link.DriveLinkConfig(
            speed_limit_rad_s=p.limit_drive_speed_rad_s,
            current_limit_a=p.speed_current_limit_a,
            repeat_ticks=max(_in_ticks(drive_link.REPEAT_S, tick_s), 1),
            answer_ticks=max(_in_ticks(drive_link.REPEAT_S, tick_s), 1),
            arm_ticks=max(_in_ticks(drive_link.ARM_S, tick_s), 1),
            re_zero_ticks=max(_in_ticks(drive_link.RE_ZERO_S, tick_s), 1),
            fresh_ticks=_in_ticks(p.watchdog_drive_s, tick_s),
        ),
        crank=crank_config,
        estimator=estimator_config,
        identify=identify.IdentifyConfig(
            enabled=p.identify_mode > 0.0,
            feeds=p.identify_mode > 1.0,
            tick_s=tick_s,
            delay_s=delay_s,
            memory=p.identify_memory,
            spring_step=p.identify_spring_step,
            friction_step=p.identify_friction_step,
            prior_spring=_square(identify.NOISE_M_S2 / identify.SPRING_STD),
            prior_friction=_square(identify.NOISE_M_S2 / identify.FRICTION_STD),
        ),
        detector=detector_config,
        start=start.StartConfig(
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=p.start_lowest_ratio,
            highest_ratio=p.start_highest_ratio,
            free_ratio=p.start_free_ratio,
            capture_ratio=p.start_capture_ratio,
            dip_ratio=p.start_dip_ratio,
            approach_ratio=p.start_approach_ratio,
            approach_s=p.start_approach_s,
            rise_s=p.start_rise_s,
            again_s=p.start_again_s,
            stop_s=p.start_stop_s,
            confirm_periods=int(p.start_confirm_periods),
            missing_periods=int(p.start_missing_periods),
            lost_periods=int(p.start_lost_periods),
            dwell_periods=int(p.start_dwell_periods),
            attempts=int(p.start_attempts),
            retreat_ratio=p.start_retreat_ratio,
        ),
        hold=hold.HoldConfig(
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=p.hold_lowest_ratio,
            highest_ratio=p.start_highest_ratio,
            highest_phase_rad=math.radians(p.hold_highest_phase_deg),
            gain_phase=p.hold_gain_phase,
            impulse_slope_n_s=p.hold_impulse_slope_n_s,
            largest_step=p.hold_largest_step,
            rate_1_s=p.hold_rate_1_s,
            lowest_impulse_n_s=p.hold_lowest_impulse_n_s,
            highest_impulse_n_s=p.hold_highest_impulse_n_s,
            refusing_periods=int(p.hold_refusing_periods),
        ),
        speed=speed.SpeedConfig(
            tick_s=tick_s,
            gain_p_n_m_s=p.speed_gain_p_n_m_s,
            gain_i_n_m=p.speed_gain_i_n_m,
            lead_s=1.5 * tick_s,  # sensors at t_k, torque from t_{k+1} to t_{k+2}
            load=speed.NominalLoad(
                inertia_kg_m2=p.motor_inertia_kg_m2,
                viscous_n_m_s=p.motor_viscous_n_m_s,
                dry_n_m=p.motor_dry_n_m,
                spring_n_m=p.striker_spring_n_m,
                amplitude_m=p.drive_amplitude_m,
                rest_length_m=p.striker_rest_length_m,
                longest_stretch_m=p.limit_stretch_m,
            ),
            load_share=p.speed_load_share,
            torque_limit_n_m=p.speed_torque_limit_n_m,
            torque_rate_n_m_s=p.speed_torque_rate_n_m_s,
            speed_limit_rad_s=p.limit_speed_rad_s,
        ),
        monitors=monitors.MonitorConfig(
            watchdogs=monitors.Watchdogs(
                sensor_ticks=_in_ticks(p.watchdog_sensor_s, tick_s),
                encoder_ticks=_in_ticks(p.watchdog_encoder_s, tick_s),
                drive_ticks=_in_ticks(p.watchdog_drive_s, tick_s),
                operator_ticks=_in_ticks(p.watchdog_operator_s, tick_s),
                frozen_ticks=_in_ticks(p.watchdog_frozen_s, tick_s),
                enable_ticks=_in_ticks(p.watchdog_enable_s, tick_s),
                gait_ticks=_in_ticks(p.watchdog_gait_s, tick_s) if p.gait_follow > 0.0 else 0,
            ),
            limits=monitors.Limits(
                overspeed_rad_s=p.limit_overspeed_rad_s,
                current_a=p.limit_current_a,
                inverter_degc=p.limit_inverter_degc,
                motor_degc=p.limit_motor_degc,
                lowest_degc=p.limit_lowest_degc,
                lowest_v=p.limit_lowest_v,
                highest_v=p.limit_highest_v,
                impulse_n_s=p.limit_impulse_n_s,
                peak_m_s2=p.limit_force_n / mass_kg,
                position_std_m=p.limit_position_std_m,
                stall_share=p.limit_stall_share,
                disturbance_rad_s2=(
                    monitors.IMPLAUSIBLE_SHARE * p.speed_torque_limit_n_m / p.motor_inertia_kg_m2
                ),
            ),
            overcurrent_ticks=_in_ticks(p.limit_overcurrent_s, tick_s),
            voltage_ticks=_in_ticks(p.limit_voltage_s, tick_s),
            estimate_ticks=_in_ticks(p.limit_estimate_s, tick_s),
            stall_ticks=_in_ticks(p.limit_stall_s, tick_s),
            runaway_ticks=_in_ticks(monitors.RUNAWAY_S, tick_s),
            implausible_ticks=_in_ticks(monitors.IMPLAUSIBLE_S, tick_s),
            stop_ticks=_in_ticks(longest_stop_s + monitors.STOP_MARGIN_S, tick_s),
            standstill_rad_s=p.limit_standstill_rad_s,
            standstill_ticks=_in_ticks(p.limit_standstill_s, tick_s),
            takeover_rad_s=p.limit_speed_rad_s,
            takeover_ticks=_in_ticks(p.limit_takeover_s, tick_s),
            gap_ticks=max(_in_ticks(monitors.LONGEST_GAP_S, tick_s), 1),
            parameters_damaged=damaged,
        ),
        gait=gait.GaitConfig(
            tick_s=tick_s,
            stale_ticks=_in_ticks(p.watchdog_gait_s, tick_s),
            edge_age_s=0.5 * GAIT_SENSORS.period_s,
            still_s=p.gait_still_s,
            gain_learning=p.gait_gain_learning,
            timing_variance=_square(gait.EVENT_STD),
            overdue=p.gait_overdue,
            surprise=p.gait_surprise,
            surprise_spread=p.gait_surprise_spread,
        ),
        gait_lock=gait_lock.LockConfig(
            follow=p.gait_follow > 0.0,
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=p.gait_lowest_ratio,
            centre_ratio=p.gait_centre_ratio,
            highest_ratio=p.gait_highest_ratio,
            hysteresis=p.gait_hysteresis,
            margin=p.gait_margin,
            window_start=p.gait_window_start,
            window_end=p.gait_window_end,
            lowest_confidence=p.gait_lowest_confidence,
            gain_1_s=p.gait_gain_1_s,
            largest_trim=p.gait_largest_trim,
            rate_1_s=p.gait_rate_1_s,
        ),
        stride_harmonic=stride_harmonic.StrideHarmonicConfig(
            lowest_ratio=p.gait_lowest_ratio,
            highest_ratio=p.gait_highest_ratio,
            impulse_slope_n_s=p.hold_impulse_slope_n_s,
            impulse_tolerance=p.gait_impulse_tolerance,
        ),
        spin_down=spin_down.SpinDownConfig(
            tick_s=tick_s,
            longest_s=p.spin_down_longest_s if p.gait_follow > 0.0 else 0.0,
            natural_rad_s=natural_rad_s,
            amplitude_m=p.drive_amplitude_m,
            rest_length_m=p.striker_rest_length_m,
            stop_m=p.stop_position_m,
            share=p.spin_down_share,
            gain=p.spin_down_gain,
            highest_rad_s=min(1.5 * natural_rad_s, 0.97 * p.limit_speed_rad_s),
        ),
    )
