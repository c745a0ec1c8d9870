"""The energy ledger, each account integrated separately over every flow.

    drive    ∫ c (x_A − y) x_A' dt
    friction ∫ b y'² dt + μ m g ∫ |y'| dt
    impacts  m (y'⁻² − y'⁺²) / 2

The motion is a free part z plus a steady part in sin θ, cos θ; products of the two integrate by parts twice,
products of z alone by the free part's own decay. Where the steady amplitude dwarfs the motion these terms
would cancel, and Gauss–Legendre quadrature is used instead, exact to rounding on panels of half a period.
"""

import math
from typing import NamedTuple

import numpy as np

from plant_sim.kernels import subroutine
from plant_sim.result import Phase
from plant_sim.solvers.double_double import add
from plant_sim.solvers.exact.automaton import Motion
from plant_sim.solvers.exact.oscillator import Flight, Oscillator, flow, launch

Rule = tuple[tuple[float, float], ...]


def _gauss_legendre(points: int) -> Rule:
    """Nodes and weights on [−1, 1]."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    return tuple((float(node), float(weight)) for node, weight in zip(nodes, weights, strict=True))


PANEL_RAD, PANEL_RULE = 3.2, _gauss_legendre(12)
SHORT_RAD, SHORT_RULE = 0.1, _gauss_legendre(4)
"""Angle of the fastest rate over which a rule is exact to rounding."""


class Ledger(NamedTuple):
    """The accounts, each a sum in two floats, J."""

    drive_j: float
    drive_low_j: float
    friction_j: float
    friction_low_j: float
    impact_j: float
    impact_low_j: float


@subroutine
def empty_ledger() -> Ledger:
    """A ledger without entries."""
    return Ledger(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@subroutine
def book(o: Oscillator, ledger: Ledger, motion: Motion, arrival: Motion, departure: Motion) -> Ledger:
    """The ledger after the flow from `motion` to `arrival` and the event that changed it to `departure`."""
    drive, friction = _flow_energies(o, motion, arrival)
    lost = 0.5 * o.mass_kg * (arrival.v_m_s - departure.v_m_s) * (arrival.v_m_s + departure.v_m_s)
    drive_j, drive_low_j = add(ledger.drive_j, ledger.drive_low_j, drive)
    friction_j, friction_low_j = add(ledger.friction_j, ledger.friction_low_j, friction)
    impact_j, impact_low_j = add(ledger.impact_j, ledger.impact_low_j, lost)
    return Ledger(drive_j, drive_low_j, friction_j, friction_low_j, impact_j, impact_low_j)


@subroutine
def stored_j(o: Oscillator, motion: Motion) -> float:
    """Kinetic and spring energy."""
    stretch = motion.y_m - o.amplitude_m * motion.sin_crank
    return 0.5 * (o.mass_kg * motion.v_m_s * motion.v_m_s + o.spring_n_per_m * stretch * stretch)


@subroutine
def _flow_energies(o: Oscillator, motion: Motion, arrival: Motion) -> tuple[float, float]:
    """Work of the drive and friction heat of one flow."""
    A = o.amplitude_m
    sin0, cos0, sin1 = motion.sin_crank, motion.cos_crank, arrival.sin_crank
    sin2 = (sin1 - sin0) * (sin1 + sin0)  # sin²θ1 − sin²θ0
    half_piston = 0.5 * o.spring_n_per_m * A * A * sin2  # ∫ c x_A x_A' dt
    if motion.phase != Phase.FLIGHT:
        return half_piston - o.spring_n_per_m * A * motion.y_m * (sin1 - sin0), 0.0

    h = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
    flight = launch(o, motion.y_m, motion.v_m_s, sin0, cos0, motion.direction)
    if o.resonant and o.decay_1_s == 0.0:
        y_cos, v2 = _undamped_resonance(o, flight, motion, arrival, h), 0.0
    elif h * o.fastest_1_s <= SHORT_RAD:
        y_cos, v2 = _quadrature(o, flight, sin0, cos0, h, 1, SHORT_RULE)
    elif o.resonant:
        panels = math.ceil(h * o.fastest_1_s / PANEL_RAD)
        y_cos, v2 = _quadrature(o, flight, sin0, cos0, h, panels, PANEL_RULE)
    else:
        y_cos, v2 = _closed_form(o, flight, motion, arrival, h)
    friction = 2.0 * o.decay_1_s * o.mass_kg * v2
    if o.is_dry:
        friction += o.spring_n_per_m * o.dry_offset_m * abs(arrival.y_m - motion.y_m)
    return half_piston - o.spring_n_per_m * A * o.drive_rad_s * y_cos, friction


@subroutine
def _undamped_resonance(o: Oscillator, flight: Flight, motion: Motion, arrival: Motion, h: float) -> float:
    """∫ y cos θ dt over h seconds of an undamped flight near resonance, by divided differences of e^(zh).

    With E = e^(iθ0), R = e^(iΩh), β = Ω − ν and T = Ω + ν: the free part is 2 Re{a e^(iνs)}, the forced one
    ω² A Im{E Q(s)}, and cos θ = Re{E e^(iΩs)}. N = ∫ e^(−iβs) ds stays regular at β = 0, and so does
    (h − N) / iβ by its series.
    """
    nu, Omega, beta = o.ringing_rad_s, o.drive_rad_s, o.beat_rad_s
    T = Omega + nu
    E = complex(motion.cos_crank, motion.sin_crank)
    R = complex(arrival.cos_crank, arrival.sin_crank) * E.conjugate()
    R2 = R * R
    half = complex(math.cos(0.5 * beta * h), -math.sin(0.5 * beta * h))
    N = half * (-2.0 * half.imag / beta if beta != 0.0 else h)
    z = beta * h
    if abs(z) < 0.02:
        z2 = z * z
        lag = h * h * complex(1 / 2 - z2 * (1 / 24 - z2 / 720), -z * (1 / 6 - z2 * (1 / 120 - z2 / 5040)))
    else:
        lag = (h - N) * complex(0.0, -1.0 / beta)
    far = R2 * half * half  # e^(iTh)
    over_T, over_2Omega = complex(0.0, -1.0 / T), complex(0.0, -0.5 / Omega)
    G0, G1 = (R2 - 1.0) * over_2Omega, (far - 1.0) * over_T
    lead = (R2 * N - G1) * over_2Omega - (G0 - N.conjugate()) * over_T  # 2iν ∫ Q e^(iΩs) ds
    lag -= (h - (1.0 - far.conjugate()) * over_T) * over_T  # 2iν ∫ Q e^(−iΩs) ds
    forced = 0.5 * o.stiffness_1_s2 * o.amplitude_m * (-(E * E * lead + lag).real / (2.0 * nu))
    a = complex(0.5 * flight.free_m, -0.5 * flight.free_m_s / nu)
    free = (a * (E * G1 + E.conjugate() * N)).real
    return forced + free + flight.offset_m * (arrival.sin_crank - motion.sin_crank) / Omega


@subroutine
def _quadrature(
    o: Oscillator, flight: Flight, sin0: float, cos0: float, h: float, panels: int, rule: Rule
) -> tuple[float, float]:
    """∫ y cos θ dt and ∫ y'² dt over h seconds of a flight, in panels of equal length."""
    half = 0.5 * h / panels
    y_cos, v2 = 0.0, 0.0
    for panel in range(panels):
        centre = (2 * panel + 1) * half
        for node, weight in rule:
            y, v, sin_drive, cos_drive = flow(o, flight, centre + half * node)
            y_cos += weight * y * (cos0 * cos_drive - sin0 * sin_drive)
            v2 += weight * v * v
    return y_cos * half, v2 * half


@subroutine
def _closed_form(
    o: Oscillator, flight: Flight, motion: Motion, arrival: Motion, h: float
) -> tuple[float, float]:
    """∫ y cos θ dt and ∫ y'² dt over h seconds of a flight, from its two ends."""
    sigma, w2, Omega = o.decay_1_s, o.stiffness_1_s2, o.drive_rad_s
    P, R = o.steady_sin_m, o.steady_cos_m  # steady motion P sin θ + R cos θ
    sin0, cos0, sin1, cos1 = motion.sin_crank, motion.cos_crank, arrival.sin_crank, arrival.cos_crank
    z0 = (motion.y_m - flight.offset_m) - (P * sin0 + R * cos0)
    u0 = motion.v_m_s - Omega * (P * cos0 - R * sin0)
    z1 = (arrival.y_m - flight.offset_m) - (P * sin1 + R * cos1)
    u1 = arrival.v_m_s - Omega * (P * cos1 - R * sin1)
    free = -(0.5 * (u1 - u0) * (u1 + u0) + 0.5 * w2 * (z1 - z0) * (z1 + z0))
    zz = free / (2.0 * sigma) if sigma > 0.0 else 0.0  # ∫ z'² dt, used times σ only
    if Omega == 0.0:
        return 0.0, zz  # the drive stands: ∫ y cos θ is multiplied by 0

    # ∫ z cos θ = Zc and ∫ z sin θ = Zs from z'' + 2σ z' + ω² z = 0 by parts:
    #   (ω² − Ω²) Zc + 2σΩ Zs = −[z' cos θ + Ω z sin θ + 2σ z cos θ]
    #   (ω² − Ω²) Zs − 2σΩ Zc = −[z' sin θ − Ω z cos θ + 2σ z sin θ]
    zc, zs = z1 * cos1 - z0 * cos0, z1 * sin1 - z0 * sin0
    right_c = -((u1 * cos1 - u0 * cos0) + Omega * zs + 2.0 * sigma * zc)
    right_s = -((u1 * sin1 - u0 * sin0) - Omega * zc + 2.0 * sigma * zs)
    detune, drag = w2 - Omega * Omega, 2.0 * sigma * Omega
    size = detune * detune + drag * drag
    Zc = (detune * right_c - drag * right_s) / size
    Zs = (detune * right_s + drag * right_c) / size
    # ∫ z' cos θ = [z cos θ] + Ω Zs,  ∫ z' sin θ = [z sin θ] − Ω Zc
    Uc, Us = zc + Omega * Zs, zs - Omega * Zc
    # ∫ cos² θ, ∫ sin² θ, ∫ sin θ cos θ
    quarter = (sin1 * cos1 - sin0 * cos0) / (2.0 * Omega)
    cc, ss = 0.5 * h + quarter, 0.5 * h - quarter
    sc = (sin1 - sin0) * (sin1 + sin0) / (2.0 * Omega)
    y_cos = P * sc + R * cc + Zc + flight.offset_m * (sin1 - sin0) / Omega
    steady2 = Omega * Omega * (P * P * cc + R * R * ss - 2.0 * P * R * sc)
    v2 = steady2 + 2.0 * Omega * (P * Uc - R * Us) + zz
    return y_cos, max(v2, 0.0)
