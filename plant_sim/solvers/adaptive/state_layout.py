"""The records of a module that kernels advance: its state, the values passed from step to step, and scratch.

`Memory` is one record, a block of numbers without pointers: a copy of its bytes is a copy of the module. Its
parts that are used both by name and by place have two names: `y` by name, `all_y` as an array.
"""

import math
from typing import Annotated, Any, NamedTuple, TypeAlias, get_type_hints

import numpy as np

from plant_sim.arrays import FloatArray, IntArray, One, record_type, zeros_of
from plant_sim.jets import ROW, State
from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import any_parts
from plant_sim.parts.drive import is_motor
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

STAGES = 16
"""Evaluations of the derivative in a step: 12 stages, 1 at its end, 3 for the continuous extension."""


SIZE, ACCOUNTS = len(State.__annotations__), ROW.drive_j
"""Number of quantities, and the place of the first account."""

UNSETTLED = -1
"""Phase of a module at a start or after a disturbance, before the solver has determined it."""

NO_IMPACT, IN_CONTACT, LET_GO = range(3)
"""Values of `in_impact`; LET_GO: the stop's force has ended, but the striker has not cleared its surface."""


class Mode:
    """State of the automaton, and the numbers of impacts and of samples so far."""

    phase: int
    direction: int
    crank_direction: int
    crank_stuck: int
    zero_depth: int
    """The four zeros: number of leading derivatives, the value included, that are zero at a step's start."""
    zero_velocity: int
    zero_crank: int
    zero_voltage: int
    in_impact: int
    impacts: int
    samples: int
    voltage_limited: int


class Progress:
    """Values that a step, or a tick (`plant_sim.tick`), passes on to the next: time, call, next steps."""

    t_s: float
    """Time of a module that is advanced tick by tick."""
    t_rest_s: float
    """Rounding error of `t_s`."""
    torque_n_m: float
    """The torque command of the present call of `advance`, its start and its duration."""
    start_s: float
    duration_s: float
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
    stored_before_j: float
    """Stored energy where the ledger begins; NaN until it is taken anew, after a change from outside."""
    motion: int
    """Number of places of the motion in `places`, and of all."""
    used: int
    advance_at: int
    """Address of the kernel `advance`; 0 until a kernel may need it (`adaptive.with_address`)."""


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


OBSERVED: Any = Observation._make(range(len(Observation._fields)))
"""Places in Memory.observed by the field names of `Observation`."""


def _array(*shape: int, of: Any = np.float64) -> np.dtype[Any]:
    return np.dtype((of, shape))


_SERIES = np.dtype((np.record, [(name, np.float64, (ORDER + 1,)) for name in ROW._fields]))
_SCRATCH = np.dtype(
    (np.record, [(name, one.dtype, one.shape) for name, one in scratch_arrays()._asdict().items()])
)
SeriesRows: TypeAlias = Any
"""A record with a row of Taylor coefficients for each quantity of `ROW`."""


class Memory:
    """The module and its scratch. `all_x` is the same memory as `x`, as an array."""

    mode: Mode
    all_mode: Annotated[IntArray, _array(len(Mode.__annotations__), of=np.int64)]
    progress: Progress
    all_progress: Annotated[FloatArray, _array(len(Progress.__annotations__))]
    contact: Contact
    all_contact: Annotated[FloatArray, _array(len(Contact.__annotations__))]
    y: State
    all_y: Annotated[FloatArray, _array(SIZE)]
    """The state now."""
    new: State
    all_new: Annotated[FloatArray, _array(SIZE)]
    """The state at the end of the present step."""
    trial: State
    all_trial: Annotated[FloatArray, _array(SIZE)]
    inner: State
    all_inner: Annotated[FloatArray, _array(SIZE)]
    scale: State
    all_scale: Annotated[FloatArray, _array(SIZE)]
    """Tolerances of a step, and below those of a step in contact."""
    contact_scale: State
    all_contact_scale: Annotated[FloatArray, _array(SIZE)]
    slopes: Annotated[FloatArray, _array(STAGES, SIZE)]
    """Derivatives of the state in the stages of DOP853."""
    series: Annotated[SeriesRows, _SERIES]
    all_series: Annotated[FloatArray, _array(len(ROW), ORDER + 1)]
    """Taylor coefficients of a step."""
    dense: Annotated[FloatArray, _array(ACCOUNTS, DEGREE + 1)]
    """Bernstein coefficients of the motion within a step of DOP853, or within a series of its degree."""
    long_dense: Annotated[FloatArray, _array(ACCOUNTS, ORDER + 1)]
    """Bernstein coefficients of the motion within a series of full order."""
    places: Annotated[IntArray, _array(SIZE, of=np.int64)]
    """Places of the quantities that the parts have: `progress.motion` of the motion, `used` with accounts."""
    observed: Annotated[FloatArray, _array(len(OBSERVED))]
    scratch: Annotated[Scratch, _SCRATCH]


def _memory_type() -> np.dtype[Any]:
    """The type of `Memory`: its fields one after the other, `all_x` in the place of `x`."""
    names, formats, offsets, end = [], [], [], 0
    for name, hint in get_type_hints(Memory, include_extras=True).items():
        its_type = hint.__metadata__[0] if hasattr(hint, "__metadata__") else record_type(hint)
        offsets.append(end - its_type.itemsize if name.startswith("all_") else end)
        end = offsets[-1] + its_type.itemsize
        names.append(name)
        formats.append(its_type)
    return np.dtype((np.record, {"names": names, "formats": formats, "offsets": offsets, "itemsize": end}))


MEMORY = _memory_type()
"""The type of a record of `Memory`."""

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
    is_pressed: bool
    """Whether a soft stop presses on the striker."""
    time_s: float
    """Time at the step's start."""
    voltage_limited: bool
    """Whether the bus limits a current loop."""


READINGS = Observation._fields.index("felt_force_n") + 1
"""Number of an observation's fields that describe the present instant alone."""


class Grid(NamedTuple):
    """Times at which a run is sampled, ascending, shape (n,), and the module at them, shape (n, READINGS).

    A row begins as an `Observation` does, with the position counted from the scene's stop.
    """

    t_s: FloatArray
    rows: FloatArray


NO_GRID = Grid(np.empty(0), np.empty((0, READINGS)))


class Run(NamedTuple):
    """The argument of kernels: parts, the sensors' filters, memory, room for impacts, and the samples' grid.

    Impacts are records as `Impact`; the first `mode.impacts` are in use.
    """

    parts: Parts
    probe: Any
    memory: One[Memory]
    impacts: Any
    grid: Grid


def run_of(parts: Parts, probe: Any, memory: One[Memory], impacts: Any, grid: Grid = NO_GRID) -> Run:
    """The run by reference."""
    record = Run(parts, probe, memory, impacts, grid)
    return by_reference(record, record._replace(parts=any_parts(parts)))


def allocate(
    parts: Parts, initial: MotionState, accuracy: float, impacts: int, probe: Any, grid: Grid = NO_GRID
) -> Run:
    """A module at `initial`, by reference, with room for `impacts`."""
    run = run_of(parts, probe, np.zeros(1, MEMORY), zeros_of(Impact, impacts), grid)
    depth_m = initial.x_m - origin_m(parts.stop, parts.striker)
    start = depth_m, initial.v_m_s, initial.crank_rad, initial.omega_rad_s, accuracy
    arguments = run, *map(float, start)
    entry_point(_begin, *arguments)(*arguments)
    return run


@jit
def _begin(
    run: Run, depth_m: float, v_m_s: float, crank_rad: float, omega_rad_s: float, accuracy: float
) -> None:
    """Set a module to its start."""
    restart(run, depth_m, v_m_s, crank_rad, omega_rad_s)
    set_accuracy(run, accuracy)


@subroutine
def restart(run: Run, depth_m: float, v_m_s: float, crank_rad: float, omega_rad_s: float) -> None:
    """Set a module to a start of undetermined phase; nothing of an earlier run is left. `set_accuracy`
    follows.
    """
    parts, striker = run.parts, run.parts.striker
    advance_at = run.memory[0].progress.advance_at
    memory = run.memory[0]
    memory.all_mode[:] = 0
    memory.all_progress[:] = memory.all_contact[:] = memory.all_y[:] = memory.observed[:] = 0.0
    y, progress, memory.mode.phase = memory.y, memory.progress, UNSETTLED
    progress.advance_at, progress.stored_before_j = advance_at, math.nan
    y.depth_m, y.v_m_s, y.crank_rad = depth_m, v_m_s, crank_rad % TURN_RAD
    y.crank_rad_s = omega_rad_s if is_motor(parts.drive) else parts.drive.omega_rad_s
    if is_worn(parts.wearer):
        y.plate_m = equilibrium_m(parts.wearer, steady_m_s2(parts.housing))
        y.depth_m -= y.plate_m
    progress.free_step_s = progress.contact_step_s = 0.1 / math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    _list_places(parts, memory)


@subroutine
def _list_places(parts: Parts, memory: Memory) -> None:
    """List the quantities that the parts have: those of the motion, then the accounts."""
    memory.progress.motion = memory.progress.used = 0
    motor, soft = is_motor(parts.drive), is_soft(parts.stop)
    _use(memory, ROW.depth_m, 2, True)
    _use(memory, ROW.crank_rad, 2, motor)
    _use(memory, ROW.plate_m, 2, is_worn(parts.wearer))
    _use(memory, ROW.i_d_a, 4, is_wound(parts.winding))
    memory.progress.motion = memory.progress.used
    _use(memory, ROW.drive_j, 2, True)
    _use(memory, ROW.stop_j, 1, soft or is_rigid(parts.stop))
    _use(memory, ROW.impulse_n_s, 1, soft)
    _use(memory, ROW.housing_j, 1, not is_level(parts.housing))
    _use(memory, ROW.ankle_j, 1, is_worn(parts.wearer))
    _use(memory, ROW.terminal_j, 2, is_wound(parts.winding))


@subroutine
def _use(memory: Memory, first: int, count: int, has: bool) -> None:
    for index in range(first, first + count if has else first):
        memory.places[memory.progress.used] = index
        memory.progress.used += 1


@subroutine
def set_accuracy(run: Run, accuracy: float) -> None:
    """Set the tolerated error of one step in each quantity, equivalent to a step's share of `accuracy` in
    position."""
    parts, memory = run.parts, run.memory[0]
    striker, stop, scale = parts.striker, parts.stop, memory.scale
    natural = math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    length = max(parts.drive.amplitude_m, 1e-3)
    force = striker.spring_n_per_m * max(length, abs(striker.rest_length_m - origin_m(stop, striker)))
    memory.all_scale[:] = force
    scale.depth_m, scale.v_m_s = 1.0, natural
    scale.crank_rad, scale.crank_rad_s = 1.0 / length, natural / length
    scale.plate_m, scale.plate_m_s = 1.0, natural
    _set_current_scale(parts, length, natural, scale)
    scale.impulse_n_s = striker.mass_kg * natural
    share = SHARE_OF_A_MOTOR_STEP if is_motor(parts.drive) else SHARE_OF_A_STEP
    for i in range(SIZE):
        memory.all_scale[i] *= share * accuracy
    scale.v_m_s = min(scale.v_m_s, SHARE_OF_BEND * bend_m_s(parts.friction))
    for i in range(SIZE):
        memory.all_contact_scale[i] = SHARE_OF_A_CONTACT * memory.all_scale[i]
    memory.progress.rest_m_s = 0.01 * accuracy * natural  # such a rebound's height is far below the accuracy


@subroutine
def _set_current_scale(parts: Parts, length_m: float, natural_rad_s: float, scale: State) -> None:
    """Set the units of the windings' currents and voltages, if they are modelled."""
    winding, drive = parts.winding, parts.drive
    if not (is_wound(winding) and is_motor(drive)):
        return
    # An error of current dies out within 1/α; until then it turns the crank: δω = K_t δi / (J α).
    alpha = winding.bandwidth_rad_s
    current = drive.inertia_kg_m2 * alpha / drive.torque_constant_n_m_a * natural_rad_s / length_m
    scale.i_d_a = scale.i_q_a = current
    scale.u_d_v = alpha * winding.d_inductance_h * current
    scale.u_q_v = alpha * winding.q_inductance_h * current


@subroutine
def now_s(memory: Memory) -> float:
    """The time reached."""
    return memory.progress.start_s + memory.progress.elapsed_s
