"""Parameters of a soft stop for a given coefficient of restitution and contact time.

The formulas neglect the coupling spring and the drive, whose forces are small beside the stop's. Speeds are
approach speeds, m/s; k is the ratio of separation to approach speed.
"""

import math

from plant_sim.kernels import subroutine

HERTZ_EXPONENT = 1.5
"""F ∝ δ^1.5 for a rounded striker on a flat pad (Hertz)."""

_QUARTER = (
    math.sqrt(math.pi)
    * math.gamma(1.0 + 1.0 / (HERTZ_EXPONENT + 1.0))
    / math.gamma(0.5 + 1.0 / (HERTZ_EXPONENT + 1.0))
)
"""∫₀¹ du / √(1 − uⁿ⁺¹) for Hertz's exponent."""


@subroutine
def hunt_crossley_dissipation(restitution: float) -> float:
    """Dimensionless d = λ v⁻ of F = K δⁿ (1 + λ δ') that returns the striker at k v⁻, for any exponent n.

    On both ways m v dv = −K δⁿ (1 + λ v) dδ, so with G(u) = u − ln(1 + u) the way in gives
    K δmaxⁿ⁺¹ / (m (n + 1)) = G(d)/λ² and the way out G(−k d)/λ²: the root of G(d) = G(−k d). Exact, after
    Hunt & Crossley, J. Appl. Mech. 42 (1975) 440. It tends to 3/2 (1 − k) for k → 1 and to 1/k for k → 0.

    >>> round(hunt_crossley_dissipation(0.5), 6)
    1.432751
    """
    if restitution >= 1.0:
        return 0.0
    largest = math.nextafter(1.0 / restitution, 0.0)
    if imbalance(restitution, False, largest) > 0.0:  # the root is closer to 1/k than numbers are
        return largest
    return root(restitution, False, 0.0, largest)


@subroutine
def imbalance(restitution: float, is_linear: bool, value: float) -> float:
    """A function that falls with the unknown `value` and is 0 at the one that gives this restitution k.

    For Hunt and Crossley's stop the unknown is d, and the function G(d) − G(−k d), over d². For a linear stop
    the unknown is ln ζ, and the function ln k(ζ) − ln k.
    """
    if is_linear:
        return math.log(kelvin_voigt_restitution(math.exp(value))) - math.log(restitution)
    k = restitution
    return log_remainder(value) - k * k * log_remainder(-k * value)


@subroutine
def log_remainder(u: float) -> float:
    """(u − ln(1 + u)) / u², by its series where the difference would cancel."""
    if abs(u) > 0.1:
        return (u - math.log1p(u)) / (u * u)
    total = 0.0
    for j in range(18):  # next term below 1e-19
        total += (-u) ** float(j) / (j + 2)
    return total


@subroutine
def hertz_stiffness(mass_kg: float, contact_s: float, speed_m_s: float) -> float:
    """K in N/m^1.5 of F = K δ^1.5 with the elastic contact time `contact_s` at approach speed `speed_m_s`.

    T = 2 (δmax/v) ∫₀¹ du / √(1 − uⁿ⁺¹) = 2.943 δmax/v at n = 1.5, with δmaxⁿ⁺¹ = (n + 1) m v² / (2 K)
    (Johnson, Contact Mechanics, 1985, section 11.4).
    """
    n = HERTZ_EXPONENT
    deepest_m = contact_s * speed_m_s / (2.0 * _QUARTER)
    stiffness: float = (n + 1.0) * mass_kg * (speed_m_s * speed_m_s) / (2.0 * deepest_m ** (n + 1.0))
    return stiffness


@subroutine
def linear_stiffness(mass_kg: float, contact_s: float) -> float:
    """K in N/m of a linear stop with the elastic contact time `contact_s`: half a period, T = π √(m/K)."""
    rate = math.pi / contact_s
    return mass_kg * (rate * rate)


@subroutine
def kelvin_voigt_restitution(zeta: float) -> float:
    """Restitution k of F = K δ + D δ' ≥ 0 at damping ratio ζ = D / (2 √(K m)), released when F would pull.

    In units of √(m/K), with v(0) = 1: the force −v' vanishes first at τ; k = −v(τ) = exp(−ζ τ), because
    δ = −2 ζ v there makes v² + 2 ζ δ v + δ² = v² the invariant e^(−2 ζ τ). Schwager & Pöschel,
    Granular Matter 9 (2007) 465.
    """
    if zeta < 1.0:
        frequency = math.sqrt(1.0 - zeta * zeta)
        tau = math.atan2(2.0 * zeta * frequency, 2.0 * zeta * zeta - 1.0) / frequency
    elif zeta == 1.0:
        tau = 2.0
    else:
        rate = math.sqrt(zeta * zeta - 1.0)
        tau = 2.0 * math.log(zeta + rate) / rate
    return math.exp(-zeta * tau)


@subroutine
def kelvin_voigt_damping(mass_kg: float, stiffness_n_per_m: float, restitution: float) -> float:
    """D in N s/m of F = K δ + D δ' ≥ 0 for a given restitution."""
    if restitution >= 1.0:
        return 0.0
    zeta = math.exp(root(restitution, True, -50.0, 50.0))
    return 2.0 * zeta * math.sqrt(stiffness_n_per_m * mass_kg)


@subroutine
def root(restitution: float, is_linear: bool, low: float, high: float) -> float:
    """The unknown of `imbalance`, between `low` and `high`: bisection down to two adjacent floats.

    scipy.optimize is not used because its import takes longer than everything else that a scene needs.
    """
    middle = low + 0.5 * (high - low)
    while low < middle < high:
        if imbalance(restitution, is_linear, middle) > 0.0:
            low = middle
        else:
            high = middle
        middle = low + 0.5 * (high - low)
    return high
