"""The exact solver against independent references: 40-digit closed forms and scipy's DOP853."""

import math
from itertools import pairwise

import mpmath
import numpy as np
import pytest
from exact_reference import Mpmath, Reference
from exact_scenes import NATURAL_RAD_S, REST_M, STOP, module, random_module, reference_impacts, start
from scipy.integrate import solve_ivp

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Coulomb, NoFriction, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.solvers.exact.exact import simulate

CRITICAL_B = 2.0 * math.sqrt(0.8 * 70.0)


@pytest.fixture(autouse=True)
def _forty_digits():
    with mpmath.workdps(40):
        yield


@pytest.mark.parametrize(
    ("amplitude_m", "ratio", "b_n_s_m"),
    [
        (0.02, 1.0, 0.2),
        (0.03, 1.4, 0.2),
        (0.02, 1.1, 0.3),
        (0.02, 1.0, 0.0),
        (0.02, 1.0 + 1e-15, 0.0),
        (0.02, 1.0 - 1e-9, 0.0),
        (0.02, 1.01, 0.05),
        (0.3, 0.6, CRITICAL_B * (1.0 - 1e-12)),
        (0.3, 0.6, CRITICAL_B),
        (0.3, 0.6, CRITICAL_B * (1.0 + 1e-12)),
    ],
)
def test_first_twenty_impacts_are_those_of_forty_digits(amplitude_m, ratio, b_n_s_m):
    parts = module(amplitude_m, ratio, Viscous(b_n_s_m))
    expected = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s=70.0, most=20)
    impacts = simulate(parts, start(), 70.0).impacts
    assert len(expected) == 20
    assert np.abs(impacts.t_s[:20] - np.array([float(b.t_s) for b in expected])).max() <= 1e-13
    assert np.abs(impacts.v_m_s[:20] - np.array([float(b.v_m_s) for b in expected])).max() <= 1e-12


def test_chatter_of_an_overdamped_striker_is_that_of_forty_digits():
    """Impacts down to 1e-6 m/s: a place's rounding over such a speed is what their times can be good to."""
    parts = module(0.2, 0.3, Viscous(3.0 * CRITICAL_B))
    expected = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s=1.0, most=18)
    impacts = simulate(parts, start(), 1.0).impacts
    errors_s = np.abs(impacts.t_s[:18] - np.array([float(b.t_s) for b in expected]))
    speeds_m_s = np.array([float(b.v_m_s) for b in expected])
    assert speeds_m_s[-1] < 1e-5
    assert np.all(errors_s <= 1e-15 + np.minimum(1e-16 / speeds_m_s, 5e-13))


@pytest.mark.parametrize(
    ("ratio", "friction", "until_s"),
    [(1.0, Coulomb(0.15, 0.0), 3.0), (0.9, Coulomb(0.2, 0.0), 7.0), (1.1, Coulomb(0.15, 0.1), 3.0)],
)
def test_dry_friction_impacts_are_those_of_forty_digits(ratio, friction, until_s):
    parts = module(0.03, ratio, friction)
    expected = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s)
    impacts = simulate(parts, start(), until_s).impacts
    assert len(expected) == len(impacts.t_s) >= 1
    assert np.abs(impacts.t_s - np.array([float(b.t_s) for b in expected])).max() <= 1e-13


def test_error_of_a_sensitive_orbit_is_rounding_times_its_growth():
    """At r = 0.9 impacts come every second period and errors grow: the factor is measured, not assumed."""
    parts = module(0.02, 0.9, Viscous(0.2))
    nudge = 1e-9
    plain = simulate(parts, start(), 25.0).impacts.t_s[:20]
    nudged = simulate(parts, start(x_m=REST_M + nudge), 25.0).impacts.t_s[:20]
    growth_s_m = np.abs(nudged - plain).max() / nudge
    expected = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s=25.0, most=20)
    error_s = np.abs(plain - np.array([float(b.t_s) for b in expected])).max()
    assert error_s <= 1e-13
    assert error_s <= 1e-15 * (1.0 + growth_s_m)


@pytest.mark.parametrize(
    "damping_ratio", [0.0, 1e-9, 0.01, 0.5, 1.0 - 1e-12, 1.0, 1.0 + 1e-12, 1.5, 50.0, 1e3]
)
@pytest.mark.parametrize("ratio", [0.0, 1e-6, 0.5, 1.0 - 1e-9, 1.0, 1.0 + 1e-15, 3.0, 1e3])
def test_flow_is_accurate_at_any_damping_and_drive(damping_ratio, ratio):
    parts = module(0.02, ratio, Viscous(2.0 * damping_ratio * math.sqrt(0.8 * 70.0)), NoStop())
    t_s = np.array([1e-9, 0.01, 0.3, 2.0, 9.7])
    samples = simulate(parts, start(REST_M + 0.03, -0.2, 1.0), 10.0, t_s).samples
    reference = Reference(parts, Mpmath)
    y0 = mpmath.mpf(REST_M + 0.03) - mpmath.mpf(REST_M)
    motion = reference._flight(y0, mpmath.mpf(-0.2), mpmath.mpf(1.0), 0)
    for t, x, v in zip(t_s, samples.x_m, samples.v_m_s, strict=True):
        y_true, v_true = motion(mpmath.mpf(t))
        scale = 0.05 + abs(float(y_true))
        assert abs(x - REST_M - float(y_true)) <= 2e-15 * scale * (1.0 + NATURAL_RAD_S * t)
        assert abs(v - float(v_true)) <= 2e-15 * NATURAL_RAD_S * scale * (1.0 + NATURAL_RAD_S * t)


def _scipy_impacts(parts: Parts, until_s: float) -> np.ndarray:
    """Impact times by the paper's method, one flight at a time, at tolerances near rounding."""
    c, m, b = parts.striker.spring_n_per_m, parts.striker.mass_kg, parts.friction.b_n_s_m
    A, Omega = parts.drive.amplitude_m, parts.drive.omega_rad_s
    gap = parts.stop.position_m - parts.striker.rest_length_m

    def rate(t, z):
        return [z[1], (-c * (z[0] - A * math.sin(Omega * t)) - b * z[1]) / m]

    def strike(t, z):
        return z[0] - gap

    strike.terminal, strike.direction = True, 1.0
    t, z, times = 0.0, [0.0, 0.0], []
    while True:
        flight = solve_ivp(
            rate, (t, until_s), z, method="DOP853", rtol=1e-12, atol=1e-14, events=strike, max_step=0.02
        )
        if not len(flight.t_events[0]):
            return np.array(times)
        t = float(flight.t_events[0][0])
        times.append(t)
        z = [gap - 1e-16, -parts.stop.restitution * flight.y_events[0][0][1]]


def test_every_impact_of_ten_seconds_agrees_with_scipy():
    parts = module(0.02, 1.0, Viscous(0.2))
    times = _scipy_impacts(parts, 10.0)
    impacts = simulate(parts, start(), 10.0).impacts
    assert len(impacts.t_s) == len(times) > 10
    assert np.abs(impacts.t_s - times).max() <= 1e-9


@pytest.mark.parametrize("batch", range(8))
def test_no_impact_is_lost_or_invented_in_random_scenes(batch):
    """25 scenes of 5 s a batch, against long doubles on a dense grid; impacts below 1e-6 m/s aside."""
    for seed in range(1000 + 25 * batch, 1025 + 25 * batch):
        parts, initial = random_module(np.random.default_rng(seed))
        impacts = simulate(parts, initial, 5.0).impacts
        times = impacts.t_s[impacts.v_m_s > 1e-6]
        expected = reference_impacts(parts, initial, 5.0, 1e-6)
        assert len(times) == len(expected), f"seed {seed}: {parts}, {initial}"
        assert np.abs(times - expected[:, 0]).max(initial=0.0) < 1e-9, f"seed {seed}: {parts}, {initial}"


def test_a_million_seconds_cost_no_precision():
    """Free beating without damping: the state after 1e6 s, to the last digits, and the crank's angle."""
    parts = module(0.01, 1.37, NoFriction(), NoStop())
    final = simulate(parts, start(REST_M + 0.02, 0.1, 0.5), 1e6).final
    y0 = mpmath.mpf(REST_M + 0.02) - mpmath.mpf(REST_M)
    motion = Reference(parts, Mpmath)._flight(y0, mpmath.mpf(0.1), mpmath.mpf(0.5), 0)
    y, v = motion(mpmath.mpf(1e6))
    angle = mpmath.fmod(mpmath.mpf(0.5) + mpmath.mpf(parts.drive.omega_rad_s) * 10**6, 2 * mpmath.pi)
    assert abs(final.x_m - REST_M - float(y)) < 1e-15
    assert abs(final.v_m_s - float(v)) < 1e-14
    assert abs(final.crank_rad - float(angle)) < 1e-15


def test_impacts_late_in_a_long_run_are_as_sharp_as_early_ones():
    """A periodic orbit contracts errors: after 1e5 s its impacts still come once a period, on the angle."""
    parts = module(0.02, 1.1, Viscous(0.2))
    impacts = simulate(parts, start(), 1e5).impacts
    late = impacts.t_s[-200:]
    period_s = 2.0 * math.pi / parts.drive.omega_rad_s
    assert np.abs(np.diff(late) - period_s).max() < 5e-11  # two roundings of a time near 1e5 s
    assert np.ptp(impacts.crank_rad[-200:]) < 1e-14
    turn = [
        mpmath.fmod(mpmath.mpf(t) * mpmath.mpf(parts.drive.omega_rad_s), 2 * mpmath.pi) for t in late[-3:]
    ]
    assert max(abs(float(a) - b) for a, b in zip(turn, impacts.crank_rad[-3:], strict=True)) < 2e-10


@pytest.mark.parametrize("mass_kg", [1e-6, 1e3])
def test_masses_at_the_extremes(mass_kg):
    omega = math.sqrt(70.0 / mass_kg)
    damping = 0.02 * math.sqrt(70.0 * mass_kg)
    parts = module(0.02, 1.05, Viscous(damping), mass_kg=mass_kg)
    until_s = 60.0 / omega
    expected = Reference(parts, Mpmath).run(0.0, 0.0, 0.0, until_s)
    impacts = simulate(parts, start(), until_s).impacts
    assert len(impacts.t_s) == len(expected) > 5
    assert max(abs(t - float(b.t_s)) for t, b in zip(impacts.t_s, expected, strict=True)) <= 1e-13 * until_s


def test_a_drive_of_ten_thousand_radians_per_second():
    striker = Striker(0.8, 70.0, 0.0, 9.80665)
    parts = Parts(striker, IdealDrive(2.0, 1e4, 0.0), Viscous(0.2), RigidStop(1e-5, 0.5))
    initial = start(-1e-3, 0.0)
    expected = Reference(parts, Mpmath).run(-1e-3, 0.0, 0.0, 0.3)
    impacts = simulate(parts, initial, 0.3).impacts
    assert len(impacts.t_s) == len(expected) >= 1
    assert max(abs(t - float(b.t_s)) for t, b in zip(impacts.t_s, expected, strict=True)) <= 1e-13


@pytest.mark.parametrize("omega", [0.0, 1e-12, 1e-6])
def test_a_drive_that_hardly_turns(omega):
    """The piston then stands: free decay from a start beyond it, against the 40 digits."""
    parts = Parts(Striker(0.8, 70.0, REST_M, 9.8), IdealDrive(0.02, omega, 0.0), Viscous(0.2), STOP)
    initial = start(REST_M - 0.1, 0.0, 1.2)
    y0 = mpmath.mpf(REST_M - 0.1) - mpmath.mpf(REST_M)
    expected = Reference(parts, Mpmath).run(y0, 0.0, 1.2, 3.0)
    impacts = simulate(parts, initial, 3.0).impacts
    assert len(impacts.t_s) == len(expected) >= 3
    assert max(abs(t - float(b.t_s)) for t, b in zip(impacts.t_s, expected, strict=True)) <= 1e-14


def test_stick_and_slip_of_one_period_against_its_own_algebra():
    """From rest the striker holds until c A sin θ = μ m g, for any friction below c A."""
    for mu in (0.05, 0.1, 0.2, 0.26):
        parts = module(0.03, 0.7, Coulomb(mu, 0.0), NoStop())
        release_s = math.asin(mu * 0.8 * 9.80665 / (70.0 * 0.03)) / parts.drive.omega_rad_s
        t_s = np.array([release_s * (1.0 - 1e-9), release_s + 1e-4])
        samples = simulate(parts, start(), 1.0, t_s).samples
        assert samples.v_m_s[0] == 0.0
        jerk = 87.5 * 0.03 * parts.drive.omega_rad_s * math.cos(parts.drive.omega_rad_s * release_s)
        assert samples.v_m_s[1] == pytest.approx(0.5 * jerk * 1e-8, rel=1e-2)


def test_samples_lie_on_a_smooth_motion_between_impacts():
    parts = module(0.02, 1.2, Viscous(0.2))
    t_s = np.linspace(0.0, 5.0, 20_001)
    result = simulate(parts, start(), 5.0, t_s)
    samples, impacts = result.samples, result.impacts
    acceleration = -87.5 * (samples.x_m - REST_M - 0.02 * np.sin(samples.crank_rad)) - 0.25 * samples.v_m_s
    slope = np.diff(samples.v_m_s) / np.diff(t_s)
    middle = 0.5 * (acceleration[1:] + acceleration[:-1])
    crossed = np.zeros(len(slope), dtype=bool)
    for before, after in pairwise(range(len(t_s))):
        crossed[before] = np.any((impacts.t_s >= t_s[before]) & (impacts.t_s <= t_s[after]))
    assert np.abs(slope - middle)[~crossed].max() < 1e-5
    assert samples.x_m.max() <= 0.18
