"""The configuration, computed from the parameters before the first tick, and after a commit over the bus.

A commit changes tuning parameters only: constants of the module and the gate's limits keep their bits.
"""

import math

from firmware_py.core.config import Config, Derived, MonitorTicks, Row, Ticks, Tracker
from firmware_py.core.estimation import crank, detector, stop_model, striker_model
from firmware_py.core.gate_limits import GateLimits
from firmware_py.core.numbers import TAU
from firmware_py.core.safety import consent, drive_link, gate, liveness, monitors, own_crank, watchdog_proof
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

STANDARD_GRAVITY_M_S2 = 9.80665
LONGEST_CATCH_UP_S = 0.5
"""Longest time whose missed periods are run later (`node.inbox`). It is longer than the watchdogs of links
and sensors (`ceiling.link_watchdog_s`): raise both together."""


def derive_gate_limits(p: Parameters) -> GateLimits:
    """All that the gate knows of the parameters."""
    tick_s, mass_kg = p.control.tick_s, p.striker.mass_kg
    return GateLimits(
        tick_s=tick_s,
        peak_m_s2=p.limit.force_n / mass_kg,
        change_m_s=p.limit.impulse_n_s / mass_kg,
        clipped_m_s2=gate.CLIPPED_SHARE * p.sensor.high_full_scale_m_s2,
        low_clipped_m_s2=gate.CLIPPED_SHARE * p.sensor.low_full_scale_m_s2,
        differ_m_s2=p.sensor.high_offset_m_s2 + liveness.DIFFER_M_S2,
        reads_housing=p.sensor.housing_weight > 0.0,
        flight_m_s3=max(gate.FLIGHT_M_S3, gate.SPRING_M_S * p.striker.spring_n_m / mass_kg),
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
        longest_contact_ticks=in_ticks(gate.LONGEST_CONTACT_S, tick_s),
        window_ticks=in_ticks(gate.SPEED_WINDOW_S, tick_s),
        overcurrent_ticks=in_ticks(p.limit.overcurrent_s, tick_s),
        voltage_ticks=in_ticks(p.limit.voltage_s, tick_s),
        operator_ticks=in_ticks(p.watchdog.operator_s, tick_s),
        gait_ticks=in_ticks(p.watchdog.gait_s, tick_s) if p.gait.follow > 0 else 0,
        frozen_ticks=in_ticks(p.watchdog.frozen_s, tick_s),
        gap_ticks=in_ticks(gate.LONGEST_GAP_S, tick_s, 1),
    )


def in_ticks(duration_s: float, tick_s: float, least: int = 0) -> int:
    """The whole number of ticks nearest to a duration, at least `least`."""
    return max(round(duration_s / tick_s), least)


def ticks_of(p: Parameters) -> Ticks:
    """The durations in ticks of the control period, without those that `derive_tuning_constants` computes."""
    tick_s = p.control.tick_s
    return zeroed(
        Ticks,
        longest_contact=in_ticks(detector.LONGEST_CONTACT_S, tick_s),
        newton_contact=in_ticks(p.stop.contact_s, tick_s, 1),
        sensor=in_ticks(p.watchdog.sensor_s, tick_s),
        encoder=in_ticks(p.watchdog.encoder_s, tick_s),
        drive=in_ticks(p.watchdog.drive_s, tick_s),
        enable=in_ticks(p.watchdog.enable_s, tick_s),
        monitors=zeroed(
            MonitorTicks,
            estimate_invalid=in_ticks(p.limit.estimate_s, tick_s),
            load_implausible=in_ticks(monitors.IMPLAUSIBLE_S, tick_s),
            runaway=in_ticks(monitors.RUNAWAY_S, tick_s),
            stall=in_ticks(p.limit.stall_s, tick_s),
        ),
        standstill=in_ticks(p.limit.standstill_s, tick_s),
        takeover=in_ticks(p.limit.takeover_s, tick_s),
        repeat=in_ticks(drive_link.REPEAT_S, tick_s, 1),
        arm=in_ticks(drive_link.ARM_S, tick_s, 1),
        re_zero=in_ticks(drive_link.RE_ZERO_S, tick_s, 1),
        proof_due=in_ticks(watchdog_proof.WATCHDOG_S, tick_s) + 2,
        proof_longest=in_ticks(watchdog_proof.LONGEST_S, tick_s),
        gait=in_ticks(p.watchdog.gait_s, tick_s),
        catch_up=in_ticks(LONGEST_CATCH_UP_S, tick_s),
        consent=in_ticks(p.watchdog.operator_s - consent.ARMING_S, tick_s, 1),
    )


def derive_module_constants(p: Parameters) -> Derived:
    """The constants that follow from parameters which never change over the bus; 0 for the others."""
    tick_s, mass_kg, restitution = p.control.tick_s, p.striker.mass_kg, p.stop.restitution
    stiffness_1_s2 = p.striker.spring_n_m / mass_kg
    damping_1_s = p.friction.b_n_s_m / mass_kg
    natural_rad_s = math.sqrt(stiffness_1_s2)
    delay_s = math.sqrt(2.0) / (TAU * p.sensor.bandwidth_hz)  # Butterworth, second order, at rest
    torque_n_m, inertia_kg_m2 = p.speed.torque_limit_n_m, p.motor.inertia_kg_m2
    spring_load_n_m = p.striker.spring_n_m * p.limit.stretch_m * p.drive.amplitude_m
    return zeroed(
        Derived,
        natural_rad_s=natural_rad_s,
        stiffness_1_s2=stiffness_1_s2,
        damping_1_s=damping_1_s,
        dry_m_s2=p.friction.mu * STANDARD_GRAVITY_M_S2,
        sensor_delay_s=delay_s,
        tracker=Tracker(0.0, (0.0, 0.0, 0.0), 0.0),
        own_tracker=crank.tracker_of(
            own_crank.BANDWIDTH_RAD_S, own_crank.LARGEST_SHARE * torque_n_m / inertia_kg_m2, tick_s
        ),
        flight=striker_model.free_flight(stiffness_1_s2, damping_1_s, tick_s),
        strapdown=striker_model.strapdown(tick_s),
        # a_d = a − τ a',  a = −(c/m) (x − …) − (b/m) x',  a' = −(c/m) (x' − x_A') − (b/m) a
        row=Row(
            x=-stiffness_1_s2 * (1.0 + delay_s * damping_1_s),
            v=-damping_1_s * (1.0 + delay_s * damping_1_s) + delay_s * stiffness_1_s2,
            b=1.0,
        ),
        contact_growth=stop_model.contact_growth(mass_kg, p.stop.contact_s, restitution),
        implausible_rad_s2=monitors.IMPLAUSIBLE_SHARE * torque_n_m / inertia_kg_m2,
        largest_load_n_m=min(spring_load_n_m, own_crank.LOAD_SHARE * torque_n_m),
        spin_down_highest_rad_s=min(1.5 * natural_rad_s, 0.97 * p.limit.speed_rad_s),
        ticks=ticks_of(p),
        gate=derive_gate_limits(p),
    )


def derive_tuning_constants(p: Parameters, d: Derived) -> Derived:
    """`d` with the constants that follow from tuning parameters."""
    tick_s = p.control.tick_s
    spin_down_s = p.spin_down.longest_s if p.gait.follow > 0 else 0.0
    stop_ticks = in_ticks(max(p.start.stop_s, spin_down_s) + monitors.STOP_MARGIN_S, tick_s)
    return d._replace(
        tracker=crank.tracker_of(p.crank.bandwidth_rad_s, p.crank.largest_disturbance_rad_s2, tick_s),
        high_offset_rate=min(tick_s / p.sensor.high_offset_s, 1.0),
        housing_rate=min(tick_s / p.sensor.housing_offset_s, 1.0),
        learning_rate=min(tick_s / p.estimator.model_learning_s, 1.0),
        readings_as_one=max(p.estimator.model_memory_s / tick_s, 1.0),
        highest_phase_rad=math.radians(p.hold.highest_phase_deg),
        spin_down_s=spin_down_s,
        ticks=d.ticks._replace(
            still=in_ticks(p.estimator.still_s, tick_s),
            gated=in_ticks(p.estimator.gate_s, tick_s),
            refractory=in_ticks(p.detector.refractory_s, tick_s),
            monitors=d.ticks.monitors._replace(stop_failed=stop_ticks),
        ),
    )


def config_of(parameters: Parameters, damaged: bool) -> Config:
    """The configuration for parameters within their bounds; `damaged`: see `Config`."""
    d = derive_tuning_constants(parameters, derive_module_constants(parameters))
    return Config(parameters.control.tick_s, parameters, d, damaged)


def commit(config: Config, parameters: Parameters) -> Config:
    """The configuration with other tuning parameters; damaged ones remain marked as damaged."""
    return config._replace(p=parameters, d=derive_tuning_constants(parameters, config.d))
