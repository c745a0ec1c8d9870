"""Moreau–Jean time stepping with a fixed step, of first order and robust: a peer of the plant's own solvers.

One step of the θ-scheme solves for the velocity together with the impulses of stop and dry friction, so that
impact, stick and rest need no events (Jean, Comput. Methods Appl. Mech. Eng. 177, 1999; Acary & Brogliato,
Numerical Methods for Nonsmooth Dynamical Systems, 2008, ch. 10):

    M̂ v₁ = r + P_f + P_n,   y₁ = y₀ + h [(1 − ϑ) v₀ + ϑ v₁],   M̂ = m + ϑ h b + ϑ² h² c
    P_f ∈ −h μ m g Sgn(v₁)
    0 ≥ P_n ⊥ v₁ + k v₀ ≤ 0   where y₀ + h v₀ / 2 reaches the stop

The striker may penetrate the stop by the path of one step.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.jets import NOW
from plant_sim.kernels import jit
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import constant_speed_rad_s
from plant_sim.parts.friction import ROUNDING, damping_n_s_m, friction_force_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import has_no_stop, restitution, stop_position_m
from plant_sim.result import MotionState
from plant_sim.solvers.double_double import turn_by

THETA = 0.5


class Run(NamedTuple):
    """Impacts of a run, shape (3, n): time, velocity before, velocity after; and position and velocity at its
    end."""

    impacts: NDArray[np.float64]
    x_m: float
    v_m_s: float


@jit
def _step(parts: Parts, y: float, v: float, x_A0: float, x_A1: float, h: float) -> tuple[float, float, bool]:
    """Position and velocity after a step, and whether the striker met the stop in it."""
    striker, friction, stop = parts.striker, parts.friction, parts.stop
    m, c, b = striker.mass_kg, striker.spring_n_per_m, damping_n_s_m(friction)
    # m (v₁ − v₀) = −h [(1 − ϑ) (c s₀ + b v₀) + ϑ (c s₁ + b v₁)] + P_f + P_n,  s = y − x_A
    effective = m + THETA * h * b + THETA * THETA * h * h * c
    ahead = y + (1.0 - THETA) * h * v
    right = m * v - h * ((1.0 - THETA) * (c * (y - x_A0) + b * v) + THETA * c * (ahead - x_A1))
    # Friction of the speed before the step, without its viscous part, which is in M̂.
    dry = -h * (friction_force_n(friction, NOW, m * striker.gravity_m_s2, abs(v), 1.0) + b * abs(v))
    # What dry friction leaves of the momentum.
    sliding = abs(right) - dry if abs(right) > dry * (1.0 + ROUNDING) else 0.0
    v1 = math.copysign(sliding, right) / effective
    rebound = -restitution(stop) * v
    gap = stop_position_m(stop) - striker.rest_length_m
    meets = not has_no_stop(stop) and y + 0.5 * h * v >= gap and v1 > rebound
    if meets:
        v1 = rebound
    return ahead + THETA * h * v1, v1, meets


@jit
def _run(
    parts: Parts, start: tuple[float, float, float, float], until_s: float, step_s: float
) -> tuple[NDArray[np.float64], float, float]:
    """`simulate` in y = x − l0; `start` is t, y, v and crank angle."""
    A, Omega = parts.drive.amplitude_m, constant_speed_rad_s(parts.drive)
    t0, y, v = start[0], start[1], start[2]
    crank, crank_low = turn_by(start[3], 0.0, 0.0, 0.0, 0.0)
    x_A = A * math.sin(crank)
    gap = stop_position_m(parts.stop) - parts.striker.rest_length_m
    impacts, found = np.empty((3, 64)), 0
    for index in range(max(math.ceil((until_s - t0) / step_s - 1e-9), 0)):
        t = t0 + index * step_s
        h = min(step_s, until_s - t)
        crank, crank_low = turn_by(crank, crank_low, Omega, 0.0, h)
        x_A1 = A * math.sin(crank)
        y1, v1, meets = _step(parts, y, v, x_A, x_A1, h)
        # A resting striker is caught at the speeds that one step's acceleration gives: those are no impacts.
        if meets and v > 2.0 * h * abs(parts.striker.spring_n_per_m * (y - x_A)) / parts.striker.mass_kg:
            if found == impacts.shape[1]:
                impacts = np.concatenate((impacts, np.empty_like(impacts)), axis=1)
            impacts[:, found] = (t + min(max((gap - y) / v, 0.0), h), v, v1)
            found += 1
        y, v, x_A = y1, v1, x_A1
    return impacts[:, :found], y, v


def simulate(parts: Parts, initial: MotionState, until_s: float, step_s: float) -> Run:
    """Run a module with an ideal drive and no or a rigid stop to `until_s` in steps of `step_s`.

    The errors of positions and times are of the order of one step.
    """
    rest_m = parts.striker.rest_length_m
    start = (float(initial.t_s), float(initial.x_m - rest_m), float(initial.v_m_s), float(initial.crank_rad))
    impacts, y_m, v_m_s = _run(kernel_parts(parts), start, float(until_s), step_s)
    return Run(impacts, rest_m + y_m, v_m_s)
