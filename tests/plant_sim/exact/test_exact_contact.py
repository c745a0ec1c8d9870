"""Contact and stick as modes: chatter, rest, release, pre-loaded stops, starts on the stop, dry friction."""

import math

import numpy as np
import pytest
from exact_scenes import REST_M, module, start
from hypothesis import given, settings
from hypothesis import strategies as st

from plant_sim.parts.friction import Coulomb, NoFriction, Viscous
from plant_sim.parts.stop import RigidStop
from plant_sim.result import Phase
from plant_sim.solvers.cost import SolverError
from plant_sim.solvers.exact.exact import UnsupportedSceneError, simulate

STOP_M = 0.18


@pytest.mark.parametrize("k", [0.0, 0.05, 0.4, 0.95])
@pytest.mark.parametrize("friction", [NoFriction(), Viscous(0.2), Coulomb(0.02, 0.1)])
def test_chatter_on_a_preloaded_stop_ends_at_rest_and_stays(k, friction):
    """Gap −30 mm and A = 20 mm: the spring presses always."""
    parts = module(0.02, 0.9, friction, RigidStop(REST_M - 0.03, k))
    result = simulate(parts, start(REST_M - 0.06), 60.0)
    assert result.final.phase == Phase.REST_ON_STOP
    assert result.final.x_m == parts.stop.position_m
    assert 1 <= len(result.impacts.t_s) < 2_000
    assert result.energy.residual < 1e-12


@pytest.mark.parametrize("k", [0.05, 0.4, 0.8])
@pytest.mark.parametrize("friction", [Viscous(4.0), Coulomb(0.02, 4.0)])
def test_the_cutoff_of_chatter_does_not_show_in_later_motion(k, friction):
    """Rest and release each period; cutoffs over five decades give one final state, to the bit."""
    parts = module(0.03, 0.3, friction, RigidStop(REST_M + 0.01, k))
    finals, counts = [], []
    for cutoff_m_s in (1e-6, 1e-7, 1e-8, 1e-9, 1e-10, 1e-11):
        result = simulate(parts, start(), 20.3, rest_speed_m_s=cutoff_m_s)
        finals.append(result.final)
        counts.append(len(result.impacts.t_s))
        assert result.energy.residual < 1e-11
    assert len({(final.x_m, final.v_m_s, final.phase) for final in finals}) == 1
    assert np.ptp([final.crank_rad for final in finals]) < 1e-15
    assert counts[0] < counts[-1] < 1_000


@pytest.mark.parametrize(
    ("crank_rad", "v_m_s", "phase", "count"),
    [
        (1.5, -0.1, Phase.FLIGHT, 0),
        (1.5, 0.0, Phase.REST_ON_STOP, 0),
        (1.5, 0.1, Phase.FLIGHT, 1),
        (4.5, -0.1, Phase.FLIGHT, 0),
        (4.5, 0.0, Phase.FLIGHT, 0),
        (4.5, 0.1, Phase.FLIGHT, 1),
    ],
)
def test_starts_on_the_stop(crank_rad, v_m_s, phase, count):
    """Gap 0: the piston presses at θ = 1.5 and pulls at 4.5."""
    parts = module(0.03, 0.3, NoFriction(), RigidStop(REST_M, 0.5))
    result = simulate(parts, start(REST_M, v_m_s, crank_rad), 1e-4)
    assert result.final.phase == phase
    assert len(result.impacts.t_s) == count
    if count:
        assert result.impacts.t_s[0] == 0.0
        assert result.impacts.v_after_m_s[0] == -0.05
    expected = {0.0: 0.0, -0.1: -0.1, 0.1: -0.05}[v_m_s]
    assert result.final.v_m_s == pytest.approx(expected, abs=3e-4)


def test_a_start_beyond_the_stop_is_refused():
    with pytest.raises(UnsupportedSceneError, match="beyond the rigid stop"):
        simulate(module(0.02, 1.0, NoFriction()), start(np.nextafter(STOP_M, 1.0)), 1.0)


def test_bounces_that_never_die_out_are_an_error_and_not_a_hang():
    parts = module(0.0, 1.0, NoFriction(), RigidStop(REST_M - 0.03, 1.0))
    with pytest.raises(SolverError, match=r"do not die out.*stop\.restitution"):
        simulate(parts, start(parts.stop.position_m, -1e-7), 1e3)


@pytest.mark.parametrize(("excess", "moves"), [(1e-9, True), (1e-13, True), (0.0, False), (-1e-13, False)])
def test_release_at_an_extremum_of_the_forcing(excess, moves):
    """μ m g = c A (1 − excess): the push overcomes friction for an instant only, or never."""
    amplitude = 0.02
    mu = 70.0 * amplitude / (0.8 * 9.80665)
    parts = module(amplitude, 1.0, Coulomb(mu * (1.0 - excess), 0.0))
    held_m = parts.friction.mu * 9.80665 / (70.0 / 0.8)
    result = simulate(parts, start(), 10.0)
    if abs(excess) >= 1e-13:
        assert (result.energy.friction_j > 0.0) == moves
    assert result.final.phase == Phase.STICK
    assert abs(result.final.x_m - REST_M) <= 50.0 * abs(amplitude - held_m)


def test_stuck_on_the_stop_between_press_and_pull():
    """Dry friction holds at the stop while the push is below μ m g either way: rest, stick, then off."""
    parts = module(0.03, 0.3, Coulomb(0.1, 0.0), RigidStop(REST_M, 0.0))
    held = 0.1 * 9.80665 / (70.0 / 0.8)
    period = 2.0 * math.pi / parts.drive.omega_rad_s
    to_stick = (math.pi - math.asin(held / 0.03)) / parts.drive.omega_rad_s
    to_flight = (math.pi + math.asin(held / 0.03)) / parts.drive.omega_rad_s
    for until_s, phase in (
        (0.25 * period, Phase.REST_ON_STOP),
        (to_stick - 1e-9, Phase.REST_ON_STOP),
        (to_stick + 1e-9, Phase.STICK),
        (to_flight - 1e-9, Phase.STICK),
        (to_flight + 1e-9, Phase.FLIGHT),
    ):
        assert simulate(parts, start(REST_M), until_s).final.phase == phase


@pytest.mark.parametrize("v_m_s", [s * 10.0**e for s in (-1, 1) for e in (-12, -25, -60, -99, -150, -300)])
def test_a_flight_of_any_speed_ends(v_m_s: float) -> None:
    """The parabola to the turn of the least speeds rounds to no time at all."""
    parts = module(0.03, 1.3, Coulomb(0.15, 0.0), RigidStop(REST_M + 0.06, 0.5))
    ended = simulate(parts, start(REST_M + 0.05, v_m_s, 2.6), 3.0)
    rest = simulate(parts, start(REST_M + 0.05, 0.0, 2.6), 3.0)
    assert ended.final.x_m == pytest.approx(rest.final.x_m, abs=1e-9)


@pytest.mark.parametrize("stroke_m", [5e-324, 1e-250, 1e-160, 1e-101, 1e-99])
@pytest.mark.parametrize("mu", [0.0, 5e-324, 1e-250, 0.3])
@pytest.mark.parametrize("gap_m", [0.0, 9e-119])
def test_a_stroke_of_any_length_ends(stroke_m: float, mu: float, gap_m: float) -> None:
    """The span of the search for events and the squares of the least lengths round to zero."""
    stop = RigidStop(REST_M + gap_m, 0.5)
    ended, without = (
        simulate(module(amplitude_m, 1.3, Coulomb(mu, 0.1), stop), start(REST_M - 0.06, 0.0, 1.0), 5.0)
        for amplitude_m in (stroke_m, 0.0)
    )
    assert ended.final.x_m == pytest.approx(without.final.x_m, abs=1e-12)


@settings(max_examples=80, derandomize=True)
@given(
    gap_m=st.floats(-0.04, 0.04),
    amplitude_m=st.floats(0.0, 0.05),
    ratio=st.floats(0.0, 3.0),
    k=st.floats(0.0, 0.97),
    mu=st.floats(0.0, 0.4),
    below_m=st.floats(0.0, 0.1),
    v_m_s=st.floats(-1.0, 1.0),
)
def test_the_striker_never_passes_the_stop_and_impacts_are_never_stuck(
    gap_m, amplitude_m, ratio, k, mu, below_m, v_m_s
):
    parts = module(amplitude_m, ratio, Coulomb(mu, 0.1), RigidStop(REST_M + gap_m, k))
    initial = start(parts.stop.position_m - below_m, v_m_s, 1.0)
    t_s = np.linspace(0.0, 5.0, 700)
    result = simulate(parts, initial, 5.0, t_s)
    assert result.samples.x_m.max() <= parts.stop.position_m
    assert np.all(result.impacts.v_m_s > 0.0)
    assert np.all(result.impacts.v_after_m_s <= 0.0)
    assert np.all(np.diff(result.impacts.t_s) >= 0.0)
    assert result.energy.friction_j >= 0.0
    assert result.energy.impact_loss_j >= 0.0
