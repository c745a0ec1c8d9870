"""The speed loop's design: its gains are the firmware's, its margins are those of the loop run in time."""

import math

import numpy as np
import pytest

from firmware_py.shell.parameters import DEFAULTS, critically_damped_gains
from tools.tuning.speed import SpeedDesign, design_speed_loop, speed_loop

J, B, T, TRACKER = 5e-4, 1e-4, 1e-3, DEFAULTS["crank.bandwidth_rad_s"]


@pytest.fixture(scope="module")
def design() -> SpeedDesign:
    return design_speed_loop()


def test_the_default_gains_are_the_designs(design: SpeedDesign) -> None:
    assert design.gain_p_n_m_s == DEFAULTS["speed.gain_p_n_m_s"]
    assert design.gain_i_n_m == DEFAULTS["speed.gain_i_n_m"]


def test_the_margins_are_comfortable(design: SpeedDesign) -> None:
    assert 50.0 <= design.phase_margin_deg <= 75.0
    assert design.gain_margin_db >= 8.0
    assert design.peak <= 1.6
    assert 60.0 <= design.crossover_rad_s <= 150.0
    assert design.bandwidth_rad_s >= design.crossover_rad_s


def in_time(design: SpeedDesign, motor_gain: float = 1.0) -> np.ndarray:
    """Motor, tracker and PI tick by tick after a push; the motor has `motor_gain` times the strength."""
    g, h, k = critically_damped_gains(TRACKER, T)
    angle = omega = at = speed = extra = integral = 0.0
    torque = 0.0
    omega, seen = 1.0, []
    for _ in range(4000):
        alpha = (motor_gain * torque - B * omega) / J
        angle += omega * T + 0.5 * alpha * T * T
        omega += alpha * T
        known = (torque - B * speed) / J + extra
        at += speed * T + 0.5 * known * T * T
        speed += known * T
        error = angle - at
        at += g * error
        speed += h * error / T
        extra += 2.0 * k * error / (T * T)
        torque = -design.gain_p_n_m_s * speed + integral
        integral -= design.gain_i_n_m * speed * T
        seen.append(omega)
    return np.array(seen)


def test_the_loop_settles_as_it_runs(design: SpeedDesign) -> None:
    assert np.abs(in_time(design)[-1000:]).max() < 1e-3


@pytest.mark.parametrize(("share", "stable"), [(0.9, True), (1.1, False)])
def test_the_gain_margin_is_where_the_loop_in_time_becomes_unstable(
    design: SpeedDesign, share: float, stable: bool
) -> None:
    factor = 10.0 ** (design.gain_margin_db / 20.0)
    swing = in_time(design, motor_gain=share * factor)
    assert bool(np.abs(swing[-200:]).max() < np.abs(swing[:200]).max()) == stable


def test_the_closed_loop_matrix_is_stable(design: SpeedDesign) -> None:
    loop = speed_loop(J, B, T, TRACKER, design.gain_p_n_m_s, design.gain_i_n_m)
    poles = np.abs(np.linalg.eigvals(loop.A - loop.B @ loop.C))
    # The crank's angle is no part of the loop: one pole stays at 1.
    assert np.count_nonzero(poles > 1.0 - 1e-6) == 1


def test_a_faster_loop_has_less_margin() -> None:
    slow, fast = design_speed_loop(crossover_rad_s=60.0), design_speed_loop(crossover_rad_s=200.0)
    assert slow.phase_margin_deg > fast.phase_margin_deg
    assert slow.gain_margin_db > fast.gain_margin_db
    assert fast.load_stiffness_n_m_s > slow.load_stiffness_n_m_s


def test_a_heavier_crank_gets_stronger_gains() -> None:
    assert design_speed_loop(inertia_kg_m2=1e-3).gain_p_n_m_s == pytest.approx(
        2 * DEFAULTS["speed.gain_p_n_m_s"]
    )
    assert math.isfinite(design_speed_loop(tick_s=0.002).peak)
