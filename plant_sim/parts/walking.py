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

from plant_sim.arrays import FloatArray
from plant_sim.kernels import subroutine

Derivatives: TypeAlias = tuple[float, float, float, float]
"""A quantity and its first three derivatives."""

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
    """The shank: lean and its rates, and the specific force at the housing with its time derivative."""

    lean_rad: float
    lean_rad_s: float
    up_m_s2: float
    forward_m_s2: float
    outward_m_s2: float
    up_m_s3: float
    forward_m_s3: float
    outward_m_s3: float


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
def _transition(first: float, last: float, into_s: float, length_s: float) -> Derivatives:
    """Transition from `first` to `last` by S = 10 s³ − 15 s⁴ + 6 s⁵, with S' = S'' = 0 at both ends."""
    if first == last or into_s >= length_s:
        return last, 0.0, 0.0, 0.0
    s, change = into_s / length_s, last - first
    rate = change / length_s
    left = 1.0 - s
    return (
        first + change * s * s * s * (10.0 - s * (15.0 - 6.0 * s)),
        rate * 30.0 * s * s * left * left,
        rate / length_s * 60.0 * s * left * (1.0 - 2.0 * s),
        rate / (length_s * length_s) * 60.0 * (1.0 - 6.0 * s * left),
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
def _warped(cycles: float, hertz: Derivatives, warp: float) -> Derivatives:
    """χ = φ + warp · sin² π φ and its derivatives in time."""
    turn = 2.0 * math.pi
    phase = cycles - math.floor(cycles)
    c, s = math.cos(turn * phase), math.sin(turn * phase)
    # dχ/dφ and on
    d1 = 1.0 + 0.5 * turn * warp * s
    d2 = 0.5 * turn * turn * warp * c
    d3 = -0.5 * turn * turn * turn * warp * s
    f, f1, f2 = hertz[0], hertz[1], hertz[2]
    return (
        phase + 0.5 * warp * (1.0 - c),
        d1 * f,
        d2 * f * f + d1 * f1,
        d3 * f * f * f + 3.0 * d2 * f * f1 + d1 * f2,
    )


@subroutine
def _curve(coefficients: tuple[tuple[float, ...], tuple[float, ...]], phase: Derivatives) -> Derivatives:
    """A series at χ(t) and its derivatives in time (Faà di Bruno)."""
    turn = 2.0 * math.pi
    cosines, sines = coefficients
    c1, s1 = math.cos(turn * phase[0]), math.sin(turn * phase[0])
    c, s = 1.0, 0.0
    value, d1, d2, d3 = cosines[0], 0.0, 0.0, 0.0
    for k in range(1, ORDER + 1):
        c, s = c * c1 - s * s1, s * c1 + c * s1
        rate = turn * k
        there, slope = cosines[k] * c + sines[k] * s, rate * (sines[k] * c - cosines[k] * s)
        value += there
        d1 += slope
        d2 -= rate * rate * there
        d3 -= rate * rate * slope
    p1, p2, p3 = phase[1], phase[2], phase[3]
    return value, d1 * p1, d2 * p1 * p1 + d1 * p2, d3 * p1 * p1 * p1 + 3.0 * d2 * p1 * p2 + d1 * p3


@subroutine
def _times(p: Derivatives, q: Derivatives) -> Derivatives:
    """Product of two quantities, by Leibniz' rule."""
    return (
        p[0] * q[0],
        p[1] * q[0] + p[0] * q[1],
        p[2] * q[0] + 2.0 * p[1] * q[1] + p[0] * q[2],
        p[3] * q[0] + 3.0 * (p[2] * q[1] + p[1] * q[2]) + p[0] * q[3],
    )


@subroutine
def _bump(peak: float, into_s: float, length_s: float) -> tuple[float, float]:
    """peak · sin²(π t/T) for 0 < t < T, and its time derivative."""
    if peak == 0.0 or into_s <= 0.0 or into_s >= length_s:
        return 0.0, 0.0
    angle = math.pi * into_s / length_s
    return peak * math.sin(angle) ** 2, peak * math.pi / length_s * math.sin(2.0 * angle)


@subroutine
def leg_at(walking: Walking, t_s: float) -> Leg:
    """State of the shank at `t_s`."""
    row = walking.rows[row_at(walking.rows, t_s)]
    into_s, length_s, g, h = t_s - row[BEGIN_S], row[LENGTH_S], walking.gravity_m_s2, walking.mount_m
    hertz = _transition(row[FROM_HZ], row[TO_HZ], into_s, length_s)
    size = _transition(row[FROM_SIZE], row[TO_SIZE], into_s, length_s)
    stride = _transition(row[FROM_STRIDE_M], row[TO_STRIDE_M], into_s, length_s)
    phase = _warped(cycles_at(row, t_s), hertz, walking.warp)
    lean = _times(size, _curve(SHANK_RAD, phase))
    rise = _times(size, _curve(RISE_M, phase))
    sway = _times(size, _curve(SWAY_M, phase))
    tilt = _times(size, _curve(TILT_RAD, phase))
    ahead = _times(stride, _curve(ADVANCE, phase))
    speed = _times(stride, hertz)  # p_x = ∫ L f dt + L ξ(χ)
    x2, x3 = speed[1] + ahead[2], speed[2] + ahead[3]
    fall, fall1 = rise[2] + g, rise[3]
    cosine, sine = math.cos(lean[0]), math.sin(lean[0])
    strike, strike1 = _bump(row[STRIKE_M_S2], since_strike_s(row, into_s, 0.0), STRIKE_S)
    knock, knock1 = _bump(row[KNOCK_M_S2], into_s, KNOCK_S)
    return Leg(
        lean_rad=lean[0],
        lean_rad_s=lean[1],
        up_m_s2=x2 * sine + fall * cosine - h * lean[1] * lean[1] + strike,
        forward_m_s2=x2 * cosine - fall * sine + h * lean[2] - STRIKE_BACKWARD * strike - knock,
        outward_m_s2=sway[2] - fall * math.sin(tilt[0]) + h * tilt[2],
        up_m_s3=x3 * sine
        + fall1 * cosine
        + (x2 * cosine - fall * sine) * lean[1]
        - 2.0 * h * lean[1] * lean[2]
        + strike1,
        forward_m_s3=x3 * cosine
        - fall1 * sine
        - (x2 * sine + fall * cosine) * lean[1]
        + h * lean[3]
        - STRIKE_BACKWARD * strike1
        - knock1,
        outward_m_s3=sway[3] - fall1 * math.sin(tilt[0]) - fall * math.cos(tilt[0]) * tilt[1] + h * tilt[3],
    )


@subroutine
def ankle_n_m_kg(phase: float) -> float:
    """Moment of the ankle at χ in natural walking, N m/kg: positive if it pushes the toes down."""
    return _curve(ANKLE_N_M_KG, (phase, 0.0, 0.0, 0.0))[0]


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
