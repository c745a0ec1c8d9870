"""The module at campaign speed: its own equations and phases, by Runge–Kutta steps of a tick or less.

What a phase's equations are and what an event does is the plant's (`plant_sim.solvers`); only the way from
event to event is a cheaper one: classical Runge–Kutta of fourth order, a tick long in flight and a quarter of
one in contact, where an event is a change of sign, located by false position. The suite holds it against the
plant's adaptive solver.

The sensors' low-passes are driven exactly by the parabola of each step's acceleration, which keeps the step's
change of velocity: a(s) through a₀ and a₁ with ∫a = Δv. The step's last stage stands for a₁. What a housing
does is added as the parabola through its values at the step's ends and middle.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.friction import static_limit_n
from plant_sim.parts.housing import housing_m_s2, smooth_for_s
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import HuntCrossley
from plant_sim.parts.winding import Settled
from plant_sim.result import MotionState
from plant_sim.sensing import HOUSING, SPEED_ESTIMATE, NoSensing, Sensing, driven
from plant_sim.solvers.events import CRANK_HALT, HALT, LEAVE, NONE, RELEASE, TOUCH
from plant_sim.solvers.memory import (
    CRANK_DIRECTION,
    CRANK_STUCK,
    DAMPING,
    DIRECTION,
    PEAK,
    PHASE,
    UNSETTLED,
    Memory,
    allocate,
)
from plant_sim.solvers.motion import (
    CONTACT,
    FLIGHT,
    STICK,
    Flow,
    derivative,
    held_force_n,
    state_size,
    work_place,
)
from plant_sim.solvers.transitions import apply, settle, settle_crank, turn_crank
from tools.campaign.kernels import subroutine

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

STEPS_IN_CONTACT = 4
"""A default contact lasts ten ticks: forty steps, which place its end to a microsecond."""
ACCURACY = 1e-9
"""Handed to the plant's memory, where it settles below which rebound a striker rests."""
MOST_CUTS = 40


class Filters(NamedTuple):
    """The low-passes' steps: decay and moments of 1, s, s² over a tick and over a step in contact.

    Shape (2, filters, 4); the states have shape (filters,): a housing that is felt has one more.
    """

    steps: Complex
    poles: Complex
    states: Complex
    power: Vector


class Module(NamedTuple):
    """A module in motion: the plant's memory, the end of a step, derivatives at its stages and a trial."""

    memory: Memory
    end: Vector
    k1: Vector
    k2: Vector
    k3: Vector
    k4: Vector
    trial: Vector


def module(parts: Parts, initial: MotionState, impacts: int) -> Module:
    """A module at `initial`, with room for this number of impacts."""
    memory = allocate(parts, initial, ACCURACY, impacts)
    end, k1, k2, k3, k4, trial = np.zeros((6, state_size(parts)))
    return Module(memory, end, k1, k2, k3, k4, trial)


def filters(sensing: Sensing, tick_s: float) -> Filters:
    """The low-passes of `sensing`, prepared for ticks of `tick_s`."""
    power = np.zeros(sensing.power.size)
    count = sensing.poles.size
    steps = np.zeros((2, count, 4), dtype=np.complex128)
    interpreted: Any = driven
    driven_here = interpreted.py_func
    for row, h_s in enumerate((tick_s, tick_s / STEPS_IN_CONTACT)):
        for which in range(count):
            steps[row, which, 0] = driven_here(sensing.poles[which], 1.0 + 0.0j, power, 0, h_s)
            for degree in range(3):
                power[:] = 0.0
                power[degree] = 1.0
                steps[row, which, 1 + degree] = driven_here(sensing.poles[which], 0.0j, power, degree, h_s)
            power[:] = 0.0
    return Filters(steps, sensing.poles.copy(), sensing.states.copy(), power)


@subroutine
def advance(
    parts: Parts, filters: Filters, module: Module, torque_n_m: float, start_s: float, tick_s: float
) -> None:
    """Move on by a tick under a held torque."""
    memory = module.memory
    y, mode = memory.y, memory.mode
    if mode[PHASE] == UNSETTLED:
        settle(parts, memory, torque_n_m, start_s)
    elif mode[CRANK_STUCK] == 1:
        settle_crank(parts.drive, parts, memory, torque_n_m)
    left_s = tick_s
    while left_s > 0.0:
        in_contact = mode[PHASE] == CONTACT
        whole_s = tick_s / STEPS_IN_CONTACT if in_contact else tick_s
        now_s = start_s + tick_s - left_s
        h_s = min(whole_s, left_s, smooth_for_s(parts.housing, now_s))
        flow = Flow(
            mode[PHASE],
            float(mode[DIRECTION]),
            memory.contact[DAMPING],
            0.0,
            torque_n_m,
            float(mode[CRANK_DIRECTION]),
            mode[CRANK_STUCK] == 1,
            now_s,
            False,
        )
        derivative(parts, flow, 0.0, y, module.k1)
        _step(parts, flow, module, h_s)
        used_s = h_s
        event = NONE
        for kind in (TOUCH, LEAVE, HALT, RELEASE, CRANK_HALT):
            if _is_due(parts, flow, kind, module.end, used_s):
                used_s = _locate(parts, flow, module, kind, used_s)
                event = kind
        if used_s == whole_s:
            _filter(parts, flow, filters, 1 if in_contact else 0, module, used_s)
        else:
            _filter_part(parts, flow, filters, module, used_s)
        if in_contact:
            push_n = module.k4[work_place(parts) + 3]
            memory.contact[PEAK] = max(memory.contact[PEAK], push_n)
        for i in range(state_size(parts)):
            y[i] = module.end[i]
        turn_crank(parts.drive, memory, used_s)
        left_s = 0.0 if used_s == left_s else left_s - used_s
        if left_s < 1e-9 * tick_s:
            left_s = 0.0
        if event != NONE:
            apply(parts, NoSensing(), memory, torque_n_m, event, start_s + tick_s - left_s)


@subroutine
def _step(parts: Parts, flow: Flow, module: Module, h_s: float) -> None:
    """From `memory.y`, whose derivative `k1` holds, to `end`: Runge–Kutta of fourth order."""
    y = module.memory.y
    _, end, k1, k2, k3, k4, trial = module
    for i in range(state_size(parts)):
        trial[i] = y[i] + 0.5 * h_s * k1[i]
    derivative(parts, flow, 0.5 * h_s, trial, k2)
    for i in range(state_size(parts)):
        trial[i] = y[i] + 0.5 * h_s * k2[i]
    derivative(parts, flow, 0.5 * h_s, trial, k3)
    for i in range(state_size(parts)):
        trial[i] = y[i] + h_s * k3[i]
    derivative(parts, flow, h_s, trial, k4)
    for i in range(state_size(parts)):
        end[i] = y[i] + h_s / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i])


@subroutine
def _quantity(parts: Parts, flow: Flow, kind: int, y: Vector, since_s: float) -> float:
    """What passes from negative to positive when an event of this kind happens, at this time in the step."""
    sign, place = -1.0, 0
    if kind == TOUCH:
        sign = 1.0
    elif kind == HALT:
        sign, place = -flow.direction, 1
    elif kind == CRANK_HALT:
        sign, place = -flow.crank_direction, 3
    elif kind == RELEASE:
        limit_n = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
        return abs(held_force_n(parts, y[2], y, flow.time_s + since_s)) - limit_n
    value: float = sign * y[place]
    return value


@subroutine
def _is_due(parts: Parts, flow: Flow, kind: int, end: Vector, h_s: float) -> bool:
    """Whether an event of this kind lies in the step to `end`."""
    if kind == TOUCH and flow.phase != FLIGHT:
        return False
    if kind == LEAVE and flow.phase != CONTACT:
        return False
    if kind == HALT:
        dry = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2) > 0.0
        if not dry or flow.phase == STICK:
            return False
    if kind == RELEASE and flow.phase != STICK:
        return False
    if kind == CRANK_HALT and (flow.crank_direction == 0.0 or flow.crank_stuck):
        return False
    return _quantity(parts, flow, kind, end, h_s) > 0.0


@subroutine
def _locate(parts: Parts, flow: Flow, module: Module, kind: int, longest_s: float) -> float:
    """Step up to the event only, which lies within `longest_s`; its time, s, by false position (Illinois)."""
    low_s, high_s = 0.0, longest_s
    low = _quantity(parts, flow, kind, module.memory.y, 0.0)
    high = _quantity(parts, flow, kind, module.end, longest_s)
    if high <= 0.0 or low >= 0.0:
        # Set off from the event's own place and back at it already: what little it moved is dropped.
        return longest_s
    kept = 0
    for _ in range(MOST_CUTS):
        s = (low_s * high - high_s * low) / (high - low)
        _step(parts, flow, module, s)
        value = _quantity(parts, flow, kind, module.end, s)
        if abs(value) < 1e-12 or high_s - low_s < 1e-12:
            return s
        if value > 0.0:
            high_s, high = s, value
            if kept == 1:
                low *= 0.5
            kept = 1
        else:
            low_s, low = s, value
            if kept == -1:
                high *= 0.5
            kept = -1
    _step(parts, flow, module, high_s)
    return high_s


@subroutine
def _filter(parts: Parts, flow: Flow, filters: Filters, row: int, module: Module, h_s: float) -> None:
    """Drive the low-passes over a step of one of the two usual lengths."""
    felt = _felt_course(parts, flow, h_s)
    for which in range(filters.states.size):
        a0, a1, mean, gain = _course(felt, filters, which, module, h_s)
        c1, c2 = _parabola(a0, a1, mean)
        step = filters.steps[row, which]
        filters.states[which] = (
            step[0] * filters.states[which] + (a0 * step[1] + c1 * step[2] + c2 * step[3]) * gain
        )


@subroutine
def _filter_part(parts: Parts, flow: Flow, filters: Filters, module: Module, h_s: float) -> None:
    """The same over a step that an event has cut short."""
    if h_s <= 0.0:
        return
    power = filters.power
    felt = _felt_course(parts, flow, h_s)
    for which in range(filters.states.size):
        a0, a1, mean, gain = _course(felt, filters, which, module, h_s)
        c1, c2 = _parabola(a0, a1, mean)
        power[0], power[1], power[2] = a0 * gain, c1 * gain, c2 * gain
        filters.states[which] = driven(filters.poles[which], filters.states[which], power, 2, h_s)


@subroutine
def _felt_course(parts: Parts, flow: Flow, h_s: float) -> tuple[float, float, float]:
    """The housing's a_b at both ends of a step, and its mean by Simpson's rule."""
    first = housing_m_s2(parts.housing, flow.time_s)
    middle = housing_m_s2(parts.housing, flow.time_s + 0.5 * h_s)
    last = housing_m_s2(parts.housing, flow.time_s + h_s)
    return first, last, (first + 4.0 * middle + last) / 6.0


@subroutine
def _course(
    felt: tuple[float, float, float], filters: Filters, which: int, module: Module, h_s: float
) -> tuple[float, float, float, float]:
    """A filter's input at both ends of a step, its mean, and the input's gain.

    For the crank's speed the mean is Simpson's on the Hermite cubic: (ω₀ + ω₁)/2 + h (ω'₀ − ω'₁)/12. The
    striker's accelerometers read x'' + a_b, the housing's a_b.
    """
    y, end, slope, slope_end = module.memory.y, module.end, module.k1, module.k4
    if which == SPEED_ESTIMATE:
        mean = 0.5 * (y[3] + end[3]) + h_s * (slope[3] - slope_end[3]) / 12.0
        return y[3], end[3], mean, -filters.poles[which].real
    first, last, mean = felt
    if which == HOUSING:
        return first, last, mean, 1.0
    return slope[1] + first, slope_end[1] + last, (end[1] - y[1]) / h_s + mean, 1.0


@subroutine
def _parabola(a0: float, a1: float, mean: float) -> tuple[float, float]:
    """c₁ and c₂ of a₀ + c₁ s + c₂ s² on 0…1 that ends at a₁ and has this mean."""
    # a₀ + c₁ + c₂ = a₁, a₀ + c₁/2 + c₂/3 = mean
    c2 = 3.0 * (a0 + a1) - 6.0 * mean
    return a1 - a0 - c2, c2


def is_supported(parts: Parts) -> bool:
    """Whether the campaign's plant knows these parts: a torque-mode motor and a soft stop."""
    is_torque_driven = isinstance(parts.drive, MotorDrive) and isinstance(parts.winding, Settled)
    return is_torque_driven and isinstance(parts.stop, HuntCrossley)
