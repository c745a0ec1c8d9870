"""Orbits followed without being stored: against the other solver, against theory, and stopped early."""

import math
from dataclasses import replace

import numpy as np
import pytest

from plant_sim.result import MotionState, Phase
from plant_sim.solvers.adaptive.state_layout import allocate
from tools.study.basin import BORDER_BOUND_M, axes
from tools.study.cases import Case, case
from tools.study.orbits.follow import AT_REST, State, carrier_of, classify, follow, follow_orbit
from tools.study.orbits.sections import CLASSIFY, PAPER, Regime
from tools.study.orbits.stepwise import stepwise
from tools.study.sweep import CONTINUE, run

VISCOUS, COULOMB = case("table1", "viscous"), case("table1", "coulomb")


def by_the_other_solver(case: Case, ratio: float, start: State):
    """The same law as a special case of Stribeck's, integrated step by step."""
    parts = case.scene(ratio).parts()
    rest = MotionState(0.0, case.rest_length_m, 0.0, 0.0, 0.0, Phase.FLIGHT)
    memory = allocate(parts, rest, 1e-11, 256)
    return follow_orbit(stepwise(parts, memory), start, PAPER)


@pytest.mark.parametrize(
    ("case", "ratio"), [(VISCOUS, 1.2), (VISCOUS, 1.5), (COULOMB, 1.1), (COULOMB, 1.5), (COULOMB, 0.9)]
)
def test_closed_form_and_steps_agree(case: Case, ratio: float) -> None:
    closed, stepped = follow(case, ratio, AT_REST, PAPER), by_the_other_solver(case, ratio, AT_REST)
    assert closed.regime == stepped.regime
    assert (closed.cycle, closed.impacts) == (stepped.cycle, stepped.impacts)
    for figure in ("v_mean_m_s", "impulse_n_s", "x_low_m", "x_high_m", "drive_j", "friction_j", "loss_j"):
        assert getattr(closed, figure) == pytest.approx(
            getattr(stepped, figure), rel=1e-5, abs=5e-6 if figure.startswith("x_") else 1e-9, nan_ok=True
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


def test_regimes_have_their_names() -> None:
    assert follow(VISCOUS, 1.2, AT_REST, CLASSIFY).regime == Regime.IMPACT
    assert follow(VISCOUS, 1.5, AT_REST, CLASSIFY).regime == Regime.NON_IMPACT
    assert follow(COULOMB, 0.9, AT_REST, CLASSIFY).regime == Regime.PERIOD_N
    assert follow(case("table1", "coulomb", 0.3), 1.0, AT_REST, CLASSIFY).regime == Regime.STUCK
    pressed = replace(VISCOUS, stop_m=0.12, amplitude_m=0.02, restitution=0.4)
    assert follow(pressed, 0.2, AT_REST, CLASSIFY).regime == Regime.CHATTERING


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


@pytest.mark.parametrize(("case", "ratio"), [(VISCOUS, 1.3), (VISCOUS, 1.35), (COULOMB, 1.2)])
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


@pytest.mark.parametrize(("case", "ratio"), [(VISCOUS, 1.35), (VISCOUS, 1.4), (COULOMB, 1.2)])
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
    y_m, v_m_s = axes(VISCOUS, "state", 100)
    starts = np.array([(y, v, 0.0) for v in v_m_s for y in y_m])
    scene = VISCOUS.scene(1.3)
    early, _ = classify(carrier_of(scene), starts, CLASSIFY)
    parts = scene.parts()
    rest = MotionState(0.0, 0.12, 0.0, 0.0, 0.0, Phase.FLIGHT)
    whole = CLASSIFY._replace(settle_s=40.0, record_s=10.0, stop_early=False)
    memory = allocate(parts, rest, 1e-12, 256)
    late, _ = classify(stepwise(parts, memory), starts, whole)
    assert np.array_equal(early, -1 - late)
