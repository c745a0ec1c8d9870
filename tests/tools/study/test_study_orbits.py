"""Long motions and what they end in: against theory, by both solvers, and whatever their duration."""

import math

import numpy as np
import pytest

from firmware_py.interface.enums import Regime
from plant_sim.scene import Scene, load_scene
from tools.output import BadInputError
from tools.study.basin import axes
from tools.study.cases import Case, case
from tools.study.orbits import (
    AT_REST,
    CLASSIFY,
    PAPER,
    State,
    classify,
    cycle_of,
    follow,
    motion,
    outcome_of,
    turn_s,
)
from tools.study.sweep import CONTINUE, run

VISCOUS, COULOMB = case("table1", "viscous"), case("table1", "coulomb")
FIGURES = ("impacts", "v_mean_m_s", "impulse_n_s", "x_low_m", "x_high_m", "drive_j", "friction_j", "loss_j")


def scene(ratio: float, friction: dict, stop_m: float, k: float, amplitude_m: float = 0.03) -> Scene:
    tables = VISCOUS.tables(ratio)
    tables["drive"]["amplitude_m"] = amplitude_m
    stop = {"law": "rigid", "position_m": stop_m, "restitution": k}
    return load_scene({**tables, "friction": friction, "stop": stop})


def coulomb(ratio: float, mu: float, stop_m: float, k: float) -> Scene:
    return scene(ratio, {"law": "coulomb", "mu": mu}, stop_m, k)


@pytest.mark.parametrize(
    ("module", "regime"),
    [
        (VISCOUS.scene(1.2), Regime.IMPACT),
        (VISCOUS.scene(1.5), Regime.NON_IMPACT),
        (COULOMB.scene(0.9), Regime.PERIOD_N),
        (COULOMB.scene(1.1), Regime.IMPACT),
        (COULOMB.scene(1.5), Regime.NON_IMPACT),
        # slides and sticks in turn
        (coulomb(0.3, 0.2, 0.18, 0.0), Regime.NON_IMPACT),
        (coulomb(0.3, 0.3, 0.18, 0.5), Regime.STUCK),
        # rests on the stop for part of each turn
        (coulomb(0.3, 0.15, 0.125, 0.0), Regime.CHATTERING),
        (coulomb(0.3, 0.15, 0.125, 0.2), Regime.CHATTERING),
        (scene(0.2, {"law": "viscous", "b_n_s_m": 0.2}, 0.12, 0.4, 0.02), Regime.CHATTERING),
    ],
)
def test_regimes(module: Scene, regime: Regime) -> None:
    assert follow(module, AT_REST, PAPER).regime == regime


@pytest.mark.parametrize("module", [VISCOUS.scene(1.2), COULOMB.scene(0.9), COULOMB.scene(1.5)], ids=str)
def test_the_adaptive_solver_gives_the_figures_of_the_closed_form(
    module: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    form = follow(module, AT_REST, PAPER)
    monkeypatch.setattr(Scene, "beyond_closed_form", ("a test",))
    steps = follow(module, AT_REST, PAPER)
    assert (form.regime, form.cycle) == (steps.regime, steps.cycle)
    for figure in FIGURES:
        assert getattr(form, figure) == pytest.approx(
            getattr(steps, figure), rel=1e-5, abs=1e-6, nan_ok=True
        ), figure


def test_energy_of_a_cycle_balances() -> None:
    outcome = follow(VISCOUS.scene(1.2), AT_REST, PAPER._replace(settle_s=200.0))
    assert outcome.drive_j == pytest.approx(outcome.friction_j + outcome.loss_j, rel=1e-9)
    assert outcome.loss_j == pytest.approx(0.5 * 0.8 * 0.75 * outcome.v_mean_m_s**2, rel=1e-9)
    assert outcome.impulse_n_s == pytest.approx(0.8 * 1.5 * outcome.v_mean_m_s, rel=1e-9)


def test_non_impact_amplitude_is_the_linear_one() -> None:
    outcome = follow(VISCOUS.scene(1.6), AT_REST, PAPER._replace(settle_s=200.0))
    zeta = 0.2 / (2.0 * 0.8 * VISCOUS.natural_rad_s)
    amplitude = 0.02 / abs(1.0 - 1.6**2 + 2j * zeta * 1.6)
    assert outcome.cycle == 1
    assert outcome.x_high_m - 0.12 == pytest.approx(amplitude, rel=1e-6)
    assert outcome.x_low_m - 0.12 == pytest.approx(-amplitude, rel=1e-6)
    assert outcome.drive_j == pytest.approx(outcome.friction_j, rel=1e-9)


def test_a_run_up_begins_and_a_run_down_ends_where_theory_grazes() -> None:
    # |H(r)| A = gap: (1 − r²)² + (2 ζ r)² = (A / gap)²
    zeta = 0.2 / (2.0 * 0.8 * VISCOUS.natural_rad_s)
    low, high = np.sqrt(np.sort(np.roots([1.0, 4.0 * zeta**2 - 2.0, 1.0 - (0.02 / 0.06) ** 2])))
    up, down = run(VISCOUS, "up"), run(VISCOUS, "down")
    assert up.edges[0] == pytest.approx(low, abs=5e-5)
    assert down.edges[0] == pytest.approx(high, abs=5e-5)
    # one impact per period ends in the run-up at a ratio from which no start at its own state survives
    last = up.edges[-1]
    state = up.state_at(1.40)
    assert follow(VISCOUS.scene(min(last, 1.405)), state, CONTINUE).impacts > 0.0
    assert follow(VISCOUS.scene(last + 0.003), state, CONTINUE).impacts == 0.0


@pytest.mark.parametrize(("module", "ratio"), [(VISCOUS, 1.35), (COULOMB, 1.2)])
def test_a_start_ends_in_the_same_after_six_times_the_time(
    module: Case, ratio: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    y_m, v_m_s = axes(module, "state", 20)
    starts = np.array([(y, v, 0.0) for v in v_m_s for y in y_m])
    found, rates = classify(module.scene(ratio), starts)
    assert np.all(found > 0)
    monkeypatch.setattr("tools.study.orbits.CLASSIFY", CLASSIFY._replace(settle_s=300.0))
    assert np.allclose(classify(module.scene(ratio), starts)[1], rates)
    assert set(rates) == {0.0, 1.0}


def test_a_class_is_the_outcome_of_the_motion() -> None:
    starts = np.array([(y, 0.2, 1.0) for y in (-0.08, -0.02, 0.01, 0.05)])
    cycles, rates = classify(COULOMB.scene(0.9), starts)
    outcomes = [follow(COULOMB.scene(0.9), State(*start), CLASSIFY) for start in starts.tolist()]
    assert [(one.cycle, one.impacts) for one in outcomes] == list(zip(cycles, rates, strict=True))


def test_a_motion_does_not_depend_on_the_crank_turns_before_it() -> None:
    one = follow(VISCOUS.scene(1.3), State(0.02, 0.3, 1.0), CLASSIFY)
    other = follow(VISCOUS.scene(1.3), State(0.02, 0.3, 1.0 + 2.0 * math.pi), CLASSIFY)
    assert one.v_mean_m_s == pytest.approx(other.v_mean_m_s, rel=1e-9)


@pytest.mark.parametrize(
    ("counts", "v_m_s", "cycle"),
    [
        ([1] * 17, [0.5] * 17, 1),
        ([2, 1] * 8, [0.5, 0.3, 0.4] * 8, 2),
        ([0] * 17, [], 1),
        ([1] * 17, list(np.linspace(0.5, 0.6, 17)), 0),
        ([0, *[1, 0, 0, 0, 0, 0, 0, 0] * 2], [0.5, 0.5], 8),
        # alternating sides of a cycle of one turn: two turns repeat, and one nearly does
        ([1] * 17, [0.5 + 2e-6 * (-1) ** n for n in range(17)], 0),
        ([1] * 17, [0.5 + 1e-2 * (-1) ** n for n in range(17)], 2),
        ([1, 1, 1], [0.5] * 3, 0),
    ],
)
def test_cycles(counts: list[int], v_m_s: list[float], cycle: int) -> None:
    assert cycle_of(np.array(counts), np.array(v_m_s), 1e-6) == cycle


def test_impacts_that_end_within_the_record_are_lost() -> None:
    """Beyond the fold of the branch, from one of its last stable orbits."""
    last = follow(VISCOUS.scene(1.40), State(0.06, -0.45, 2.9), PAPER._replace(settle_s=200.0))
    assert last.regime == Regime.IMPACT
    found = [follow(VISCOUS.scene(1.42), last.end, PAPER._replace(settle_s=s)) for s in (0.0, 60.0)]
    assert [one.regime for one in found] == [Regime.LOST, Regime.NON_IMPACT]


def test_figures_are_those_of_whole_cycles() -> None:
    """Of 9 turns with an impact in every second one, the last 8 count."""
    module = COULOMB.scene(0.9)
    end = follow(module, AT_REST, PAPER).end
    turns = 17
    found = outcome_of(module, motion(module, end, turns * turn_s(module)), turns, 1e-4)
    assert found.cycle > 1
    assert found.impacts * found.cycle == pytest.approx(round(found.impacts * found.cycle))


def test_a_tilt_moves_the_module_away_from_its_stop() -> None:
    """Upright, gravity pulls the striker 0.11 m off the stop: no impacts, by each way to an outcome."""
    module = VISCOUS.scene(1.2)
    upright = load_scene({**VISCOUS.tables(1.2), "housing": {"tilt_rad": 0.5 * math.pi}})
    starts = np.array([AT_REST])
    assert classify(module, starts)[1] == [1.0]
    assert classify(upright, starts)[1] == [0.0]
    assert follow(upright, AT_REST, CLASSIFY).impacts == 0.0


def test_orbits_of_a_crank_that_stands_are_refused() -> None:
    for study in (lambda one: classify(one, np.array([AT_REST])), lambda one: follow(one, AT_REST, CLASSIFY)):
        with pytest.raises(BadInputError, match="the drive's speed is 0"):
            study(VISCOUS.scene(0.0))
