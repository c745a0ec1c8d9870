"""Flights of a striker between contacts, simulated with a friction law, and their derivatives.

Dry friction holds a striker that stops where the spring's force is the smaller one: in a slow motion it
sticks twice in each turn of the crank.
"""

from typing import NamedTuple

import numpy as np

from firmware_py.core.estimation.kalman import Transition
from plant_sim.arrays import FloatArray, IntArray
from plant_sim.kernels import jit
from tools.tuning.identification.friction_laws import (
    DAMPING,
    DRY,
    KAPPA,
    OFFSET,
    RADIUS,
    RISE,
    V0,
    V_S,
    X0,
    B,
    Striker,
)


class FlightReadings(NamedTuple):
    """Flights one after another: first rows and number of rows, period in s, accelerometer in m/s², sine and
    cosine of the crank, and the piston's position in m.
    """

    starts: IntArray
    period_s: float
    z: FloatArray
    crank: FloatArray
    cosine: FloatArray
    piston_m: FloatArray


class Flown(NamedTuple):
    """Simulated flights, a row a sample: x − l0 and v, the residual, its negative derivatives."""

    motion: FloatArray
    left: FloatArray
    rows: FloatArray


class Tick(NamedTuple):
    """A striker after a tick: x − l0 and v, the means of the signs of f and h, the share in which it moves.

    The share is below 1 if the striker stops and dry friction holds it.
    """

    x_m: float
    v_m_s: float
    mean_sign: float
    mean_rise: float
    moves: float


@jit
def pass_tick(
    x: float,
    v: float,
    about_m: float,
    sign: float,
    rise: float,
    step: Transition,
    striker: Striker,
    period_s: float,
) -> Tick:
    """Pass a tick with the piston at `about_m`; `sign` and `rise` are the signs of f and h at its begin."""
    k, _, _, _, f, h, v_s, delta, _ = striker
    rest = about_m - (f * sign + h * rise) / k
    guess = step.v_x * (x - rest) + step.v_v * v
    share = v / (v - guess) if guess * v < 0.0 else 1.0
    turn_m = x + 0.5 * v * share * period_s
    if share < 1.0 and abs(k * (turn_m - about_m)) <= f + h:
        return Tick(turn_m, 0.0, 0.0, 0.0, share)
    mean_sign, mean_rise = sign * (2.0 * share - 1.0), 0.0
    if h != 0.0:  # by the trapezoidal rule; at v = 0 the rise is 1
        after = np.exp(-((abs(guess) / v_s) ** delta))
        turned = share * (sign + rise) - (1.0 - share) * (sign + sign * after)
        mean_rise = 0.5 * (turned if share < 1.0 else rise + sign * after)
    rest = about_m - (f * mean_sign + h * mean_rise) / k
    way = x - rest
    return Tick(
        step.x_x * way + step.x_v * v + rest, step.v_x * way + step.v_v * v, mean_sign, mean_rise, 1.0
    )


@jit
def fly(
    readings: FlightReadings,
    step: Transition,
    striker: Striker,
    states: FloatArray,
    wanted: IntArray,
    flown: Flown,
) -> None:
    """Simulate flights tick by tick, with the crank's mean over each tick; fills `flown`.

    `step` is the transition of the free oscillator over a tick about the equilibrium of spring, crank and dry
    friction. If v changes its sign within a tick, dry friction acts with its mean over the tick, or holds the
    striker until the spring's force exceeds it. If u is the derivative of the acceleration by a parameter,
    the derivative ξ of the motion follows from ξ'' + d ξ' + κ ξ = u, from rest; ξ' jumps by a₊/a₋ where v
    changes its sign (saltation), and to 0 where the striker stops.
    """
    k, _, offset, d, f, h, v_s, delta, _ = striker
    xx, xv, vx, vv, columns = step.x_x, step.x_v, step.v_x, step.v_v, len(wanted)
    now, over = np.zeros(V0 + 1), np.zeros(V0 + 1)
    for flight in range(len(readings.starts) - 1):
        begin, end = readings.starts[flight], readings.starts[flight + 1]
        x, v = states[flight, 0], states[flight, 1]
        way, speed, before = np.zeros(columns), np.zeros(columns), np.zeros(columns)
        for c in range(columns):
            way[c], speed[c] = 1.0 if wanted[c] == X0 else 0.0, 1.0 if wanted[c] == V0 else 0.0
        mean_sign, mean_rise, jump, rests = 0.0, 0.0, 1.0, False
        for row in range(begin, end):
            spring = x - readings.piston_m[row]
            flown.motion[row, 0], flown.motion[row, 1] = x, v
            if v == 0.0 and abs(k * spring) <= f + h:  # dry friction holds it
                flown.left[row], rests = readings.z[row] - offset, True
                for c in range(columns):
                    speed[c], flown.rows[row, c] = 0.0, 1.0 if wanted[c] == OFFSET else 0.0
                continue
            sign, power, rise, by_speed = np.sign(v if v != 0.0 else -spring), 0.0, 0.0, 0.0
            if h != 0.0:
                power = (abs(v) / v_s) ** delta
                rise = sign * np.exp(-power)
                by_speed = -h * delta * power / v * rise if v != 0.0 else 0.0
            flown.left[row] = readings.z[row] - (offset - k * spring - d * v - f * sign - h * rise)
            now[RADIUS], now[B] = k * readings.crank[row], k * readings.cosine[row]
            now[KAPPA], now[DAMPING] = -spring, -v
            now[DRY], now[RISE], now[V_S] = -sign, -rise, -h * rise * delta * power / v_s
            over[:] = now
            over[DRY], over[RISE] = -mean_sign, -mean_rise
            for c in range(columns):
                name = wanted[c]
                if row > begin and not rests:  # from the row before to this one
                    middle = over[name] if name in (DRY, RISE) else 0.5 * (before[c] + now[name])
                    middle -= by_speed * speed[c]
                    at, rate = way[c] - middle / k, speed[c]
                    way[c] = xx * at + xv * rate + middle / k
                    speed[c] = (vx * at + vv * rate) * jump
                before[c] = now[name]
                flown.rows[row, c] = now[name] - k * way[c] - (d + by_speed) * speed[c]
                if name == OFFSET:
                    flown.rows[row, c] = 1.0
            rests = False
            if row + 1 == end:
                break
            about_m = 0.5 * (readings.piston_m[row] + readings.piston_m[row + 1])
            x, v, mean_sign, mean_rise, moves = pass_tick(
                x, v, about_m, sign, rise, step, striker, readings.period_s
            )
            rests = moves < 1.0
            if rests:
                way += moves * readings.period_s * speed
                speed[:] = 0.0
            jump = 1.0
            if np.sign(v) * sign < 0.0:
                slowing = -k * spring - (f + h) * sign
                jump = max((-k * spring + (f + h) * sign) / slowing, 0.0) if slowing != 0.0 else 0.0
