"""The crank: its angle and speed, its part of the derivative, rest under a dry loss, and breakaway.

J θ'' = T − T_viscous − T_dry − c (x_A + l0 − x) dx_A/dθ. With a motor the crank is part of the integrated
state; with an ideal drive its angle follows from time. A crank with a dry loss can stick; its phases are
independent of the striker's.
"""

import math

from plant_sim.jets import ROW, Coefficient, Jet, State, constant, set_rate, square
from plant_sim.kernels import by_part, subroutine
from plant_sim.parts.drive import Drive, is_motor, motor_torque_n_m
from plant_sim.parts.friction import ROUNDING, set_off
from plant_sim.parts.linkage import crank_torque_n_m, piston_m
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import origin_m
from plant_sim.parts.striker import spring_force_n
from plant_sim.parts.winding import is_wound
from plant_sim.solvers.adaptive.event_location import Found, Segment, earlier, look_within, steepest
from plant_sim.solvers.adaptive.state_layout import Flow, Memory, Run, enter_crank
from plant_sim.solvers.adaptive.wearer import from_stop_m
from plant_sim.solvers.adaptive.winding import turning_torque_n_m
from plant_sim.solvers.bernstein import DEGREE, NO_ROOT, NODES, at, first_beyond, interpolate, root
from plant_sim.solvers.double_double import TURN_LOW_RAD, TURN_RAD
from plant_sim.solvers.event import Event

LOOP_ROUNDING = 1e-9
"""`ROUNDING` of a torque by a current that is integrated."""


@subroutine(inline=True)
def crank_in_stage(drive: Drive, flow: Flow, tau_s: float, y: State) -> tuple[float, float]:
    """The crank's angle and speed `tau_s` after the step's start, where the state is `y`."""
    if is_motor(drive):
        return y.crank_rad, y.crank_rad_s
    return flow.angle_rad + drive.omega_rad_s * tau_s, drive.omega_rad_s


@subroutine
def angle_at(drive: Drive, segment: Segment, s: float) -> float:
    """Crank angle, rad, within a step."""
    if is_motor(drive):
        return at(segment.dense[ROW.crank_rad], s)
    return segment.flow.angle_rad + drive.omega_rad_s * s * segment.h_s


@subroutine(inline=True)
def turn_crank(drive: Drive, memory: Memory, h_s: float) -> None:
    """Update the crank's angle after a step, within [0, 2π)."""
    turned_rad = memory.y.crank_rad if is_motor(drive) else memory.y.crank_rad + drive.omega_rad_s * h_s
    memory.y.crank_rad = within_a_turn(turned_rad)


@subroutine
def within_a_turn(angle_rad: float) -> float:
    """The angle in [0, 2π); many turns cause no drift."""
    turns = math.floor(angle_rad / TURN_RAD)
    if turns == 0:
        return angle_rad
    rest = (angle_rad - turns * TURN_RAD) - turns * TURN_LOW_RAD
    return rest + TURN_RAD if rest < 0.0 else rest  # below 0 by rounding


@subroutine
def coupling_n(parts: Parts, angle_rad: float, place_m: float) -> float:
    """Force, N, of the coupling spring on a striker `place_m` from the stop: c (x_A + l0 − x)."""
    striker = parts.striker
    reach = striker.rest_length_m - origin_m(parts.stop, striker)
    piston = piston_m(parts.linkage, parts.drive.amplitude_m, angle_rad)
    return spring_force_n(striker, piston + reach - place_m)


@subroutine
def crank_load_n_m(parts: Parts, angle_rad: float, place_m: float) -> float:
    """Load torque, N m, of the coupling spring on the crank, with the striker `place_m` from the stop.

    c (x_A + l0 − x) dx_A/dθ.
    """
    spring = coupling_n(parts, angle_rad, place_m)
    return crank_torque_n_m(parts.linkage, spring, parts.drive.amplitude_m, angle_rad)


@by_part
def drive_torque_n_m(jet: Jet, parts: Parts, flow: Flow, y: State) -> float:
    """The motor's torque on the crank, N m."""
    return turning_torque_n_m(parts, flow.torque_n_m, y.crank_rad_s, y)


@drive_torque_n_m.register(Coefficient)
def _drive_torque_n_m(jet: Coefficient, parts: Parts, flow: Flow, y: State) -> float:
    return jet.torque_n_m


@subroutine(inline=True)
def set_crank_rates(parts: Parts, jet: Jet, flow: Flow, load_n_m: float, y: State) -> float:
    """Store the crank's rates and the drive's power, W; return the crank's loss, W."""
    drive = parts.drive
    if not is_motor(drive):
        set_rate(jet, ROW.drive_j, load_n_m * drive.omega_rad_s)
        return 0.0
    if flow.crank_stuck:
        set_rate(jet, ROW.crank_rad, 0.0)
        set_rate(jet, ROW.crank_rad_s, 0.0)
        set_rate(jet, ROW.drive_j, 0.0)
        return 0.0
    speed, torque_n_m = y.crank_rad_s, drive_torque_n_m(jet, parts, flow, y)
    dry_n_m = drive.dry_n_m * flow.crank_direction
    net_n_m = constant(jet, torque_n_m - dry_n_m) - (drive.viscous_n_m_s * speed + load_n_m)
    set_rate(jet, ROW.crank_rad, speed)
    set_rate(jet, ROW.crank_rad_s, net_n_m * (1.0 / drive.inertia_kg_m2))
    set_rate(jet, ROW.drive_j, torque_n_m * speed)
    loss_w: float = drive.viscous_n_m_s * square(jet, ROW.crank_rad_s, speed) + dry_n_m * speed
    return loss_w


@subroutine
def rotor_energy_j(drive: Drive, omega_rad_s: float) -> float:
    """Kinetic energy, J, of the rotor; 0 for an ideal drive, which has no inertia."""
    return 0.5 * drive.inertia_kg_m2 * omega_rad_s * omega_rad_s if is_motor(drive) else 0.0


@subroutine
def crank_net_n_m(parts: Parts, torque_n_m: float, angle_rad: float, y: State) -> float:
    """Torque, N m, on a crank at rest at `angle_rad`, without its dry loss."""
    return turning_torque_n_m(parts, torque_n_m, 0.0, y) - crank_load_n_m(parts, angle_rad, from_stop_m(y))


@subroutine
def crank_limit_n_m(parts: Parts, dry_n_m: float, torque_n_m: float, angle_rad: float, y: State) -> float:
    """Largest net torque, N m, at which the dry loss holds a crank at rest: the loss plus a rounding of the
    net torque, to which the motor adds at most what its drive permits. A current loop approaches its command
    for ever, and rounding of the current may pass the loss."""
    motor = motor_torque_n_m(parts.drive, torque_n_m, 0.0)
    load = crank_load_n_m(parts, angle_rad, from_stop_m(y))
    rounding = LOOP_ROUNDING if is_wound(parts.winding) else ROUNDING
    return dry_n_m + rounding * (abs(motor) + abs(load) + dry_n_m)


@subroutine
def settle_crank(run: Run) -> None:
    """Determine whether a motor's crank at rest stays there under this torque, otherwise its direction."""
    parts, memory = run.parts, run.memory[0]
    drive, y, mode, torque_n_m = parts.drive, memory.y, memory.mode, memory.progress.torque_n_m
    if not is_motor(drive):
        return
    if drive.dry_n_m == 0.0:
        enter_crank(mode, 0, 0, 0)
        return
    if y.crank_rad_s != 0.0:
        enter_crank(mode, 0, 1 if y.crank_rad_s > 0.0 else -1, 0)
        return
    net = crank_net_n_m(parts, torque_n_m, y.crank_rad, y)
    limit = crank_limit_n_m(parts, drive.dry_n_m, torque_n_m, y.crank_rad, y)
    direction = set_off(net, limit, 0.0, 0.0, False)
    enter_crank(mode, 1 if direction == 0 else 0, direction, 1)


@subroutine
def halt_crank(run: Run) -> None:
    """Halt the crank."""
    run.memory[0].y.crank_rad_s = 0.0
    settle_crank(run)


@subroutine
def break_crank_away(run: Run) -> None:
    """Let the crank break away from rest."""
    memory = run.memory[0]
    net = crank_net_n_m(run.parts, memory.progress.torque_n_m, memory.y.crank_rad, memory.y)
    enter_crank(memory.mode, 0, 1 if net > 0.0 else -1, 2)


@subroutine
def dry_loss_n_m(drive: Drive) -> float:
    """Torque, N m, with which a crank's dry loss holds it at rest; 0 if nothing does."""
    return drive.dry_n_m if is_motor(drive) else 0.0


@subroutine
def crank_may_halt(run: Run, segment: Segment) -> bool:
    """Whether the crank may halt or break away in a step; bounds as in `automaton.may_end`."""
    memory, flow = run.memory[0], segment.flow
    if dry_loss_n_m(run.parts.drive) == 0.0:
        return False
    if flow.crank_stuck:
        return True
    twice_mean: float = (memory.y.crank_rad_s + memory.new.crank_rad_s) * flow.crank_direction
    return twice_mean <= segment.h_s * steepest(memory, segment, ROW.crank_rad_s)


@subroutine
def crank_events(run: Run, segment: Segment, found: Found) -> Found:
    """The earlier of `found` and the crank's halt or breakaway."""
    drive, flow, memory = run.parts.drive, segment.flow, run.memory[0]
    if dry_loss_n_m(drive) == 0.0:
        return found
    if not flow.crank_stuck:
        s = root(
            segment.dense[ROW.crank_rad_s], -flow.crank_direction, 0.0, memory.mode.zero_crank, memory.scratch
        )
        return earlier(found, Event.CRANK_HALT, s)
    return earlier(found, Event.CRANK_BREAK, _break_event(run, dry_loss_n_m(drive), segment))


@subroutine
def _break_event(run: Run, dry_n_m: float, segment: Segment) -> float:
    """First s at which the torque on a crank at rest exceeds `crank_limit_n_m`; at the limit the loss holds.

    With an ideal current the net torque at rest is linear in the striker's position: net(0) + slope (place −
    place(0)).
    """
    parts, memory, flow = run.parts, run.memory[0], segment.flow
    y, scratch = memory.y, memory.scratch
    angle_rad = y.crank_rad
    limit = crank_limit_n_m(parts, dry_n_m, flow.torque_n_m, angle_rad, y)
    if is_wound(parts.winding):
        values, net = scratch.poly, scratch.press[: DEGREE + 1]
        for i in range(DEGREE + 1):
            look_within(memory, segment.dense, NODES[i], memory.all_inner)
            values[i] = crank_net_n_m(parts, flow.torque_n_m, angle_rad, memory.inner)
        interpolate(values, net)
        return first_beyond(net, 1.0, 0.0, limit, scratch)
    place = scratch.press[: segment.dense.shape[1]]
    for i in range(place.size):
        place[i] = segment.dense[ROW.depth_m, i] + segment.dense[ROW.plate_m, i]
    slope = crank_load_n_m(parts, angle_rad, 0.0) - crank_load_n_m(parts, angle_rad, 1.0)
    at_stop = motor_torque_n_m(parts.drive, flow.torque_n_m, 0.0) - crank_load_n_m(parts, angle_rad, 0.0)
    return first_beyond(place, slope, at_stop, limit, scratch)


@subroutine
def angle_event(run: Run, up_rad: float, down_rad: float, segment: Segment) -> float:
    """First s at which the crank reaches `up_rad`, above its angle at the start, or `down_rad`, below it."""
    drive = run.parts.drive
    if is_motor(drive):
        angle, scratch = segment.dense[ROW.crank_rad], run.memory[0].scratch
        return min(root(angle, 1.0, -up_rad, 0, scratch), root(angle, -1.0, down_rad, 0, scratch))
    turn, begin_rad = drive.omega_rad_s * segment.h_s, segment.flow.angle_rad
    bound = up_rad - begin_rad if turn > 0.0 else down_rad - begin_rad
    if abs(bound) > abs(turn):
        return NO_ROOT
    return bound / turn
