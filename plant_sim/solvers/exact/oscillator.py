"""The striker between two events, in closed form.

    y'' + 2σ y' + ω² (y − A sin θ) = −s μ g,   θ' = Ω,   y = x − l0

with σ = b / 2m, ω² = c / m and s the direction of sliding. Linear oscillator theory (e.g. Meirovitch,
Fundamentals of Vibrations, ch. 2–3): the free part is spanned by

    C = L⁻¹[(p + 2σ)/(p² + 2σ p + ω²)],   S = L⁻¹[1/(p² + 2σ p + ω²)],   C' = −ω² S,   S' = C − 2σ S = D

each written so that it stays accurate through critical damping. The forced part is the steady one away from
resonance. There the steady amplitude dwarfs the motion and would cancel, so near it the response from rest

    ω² A Im{e^(iθ0) Q(h)},   Q = exp[λ1, λ2, iΩ](h),   λ1,2 = −σ ± iν

is used, a divided difference of the exponential taken by expm1 and sin, which is regular at λ1 = iΩ.
"""

import math
from typing import NamedTuple

from plant_sim.kernels import jit, subroutine
from plant_sim.parts.drive import Drive, constant_speed_rad_s
from plant_sim.parts.friction import Friction, damping_n_s_m, is_dry, static_limit_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import Stop, has_no_stop, restitution, stop_position_m
from plant_sim.parts.striker import Striker
from plant_sim.solvers.double_double import quotient, square_root, turn_by, two_product

RESONANT_GAIN = 40.0
"""Ratio of steady amplitude to A above which the steady motion is not used, because cancellation loses
digits."""

REMAINDER = 1.0 / (2.0 * 35.0 * 40320.0)
"""Largest error of Hermite's interpolant over a span h, divided by the 8th derivative times h⁸."""

LONGEST_RAD, SHARE = 3.2, 1e-2
"""Longest span in which an event is looked for: the angle over ω, and the interpolant's error of position, as
a share of gap and piston stroke."""

LEAST_LENGTH_M = 1e-100
"""A stroke or a length of dry friction below this counts as 0, since its square would vanish."""

LONG_ANGLE_RAD = 32.0  # beyond this an angle is reduced in two floats


class Oscillator(NamedTuple):
    """Constants of one scene."""

    is_dry: bool
    has_stop: bool
    mass_kg: float
    spring_n_per_m: float
    amplitude_m: float
    drive_rad_s: float  # Ω
    stiffness_1_s2: float  # ω²
    natural_rad_s: float  # ω
    decay_1_s: float  # σ
    ringing_rad_s: float  # ν = √(ω² − σ²), 0 from critical damping on
    ringing_low_rad_s: float
    split_1_s: float  # δ = √(σ² − ω²), 0 up to critical damping
    dry_offset_m: float  # μ g / ω²: dry friction as a shift of the spring
    gap_m: float  # x_stop − l0
    restitution: float
    steady_sin_m: float  # steady motion = steady_sin_m sin θ + steady_cos_m cos θ
    steady_cos_m: float
    steady_m: float  # its amplitude
    resonant: bool
    beat_rad_s: float  # Ω − ν
    coincident: bool  # λ1 = iΩ
    near_re_s: float  # 1 / (iΩ − λ1)
    near_im_s: float
    far_re_s: float  # 1 / (iΩ − λ2)
    far_im_s: float
    fastest_1_s: float  # the n-th derivative of the motion scales with at most its n-th power
    span_s: float  # longest span in which a flight's event is looked for


class Flight(NamedTuple):
    """Constants of one flight, fixed at its start."""

    free_m: float  # free part and its rate at the start
    free_m_s: float
    offset_m: float  # −s μ g / ω²
    forced_sin: float  # forced part's weights of sin Ωh and cos Ωh (at resonance: of Im Q and Re Q)
    forced_cos: float
    piston_sin_m: float  # x_A = piston_sin_m sin Ωh + piston_cos_m cos Ωh
    piston_cos_m: float


@jit
def oscillator(parts: Parts) -> Oscillator:
    """Constants of a scene with an ideal drive."""
    Omega = constant_speed_rad_s(parts.drive)
    return oscillator_of(parts.striker, parts.drive, parts.friction, parts.stop, Omega)


@subroutine
def oscillator_of(striker: Striker, drive: Drive, friction: Friction, stop: Stop, Omega: float) -> Oscillator:
    """Constants of these parts at the drive's speed Ω, rad/s."""
    w2, w2_low = quotient(striker.spring_n_per_m, striker.mass_kg)
    amplitude_m = _length_m(drive.amplitude_m)
    dry_m = _length_m(static_limit_n(friction, striker.gravity_m_s2) / w2)
    w, _w_low = square_root(w2, w2_low)
    sigma, sigma_low = quotient(damping_n_s_m(friction), 2.0 * striker.mass_kg)
    square, square_low = two_product(sigma, sigma)
    spread, spread_low = w2 - square, (w2_low - square_low) - 2.0 * sigma * sigma_low
    spread_low += (w2 - spread) - square  # rounding error of the difference
    nu, nu_low, split = 0.0, 0.0, 0.0
    if spread + spread_low > 0.0:
        nu, nu_low = square_root(spread, spread_low)
    elif spread + spread_low < 0.0:
        split = math.sqrt(-(spread + spread_low))

    # Steady motion: A Im{ω² e^(iθ) / (ω² − Ω² + 2iσΩ)}
    square, square_low = two_product(Omega, Omega)
    detune = (w2 - square) + (w2_low - square_low)
    drag = 2.0 * sigma * Omega
    modulus = max(math.hypot(detune, drag), 1e-280)
    gain = w2 / modulus
    in_phase, quadrature = gain * (detune / modulus), -gain * (drag / modulus)
    resonant = not gain < RESONANT_GAIN
    beat, total = (Omega - nu) - nu_low, Omega + nu
    near, far = sigma * sigma + beat * beat, sigma * sigma + total * total

    return Oscillator(
        is_dry=is_dry(friction),
        has_stop=not has_no_stop(stop),
        mass_kg=striker.mass_kg,
        spring_n_per_m=striker.spring_n_per_m,
        amplitude_m=amplitude_m,
        drive_rad_s=Omega,
        stiffness_1_s2=w2,
        natural_rad_s=w,
        decay_1_s=sigma,
        ringing_rad_s=nu,
        ringing_low_rad_s=nu_low,
        split_1_s=split,
        dry_offset_m=dry_m,
        gap_m=stop_position_m(stop) - striker.rest_length_m,
        restitution=restitution(stop),
        steady_sin_m=amplitude_m * in_phase,
        steady_cos_m=amplitude_m * quadrature,
        steady_m=abs(amplitude_m) * gain,
        resonant=resonant,
        beat_rad_s=beat,
        coincident=not near > 0.0,
        near_re_s=sigma / near,
        near_im_s=-beat / near,
        far_re_s=sigma / far,
        far_im_s=-total / far,
        fastest_1_s=max(w, Omega, 2.0 * sigma),
        span_s=_longest_span_s(w, w2, Omega, abs(amplitude_m), stop_position_m(stop) - striker.rest_length_m),
    )


@subroutine(inline=True)
def _length_m(length_m: float) -> float:
    return length_m if abs(length_m) >= LEAST_LENGTH_M else 0.0


@subroutine
def _longest_span_s(w: float, w2: float, Omega: float, amplitude_m: float, gap_m: float) -> float:
    """The span of LONGEST_RAD, or a shorter one with which a fast drive keeps to SHARE."""
    length = amplitude_m + (abs(gap_m) if math.isfinite(gap_m) else 0.0)
    driven = amplitude_m / length if length > 0.0 else 0.0
    eighth = w2 * (w2 * w2 * w2 + Omega**6 * driven)  # per length, which may be the least there is
    span = LONGEST_RAD / w
    if eighth > 0.0:
        span = min(span, math.sqrt(math.sqrt(math.sqrt(SHARE / (REMAINDER * eighth)))))
    return span


@subroutine
def launch(
    o: Oscillator, y_m: float, v_m_s: float, sin_crank: float, cos_crank: float, direction: float
) -> Flight:
    """The flight from a state, sliding in a direction (±1, 0 without dry friction)."""
    A = o.amplitude_m
    offset = -direction * o.dry_offset_m
    if o.resonant:
        force = o.stiffness_1_s2 * A
        forced_sin, forced_cos = force * cos_crank, force * sin_crank
        free_m, free_m_s = y_m - offset, v_m_s
    else:
        forced_sin = o.steady_sin_m * cos_crank - o.steady_cos_m * sin_crank
        forced_cos = o.steady_sin_m * sin_crank + o.steady_cos_m * cos_crank
        free_m, free_m_s = (y_m - offset) - forced_cos, v_m_s - o.drive_rad_s * forced_sin
    return Flight(free_m, free_m_s, offset, forced_sin, forced_cos, A * cos_crank, A * sin_crank)


@subroutine
def _free_response(
    o: Oscillator, h: float, sin_ringing: float, cos_ringing: float
) -> tuple[float, float, float]:
    """C, S and D after h seconds, given the sine and cosine of ν h."""
    sigma = o.decay_1_s
    if o.ringing_rad_s > 0.0:
        decay = math.exp(-sigma * h)
        S = decay * sin_ringing / o.ringing_rad_s
        return decay * cos_ringing + sigma * S, S, decay * cos_ringing - sigma * S
    # α = σ − δ = ω² / (σ + δ) and β = σ + δ: no difference of close numbers
    delta = o.split_1_s
    beta = sigma + delta
    alpha = o.stiffness_1_s2 / beta
    slow = math.exp(-alpha * h)
    drop = math.expm1(-2.0 * delta * h)
    S = slow * (h if delta == 0.0 else -drop / (2.0 * delta))
    mean = 0.5 * slow * (2.0 + drop)
    if delta > 0.5 * sigma:
        return mean + sigma * S, S, slow * (beta * math.exp(-2.0 * delta * h) - alpha) / (2.0 * delta)
    return mean + sigma * S, S, mean - sigma * S


@subroutine
def _resonant_flow(o: Oscillator, flight: Flight, h: float) -> tuple[float, float, float, float]:
    """`flow` near resonance: the free motion from the whole start, and the response from rest."""
    sigma, nu, Omega = o.decay_1_s, o.ringing_rad_s, o.drive_rad_s
    sin_ringing, cos_ringing = _sin_cos(nu, o.ringing_low_rad_s, h)
    sin_half, cos_half = _sin_cos(0.5 * o.beat_rad_s, 0.0, h)
    sin_beat, vers_beat = 2.0 * sin_half * cos_half, 2.0 * sin_half * sin_half
    sin_drive = sin_ringing + (cos_ringing * sin_beat - sin_ringing * vers_beat)
    cos_drive = cos_ringing - (sin_ringing * sin_beat + cos_ringing * vers_beat)
    drop = math.expm1(-sigma * h)
    decay = 1.0 + drop
    S = decay * sin_ringing / nu
    C, D = decay * cos_ringing + sigma * S, decay * cos_ringing - sigma * S

    # q1 = exp[λ1, iΩ] = e^(iΩh) (1 − e^(−εh)) / ε,  ε = iΩ − λ1 = σ + i (Ω − ν)
    loss_re, loss_im = decay * vers_beat - drop, decay * sin_beat
    if o.coincident:
        near_re, near_im = h, 0.0
    else:
        near_re = loss_re * o.near_re_s - loss_im * o.near_im_s
        near_im = loss_re * o.near_im_s + loss_im * o.near_re_s
    q1_re = cos_drive * near_re - sin_drive * near_im
    q1_im = cos_drive * near_im + sin_drive * near_re
    # q2 = exp[λ2, iΩ] = (e^(iΩh) − e^(λ2 h)) / (iΩ − λ2)
    step_re, step_im = cos_drive - decay * cos_ringing, sin_drive + decay * sin_ringing
    q2_re = step_re * o.far_re_s - step_im * o.far_im_s
    q2_im = step_re * o.far_im_s + step_im * o.far_re_s
    # Q = (q1 − q2) / (λ1 − λ2),  Q' = iΩ Q + exp[λ1, λ2];  forced part = ω² A (sin θ0 Re Q + cos θ0 Im Q)
    Q_re, Q_im = (q1_im - q2_im) * (0.5 / nu), (q2_re - q1_re) * (0.5 / nu)
    y = flight.free_m * C + flight.free_m_s * S
    v = flight.free_m_s * D - o.stiffness_1_s2 * flight.free_m * S
    y += flight.forced_cos * Q_re + flight.forced_sin * Q_im
    v += flight.forced_cos * (S - Omega * Q_im) + flight.forced_sin * (Omega * Q_re)
    return y + flight.offset_m, v, sin_drive, cos_drive


@subroutine
def _sin_cos(rate: float, rate_low: float, h: float) -> tuple[float, float]:
    """Sine and cosine of an angle that grows at a rate; a long one is reduced in two floats."""
    angle = rate * h
    if abs(angle) > LONG_ANGLE_RAD:
        angle, _ = turn_by(0.0, 0.0, rate, rate_low, h)
    return math.sin(angle), math.cos(angle)


@subroutine
def free_flow(o: Oscillator, h: float) -> tuple[float, float, float]:
    """C, S and D after h seconds; the flow's derivative by its start is [[C, S], [−ω² S, D]]."""
    sin_ringing, cos_ringing = _sin_cos(o.ringing_rad_s, o.ringing_low_rad_s, h)
    return _free_response(o, h, sin_ringing, cos_ringing)


@subroutine
def flow(o: Oscillator, flight: Flight, h: float) -> tuple[float, float, float, float]:
    """y and y' h seconds into a flight, with the sine and cosine of Ω h."""
    if o.resonant:
        return _resonant_flow(o, flight, h)
    sin_ringing, cos_ringing = _sin_cos(o.ringing_rad_s, o.ringing_low_rad_s, h)
    sin_drive, cos_drive = _sin_cos(o.drive_rad_s, 0.0, h)
    C, S, D = _free_response(o, h, sin_ringing, cos_ringing)
    y = flight.free_m * C + flight.free_m_s * S
    v = flight.free_m_s * D - o.stiffness_1_s2 * flight.free_m * S
    y += flight.forced_sin * sin_drive + flight.forced_cos * cos_drive
    v += o.drive_rad_s * (flight.forced_sin * cos_drive - flight.forced_cos * sin_drive)
    return y + flight.offset_m, v, sin_drive, cos_drive


class Point(NamedTuple):
    """One instant of a flight, `h_s` after its start, with the motion's time derivatives."""

    h_s: float
    y_m: float
    overlap_m: float  # y − gap; of a short bounce it keeps digits that y loses
    v_m_s: float
    a_m_s2: float
    jerk_m_s3: float
    snap_m_s4: float
    crackle_m_s5: float
    piston_m: float  # x_A = A sin θ
    piston_cos_m: float  # A cos θ


@subroutine
def point(
    o: Oscillator, flight: Flight, h: float, y: float, v: float, sin_drive: float, cos_drive: float
) -> Point:
    """The point `h` seconds into a flight, given y, y' and the sine and cosine of Ω h."""
    x_A = flight.piston_sin_m * sin_drive + flight.piston_cos_m * cos_drive
    x_cos = flight.piston_sin_m * cos_drive - flight.piston_cos_m * sin_drive
    return with_derivatives(o, flight.offset_m, h, y, y - o.gap_m, v, x_A, x_cos)


@subroutine
def with_derivatives(
    o: Oscillator, offset: float, h: float, y: float, overlap: float, v: float, x_A: float, x_cos: float
) -> Point:
    """The point with its derivatives, from the equation of motion and that equation's time derivatives."""
    drag, w2, Omega = 2.0 * o.decay_1_s, o.stiffness_1_s2, o.drive_rad_s
    v_A = Omega * x_cos
    a = -drag * v - w2 * ((y - offset) - x_A)
    jerk = -drag * a - w2 * (v - v_A)
    snap = -drag * jerk - w2 * (a + Omega * Omega * x_A)
    crackle = -drag * snap - w2 * (jerk + Omega * Omega * v_A)
    return Point(h, y, overlap, v, a, jerk, snap, crackle, x_A, x_cos)
