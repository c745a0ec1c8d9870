"""A step by a Taylor series, whose coefficients follow by recurrence from the parts' own equations.

A law that is linear but for a constant holds for the coefficients as for the values, with the constant in the
first one.

The length of a step follows from the last two or three coefficients, after Jorba & Zou, Experimental
Mathematics 14, 2005. There are recurrences for an endless rod, a housing that no leg carries, a stop on it
that is rigid, a linear spring or not in touch, and a motor's ideal current below the limit of its supply. All
other steps are steps of DOP853. With sensors, whose readings leave no time for a longer step, the series has
fewer terms, and a step that needs more of them is one of DOP853.
"""

import math

import numpy as np

from plant_sim.kernels import one_of, subroutine
from plant_sim.parts.drive import Drive, is_motor, motor_torque_n_m
from plant_sim.parts.friction import (
    Coulomb,
    Friction,
    NoFriction,
    Viscous,
    friction_force_n,
    is_stribeck,
    static_limit_n,
)
from plant_sim.parts.housing import Level, Moving, Tilted, expand_housing, is_level
from plant_sim.parts.linkage import is_endless
from plant_sim.parts.stop import (
    KelvinVoigt,
    NoStop,
    RigidStop,
    Stop,
    elastic_force_n,
    is_soft,
    origin_m,
    stop_force_n,
)
from plant_sim.parts.striker import has_linear_spring, spring_force_n
from plant_sim.parts.wearer import is_worn
from plant_sim.parts.winding import is_wound
from plant_sim.result import Phase
from plant_sim.sensors.sensing import is_sensing
from plant_sim.solvers.adaptive.crank import crank_in_stage
from plant_sim.solvers.adaptive.state_layout import Flow, Memory, Run, SeriesRows, Vector, Y
from plant_sim.solvers.adaptive.stop import in_touch
from plant_sim.solvers.bernstein import DEGREE, ORDER, from_powers

UNSEEN = 40.0
"""e^−40 is below rounding."""

LEAST = 1e-300
"""Keeps the length of a step finite if nothing moves."""

CLEARLY_WITHIN = 0.5
"""A longest step whose last terms are below this share of the tolerances is taken whole."""

_is_regular = one_of(Level, Tilted, Moving)
_is_linear = one_of(NoStop, RigidStop, KelvinVoigt)
_is_linear_but_for_a_constant = one_of(NoFriction, Viscous, Coulomb)


@subroutine(inline=True)
def series_step_s(run: Run, flow: Flow, scale: Vector, longest_s: float) -> float:
    """Expand the motion into `memory.series`; return the length of a step, s, or 0 if there is no series.

    A series as short as the sensors need is worth its time only if it covers the whole step.
    """
    if not is_sensing(run.probe):
        return _step_s(run, flow, scale, longest_s, ORDER)
    h_s = _step_s(run, flow, scale, longest_s, DEGREE)
    return h_s if h_s == longest_s else 0.0


@subroutine(inline=True)
def _step_s(run: Run, flow: Flow, scale: Vector, longest_s: float, order: int) -> float:
    parts, memory = run.parts, run.memory[0]
    if not (
        is_endless(parts.linkage)
        and _is_regular(parts.housing)
        and not is_worn(parts.wearer)
        and not is_wound(parts.winding)
        and _has_recurrence(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
        and has_linear_spring(parts.striker)
    ):
        return 0.0
    if in_touch(flow.phase, memory.y.depth_m) and not _is_linear(parts.stop):
        return 0.0
    series = memory.series
    expand(run, flow, order)
    h_s = _accurate_s(memory, scale, order, _judged_terms(parts.friction), longest_s)
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        h_s = _seen_s(parts.friction, series.power, h_s, order)
    if not _is_torque_constant(parts.drive, flow, series, h_s, order):
        return 0.0
    return h_s


@subroutine
def _has_recurrence(friction: Friction, normal_n: float) -> bool:
    """Stribeck's e^−p has one where the striker halts before it slides the other way, with p < 0."""
    if is_stribeck(friction):
        return friction.delta in (1.0, 2.0) and static_limit_n(friction, normal_n) > 0.0
    return _is_linear_but_for_a_constant(friction)


@subroutine(inline=True)
def expand(run: Run, flow: Flow, order: int) -> None:
    """Taylor coefficients of the motion from `memory.y` on, into `memory.series`."""
    parts, memory = run.parts, run.memory[0]
    y, series, rows, striker = memory.y, memory.series, memory.all_series, parts.striker
    spring, drag, housing_m_s2 = series.spring_n, series.drag_n, series.housing_m_s2
    crank = crank_in_stage(parts.drive, flow, 0.0, y)
    torque_n_m = motor_torque_n_m(parts.drive, flow.torque_n_m, crank.speed_rad_s)
    reach_m = striker.rest_length_m - origin_m(parts.stop, striker)
    normal_n = striker.mass_kg * striker.gravity_m_s2
    slides = flow.phase in (Phase.FLIGHT, Phase.CONTACT)
    is_pressed = is_soft(parts.stop) and in_touch(flow.phase, y.depth_m)
    for place in range(memory.held.used):
        i = memory.places[place]
        rows[i, 0] = memory.all_y[i]
    if not is_level(parts.housing):
        expand_housing(parts.housing, flow.time_s, housing_m_s2[: order + 1])
    series.sine[0], series.cosine[0] = math.sin(crank.angle_rad), math.cos(crank.angle_rad)
    depth_k, velocity_k = y.depth_m, y.v_m_s
    for k in range(order):
        per = 1.0 / (k + 1)
        for place in range(memory.held.motion + 2, memory.held.used):
            rows[memory.places[place], k + 1] = 0.0
        spring[k] = spring_force_n(
            striker, parts.drive.amplitude_m * series.sine[k] + _at_start(reach_m, k) - depth_k
        )
        lost_w = _turn(parts.drive, flow, torque_n_m, k, per, series)
        square = _square(series.v_m_s, k)
        push_n = 0.0
        if is_pressed:
            push_n = _press(parts.stop, flow.damping_s_m, square, k, per, series)
        if slides:
            drag[k] = _drag(parts.friction, normal_n, flow.direction, k, series)
            lost_w -= _drag_power_w(parts.friction, normal_n, flow.direction, square, k, series)
            force_n = spring[k] - push_n + drag[k]
            if not is_level(parts.housing):
                force_n -= striker.mass_kg * housing_m_s2[k]
            depth_k, velocity_k = per * velocity_k, per * (1.0 / striker.mass_kg) * force_n
        else:
            depth_k = velocity_k = 0.0
        series.depth_m[k + 1], series.v_m_s[k + 1] = depth_k, velocity_k
        series.friction_j[k + 1] = per * lost_w
        if not is_level(parts.housing):
            power = -_product(housing_m_s2, series.v_m_s, k)
            series.housing_j[k + 1] = per * striker.mass_kg * power


@subroutine(inline=True)
def _at_start(value: float, k: int) -> float:
    """Coefficient k of a constant."""
    return value if k == 0 else 0.0


@subroutine(inline=True)
def _product(a: Vector, b: Vector, k: int) -> float:
    """Coefficient k of a product.

    The newest coefficients come last: a processor adds up the others while it still computes those. An
    unsigned index spares it the look for negative ones.
    """
    if k == 0:
        return float(a[0] * b[0])
    total = 0.0
    for j in range(1, k):
        total += a[j] * b[np.uint64(k - j)]
    return float(total + a[0] * b[k] + a[k] * b[0])


@subroutine(inline=True)
def _square(c: Vector, k: int) -> float:
    """Coefficient k of a square: as `_product`, where each term but the middle one stands twice."""
    if k == 0:
        return float(c[0] * c[0])
    total = 0.0
    for j in range(1, (k + 1) // 2):
        total += c[j] * c[np.uint64(k - j)]
    middle = c[k // 2] if k % 2 == 0 else 0.0
    return float(2.0 * (total + c[0] * c[k]) + middle * middle)


@subroutine(inline=True)
def _turn(drive: Drive, flow: Flow, torque_n_m: float, k: int, per: float, series: SeriesRows) -> float:
    """Coefficients k + 1 of crank and drive's work; return coefficient k of the crank's loss, W."""
    sine, cosine, spring, speed = series.sine, series.cosine, series.spring_n, series.crank_rad_s
    if not is_motor(drive):
        turn = per * drive.omega_rad_s
        sine[k + 1], cosine[k + 1] = turn * cosine[k], -turn * sine[k]
        series.drive_j[k + 1] = turn * drive.amplitude_m * _product(spring, cosine, k)
        return 0.0
    load_n = sine_rate = cosine_rate = 0.0
    for j in range(k + 1):  # three products in one loop
        back = np.uint64(k - j)
        load_n += spring[j] * cosine[back]
        sine_rate += speed[j] * cosine[back]
        cosine_rate -= speed[j] * sine[back]
    sine[k + 1], cosine[k + 1] = per * sine_rate, per * cosine_rate
    if flow.crank_stuck:
        series.crank_rad[k + 1] = speed[k + 1] = series.drive_j[k + 1] = 0.0
        return 0.0
    dry_n_m = drive.dry_n_m * flow.crank_direction
    held_n_m = drive.viscous_n_m_s * speed[k] + drive.amplitude_m * load_n
    net_n_m = _at_start(torque_n_m - dry_n_m, k) - held_n_m
    series.crank_rad[k + 1] = per * speed[k]
    speed[k + 1] = per * (1.0 / drive.inertia_kg_m2) * net_n_m
    series.drive_j[k + 1] = per * torque_n_m * speed[k]
    lost_w: float = drive.viscous_n_m_s * _square(speed, k) + dry_n_m * speed[k]
    return lost_w


@subroutine(inline=True)
def _press(stop: Stop, damping_s_m: float, square: float, k: int, per: float, series: SeriesRows) -> float:
    """Coefficients k + 1 of a linear stop's loss and impulse, from that of the velocity's square; return
    coefficient k of its force, N."""
    elastic_n = elastic_force_n(stop, series.depth_m[k])
    push_n = stop_force_n(stop, elastic_n, series.v_m_s[k], damping_s_m)
    series.stop_j[k + 1] = per * stop_force_n(stop, 0.0, square, damping_s_m)
    series.impulse_n_s[k + 1] = per * push_n
    return push_n


@subroutine(inline=True)
def _drag(friction: Friction, normal_n: float, direction: float, k: int, series: SeriesRows) -> float:
    """Coefficient k of the friction force, N, of a striker sliding in `direction`, ±1."""
    velocity, power, fall = series.v_m_s, series.power, series.fall
    if not is_stribeck(friction):
        return friction_force_n(friction, _at_start(normal_n, k), velocity[k], direction)
    per_speed = direction / friction.v_s_m_s
    power[k] = per_speed * velocity[k]
    if friction.delta == 2.0:
        power[k] = per_speed * per_speed * _square(velocity, k)
    if k == 0:
        fall[k] = math.exp(-power[k])
    else:  # f = e^−p: f' = −p' f
        total = 0.0
        for j in range(1, k + 1):
            total -= j * power[j] * fall[np.uint64(k - j)]
        fall[k] = total / k
    weight_n = normal_n * direction
    falling_n: float = (friction.mu_s - friction.mu) * weight_n * fall[k]
    force_n: float = -_at_start(friction.mu * weight_n, k) - falling_n - friction.b_n_s_m * velocity[k]
    return force_n


@subroutine(inline=True)
def _drag_power_w(
    friction: Friction, normal_n: float, direction: float, square: float, k: int, series: SeriesRows
) -> float:
    """Coefficient k of the friction force times the velocity, W, from that of the velocity's square."""
    if not is_stribeck(friction):
        return friction_force_n(friction, normal_n * series.v_m_s[k], square, direction)
    return _product(series.drag_n, series.v_m_s, k)


@subroutine
def _judged_terms(friction: Friction) -> int:
    """Number of last terms that determine the length of a step.

    With δ = 2 a striker that sets off under a growing force has every third term only: t², t⁵, t⁸ …
    """
    return 3 if is_stribeck(friction) else 2


@subroutine(inline=True)
def _accurate_s(memory: Memory, scale: Vector, order: int, terms: int, longest_s: float) -> float:
    """The length of a step, s, at most `longest_s`, over which the last `terms` are within the tolerances in
    the mean."""
    series, held = memory.all_series, memory.held
    per_s, mean, longest_power = LEAST, 0.0, 1.0
    for _ in range(order - terms):
        longest_power *= longest_s
    for k in range(order - terms + 1, order + 1):
        longest_power *= longest_s
        square = 0.0
        for place in range(held.used):
            i = memory.places[place]
            square += (series[i, k] / scale[i]) ** 2
        before, mean = mean, math.sqrt(square / held.used)
        # A root takes longest of all here: it is left out where the term before it allows no longer step.
        if not (mean * longest_power <= CLEARLY_WITHIN or mean <= before * per_s):
            per_s = max(per_s, mean ** (1.0 / k))
    return min(longest_s, 1.0 / per_s)


@subroutine
def _seen_s(friction: Friction, power: Vector, h_s: float, order: int) -> float:
    """The length of a step, at most `h_s`, over which the last terms show how friction changes.

    While p is large, all terms of e^−p are small; they show a fall of p by as much as their order.
    """
    if not is_stribeck(friction):
        return h_s
    most = max(power[0] - UNSEEN, float(order))
    while largest_change(power, h_s, order) > most:
        h_s *= 0.5
    return h_s


@subroutine
def _is_torque_constant(drive: Drive, flow: Flow, series: SeriesRows, h_s: float, order: int) -> bool:
    """Whether the supply does not limit the current at any speed within the step; torque falls with speed."""
    if not is_motor(drive):
        return True
    speed = series.crank_rad_s
    change = largest_change(speed, h_s, order)
    fastest = motor_torque_n_m(drive, flow.torque_n_m, speed[0] + change)
    slowest = motor_torque_n_m(drive, flow.torque_n_m, speed[0] - change)
    return fastest == slowest


@subroutine
def largest_change(c: Vector, h_s: float, order: int) -> float:
    """A bound of a series' change within a step: Σ |c_k| hᵏ from k = 1 on."""
    total, power = 0.0, 1.0
    for k in range(1, order + 1):
        power *= h_s
        total += abs(c[k]) * power
    return total


@subroutine(inline=True)
def state_after(memory: Memory, h_s: float, order: int) -> None:
    """The state after `h_s` of the series, into `memory.new`."""
    series, out = memory.all_series, memory.all_new
    for place in range(memory.held.used):
        i = memory.places[place]
        total = series[i, order]
        for k in range(order - 1, -1, -1):
            total = total * h_s + series[i, k]
        out[i] = total


@subroutine
def motion_within(memory: Memory, h_s: float, order: int, is_crank_needed: bool) -> None:
    """Bernstein coefficients of the motion, or of the striker's alone, over a step.

    Into `memory.long_dense`, or for an order of DEGREE into `memory.dense`.
    """
    for place in range(memory.held.motion if is_crank_needed else Y.v_m_s + 1):
        i = memory.places[place]
        if order == ORDER:
            from_powers(memory.all_series[i], h_s, memory.long_dense[i], order)
        else:
            from_powers(memory.all_series[i], h_s, memory.dense[i], order)
