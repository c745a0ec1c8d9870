import math

import numpy as np
import pytest

from firmware_py.core.config import commit, config_of
from firmware_py.core.estimation import stop_model
from firmware_py.interface import parameter_table
from firmware_py.interface.enums import Mode, XcpError
from firmware_py.interface.parameter_table import INDEX, TABLE
from firmware_py.node.calibration import calibrate
from firmware_py.node.memory import pool_of
from firmware_py.node.xcp import (
    ADDRESS,
    COMMIT,
    ELEMENT_BYTES,
    ERROR,
    LOW,
    PACKET,
    REQUEST,
    VALUE,
    WRITE,
)
from firmware_py.shell import parameters
from firmware_py.shell.parameters import DEFAULTS, ParameterError, config_from, round_to_float32
from plant_sim.parts.restitution import hertz_stiffness, hunt_crossley_dissipation


def test_the_table_is_in_itself_consistent() -> None:
    assert len({p.name for p in TABLE}) == len(TABLE)
    for parameter in TABLE:
        assert parameter.low < parameter.high, parameter.name
        assert parameter.low <= parameter.default <= parameter.high, parameter.name
        assert parameter.meaning
        assert parameter.unit
        block, _, name = parameter.name.partition(".")
        assert block
        assert name
        assert TABLE[INDEX[parameter.name]] is parameter


def test_the_defaults_are_table_1_at_20_mm() -> None:
    config = config_from({})
    assert config.nominal.natural_rad_s == pytest.approx(9.354, abs=1e-3)
    assert config.p.stop.position_m - config.p.striker.rest_length_m == pytest.approx(0.06)
    assert config.p.drive.amplitude_m == 0.02
    assert config.tick_s == 0.001


@pytest.mark.parametrize("overrides", [{"stop.restitution": 0.4}, {"stop": {"restitution": 0.4}}])
def test_overrides_by_dotted_name_or_table(overrides: dict) -> None:
    assert config_from(overrides).p.stop.restitution == 0.4


def test_whole_numbers_are_taken_as_floats() -> None:
    assert config_from({"start.rise_s": 4}).p.start.rise_s == 4.0


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        ({"stop.restitutoin": 0.4}, ["stop.restitutoin", "stop.restitution"]),
        ({"stop.restitution": 1.5}, ["stop.restitution", "1.5", "0 to 1"]),
        ({"striker.mass_kg": -0.8}, ["striker.mass_kg", "-0.8"]),
        ({"striker.mass_kg": math.nan}, ["striker.mass_kg", "nan"]),
        ({"striker.mass_kg": math.inf}, ["striker.mass_kg", "inf"]),
        ({"striker.mass_kg": "0.8"}, ["striker.mass_kg", "'0.8'", "no number"]),
        ({"striker.mass_kg": True}, ["striker.mass_kg", "True", "no number"]),
        ({"start.attempts": 1.5}, ["start.attempts", "1.5", "whole"]),
        ({"limit.lowest_v": 40.0}, ["limit.lowest_v", "limit.highest_v"]),
        ({"nonsense": 1.0}, ["nonsense"]),
    ],
)
def test_what_is_wrong_is_refused_and_named(overrides: dict, words: list[str]) -> None:
    with pytest.raises(ParameterError) as error:
        config_from(overrides)
    for word in words:
        assert word in str(error.value)


def test_bounds_hold_on_both_sides_and_every_bound_gives_a_configuration() -> None:
    for name, bound, step in ((p.name, *side) for p in TABLE for side in ((p.low, -1.0), (p.high, 1.0))):
        beyond = bound + step * max(abs(bound) * 1e-6, 1e-6)
        with pytest.raises(ParameterError, match=name):
            parameters.check_value(name, beyond)
        assert parameters.check_value(name, bound) == bound
        config = config_of(parameters.parameters_of(DEFAULTS | {name: bound}), False)
        assert config.tick_s > 0.0


@pytest.mark.parametrize("restitution", [0.05, 0.3, 0.5, 0.9, 1.0])
def test_the_nominal_contact_is_that_of_the_plants_stop(restitution: float) -> None:
    """Whose law is held to integrations of an impact; a(t) = K (1 + d) (v t)^1.5 / m at its start."""
    dissipation = hunt_crossley_dissipation(restitution)
    assert stop_model.hertz_dissipation(restitution) == pytest.approx(dissipation, rel=1e-9, abs=1e-9)
    stiffness = hertz_stiffness(0.8, 0.010, stop_model.REFERENCE_M_S)
    growth = stop_model.contact_growth(0.8, 0.010, restitution)
    assert growth == pytest.approx(stiffness / 0.8 * (1.0 + dissipation), rel=1e-4)


def test_a_stop_that_returns_less_is_left_deeper() -> None:
    """Down to one that returns nothing: its force is over before the striker turns round."""
    restitutions = [0.0, 1e-4, 5e-4, 1e-3, 0.05, 0.3, 0.5, 0.9, 1.0]
    depths_m = [stop_model.depth_at_end_m(0.010, one, stop_model.END_FRACTION) for one in restitutions]
    assert depths_m == sorted(depths_m, reverse=True)
    assert depths_m[0] == pytest.approx(stop_model.elastic_depth_m(0.010))


def test_a_parameter_file_comes_back() -> None:
    values = parameters.with_overrides({"stop.restitution": 0.43})
    assert parameters.parse_file(parameters.format_file(values)) == values


def test_a_parameter_file_has_nothing_of_the_build() -> None:
    """Those come from the build, whatever the file was written with."""
    quick = {"control.tick_s": 0.0005}
    text = parameters.format_file(parameters.with_overrides(quick))
    assert "tick_s" not in text
    assert parameters.parse_file(text)["control.tick_s"] == 0.001
    assert parameters.parse_file(text, quick)["control.tick_s"] == 0.0005
    with pytest.raises(ParameterError, match=r"control.tick_s is settled by the build"):
        parameters.parse_file(text + "\n[control]\ntick_s = 0.00025\n")


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace("0.43", "0.44"),
        lambda text: text.replace("restitution = 0.43\n", ""),
        lambda text: text.replace("restitution", "restituton"),
        lambda text: text[: len(text) // 2] + "=",
        lambda text: text.replace("checksum", "sum"),
    ],
)
def test_a_damaged_file_is_refused(damage) -> None:
    text = parameters.format_file(parameters.with_overrides({"stop.restitution": 0.43}))
    with pytest.raises(ParameterError):
        parameters.parse_file(damage(text))


def test_a_parameter_file_of_one_long_key_is_refused_before_it_fills_the_memory() -> None:
    """A text of 9 KB would take 8 GB."""
    with pytest.raises(ParameterError, match="nested more than 8 deep"):
        parameters.parse_file(f"{'.'.join('a' * 4500)} = 1\n")


def next_on_the_bus(value: float) -> float:
    """The next larger float32, the precision in which bounds are compared."""
    return float(np.nextafter(np.float32(value), np.float32(np.inf)))


def write(values: dict[str, float], name: str, value: float) -> tuple[dict[str, float], XcpError]:
    """The values in use after a write over the bus at rest and its commit; NONE, or why it was refused."""
    pool, error = pool_of(list(values.values())), XcpError.NONE
    config = config_of(parameters.parameters_of(values), False)
    bits = int(np.float32(value).view(np.uint32))
    for place, word in ((INDEX[name], bits), (COMMIT, 1)):
        pool[ADDRESS], pool[REQUEST], pool[VALUE] = ELEMENT_BYTES * place, WRITE, word
        config = calibrate(pool, config, Mode.READY)
        if pool[PACKET] == ERROR and error is XcpError.NONE:
            error = XcpError(pool[LOW])
    return parameters.values_of(config.p), error


@pytest.mark.parametrize("parameter", TABLE, ids=lambda p: p.name)
def test_only_tuning_parameters_are_written_and_within_their_bounds(
    parameter: parameter_table.Parameter,
) -> None:
    """A write changes its own value alone. The bus carries a float32: 0.8 arrives as 0.800000012."""
    name = parameter.name
    assert DEFAULTS[name] == parameter.default
    if not parameter.is_calibrated:
        for wanted in (parameter.low, parameter.default, parameter.high):
            assert write(DEFAULTS, name, wanted) == (DEFAULTS, XcpError.WRITE_PROTECTED)
        return
    assert write(DEFAULTS, name, parameter.default) == (DEFAULTS, XcpError.NONE)
    for wanted in (math.nan, math.inf, -math.inf, next_on_the_bus(parameter.high)):
        assert write(DEFAULTS, name, wanted) == (DEFAULTS, XcpError.OUT_OF_RANGE)
    for bound in (parameter.low, parameter.high):
        value = round_to_float32(bound)
        assert parameters.check_value(name, value) == value
        expected = DEFAULTS | {name: value}, XcpError.NONE
        try:
            parameters.refuse_conflicts(expected[0])
        except ParameterError:
            expected = DEFAULTS, XcpError.OUT_OF_RANGE
        assert write(DEFAULTS, name, value) == expected


@pytest.mark.parametrize("follow", [0, 1])
def test_a_commit_derives_every_constant_anew_that_follows_from_tuning(follow: int) -> None:
    """What a commit keeps does not depend on the parameter."""
    before = parameters.parameters_of(DEFAULTS | {"gait.follow": follow})
    written = [(p.name, value) for p in TABLE if p.is_calibrated for value in (p.low, p.high)]
    for name, value in written:
        after = parameters.parameters_of(DEFAULTS | {"gait.follow": follow, name: value})
        assert commit(config_of(before, True), after) == config_of(after, True), (name, value)
    assert len(written) > 100


@pytest.mark.parametrize("parameter", [p for p in TABLE if p.at_most], ids=lambda p: p.name)
def test_no_parameter_is_written_above_its_ceiling(parameter: parameter_table.Parameter) -> None:
    """By the bus or by a file: torque, current, speed and watchdogs end at the build's numbers."""
    assert parameter.at_most is not None
    above = next_on_the_bus(DEFAULTS[parameter.at_most])
    error = XcpError.OUT_OF_RANGE if parameter.is_calibrated else XcpError.WRITE_PROTECTED
    assert write(DEFAULTS, parameter.name, above) == (DEFAULTS, error)
    with pytest.raises(ParameterError, match=parameter.at_most):
        parameters.parse_file(parameters.format_file(DEFAULTS | {parameter.name: above}))


def test_torque_current_speed_and_watchdogs_have_ceilings() -> None:
    bounded = {p.name for p in TABLE if p.at_most and p.at_most.startswith("ceiling.")}
    watchdogs = {p.name for p in TABLE if p.name.startswith("watchdog.")} - {
        "watchdog.enable_s",
        "watchdog.proof_required",
    }
    limits = {"speed.torque_limit_n_m", "speed.current_limit_a", "limit.current_a"}
    limits |= {"limit.force_n", "limit.impulse_n_s"}
    limits |= {"limit.inverter_degc", "limit.motor_degc", "limit.highest_v"}
    speeds = {"limit.overspeed_rad_s", "limit.drive_speed_rad_s"}
    assert watchdogs | limits | speeds == bounded


def test_a_refusal_names_the_unit_of_what_has_one() -> None:
    with pytest.raises(
        ParameterError, match=r"^start.rise_s = -1 s is out of bounds; give a value from 0.1 to 100 s$"
    ):
        config_from({"start.rise_s": -1})
    with pytest.raises(
        ParameterError, match=r"^stop.restitution = 7 is out of bounds; give a value from 0 to 1$"
    ):
        config_from({"stop.restitution": 7})


@pytest.mark.parametrize(
    ("values", "sentence"),
    [
        ({"start.rise_s": 40.0}, r"a start takes up to 44\.\d s .*start.rise_s = 40 s.* fails after 29 s"),
        ({"start.rise_s": 20.0, "start.approach_s": 15.0}, "a start takes up to .*start.approach_s = 15 s"),
        ({"start.confirm_periods": 40}, "a start takes up to .*start.confirm_periods = 40"),
        ({"striker.spring_n_m": 2.0}, "a recovery takes 43.3 s"),
        ({"start.again_s": 27.0}, r"a recovery takes .*start.again_s = 27 s.* fails after 29 s; lower"),
        ({"start.dwell_periods": 40}, "a recovery takes .*start.dwell_periods = 40"),
        (
            {"striker.spring_n_m": 300.0},
            "start.highest_ratio = 1.45 is a speed of 28.1 rad/s.*limit.speed_rad_s = 20",
        ),
        ({"limit.speed_rad_s": 13.0}, "start.highest_ratio = 1.45 is a speed of 13.6 rad/s"),
        (
            {"start.lowest_ratio": 0.1},
            "start.lowest_ratio = 0.1 is a speed of 0.94 rad/s .*above 1 rad/s; raise",
        ),
        ({"start.dip_ratio": 0.1}, "start.dip_ratio = 0.1 is a speed of 0.94 rad/s"),
        (
            {"gait.follow": 1, "gait.lowest_ratio": 0.1, "gait.margin": 0.01},
            "gait.lowest_ratio - gait.margin = 0.09 is a speed of 0.84 rad/s",
        ),
        ({"gait.follow": 1, "gait.highest_ratio": 1.31}, "gait.highest_ratio = 1.31 with gait.margin = 0.02"),
    ],
)
def test_bounds_that_fit_together_are_checked_together(values: dict[str, float], sentence: str) -> None:
    """Each value is within its own bounds, but a module without any fault would fail."""
    with pytest.raises(ParameterError, match=sentence):
        config_from(values)
    for name, value in values.items():
        assert parameters.check_value(name, value) == value


def test_all_that_does_not_fit_together_is_named_at_once_with_values_that_do() -> None:
    light = {"striker.mass_kg": 0.3, "watchdog.sensor_s": 0.06}
    with pytest.raises(ParameterError) as refused:
        config_from(light)
    ceiling, ratio, force = str(refused.value).splitlines()
    assert ceiling.startswith("watchdog.sensor_s = 0.06 exceeds ceiling.sensor_watchdog_s")
    assert ratio.endswith("lower the ratio to 1.309, or raise the limit")
    assert force.endswith("lower the limit to 573 N")
    config_from({"striker.mass_kg": 0.3, "start.highest_ratio": 1.309, "limit.force_n": 573})


def test_a_start_of_29_s_may_still_be_asked_for() -> None:
    config_from({"start.rise_s": 24.0})


def test_a_force_limit_that_the_sensor_cannot_show_is_refused() -> None:
    """0.98 of 1961 m/s² less the offset of 10 m/s² on 0.8 kg: 1529.7 N."""
    for name, good, bad in (
        ("striker.mass_kg", 0.79, 0.78),
        ("sensor.high_full_scale_m_s2", 1930.0, 1920.0),
        ("sensor.high_offset_m_s2", 47.0, 48.0),
    ):
        config_from({name: good})
        with pytest.raises(ParameterError, match=r"limit.force_n = 1500 N exceeds the 1[45]\d+"):
            config_from({name: bad})
    assert config_from({"striker.mass_kg": 0.5, "limit.force_n": 900.0}).gate.peak_m_s2 == 1800.0


def test_a_parameter_may_equal_its_ceiling_as_a_float32() -> None:
    values = DEFAULTS
    for name, ceiling in (
        ("speed.torque_limit_n_m", "ceiling.torque_n_m"),
        ("watchdog.sensor_s", "ceiling.sensor_watchdog_s"),
    ):
        value = round_to_float32(values[ceiling])
        assert value > values[ceiling]
        assert parameters.with_overrides({name: value})[name] == value
        with pytest.raises(ParameterError):
            parameters.with_overrides({name: 1.0001 * value})


def test_a_firmware_that_may_meet_a_real_drive_requires_the_test_of_its_watchdog() -> None:
    assert parameters.require_proof({"start": {"rise_s": 2.0}}) == {
        "watchdog.proof_required": 1.0,
        "start.rise_s": 2.0,
    }
    for chosen in ({"watchdog": {"proof_required": 0}}, {"watchdog.proof_required": 0}):
        assert parameters.require_proof(chosen) == {"watchdog.proof_required": 0}
    assert write(DEFAULTS, "watchdog.proof_required", 1.0)[1] is XcpError.WRITE_PROTECTED
    with pytest.raises(ParameterError, match="settled by the build"):
        parameters.check_in_file("watchdog.proof_required", 0.0)
