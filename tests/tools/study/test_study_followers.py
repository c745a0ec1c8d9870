"""Orbits followed by the closed form and by the adaptive solver: one answer, whatever was followed before."""

import math

import numpy as np
import pytest

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Coulomb, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.result import MotionState, Phase
from plant_sim.sensors.sensing import NoSensing
from plant_sim.solvers.adaptive.adaptive import run
from plant_sim.solvers.adaptive.state_layout import Grid, Memory, allocate
from tools.study.orbits.closed import closed
from tools.study.orbits.follow import State, follow_orbit
from tools.study.orbits.sections import CLASSIFY, PAPER, Regime
from tools.study.orbits.stepwise import stepwise

NO_SAMPLES = Grid(np.empty(0), np.empty((0, 2)))

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
    by_form = follow_orbit(closed(parts), State(0.0, 0.0, 0.0), PAPER)
    by_steps = follow_orbit(stepwise(parts, memory_of(parts)), State(0.0, 0.0, 0.0), PAPER)
    assert Regime(by_form.regime) == Regime(by_steps.regime) == regime
    assert by_steps.x_low_m == pytest.approx(by_form.x_low_m, abs=1e-6)
    assert by_steps.x_high_m == pytest.approx(by_form.x_high_m, abs=1e-6)
    assert by_steps.friction_j == pytest.approx(by_form.friction_j, abs=1e-6)
    assert by_steps.loss_j == pytest.approx(by_form.loss_j, abs=1e-6)


def test_a_striker_that_the_spring_never_quite_lets_go_of_the_stop_is_stuck() -> None:
    """The gap is −A: the spring presses but for the instant in which the piston turns round."""
    friction, stop = Viscous(0.05), RigidStop(0.09, 0.5)
    parts = Parts(STRIKER, drive(2.0), friction, stop)
    by_form = follow_orbit(closed(parts), State(-0.03, 0.3, 0.0), PAPER)
    by_steps = follow_orbit(stepwise(parts, memory_of(parts)), State(-0.03, 0.3, 0.0), PAPER)
    assert Regime(by_form.regime) == Regime(by_steps.regime) == Regime.STUCK


def test_a_cell_does_not_depend_on_the_cells_before_it() -> None:
    parts = Parts(STRIKER, drive(0.9), Coulomb(0.15, 0.0), RigidStop(0.18, 0.5))
    protocol = CLASSIFY._replace(settle_s=3.0)
    fresh = follow_orbit(stepwise(parts, memory_of(parts)), State(-0.02, 0.1, 0.0), protocol)
    used = memory_of(parts)
    follow_orbit(stepwise(parts, used), State(0.01, -0.5, 1.0), protocol)
    again = follow_orbit(stepwise(parts, used), State(-0.02, 0.1, 0.0), protocol)
    assert (again.end_y_m, again.end_v_m_s) == (fresh.end_y_m, fresh.end_v_m_s)


def test_without_a_stop_nothing_beyond_the_state_is_read() -> None:
    parts = Parts(STRIKER, drive(0.5), Coulomb(0.15, 0.0), NoStop())
    memory = memory_of(parts)
    fenced = np.append(memory.y, [math.nan, math.nan])
    outcome = follow_orbit(
        stepwise(parts, memory._replace(y=fenced[: memory.y.size])), State(0.0, 0.0, 0.0), PAPER
    )
    assert outcome.loss_j == 0.0
    assert outcome.drive_j == pytest.approx(outcome.friction_j, rel=1e-5)


def test_a_million_seconds_lose_no_time_against_the_crank() -> None:
    """In 260,000 steps: the crank's angle keeps their lengths, time adds them up."""
    slow = Parts(Striker(1e3, 70.0, 0.12, 9.80665), IdealDrive(0.001, 0.1, 0.0), Coulomb(0.15, 0.0), NoStop())
    memory, until_s = allocate(slow, REST, 1e-3, 4), 1e6
    run(slow, NoSensing(), memory, 0.0, 0.0, until_s, NO_SAMPLES)
    turned = (0.1 * until_s - memory.held[0].crank_rad) / (2.0 * math.pi)
    assert abs(turned - round(turned)) * 2.0 * math.pi / 0.1 < 1e-8  # s
