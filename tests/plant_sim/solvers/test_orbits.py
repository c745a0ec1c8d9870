"""Orbits followed by the closed form and by the adaptive solver: one answer, whatever was followed before."""

import math

import numpy as np
import pytest

from plant_sim.orbits import adaptive as adaptive_orbits
from plant_sim.orbits import exact as exact_orbits
from plant_sim.orbits.sections import CLASSIFY, PAPER, Regime
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Coulomb, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.result import MotionState, Phase
from plant_sim.sensors.sensing import NoSensing
from plant_sim.solvers.adaptive.adaptive import NO_GRID, run
from plant_sim.solvers.adaptive.state_layout import Memory, allocate

STRIKER = Striker(0.8, 70.0, 0.12, 9.80665)
NATURAL_RAD_S = math.sqrt(70.0 / 0.8)
REST = MotionState(0.0, 0.12, 0.0, 0.0, 0.0, Phase.FLIGHT)


def drive(ratio: float, amplitude_m: float = 0.03) -> IdealDrive:
    return IdealDrive(amplitude_m, ratio * NATURAL_RAD_S, 0.0)


def memory_of(parts: Parts) -> Memory:
    return allocate(parts, REST, 1e-7, 256)


@pytest.mark.parametrize(
    ("mu", "restitution", "ratio", "stop_m", "regime"),
    [
        (0.2, 0.0, 0.3, 0.18, Regime.NON_IMPACT),  # slides and sticks in turn
        (0.2, 0.2, 0.3, 0.18, Regime.NON_IMPACT),
        (0.3, 0.5, 0.3, 0.18, Regime.STUCK),
        (0.15, 0.0, 0.3, 0.125, Regime.CHATTERING),  # rests on the stop for part of each turn
        (0.15, 0.2, 0.3, 0.125, Regime.CHATTERING),
        (0.2, 0.0, 0.5, 0.15, Regime.CHATTERING),  # friction alone holds it on the stop
        (0.15, 0.5, 1.0, 0.18, Regime.IMPACT),
    ],
)
def test_both_followers_name_the_same_regime(
    mu: float, restitution: float, ratio: float, stop_m: float, regime: Regime
) -> None:
    friction, stop = Coulomb(mu, 0.0), RigidStop(stop_m, restitution)
    parts = Parts(STRIKER, drive(ratio), friction, stop)
    closed = exact_orbits.follow(STRIKER, drive(ratio), friction, stop, 0.0, 0.0, 0.0, PAPER)
    stepwise = adaptive_orbits.follow_stepwise(parts, memory_of(parts), 0.0, 0.0, 0.0, PAPER)
    assert Regime(closed.regime) == Regime(stepwise.regime) == regime
    assert stepwise.x_low_m == pytest.approx(closed.x_low_m, abs=1e-6)
    assert stepwise.x_high_m == pytest.approx(closed.x_high_m, abs=1e-6)
    assert stepwise.friction_j == pytest.approx(closed.friction_j, abs=1e-6)
    assert stepwise.loss_j == pytest.approx(closed.loss_j, abs=1e-6)


def test_a_striker_that_the_spring_never_quite_lets_go_of_the_stop_is_stuck() -> None:
    """The gap is −A: the spring presses but for the instant in which the piston turns round."""
    friction, stop = Viscous(0.05), RigidStop(0.09, 0.5)
    parts = Parts(STRIKER, drive(2.0), friction, stop)
    closed = exact_orbits.follow(STRIKER, drive(2.0), friction, stop, -0.03, 0.3, 0.0, PAPER)
    stepwise = adaptive_orbits.follow_stepwise(parts, memory_of(parts), -0.03, 0.3, 0.0, PAPER)
    assert Regime(closed.regime) == Regime(stepwise.regime) == Regime.STUCK


def test_a_cell_does_not_depend_on_the_cells_before_it() -> None:
    parts = Parts(STRIKER, drive(0.9), Coulomb(0.15, 0.0), RigidStop(0.18, 0.5))
    protocol = CLASSIFY._replace(settle_s=3.0)
    fresh = adaptive_orbits.follow_stepwise(parts, memory_of(parts), -0.02, 0.1, 0.0, protocol)
    used = memory_of(parts)
    adaptive_orbits.follow_stepwise(parts, used, 0.01, -0.5, 1.0, protocol)
    again = adaptive_orbits.follow_stepwise(parts, used, -0.02, 0.1, 0.0, protocol)
    assert (again.end_y_m, again.end_v_m_s) == (fresh.end_y_m, fresh.end_v_m_s)


def test_without_a_stop_nothing_beyond_the_state_is_read() -> None:
    parts = Parts(STRIKER, drive(0.5), Coulomb(0.15, 0.0), NoStop())
    memory = memory_of(parts)
    fenced = np.append(memory.y, [math.nan, math.nan])
    outcome = adaptive_orbits.follow_stepwise(
        parts, memory._replace(y=fenced[: memory.y.size]), 0.0, 0.0, 0.0, PAPER
    )
    assert outcome.loss_j == 0.0
    assert outcome.drive_j == pytest.approx(outcome.friction_j, rel=1e-5)


def test_a_million_seconds_lose_no_time_against_the_crank() -> None:
    """In 260,000 steps: the crank's angle keeps their lengths, time adds them up."""
    slow = Parts(Striker(1e3, 70.0, 0.12, 9.80665), IdealDrive(0.001, 0.1, 0.0), Coulomb(0.15, 0.0), NoStop())
    memory, until_s = allocate(slow, REST, 1e-3, 4), 1e6
    run(slow, NoSensing(), memory, 0.0, 0.0, until_s, NO_GRID)
    turned = (0.1 * until_s - memory.held[0].crank_rad) / (2.0 * math.pi)
    assert abs(turned - round(turned)) * 2.0 * math.pi / 0.1 < 1e-8  # s
