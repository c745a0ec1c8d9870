"""A flight in cells of equal length: a linear step from cell to cell, and proofs that a cell has no event.

The motion z'' + 2σ z' + ω² z = ω² A sin θ, θ' = Ω, with z counted from the offset of dry friction, is linear
in (z, z', A sin θ, A cos θ): one matrix carries it over a cell, without sine or exponential.

Within a cell a guard g is known by its values and slopes at both ends. With B₀…B₃ Bernstein's cubic
polynomials of s / h, Hermite's interpolant p is Σ bᵢ Bᵢ, b = (g₀, g₀ + g₀' h/3, g₁ − g₁' h/3, g₁), and

    |g − p| ≤ max|g''''| s² (h − s)² / 24 ≤ E (B₁ + B₂),   E = max|g''''| h⁴ / 144,

for s² (h − s)² is the mean of h − s times s² (h − s) = h³ B₂ / 3 and of s times s (h − s)² = h³ B₁ / 3. So g
has no root within the cell if g₀ ≤ 0, g₁ ≤ 0 and b₁, b₂ < −E.
"""

import math
from typing import NamedTuple

from plant_sim.kernels import jit, subroutine

SHARE = 4e-3
"""Uncertainty within a cell as a share of the motion; near a stop, longer cells are subdivided more often."""

STRONGEST_DRAG = 0.5
"""Largest 2σ / ω for which the bounds on derivatives are useful."""

LONGEST_RAD = 4.0
"""Largest angle of the drive in a cell, for which power series lose a digit at most."""

TERMS, TERMS_PER_RAD = 16, 6.0
"""Number of terms of these series; the remainder is below a rounding."""

BLUR = 1e-13
"""Rounding error over many cells, as a share of the motion's size."""


class Cells(NamedTuple):
    """The cells of a scene; `span_s` is 0 for a scene without cells."""

    span_s: float
    z_z: float
    z_v: float
    z_sin: float
    z_cos: float
    v_z: float
    v_v: float
    v_sin: float
    v_cos: float
    turn_sin: float
    turn_cos: float
    stiffness_1_s2: float  # ω²
    drag_1_s: float  # 2σ
    # E for the guards z − const and ±z', each as a share of √(ω² z² + z'²) and a constant
    place_share_s: float
    place_m: float
    speed_share: float
    speed_m_s: float
    length_m: float  # rounding's scale besides the motion's own


class Place(NamedTuple):
    """The motion at a cell's border: z, z', z'', A sin θ and A cos θ."""

    z_m: float
    v_m_s: float
    a_m_s2: float
    sin_m: float
    cos_m: float


class Doubt(NamedTuple):
    """Uncertainty over a cell: E of position and of speed, and the rounding of each."""

    place_m: float
    speed_m_s: float
    blur_m: float
    blur_m_s: float


@subroutine
def cells(
    stiffness_1_s2: float,
    natural_rad_s: float,
    drag_1_s: float,
    drive_rad_s: float,
    piston_m: float,
    gap_m: float,
) -> Cells:
    """The cells of a scene whose striker swings by about the sum of gap and piston stroke."""
    w, w2, Omega = natural_rad_s, stiffness_1_s2, drive_rad_s
    A = abs(piston_m)
    length = A + (abs(gap_m) if math.isfinite(gap_m) else 0.0)
    h = 0.0
    if length > 0.0 and drag_1_s <= STRONGEST_DRAG * w:
        fourth = w2 * (w2 * length + Omega * Omega * A)
        h = math.sqrt(math.sqrt(144.0 * SHARE * length / fourth))
        h = h if Omega * h <= LONGEST_RAD else LONGEST_RAD / Omega
    zz, vz, _, _ = _series(w2, drag_1_s, Omega, h, 1.0, 0.0, 0.0, 0.0)
    zv, vv, _, _ = _series(w2, drag_1_s, Omega, h, 0.0, 1.0, 0.0, 0.0)
    zs, vs, sin_sin, _ = _series(w2, drag_1_s, Omega, h, 0.0, 0.0, 1.0, 0.0)
    zc, vc, sin_cos, _ = _series(w2, drag_1_s, Omega, h, 0.0, 0.0, 0.0, 1.0)
    fourth, fifth = _bounds(w, w2, drag_1_s, Omega, A, h, 0.0)
    fourth_1, fifth_1 = _bounds(w, w2, drag_1_s, Omega, A, h, 1.0)
    share = h**4 / 144.0
    return Cells(
        h,
        zz,
        zv,
        zs,
        zc,
        vz,
        vv,
        vs,
        vc,
        sin_cos,
        sin_sin,
        w2,
        drag_1_s,
        share * (fourth_1 - fourth),
        share * fourth,
        share * (fifth_1 - fifth),
        share * fifth,
        length,
    )


@subroutine
def _series(
    w2: float, drag: float, Omega: float, h: float, z: float, v: float, sine: float, cosine: float
) -> tuple[float, float, float, float]:
    """z, z', A sin θ and A cos θ after h seconds, by power series: term n is z⁽ⁿ⁾ hⁿ / n!."""
    turn = Omega * h
    term, after, drive, drive_after = z, v * h, sine, cosine * turn
    z_end, vh_end, sine_end, turned_end = term + after, after, drive + drive_after, drive_after
    for n in range(2, TERMS + int(TERMS_PER_RAD * max(turn, math.sqrt(w2) * h))):
        after, term = (-drag * h * (n - 1) * after - w2 * h * h * (term - drive)) / (n * (n - 1)), after
        drive_after, drive = -turn * turn * drive / (n * (n - 1)), drive_after
        z_end += after
        vh_end += n * after
        sine_end += drive_after
        turned_end += n * drive_after
    return z_end, vh_end / h if h > 0.0 else v, sine_end, turned_end / turn if turn > 0.0 else cosine


@subroutine
def _bounds(
    w: float, w2: float, drag: float, Omega: float, A: float, h: float, norm_m_s: float
) -> tuple[float, float]:
    """Bounds on z'''' and z''''' over a cell that begins with √(ω² z² + z'²).

    The norm grows by at most the drive's ω² A a second; each derivative follows from the equation of motion.
    """
    drive = w2 * A
    b1 = norm_m_s + drive * h
    b2 = (w + drag) * b1 + drive
    b3 = drag * b2 + w2 * b1 + drive * Omega
    b4 = drag * b3 + w2 * b2 + drive * Omega * Omega
    return b4, drag * b4 + w2 * b3 + drive * Omega * Omega * Omega


@jit
def onward(c: Cells, p: Place) -> Place:
    """The motion one cell later."""
    z = (c.z_z * p.z_m + c.z_v * p.v_m_s) + (c.z_sin * p.sin_m + c.z_cos * p.cos_m)
    v = (c.v_z * p.z_m + c.v_v * p.v_m_s) + (c.v_sin * p.sin_m + c.v_cos * p.cos_m)
    sine = c.turn_cos * p.sin_m + c.turn_sin * p.cos_m
    cosine = c.turn_cos * p.cos_m - c.turn_sin * p.sin_m
    return Place(z, v, -c.drag_1_s * v - c.stiffness_1_s2 * (z - sine), sine, cosine)


@jit
def doubt(c: Cells, z_m: float, v_m_s: float, natural_rad_s: float) -> Doubt:
    """Uncertainty over the cell that begins here."""
    free = natural_rad_s * z_m
    norm = math.sqrt(free * free + v_m_s * v_m_s)
    blur = BLUR * (norm + natural_rad_s * c.length_m)
    return Doubt(
        c.place_share_s * norm + c.place_m, c.speed_share * norm + c.speed_m_s, blur / natural_rad_s, blur
    )


@jit
def bends_below(start: float, slope: float, end: float, end_slope: float, span: float, slack: float) -> bool:
    """Whether a guard that is ≤ 0 at both ends of a span is < 0 within it: b₁, b₂ < −E.

    A guard that starts with value and slope 0 has b₀ = b₁ = 0; its whole uncertainty, 2 E, then belongs to
    B₂.
    """
    third = span / 3.0
    if start == 0.0 and slope == 0.0:
        return end - third * end_slope < -2.0 * slack
    return start + third * slope < -slack and end - third * end_slope < -slack
