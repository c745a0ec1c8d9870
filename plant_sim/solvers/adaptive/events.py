"""What ends a phase within a step, located on the step's continuous extension.

Every condition is a polynomial of the step: depth, velocity, crank speed, or an angle at which the spring's
pull on a resting striker grows past what holds it. A quantity that starts at zero is divided by s first, so
that its own zero is no event.
"""

import math
from typing import NamedTuple

from plant_sim.kernels import by_part, law, subroutine
from plant_sim.parts.drive import Drive, IdealDrive, MotorDrive, motor_torque_n_m
from plant_sim.parts.friction import ROUNDING, static_limit_n
from plant_sim.parts.housing import Housing, Level, Moving, Tilted, housing_m_s2
from plant_sim.parts.linkage import sine_at
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import (
    HuntCrossley,
    KelvinVoigt,
    RigidStop,
    Stop,
    elastic_force_n,
    origin_m,
)
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import Ankle, NoWearer, Wearer
from plant_sim.parts.winding import DqWinding, Settled, Winding
from plant_sim.solvers.adaptive.bernstein import (
    DEGREE,
    NO_ROOT,
    NODES,
    evaluate,
    first_rise,
    interpolate,
    without_root_at_start,
)
from plant_sim.solvers.adaptive.currents import stays_within_voltage, voltage_excess
from plant_sim.solvers.adaptive.motion import (
    CONTACT,
    DEPTH,
    FLIGHT,
    REST,
    SPEED,
    STICK,
    VELOCITY,
    Flow,
    Vector,
    closing_m_s,
    crank_limit_n_m,
    crank_load_n_m,
    crank_net_n_m,
    current_place,
    from_stop_m,
    held_force_n,
)

NONE, TOUCH, LEAVE, CLEAR, PRESS, HALT, RELEASE, CRANK_HALT, CRANK_BREAK, LIMIT, UNLIMIT = range(11)
"""Reach the stop; leave it; clear one that let go early, or press into it again; halt; slide; the crank's;
the bus limits a current loop, or no longer does."""

TURN = 2.0 * math.pi

NEAR_RAD = 1e-9
"""A crank this close to where a striker breaks away is there."""


class Zeros(NamedTuple):
    """How many derivatives, the value included, are zero at the step's start."""

    depth: int
    velocity: int
    crank: int
    voltage: int


class Found(NamedTuple):
    """The first event of a step and where in the step it is, 0 to 1."""

    event: int
    s: float


class Scratch(NamedTuple):
    """Arrays that only root finding writes: shapes (DEGREE + 1,) twice, (DEEPEST_HALVING + 2, DEGREE + 3).

    `inner` is the motion within a step, which only windings ask for.
    """

    poly: Vector
    press: Vector
    stack: Vector
    inner: Vector


@subroutine
def root(b: Vector, sign: float, offset: float, zeros: int, scratch: Scratch) -> float:
    """First s at which sign · p(s) + offset, negative at first, reaches 0; `zeros` as in Zeros."""
    poly = scratch.poly
    degree = DEGREE
    for i in range(DEGREE + 1):
        poly[i] = sign * b[i] + offset
    while degree > DEGREE - zeros:
        without_root_at_start(poly, degree)
        degree -= 1
    return first_rise(poly, degree, scratch.stack)


@by_part
def stop_events(
    stop: Stop, parts: Parts, phase: int, zeros: Zeros, dense: Vector, scratch: Scratch, found: Found
) -> Found:
    """The earlier of `found` and the stop's own event."""
    return found


@law(stop_events, RigidStop)
def _(
    stop: RigidStop, parts: Parts, phase: int, zeros: Zeros, dense: Vector, scratch: Scratch, found: Found
) -> Found:
    if phase != FLIGHT:
        return found
    return earlier(found, TOUCH, root(dense[DEPTH], 1.0, 0.0, zeros.depth, scratch))


@law(stop_events, HuntCrossley)
def _(
    stop: HuntCrossley, parts: Parts, phase: int, zeros: Zeros, dense: Vector, scratch: Scratch, found: Found
) -> Found:
    if phase == FLIGHT:
        return earlier(found, TOUCH, root(dense[DEPTH], 1.0, 0.0, zeros.depth, scratch))
    if phase == CONTACT:
        return earlier(found, LEAVE, root(dense[DEPTH], -1.0, 0.0, zeros.depth, scratch))
    return found


@law(stop_events, KelvinVoigt)
def _(
    stop: KelvinVoigt, parts: Parts, phase: int, zeros: Zeros, dense: Vector, scratch: Scratch, found: Found
) -> Found:
    slope_s = stop.damping_n_s_m / stop.stiffness_n_m
    depth, press = dense[DEPTH], scratch.press
    beyond = phase == FLIGHT and depth[0] > 0.0
    if phase == FLIGHT and not beyond:
        return earlier(found, TOUCH, root(depth, 1.0, 0.0, zeros.depth, scratch))
    if phase not in (FLIGHT, CONTACT):
        return found
    if beyond:
        found = earlier(found, CLEAR, root(depth, -1.0, 0.0, 0, scratch))
    for i in range(DEGREE + 1):
        press[i] = depth[i] + slope_s * closing_m_s(parts.wearer, parts.drive, dense[:, i])  # F/K
    if beyond:
        return earlier(found, PRESS, root(press, 1.0, 0.0, zeros.depth, scratch))
    return earlier(found, LEAVE, root(press, -1.0, 0.0, zeros.depth, scratch))


@subroutine
def earlier(found: Found, event: int, s: float) -> Found:
    """`found`, or this event where it comes first."""
    if s < found.s:
        return Found(event, s)
    return found


@by_part
def crank_events(
    drive: Drive,
    parts: Parts,
    flow: Flow,
    y: Vector,
    zeros: Zeros,
    dense: Vector,
    scratch: Scratch,
    found: Found,
) -> Found:
    """The earlier of `found` and the crank's coming to rest, or breaking away from it."""
    return found


@law(crank_events, MotorDrive)
def _(
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    y: Vector,
    zeros: Zeros,
    dense: Vector,
    scratch: Scratch,
    found: Found,
) -> Found:
    if drive.dry_n_m == 0.0:
        return found
    if not flow.crank_stuck:
        return earlier(
            found, CRANK_HALT, root(dense[SPEED], -flow.crank_direction, 0.0, zeros.crank, scratch)
        )
    return earlier(found, CRANK_BREAK, break_event(parts.winding, drive, parts, flow, y, dense, scratch))


@by_part
def break_event(
    winding: Winding,
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    y: Vector,
    dense: Vector,
    scratch: Scratch,
) -> float:
    """First s at which the torque on a resting crank passes `crank_limit_n_m`; the loss holds at it."""
    raise NotImplementedError


@law(break_event, Settled)
def _(
    winding: Settled,
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    y: Vector,
    dense: Vector,
    scratch: Scratch,
) -> float:
    """At rest the net torque is linear in the striker's place: net(0) + slope (place − place(0))."""
    place = _place(parts.wearer, drive, dense, scratch)
    slope = crank_load_n_m(parts, y[2], 0.0) - crank_load_n_m(parts, y[2], 1.0)
    net = motor_torque_n_m(drive, flow.torque_n_m, 0.0) - crank_load_n_m(parts, y[2], 0.0)
    limit = crank_limit_n_m(parts, drive.dry_n_m, flow.torque_n_m, y[2], y)
    upward = root(place, slope, net - limit, 0, scratch)
    return min(upward, root(place, -slope, -net - limit, 0, scratch))


@law(break_event, DqWinding)
def _(
    winding: DqWinding,
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    y: Vector,
    dense: Vector,
    scratch: Scratch,
) -> float:
    values, net = scratch.poly, scratch.press
    for i in range(DEGREE + 1):
        look_within(dense, NODES[i], scratch)
        values[i] = crank_net_n_m(parts, flow.torque_n_m, y[2], scratch.inner)
    interpolate(values, net)
    limit = crank_limit_n_m(parts, drive.dry_n_m, flow.torque_n_m, y[2], y)
    upward = root(net, 1.0, -limit, 0, scratch)
    return min(upward, root(net, -1.0, -limit, 0, scratch))


@subroutine
def look_within(dense: Vector, s: float, scratch: Scratch) -> None:
    """The motion within a step, into `scratch.inner`."""
    for i in range(dense.shape[0]):
        scratch.inner[i] = evaluate(dense[i], DEGREE, s)


@by_part
def voltage_events(
    winding: Winding,
    drive: Drive,
    parts: Parts,
    flow: Flow,
    zeros: Zeros,
    dense: Vector,
    scratch: Scratch,
    found: Found,
) -> Found:
    """The earlier of `found` and the bus's beginning, or ending, to limit the current loop."""
    return found


@law(voltage_events, DqWinding)
def _(
    winding: DqWinding,
    drive: MotorDrive,
    parts: Parts,
    flow: Flow,
    zeros: Zeros,
    dense: Vector,
    scratch: Scratch,
    found: Found,
) -> Found:
    values, excess = scratch.poly, scratch.press
    place = current_place(parts)
    if not flow.voltage_limited and stays_within_voltage(
        winding, drive, flow.torque_n_m, dense, SPEED, place
    ):
        return found
    for i in range(DEGREE + 1):
        look_within(dense, NODES[i], scratch)
        omega = scratch.inner[SPEED]
        values[i] = voltage_excess(winding, drive, flow.torque_n_m, omega, scratch.inner, place)
    interpolate(values, excess)
    if flow.voltage_limited:
        return earlier(found, UNLIMIT, root(excess, -1.0, 0.0, zeros.voltage, scratch))
    return earlier(found, LIMIT, root(excess, 1.0, 0.0, zeros.voltage, scratch))


@by_part
def _place(wearer: Wearer, drive: Drive, dense: Vector, scratch: Scratch) -> Vector:
    """Coefficients of the striker's place from where the scene puts the stop."""
    raise NotImplementedError


@law(_place, NoWearer)
def _(wearer: NoWearer, drive: Drive, dense: Vector, scratch: Scratch) -> Vector:
    depth: Vector = dense[DEPTH]
    return depth


@law(_place, Ankle)
def _(wearer: Ankle, drive: Drive, dense: Vector, scratch: Scratch) -> Vector:
    for i in range(DEGREE + 1):
        scratch.press[i] = from_stop_m(wearer, drive, dense[:, i])
    return scratch.press


@by_part
def angle_event(
    drive: Drive,
    up_rad: float,
    down_rad: float,
    angle_rad: float,
    h_s: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    """First s at which the crank, at `angle_rad` at first, reaches `up_rad` above it or `down_rad` below."""
    raise NotImplementedError


@law(angle_event, IdealDrive)
def _(
    drive: IdealDrive,
    up_rad: float,
    down_rad: float,
    angle_rad: float,
    h_s: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    turn = drive.omega_rad_s * h_s
    bound = up_rad - angle_rad if turn > 0.0 else down_rad - angle_rad
    if abs(bound) > abs(turn):
        return NO_ROOT
    return bound / turn


@law(angle_event, MotorDrive)
def _(
    drive: MotorDrive,
    up_rad: float,
    down_rad: float,
    angle_rad: float,
    h_s: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    return min(root(dense[2], 1.0, -up_rad, 0, scratch), root(dense[2], -1.0, down_rad, 0, scratch))


@subroutine
def release_angles(parts: Parts, phase: int, angle_rad: float, depth_m: float) -> tuple[float, float]:
    """Next crank angles above and below the present one, rad, at which a resting striker breaks away.

    The spring's pull c (x_A + l0 − x) must pass the friction limit outwards (and, on a rigid stop, only
    away from it), by more than its rounding where the piston turns round. Angles within NEAR_RAD are passed
    over: whoever comes to rest there has been dealt with. For a housing that does not move, whatever its
    tilt.
    """
    striker, stop, amplitude = parts.striker, parts.stop, parts.drive.amplitude_m
    if amplitude == 0.0:
        return math.inf, -math.inf
    limit = static_limit_n(parts.friction, striker.mass_kg * striker.gravity_m_s2)
    reach = striker.rest_length_m - origin_m(stop, striker) - depth_m
    held = elastic_force_n(stop, max(depth_m, 0.0)) / striker.spring_n_m - reach
    held += striker.mass_kg * housing_m_s2(parts.housing, 0.0) / striker.spring_n_m
    high = sine_at(parts.linkage, amplitude, held + limit / striker.spring_n_m)
    low = sine_at(parts.linkage, amplitude, held - limit / striker.spring_n_m)
    turning = 1.0 - ROUNDING * (1.0 + (abs(held) + limit / striker.spring_n_m) / amplitude)
    up, down = math.inf, -math.inf
    if phase == STICK and abs(high) < turning:
        rising = math.asin(high)
        up = min(up, _next(rising, angle_rad))
        down = max(down, -_next(rising - math.pi, -angle_rad))
    if abs(low) < turning:
        falling = math.pi - math.asin(low)
        up = min(up, _next(falling, angle_rad))
        down = max(down, -_next(falling - math.pi, -angle_rad))
    return up, down


@subroutine
def _next(angle_rad: float, after_rad: float) -> float:
    """The first of angle + 2π n that is greater than `after_rad`."""
    turns = math.floor((after_rad + NEAR_RAD - angle_rad) / TURN) + 1.0
    return angle_rad + turns * TURN


@by_part
def release_event(
    housing: Housing,
    parts: Parts,
    flow: Flow,
    h_s: float,
    y: Vector,
    angle_rad: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    """First s at which a resting striker breaks away."""
    raise NotImplementedError


@law(release_event, Level, Tilted)
def _(
    housing: Level | Tilted,
    parts: Parts,
    flow: Flow,
    h_s: float,
    y: Vector,
    angle_rad: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    up, down = release_angles(parts, flow.phase, angle_rad, y[0])
    return angle_event(parts.drive, up, down, angle_rad, h_s, dense, scratch)


@law(release_event, Moving, Walking)
def _(
    housing: Moving | Walking,
    parts: Parts,
    flow: Flow,
    h_s: float,
    y: Vector,
    angle_rad: float,
    dense: Vector,
    scratch: Scratch,
) -> float:
    """The pull and the housing's push together, as a polynomial: over a radian good to 1e-9 of them."""
    striker = parts.striker
    values, pull = scratch.poly, scratch.press
    largest = 0.0
    for i in range(DEGREE + 1):
        angle = angle_at(parts.drive, angle_rad, NODES[i], h_s, dense)
        values[i] = held_force_n(parts, angle, y, flow.time_s + NODES[i] * h_s)
        largest = max(largest, abs(values[i]))
    interpolate(values, pull)
    limit = static_limit_n(parts.friction, striker.mass_kg * striker.gravity_m_s2) + ROUNDING * largest
    down = _break(pull, -1.0, limit, scratch)
    return min(down, _break(pull, 1.0, limit, scratch)) if flow.phase == STICK else down


@subroutine
def _break(pull: Vector, sign: float, limit_n: float, scratch: Scratch) -> float:
    """First s at which sign · pull passes the limit; one that is held beyond it has to grow for that."""
    beyond_n = max(sign * pull[0] - limit_n, 0.0)
    return root(pull, sign, -limit_n - beyond_n, 1 if beyond_n > 0.0 else 0, scratch)


@by_part
def angle_at(drive: Drive, angle_rad: float, s: float, h_s: float, dense: Vector) -> float:
    """Crank angle, rad, within a step that began at `angle_rad`."""
    raise NotImplementedError


@law(angle_at, IdealDrive)
def _(drive: IdealDrive, angle_rad: float, s: float, h_s: float, dense: Vector) -> float:
    return angle_rad + drive.omega_rad_s * s * h_s


@law(angle_at, MotorDrive)
def _(drive: MotorDrive, angle_rad: float, s: float, h_s: float, dense: Vector) -> float:
    return evaluate(dense[2], DEGREE, s)


@subroutine
def first_event(
    parts: Parts,
    flow: Flow,
    h_s: float,
    y: Vector,
    zeros: Zeros,
    angle_rad: float,
    dense: Vector,
    scratch: Scratch,
) -> Found:
    """The first event of a step whose continuous extension is `dense`."""
    found = Found(NONE, NO_ROOT)
    limit = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
    found = crank_events(parts.drive, parts, flow, y, zeros, dense, scratch, found)
    found = voltage_events(parts.winding, parts.drive, parts, flow, zeros, dense, scratch, found)
    if flow.phase in (STICK, REST):
        s = release_event(parts.housing, parts, flow, h_s, y, angle_rad, dense, scratch)
        return earlier(found, RELEASE, s)
    if limit > 0.0:
        found = earlier(found, HALT, root(dense[VELOCITY], -flow.direction, 0.0, zeros.velocity, scratch))
    return stop_events(parts.stop, parts, flow.phase, zeros, dense, scratch, found)
