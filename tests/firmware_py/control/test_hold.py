"""The law of the hold on the map from one impact of a rigid stop to the next."""

import math
from collections.abc import Callable
from functools import cache

import numpy as np
import pytest
from closed_loop import Bench

from firmware_py.core.control import hold
from firmware_py.core.control.hold import HoldState
from firmware_py.core.estimation import regime
from firmware_py.core.estimation.regime import Period
from firmware_py.core.gait import follow
from firmware_py.core.inputs import OperatorInput
from firmware_py.core.request import Request
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import ActingLimit, Mode, OperatorRequest, Refusal, Regime
from firmware_py.shell.parameters import config_from
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.result import MotionState, Phase
from plant_sim.solvers.exact.exact import simulate

CONFIG = config_from({})
M_KG, C_N_PER_M, B_N_S_M, A_M, GAP_M, K = 0.8, 70.0, 0.2, 0.02, 0.06, 0.5
OMEGA = math.sqrt(C_N_PER_M / M_KG)


def next_impact(v_m_s: float, phase_rad: float, ratio: float) -> tuple[float, float]:
    """Speed and crank phase of the next impact after `v_m_s` and `phase_rad` past the forward dead centre."""
    speed = ratio * OMEGA
    drive, stop = IdealDrive(A_M, speed, 0.0), RigidStop(GAP_M, K)
    module = Parts(Striker(M_KG, C_N_PER_M, 0.0, 9.80665), drive, Viscous(B_N_S_M), stop)
    left = MotionState(0.0, GAP_M, -K * v_m_s, phase_rad + 0.5 * math.pi, speed, Phase.FLIGHT)
    impacts = simulate(module, left, 1.6 * math.tau / speed).impacts
    return float(impacts.v_m_s[0]), phase_rad + speed * float(impacts.t_s[0]) - math.tau


@cache
def steady_impact(ratio: float) -> tuple[float, float]:
    """The orbit with one impact a period, followed from r = 1 upwards as a start does."""
    v, phase = 0.4, 0.05
    for r in np.append(np.arange(1.0, ratio, 0.01), ratio):
        for _ in range(12 if r < ratio else 200):
            v, phase = next_impact(v, phase, float(r))
    return v, phase


def largest_eigenvalue(ratio: float, law: Callable[[float, float, float], float], late: bool) -> float:
    """Of the loop closed from impact to impact, `late` by one more; `law` gives the step from (v, φ, r)."""
    v, phase = steady_impact(ratio)

    def around(s: np.ndarray) -> np.ndarray:
        impact = next_impact(s[0], s[1], s[2])
        following = s[3] + law(impact[0], impact[1], s[3])
        return np.array([*impact, s[3], following] if late else [*impact, following, following])

    at = np.array([v, phase, ratio, ratio])
    # The law's own steady step is taken off: what matters is how it answers deviations.
    e, columns = 1e-6, []
    for k in range(4):
        d = np.zeros(4)
        d[k] = e
        columns.append((around(at + d) - around(at - d)) / (2 * e))
    return float(np.abs(np.linalg.eigvals(np.column_stack(columns))).max())


RATIOS = (1.0, 1.1, 1.2, 1.3, 1.33)


def test_the_phase_rises_with_the_speed_at_about_the_scheduled_slope() -> None:
    for ratio in RATIOS[1:]:
        slope = (steady_impact(ratio + 0.005)[1] - steady_impact(ratio - 0.005)[1]) / 0.01
        phase = steady_impact(ratio)[1]
        p = CONFIG.p
        scheduled = (
            p.hold.gain_phase * (math.radians(p.hold.highest_phase_deg) - phase) / hold.phase_step(p, phase)
        )
        assert 0.4 < slope / scheduled < 2.5, (ratio, slope, scheduled)


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("ratio", RATIOS)
def test_the_phase_loop_is_stable_and_its_sign_is_right(ratio: float, late: bool) -> None:
    right = largest_eigenvalue(ratio, lambda _v, phase, _r: hold.phase_step(CONFIG.p, phase), late)
    assert right < 0.98
    wrong = largest_eigenvalue(ratio, lambda _v, phase, _r: -hold.phase_step(CONFIG.p, phase), late)
    assert wrong > 1.0


@pytest.mark.parametrize("late", [False, True])
@pytest.mark.parametrize("ratio", RATIOS[1:4])
def test_the_impulse_loop_is_stable_and_its_sign_is_right(ratio: float, late: bool) -> None:
    held = (1.0 + K) * M_KG * steady_impact(ratio)[0]

    def law(v: float, _phase: float, r: float) -> float:
        return hold.wanted_step(CONFIG.p, r, request(0.0, held), (1.0 + K) * M_KG * v)

    assert largest_eigenvalue(ratio, law, late) < 0.98
    assert largest_eigenvalue(ratio, lambda *impact: -law(*impact), late) > 1.0


def request(ratio: float, impulse_n_s: float) -> Request:
    operator = OperatorInput(OperatorRequest.RUN, ratio, impulse_n_s, 0, NEVER_TICKS)
    return follow.operator_request(operator)


def period(phase_deg: float, impacts: int = 1) -> regime.RegimeState:
    last = Period(impacts, 0.9, math.radians(phase_deg), 300.0)
    return regime.INITIAL._replace(ended=True, last=last, second=last)


def held(
    periods: int,
    phase_deg: float = 30.0,
    impact: float = 0.8,
    target: float = 1.3,
    impulse: float = 0.0,
    impacts: int = 1,
    holding: bool = True,
) -> HoldState:
    """`periods` periods of 0.5 s at r = 1.3."""
    state = hold.INITIAL
    for tick in range(500 * periods):
        seen = period(phase_deg, impacts) if tick % 500 == 0 else regime.INITIAL
        if holding:
            state = hold.step(CONFIG.p, state, request(target, impulse), 1.3, seen, impact)
        else:
            state = hold.rest(CONFIG.p, request(target, impulse))
    return state


def test_at_the_speed_asked_for_nothing_moves() -> None:
    assert held(10) == hold.INITIAL._replace(impulse_n_s=0.8)


def test_the_ratio_creeps_up_until_the_phase_says_stop() -> None:
    assert 0.0 < held(5, target=1.4).trim < 0.0751
    assert held(30, target=1.4).trim == pytest.approx(0.1)
    assert held(30, target=1.4, phase_deg=64.5).trim == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("impacts", [0, 2])
def test_without_exactly_one_impact_nothing_moves(impacts: int) -> None:
    assert held(10, impulse=1.0, impacts=impacts).trim == 0.0


def test_what_the_region_cannot_give_is_refused_with_its_reason() -> None:
    assert held(60, impulse=1.2, phase_deg=65.0).refusal == Refusal.IMPULSE_TOO_HIGH
    assert held(80, impulse=1.2).refusal == Refusal.IMPULSE_TOO_HIGH
    assert held(80, impulse=0.5).refusal == Refusal.IMPULSE_TOO_LOW
    assert held(80, impulse=0.8).refusal == Refusal.NONE
    for impulse in (5.0, 0.01, math.nan, math.inf, -1.0):
        refused = held(2, impulse=impulse)
        assert refused.refusal == Refusal.IMPULSE_OUT_OF_RANGE
        assert refused.trim == 0.0


def test_a_ratio_that_the_guard_keeps_from_is_refused() -> None:
    assert held(30, target=1.4, phase_deg=64.6).refusal == Refusal.RATIO_TOO_HIGH
    assert held(5, target=1.4, phase_deg=64.6).refusal == Refusal.NONE
    assert held(30, target=1.4).refusal == Refusal.NONE
    state = held(30, target=1.4, phase_deg=64.6)
    asked = hold.step(CONFIG.p, state, request(1.4, 0.8), 1.3, regime.INITIAL, 0.8)
    assert asked.refusal == Refusal.NONE
    lowered = hold.step(CONFIG.p, state, request(1.3, 0.0), 1.3, period(64.6), 0.8)
    assert lowered.refusal == Refusal.NONE
    assert held(80, impulse=5.0, target=1.4, phase_deg=64.6).refusal == Refusal.IMPULSE_OUT_OF_RANGE


def test_a_refusal_ends_with_its_request() -> None:
    state = held(2, impulse=5.0)
    assert hold.step(CONFIG.p, state, request(1.3, 0.0), 1.3, regime.INITIAL, 0.8).refusal == Refusal.NONE
    assert held(1, impulse=5.0, holding=False).refusal == Refusal.IMPULSE_OUT_OF_RANGE


def test_not_a_number_moves_nothing() -> None:
    for phase, impact in ((math.nan, 0.8), (30.0, math.nan)):
        state = held(5, phase_deg=phase, impact=impact, impulse=0.9)
        assert abs(state.trim) < 0.0751


def test_a_ratio_beyond_the_fold_is_held_before_it() -> None:
    """At 1.44 there is no impact regime any more; the firmware goes as far as the phase allows."""
    bench = Bench({"start.rise_s": 4.0}, ratio=1.44).started()
    bench.run(22.0)
    reports = [o for o in bench.outputs[-3000:] if o.period_ended]
    assert bench.node.outputs.mode == Mode.RUN
    assert bench.node.outputs.regime == Regime.IMPACT
    assert bench.node.outputs.acting_limit == ActingLimit.IMPACT_PHASE
    for report in reports:
        assert math.degrees(report.impact_phase_rad) == pytest.approx(65.0, abs=6.0)
        assert report.impact_impulse_n_s > 1.0
