"""Arithmetic of laws that hold for values and for Taylor coefficients alike, and the quantities they concern.

A law is a text of floats. With the jet `Value` they are values; with `Coefficient` they are the k-th Taylor
coefficients, in ascending order of k. Sums and multiples by constants are written plainly, because they hold
for each coefficient as for the values. All else is a function of this file, which takes the jet first.
A product of coefficients depends on all earlier ones of its factors: the function keeps each factor in a row
of the series, whose place the law names from `ROW`.
"""

import math
from collections import namedtuple
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import by_part, subroutine


class State:
    """The integrated quantities; those of missing parts are 0. Depth is x − x_stop − p, so that it keeps its
    digits at the stop. The crank's angle and speed are integrated with a motor only.
    """

    depth_m: float
    v_m_s: float
    crank_rad: float
    crank_rad_s: float
    plate_m: float
    plate_m_s: float
    i_d_a: float
    i_q_a: float
    u_d_v: float
    u_q_v: float
    # The accounts, which feed back into nothing.
    drive_j: float
    friction_j: float
    stop_j: float
    impulse_n_s: float
    housing_j: float
    ankle_j: float
    terminal_j: float
    copper_j: float


class Factors:
    """Rows of a Taylor series behind those of the state: factors of products, and functions of them.

    Each function of this file has rows of its own, so that none overwrites another's.
    """

    sine: float
    cosine: float
    spring_n: float
    lever_m: float
    drag_n: float
    exponent: float
    power_of_e: float
    damping_n: float
    closing_m_s: float
    housing_m_s2: float
    momentum_n_s: float


_NAMES = [*State.__annotations__, *Factors.__annotations__]
ROW: Any = namedtuple("ROW", _NAMES)(*range(len(_NAMES)))
"""Places of the quantities of `State` and of `Factors` in arrays of them."""


class Value(NamedTuple):
    """Values, `tau_s` after a step's start; rates go into `rates`, shape (state,)."""

    tau_s: float
    rates: FloatArray


class Coefficient(NamedTuple):
    """k-th Taylor coefficients at a step's start; `rows` of shape (rows, order + 1) keeps the earlier ones.

    `torque_n_m` is a motor's torque, which is constant within a series.
    """

    rows: FloatArray
    k: int
    torque_n_m: float


Jet: TypeAlias = Value | Coefficient

NOW = Value(0.0, np.empty(0))
"""Values alone."""


@by_part
def constant(jet: Jet, value: float) -> float:
    """A number that is constant within a step."""
    return value


@constant.register(Coefficient)
def _constant(jet: Coefficient, value: float) -> float:
    return value if jet.k == 0 else 0.0


@by_part
def set_rate(jet: Any, row: int, rate: float) -> None:
    """Store the time derivative of a quantity of `State`."""
    jet.rates[row] = rate


@set_rate.register(Coefficient)
def _set_rate(jet: Coefficient, row: int, rate: float) -> None:
    """The quantity's next coefficient: y_(k+1) = f_k / (k + 1)."""
    jet.rows[row, jet.k + 1] = 1.0 / (jet.k + 1) * rate


@by_part
def product(jet: Jet, a_row: int, a: float, b_row: int, b: float) -> float:
    """a b."""
    return a * b


@product.register(Coefficient)
def _product(jet: Coefficient, a_row: int, a: float, b_row: int, b: float) -> float:
    """Cauchy's product.

    The newest coefficients come last, so that a processor adds up the others before it has computed them.
    With an unsigned index it does not test for negative ones.
    """
    k, first, second = jet.k, jet.rows[a_row], jet.rows[b_row]
    first[k], second[k] = a, b
    if k == 0:
        return a * b
    total = 0.0
    for j in range(1, k):
        total += first[j] * second[np.uint64(k - j)]
    return float(total + first[0] * b + a * second[0])


@by_part
def square(jet: Jet, row: int, a: float) -> float:
    """a²."""
    return a * a


@square.register(Coefficient)
def _square(jet: Coefficient, row: int, a: float) -> float:
    """As `product`, where each term but the middle one stands twice."""
    k, c = jet.k, jet.rows[row]
    c[k] = a
    if k == 0:
        return a * a
    total = 0.0
    for j in range(1, (k + 1) // 2):
        total += c[j] * c[np.uint64(k - j)]
    middle = c[k // 2] if k % 2 == 0 else 0.0
    return float(2.0 * (total + c[0] * a) + middle * middle)


@by_part
def exponential(jet: Jet, x: float) -> float:
    """e^x."""
    return math.exp(x)


@exponential.register(Coefficient)
def _exponential(jet: Coefficient, x: float) -> float:
    """f = e^x has f' = x' f."""
    k, exponent, f = jet.k, jet.rows[ROW.exponent], jet.rows[ROW.power_of_e]
    exponent[k] = x
    if k == 0:
        f[0] = math.exp(x)
    else:
        total = 0.0
        for j in range(1, k + 1):
            total += j * exponent[j] * f[np.uint64(k - j)]
        f[k] = total / k
    return float(f[k])


@by_part
def sine_and_cosine(jet: Jet, angle: float, rate_row: int) -> tuple[float, float]:
    """sin and cos of an angle whose rate is the quantity at `rate_row`."""
    return math.sin(angle), math.cos(angle)


@sine_and_cosine.register(Coefficient)
def _sine_and_cosine(jet: Coefficient, angle: float, rate_row: int) -> tuple[float, float]:
    return rotate(jet, angle, 1.0, rate_row, ROW.sine, ROW.cosine)


@subroutine(inline=True)
def rotate(
    jet: Coefficient, angle: float, factor: float, rate_row: int, sine_row: int, cosine_row: int
) -> tuple[float, float]:
    """sin and cos, also into their rows, of an angle whose rate is `factor` the quantity at `rate_row`."""
    k, rate, sine, cosine = jet.k, jet.rows[rate_row], jet.rows[sine_row], jet.rows[cosine_row]
    if k == 0:
        s, c = math.sin(angle), math.cos(angle)
    else:
        rise = fall = 0.0
        for j in range(k):
            back = np.uint64(k - 1 - j)
            rise += rate[j] * cosine[back]
            fall += rate[j] * sine[back]
        per = factor / k
        s, c = per * rise, -per * fall
    sine[k], cosine[k] = s, c
    return s, c


@by_part
def steady_sine_and_cosine(jet: Any, start_rad: float, rate_rad_s: float) -> tuple[float, float]:
    """sin and cos of an angle that grows at a constant rate from a step's start on."""
    angle = start_rad + rate_rad_s * jet.tau_s
    return math.sin(angle), math.cos(angle)


@steady_sine_and_cosine.register(Coefficient)
def _steady_sine_and_cosine(jet: Coefficient, start_rad: float, rate_rad_s: float) -> tuple[float, float]:
    k, sine, cosine = jet.k, jet.rows[ROW.sine], jet.rows[ROW.cosine]
    if k == 0:
        s, c = math.sin(start_rad), math.cos(start_rad)
    else:
        before, turn = np.uint64(k - 1), 1.0 / k * rate_rad_s
        s, c = float(turn * cosine[before]), float(-turn * sine[before])
    sine[k], cosine[k] = s, c
    return s, c


@by_part
def at_least(jet: Jet, value: float, least: float) -> float:
    """The larger one; a series ends before its value falls to `least`."""
    return max(value, least)


@at_least.register(Coefficient)
def _at_least(jet: Coefficient, value: float, least: float) -> float:
    return value


@subroutine
def add_sine(amplitude: float, rate_rad_s: float, phase_rad: float, series: FloatArray) -> None:
    """Add the Taylor coefficients of a sine wave."""
    sine, cosine = amplitude * math.sin(phase_rad), amplitude * math.cos(phase_rad)
    for k in range(series.size):
        series[k] += sine
        per = rate_rad_s / (k + 1)
        sine, cosine = per * cosine, -per * sine
