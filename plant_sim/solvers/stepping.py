"""The stepping solver: Moreau–Jean time stepping with a fixed step, of first order and robust.

One step of the θ-scheme solves for the velocity together with the impulses of stop and dry friction, so that
impact, stick and rest need no events (Jean, Comput. Methods Appl. Mech. Eng. 177, 1999; Acary & Brogliato,
Numerical Methods for Nonsmooth Dynamical Systems, 2008, ch. 10):

    M̂ v₁ = r + P_f + P_n,   y₁ = y₀ + h [(1 − ϑ) v₀ + ϑ v₁],   M̂ = m + ϑ h b + ϑ² h² c
    P_f ∈ −h μ m g Sgn(v₁)
    0 ≥ P_n ⊥ v₁ + k v₀ ≤ 0   where y₀ + h v₀ / 2 reaches the stop

At ϑ = 1/2 the energies of a step balance to rounding. The striker may penetrate the stop by the path of one
step.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import jit
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import ROUNDING, Friction, damping_n_s_m, dry_force_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop, Stop, has_stop, restitution, stop_position_m
from plant_sim.parts.striker import Striker
from plant_sim.result import EnergyLedger, Impacts, MotionState, Phase, Samples, SimulationResult
from plant_sim.solvers.cost import ALLOWANCE, TIME_STEP, debt, too_costly
from plant_sim.solvers.double_double import TURN_RAD, turned
from plant_sim.solvers.exact.exact import UnsupportedSceneError, require_plain, sample_times, start_of

THETA = 0.5


class _Rig(NamedTuple):
    """The scene's constants of a step."""

    friction: Friction
    stop: Stop
    mass_kg: float
    spring_n_m: float
    gravity_m_s2: float
    gap_m: float


class _Step(NamedTuple):
    """The outcome of one step; the impulses are those of dry friction and stop on the striker."""

    y_m: float
    v_m_s: float
    dry_n_s: float
    contact_n_s: float
    phase: Phase


@jit
def _step(rig: _Rig, y: float, v: float, x_A0: float, x_A1: float, h: float) -> _Step:
    m, c, b = rig.mass_kg, rig.spring_n_m, damping_n_s_m(rig.friction)
    # m (v₁ − v₀) = −h [(1 − ϑ) (c s₀ + b v₀) + ϑ (c s₁ + b v₁)] + P_f + P_n,  s = y − x_A
    effective = m + THETA * h * b + THETA * THETA * h * h * c
    ahead = y + (1.0 - THETA) * h * v
    right = m * v - h * ((1.0 - THETA) * (c * (y - x_A0) + b * v) + THETA * c * (ahead - x_A1))
    dry = h * dry_force_n(rig.friction, m * rig.gravity_m_s2, v)
    # What dry friction leaves of the momentum.
    sliding = abs(right) - dry if abs(right) > dry * (1.0 + ROUNDING) else 0.0
    v1 = math.copysign(sliding, right) / effective
    rubbed, contact = effective * v1 - right, 0.0
    phase = Phase.STICK if sliding == 0.0 and dry > 0.0 else Phase.FLIGHT
    if has_stop(rig.stop):
        rebound = -restitution(rig.stop) * v
        if y + 0.5 * h * v >= rig.gap_m and v1 > rebound:
            v1 = rebound
            both = effective * v1 - right
            rubbed = -math.copysign(dry, v1) if v1 != 0.0 else min(max(both, -dry), dry)
            contact = both - rubbed
            phase = Phase.REST_ON_STOP if v1 == 0.0 else Phase.FLIGHT
    return _Step(ahead + THETA * h * v1, v1, rubbed, contact, phase)


@jit
def _run(
    striker: Striker,
    drive: IdealDrive,
    friction: Friction,
    stop: Stop,
    start: tuple[float, float, float, float],
    until_s: float,
    step_s: float,
    samples_t_s: NDArray[np.float64],
    samples: NDArray[np.float64],
) -> tuple[NDArray[np.float64], tuple[float, float, float], tuple[float, float, float, float], int]:
    """A whole run: impacts (6, n), final (y, v, crank), energies, phase. `start` is (t, y, v, crank)."""
    m, c, A, Omega = striker.mass_kg, striker.spring_n_m, drive.amplitude_m, drive.omega_rad_s
    gap = stop_position_m(stop) - striker.rest_length_m
    rig = _Rig(friction, stop, m, c, striker.gravity_m_s2, gap)
    t0, y, v = start[0], start[1], start[2]
    crank, crank_low = turned(start[3], 0.0, 0.0, 0.0, 0.0)
    x_A = A * math.sin(crank)
    stored = 0.5 * (m * v * v + c * (y - x_A) ** 2)
    drive_j, friction_j, impact_j = 0.0, 0.0, 0.0
    impacts, found, next_sample = np.empty((6, 64)), 0, 0
    phase = Phase.FLIGHT
    steps = max(math.ceil((until_s - t0) / step_s - 1e-9), 0)
    for index in range(steps):
        t = t0 + index * step_s
        h = min(step_s, until_s - t)
        crank_1, crank_low = turned(crank, crank_low, Omega, 0.0, h)
        x_A1 = A * math.sin(crank_1)
        end = _step(rig, y, v, x_A, x_A1, h)
        mean = 0.5 * (v + end.v_m_s)
        drive_j += 0.5 * c * ((x_A + x_A1) - (y + end.y_m)) * (x_A1 - x_A)
        friction_j += (h * damping_n_s_m(friction) * mean - end.dry_n_s) * mean
        impact_j -= end.contact_n_s * mean
        # A resting striker is caught at the speeds that one step's acceleration gives: those are no impacts.
        if end.contact_n_s != 0.0 and v > 2.0 * h * abs(c * (y - x_A)) / m:
            if found == impacts.shape[1]:
                impacts = np.concatenate((impacts, np.empty_like(impacts)), axis=1)
            lead = min(max((gap - y) / v, 0.0), h)
            impacts[:, found] = (t + lead, v, end.v_m_s, m * (v - end.v_m_s), np.nan, crank + lead * Omega)
            found += 1
        while next_sample < len(samples_t_s) and (samples_t_s[next_sample] < t + h or index == steps - 1):
            lead = samples_t_s[next_sample] - t
            samples[next_sample, 0] = y + lead / h * (end.y_m - y)
            samples[next_sample, 1] = v + lead / h * (end.v_m_s - v)
            samples[next_sample, 2] = crank + lead * Omega
            next_sample += 1
        y, v, crank, x_A, phase = end.y_m, end.v_m_s, crank_1, x_A1, end.phase
    for index in range(next_sample, len(samples_t_s)):  # a run of no length
        samples[index] = (y, v, crank)
    change = 0.5 * (m * v * v + c * (y - x_A) ** 2) - stored
    return impacts[:, :found], (y, v, crank), (drive_j, change, friction_j, impact_j), phase.value


def simulate(
    parts: Parts,
    initial: MotionState,
    until_s: float,
    step_s: float,
    samples_t_s: NDArray[np.float64] | None = None,
) -> SimulationResult:
    """Run the module from `initial` to the absolute time `until_s` in steps of `step_s`.

    The errors of positions and times are of the order of one step; samples between steps are interpolated.
    """
    striker, drive, friction, stop = parts.striker, parts.drive, parts.friction, parts.stop
    require_plain(parts)
    if not isinstance(drive, IdealDrive) or not isinstance(stop, NoStop | RigidStop):
        raise UnsupportedSceneError(
            f"the stepping solver takes an ideal drive and no or a rigid stop; this scene has {drive!r} and "
            f"{stop!r}: use the adaptive solver"
        )
    if not (math.isfinite(step_s) and step_s > 0.0):
        raise UnsupportedSceneError(f"the step is {step_s} s; it must be finite and above 0")
    duration_s = until_s - initial.t_s
    fastest_rad_s = max(drive.omega_rad_s, math.sqrt(striker.spring_n_m / striker.mass_kg))
    if debt(0.0, duration_s / step_s * TIME_STEP, duration_s * fastest_rad_s) > ALLOWANCE:
        place = f"over {duration_s:g} s in steps of {step_s:g} s, {1.0 / TIME_STEP:g} of which count as one"
        raise too_costly(place, "raise solver.step_s or solver.accuracy, or end the run earlier")
    grid = sample_times(initial, until_s, samples_t_s)
    until_s = float(until_s)
    start = start_of(striker, stop, initial)
    samples = np.empty((len(grid), 3))
    impacts, (y_m, final_v_m_s, final_crank_rad), energies, phase = _run(
        striker, drive, friction, stop, start, until_s, step_s, grid, samples
    )
    t_s, v_m_s, v_after_m_s, impulse_n_s, peak_force_n, crank_rad = impacts
    return SimulationResult(
        impacts=Impacts(t_s, v_m_s, v_after_m_s, impulse_n_s, peak_force_n, crank_rad % TURN_RAD),
        final=MotionState(
            until_s,
            striker.rest_length_m + y_m,
            final_v_m_s,
            final_crank_rad % TURN_RAD,
            drive.omega_rad_s,
            Phase(phase),
        ),
        energy=EnergyLedger(*energies),
        method="stepping",
        samples=None
        if samples_t_s is None
        else Samples(
            t_s=grid,
            x_m=striker.rest_length_m + samples[:, 0],
            v_m_s=samples[:, 1],
            crank_rad=samples[:, 2] % TURN_RAD,
        ),
    )
