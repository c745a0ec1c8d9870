"""A step of the adaptive solver: its length, its end at the first event, and the quantities recorded from it.

If the scene has a Taylor series, the step uses it, otherwise DOP853. Bernstein coefficients of the motion
within the step locate the first of any number of events. The step is then repeated up to that event, so that
the state there has the accuracy of a step.
"""

import math

from plant_sim.arrays import FloatArray
from plant_sim.jets import ROW
from plant_sim.kernels import subroutine
from plant_sim.parts.friction import bend_m_s
from plant_sim.parts.housing import smooth_for_s
from plant_sim.parts.parts import Parts
from plant_sim.parts.wearer import is_worn
from plant_sim.result import Phase
from plant_sim.sensors.sensing import is_sensing, sense
from plant_sim.solvers.adaptive.automaton import apply, first_event, may_end
from plant_sim.solvers.adaptive.crank import dry_loss_n_m, turn_crank
from plant_sim.solvers.adaptive.dop853 import attempt, extend
from plant_sim.solvers.adaptive.event_location import Found, Segment, steepest_stage
from plant_sim.solvers.adaptive.motion import derivative, flow_now
from plant_sim.solvers.adaptive.observation import follow_contact, follow_felt, sample_step
from plant_sim.solvers.adaptive.series import LEAST, motion_within, series_step_s, state_after
from plant_sim.solvers.adaptive.state_layout import Flow, Memory, Progress, Run, now_s
from plant_sim.solvers.adaptive.stop import follow_shock
from plant_sim.solvers.adaptive.wearer import ankle_s, closing_m_s
from plant_sim.solvers.adaptive.winding import current_s
from plant_sim.solvers.bernstein import ORDER
from plant_sim.solvers.cost import debt
from plant_sim.solvers.double_double import two_sum
from plant_sim.solvers.event import Event

LEAST_ERROR = 1e-6
"""Smallest error of a step, in tolerances, that influences the next step; at rest the error may be 0."""

LONGEST_SERIES = 2.0
"""Longest step of a Taylor series, in longest steps of DOP853: two radians of the fastest motion.

Over longer steps the last two terms may be smaller than the terms cut off, as of a crank that starts from
rest; the error per forcing period then exceeds the accuracy.
"""


@subroutine(inline=True)
def take_step(run: Run) -> float:
    """Take one step, at most up to an event; return its length, s, or −1 if no step is small enough."""
    parts, memory, grid = run.parts, run.memory[0], run.grid
    mode, progress = memory.mode, memory.progress
    begin_s = now_s(memory)
    follow_shock(run)
    flow = flow_now(run)
    scale = memory.all_contact_scale if flow.phase == Phase.CONTACT else memory.all_scale
    remaining = (progress.duration_s - progress.elapsed_s) - progress.elapsed_low_s
    longest = _longest_s(parts, memory, begin_s)
    longest_series = min(LONGEST_SERIES * longest, smooth_for_s(parts.housing, begin_s), remaining)
    longest_series = min(longest_series, ankle_s(parts))  # beyond, an orbit amplifies the truncation
    h, order = series_step_s(run, flow, scale, longest_series, longest)
    is_series, attempts = h > 0.0, 1.0
    if is_series:
        state_after(memory, h, order)
    else:
        h, attempts = _stages_step_s(run, flow, scale, longest, remaining)
        if h < 0.0:
            return h

    dense = memory.long_dense[:] if is_series and order == ORDER else memory.dense[:]
    segment = Segment(flow, h, is_series, order, dense)
    used: float = h
    event = Event.NONE
    has_sample = mode.samples < grid.t_s.size and grid.t_s[mode.samples] < begin_s + h
    is_checked = may_end(run, segment)
    if has_sample or is_checked or (is_sensing(run.probe) and not is_series):
        _look_within(run, segment, has_sample)
    if is_checked:
        found = first_event(run, segment)
        event = found.event
        if event != Event.NONE:
            used = _repeat(run, segment, found)
    if flow.phase == Phase.CONTACT:
        follow_contact(run, dense, flow.damping_s_m, used / h)
    follow_felt(run, dense, used / h)
    sense(run, segment, used)
    if has_sample:
        sample_step(run, segment, used)

    for index in range(progress.used):
        i = memory.places[index]
        memory.all_y[i] = memory.all_new[i]
    turn_crank(parts.drive, memory, used)
    if used > 0.0:  # at an event at the step's start, the other quantities are still zero
        mode.zero_depth = mode.zero_velocity = mode.zero_crank = mode.zero_voltage = 0
    _pass_time(progress, used, remaining)
    if used < remaining:  # the last step of a call is as short as the call demands
        progress.debt = debt(progress.debt, attempts, used / longest)
    if event != Event.NONE:
        progress.last_step_s = 0.0
        apply(run, event)
    return used


@subroutine
def _longest_s(parts: Parts, memory: Memory, begin_s: float) -> float:
    """The longest step of DOP853, s: a radian of the fastest motion of any part."""
    striker = parts.striker
    natural = math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    longest = 1.0 / max(natural, abs(memory.y.crank_rad_s))
    longest = min(longest, ankle_s(parts), smooth_for_s(parts.housing, begin_s))
    return min(longest, current_s(parts))


@subroutine
def _stages_step_s(
    run: Run, flow: Flow, scale: FloatArray, longest_s: float, remaining_s: float
) -> tuple[float, float]:
    """Step of DOP853 from `memory.y` to `memory.new`: its length, s, or −1 if none is small enough, and the
    number of attempts.

    Over a longer change of speed the fall of Stribeck's friction near rest could lie between two stages.
    """
    parts, memory = run.parts, run.memory[0]
    progress, slopes = memory.progress, memory.slopes
    derivative(parts, flow, 0.0, memory.y, slopes[0])
    most_m_s = max(0.5 * abs(memory.y.v_m_s), bend_m_s(parts.friction))
    longest_s = min(longest_s, most_m_s / max(abs(slopes[0, ROW.v_m_s]), LEAST))
    attempts, next_s = 0.0, progress.contact_step_s if flow.phase == Phase.CONTACT else progress.free_step_s
    while True:
        h = min(next_s, longest_s, remaining_s)
        attempts += 1.0
        error = attempt(run, flow, h, scale)
        if not error <= 1.0:  # also nan
            next_s = h * (max(0.2, 0.9 * _eighth_root(1.0 / error)) if error < 1e300 else 0.2)
        elif math.isinf(most_m_s) or h * steepest_stage(memory.slopes, ROW.v_m_s) <= 2.0 * most_m_s:
            break
        else:
            next_s = 0.5 * h
        if next_s < 1e-12 * longest_s:
            return -1.0, attempts
    _choose_next(progress, flow.phase, next_s, h, error)
    return h, attempts


@subroutine
def _pass_time(progress: Progress, used_s: float, remaining_s: float) -> None:
    """Advance the time by `used_s` of the `remaining_s` up to the call's end."""
    elapsed_s, rest_s = two_sum(progress.elapsed_s, progress.elapsed_low_s + used_s)
    is_end = used_s == remaining_s
    progress.elapsed_s = progress.duration_s if is_end else elapsed_s
    progress.elapsed_low_s = 0.0 if is_end else rest_s


@subroutine
def _choose_next(progress: Progress, phase: int, tried_s: float, h_s: float, error: float) -> None:
    """Set the length of the next step from the error of this one and the trend of the last two.

    Predictive control (Gustafsson, ACM Trans. Math. Softw. 20, 1994): without it every second step would be
    refused where friction stiffens towards rest.
    """
    margin = _eighth_root(1.0 / max(error, LEAST_ERROR))
    growth = 0.9 * margin
    if progress.last_step_s > 0.0:
        growth *= min(h_s / progress.last_step_s * margin / progress.last_margin, 1.0)
    growth = min(growth, 5.0)
    progress.last_step_s, progress.last_margin = h_s, margin
    next_s = max(tried_s, h_s * growth) if growth > 1.0 else h_s * growth
    if phase == Phase.CONTACT:
        progress.contact_step_s = next_s
    else:
        progress.free_step_s = next_s


@subroutine
def _eighth_root(value: float) -> float:
    """The eighth root: growth of a step whose error, of the method's order 8, may grow by `value`."""
    return math.sqrt(math.sqrt(math.sqrt(value)))


@subroutine
def _look_within(run: Run, segment: Segment, has_sample: bool) -> None:
    """The motion within the step, into `segment.dense`.

    Of a series it is the crank's only if events, forces or samples need it, for it takes as long as the
    striker's.
    """
    parts, flow = run.parts, segment.flow
    if not segment.is_series:
        extend(run, flow, segment.h_s)
        return
    slides = flow.phase in (Phase.FLIGHT, Phase.CONTACT)
    is_all_needed = has_sample or not slides or dry_loss_n_m(parts.drive) > 0.0 or is_worn(parts.wearer)
    motion_within(run.memory[0], segment.h_s, segment.order, is_all_needed)


@subroutine
def _repeat(run: Run, segment: Segment, found: Found) -> float:
    """Repeat the step up to the event; the time of a touch-down is then corrected by Newton's method."""
    new = run.memory[0].new
    used = found.s * segment.h_s
    _end_at(run, segment, used)
    closing = closing_m_s(new)
    if found.event == Event.TOUCH and closing != 0.0:
        correction = -new.depth_m / closing
        if abs(correction) < 1e-3 * used:
            used = min(used + correction, segment.h_s)
            _end_at(run, segment, used)
    return used


@subroutine
def _end_at(run: Run, segment: Segment, used_s: float) -> None:
    """The state `used_s` after the step's start, into `memory.new`."""
    if segment.is_series:
        state_after(run.memory[0], used_s, segment.order)
    else:
        attempt(run, segment.flow, used_s, run.memory[0].all_scale)
