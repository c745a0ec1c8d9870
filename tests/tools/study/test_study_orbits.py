"""Orbits followed without being stored: against the other solver, against theory, and stopped early."""

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
from plant_sim.solvers.adaptive.adaptive import run as run_solver
from plant_sim.solvers.adaptive.state_layout import Grid, Memory, allocate
from tools.study.basin import BORDER_BOUND_M, axes
from tools.study.cases import Case, case
from tools.study.orbits.closed import closed
from tools.study.orbits.follow import AT_REST, State, carrier_of, classify, follow, follow_orbit
from tools.study.orbits.sections import CLASSIFY, PAPER, Outcome, Regime
from tools.study.orbits.stepwise import stepwise
from tools.study.sweep import CONTINUE, run

VISCOUS, COULOMB = case("table1", "viscous"), case("table1", "coulomb")


STRIKER = VISCOUS.scene(1.0).parts().striker
REST = MotionState(0.0, 0.12, 0.0, 0.0, 0.0, Phase.FLIGHT)
FIGURES = ("v_mean_m_s", "impulse_n_s", "x_low_m", "x_high_m", "drive_j", "friction_j", "loss_j")


def drive(ratio: float, amplitude_m: float = 0.03) -> IdealDrive:
    return IdealDrive(amplitude_m, ratio * VISCOUS.natural_rad_s, 0.0)


def memory_of(parts: Parts, accuracy: float = 1e-7) -> Memory:
    return allocate(parts, REST, accuracy, 256)


def both(parts: Parts, start: State) -> list[Outcome]:
    """The orbit by the closed form, and by the adaptive solver step by step."""
    steps = stepwise(parts, memory_of(parts, 1e-11))
    return [follow_orbit(carrier, start, PAPER) for carrier in (closed(parts), steps)]


@pytest.mark.parametrize(
    ("parts", "regime"),
    [
        (VISCOUS.scene(1.2).parts(), Regime.IMPACT),
        (VISCOUS.scene(1.5).parts(), Regime.NON_IMPACT),
        (COULOMB.scene(0.9).parts(), Regime.PERIOD_N),
        (COULOMB.scene(1.1).parts(), Regime.IMPACT),
        (COULOMB.scene(1.5).parts(), Regime.NON_IMPACT),
        # slides and sticks in turn
        (Parts(STRIKER, drive(0.3), Coulomb(0.2, 0.0), RigidStop(0.18, 0.0)), Regime.NON_IMPACT),
        (Parts(STRIKER, drive(0.3), Coulomb(0.2, 0.0), RigidStop(0.18, 0.2)), Regime.NON_IMPACT),
        (Parts(STRIKER, drive(0.3), Coulomb(0.3, 0.0), RigidStop(0.18, 0.5)), Regime.STUCK),
        # rests on the stop for part of each turn
        (Parts(STRIKER, drive(0.3), Coulomb(0.15, 0.0), RigidStop(0.125, 0.0)), Regime.CHATTERING),
        (Parts(STRIKER, drive(0.3), Coulomb(0.15, 0.0), RigidStop(0.125, 0.2)), Regime.CHATTERING),
        # friction alone holds it on the stop
        (Parts(STRIKER, drive(0.5), Coulomb(0.2, 0.0), RigidStop(0.15, 0.0)), Regime.CHATTERING),
        (Parts(STRIKER, drive(0.2, 0.02), Viscous(0.2), RigidStop(0.12, 0.4)), Regime.CHATTERING),
    ],
    ids=str,
)
def test_closed_form_and_steps_agree(parts: Parts, regime: Regime) -> None:
    form, steps = both(parts, AT_REST)
    assert Regime(form.regime) == Regime(steps.regime) == regime
    if regime != Regime.CHATTERING:  # of whose impacts some are too soft to count
        assert (form.cycle, form.impacts) == (steps.cycle, steps.impacts)
    for figure in FIGURES if regime != Regime.CHATTERING else FIGURES[2:]:
        assert getattr(form, figure) == pytest.approx(
            getattr(steps, figure), rel=1e-5, abs=5e-6 if figure.startswith("x_") else 1e-6, nan_ok=True
        ), figure


def test_energy_of_a_cycle_balances() -> None:
    outcome = follow(VISCOUS, 1.2, AT_REST, PAPER)
    assert outcome.drive_j == pytest.approx(outcome.friction_j + outcome.loss_j, rel=1e-9)
    assert outcome.loss_j == pytest.approx(0.5 * 0.8 * 0.75 * outcome.v_mean_m_s**2, rel=1e-9)
    assert outcome.impulse_n_s == pytest.approx(0.8 * 1.5 * outcome.v_mean_m_s, rel=1e-9)


def test_non_impact_amplitude_is_the_linear_one() -> None:
    outcome = follow(VISCOUS, 1.6, AT_REST, CLASSIFY._replace(measure=True))
    zeta = 0.2 / (2.0 * 0.8 * VISCOUS.natural_rad_s)
    amplitude = 0.02 / abs(1.0 - 1.6**2 + 2j * zeta * 1.6)
    assert outcome.certain
    assert outcome.x_high_m - 0.12 == pytest.approx(amplitude, rel=1e-9)
    assert outcome.drive_j == pytest.approx(outcome.friction_j, rel=1e-12)


def test_a_run_up_begins_and_a_run_down_ends_where_theory_grazes() -> None:
    # |H(r)| A = gap: (1 − r²)² + (2 ζ r)² = (A / gap)²
    zeta = 0.2 / (2.0 * 0.8 * VISCOUS.natural_rad_s)
    low, high = np.sqrt(np.sort(np.roots([1.0, 4.0 * zeta**2 - 2.0, 1.0 - (0.02 / 0.06) ** 2])))
    up, down = run(VISCOUS, "up"), run(VISCOUS, "down")
    assert up.edges[0].kind == down.edges[0].kind == "grazing"
    assert up.edges[0].ratio == pytest.approx(low, abs=5e-5)
    assert down.edges[0].ratio == pytest.approx(high, abs=5e-5)
    # one impact per period ends in the run-up at a ratio from which no start at its own state survives
    last = up.edges[-1].ratio
    state = up.state_at(1.40)
    assert follow(VISCOUS, min(last, 1.405), state, CONTINUE).impacts > 0.0
    assert follow(VISCOUS, last + 0.003, state, CONTINUE).impacts == 0.0


@pytest.mark.parametrize(("case", "ratio"), [(VISCOUS, 1.35), (COULOMB, 1.2)])
def test_stopped_early_as_in_full(case: Case, ratio: float) -> None:
    """Each cell's class is that of the whole run, and of the run with ten times finer certainty."""
    y_m, v_m_s = axes(case, "state", 30)
    starts = np.array([(y, v, 0.0) for v in v_m_s for y in y_m])
    carrier = carrier_of(case.scene(ratio))
    early, early_impacts = classify(carrier, starts, CLASSIFY)
    whole = CLASSIFY._replace(settle_s=80.0, record_s=20.0, stop_early=False)
    late, late_impacts = classify(carrier, starts, whole)
    assert np.all(early >= 0)
    assert np.array_equal(early, -1 - late)
    assert np.allclose(early_impacts, late_impacts)


def test_an_orbit_does_not_depend_on_the_crank_turns_before_it() -> None:
    one = follow(VISCOUS, 1.3, State(0.02, 0.3, 1.0), CLASSIFY)
    other = follow(VISCOUS, 1.3, State(0.02, 0.3, 1.0 + 2.0 * math.pi), CLASSIFY)
    assert one.v_mean_m_s == pytest.approx(other.v_mean_m_s, rel=1e-9)


@pytest.mark.parametrize(("case", "ratio"), [(VISCOUS, 1.4), (COULOMB, 1.2)])
def test_borders_lie_within_the_stated_bound(case: Case, ratio: float) -> None:
    """The border of a basin by orbits stopped early, and by whole runs of 300 s, along a row of starts."""
    whole = CLASSIFY._replace(settle_s=280.0, record_s=20.0, stop_early=False)
    y_m = axes(case, "state", 40)[0]
    row = np.column_stack((y_m, np.full(40, -0.1), np.zeros(40)))
    carrier = carrier_of(case.scene(ratio))
    reaches_stop = classify(carrier, row, CLASSIFY)[1] > 0.0
    (places,) = np.nonzero(reaches_stop[1:] != reaches_stop[:-1])
    assert len(places) > 0
    for place in places:
        found = []
        for protocol in (CLASSIFY, whole):
            low, high = y_m[place], y_m[place + 1]
            for _ in range(40):
                middle = 0.5 * (low + high)
                impacts = classify(carrier, np.array([[middle, -0.1, 0.0]]), protocol)[1]
                low, high = (middle, high) if (impacts[0] > 0.0) == reaches_stop[place] else (low, middle)
            found.append(low)
        assert abs(found[0] - found[1]) < BORDER_BOUND_M


def test_every_cell_of_a_basin_is_the_other_solvers() -> None:
    y_m, v_m_s = axes(VISCOUS, "state", 30)
    starts = np.array([(y, v, 0.0) for v in v_m_s for y in y_m])
    scene = VISCOUS.scene(1.3)
    early, _ = classify(carrier_of(scene), starts, CLASSIFY)
    parts = scene.parts()
    whole = CLASSIFY._replace(settle_s=40.0, record_s=10.0, stop_early=False)
    late, _ = classify(stepwise(parts, memory_of(parts, 1e-12)), starts, whole)
    assert np.array_equal(early, -1 - late)


def test_a_striker_that_the_spring_never_quite_lets_go_of_the_stop_is_stuck() -> None:
    """The gap is −A: the spring presses but for the instant in which the piston turns round."""
    friction, stop = Viscous(0.05), RigidStop(0.09, 0.5)
    parts = Parts(STRIKER, drive(2.0), friction, stop)
    assert [Regime(one.regime) for one in both(parts, State(-0.03, 0.3, 0.0))] == [Regime.STUCK] * 2


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
    nothing = Grid(np.empty(0), np.empty((0, 2)))
    run_solver(slow, NoSensing(), memory, 0.0, 0.0, until_s, nothing)
    turned = (0.1 * until_s - memory.held[0].crank_rad) / (2.0 * math.pi)
    assert abs(turned - round(turned)) * 2.0 * math.pi / 0.1 < 1e-8  # s
