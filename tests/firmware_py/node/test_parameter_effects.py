"""Every parameter alone: which derived constants follow from it, with all others distinct.

Two parameters with one default can be swapped unseen. Here no two values are equal, each parameter in turn
changes alone, and the constants that change are those of the table `EFFECTS`; the durations among them are
its own, in ticks. The effect of a parameter that the blocks read themselves is in
`tests/hil/nodes/test_parameter_effects.py`.
"""

import pytest
from records import leaves

from firmware_py.core.configure import commit, config_of
from firmware_py.core.conflicts import Conflict, conflict_of
from firmware_py.core.safety.consent import ARMING_S
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


def effects_of(parameter: Parameter) -> set[str]:
    """The derived constants that another value of this parameter alone changes."""
    before = leaves(config_of(parameters_of(DEFAULTS | DISTINCT), False).d)
    alone = DEFAULTS | DISTINCT | {parameter.name: changed(parameter)}
    after = leaves(config_of(parameters_of(alone), False).d)
    return {name for name in before if before[name] != after[name]}


EFFECTS = {
    "striker.mass_kg": (
        "damping_1_s flight.v_v flight.v_x flight.x_v flight.x_x gate.change_m_s gate.peak_m_s2 "
        "natural_rad_s row.v row.x spin_down_highest_rad_s stiffness_1_s2"
    ),
    "striker.spring_n_m": (
        "flight.v_v flight.v_x flight.x_v flight.x_x largest_load_n_m natural_rad_s row.v row.x "
        "spin_down_highest_rad_s stiffness_1_s2"
    ),
    "drive.amplitude_m": "largest_load_n_m",
    "friction.b_n_s_m": "damping_1_s flight.v_v flight.v_x flight.x_v flight.x_x row.v row.x",
    "friction.mu": "dry_m_s2",
    "stop.restitution": "contact_growth",
    "stop.contact_s": "contact_growth ticks.newton_contact",
    "crank.bandwidth_rad_s": "tracker.bandwidth_rad_s tracker.gains",
    "crank.largest_disturbance_rad_s2": "tracker.largest_rad_s2",
    "sensor.low_full_scale_m_s2": "gate.low_clipped_m_s2",
    "sensor.high_full_scale_m_s2": "gate.clipped_m_s2",
    "sensor.high_offset_m_s2": "gate.differ_m_s2",
    "sensor.bandwidth_hz": "row.v row.x sensor_delay_s",
    "sensor.high_offset_s": "high_offset_rate",
    "sensor.housing_offset_s": "housing_rate",
    "estimator.model_learning_s": "learning_rate",
    "estimator.model_memory_s": "readings_as_one",
    "estimator.still_s": "ticks.still",
    "estimator.gate_s": "ticks.gated",
    "detector.refractory_s": "ticks.refractory",
    "motor.inertia_kg_m2": "implausible_rad_s2 own_tracker.largest_rad_s2",
    "speed.torque_limit_n_m": "gate.torque_n_m implausible_rad_s2 own_tracker.largest_rad_s2",
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
    "limit.estimate_s": "ticks.monitors.estimate_invalid",
    "limit.stall_s": "ticks.monitors.stall",
    "limit.standstill_s": "ticks.standstill",
    "limit.force_n": "gate.peak_m_s2",
    "limit.stretch_m": "largest_load_n_m",
    "limit.takeover_s": "ticks.takeover",
    "watchdog.sensor_s": "gate.sensor_ticks ticks.sensor",
    "watchdog.encoder_s": "gate.encoder_ticks ticks.encoder",
    "watchdog.drive_s": "gate.drive_ticks ticks.drive",
    "watchdog.operator_s": "gate.operator_ticks ticks.consent",
    "watchdog.frozen_s": "gate.frozen_ticks",
    "watchdog.enable_s": "ticks.enable",
    "watchdog.gait_s": "gate.gait_ticks ticks.gait",
    "hold.highest_phase_deg": "highest_phase_rad",
    "gait.follow": "gate.gait_ticks spin_down_s ticks.monitors.stop_failed",
    "spin_down.longest_s": "spin_down_s ticks.monitors.stop_failed",
}
"""The derived constants of each parameter that has some; the control period alone has too many to list."""
DURATIONS = {
    name: [constant for constant in constants.split() if "ticks." in constant or constant.endswith("_ticks")]
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
    derived = leaves(config_of(parameters_of(values), False).d)
    ticks = {name: round(values[name] / 1e-3) for name, constants in DURATIONS.items() if constants}
    assert len(set(ticks.values())) == len(ticks) >= 16
    for name, own_ticks in ticks.items():
        for constant in DURATIONS[name]:
            less = round(1000 * ARMING_S) if constant == "ticks.consent" else 0
            assert derived[constant] == own_ticks - less, (name, constant)
    for name, constant in LIMITS.items():
        assert derived[constant] == values[name], (name, constant)
    assert len(LIMITS) >= 8


def test_a_commit_changes_the_constants_of_tuning_parameters_as_a_power_up_does() -> None:
    """But the durations and limits of the gate and the watchdogs keep those of the power-up."""
    config = config_of(parameters_of(DEFAULTS | DISTINCT), False)
    for parameter in TABLE:
        if not parameter.is_calibrated:
            continue
        p = parameters_of(DEFAULTS | DISTINCT | {parameter.name: changed(parameter)})
        assert conflict_of(p) == Conflict.NONE
        committed, anew = leaves(commit(config, p).d), leaves(config_of(p, False).d)
        differing = {name for name in committed if committed[name] != anew[name]}
        kept = {
            one for one in EFFECTS.get(parameter.name, "").split() if parameter.table in ("watchdog", "limit")
        }
        assert differing == kept - {"ticks.monitors.stop_failed"}, parameter.name
