"""Whole runs of the exact solver: grids, cuts, ends, energy, refusals, and its kernel in a caller's loop."""

import math

import numpy as np
import pytest
from exact_scenes import MASS_KG, REST_M, STOP, module, random_module, start
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.friction import Coulomb, NoFriction, Stribeck, Viscous
from plant_sim.parts.stop import HuntCrossley
from plant_sim.solvers.exact.exact import UnsupportedSceneError, simulate

SCENES = [
    module(0.02, 1.3, Viscous(0.2)),
    module(0.02, 1.0, Viscous(0.2)),
    module(0.03, 1.1, Coulomb(0.15, 0.0)),
    module(0.03, 0.3, Coulomb(0.05, 1.0), STOP._replace(position_m=REST_M)),
    module(0.02, 1.0, NoFriction()),
]


@pytest.mark.parametrize("parts", SCENES)
def test_results_do_not_depend_on_the_grid_of_samples(parts):
    plain = simulate(parts, start(), 10.0)
    sampled = simulate(parts, start(), 10.0, np.linspace(0.0, 10.0, 777))
    assert np.array_equal(plain.impacts.t_s, sampled.impacts.t_s)
    assert plain.final == sampled.final
    coarse = simulate(parts, start(), 10.0, np.array([1.25, 7.5])).samples
    fine = simulate(parts, start(), 10.0, np.linspace(0.0, 10.0, 8001)).samples
    for time, x in zip(coarse.t_s, coarse.x_m, strict=True):
        assert fine.x_m[round(time * 800)] == x


@pytest.mark.parametrize("parts", SCENES)
def test_results_do_not_depend_on_how_a_run_is_cut_into_ticks(parts):
    whole = simulate(parts, start(), 4.0)
    state, times, drive_j = start(), [], 0.0
    for tick in range(1, 4001):
        piece = simulate(parts, state, tick * 1e-3)
        state = piece.final
        times.extend(piece.impacts.t_s)
        drive_j += piece.energy.drive_work_j
    assert len(times) == len(whole.impacts.t_s)
    assert np.abs(np.array(times) - whole.impacts.t_s).max(initial=0.0) < 1e-11
    assert state.x_m == pytest.approx(whole.final.x_m, abs=1e-12)
    assert state.phase == whole.final.phase
    assert drive_j == pytest.approx(whole.energy.drive_work_j, abs=1e-12)


def test_an_impact_exactly_at_the_end_belongs_to_the_run():
    parts = SCENES[0]
    impact_s = simulate(parts, start(REST_M - 0.05, 0.5), 5.0).impacts.t_s[0]
    at_end = simulate(parts, start(REST_M - 0.05, 0.5), impact_s)
    assert at_end.impacts.t_s.tolist() == [impact_s]
    assert at_end.final.v_m_s < 0.0
    just_before = simulate(parts, start(REST_M - 0.05, 0.5), np.nextafter(impact_s, 0.0))
    assert len(just_before.impacts.t_s) == 0
    rest = simulate(parts, just_before.final, 5.0)
    assert rest.impacts.t_s[0] == pytest.approx(impact_s, abs=1e-15)


def test_a_sample_at_an_impact_sees_the_speed_after_it():
    parts = SCENES[0]
    impacts = simulate(parts, start(REST_M - 0.05, 0.5), 5.0).impacts
    samples = simulate(parts, start(REST_M - 0.05, 0.5), 5.0, impacts.t_s[:3]).samples
    assert samples.v_m_s == pytest.approx(impacts.v_after_m_s[:3], abs=1e-12)
    assert samples.x_m == pytest.approx(STOP.position_m, abs=1e-15)


def test_a_run_of_no_length_changes_nothing():
    result = simulate(SCENES[0], start(0.1, -0.2, 1.0, t_s=3.0), 3.0, np.array([3.0]))
    assert (result.final.x_m, result.final.v_m_s, result.final.crank_rad) == (0.1, -0.2, 1.0)
    assert result.samples.x_m.tolist() == [0.1]


def test_impulse_is_mass_times_change_of_speed_and_newtons_law_holds():
    impacts = simulate(SCENES[0], start(REST_M - 0.05, 0.5), 20.0).impacts
    assert np.array_equal(impacts.v_after_m_s, -0.5 * impacts.v_m_s)
    assert impacts.impulse_n_s == pytest.approx(1.5 * MASS_KG * impacts.v_m_s, rel=1e-15)
    assert np.all(np.isnan(impacts.peak_force_n))


@settings(max_examples=300, derandomize=True)
@given(seed=st.integers(0, 10**6))
@pytest.mark.requirement("B-01")
def test_the_energy_ledger_balances(seed):
    parts, initial = random_module(np.random.default_rng(seed))
    assert simulate(parts, initial, 10.0).energy.residual < 1e-12


@pytest.mark.parametrize("ratio", [0.9, 0.99, 1.0 - 1e-9, 1.0, 1.0 + 1e-15, 1.02, 1.1])
@pytest.mark.parametrize("b_n_s_m", [0.0, 0.01, 0.2, 15.0])
def test_the_energy_ledger_balances_through_resonance(ratio, b_n_s_m):
    result = simulate(module(0.02, ratio, Viscous(b_n_s_m)), start(), 50.0)
    assert result.energy.residual < 1e-12


def test_the_ledgers_accounts_are_those_of_quadrature():
    """Against a trapezoid over dense samples: ∫ c (x_A − y) x_A' dt and ∫ b v² + μ m g |v| dt."""
    for parts in (
        module(0.02, 1.2, Viscous(0.2)),
        module(0.03, 1.1, Coulomb(0.15, 0.1)),
        module(0.02, 1.0, Viscous(0.2)),
    ):
        t_s = np.linspace(0.0, 6.0, 600_001)
        result = simulate(parts, start(), 6.0, t_s)
        samples, energy = result.samples, result.energy
        A, Omega = parts.drive.amplitude_m, parts.drive.omega_rad_s
        y, piston = samples.x_m - REST_M, A * np.sin(samples.crank_rad)
        power = 70.0 * (piston - y) * A * Omega * np.cos(samples.crank_rad)
        dry = parts.friction.mu * MASS_KG * 9.80665 if isinstance(parts.friction, Coulomb) else 0.0
        heat = parts.friction.b_n_s_m * samples.v_m_s**2 + dry * np.abs(samples.v_m_s)
        assert energy.drive_work_j == pytest.approx(np.trapezoid(power, t_s), rel=1e-5)
        assert energy.friction_j == pytest.approx(np.trapezoid(heat, t_s), rel=1e-4)
        lost = 0.5 * MASS_KG * np.sum(result.impacts.v_m_s**2 - result.impacts.v_after_m_s**2)
        assert energy.impact_loss_j == pytest.approx(lost, rel=1e-12)


@pytest.mark.parametrize(
    "change",
    [
        {"friction": Stribeck(0.1, 0.2, 0.01, 1.0, 0.0)},
        {"stop": HuntCrossley(0.18, 1e6, 1.5, 0.5)},
        {"drive": MotorDrive(0.02, 0.0, 5e-4, 0.08, 0.4, 7, 24.0, 10.0, 1e-4, 5e-3, 40.0)},
    ],
)
def test_parts_without_closed_form_are_refused(change):
    with pytest.raises(UnsupportedSceneError, match="use the adaptive solver"):
        simulate(SCENES[0]._replace(**change), start(), 1.0)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_starts_and_ends_that_are_no_numbers_are_refused(bad):
    for initial, until_s in (
        (start(bad), 1.0),
        (start(0.1, bad), 1.0),
        (start(0.1, 0.0, bad), 1.0),
        (start(), bad),
    ):
        with pytest.raises(UnsupportedSceneError, match="finite"):
            simulate(SCENES[0], initial, until_s)


def test_ends_and_samples_out_of_order_are_refused():
    with pytest.raises(UnsupportedSceneError, match="before its start"):
        simulate(SCENES[0], start(t_s=2.0), 1.0)
    for grid in ([0.5, 0.1], [-0.1, 0.5], [0.5, 1.5]):
        with pytest.raises(UnsupportedSceneError, match="sample times"):
            simulate(SCENES[0], start(), 1.0, np.array(grid))
