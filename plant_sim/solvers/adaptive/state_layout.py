"""State of a module from step to step, in arrays that kernels change in place.

The integrated state holds only the quantities of the scene's parts: depth and velocity; with a motor the
crank's angle and speed; with a wearer position and velocity of the foot plate; with windings their currents
and the integrals of the current loop; then the integrals of the ledger: work of the drive, friction loss,
with a stop its loss, with a soft stop its impulse, with a tilted or moving housing its work, with a wearer
the ankle's loss, with windings the work at their terminals and the copper loss. Depth is x − x_stop − p, so
that it keeps its digits at the stop.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import One, zeros_of
from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import Drive, is_motor
from plant_sim.parts.friction import bend_m_s
from plant_sim.parts.housing import is_level, steady_m_s2
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import is_rigid, is_soft, origin_m
from plant_sim.parts.wearer import equilibrium_m, is_worn
from plant_sim.parts.winding import is_wound
from plant_sim.references import by_reference
from plant_sim.result import Impact, MotionState, Observation
from plant_sim.solvers.bernstein import DEGREE, ORDER, Scratch, scratch_arrays
from plant_sim.solvers.double_double import TURN_RAD

Vector = NDArray[np.float64]

STAGES = 16
"""Evaluations of the derivative in a step: 12 stages, 1 at its end, 3 for the continuous extension."""

DEPTH, VELOCITY, ANGLE, SPEED = range(4)
"""Places of the motion in the state; the integrals of the ledger follow from `work_place` on."""

SINE, COSINE, SPRING, DRAG, POWER, FALL, SHAKE, BESIDE = range(8)
"""Rows of a Taylor series behind those of the state: sin θ, cos θ, force of the coupling spring, friction,
exponent and exponential of Stribeck's law, a_b of the housing."""


@subroutine
def plate_place(drive: Drive) -> int:
    """Place of the foot plate's position in the state, followed by its velocity, if there is a wearer."""
    return 4 if is_motor(drive) else 2


@subroutine
def current_place(parts: Parts) -> int:
    """Place of the windings' currents in the state, if they are modelled."""
    return plate_place(parts.drive) + (2 if is_worn(parts.wearer) else 0)


@subroutine
def work_place(parts: Parts) -> int:
    """Place of the drive's work in the state; friction's follows, then the stop's loss and impulse."""
    return current_place(parts) + (4 if is_wound(parts.winding) else 0)


@subroutine
def housing_place(parts: Parts) -> int:
    """Place of the housing's work in the state, if it is tilted or moves."""
    place = work_place(parts) + 2
    if is_soft(parts.stop):
        return place + 2
    return place + 1 if is_rigid(parts.stop) else place


@subroutine
def ankle_place(parts: Parts) -> int:
    """Place of the ankle's loss in the state, if there is a wearer."""
    return housing_place(parts) + (0 if is_level(parts.housing) else 1)


@subroutine
def terminal_place(parts: Parts) -> int:
    """Place of the work at a motor's terminals in the state, if its windings are modelled."""
    return ankle_place(parts) + (1 if is_worn(parts.wearer) else 0)


@subroutine
def state_size(parts: Parts) -> int:
    """Length of the integrated state."""
    return terminal_place(parts) + (2 if is_wound(parts.winding) else 0)


UNSETTLED = -1
"""Phase of a module at a start or after a disturbance, before the solver has determined it."""

NO_IMPACT, IN_CONTACT, LET_GO = range(3)
"""Values of `in_impact`; LET_GO: the stop's force has ended, but the striker has not cleared its surface."""


class Mode:
    """State of the automaton, and counters."""

    phase: int
    direction: int
    crank_direction: int
    crank_stuck: int
    zero_depth: int
    """The four zeros: number of leading derivatives, the value included, that are zero at a step's start."""
    zero_velocity: int
    zero_crank: int
    zero_voltage: int
    turns: int
    in_impact: int
    impacts: int
    samples: int
    seen: int
    """Bit p is set if phase p has taken time since it was cleared."""
    voltage_limited: int


@subroutine
def enter(mode: Mode, phase: int, direction: int, zero_depth: int, zero_velocity: int) -> None:
    """Begin a phase of the striker: set all that belongs to it; nothing of the phase before remains.

    `direction` of sliding, ±1, or 0 at rest; the zeros as in `Mode`.
    """
    mode.phase, mode.direction = phase, direction
    mode.zero_depth, mode.zero_velocity = zero_depth, zero_velocity


@subroutine
def enter_crank(mode: Mode, stuck: int, direction: int, zero_crank: int) -> None:
    """Begin a phase of the crank: stuck (1) or turning in `direction`, which is 0 without a dry loss."""
    mode.crank_stuck, mode.crank_direction, mode.zero_crank = stuck, direction, zero_crank


class Held:
    """Values that a step passes on to the next, or a tick (`plant_sim.module`) to the next."""

    t_s: float
    """Time of a module that is advanced tick by tick."""
    t_rest_s: float
    """Rounding error of `t_s`."""
    torque_n_m: float
    """The torque command of its last tick."""
    elapsed_s: float
    elapsed_low_s: float
    """Rounding error of `elapsed_s`; over 1e6 s of steps it would add up to 0.1 ms."""
    free_step_s: float
    contact_step_s: float
    last_step_s: float
    last_margin: float
    rest_m_s: float
    """A rebound at a rigid stop below this speed ends in rest."""
    debt: float
    """Cost (`plant_sim.solvers.cost`) that simulated time has not yet paid off."""
    crank_rad: float
    """Crank angle with an ideal drive; with a motor it is in the integrated state."""
    stored_before_j: float
    """Stored energy where the ledger begins; NaN until it is taken anew, after a change from outside."""


class Contact:
    """The present impact at a soft stop, and the largest force on a wearer so far."""

    touch_s: float
    touch_m_s: float
    touch_rad: float
    damping_s_m: float
    peak_n: float
    impulse_before_n_s: float
    leave_m_s: float
    peak_felt_n: float


_NEW_MODE: One[Mode] = zeros_of(Mode, 1)
_NEW_MODE[0].phase = UNSETTLED
_NEW_HELD: One[Held] = zeros_of(Held, 1)
_NEW_HELD[0].stored_before_j = math.nan
_NEW_CONTACT: One[Contact] = zeros_of(Contact, 1)

OBSERVED: Any = Observation._make(range(len(Observation._fields)))
"""Places in Memory.observed by the field names of `Observation`."""

SHARE_OF_A_STEP, SHARE_OF_A_MOTOR_STEP = 0.05, 0.02
"""Share of the accuracy that each of some twenty steps per forcing period may contribute as error.

Errors of a motor's speed accumulate in its angle; their share is smaller.
"""

SHARE_OF_A_CONTACT = 0.1
"""An orbit can amplify the errors of a contact's few steps, so each may contribute only this share of
another's."""


SHARE_OF_BEND = 1e-3
"""Largest error of the velocity as a share of `bend_m_s`, for any accuracy: a larger one would hide the curve
of friction near rest."""


class Crank(NamedTuple):
    """The crank at one instant."""

    angle_rad: float
    speed_rad_s: float


class Flow(NamedTuple):
    """Constants of one step."""

    phase: int
    direction: float
    """Direction of the striker's sliding, ±1."""
    damping_s_m: float
    """λ of the present contact."""
    angle_rad: float
    """Crank angle at the step's start."""
    torque_n_m: float
    """Torque command of a motor."""
    crank_direction: float
    """Direction of a turning crank with dry loss, ±1; otherwise 0."""
    crank_stuck: bool
    time_s: float
    """Time at the step's start."""
    voltage_limited: bool
    """Whether the bus limits a current loop."""


class Grid(NamedTuple):
    """Times at which a run is sampled, ascending, shape (n,), and the module at them, shape (n, READINGS).

    A row begins as an `Observation` does, with the position counted from the scene's stop.
    """

    t_s: Vector
    rows: Vector


READINGS = Observation._fields.index("felt_force_n") + 1
"""Number of an observation's fields that describe the present instant alone."""


class Memory(NamedTuple):
    """Integrated state, mode, values between steps, results, tolerances, and scratch from `k` on.

    `contact` is empty without a soft stop; `impacts` are records as `Impact`, the first `mode.impacts` of
    them in use.
    """

    y: Vector
    mode: One[Mode]
    held: One[Held]
    contact: One[Contact]
    impacts: Any
    observed: Vector
    scale: Vector
    contact_scale: Vector
    k: Vector
    trial: Vector
    new: Vector
    dense: Vector
    """Bernstein coefficients of the motion within a step of DOP853, shape (motion, DEGREE + 1)."""
    series: Vector
    """Taylor coefficients of a step, shape (state + BESIDE, order + 1)."""
    long_dense: Vector
    """Bernstein coefficients of the motion within it, shape (motion, order + 1)."""
    scratch: Scratch
    advance_at: int
    """Address of the kernel `advance`; 0 until a kernel may need it (`adaptive.kernel_records`)."""


def allocate(parts: Parts, initial: MotionState, accuracy: float, impacts: int, order: int = ORDER) -> Memory:
    """Memory of a module at `initial`, by reference, with the arrays that these parts need and room for
    `impacts`.

    `order` of a step's Taylor series: with sensors DEGREE, otherwise ORDER.
    """
    striker, stop = parts.striker, parts.stop
    motion, size = work_place(parts), state_size(parts)
    arrays = Memory(
        y=np.zeros(size),
        mode=zeros_of(Mode, 1),
        held=zeros_of(Held, 1),
        contact=zeros_of(Contact, 1 if is_soft(stop) else 0),
        impacts=zeros_of(Impact, impacts),
        observed=np.zeros(len(OBSERVED)),
        scale=np.zeros(size),
        contact_scale=np.zeros(size if is_soft(stop) else 0),
        k=np.zeros((STAGES, size)),
        trial=np.zeros(size),
        new=np.zeros(size),
        dense=np.zeros((motion, DEGREE + 1)),
        series=np.zeros((size + BESIDE, order + 1)),
        long_dense=np.zeros((motion, order + 1)),
        scratch=scratch_arrays(motion if is_wound(parts.winding) else 0),
        advance_at=0,
    )
    depth_m = initial.x_m - origin_m(stop, striker)
    memory = by_reference(arrays, arrays)  # its class determines its type for all scenes
    start = depth_m, initial.v_m_s, initial.crank_rad, initial.omega_rad_s, accuracy
    arguments = kernel_parts(parts), memory, *map(float, start)
    entry_point(_begin, *arguments)(*arguments)
    return memory


@jit
def _begin(
    parts: Parts,
    memory: Memory,
    depth_m: float,
    v_m_s: float,
    crank_rad: float,
    omega_rad_s: float,
    accuracy: float,
) -> None:
    """Set a module to its start."""
    restart(parts, memory, depth_m, v_m_s, crank_rad, omega_rad_s)
    set_accuracy(parts, memory, accuracy)


@subroutine
def restart(
    parts: Parts, memory: Memory, depth_m: float, v_m_s: float, crank_rad: float, omega_rad_s: float
) -> None:
    """Set a module to a start of undetermined phase; nothing of an earlier run is left. `set_accuracy`
    follows.
    """
    memory.y[:] = 0.0
    memory.mode[0] = _NEW_MODE[0]
    memory.held[0] = _NEW_HELD[0]
    if is_soft(parts.stop):
        memory.contact[0] = _NEW_CONTACT[0]
    memory.y[0], memory.y[1] = depth_m, v_m_s
    if is_worn(parts.wearer):
        plate_m = equilibrium_m(parts.wearer, steady_m_s2(parts.housing))
        memory.y[plate_place(parts.drive)] = plate_m
        memory.y[0] -= plate_m
    held, striker = memory.held[0], parts.striker
    held.free_step_s = held.contact_step_s = 0.1 / math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    memory.observed[:] = 0.0
    angle_rad = crank_rad % TURN_RAD
    if is_motor(parts.drive):
        memory.y[ANGLE], memory.y[SPEED] = angle_rad, omega_rad_s
    else:
        held.crank_rad = angle_rad


@subroutine
def set_accuracy(parts: Parts, memory: Memory, accuracy: float) -> None:
    """Set the tolerated error of one step in each quantity, equivalent to a step's share of `accuracy` in
    position."""
    striker, stop, scale = parts.striker, parts.stop, memory.scale
    natural = math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    length = max(parts.drive.amplitude_m, 1e-3)
    scale[DEPTH], scale[VELOCITY] = 1.0, natural
    if is_motor(parts.drive):
        scale[ANGLE], scale[SPEED] = 1.0 / length, natural / length
    if is_worn(parts.wearer):
        plate = plate_place(parts.drive)
        scale[plate], scale[plate + 1] = 1.0, natural
    _set_current_scale(parts, length, natural, scale)
    force = striker.spring_n_per_m * max(length, abs(striker.rest_length_m - origin_m(stop, striker)))
    work = work_place(parts)
    scale[work:] = force
    if is_soft(stop):
        scale[work + 3] = striker.mass_kg * natural
    share = SHARE_OF_A_MOTOR_STEP if is_motor(parts.drive) else SHARE_OF_A_STEP
    for i in range(scale.size):
        scale[i] *= share * accuracy
    scale[VELOCITY] = min(scale[VELOCITY], SHARE_OF_BEND * bend_m_s(parts.friction))
    for i in range(memory.contact_scale.size):
        memory.contact_scale[i] = SHARE_OF_A_CONTACT * scale[i]
    memory.held[0].rest_m_s = 0.01 * accuracy * natural  # such a rebound's height is far below the accuracy


@subroutine
def _set_current_scale(parts: Parts, length_m: float, natural_rad_s: float, scale: Vector) -> None:
    """Set the units of the windings' currents and voltages, if they are modelled."""
    winding, drive, place = parts.winding, parts.drive, current_place(parts)
    if not (is_wound(winding) and is_motor(drive)):
        return
    # An error of current dies out within 1/α; until then it turns the crank: δω = K_t δi / (J α).
    alpha = winding.bandwidth_rad_s
    current = drive.inertia_kg_m2 * alpha / drive.torque_constant_n_m_a * natural_rad_s / length_m
    scale[place] = scale[place + 1] = current
    scale[place + 2] = alpha * winding.d_inductance_h * current
    scale[place + 3] = alpha * winding.q_inductance_h * current
