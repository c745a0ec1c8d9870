import math
from pathlib import Path

import pytest

from firmware_py.shell import parameters
from firmware_py.shell.parameters import DEFAULTS, INDEX, TABLE, ParameterError, config_from


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
    parameter: parameters.Parameter,
) -> None:
    for bound, step in ((parameter.low, -1.0), (parameter.high, 1.0)):
        beyond = bound + step * max(abs(bound) * 1e-6, 1e-6)
        with pytest.raises(ParameterError):
            parameters.checked(parameter.name, beyond)
        assert parameters.checked(parameter.name, bound) == bound
        config = parameters.config_of(DEFAULTS | {parameter.name: bound})
        assert config.tick_s > 0.0


@pytest.mark.parametrize("restitution", [0.0, 0.05, 0.3, 0.5, 0.9, 1.0])
def test_hunt_crossley_gives_back_the_restitution(restitution: float) -> None:
    """Integrate m v dv/dδ = −K δ^1.5 (1 + λ v) in closed form: the loading and unloading areas are equal."""
    d = parameters.hertz_dissipation(restitution)
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
    growth = parameters.contact_growth(0.8, 0.010, 1.0)
    x, v, t, h = 0.0, 0.9, 0.0, 1e-6
    while x >= 0.0:
        v -= h * growth * max(x, 0.0) ** 1.5
        x += h * v
        t += h
    assert t == pytest.approx(0.010, rel=2e-3)


def test_saved_parameters_come_back(tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    values = parameters.with_overrides({"stop.restitution": 0.43})
    parameters.save(path, values)
    assert parameters.load(path) == values


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
def test_a_damaged_file_is_refused(tmp_path: Path, damage) -> None:
    path = tmp_path / "parameters.toml"
    parameters.save(path, parameters.with_overrides({"stop.restitution": 0.43}))
    path.write_text(damage(path.read_text()))
    with pytest.raises(ParameterError):
        parameters.load(path)
