"""The exact solver against independent references: 40-digit closed forms and scipy's DOP853."""

import math

import mpmath
import numpy as np
import pytest
from exact_reference import Mpmath, Reference
from exact_scenes import NATURAL_RAD_S, REST_M, STOP, module, random_module, reference_impacts, start

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


def of_mass(mass_kg: float) -> Parts:
    return module(0.02, 1.05, Viscous(0.02 * math.sqrt(70.0 * mass_kg)), mass_kg=mass_kg)


QUICK = Parts(Striker(0.8, 70.0, 0.0, 9.80665), IdealDrive(2.0, 1e4, 0.0), Viscous(0.2), RigidStop(1e-5, 0.5))
CREEPING = [
    Parts(Striker(0.8, 70.0, REST_M, 9.8), IdealDrive(0.02, omega, 0.0), Viscous(0.2), STOP)
    for omega in (0.0, 1e-12, 1e-6)
]


@pytest.mark.parametrize(
    ("parts", "initial", "until_s", "least", "tolerance_s"),
    [
        (module(0.02, 1.0, Viscous(0.2)), start(), 70.0, 20, 1e-13),
        (module(0.02, 0.9, Viscous(0.2)), start(), 70.0, 20, 1e-13),  # sensitive: every second period
        (module(0.02, 1.0 + 1e-15, Viscous(0.0)), start(), 70.0, 20, 1e-13),
        (module(0.02, 1.01, Viscous(0.05)), start(), 70.0, 20, 1e-13),
        (module(0.3, 0.6, Viscous(CRITICAL_B)), start(), 70.0, 20, 1e-13),
        (module(0.03, 1.0, Coulomb(0.15, 0.0)), start(), 3.0, 1, 1e-13),
        (module(0.03, 0.9, Coulomb(0.2, 0.0)), start(), 7.0, 1, 1e-13),
        (module(0.03, 1.1, Coulomb(0.15, 0.1)), start(), 3.0, 1, 1e-13),
        (of_mass(1e-6), start(), 60.0 / math.sqrt(70.0 / 1e-6), 6, 7e-16),
        (of_mass(1e3), start(), 60.0 / math.sqrt(70.0 / 1e3), 6, 2e-11),
        (QUICK, start(-1e-3), 0.3, 1, 1e-13),
        # The piston hardly turns: free decay from a start beyond it.
        *((parts, start(REST_M - 0.1, 0.0, 1.2), 3.0, 3, 1e-14) for parts in CREEPING),
    ],
)
def test_impacts_are_those_of_forty_digits(parts, initial, until_s, least, tolerance_s):
    y_m = mpmath.mpf(initial.x_m) - mpmath.mpf(parts.striker.rest_length_m)
    expected = Reference(parts, Mpmath).run(y_m, initial.v_m_s, initial.crank_rad, until_s, most=20)
    impacts = simulate(parts, initial, until_s).impacts
    assert len(expected) >= least
    assert len(impacts.t_s) == len(expected) or len(expected) == 20
    for t_s, v_m_s, impact in zip(impacts.t_s, impacts.v_m_s, expected, strict=False):
        assert abs(t_s - float(impact.t_s)) <= tolerance_s
        assert abs(v_m_s - float(impact.v_m_s)) <= 1e-12 * max(1.0, float(impact.v_m_s))


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
