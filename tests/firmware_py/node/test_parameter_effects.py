"""Every parameter alone: which derived constants follow from it, with all others distinct.

Two parameters with one default can be swapped unseen. Here no two values are equal, each parameter in turn
changes alone, and the constants that change are those of the table `EFFECTS`; the durations among them are
its own, in ticks. The effect of a parameter that the blocks read themselves is in
`tests/hil/nodes/test_parameters_in_the_loop.py`.
"""

from typing import Any

import pytest

from firmware_py.core.config import commit, config_of
from firmware_py.core.conflicts import Conflict, conflict_of
from firmware_py.core.safety.consent import ARMING_S
from firmware_py.interface.generated import parameters as tables
from firmware_py.interface.parameter_table import TABLE, Parameter
from firmware_py.shell.parameters import DEFAULTS, ParameterError, parameters_of, with_overrides

DISTINCT = {
    "watchdog.encoder_s": 0.031,
    "watchdog.sensor_s": 0.037,
    "watchdog.frozen_s": 0.023,
    "watchdog.drive_s": 0.31,
    "watchdog.operator_s": 0.34,
    "watchdog.gait_s": 0.19,
    "watchdog.enable_s": 0.91,
    "limit.overcurrent_s": 0.017,
    "limit.voltage_s": 0.14,
    "limit.estimate_s": 1.1,
    "limit.stall_s": 0.82,
    "limit.standstill_s": 0.29,
    "limit.takeover_s": 0.51,
    "estimator.still_s": 0.033,
    "estimator.gate_s": 0.026,
    "detector.refractory_s": 0.006,
    "gait.follow": 1.0,
    "spin_down.longest_s": 2.1,
    "limit.current_a": 11.5,
}
"""Values that differ from the defaults, so that no two durations are equal."""


def changed(parameter: Parameter) -> float:
    """Another value of a parameter, which no other parameter contradicts."""
    value = DISTINCT.get(parameter.name, parameter.default)
    for other in (
        value * 1.1,
        value * 0.9,
        value + 1.0,
        value - 1.0,
        value + 0.05,
        parameter.high,
        parameter.low,
    ):
        candidate = float(round(other)) if parameter.whole else other
        try:
            with_overrides(DISTINCT | {parameter.name: candidate})
        except ParameterError:
            continue
        if candidate != value:
            return candidate
    raise AssertionError(f"{parameter.name}: no other value")


def derived(record: Any, prefix: str = "") -> dict[str, Any]:
    """The blocks' constants by dotted name, without tables of parameters."""
    found: dict[str, Any] = {}
    for name, value in zip(record._fields, record, strict=True):
        is_copy = type(value).__module__ == tables.__name__
        if hasattr(value, "_fields") and not is_copy:
            found |= derived(value, f"{prefix}{name}.")
        elif not is_copy:
            found[f"{prefix}{name}"] = value
    return found


def effects_of(parameter: Parameter) -> set[str]:
    """The derived constants that another value of this parameter alone changes."""
    before = derived(config_of(parameters_of(DEFAULTS | DISTINCT), False))
    alone = DEFAULTS | DISTINCT | {parameter.name: changed(parameter)}
    after = derived(config_of(parameters_of(alone), False))
    return {name for name in before if before[name] != after[name]}


EFFECTS = {
    "striker.mass_kg": (
        "gait.natural_rad_s gate.change_m_s gate.peak_m_s2 nominal.damping_1_s nominal.flight.v_v "
        "nominal.flight.v_x nominal.flight.x_v nominal.flight.x_x nominal.natural_rad_s nominal.row.v "
        "nominal.row.x nominal.stiffness_1_s2 own_crank.mass_kg"
    ),
    "striker.spring_n_m": (
        "gait.natural_rad_s nominal.flight.v_v nominal.flight.v_x nominal.flight.x_v "
        "nominal.flight.x_x nominal.natural_rad_s nominal.row.v nominal.row.x nominal.stiffness_1_s2 "
        "own_crank.largest_load_n_m"
    ),
    "drive.amplitude_m": "own_crank.amplitude_m own_crank.largest_load_n_m",
    "friction.b_n_s_m": (
        "nominal.damping_1_s nominal.flight.v_v nominal.flight.v_x nominal.flight.x_v "
        "nominal.flight.x_x nominal.row.v nominal.row.x"
    ),
    "friction.mu": "nominal.dry_m_s2",
    "stop.restitution": "nominal.contact_growth nominal.end_depth_m",
    "stop.contact_s": "nominal.contact_growth nominal.contact_ticks nominal.end_depth_m",
    "crank.zero_rad": "crank.zero_rad own_crank.crank.zero_rad",
    "crank.bandwidth_rad_s": "crank.tracker.bandwidth_rad_s crank.tracker.gains",
    "crank.largest_disturbance_rad_s2": "crank.tracker.largest_rad_s2",
    "sensor.low_full_scale_m_s2": "estimator.sensing.low_full_scale_m_s2 gate.low_clipped_m_s2",
    "sensor.high_full_scale_m_s2": "estimator.sensing.high_full_scale_m_s2 gate.clipped_m_s2",
    "sensor.housing_weight": "estimator.sensing.housing_weight",
    "sensor.high_offset_m_s2": "gate.differ_m_s2",
    "sensor.bandwidth_hz": "nominal.row.v nominal.row.x nominal.sensor_delay_s",
    "sensor.high_offset_s": "estimator.sensing.high_offset_rate",
    "sensor.housing_offset_s": "estimator.sensing.housing_rate",
    "estimator.velocity_noise_m_s": "estimator.flight_noise.vv",
    "estimator.model_learning_s": "estimator.learning_rate",
    "estimator.model_memory_s": "estimator.readings_as_one",
    "estimator.still_s": "estimator.still_ticks",
    "estimator.gate_s": "estimator.gated_ticks",
    "detector.floor_m_s2": "detector.floor_m_s2",
    "detector.refractory_s": "detector.refractory_ticks",
    "motor.inertia_kg_m2": "monitors.implausible_rad_s2 own_crank.crank.tracker.largest_rad_s2",
    "speed.torque_limit_n_m": (
        "crank.torque_limit_n_m gate.torque_n_m monitors.implausible_rad_s2 "
        "own_crank.crank.torque_limit_n_m own_crank.crank.tracker.largest_rad_s2"
    ),
    "limit.speed_rad_s": "gate.speed_rad_s",
    "limit.overspeed_rad_s": "gate.overspeed_rad_s",
    "limit.current_a": "gate.current_a",
    "limit.inverter_degc": "gate.inverter_degc",
    "limit.motor_degc": "gate.motor_degc",
    "limit.lowest_degc": "gate.lowest_degc",
    "limit.lowest_v": "gate.lowest_v",
    "limit.highest_v": "gate.highest_v",
    "limit.impulse_n_s": "gate.change_m_s",
    "limit.overcurrent_s": "gate.overcurrent_ticks",
    "limit.voltage_s": "gate.voltage_ticks",
    "limit.estimate_s": "monitors.longest.estimate_invalid",
    "limit.stall_s": "monitors.longest.stall",
    "limit.standstill_s": "monitors.standstill_ticks",
    "limit.force_n": "gate.peak_m_s2",
    "limit.stretch_m": "own_crank.largest_load_n_m",
    "limit.takeover_s": "monitors.takeover_ticks",
    "watchdog.sensor_s": "gate.sensor_ticks monitors.sensor_ticks",
    "watchdog.encoder_s": "gate.encoder_ticks monitors.encoder_ticks",
    "watchdog.drive_s": "drive_link.silent_ticks gate.drive_ticks proof.silent_ticks",
    "watchdog.operator_s": "consent.repeated_ticks consent.silent_ticks gate.operator_ticks",
    "watchdog.frozen_s": "gate.frozen_ticks",
    "watchdog.enable_s": "monitors.enable_ticks",
    "watchdog.gait_s": "gait.silent_ticks gate.gait_ticks",
    "watchdog.proof_required": "proof.is_required",
    "hold.impulse_slope_n_s": "gait.impulse_slope_n_s",
    "gait.follow": "gate.reads_gait monitors.longest.stop_failed",
    "spin_down.longest_s": "monitors.longest.stop_failed",
}
"""The derived constants of each parameter that has some; the control period alone has too many to list."""
DURATIONS = {
    name: [
        constant for constant in constants.split() if constant.endswith("_ticks") or ".longest." in constant
    ]
    for name, constants in EFFECTS.items()
    if name.endswith("_s") and name not in ("stop.contact_s", "spin_down.longest_s")
}
LIMITS = {
    name: constant
    for name, constants in EFFECTS.items()
    for constant in constants.split()
    if constant.startswith("gate.") and constant.split(".")[1] == name.split(".")[1]
}


@pytest.mark.parametrize("parameter", TABLE, ids=lambda parameter: parameter.name)
def test_a_parameter_alone_changes_its_own_constants(parameter: Parameter) -> None:
    effects = effects_of(parameter)
    if parameter.name == "control.tick_s":
        assert {name for name in effects if name.endswith("_ticks")} >= {
            "gate.sensor_ticks",
            "gate.drive_ticks",
        }
    else:
        assert effects == set(EFFECTS.get(parameter.name, "").split())


def test_no_two_durations_are_equal_and_each_constant_is_that_of_its_parameter() -> None:
    values = DEFAULTS | DISTINCT
    found = derived(config_of(parameters_of(values), False))
    ticks = {name: round(values[name] / 1e-3) for name, constants in DURATIONS.items() if constants}
    assert len(set(ticks.values())) == len(ticks) >= 16
    for name, own_ticks in ticks.items():
        for constant in DURATIONS[name]:
            less = round(1000 * ARMING_S) if constant == "consent.repeated_ticks" else 0
            assert found[constant] == own_ticks - less, (name, constant)
    for name, constant in LIMITS.items():
        assert found[constant] == values[name], (name, constant)
    assert len(LIMITS) >= 8


def test_a_commit_changes_the_constants_of_tuning_parameters_as_a_power_up_does() -> None:
    config = config_of(parameters_of(DEFAULTS | DISTINCT), False)
    for parameter in TABLE:
        if not parameter.is_calibrated:
            continue
        p = parameters_of(DEFAULTS | DISTINCT | {parameter.name: changed(parameter)})
        assert conflict_of(p) == Conflict.NONE
        committed, anew = derived(commit(config, p)), derived(config_of(p, False))
        assert committed == anew, parameter.name
