"""Any scene: DOP853 with error control from event to event.

A step ends at the first event on its continuous extension, which Bernstein coefficients find however many
there are; it is then repeated up to there, so that the state at an event has the step's own accuracy.
"""

import math

import numpy as np

from plant_sim.kernels import by_part, jit, law, subroutine, unowned
from plant_sim.parts.drive import Drive, MotorDrive
from plant_sim.parts.friction import Stribeck, static_limit_n
from plant_sim.parts.housing import is_level, smooth_for_s
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_force_n, is_rigid, is_soft, origin_m, stop_force_n
from plant_sim.parts.wearer import Ankle, NoWearer, Wearer, is_worn
from plant_sim.parts.winding import DqWinding, Winding
from plant_sim.result import (
    ElectricalLedger,
    EnergyLedger,
    Impacts,
    MotionState,
    Observation,
    Phase,
    Samples,
    SimulationResult,
)
from plant_sim.sensors.sensing import NoSensing, Probe, is_sensing, note_readings, sense_step
from plant_sim.solvers.adaptive.bernstein import DEGREE, evaluate
from plant_sim.solvers.adaptive.currents import (
    current_s,
    magnetic_energy_j,
    turning_current_a,
    turning_torque_n_m,
    voltage_may_end,
)
from plant_sim.solvers.adaptive.dop853 import attempt, extend
from plant_sim.solvers.adaptive.events import NONE, TOUCH, TURN, Found, Scratch, Zeros, angle_at, first_event
from plant_sim.solvers.adaptive.motion import (
    CONTACT,
    FLIGHT,
    REST,
    SPEED,
    STICK,
    Flow,
    Vector,
    ankle_place,
    closing_m_s,
    current_place,
    derivative,
    felt_force_n,
    from_stop_m,
    held_force_n,
    housing_place,
    in_touch,
    plate_place,
    state_size,
    stored_energy_j,
    terminal_place,
    work_place,
)
from plant_sim.solvers.adaptive.state_layout import (
    ACCELERATION,
    ANGLE_NOW,
    ANKLE_LOSS,
    APPROACH,
    CRANK_DIRECTION,
    CRANK_STUCK,
    CURRENT,
    DAMPING,
    DEBT,
    DIRECTION,
    DRIVE_WORK,
    ELAPSED,
    ELAPSED_LOW,
    FELT_FORCE,
    FRICTION_LOSS,
    HOUSING_WORK,
    IMPACT_ANGLE,
    IMPACT_LOSS,
    IMPACT_TIME,
    IMPACTS,
    IMPULSE,
    LAST_MARGIN,
    LAST_STEP,
    MOTOR_TORQUE,
    PEAK,
    PEAK_FELT,
    PEAK_FORCE,
    PHASE,
    PHASE_NOW,
    PLACE_NOW,
    REBOUND,
    SAMPLES,
    SEEN,
    SPEED_NOW,
    STEP_CONTACT,
    STEP_FREE,
    STOP_FORCE,
    STORED,
    UNSETTLED,
    VELOCITY_NOW,
    ZERO_CRANK,
    ZERO_DEPTH,
    ZERO_VELOCITY,
    Memory,
    allocate,
)
from plant_sim.solvers.adaptive.transitions import (
    apply,
    crank_angle,
    crank_speed,
    is_voltage_limited,
    settle,
    settle_crank,
    settle_voltage,
    turn_crank,
    voltage_zeros,
)
from plant_sim.solvers.cost import ALLOWANCE, SolverError, debt, too_costly
from plant_sim.solvers.double_double import two_sum

DONE, BUFFER_FULL, STEP_TOO_SMALL, TOO_COSTLY = range(4)
"""What `advance` returns."""

LEAST_ERROR = 1e-6
"""Of a step, in tolerances; a smaller one, as of rest, says nothing of the next step."""

GOLDEN = 0.6180339887498949
GOLDEN_CUTS = 20
"""They narrow half a step to 3e-5 of it, where the force is 1e-9 below its peak."""

NO_GRID = np.empty(0)
NO_SAMPLES = np.empty((0, 3))


@jit
def advance(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    torque_n_m: float,
    start_s: float,
    duration_s: float,
    grid_s: Vector,
    samples: Vector,
) -> int:
    """Carry `memory` on to `duration_s` after `start_s` under a held torque; continues where it left off.

    `memory.held[ELAPSED]` says how far it got. Depth, velocity and crank angle at the times of `grid_s`
    (ascending, absolute) go into the rows of `samples`.
    """
    memory = _borrowed(memory)
    grid_s, samples = unowned(grid_s), unowned(samples)
    mode, held = memory.mode, memory.held
    if mode[PHASE] == UNSETTLED:
        settle(parts, memory, torque_n_m, start_s)
    elif mode[CRANK_STUCK] == 1:
        settle_crank(parts.drive, parts, memory, torque_n_m)
    settle_voltage(parts.winding, parts.drive, parts, memory, torque_n_m)
    status = DONE
    while True:
        _sample_now(parts, memory, start_s, grid_s, samples)
        if held[ELAPSED] >= duration_s:
            break
        if mode[IMPACTS] == memory.impacts.shape[0]:
            status = BUFFER_FULL
            break
        used = _step(parts, probe, memory, torque_n_m, start_s, duration_s, grid_s, samples)
        if used < 0.0:
            status = STEP_TOO_SMALL
            break
        if held[DEBT] > ALLOWANCE:
            status = TOO_COSTLY
            break
    _observe(parts, memory, torque_n_m, start_s + held[ELAPSED])
    note_readings(probe)
    return status


@subroutine
def _borrowed(memory: Memory) -> Memory:
    scratch = memory.scratch
    return Memory(
        unowned(memory.y),
        unowned(memory.mode),
        unowned(memory.held),
        unowned(memory.contact),
        unowned(memory.impacts),
        unowned(memory.observed),
        unowned(memory.scale),
        unowned(memory.contact_scale),
        unowned(memory.k),
        unowned(memory.trial),
        unowned(memory.new),
        unowned(memory.dense),
        Scratch(
            unowned(scratch.poly), unowned(scratch.press), unowned(scratch.stack), unowned(scratch.inner)
        ),
    )


@subroutine
def _step(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    torque_n_m: float,
    start_s: float,
    duration_s: float,
    grid_s: Vector,
    samples: Vector,
) -> float:
    """One step, up to an event at most; returns its length, s, or −1 where no step is small enough."""
    y, mode, held, new = memory.y, memory.mode, memory.held, memory.new
    k, trial, dense = memory.k, memory.trial, memory.dense
    begin_s = start_s + held[ELAPSED]
    flow = _flow(parts, memory, torque_n_m, begin_s)
    scale = memory.contact_scale if flow.phase == CONTACT else memory.scale
    place = STEP_CONTACT if flow.phase == CONTACT else STEP_FREE
    remaining = (duration_s - held[ELAPSED]) - held[ELAPSED_LOW]
    longest = 1.0 / max(
        math.sqrt(parts.striker.spring_n_m / parts.striker.mass_kg), abs(crank_speed(parts.drive, memory))
    )
    longest = min(longest, ankle_s(parts.wearer), smooth_for_s(parts.housing, begin_s))
    longest = min(longest, current_s(parts.winding, parts.drive))
    derivative(parts, flow, 0.0, y, k[0])
    attempts = 0.0
    while True:
        h = min(held[place], longest, remaining)
        attempts += 1.0
        error = attempt(parts, flow, h, y, scale, k, trial, new)
        if error <= 1.0:
            break
        held[place] = h * (max(0.2, 0.9 * _eighth_root(1.0 / error)) if error < 1e300 else 0.2)
        if held[place] < 1e-12 * longest:
            return -1.0
    _choose_next(held, place, h, error)

    zeros = Zeros(
        mode[ZERO_DEPTH], mode[ZERO_VELOCITY], mode[ZERO_CRANK], voltage_zeros(parts.winding, memory)
    )
    used: float = h
    event = NONE
    has_sample = mode[SAMPLES] < grid_s.size and grid_s[mode[SAMPLES]] < begin_s + h
    may_end = is_worn(parts.wearer) or _may_end(parts, flow, h, y, new, k, zeros)
    if is_sensing(probe) or has_sample or may_end:
        extend(parts, flow, h, y, new, k, trial, dense)
    if may_end:
        found = first_event(parts, flow, h, y, zeros, crank_angle(parts.drive, memory), dense, memory.scratch)
        event = found.event
        if event != NONE:
            used = _repeat(parts, flow, found, h, memory)
    if flow.phase == CONTACT:
        _follow_peak(parts, memory, flow.damping_s_m, used / h)
    _follow_felt(parts.wearer, parts.drive, memory, used / h)
    sense_step(probe, parts, dense, h, used, begin_s)
    if has_sample:
        _sample_step(parts, memory, begin_s, h, used, grid_s, samples)

    for i in range(state_size(parts)):
        y[i] = new[i]
    turn_crank(parts.drive, memory, used)
    mode[ZERO_DEPTH] = mode[ZERO_VELOCITY] = mode[ZERO_CRANK] = 0
    _pass_time(memory, flow.phase, used, remaining, duration_s)
    if used < remaining:  # what ends a call is as short as the caller asked for
        held[DEBT] = debt(held[DEBT], attempts, used / longest)
    if event != NONE:
        held[LAST_STEP] = 0.0
        apply(parts, probe, memory, torque_n_m, event, start_s + held[ELAPSED])
    return used


@subroutine
def _pass_time(memory: Memory, phase: int, used_s: float, remaining_s: float, duration_s: float) -> None:
    """Book `used_s` seconds in a phase, of the `remaining_s` up to `duration_s`."""
    held = memory.held
    if used_s > 0.0:
        memory.mode[SEEN] |= 1 << phase
    elapsed_s, rest_s = two_sum(held[ELAPSED], held[ELAPSED_LOW] + used_s)
    is_end = used_s == remaining_s
    held[ELAPSED] = duration_s if is_end else elapsed_s
    held[ELAPSED_LOW] = 0.0 if is_end else rest_s


@subroutine
def _choose_next(held: Vector, place: int, h_s: float, error: float) -> None:
    """Length of the next step: the error's, and no longer than the trend of the last two allows.

    Predictive control (Gustafsson, ACM Trans. Math. Softw. 20, 1994): where friction stiffens towards rest
    every second step would else be refused.
    """
    margin = _eighth_root(1.0 / max(error, LEAST_ERROR))
    growth = 0.9 * margin
    if held[LAST_STEP] > 0.0:
        growth *= min(h_s / held[LAST_STEP] * margin / held[LAST_MARGIN], 1.0)
    growth = min(growth, 5.0)
    held[place] = max(held[place], h_s * growth) if growth > 1.0 else h_s * growth
    held[LAST_STEP], held[LAST_MARGIN] = h_s, margin


@subroutine
def _eighth_root(value: float) -> float:
    """By how much a step may grow for an error of the method's order that shrinks to 1/value."""
    return math.sqrt(math.sqrt(math.sqrt(value)))


@subroutine
def _flow(parts: Parts, memory: Memory, torque_n_m: float, time_s: float) -> Flow:
    mode = memory.mode
    return Flow(
        mode[PHASE],
        float(mode[DIRECTION]),
        memory.contact[DAMPING] if is_soft(parts.stop) else 0.0,
        crank_angle(parts.drive, memory),
        torque_n_m,
        float(mode[CRANK_DIRECTION]),
        mode[CRANK_STUCK] == 1,
        time_s,
        is_voltage_limited(parts.winding, memory),
    )


@subroutine
def _repeat(parts: Parts, flow: Flow, found: Found, h_s: float, memory: Memory) -> float:
    """Step again, up to the event only; a touch-down is then polished on the step itself."""
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


@subroutine
def _may_end(parts: Parts, flow: Flow, h_s: float, y: Vector, new: Vector, k: Vector, zeros: Zeros) -> bool:
    """Whether an event could lie in the step: bounds from its ends and twice its stages' largest slopes.

    Of slopes within ± S, g between g0 and g1 is at least (g0 + g1 − S h) / 2.
    """
    if flow.phase != FLIGHT or zeros.depth + zeros.velocity + zeros.crank > 0:
        return True
    steepest = 0.0
    for stage in range(12):
        steepest = max(steepest, abs(k[stage, 1]))
    change = h_s * 2.0 * steepest
    is_dry = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2) > 0.0
    if is_dry and (y[1] + new[1]) * flow.direction <= change:
        return True
    has_stop = is_soft(parts.stop) or is_rigid(parts.stop)
    if has_stop and max(y[0], new[0]) + 0.125 * h_s * change >= 0.0:
        return True
    return _crank_may_halt(parts.drive, flow, h_s, y, new, k) or _voltage_may_end(
        parts.winding, parts.drive, parts, flow, h_s, y, new, k
    )


@by_part
def _voltage_may_end(
    winding: Winding, drive: Drive, parts: Parts, flow: Flow, h_s: float, y: Vector, new: Vector, k: Vector
) -> bool:
    return False


@law(_voltage_may_end, DqWinding)
def _(
    winding: DqWinding,
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    h_s: float,
    y: Vector,
    new: Vector,
    k: Vector,
) -> bool:
    return flow.voltage_limited or voltage_may_end(
        winding, drive, flow.torque_n_m, h_s, y, new, k, SPEED, current_place(parts)
    )


@by_part
def _crank_may_halt(drive: Drive, flow: Flow, h_s: float, y: Vector, new: Vector, k: Vector) -> bool:
    return False


@law(_crank_may_halt, MotorDrive)
def _(drive: MotorDrive, flow: Flow, h_s: float, y: Vector, new: Vector, k: Vector) -> bool:
    if drive.dry_n_m == 0.0:
        return False
    if flow.crank_stuck:
        return True
    steepest = 0.0
    for stage in range(12):
        steepest = max(steepest, abs(k[stage, 3]))
    twice_mean: float = (y[3] + new[3]) * flow.crank_direction
    return twice_mean <= h_s * 2.0 * steepest


@subroutine
def _follow_peak(parts: Parts, memory: Memory, damping_s_m: float, share: float) -> None:
    """Largest force of the contact so far: the largest of five on the step, refined by golden section."""
    dense, contact = memory.dense, memory.contact
    best, best_s = -1.0, 0.0
    for i in range(5):
        s = share * 0.25 * i
        force = _force_at(parts, dense, damping_s_m, s)
        if force > best:
            best, best_s = force, s
    if best > contact[PEAK]:
        low, high = max(best_s - 0.25 * share, 0.0), min(best_s + 0.25 * share, share)
        for _ in range(GOLDEN_CUTS):
            cut = GOLDEN * (high - low)
            if _force_at(parts, dense, damping_s_m, high - cut) > _force_at(
                parts, dense, damping_s_m, low + cut
            ):
                high = low + cut
            else:
                low = high - cut
        contact[PEAK] = max(best, _force_at(parts, dense, damping_s_m, 0.5 * (low + high)))


@subroutine
def _force_at(parts: Parts, dense: Vector, damping_s_m: float, s: float) -> float:
    depth = max(evaluate(dense[0], DEGREE, s), 0.0)
    velocity = _closing_at(parts.wearer, parts.drive, dense, s)
    return stop_force_n(parts.stop, elastic_force_n(parts.stop, depth), velocity, damping_s_m)


@by_part
def _closing_at(wearer: Wearer, drive: Drive, dense: Vector, s: float) -> float:
    """How fast depth grows within a step, m/s."""
    raise NotImplementedError


@law(_closing_at, NoWearer)
def _(wearer: NoWearer, drive: Drive, dense: Vector, s: float) -> float:
    return evaluate(dense[1], DEGREE, s)


@law(_closing_at, Ankle)
def _(wearer: Ankle, drive: Drive, dense: Vector, s: float) -> float:
    return evaluate(dense[1], DEGREE, s) - evaluate(dense[plate_place(drive) + 1], DEGREE, s)


@by_part
def _follow_felt(wearer: Wearer, drive: Drive, memory: Memory, share: float) -> None:
    """Largest force on the wearer so far, by the same means as the contact's."""
    return


@law(_follow_felt, Ankle)
def _(wearer: Ankle, drive: Drive, memory: Memory, share: float) -> None:
    dense, contact = memory.dense, memory.contact
    best, best_s = -1.0, 0.0
    for i in range(5):
        s = share * 0.25 * i
        force = _felt_at(wearer, drive, dense, s)
        if force > best:
            best, best_s = force, s
    if best > contact[PEAK_FELT]:
        low, high = max(best_s - 0.25 * share, 0.0), min(best_s + 0.25 * share, share)
        for _ in range(GOLDEN_CUTS):
            cut = GOLDEN * (high - low)
            if _felt_at(wearer, drive, dense, high - cut) > _felt_at(wearer, drive, dense, low + cut):
                high = low + cut
            else:
                low = high - cut
        contact[PEAK_FELT] = max(best, _felt_at(wearer, drive, dense, 0.5 * (low + high)))


@subroutine
def _felt_at(wearer: Ankle, drive: Drive, dense: Vector, s: float) -> float:
    place = plate_place(drive)
    way, velocity = evaluate(dense[place], DEGREE, s), evaluate(dense[place + 1], DEGREE, s)
    return abs(wearer.stiffness_n_m * way + wearer.damping_n_s_m * velocity)


@by_part
def ankle_s(wearer: Wearer) -> float:
    """How long a step may be for the ankle's sake, s: a radian of its oscillation at most."""
    return math.inf


@law(ankle_s, Ankle)
def _(wearer: Ankle) -> float:
    return math.sqrt(wearer.plate_kg / wearer.stiffness_n_m)


@subroutine
def _sample_now(parts: Parts, memory: Memory, start_s: float, grid_s: Vector, samples: Vector) -> None:
    mode = memory.mode
    while mode[SAMPLES] < grid_s.size and grid_s[mode[SAMPLES]] <= start_s + memory.held[ELAPSED]:
        row = samples[mode[SAMPLES]]
        row[0], row[1] = from_stop_m(parts.wearer, parts.drive, memory.y), memory.y[1]
        row[2] = crank_angle(parts.drive, memory)
        mode[SAMPLES] += 1


@subroutine
def _sample_step(
    parts: Parts, memory: Memory, begin_s: float, h_s: float, used_s: float, grid_s: Vector, samples: Vector
) -> None:
    mode = memory.mode
    while mode[SAMPLES] < grid_s.size and grid_s[mode[SAMPLES]] < begin_s + used_s:
        row = samples[mode[SAMPLES]]
        s = (grid_s[mode[SAMPLES]] - begin_s) / h_s
        row[0] = _place_at(parts.wearer, parts.drive, memory.dense, s)
        row[1] = evaluate(memory.dense[1], DEGREE, s)
        row[2] = angle_at(parts.drive, crank_angle(parts.drive, memory), s, h_s, memory.dense)
        mode[SAMPLES] += 1


@by_part
def _place_at(wearer: Wearer, drive: Drive, dense: Vector, s: float) -> float:
    """The striker's place within a step, m from where the scene puts the stop."""
    raise NotImplementedError


@law(_place_at, NoWearer)
def _(wearer: NoWearer, drive: Drive, dense: Vector, s: float) -> float:
    return evaluate(dense[0], DEGREE, s)


@law(_place_at, Ankle)
def _(wearer: Ankle, drive: Drive, dense: Vector, s: float) -> float:
    return evaluate(dense[0], DEGREE, s) + evaluate(dense[plate_place(drive)], DEGREE, s)


@subroutine
def _observe(parts: Parts, memory: Memory, torque_n_m: float, time_s: float) -> None:
    """What can be read off the module now."""
    y, observed = memory.y, memory.observed
    flow = _flow(parts, memory, torque_n_m, time_s)
    observed[PLACE_NOW] = from_stop_m(parts.wearer, parts.drive, y) + origin_m(parts.stop, parts.striker)
    observed[VELOCITY_NOW] = y[1]
    derivative(parts, flow, 0.0, y, memory.k[0])
    observed[ACCELERATION] = memory.k[0, 1]
    observed[STOP_FORCE] = 0.0
    if is_soft(parts.stop) and in_touch(flow.phase, y[0]):
        observed[STOP_FORCE] = stop_force_n(
            parts.stop,
            elastic_force_n(parts.stop, y[0]),
            closing_m_s(parts.wearer, parts.drive, y),
            flow.damping_s_m,
        )
    angle, speed = crank_angle(parts.drive, memory), crank_speed(parts.drive, memory)
    winding, place = parts.winding, current_place(parts)
    observed[CURRENT] = turning_current_a(winding, parts.drive, torque_n_m, speed, y, place)
    observed[MOTOR_TORQUE] = turning_torque_n_m(winding, parts.drive, torque_n_m, angle, speed, y, place)
    observed[FELT_FORCE] = felt_force_n(parts.wearer, parts.drive, y)
    work = work_place(parts)
    observed[DRIVE_WORK] = y[work]
    observed[STORED] = stored_energy_j(parts, flow.phase, y, angle, speed)
    observed[FRICTION_LOSS] = y[work + 1]
    if is_soft(parts.stop) or is_rigid(parts.stop):
        observed[IMPACT_LOSS] = y[work + 2]
    if not is_level(parts.housing):
        observed[HOUSING_WORK] = y[housing_place(parts)]
    if is_worn(parts.wearer):
        observed[ANKLE_LOSS] = y[ankle_place(parts)]
    observed[ANGLE_NOW] = angle
    observed[SPEED_NOW] = speed
    observed[PHASE_NOW] = flow.phase
    limit = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
    if flow.phase == REST and held_force_n(parts, angle, y, time_s) < limit:
        observed[PHASE_NOW] = STICK  # friction holds it there, the stop does not have to


IMPACTS_AT_ONCE = 4096
"""Rows of the impacts' buffer; a fuller run empties it in between."""


def simulate(
    parts: Parts,
    initial: MotionState,
    until_s: float,
    samples_t_s: Vector | None = None,
    *,
    torque_n_m: float = 0.0,
    accuracy: float = 1e-9,
) -> SimulationResult:
    """Run from `initial` (whose phase is found anew) to `until_s` under a held motor torque.

    `samples_t_s` ascends within the run. `accuracy` is the largest error per forcing period, m.
    """
    memory = allocate(parts, initial, accuracy, IMPACTS_AT_ONCE)
    grid = np.ascontiguousarray(NO_GRID if samples_t_s is None else samples_t_s, dtype=np.float64)
    samples = np.zeros((grid.size, 3))
    run(parts, NoSensing(), memory, torque_n_m, initial.t_s, 0.0, grid, samples)
    stored_before_j = float(memory.observed[STORED])
    rows = [run(parts, NoSensing(), memory, torque_n_m, initial.t_s, until_s - initial.t_s, grid, samples)]
    while memory.held[ELAPSED] < until_s - initial.t_s:
        rows.append(
            run(parts, NoSensing(), memory, torque_n_m, initial.t_s, until_s - initial.t_s, grid, samples)
        )
    columns = np.concatenate(rows).T
    origin = origin_m(parts.stop, parts.striker)
    end = observation(memory, stored_before_j)
    return SimulationResult(
        impacts=Impacts(
            t_s=columns[IMPACT_TIME],
            v_m_s=columns[APPROACH],
            v_after_m_s=columns[REBOUND],
            impulse_n_s=columns[IMPULSE],
            peak_force_n=columns[PEAK_FORCE],
            crank_rad=columns[IMPACT_ANGLE],
        ),
        final=motion_state(end, until_s),
        energy=ledger(end),
        method="adaptive",
        samples=None
        if samples_t_s is None
        else Samples(
            t_s=grid, x_m=samples[:, 0] + origin, v_m_s=samples[:, 1].copy(), crank_rad=samples[:, 2] % TURN
        ),
        peak_felt_force_n=peak_felt_force_n(parts, memory),
        electrical=electrical_ledger(parts, memory),
    )


def run(
    parts: Parts,
    probe: Probe,
    memory: Memory,
    torque_n_m: float,
    start_s: float,
    duration_s: float,
    grid_s: Vector,
    samples: Vector,
) -> Vector:
    """`advance`, its failures raised; returns (and forgets) the impacts so far, shape (impacts, 6)."""
    status = advance(parts, probe, memory, torque_n_m, start_s, duration_s, grid_s, samples)
    if status in (STEP_TOO_SMALL, TOO_COSTLY):
        raise refusal(status, parts, memory, start_s)
    impacts = memory.impacts[: memory.mode[IMPACTS]].copy()
    memory.mode[IMPACTS] = 0
    return impacts


def refusal(status: int, parts: Parts, memory: Memory, start_s: float) -> SolverError:
    """What went wrong where, and what to do."""
    x_m = from_stop_m(parts.wearer, parts.drive, memory.y) + origin_m(parts.stop, parts.striker)
    place = f"at t = {start_s + memory.held[ELAPSED]:.9g} s, x = {x_m:.9g} m, v = {memory.y[1]:.6g} m/s"
    if status == TOO_COSTLY:
        return too_costly(place, _remedy(parts, memory))
    return SolverError(
        f"no step is small enough {place}; raise solver.accuracy, or make the parts less extreme"
    )


def _remedy(parts: Parts, memory: Memory) -> str:
    """The keys that most likely make a run so costly."""
    if memory.mode[PHASE] == CONTACT:
        return (
            "make the stop softer (stop.contact_s, stop.stiffness), start the striker outside it "
            "(initial.x_m, stop.position_m), or raise solver.accuracy"
        )
    if isinstance(parts.friction, Stribeck):
        return "make friction less steep at rest (friction.v_s_m_s), or raise solver.accuracy"
    if is_rigid(parts.stop):
        return "lower stop.restitution if it chatters, or raise solver.accuracy"
    return "raise solver.accuracy, or make the parts less extreme"


_PHASES = tuple(Phase)


def observation(memory: Memory, stored_before_j: float) -> Observation:
    """The module as `memory` has it; the ledger counts from when `stored_before_j` was stored."""
    *values, phase = memory.observed.tolist()
    values[STORED] -= stored_before_j
    return Observation._make((*values, _PHASES[int(phase)]))


def motion_state(now: Observation, t_s: float) -> MotionState:
    """The motion in `now`."""
    return MotionState(t_s, now.x_m, now.v_m_s, now.crank_rad, now.omega_rad_s, now.phase)


def ledger(now: Observation) -> EnergyLedger:
    """The ledger in `now`."""
    return EnergyLedger(
        drive_work_j=now.drive_work_j,
        stored_change_j=now.stored_j,
        friction_j=now.friction_j,
        impact_loss_j=now.impact_loss_j,
        housing_work_j=now.housing_work_j,
        ankle_j=now.ankle_j,
    )


def peak_felt_force_n(parts: Parts, memory: Memory) -> float | None:
    """Largest force on the wearer so far, N; None where nobody wears the module."""
    return float(memory.contact[PEAK_FELT]) if is_worn(parts.wearer) else None


def electrical_ledger(parts: Parts, memory: Memory) -> ElectricalLedger | None:
    """Where the energy at the motor's terminals went so far; None where its windings are not modelled."""
    if not isinstance(parts.winding, DqWinding):
        return None
    terminal, currents = terminal_place(parts), current_place(parts)
    i_d, i_q = memory.y[currents : currents + 2].tolist()
    return ElectricalLedger(
        work_j=float(memory.y[terminal]),
        shaft_j=float(memory.y[work_place(parts)]),
        copper_j=float(memory.y[terminal + 1]),
        magnetic_j=magnetic_energy_j(parts.winding, i_d, i_q),
    )
