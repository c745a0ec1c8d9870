"""The speed loop's design: its gains are the firmware's, its margins are those of the loop run in time."""

import json
import math
from pathlib import Path

import control
import numpy as np
import pytest
from measured_loop import MeasuredLoop, measure_loop

from firmware_py.shell.parameters import DEFAULTS
from hil.scenario.parameter_file import nest
from tools import cli
from tools.output import EXIT_PASSED, BadInputError
from tools.plots import drawn
from tools.tuning import safety
from tools.tuning.pictures import draw_speed
from tools.tuning.speed import (
    NominalDrive,
    SpeedDesign,
    closed_loops,
    gains,
    margins,
    respond,
    shape,
    speed_loop,
    tune_speed,
)

J, B, T, TRACKER = 5e-4, 1e-4, 1e-3, DEFAULTS["crank.bandwidth_rad_s"]


def designed(
    inertia_kg_m2: float = J, tick_s: float = T, crossover_rad_s: float = 100.0, integral_ratio: float = 6.25
) -> SpeedDesign:
    """Gains of two digits for a crossover, and their margins."""
    nominal = NominalDrive(inertia_kg_m2, B, tick_s, TRACKER)
    rounded = (float(f"{gain:.2g}") for gain in gains(nominal, crossover_rad_s, integral_ratio))
    return margins(nominal, *rounded)


@pytest.fixture(scope="module")
def design() -> SpeedDesign:
    return designed()


def test_the_margins_are_comfortable(design: SpeedDesign) -> None:
    assert 50.0 <= design.phase_margin_deg <= 75.0
    assert design.gain_margin_db >= 8.0
    assert design.peak <= 1.6
    assert design.disk_margin >= 0.8
    assert 60.0 <= design.crossover_rad_s <= 150.0
    assert design.bandwidth_rad_s >= design.crossover_rad_s


@pytest.mark.parametrize(("share", "stable"), [(0.99, True), (1.01, False)])
def test_the_loop_is_stable_up_to_its_gain_margin(design: SpeedDesign, share: float, stable: bool) -> None:
    """By the poles of 1 + g L, of which one at 1 is that of the crank's angle."""
    loop = speed_loop(NominalDrive(J, B, T, TRACKER), design.gain_p_n_m_s, design.gain_i_n_m)
    gain = share * 10.0 ** (design.gain_margin_db / 20.0)
    poles = np.sort(np.abs(np.linalg.eigvals(loop.A - gain * loop.B @ loop.C)))
    assert bool(poles[-2] < 1.0) == stable


def test_a_faster_loop_has_less_margin() -> None:
    slow, fast = designed(crossover_rad_s=60.0), designed(crossover_rad_s=200.0)
    assert slow.phase_margin_deg > fast.phase_margin_deg
    assert slow.gain_margin_db > fast.gain_margin_db
    assert fast.load_stiffness_n_m_s > slow.load_stiffness_n_m_s


@pytest.fixture(scope="module")
def measured() -> MeasuredLoop:
    return measure_loop({}, window_s=10.0)


def test_the_loop_measured_on_the_bench_is_the_designed_one(
    design: SpeedDesign, measured: MeasuredLoop
) -> None:
    """Cut on the torque's frames in lockstep: within 3 % and 2.5° from 8 Hz to 80 Hz, below it is no weaker.

    A tick of delay more or less would be 7° at 20 Hz and 18° at 50 Hz.
    """
    designed = respond(NominalDrive(), design.gain_p_n_m_s, design.gain_i_n_m, measured.omega_rad_s).loop
    ratio = measured.loop / designed
    hertz = measured.omega_rad_s / (2.0 * math.pi)
    judged = (hertz > 8.0) & (hertz < 80.0)
    assert np.count_nonzero(judged) >= 5
    assert np.abs(np.abs(ratio[judged]) - 1.0).max() < 0.03
    assert np.abs(np.degrees(np.angle(ratio[judged]))).max() < 2.5
    assert np.abs(ratio[hertz <= 8.0]).min() > 0.97


def test_the_measurement_sees_other_gains() -> None:
    gains = {"speed.gain_p_n_m_s": 0.03, "speed.gain_i_n_m": 0.3}
    other = measure_loop(nest(gains), window_s=5.0)
    at = int(np.argmin(np.abs(other.omega_rad_s - 2.0 * math.pi * 20.0)))
    expected = respond(NominalDrive(), 0.03, 0.3, other.omega_rad_s).loop[at]
    assert other.loop[at] == pytest.approx(expected, rel=0.06)


def test_what_is_asked_for_is_what_comes_out() -> None:
    for bandwidth_hz, margin_deg in ((10.0, 60.0), (21.7, 52.45), (30.0, 45.0)):
        tuning, design = tune_speed(NominalDrive(), bandwidth_hz, margin_deg)
        # The gains are rounded to two digits.
        assert design.bandwidth_rad_s / (2.0 * math.pi) == pytest.approx(bandwidth_hz, rel=0.06)
        assert design.phase_margin_deg == pytest.approx(margin_deg, abs=1.5)
        for value in list(tuning.parameters.values())[:2]:
            assert value.low < value.value < value.high


def test_what_cannot_be_had_is_refused() -> None:
    with pytest.raises(BadInputError, match="phase-margin-deg 80 cannot be reached"):
        shape(NominalDrive(), 25.0, 80.0)
    with pytest.raises(BadInputError, match="cannot be reached with a control period"):
        shape(NominalDrive(), 400.0, 20.0)
    with pytest.raises(
        BadInputError, match="the nearest is 198 Hz"
    ):  # at the tick's rate samples look at rest
        shape(NominalDrive(), 1000.0, 20.0)


def test_the_defaults_are_the_commands_output() -> None:
    values = tune_speed()[0].values
    assert values == {name: DEFAULTS[name] for name in values}


def test_the_command_takes_the_motor_and_the_tracker_that_are_named(
    tmp_path: Path, monkeypatch, capsys
) -> None:
    monkeypatch.setattr(safety, "SCENARIOS", ())
    command = ["tune", "speed", "--json", "--out", str(tmp_path / "mine.toml")]
    found = []
    for options in ([], ["--tracker-rad-s", "500"], ["--inertia-kg-m2", "1e-3"]):
        assert cli.run([*command, *options]) == EXIT_PASSED
        parameters = json.loads(capsys.readouterr().out)["parameters"]
        found.append({name: one["value"] for name, one in parameters.items()})
    default, quick, heavy = found
    assert (default["crank.bandwidth_rad_s"], quick["crank.bandwidth_rad_s"]) == (TRACKER, 500.0)
    assert quick["speed.gain_i_n_m"] > default["speed.gain_i_n_m"]
    assert heavy["speed.gain_p_n_m_s"] == pytest.approx(2.0 * default["speed.gain_p_n_m_s"], rel=0.1)
    assert heavy["motor.inertia_kg_m2"] == 1e-3


def test_a_module_of_twice_the_inertia_is_tested_with_its_own_plant() -> None:
    values = tune_speed(NominalDrive(inertia_kg_m2=1e-3))[0].values
    own = safety.Bench(changes={"motor": {"inertia_kg_m2": 1e-3}})
    for bench, passes in ((own, True), (safety.Bench(changes={"motor": {"inertia_kg_m2": 1e-4}}), False)):
        result = safety.judge_scenario("quick-start-below-the-band", values, lambda *_: None, bench=bench)
        assert result.passed == passes, result.why


def test_the_disk_margin_is_controls(design: SpeedDesign) -> None:
    loop = speed_loop(NominalDrive(J, B, T, TRACKER), design.gain_p_n_m_s, design.gain_i_n_m)
    omega = np.geomspace(1.0, 3000.0, 4000)
    alpha, gain_db, phase_deg = control.disk_margins(loop, omega)
    assert design.disk_margin == pytest.approx(alpha, rel=1e-3)
    assert design.disk_gain_db == pytest.approx(gain_db, rel=1e-3)
    assert design.disk_phase_deg == pytest.approx(phase_deg, rel=1e-3)


def test_steps_end_where_they_should(design: SpeedDesign) -> None:
    """The integral brings the speed to its target, and takes off all that a steady load does."""
    from_target, from_load = closed_loops(NominalDrive(), design.gain_p_n_m_s, design.gain_i_n_m)
    t_s = np.arange(3000) * T
    for system, end in ((from_target, 1.0), (from_load, 0.0)):
        speed = control.forced_response(system, t_s, np.ones(len(t_s))).outputs
        assert speed[-1] == pytest.approx(end, abs=1e-3)


def test_it_is_drawn(design: SpeedDesign, tmp_path: Path) -> None:
    with drawn(tmp_path / "speed.svg") as figure:
        draw_speed(figure, NominalDrive(), design)
        figure.canvas.draw()
        legend = figure.axes[0].get_legend().get_window_extent()
        points = [line.get_transform().transform(line.get_xydata()) for line in figure.axes[0].lines]
        assert legend.count_contains(np.concatenate(points)) == 0
    content = (tmp_path / "speed.svg").read_text()
    assert content.count("<path") > 50
