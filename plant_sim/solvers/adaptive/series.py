"""A step by a Taylor series, whose coefficients follow from the equations of motion (`plant_sim.jets`).

The length of a step follows from the last two or three coefficients, after Jorba & Zou, Experimental
Mathematics 14, 2005. There is a series if each part has one (`_has_series`) and the supply does not limit a
motor's current within the step. All other steps are steps of DOP853. A step that a call makes short, as
from tick to tick, takes a series of fewer terms if they suffice.
"""

import math
from typing import NamedTuple

from plant_sim.arrays import FloatArray
from plant_sim.jets import ROW, Coefficient
from plant_sim.kernels import subroutine
from plant_sim.parts.drive import Drive, is_motor, motor_torque_n_m
from plant_sim.parts.friction import Friction, damping_n_s_m, friction_has_series, is_stribeck
from plant_sim.parts.housing import expand_housing, is_level
from plant_sim.parts.linkage import is_endless
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import stop_has_series
from plant_sim.parts.striker import has_linear_spring
from plant_sim.parts.winding import is_wound
from plant_sim.result import Phase
from plant_sim.solvers.adaptive.motion import set_rates
from plant_sim.solvers.adaptive.state_layout import Flow, Memory, Run, SeriesRows
from plant_sim.solvers.bernstein import DEGREE, ORDER, from_powers

NEGLIGIBLE_EXPONENT = 40.0
"""e^−40 is below rounding."""

LEAST = 1e-300
"""Keeps the length of a step finite if nothing moves."""

SHORT_RAD = 0.1
"""Longest step for which the terms up to DEGREE are tried first, in radians of the fastest motion: a tenth of
a radian leaves 3e-13 of the motion."""

CLEARLY_WITHIN = 0.5
"""A longest step whose last terms are below this share of the tolerances is taken whole."""


@subroutine(inline=True)
def series_step_s(
    run: Run, flow: Flow, scale: FloatArray, longest_s: float, radian_s: float
) -> tuple[float, int]:
    """Expand the motion into `memory.series`; return the length of a step, s, or 0 if there is no series, and
    the series' order.

    A step that has to be short in comparison with a radian of the fastest motion, `radian_s`, and with the
    decay by viscous friction, is tried with the order DEGREE, which is worth its time only if it covers the
    whole step.
    """
    if not _has_series(run.parts, flow):
        return 0.0, ORDER
    decay_per_s = damping_n_s_m(run.parts.friction) / run.parts.striker.mass_kg
    if longest_s * max(1.0 / radian_s, decay_per_s) <= SHORT_RAD:
        h_s = _step_s(run, flow, scale, longest_s, DEGREE)
        if h_s in (0.0, longest_s):  # with more terms the supply limits the current, too
            return h_s, DEGREE
    return _step_s(run, flow, scale, longest_s, ORDER), ORDER


@subroutine
def _has_series(parts: Parts, flow: Flow) -> bool:
    """Whether each part has a series in this phase; a motor's depends on the step, too."""
    return (
        is_endless(parts.linkage)
        and not is_wound(parts.winding)
        and friction_has_series(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
        and has_linear_spring(parts.striker)
        and (stop_has_series(parts.stop) or not flow.is_pressed)
    )


@subroutine(inline=True)
def _step_s(run: Run, flow: Flow, scale: FloatArray, longest_s: float, order: int) -> float:
    """`series_step_s` with this order."""
    parts, memory = run.parts, run.memory[0]
    series = memory.series
    expand(run, flow, order)
    h_s = _accurate_s(memory, scale, order, _decisive_terms(parts.friction), longest_s)
    if flow.phase in (Phase.FLIGHT, Phase.CONTACT):
        h_s = _resolved_s(parts.friction, series.exponent, h_s, order)
    return h_s if _is_torque_constant(parts.drive, flow, series, h_s, order) else 0.0


class MotionCoefficients(NamedTuple):
    """k-th coefficients of the quantities of `State` that have a series and on which rates depend."""

    depth_m: float
    v_m_s: float
    crank_rad: float
    crank_rad_s: float
    plate_m: float
    plate_m_s: float


@subroutine(inline=True)
def expand(run: Run, flow: Flow, order: int) -> None:
    """Taylor coefficients of the motion from `memory.y` on, into `memory.series`.

    Those of the state follow from those of its rates: y_(k+1) = f_k / (k + 1).
    """
    parts, memory = run.parts, run.memory[0]
    y, rows = memory.y, memory.all_series[:]
    torque_n_m = motor_torque_n_m(parts.drive, flow.torque_n_m, y.crank_rad_s)
    if not is_level(parts.housing):
        expand_housing(parts.housing, flow.time_s, rows[ROW.housing_m_s2, : order + 1], memory.scratch.stack)
    for index in range(memory.progress.used):
        i = memory.places[index]
        rows[i, 0] = memory.all_y[i]
    depth, v = y.depth_m, y.v_m_s  # read from the rows, they would have to be stored first
    for k in range(order):
        motion = MotionCoefficients(
            depth,
            v,
            rows[ROW.crank_rad, k],
            rows[ROW.crank_rad_s, k],
            rows[ROW.plate_m, k],
            rows[ROW.plate_m_s, k],
        )
        depth_rate, acceleration = set_rates(parts, flow, Coefficient(rows, k, torque_n_m), motion)
        per = 1.0 / (k + 1)
        depth, v = per * depth_rate, per * acceleration


@subroutine
def _decisive_terms(friction: Friction) -> int:
    """Number of last terms that determine the length of a step.

    With δ = 2 a striker that sets off under a growing force has every third term only: t², t⁵, t⁸ …
    """
    return 3 if is_stribeck(friction) else 2


@subroutine(inline=True)
def _accurate_s(memory: Memory, scale: FloatArray, order: int, terms: int, longest_s: float) -> float:
    """The length of a step, s, at most `longest_s`, over which the last `terms` are within the tolerances in
    the mean."""
    series, progress = memory.all_series, memory.progress
    per_s, mean, longest_power = LEAST, 0.0, 1.0
    for _ in range(order - terms):
        longest_power *= longest_s
    for k in range(order - terms + 1, order + 1):
        longest_power *= longest_s
        square = 0.0
        for index in range(progress.used):
            i = memory.places[index]
            square += (series[i, k] / scale[i]) ** 2
        before, mean = mean, math.sqrt(square / progress.used)
        # A root takes longest of all here: it is left out where the term before it allows no longer step.
        if not (mean * longest_power <= CLEARLY_WITHIN or mean <= before * per_s):
            per_s = max(per_s, mean ** (1.0 / k))
    return min(longest_s, 1.0 / per_s)


@subroutine
def _resolved_s(friction: Friction, exponent: FloatArray, h_s: float, order: int) -> float:
    """The length of a step, at most `h_s`, over which the last terms show how friction changes.

    While p is large, all terms of e^−p are small; they show a change of p by as much as their order.
    """
    if not is_stribeck(friction):
        return h_s
    most = max(-exponent[0] - NEGLIGIBLE_EXPONENT, float(order))
    while largest_change(exponent, h_s, order) > most:
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
def largest_change(c: FloatArray, h_s: float, order: int) -> float:
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
    for index in range(memory.progress.used):
        i = memory.places[index]
        total = series[i, order]
        for k in range(order - 1, -1, -1):
            total = total * h_s + series[i, k]
        out[i] = total


@subroutine
def motion_within(memory: Memory, h_s: float, order: int, is_all_needed: bool) -> None:
    """Bernstein coefficients of the motion, or of the striker's alone, over a step.

    Into `memory.long_dense`, or for an order of DEGREE into `memory.dense`.
    """
    for index in range(memory.progress.motion if is_all_needed else ROW.v_m_s + 1):
        i = memory.places[index]
        if order == ORDER:
            from_powers(memory.all_series[i], h_s, memory.long_dense[i], order)
        else:
            from_powers(memory.all_series[i], h_s, memory.dense[i], order)
