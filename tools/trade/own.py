"""The plant's solvers as methods of the comparison, and time stepping beside them."""

import math

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.result import SimulationResult
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive import adaptive
from plant_sim.solvers.exact import exact
from tools.trade.cases import Answer, Case, Method, Solve, answer
from tools.trade.peers import stepping

ACCURACIES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
STEPS_RAD = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003)
"""Steps as phase angles of the faster of drive and free oscillation."""

TRUTH_ACCURACY = 1e-13


def truth(case: Case) -> Answer:
    """Return the reference answer: by the closed form, or if there is none by the finest adaptive run."""
    return (_adaptive(case, TRUTH_ACCURACY) if case.scene.beyond_closed_form else _exact(case))()


def methods(case: Case, quick: bool) -> list[Method]:
    """Return all solvers that support the case, at all their settings."""
    found = [] if case.scene.beyond_closed_form else [Method("exact", "", _exact(case))]
    for accuracy in ACCURACIES[1::2] if quick else ACCURACIES:
        found.append(Method("adaptive", f"{accuracy:.0e}", _adaptive(case, accuracy)))
    if isinstance(case.parts.drive, IdealDrive) and isinstance(case.parts.stop, NoStop | RigidStop):
        for step_rad in STEPS_RAD[1:4:2] if quick else STEPS_RAD:
            fastest_rad_s = max(2.0 * math.pi / case.period_s, case.scene.natural_rad_s)
            found.append(Method("stepping", f"{step_rad:g} rad", _stepping(case, step_rad / fastest_rad_s)))
    return found


def _exact(case: Case) -> Solve:
    parts, start = case.parts, initial_state(case.scene)
    return lambda: _answer(exact.simulate(parts, start, case.until_s))


def _adaptive(case: Case, accuracy: float) -> Solve:
    parts, start = case.parts, initial_state(case.scene)
    return lambda: _answer(
        adaptive.simulate(parts, start, case.until_s, torque_n_m=case.torque_n_m, accuracy=accuracy)
    )


def _stepping(case: Case, step_s: float) -> Solve:
    parts, start = case.parts, initial_state(case.scene)

    def solve() -> Answer:
        run = stepping.simulate(parts, start, case.until_s, step_s)
        t_s, v_m_s, v_after_m_s = run.impacts
        return answer(t_s, v_m_s, v_after_m_s, run.x_m, run.v_m_s)

    return solve


def _answer(result: SimulationResult) -> Answer:
    impacts, final = result.impacts, result.final
    return answer(impacts.t_s, impacts.v_m_s, impacts.v_after_m_s, final.x_m, final.v_m_s)
