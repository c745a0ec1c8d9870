"""A step of the adaptive solver: its length, its end at the first event, and the quantities recorded from it.

Bernstein coefficients of the continuous extension locate the first of any number of events. The step is then
repeated up to that event, so that the state there has the accuracy of a step.
"""

import math

from plant_sim.kernels import subroutine
from plant_sim.parts.housing import smooth_for_s
from plant_sim.parts.parts import Parts
from plant_sim.sensors.sensing import Probe, is_sensing, sense_step
from plant_sim.solvers.adaptive.automaton import apply, first_event, may_end
from plant_sim.solvers.adaptive.crank import crank_now, turn_crank
from plant_sim.solvers.adaptive.dop853 import attempt, extend
from plant_sim.solvers.adaptive.event_location import NONE, TOUCH, Found, Step, Zeros
from plant_sim.solvers.adaptive.motion import derivative, flow_now
from plant_sim.solvers.adaptive.observation import follow_contact, follow_felt, sample_step
from plant_sim.solvers.adaptive.state_layout import (
    CONTACT,
    Flow,
    Held,
    Memory,
    Vector,
    state_size,
)
from plant_sim.solvers.adaptive.wearer import ankle_s, closing_m_s
from plant_sim.solvers.adaptive.winding import current_s, voltage_zeros
from plant_sim.solvers.cost import debt
from plant_sim.solvers.double_double import two_sum

LEAST_ERROR = 1e-6
"""Smallest error of a step, in tolerances, that influences the next step; at rest the error may be 0."""


@subroutine
def take_step(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    torque_n_m: float,
    start_s: float,
    duration_s: float,
    grid_s: Vector,
    samples: Vector,
) -> float:
    """Take one step, at most up to an event; return its length, s, or −1 if no step is small enough."""
    y, mode, held, new = memory.y, memory.mode[0], memory.held[0], memory.new
    k, trial, dense = memory.k, memory.trial, memory.dense
    begin_s = start_s + held.elapsed_s
    flow = flow_now(parts, memory, torque_n_m, begin_s)
    scale = memory.contact_scale if flow.phase == CONTACT else memory.scale
    remaining = (duration_s - held.elapsed_s) - held.elapsed_low_s
    longest = 1.0 / max(
        math.sqrt(parts.striker.spring_n_m / parts.striker.mass_kg),
        abs(crank_now(parts.drive, memory).speed_rad_s),
    )
    longest = min(longest, ankle_s(parts.wearer), smooth_for_s(parts.housing, begin_s))
    longest = min(longest, current_s(parts.winding, parts.drive))
    derivative(parts, flow, 0.0, y, k[0])
    attempts, next_s = 0.0, held.contact_step_s if flow.phase == CONTACT else held.free_step_s
    while True:
        h = min(next_s, longest, remaining)
        attempts += 1.0
        error = attempt(parts, flow, h, y, scale, k, trial, new)
        if error <= 1.0:
            break
        next_s = h * (max(0.2, 0.9 * _eighth_root(1.0 / error)) if error < 1e300 else 0.2)
        if next_s < 1e-12 * longest:
            return -1.0
    _choose_next(held, flow.phase, next_s, h, error)

    zeros = Zeros(mode.zero_depth, mode.zero_velocity, mode.zero_crank, voltage_zeros(parts.winding, memory))
    used: float = h
    event = NONE
    has_sample = mode.samples < grid_s.size and grid_s[mode.samples] < begin_s + h
    is_checked = may_end(parts, flow, h, y, new, k, zeros)
    if is_sensing(probe) or has_sample or is_checked:
        extend(parts, flow, h, y, new, k, trial, dense)
    if is_checked:
        found = first_event(parts, Step(flow, zeros, h, y, dense, memory.scratch))
        event = found.event
        if event != NONE:
            used = _repeat(parts, flow, found, h, memory)
    if flow.phase == CONTACT:
        follow_contact(parts, memory, flow.damping_s_m, used / h)
    follow_felt(parts.wearer, parts.drive, memory, used / h)
    sense_step(probe, parts, dense, h, used, begin_s)
    if has_sample:
        sample_step(parts, memory, flow, h, used, grid_s, samples)

    for i in range(state_size(parts)):
        y[i] = new[i]
    turn_crank(parts.drive, memory, used)
    mode.zero_depth = mode.zero_velocity = mode.zero_crank = 0
    _pass_time(memory, flow.phase, used, remaining, duration_s)
    if used < remaining:  # what ends a call is as short as the caller asked for
        held.debt = debt(held.debt, attempts, used / longest)
    if event != NONE:
        held.last_step_s = 0.0
        apply(parts, probe, memory, torque_n_m, event, start_s + held.elapsed_s)
    return used


@subroutine
def _pass_time(memory: Memory, phase: int, used_s: float, remaining_s: float, duration_s: float) -> None:
    """Advance the time by `used_s` in a phase, of the `remaining_s` up to `duration_s`."""
    held = memory.held[0]
    if used_s > 0.0:
        memory.mode[0].seen |= 1 << phase
    elapsed_s, rest_s = two_sum(held.elapsed_s, held.elapsed_low_s + used_s)
    is_end = used_s == remaining_s
    held.elapsed_s = duration_s if is_end else elapsed_s
    held.elapsed_low_s = 0.0 if is_end else rest_s


@subroutine
def _choose_next(held: Held, phase: int, tried_s: float, h_s: float, error: float) -> None:
    """Set the length of the next step from the error of this one and the trend of the last two.

    Predictive control (Gustafsson, ACM Trans. Math. Softw. 20, 1994): without it every second step would be
    refused where friction stiffens towards rest.
    """
    margin = _eighth_root(1.0 / max(error, LEAST_ERROR))
    growth = 0.9 * margin
    if held.last_step_s > 0.0:
        growth *= min(h_s / held.last_step_s * margin / held.last_margin, 1.0)
    growth = min(growth, 5.0)
    held.last_step_s, held.last_margin = h_s, margin
    next_s = max(tried_s, h_s * growth) if growth > 1.0 else h_s * growth
    if phase == CONTACT:
        held.contact_step_s = next_s
    else:
        held.free_step_s = next_s


@subroutine
def _eighth_root(value: float) -> float:
    """The eighth root: growth of a step whose error, of the method's order 8, may grow by `value`."""
    return math.sqrt(math.sqrt(math.sqrt(value)))


@subroutine
def _repeat(parts: Parts, flow: Flow, found: Found, h_s: float, memory: Memory) -> float:
    """Repeat the step up to the event; the time of a touch-down is then corrected by Newton's method."""
    y, k, trial, new = memory.y, memory.k, memory.trial, memory.new
    used = found.s * h_s
    attempt(parts, flow, used, y, memory.scale, k, trial, new)
    closing = closing_m_s(parts.wearer, parts.drive, new)
    if found.event == TOUCH and closing != 0.0:
        correction = -new[0] / closing
        if abs(correction) < 1e-3 * used:
            used = min(used + correction, h_s)
            attempt(parts, flow, used, y, memory.scale, k, trial, new)
    return used
