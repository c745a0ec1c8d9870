import ast
import math

import pytest
from compiled_calls import as_compiled

from firmware_py.core import parameter_values
from firmware_py.core.configure import config_of
from firmware_py.core.estimation import detector
from firmware_py.core.parameters import read_parameter, write_parameter
from firmware_py.interface.enums import ParameterStatus, ParameterTier
from firmware_py.interface.sources import parameter_table
from firmware_py.interface.sources.parameter_table import INDEX, TABLE
from firmware_py.shell import parameters
from firmware_py.shell.parameters import DEFAULTS, ParameterError, config_from


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
    assert config.start.natural_rad_s == pytest.approx(9.354, abs=1e-3)
    assert config.estimator.striker.stop_m - config.estimator.striker.rest_length_m == pytest.approx(0.06)
    assert config.speed.load.amplitude_m == 0.02
    assert config.tick_s == 0.001


@pytest.mark.parametrize("overrides", [{"stop.restitution": 0.4}, {"stop": {"restitution": 0.4}}])
def test_overrides_by_dotted_name_or_table(overrides: dict) -> None:
    assert config_from(overrides).estimator.striker.restitution == 0.4


def test_whole_numbers_are_taken_as_floats() -> None:
    assert config_from({"start.rise_s": 4}).start.rise_s == 4.0


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


@pytest.mark.parametrize("parameter", TABLE, ids=lambda p: p.name)
def test_bounds_hold_on_both_sides_and_every_bound_gives_a_configuration(
    parameter: parameter_table.Parameter,
) -> None:
    for bound, step in ((parameter.low, -1.0), (parameter.high, 1.0)):
        beyond = bound + step * max(abs(bound) * 1e-6, 1e-6)
        with pytest.raises(ParameterError):
            parameters.checked(parameter.name, beyond)
        assert parameters.checked(parameter.name, bound) == bound
        config = config_of(parameters.parameters_of(DEFAULTS | {parameter.name: bound}), False)
        assert config.tick_s > 0.0


@pytest.mark.parametrize("restitution", [0.0, 0.05, 0.3, 0.5, 0.9, 1.0])
def test_hunt_crossley_gives_back_the_restitution(restitution: float) -> None:
    """Integrate m v dv/dδ = −K δ^1.5 (1 + λ v) in closed form: the loading and unloading areas are equal."""
    d = detector.hertz_dissipation(restitution)
    if restitution in (0.0, 1.0):
        assert d >= 0.0
        return
    low, high = 0.0, 1.0
    loading = d - math.log1p(d)
    for _ in range(100):
        k = 0.5 * (low + high)
        unloading = -k * d - math.log1p(-k * d) if k * d < 1.0 else math.inf
        low, high = (k, high) if unloading < loading else (low, k)
    assert k == pytest.approx(restitution, rel=1e-6)


def test_the_start_of_a_contact_is_hertz() -> None:
    """10 ms at 0.9 m/s: integrate the elastic contact and time it."""
    growth = detector.contact_growth(0.8, 0.010, 1.0)
    x, v, t, h = 0.0, 0.9, 0.0, 1e-6
    while x >= 0.0:
        v -= h * growth * max(x, 0.0) ** 1.5
        x += h * v
        t += h
    assert t == pytest.approx(0.010, rel=2e-3)


def test_a_parameter_file_comes_back() -> None:
    values = parameters.with_overrides({"stop.restitution": 0.43})
    assert parameters.read_back(parameters.written(values)) == values


def test_a_parameter_file_has_nothing_of_the_build() -> None:
    """Those come from the build, whatever the file was written with."""
    quick = {"control.tick_s": 0.0005}
    text = parameters.written(parameters.with_overrides(quick))
    assert "tick_s" not in text
    assert parameters.read_back(text)["control.tick_s"] == 0.001
    assert parameters.read_back(text, quick)["control.tick_s"] == 0.0005
    with pytest.raises(ParameterError, match=r"control.tick_s is settled by the build"):
        parameters.read_back(text + "\n[control]\ntick_s = 0.00025\n")


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
    text = parameters.written(parameters.with_overrides({"stop.restitution": 0.43}))
    with pytest.raises(ParameterError):
        parameters.read_back(damage(text))


def test_the_checked_in_values_are_those_of_the_table() -> None:
    written = ast.parse(parameter_table.TARGET.read_text(encoding="utf-8"))
    assert ast.dump(written) == ast.dump(ast.parse(parameter_table.source()))


@pytest.mark.parametrize("parameter", TABLE, ids=lambda p: p.name)
def test_every_parameter_is_read_and_written_by_its_index(parameter: parameter_table.Parameter) -> None:
    """Of the build none is written; of the others only their own value changes, and only within bounds."""
    before, index = parameter_values.DEFAULTS, INDEX[parameter.name]
    value, tier, status = read_parameter(before, index)
    assert (value, tier, status) == (parameter.default, parameter.tier, ParameterStatus.OK)
    if parameter.tier is ParameterTier.BUILD:
        for wanted in (parameter.low, parameter.default, parameter.high):
            assert write_parameter(before, index, wanted) == (before, ParameterStatus.NOT_WRITABLE)
        return
    assert write_parameter(before, index, parameter.default) == (before, ParameterStatus.OK)
    for wanted in (math.nan, math.inf, -math.inf, math.nextafter(parameter.high, math.inf)):
        assert write_parameter(before, index, wanted) == (before, ParameterStatus.OUT_OF_RANGE)
    after, status = write_parameter(before, index, parameter.low)
    if status is ParameterStatus.OK:
        assert after == before._replace(**{parameter.field: parameter.low})


def test_an_index_that_is_none() -> None:
    before = parameter_values.DEFAULTS
    for index in (-1, len(TABLE), 16383):
        assert read_parameter(before, index) == (0.0, ParameterTier.MODULE, ParameterStatus.UNKNOWN_INDEX)
        assert write_parameter(before, index, 1.0) == (before, ParameterStatus.UNKNOWN_INDEX)


@pytest.mark.parametrize("parameter", [p for p in TABLE if p.at_most], ids=lambda p: p.name)
def test_no_parameter_is_written_above_its_ceiling(parameter: parameter_table.Parameter) -> None:
    """By the bus or by a file: torque, current, speed and watchdogs end at the build's numbers."""
    before = parameter_values.DEFAULTS
    assert parameter.at_most is not None
    ceiling = getattr(before, parameter.at_most.replace(".", "_"))
    at, status = write_parameter(before, INDEX[parameter.name], ceiling)
    assert status is ParameterStatus.OK
    above = math.nextafter(ceiling, math.inf)
    assert write_parameter(at, INDEX[parameter.name], above) == (at, ParameterStatus.OUT_OF_RANGE)
    with pytest.raises(ParameterError, match=parameter.at_most):
        parameters.read_back(parameters.written(DEFAULTS | {parameter.name: above}))


def test_torque_current_speed_and_watchdogs_have_ceilings() -> None:
    bounded = {p.name for p in TABLE if p.at_most and p.at_most.startswith("ceiling.")}
    watchdogs = {p.name for p in TABLE if p.name.startswith("watchdog.")} - {"watchdog.enable_s"}
    limits = {"speed.torque_limit_n_m", "speed.current_limit_a", "limit.current_a"}
    speeds = {"limit.overspeed_rad_s", "limit.drive_speed_rad_s"}
    assert watchdogs | limits | speeds == bounded


def test_interpreted_and_compiled_write_and_configure_alike() -> None:
    before = parameter_values.DEFAULTS
    compiled_write, compiled_config = as_compiled(write_parameter), as_compiled(config_of)
    for index in range(-1, parameter_values.COUNT + 1):
        after, status = write_parameter(before, index, 0.5)
        other_after, other_status = compiled_write(before, index, 0.5)
        assert (other_after, other_status) == (after, status), index
    assert repr(compiled_config(before, False)) == repr(config_of(before, False))


def test_a_refusal_names_the_unit_of_what_has_one() -> None:
    with pytest.raises(
        ParameterError, match=r"^start.rise_s = -1 s is out of bounds; give a value from 0.1 to 100 s$"
    ):
        config_from({"start.rise_s": -1})
    with pytest.raises(
        ParameterError, match=r"^stop.restitution = 7 is out of bounds; give a value from 0 to 1$"
    ):
        config_from({"stop.restitution": 7})
