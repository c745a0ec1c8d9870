"""Observations of a module: samples and largest forces within a step, state and ledgers at its end."""

import math
from typing import Any, NamedTuple

from plant_sim.arrays import FloatArray
from plant_sim.jets import ROW, State
from plant_sim.kernels import subroutine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_force_n, is_soft, origin_m, stop_force_n
from plant_sim.parts.wearer import is_worn
from plant_sim.parts.winding import DqWinding
from plant_sim.result import ElectricalLedger, EnergyLedger, MotionState, Observation, Phase
from plant_sim.solvers.adaptive.crank import crank_in_stage
from plant_sim.solvers.adaptive.event_location import Segment, look_within
from plant_sim.solvers.adaptive.motion import derivative, flow_now, stored_energy_j
from plant_sim.solvers.adaptive.state_layout import OBSERVED, Flow, Memory, Run, now_s
from plant_sim.solvers.adaptive.stiction import dry_limit_n, force_at_rest_n
from plant_sim.solvers.adaptive.stop import in_touch
from plant_sim.solvers.adaptive.wearer import ankle_force_n, closing_m_s, felt_force_n, from_stop_m
from plant_sim.solvers.adaptive.winding import magnetic_energy_j, turning_current_a, turning_torque_n_m
from plant_sim.solvers.bernstein import at

GOLDEN = 0.6180339887498949
GOLDEN_CUTS = 20
"""Number of cuts: they narrow half a step to 3e-5 of it, where the force is 1e-9 below its peak."""

NEAR_THE_END = 3e-5
"""Share of a step at whose end a force shows whether it rises; a peak nearer to the end is 1e-9 above it."""


class Force(NamedTuple):
    """A force whose peak is followed: of a soft stop in a contact with damping λ, or of a worn module on its
    wearer."""

    parts: Parts
    is_felt: bool
    damping_s_m: float


@subroutine(inline=True)
def force_at(force: Force, dense: FloatArray, s: float) -> float:
    """The force within a step, N."""
    parts = force.parts
    place = velocity = 0.0
    if is_worn(parts.wearer):
        place, velocity = at(dense[ROW.plate_m], s), at(dense[ROW.plate_m_s], s)
    if force.is_felt and is_worn(parts.wearer):
        return abs(ankle_force_n(parts.wearer, place, velocity))
    elastic_n = elastic_force_n(parts.stop, max(at(dense[ROW.depth_m], s), 0.0))
    return stop_force_n(parts.stop, elastic_n, at(dense[ROW.v_m_s], s) - velocity, force.damping_s_m)


@subroutine
def follow_contact(run: Run, dense: FloatArray, damping_s_m: float, share: float) -> None:
    """Update the largest force of the contact by the used share of a step."""
    contact = run.memory[0].contact
    contact.peak_n = _largest(Force(run.parts, False, damping_s_m), dense, share, contact.peak_n)


@subroutine
def follow_felt(run: Run, dense: FloatArray, share: float) -> None:
    """Update the largest force on a wearer by the used share of a step."""
    if is_worn(run.parts.wearer):
        memory = run.memory[0]
        contact = memory.contact
        contact.peak_felt_n = _largest(Force(run.parts, True, 0.0), dense, share, contact.peak_felt_n)


@subroutine
def _largest(force: Force, dense: FloatArray, share: float, before_n: float) -> float:
    """The largest force so far: the largest of five samples on the step, refined by golden section.

    Between two samples the force may exceed both, by less than the largest difference of neighbours.
    """
    best, best_s, last_n, jump_n = -1.0, 0.0, 0.0, 0.0
    for i in range(5):
        s = share * 0.25 * i
        force_n = force_at(force, dense, s)
        if i > 0:
            jump_n = max(jump_n, abs(force_n - last_n))
        if force_n > best:
            best, best_s = force_n, s
        last_n = force_n
    if best + jump_n > before_n and not _peaks_at_an_end(force, dense, share, best, best_s):
        low, high = max(best_s - 0.25 * share, 0.0), min(best_s + 0.25 * share, share)
        left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
        left_n, right_n = force_at(force, dense, left), force_at(force, dense, right)
        for _ in range(GOLDEN_CUTS):
            if left_n > right_n:
                high, right, right_n = right, left, left_n
                left = high - GOLDEN * (high - low)
                left_n = force_at(force, dense, left)
            else:
                low, left, left_n = left, right, right_n
                right = low + GOLDEN * (high - low)
                right_n = force_at(force, dense, right)
        return max(before_n, best, left_n, right_n)
    return max(before_n, best)


@subroutine
def _peaks_at_an_end(force: Force, dense: FloatArray, share: float, best_n: float, best_s: float) -> bool:
    """Whether the force falls from `best_s` inwards, if that is an end of the step."""
    if 0.0 < best_s < share:
        return False
    inwards_s = share * NEAR_THE_END
    return force_at(force, dense, inwards_s if best_s == 0.0 else share - inwards_s) <= best_n


@subroutine
def sample_now(run: Run) -> None:
    """Fill samples at times up to now that no step has covered."""
    memory, grid = run.memory[0], run.grid
    mode = memory.mode
    while mode.samples < grid.t_s.size and grid.t_s[mode.samples] <= now_s(memory):
        write_row(run.parts, flow_now(run), 0.0, memory.y, memory.slopes[0], grid.rows[mode.samples])
        mode.samples += 1


@subroutine
def sample_step(run: Run, segment: Segment, used_s: float) -> None:
    """Fill samples at times within the used part of a step."""
    memory, grid, flow = run.memory[0], run.grid, segment.flow
    mode = memory.mode
    while mode.samples < grid.t_s.size and grid.t_s[mode.samples] < flow.time_s + used_s:
        tau_s = grid.t_s[mode.samples] - flow.time_s
        look_within(memory, segment.dense, tau_s / segment.h_s, memory.all_trial)
        write_row(run.parts, flow, tau_s, memory.trial, memory.slopes[1], grid.rows[mode.samples])
        mode.samples += 1


@subroutine
def write_row(parts: Parts, flow: Flow, tau_s: float, y: State, slopes: FloatArray, row: FloatArray) -> None:
    """Write the module `tau_s` after a step's start, where its motion is `y`, as a row of `Grid`.

    `slopes` is scratch.
    """
    row[OBSERVED.x_m], row[OBSERVED.v_m_s] = from_stop_m(y), y.v_m_s
    derivative(parts, flow, tau_s, y, slopes)
    row[OBSERVED.accel_m_s2] = slopes[ROW.v_m_s]
    row[OBSERVED.stop_force_n] = 0.0
    if is_soft(parts.stop) and in_touch(flow.phase, y.depth_m):
        elastic_n, closing = elastic_force_n(parts.stop, y.depth_m), closing_m_s(y)
        row[OBSERVED.stop_force_n] = stop_force_n(parts.stop, elastic_n, closing, flow.damping_s_m)
    angle_rad, omega_rad_s = crank_in_stage(parts.drive, flow, tau_s, y)
    row[OBSERVED.crank_rad], row[OBSERVED.omega_rad_s] = angle_rad, omega_rad_s
    row[OBSERVED.current_a] = turning_current_a(parts, flow.torque_n_m, omega_rad_s, y)
    row[OBSERVED.motor_torque_n_m] = turning_torque_n_m(parts, flow.torque_n_m, omega_rad_s, y)
    row[OBSERVED.felt_force_n] = felt_force_n(parts, y)


@subroutine
def begin_ledger(run: Run) -> None:
    """Begin the ledger at a start; after a change from outside, continue it without that change."""
    memory = run.memory[0]
    progress = memory.progress
    if math.isnan(progress.stored_before_j):
        stored_j = stored_energy_j(run.parts, memory.mode.phase, memory.y)
        progress.stored_before_j = stored_j - memory.observed[OBSERVED.stored_j]


@subroutine
def observe(run: Run) -> None:
    """Write the present observation of the module."""
    parts, memory = run.parts, run.memory[0]
    y, observed, flow = memory.y, memory.observed, flow_now(run)
    write_row(parts, flow, 0.0, y, memory.slopes[0], observed)
    observed[OBSERVED.x_m] += origin_m(parts.stop, parts.striker)
    observed[OBSERVED.drive_work_j] = y.drive_j
    stored_j = stored_energy_j(parts, flow.phase, y)
    observed[OBSERVED.stored_j] = stored_j - memory.progress.stored_before_j
    observed[OBSERVED.friction_j] = y.friction_j
    observed[OBSERVED.impact_loss_j] = y.stop_j
    observed[OBSERVED.housing_work_j] = y.housing_j
    observed[OBSERVED.ankle_j] = y.ankle_j
    observed[OBSERVED.phase] = flow.phase
    if flow.phase == Phase.REST_ON_STOP:
        force_n = force_at_rest_n(parts, y.crank_rad, y, flow.time_s)
        if force_n < dry_limit_n(parts):  # friction holds it there, the stop does not have to
            observed[OBSERVED.phase] = Phase.STICK.value


_PHASES = tuple(Phase)


def observation(observed: FloatArray) -> Observation:
    """The observation from an array of its fields."""
    *values, phase = observed.tolist()
    return Observation._make((*values, _PHASES[int(phase)]))


def motion_state(now: Observation, t_s: float) -> MotionState:
    """The motion in `now`."""
    return MotionState(t_s, now.x_m, now.v_m_s, now.crank_rad, now.omega_rad_s, now.phase)


def ledger(now: Observation, memory: Memory) -> EnergyLedger:
    """The ledger in `now`."""
    return EnergyLedger(
        drive_work_j=now.drive_work_j,
        stored_change_j=now.stored_j,
        friction_j=now.friction_j,
        impact_loss_j=now.impact_loss_j,
        housing_work_j=now.housing_work_j,
        ankle_j=now.ankle_j,
        stored_j=now.stored_j + float(memory.progress.stored_before_j),
    )


def peak_felt_force_n(parts: Parts, memory: Memory) -> float | None:
    """Largest force on the wearer so far, N; None without a wearer."""
    return float(memory.contact.peak_felt_n) if is_worn(parts.wearer) else None


def electrical_ledger(parts: Parts, memory: Memory) -> ElectricalLedger | None:
    """Electrical ledger so far; None if the windings are not modelled."""
    if not isinstance(parts.winding, DqWinding):
        return None
    y: Any = memory.y
    return ElectricalLedger(
        work_j=float(y.terminal_j),
        shaft_j=float(y.drive_j),
        copper_j=float(y.copper_j),
        magnetic_j=magnetic_energy_j(parts.winding, float(y.i_d_a), float(y.i_q_a)),
    )
