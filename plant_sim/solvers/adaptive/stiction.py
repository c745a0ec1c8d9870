"""A striker at rest: the forces that hold it, its breakaway, and the direction of the motion that follows.

The striker sticks by dry friction, or rests on a rigid stop. The law of friction is in
`plant_sim.parts.friction`.
"""

import math

from plant_sim.arrays import FloatArray
from plant_sim.jets import State
from plant_sim.kernels import subroutine
from plant_sim.parts.friction import ROUNDING, set_off, static_limit_n
from plant_sim.parts.housing import expand_housing, housing_m_s2, is_still
from plant_sim.parts.linkage import crank_torque_n_m, sine_at
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import elastic_force_n, is_rigid, is_soft, origin_m
from plant_sim.parts.striker import spring_force_n, spring_stretch_m
from plant_sim.parts.wearer import is_worn
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.crank import angle_at, angle_event, coupling_n
from plant_sim.solvers.adaptive.event_location import Segment
from plant_sim.solvers.adaptive.state_layout import IN_CONTACT, Run, enter, now_s
from plant_sim.solvers.adaptive.stop import leaving_zeros, open_contact
from plant_sim.solvers.adaptive.wearer import closing_m_s, from_stop_m
from plant_sim.solvers.bernstein import DEGREE, NODES, Scratch, interpolate, root
from plant_sim.solvers.double_double import TURN_RAD

NEAR_RAD = 1e-9
"""A crank within this angle of a breakaway counts as having reached it."""


@subroutine
def dry_limit_n(parts: Parts) -> float:
    """Largest dry friction at rest, N; 0 for a law without sticking."""
    return static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)


@subroutine
def force_at_rest_n(parts: Parts, angle_rad: float, y: State, time_s: float) -> float:
    """Force, N, on a striker at rest, with the crank at this angle; without dry friction and a rigid stop."""
    spring = coupling_n(parts, angle_rad, from_stop_m(y))
    inertia = parts.striker.mass_kg * housing_m_s2(parts.housing, time_s)
    return spring - elastic_force_n(parts.stop, max(y.depth_m, 0.0)) - inertia


@subroutine
def limit_at_rest_n(parts: Parts, y: State, time_s: float) -> float:
    """Largest `force_at_rest_n` on a striker that stays at rest: friction's limit and a rounding."""
    striker, stop = parts.striker, parts.stop
    limit = dry_limit_n(parts)
    reach = abs(striker.rest_length_m - origin_m(stop, striker))
    reach += abs(from_stop_m(y))
    spring = spring_force_n(striker, parts.drive.amplitude_m + reach)
    inertia = striker.mass_kg * abs(housing_m_s2(parts.housing, time_s))
    return limit + ROUNDING * (spring + elastic_force_n(stop, max(y.depth_m, 0.0)) + inertia + limit)


@subroutine
def _release_angles(parts: Parts, phase: int, angle_rad: float, depth_m: float) -> tuple[float, float]:
    """Next crank angles above and below the present one, rad, at which a resting striker breaks away.

    The spring's pull c (x_A + l0 − x) must pass the friction limit outwards (and, on a rigid stop, only
    away from it), by more than its rounding where the piston turns round. Angles within NEAR_RAD are left
    out: their breakaway has already been treated. The housing may be tilted but does not move.
    """
    striker, stop, amplitude = parts.striker, parts.stop, parts.drive.amplitude_m
    if amplitude == 0.0:
        return math.inf, -math.inf
    limit = dry_limit_n(parts)
    reach = striker.rest_length_m - origin_m(stop, striker) - depth_m
    load_n = elastic_force_n(stop, max(depth_m, 0.0)) + striker.mass_kg * housing_m_s2(parts.housing, 0.0)
    high = sine_at(parts.linkage, amplitude, spring_stretch_m(striker, load_n + limit) - reach)
    low = sine_at(parts.linkage, amplitude, spring_stretch_m(striker, load_n - limit) - reach)
    summed_m = abs(reach) + abs(spring_stretch_m(striker, load_n)) + spring_stretch_m(striker, limit)
    turning = 1.0 - ROUNDING * (1.0 + summed_m / amplitude)
    up, down = math.inf, -math.inf
    if phase == Phase.STICK and abs(high) < turning:
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
    turns = math.floor((after_rad + NEAR_RAD - angle_rad) / TURN_RAD) + 1.0
    return angle_rad + turns * TURN_RAD


@subroutine
def release_event(run: Run, segment: Segment) -> float:
    """First s at which a resting striker breaks away.

    In a housing that moves, the sum of spring and housing force is approximated by a polynomial, to 1e-9 over
    a radian.
    """
    parts, memory, flow, h_s = run.parts, run.memory[0], segment.flow, segment.h_s
    y, scratch = memory.y, memory.scratch
    if is_still(parts.housing):
        up, down = _release_angles(parts, flow.phase, flow.angle_rad, y.depth_m)
        return angle_event(run, up, down, segment)
    values, pull = scratch.poly, scratch.press[: DEGREE + 1]
    largest = 0.0
    for i in range(DEGREE + 1):
        angle = angle_at(parts.drive, segment, NODES[i])
        values[i] = force_at_rest_n(parts, angle, y, flow.time_s + NODES[i] * h_s)
        largest = max(largest, abs(values[i]))
    interpolate(values, pull)
    limit = dry_limit_n(parts) + ROUNDING * largest
    down = _break(pull, -1.0, limit, scratch)
    return min(down, _break(pull, 1.0, limit, scratch)) if flow.phase == Phase.STICK else down


@subroutine
def _break(pull: FloatArray, sign: float, limit_n: float, scratch: Scratch) -> float:
    """First s at which sign · pull exceeds the limit; a pull that starts beyond the limit must grow
    further."""
    beyond_n = max(sign * pull[0] - limit_n, 0.0)
    return root(pull, sign, -limit_n - beyond_n, 1 if beyond_n > 0.0 else 0, scratch)


@subroutine
def from_rest(run: Run) -> None:
    """Set the phase of a striker at v = 0: stick, rest on a rigid stop, or motion in the direction of the
    force."""
    parts, memory = run.parts, run.memory[0]
    y, mode, time_s = memory.y, memory.mode, now_s(memory)
    net = force_at_rest_n(parts, y.crank_rad, y, time_s)
    is_beside = is_worn(parts.wearer) and y.depth_m == 0.0 and closing_m_s(y) == 0.0
    if is_beside:  # at a plate at rest, which the housing moves along as it does the striker
        net += parts.striker.mass_kg * housing_m_s2(parts.housing, time_s)
    dry = dry_limit_n(parts)
    rounding = limit_at_rest_n(parts, y, time_s) - dry
    rate, margin = (0.0, 0.0) if is_beside else _pull_rate(run)
    margin = max(margin, rounding) if rate != 0.0 else rounding
    is_on_stop = is_rigid(parts.stop) and y.depth_m == 0.0
    direction = set_off(net, dry, margin, rate, is_on_stop)
    if direction == 0 and (is_on_stop or dry > 0.0):
        enter(mode, Phase.REST_ON_STOP if is_on_stop else Phase.STICK, 0, 0, 0)
        return
    forward = direction > 0
    if direction == 0:  # free, and without a pull
        forward = rate > 0.0 or (rate == 0.0 and net >= 0.0)
    _slide(run, forward, 1 if abs(net) > dry + margin else 2)


@subroutine
def _pull_rate(run: Run) -> tuple[float, float]:
    """Time derivative of the pull on a striker at rest, N/s, and the change of the pull within twice
    NEAR_RAD, N.

    Within that distance of the limit the derivative decides, so that no release is missed. At the piston's
    dead centres the derivative vanishes, and no breakaway begins.
    """
    parts, memory = run.parts, run.memory[0]
    y, striker = memory.y, parts.striker
    stands = is_still(parts.housing)
    if stands and abs(math.cos(y.crank_rad)) < 1e-4:
        return 0.0, 0.0
    per_rad = crank_torque_n_m(parts.linkage, striker.spring_n_per_m, parts.drive.amplitude_m, y.crank_rad)
    if stands:
        return per_rad * y.crank_rad_s, abs(per_rad) * 2.0 * NEAR_RAD
    series = memory.scratch.poly[:2]
    expand_housing(parts.housing, now_s(memory), series, memory.scratch.stack)
    shaken = striker.mass_kg * series[1]
    natural = math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    rate = per_rad * y.crank_rad_s - shaken
    return rate, (abs(per_rad) + abs(shaken) / natural) * 2.0 * NEAR_RAD


@subroutine
def release(run: Run) -> None:
    """Release a striker whose pull has just reached its limit: it sets off with zero acceleration."""
    memory = run.memory[0]
    net = force_at_rest_n(run.parts, memory.y.crank_rad, memory.y, now_s(memory))
    forward = net > 0.0 and memory.mode.phase == Phase.STICK
    _slide(run, forward, 2)


@subroutine
def _slide(run: Run, forward: bool, zeros: int) -> None:
    """Slide from v = 0; the first `zeros` derivatives, v included, are zero."""
    parts, memory = run.parts, run.memory[0]
    y, mode = memory.y, memory.mode
    direction = 1 if forward else -1
    if mode.in_impact == IN_CONTACT:
        enter(mode, Phase.CONTACT, direction, mode.zero_depth, zeros)
        return
    sets_off_surface = y.depth_m == 0.0 and not forward
    enter(mode, Phase.FLIGHT, direction, zeros + 1 if sets_off_surface else mode.zero_depth, zeros)
    if is_soft(parts.stop) and y.depth_m == 0.0 and forward:
        open_contact(run, zeros + leaving_zeros(parts.stop))
