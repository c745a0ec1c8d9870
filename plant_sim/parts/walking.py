"""The housing on the shank of a walker: a_b(t) from the leg's motion over the gait cycle.

Sagittal plane: x forward, z up, ψ the shank's lean, positive where its top is in front of the ankle. With e
the shank's direction upward, t across it forward, h the housing's height over the ankle and p the ankle:

    along e:  p_x'' sin ψ + (p_z'' + g) cos ψ − h ψ'²        along t:  p_x'' cos ψ − (p_z'' + g) sin ψ + h ψ''
    sideways: p_y'' − (p_z'' + g) sin ρ + h ρ''              ρ: the frontal tilt, positive: top outside

The curves are Fourier series of low order through landmarks of the normative curves of natural cadence
(Winter, The Biomechanics and Motor Control of Human Gait, 1991; Biomechanics and Motor Control of Human
Movement, 4th ed. 2009, appendix A): the shank leans 20° back at heel strike, 15° forward at 40 % and 52°
after toe-off at 62 %, and swings back at 370 °/s; the ankle stays where it is until heel-off and then travels
a stride at up to 3.2 times the walking speed; the calf pushes off with up to 1.6 N m/kg, at 47 %. Moments
grow with the speed of walking (Lelas et al., Gait & Posture 17, 2003): here as much as the motion. The
landmarks are rounded figures, not Winter's tables: they are adequate for the size and the timing of the
module's accelerations, not for a study of gait. Sideways motion (2° of tilt, 1 cm of sway) has the usual size
and follows no published curve. The model has one leg on level ground. The normal force of dry friction in the
guide remains m g, whatever the axis' direction.

Time runs through `rows`: in each, frequency, size of the motion and length of the stride change from one
value to the next by 10 s³ − 15 s⁴ + 6 s⁵, so that a_b is smooth except where heel strikes and knocks begin
and end.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.jets import NOW, Coefficient, Jet, add_sine, product, rotate, square
from plant_sim.kernels import subroutine

Derivatives: TypeAlias = tuple[float, float, float]
"""A quantity and its first two derivatives."""
Blend: TypeAlias = tuple[float, float, float, float, float, float]
"""Taylor coefficients in time of the course of a row, from 0 to 1."""
Harmonics: TypeAlias = tuple[tuple[float, ...], tuple[float, ...]]
"""cos k α and sin k α, or their coefficients in a curve, k from 0 to ORDER."""

(
    BEGIN_S,
    LENGTH_S,
    PHASE,
    FROM_HZ,
    TO_HZ,
    FROM_SIZE,
    TO_SIZE,
    FROM_STRIDE_M,
    TO_STRIDE_M,
    STRIKE_M_S2,
    KNOCK_M_S2,
    COLUMNS,
) = range(12)
"""Columns of `Walking.rows`: begin and length of the row, cycles before it, first and last value of
frequency, size and stride, and the peaks of a heel strike and of a knock at its beginning. The last row of a
walk that does not stop is of infinite length: even strides, each with its heel strike."""

STRIKE_S = 0.03
"""Duration of a heel strike at the shank."""
KNOCK_S = 0.08
"""Duration for which a tripping foot is held."""
STRIKE_BACKWARD = 0.3
"""Share of a heel strike across the shank: the ground pushes up and back."""

TOE_OFF = 0.62
"""Phase of toe-off in the curves below."""

ORDER = 6
SHANK_RAD = (
    (0.2545, -0.3875, -0.2050, -0.0069, -0.0020, 0.0020, -0.0023),
    (0.0, -0.3084, 0.1098, 0.0538, 0.0156, 0.0055, 0.0013),
)
"""ψ: coefficients of cos 2π k χ and of sin 2π k χ, k from 0."""
RISE_M = (
    (0.0, -0.0175, -0.0236, 0.0078, 0.0045, -0.0009, 0.0003),
    (0.0, -0.0642, 0.0153, 0.0075, -0.0036, -0.0016, -0.0003),
)
"""Height of the ankle above its mean."""
ADVANCE = (
    (0.0, 0.2378, 0.0355, -0.0001, 0.0016, 0.0008, -0.0008),
    (0.0, 0.0546, -0.0444, -0.0108, -0.0016, -0.0018, -0.0001),
)
"""Position of the ankle ahead of a point that moves at walking speed, in strides."""
SWAY_M = (
    (0.0, 0.0019, -0.0028, 0.0, 0.0, 0.0, 0.0),
    (0.0, -0.0098, -0.0011, 0.0, 0.0, 0.0, 0.0),
)
"""Outward position of the ankle: it passes the other leg at 78 %."""
TILT_RAD = (
    (0.0, -0.0108, -0.0081, 0.0, 0.0, 0.0, 0.0),
    (0.0, 0.0333, -0.0059, 0.0, 0.0, 0.0, 0.0),
)
"""ρ: largest in mid-stance."""
ANKLE_N_M_KG = (
    (0.4279, -0.5735, 0.1686, -0.1418, 0.0916, -0.0470, 0.0349),
    (0.0, 0.3846, -0.2623, 0.0626, -0.0578, -0.0086, -0.0001),
)
"""Moment of the calf about the ankle per body mass: −0.1 after heel strike, 1.6 at 47 %, 0 in swing."""

_CURVES: FloatArray = np.array([SHANK_RAD, RISE_M, SWAY_M, TILT_RAD, ADVANCE])

_HERTZ, _SIZE, _STRIDE = range(3)
"""Rows of a series: first those of the changes in a row of `Walking.rows`, in the order of its columns."""
_LEAN, _RISE, _SWAY, _TILT, _AHEAD = range(3, 8)
_LEAN_RATE, _LEAN_SINE, _LEAN_COSINE, _TILT_RATE, _TILT_SINE, _TILT_COSINE, _FORWARD, _FALL = range(8, 16)
_TURN, _TURN_SINE, _TURN_COSINE, _RATE = range(16, 20)
"""2π φ' with sin 2π φ and cos 2π φ, and 2π χ'."""
_SPEED, _BARE, _SINES, _COSINES = 20, 21, 26, 27 + ORDER
"""L f, and the first rows of the curves of size 1 and of their harmonics."""


class Walking(NamedTuple):
    """Housing on a walking leg; `axis_…` is the striker's axis towards the stop, in the shank's directions.

    `warp` moves toe-off: the curves are read at χ = φ + warp · sin² π φ.
    """

    axis_up: float
    axis_forward: float
    axis_outward: float
    mount_m: float
    gravity_m_s2: float
    warp: float
    rows: FloatArray


class Leg(NamedTuple):
    """The shank: lean and its rate, and the specific force at the housing."""

    lean_rad: float
    lean_rad_s: float
    up_m_s2: float
    forward_m_s2: float
    outward_m_s2: float


@subroutine
def row_at(rows: FloatArray, t_s: float) -> int:
    """The last row that has begun."""
    low, high = 0, rows.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if rows[middle, BEGIN_S] <= t_s:
            low = middle
        else:
            high = middle
    return low


@subroutine
def since_strike_s(row: FloatArray, into_s: float, same_s: float) -> float:
    """Time since the last heel strike, s; the last row of a walk has no end and one heel strike a
    stride.

    The instant of a heel strike may be missed by up to `same_s`: then the time is 0 or just below.
    """
    if math.isfinite(row[LENGTH_S]) or row[FROM_HZ] == 0.0:
        return into_s
    stride_s: float = 1.0 / row[FROM_HZ]
    return into_s - math.floor((into_s + same_s) / stride_s) * stride_s


@subroutine
def expand_blend(into_s: float, length_s: float) -> Blend:
    """Taylor coefficients of S = 10 s³ − 15 s⁴ + 6 s⁵, with S' = S'' = 0 at both ends, in time."""
    s, per_s = into_s / length_s, 1.0 / length_s
    left = 1.0 - s
    return (
        s * s * s * (10.0 - s * (15.0 - 6.0 * s)),
        per_s * 30.0 * s * s * left * left,
        per_s**2 * 30.0 * s * left * (1.0 - 2.0 * s),
        per_s**3 * 10.0 * (1.0 - 6.0 * s * left),
        per_s**4 * 15.0 * (2.0 * s - 1.0),
        per_s**5 * 6.0,
    )


@subroutine
def cycles_at(row: FloatArray, t_s: float) -> float:
    """φ, in cycles since the first heel strike: the integral of the frequency."""
    into_s, length_s, first_hz = t_s - row[BEGIN_S], row[LENGTH_S], row[FROM_HZ]
    change_hz = row[TO_HZ] - first_hz
    if change_hz == 0.0:
        return float(row[PHASE] + first_hz * into_s)
    s = min(into_s / length_s, 1.0)
    grown = change_hz * length_s * s * s * s * s * (2.5 - s * (3.0 - s))
    return float(row[PHASE] + first_hz * into_s + grown)


@subroutine
def _phase_rad(row: FloatArray, t_s: float) -> float:
    """2π φ within a cycle."""
    cycles = cycles_at(row, t_s)
    return 2.0 * math.pi * (cycles - math.floor(cycles))


@subroutine
def _harmonics(angle: float) -> Harmonics:
    """cos k α and sin k α at this angle."""
    c1, s1 = math.cos(angle), math.sin(angle)
    c2, s2 = c1 * c1 - s1 * s1, 2.0 * s1 * c1
    c3, s3 = c2 * c1 - s2 * s1, s2 * c1 + c2 * s1
    c4, s4 = c2 * c2 - s2 * s2, 2.0 * s2 * c2
    c5, s5 = c4 * c1 - s4 * s1, s4 * c1 + c4 * s1
    return (1.0, c1, c2, c3, c4, c5, c3 * c3 - s3 * s3), (0.0, s1, s2, s3, s4, s5, 2.0 * s3 * c3)


@subroutine
def _between(first: float, last: float, mix: Blend) -> Derivatives:
    change = last - first
    return first + change * mix[0], change * mix[1], 2.0 * change * mix[2]


@subroutine
def _curve(curve: Harmonics, waves: Harmonics, rate: float, growth: float, size: Derivatives) -> Derivatives:
    """A curve times `size` at an angle with this first and second derivative in time; and its derivatives."""
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(ORDER + 1):
        a, b, c, s = curve[0][k], curve[1][k], waves[0][k], waves[1][k]
        value += a * c + b * s
        slope += k * (b * c - a * s)
        bend -= k * k * (a * c + b * s)
    d1, d2 = slope * rate, bend * rate * rate + slope * growth
    return (
        size[0] * value,
        size[1] * value + size[0] * d1,
        size[2] * value + 2.0 * size[1] * d1 + size[0] * d2,
    )


@subroutine
def _bump(peak: float, into_s: float, length_s: float) -> float:
    """peak · sin²(π t/T) for 0 < t < T."""
    if peak == 0.0 or into_s <= 0.0 or into_s >= length_s:
        return 0.0
    return peak * math.sin(math.pi * into_s / length_s) ** 2


@subroutine
def leg_at(walking: Walking, t_s: float) -> Leg:
    """State of the shank at `t_s`."""
    row = walking.rows[row_at(walking.rows, t_s)]
    into_s = t_s - row[BEGIN_S]
    mix = expand_blend(min(into_s, row[LENGTH_S]), row[LENGTH_S])
    hertz = _between(row[FROM_HZ], row[TO_HZ], mix)
    size = _between(row[FROM_SIZE], row[TO_SIZE], mix)
    stride = _between(row[FROM_STRIDE_M], row[TO_STRIDE_M], mix)
    phase, warp = _phase_rad(row, t_s), math.pi * walking.warp
    c, s, turn = math.cos(phase), math.sin(phase), 2.0 * math.pi * hertz[0]
    waves, rate = _harmonics(phase + warp * (1.0 - c)), turn * (1.0 + warp * s)
    growth = 2.0 * math.pi * hertz[1] * (1.0 + warp * s) + warp * c * turn * turn
    lean = _curve(SHANK_RAD, waves, rate, growth, size)
    rise = _curve(RISE_M, waves, rate, growth, size)
    sway = _curve(SWAY_M, waves, rate, growth, size)
    tilt = _curve(TILT_RAD, waves, rate, growth, size)
    ahead = _curve(ADVANCE, waves, rate, growth, stride)
    x2 = stride[1] * hertz[0] + stride[0] * hertz[1] + ahead[2]  # p_x = ∫ L f dt + L ξ(χ)
    ankle = x2, sway[2], rise[2] + walking.gravity_m_s2
    shank = math.sin(lean[0]), math.cos(lean[0]), lean[1], lean[2]
    up, forward, outward = _force(NOW, walking.mount_m, ankle, shank, (math.sin(tilt[0]), tilt[2]))
    strike = _bump(row[STRIKE_M_S2], since_strike_s(row, into_s, 0.0), STRIKE_S)
    knock = _bump(row[KNOCK_M_S2], into_s, KNOCK_S)
    return Leg(lean[0], lean[1], up + strike, forward - STRIKE_BACKWARD * strike - knock, outward)


@subroutine(inline=True)
def _force(
    jet: Jet,
    h: float,
    ankle: tuple[float, float, float],
    shank: tuple[float, float, float, float],
    tilt: tuple[float, float],
) -> tuple[float, float, float]:
    """Specific force up, forward and outward without bumps: from p'' with gravity, sin ψ, cos ψ, ψ', ψ'',
    sin ρ and ρ''."""
    (x2, y2, fall), (sine, cosine, rate, growth), (tilt_sine, tilt_growth) = ankle, shank, tilt
    up = product(jet, _FORWARD, x2, _LEAN_SINE, sine) + product(jet, _FALL, fall, _LEAN_COSINE, cosine)
    forward = product(jet, _FORWARD, x2, _LEAN_COSINE, cosine) - product(jet, _FALL, fall, _LEAN_SINE, sine)
    outward = y2 - product(jet, _FALL, fall, _TILT_SINE, tilt_sine)
    return up - h * square(jet, _LEAN_RATE, rate), forward + h * growth, outward + h * tilt_growth


@subroutine
def expand_leg(walking: Walking, t_s: float, same_s: float, series: FloatArray, work: FloatArray) -> None:
    """Taylor coefficients of a_b at `t_s`, into `series`, shape (order + 1,).

    `work` is scratch, shape (40, order + 3) and (40, 6) at least. Bumps that begin or end within `same_s` do
    so at `t_s`.
    """
    row = walking.rows[row_at(walking.rows, t_s + same_s)]
    into_s = t_s - row[BEGIN_S]
    _expand_curves(walking, row, t_s, series.size + 2, work)
    for k in range(series.size):
        jet = Coefficient(work, k, 0.0)
        first, second = k + 1, (k + 1) * (k + 2)  # factors of the derivatives
        x2, y2 = first * work[_SPEED, k + 1] + second * work[_AHEAD, k + 2], second * work[_SWAY, k + 2]
        fall = second * work[_RISE, k + 2] + (walking.gravity_m_s2 if k == 0 else 0.0)
        sine, cosine = rotate(jet, work[_LEAN, 0], 1.0, _LEAN_RATE, _LEAN_SINE, _LEAN_COSINE)
        shank = sine, cosine, first * work[_LEAN, k + 1], second * work[_LEAN, k + 2]
        tilt_sine, _ = rotate(jet, work[_TILT, 0], 1.0, _TILT_RATE, _TILT_SINE, _TILT_COSINE)
        work[_TILT_RATE, k] = first * work[_TILT, k + 1]
        tilt = tilt_sine, second * work[_TILT, k + 2]
        series[k] = along_axis(walking, *_force(jet, walking.mount_m, (x2, y2, fall), shank, tilt))
    since_s = since_strike_s(row, into_s, same_s)
    if since_s < STRIKE_S - same_s:
        strike = along_axis(walking, row[STRIKE_M_S2], -STRIKE_BACKWARD * row[STRIKE_M_S2], 0.0)
        _add_bump(strike, since_s, STRIKE_S, series)
    if into_s < KNOCK_S - same_s:
        _add_bump(along_axis(walking, 0.0, -row[KNOCK_M_S2], 0.0), into_s, KNOCK_S, series)


@subroutine
def _expand_curves(walking: Walking, row: FloatArray, t_s: float, terms: int, work: FloatArray) -> None:
    """The first coefficients of frequency and stride, and of the curves."""
    mix = expand_blend(t_s - row[BEGIN_S], row[LENGTH_S])
    work[: _STRIDE + 1] = 0.0
    for i in range(_STRIDE + 1):
        first = work[i, 0] = row[FROM_HZ + 2 * i]
        for k in range(len(mix)):
            work[i, k] += (row[TO_HZ + 2 * i] - first) * mix[k]
    phase, warp = _phase_rad(row, t_s), math.pi * walking.warp
    angle = phase + warp * (1.0 - math.cos(phase))
    for k in range(terms):
        jet = Coefficient(work, k, 0.0)
        for i in range(ORDER + 1):
            rotate(jet, i * angle, i, _RATE, _SINES + i, _COSINES + i)
        work[_SPEED, k] = product(jet, _HERTZ, work[_HERTZ, k], _STRIDE, work[_STRIDE, k])
        rate = work[_RATE, k] = 2.0 * math.pi * work[_HERTZ, k]
        if warp != 0.0:
            sine, _ = rotate(jet, phase, 1.0, _TURN, _TURN_SINE, _TURN_COSINE)
            work[_RATE, k] += warp * product(jet, _TURN, rate, _TURN_SINE, sine)
        for i in range(_CURVES.shape[0]):
            bare = 0.0
            for j in range(ORDER + 1):
                bare += _CURVES[i, 0, j] * work[_COSINES + j, k] + _CURVES[i, 1, j] * work[_SINES + j, k]
            size = _STRIDE if _LEAN + i == _AHEAD else _SIZE
            work[_LEAN + i, k] = product(jet, size, work[size, k], _BARE + i, bare)


@subroutine
def _add_bump(peak: float, into_s: float, length_s: float, series: FloatArray) -> None:
    """Add peak · sin²(π t/T) = peak/2 · (1 − cos 2π t/T)."""
    rate = 2.0 * math.pi / length_s
    series[0] += 0.5 * peak
    add_sine(-0.5 * peak, rate, rate * into_s + 0.5 * math.pi, series)


@subroutine
def ankle_n_m_kg(phase: float) -> float:
    """Moment of the ankle at χ in natural walking, N m/kg: positive if it pushes the toes down."""
    return _curve(ANKLE_N_M_KG, _harmonics(2.0 * math.pi * phase), 0.0, 0.0, (1.0, 0.0, 0.0))[0]


@subroutine
def along_axis(walking: Walking, up: float, forward: float, outward: float) -> float:
    """Component along the striker's axis of a vector given in the shank's directions."""
    return walking.axis_up * up + walking.axis_forward * forward + walking.axis_outward * outward


@subroutine
def bump_m_s(walking: Walking, t_s: float, same_s: float) -> float:
    """The velocity along the axis, m/s, that a heel strike and a knock which begin at `t_s` give the
    housing."""
    row = walking.rows[row_at(walking.rows, t_s + same_s)]
    if abs(since_strike_s(row, t_s - row[BEGIN_S], same_s)) > same_s:
        return 0.0
    strike, knock = 0.5 * STRIKE_S * row[STRIKE_M_S2], 0.5 * KNOCK_S * row[KNOCK_M_S2]  # ∫ sin²
    return along_axis(walking, strike, -STRIKE_BACKWARD * strike - knock, 0.0)


@subroutine
def unbroken_s(walking: Walking, t_s: float, same_s: float) -> float:
    """Longest smooth interval from `t_s`, s: a radian of the fastest wave, up to the end of a row or bump."""
    rows = walking.rows
    row = rows[row_at(rows, t_s + same_s)]
    into_s = t_s - row[BEGIN_S]
    hertz = max(row[FROM_HZ], row[TO_HZ]) * (1.0 + math.pi * abs(walking.warp))
    longest = 1.0 / (2.0 * math.pi * ORDER * hertz) if hertz > 0.0 else math.inf
    since_s, left_s = since_strike_s(row, into_s, same_s), row[LENGTH_S] - into_s
    if math.isinf(left_s) and hertz > 0.0:
        left_s = 1.0 / row[FROM_HZ] - since_s
    if left_s > same_s:
        longest = min(longest, left_s)
    if row[STRIKE_M_S2] != 0.0 and STRIKE_S - since_s > same_s:
        longest = min(longest, STRIKE_S - since_s, STRIKE_S / (2.0 * math.pi))
    if row[KNOCK_M_S2] != 0.0 and KNOCK_S - into_s > same_s:
        longest = min(longest, KNOCK_S - into_s, KNOCK_S / (2.0 * math.pi))
    return longest
