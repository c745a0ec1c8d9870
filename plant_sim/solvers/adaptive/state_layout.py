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
from plant_sim.kernels import by_part, law, shared
from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive
from plant_sim.parts.friction import bend_m_s
from plant_sim.parts.housing import Housing, Moving, Tilted
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import HuntCrossley, KelvinVoigt, RigidStop, Stop, is_soft, origin_m
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import Ankle, Wearer, is_worn
from plant_sim.parts.winding import DqWinding, Winding
from plant_sim.result import Impact, MotionState, Observation, Phase
from plant_sim.solvers.bernstein import DEEPEST_HALVING, DEGREE, ORDER
from plant_sim.solvers.double_double import TURN_RAD

Vector = NDArray[np.float64]

FLIGHT, STICK, REST, CONTACT = (int(phase) for phase in Phase)

STAGES = 16
"""Evaluations of the derivative in a step: 12 stages, 1 at its end, 3 for the continuous extension."""

DEPTH, VELOCITY, ANGLE, SPEED = range(4)
"""Places of the motion in the state; the integrals of the ledger follow from `work_place` on."""

SINE, COSINE, SPRING, DRAG, POWER, FALL, SHAKE, BESIDE = range(8)
"""Rows of a Taylor series behind those of the state: sin θ, cos θ, force of the coupling spring, friction,
exponent and exponential of Stribeck's law, a_b of the housing."""


@by_part
def motion_size(part: Drive | Wearer | Winding) -> int:
    """Number of quantities of motion that a part adds to the striker's two."""
    return 0


@law(motion_size, MotorDrive, Ankle)
def _(part: MotorDrive | Ankle) -> int:
    return 2


@law(motion_size, DqWinding)
def _(part: DqWinding) -> int:
    return 4


@by_part
def ledger_size(part: Stop | Housing | Wearer | Winding) -> int:
    """Number of integrals that a part adds to the ledger's two, of drive and friction."""
    return 0


@law(ledger_size, RigidStop, Tilted, Moving, Walking, Ankle)
def _(part: RigidStop | Tilted | Moving | Walking | Ankle) -> int:
    return 1


@law(ledger_size, KelvinVoigt, HuntCrossley, DqWinding)
def _(part: KelvinVoigt | HuntCrossley | DqWinding) -> int:
    return 2


@shared
def plate_place(drive: Drive) -> int:
    """Place of the foot plate's position in the state, followed by its velocity, if there is a wearer."""
    return 2 + motion_size(drive)


@shared
def current_place(parts: Parts) -> int:
    """Place of the windings' currents in the state, if they are modelled."""
    return plate_place(parts.drive) + motion_size(parts.wearer)


@shared
def work_place(parts: Parts) -> int:
    """Place of the drive's work in the state; friction's follows, then the stop's loss and impulse."""
    return current_place(parts) + motion_size(parts.winding)


@shared
def housing_place(parts: Parts) -> int:
    """Place of the housing's work in the state, if it is tilted or moves."""
    return work_place(parts) + 2 + ledger_size(parts.stop)


@shared
def ankle_place(parts: Parts) -> int:
    """Place of the ankle's loss in the state, if there is a wearer."""
    return housing_place(parts) + ledger_size(parts.housing)


@shared
def terminal_place(parts: Parts) -> int:
    """Place of the work at a motor's terminals in the state, if its windings are modelled."""
    return ankle_place(parts) + ledger_size(parts.wearer)


@shared
def state_size(parts: Parts) -> int:
    """Length of the integrated state."""
    return terminal_place(parts) + ledger_size(parts.winding)


UNSETTLED = -1
"""Phase of a module before the solver has determined it."""

NO_IMPACT, IN_CONTACT, LET_GO = range(3)
"""Values of `in_impact`; LET_GO: the stop's force has ended, but the striker has not cleared its surface."""


class Mode:
    """State of the automaton, and counters."""

    phase: int
    direction: int
    crank_direction: int
    crank_stuck: int
    zero_depth: int
    """The four zeros: as in `event_location.Zeros`."""
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


class Held:
    """Values that a step passes on to the next."""

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
    """Times at which a run is sampled, ascending, shape (n,), and the motion at them, shape (n, 3).

    The motion is depth from the scene's stop, velocity and crank angle.
    """

    t_s: Vector
    motion: Vector


class Scratch(NamedTuple):
    """Scratch arrays of event location: shapes (ORDER + 1,) twice, (DEEPEST_HALVING + 2, ORDER + 3).

    `inner` is the motion within a step; only windings use it.
    """

    poly: Vector
    press: Vector
    stack: Vector
    inner: Vector


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


def allocate(parts: Parts, initial: MotionState, accuracy: float, impacts: int, order: int = ORDER) -> Memory:
    """Memory of a module at `initial`, with the arrays that these parts need and room for `impacts`.

    `order` of a step's Taylor series: with sensors DEGREE, otherwise ORDER.
    """
    striker, stop = parts.striker, parts.stop
    motion, size = work_place(parts), state_size(parts)
    natural = math.sqrt(striker.spring_n_m / striker.mass_kg)
    has_winding = isinstance(parts.winding, DqWinding)
    scale = _scale(parts, accuracy)
    memory = Memory(
        y=np.zeros(size),
        mode=zeros_of(Mode, 1),
        held=zeros_of(Held, 1),
        contact=zeros_of(Contact, 1 if is_soft(stop) else 0),
        impacts=zeros_of(Impact, impacts),
        observed=np.zeros(len(OBSERVED)),
        scale=scale,
        contact_scale=SHARE_OF_A_CONTACT * scale[: None if is_soft(stop) else 0],
        k=np.zeros((STAGES, size)),
        trial=np.zeros(size),
        new=np.zeros(size),
        dense=np.zeros((motion, DEGREE + 1)),
        series=np.zeros((size + BESIDE, order + 1)),
        long_dense=np.zeros((motion, order + 1)),
        scratch=Scratch(
            poly=np.zeros(ORDER + 1),
            press=np.zeros(ORDER + 1),
            stack=np.zeros((DEEPEST_HALVING + 2, ORDER + 3)),
            inner=np.zeros(motion if has_winding else 0),
        ),
    )
    memory.held[0].rest_m_s = 0.01 * accuracy * natural  # such a rebound's height is far below the accuracy
    depth_m = initial.x_m - origin_m(stop, striker)
    restart(parts, memory, depth_m, initial.v_m_s, initial.crank_rad, initial.omega_rad_s)
    return memory


@shared
def restart(
    parts: Parts, memory: Memory, depth_m: float, v_m_s: float, crank_rad: float, omega_rad_s: float
) -> None:
    """Set a module to a start of undetermined phase; nothing of an earlier run is left."""
    memory.y[:] = 0.0
    memory.mode[0] = _NEW_MODE[0]
    if is_soft(parts.stop):
        memory.contact[0] = _NEW_CONTACT[0]
    memory.y[0], memory.y[1] = depth_m, v_m_s
    held, striker = memory.held[0], parts.striker
    held.elapsed_s = held.elapsed_low_s = 0.0
    held.free_step_s = held.contact_step_s = 0.1 / math.sqrt(striker.spring_n_m / striker.mass_kg)
    held.last_step_s = held.last_margin = held.debt = 0.0
    held.stored_before_j = math.nan
    memory.observed[:] = 0.0
    _set_crank(parts.drive, memory, crank_rad % TURN_RAD, omega_rad_s)


@by_part
def _set_crank(drive: Drive, memory: Memory, angle_rad: float, omega_rad_s: float) -> None:
    raise NotImplementedError


@law(_set_crank, IdealDrive)
def _(drive: IdealDrive, memory: Memory, angle_rad: float, omega_rad_s: float) -> None:
    memory.held[0].crank_rad = angle_rad


@law(_set_crank, MotorDrive)
def _(drive: MotorDrive, memory: Memory, angle_rad: float, omega_rad_s: float) -> None:
    memory.y[ANGLE], memory.y[SPEED] = angle_rad, omega_rad_s


def _scale(parts: Parts, accuracy: float) -> Vector:
    """Tolerated error of one step in each quantity, equivalent to a step's share of `accuracy` in
    position."""
    striker, drive, stop = parts.striker, parts.drive, parts.stop
    natural = math.sqrt(striker.spring_n_m / striker.mass_kg)
    length = max(drive.amplitude_m, 1e-3)
    motion = [1.0, natural]
    share = SHARE_OF_A_STEP
    if isinstance(drive, MotorDrive):
        share = SHARE_OF_A_MOTOR_STEP
        motion += [1.0 / length, natural / length]
    if is_worn(parts.wearer):
        motion += [1.0, natural]
    if isinstance(drive, MotorDrive) and isinstance(parts.winding, DqWinding):
        # An error of current dies out within 1/α; until then it turns the crank: δω = K_t δi / (J α).
        winding, alpha = parts.winding, parts.winding.bandwidth_rad_s
        current = drive.inertia_kg_m2 * alpha / drive.torque_constant_n_m_a * natural / length
        motion += [current, current, alpha * winding.d_inductance_h * current]
        motion += [alpha * winding.q_inductance_h * current]
    force = striker.spring_n_m * max(length, abs(striker.rest_length_m - origin_m(stop, striker)))
    ledger = [force, force, force, striker.mass_kg * natural][: 2 + ledger_size(stop)]
    ledger += [force] * (state_size(parts) - housing_place(parts))
    scale: Vector = share * accuracy * np.array(motion + ledger)
    scale[1] = min(scale[1], SHARE_OF_BEND * bend_m_s(parts.friction))
    return scale
