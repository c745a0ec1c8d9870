"""Identification of spring and friction from the free flights between impacts.

    z = −(1 + p) (c/m) (x − l0 − x_A) − (1 + f) R(x') + b,   R = (b/m) x' + μ g sign x'

p and f are the relative errors of the nominal spring and friction. The integrals of the accelerometer give x
over a flight, except for x and x' at its start and the sensor's bias. Their effect is a parabola in time, and
so is the effect of an error of l0. Therefore a parabola is eliminated from all terms by least squares, and
the remainder depends only on p and f (partial regression: Frisch & Waugh, Econometrica 1:387, 1933). The
estimator's x is not used, so feeding p and f to the estimator closes no loop.

Flights are summed with exponential forgetting over `memory` flights. Each new flight first tests the previous
p and f: only if they have explained new flights better than the parameters do, they are fed to the estimator,
in small steps and within bounds.
"""

from typing import NamedTuple

from firmware_py.core.elementary import sin
from firmware_py.core.estimation.estimator_state import Contact, EstimatorState
from firmware_py.core.estimation.striker_model import NominalStriker
from firmware_py.core.numbers import clamp
from firmware_py.core.records import zeroed

SAMPLE_TICKS = 10
"""One reading in this many is a sample of the regression; the integrals use all readings."""

FEWEST_SAMPLES = 15

SLOWEST_M_S = 0.05
"""Speed below which the sign of x' is uncertain on a dry guide."""

FEWEST_FLIGHTS = 5
"""Flights before p and f are fed to the estimator; a single flight gives p to 1 %."""
LARGEST_SPRING = 0.1
"""Largest p: 10 % of c, 5 % of the natural frequency."""
LARGEST_FRICTION = 0.5
"""Largest f; b is known to +-30 %, mu to +-10 %."""
NOISE_M_S2 = 0.03
"""Noise of a sample, of the sensor and of its integral."""
SPRING_STD = 0.03
"""Standard deviation of p before the first flight."""
FRICTION_STD = 0.3
"""Standard deviation of f before the first flight."""
LARGEST_RESIDUAL_M_S2 = 0.5
"""Largest RMS residual; a flight beyond it, with another force, is left out."""


class IdentifyConfig(NamedTuple):
    """`prior_…`: information on p and f before the first flight, relative to the noise.

    `feeds`: p and f are fed to the estimator's model; else they are only reported.
    """

    enabled: bool
    feeds: bool
    tick_s: float
    delay_s: float
    memory: float
    spring_step: float
    friction_step: float
    prior_spring: float
    prior_friction: float


class Sample(NamedTuple):
    """One reading at `t_s` in the flight: −(c/m) (x − l0 − x_A), −R, and z minus the model, all in m/s²."""

    t_s: float
    spring: float
    friction: float
    off: float


class Sums(NamedTuple):
    """Sums over a flight's samples: powers of t, and products of spring a, friction f and off y (q = t²)."""

    n: float
    t: float
    t2: float
    t3: float
    t4: float
    a: float
    f: float
    y: float
    ta: float
    tf: float
    ty: float
    qa: float
    qf: float
    qy: float
    aa: float
    af: float
    ff: float
    ay: float
    fy: float
    yy: float


class Normal(NamedTuple):
    """The normal equations of p and f without a parabola, of one flight or of many."""

    aa: float
    af: float
    ff: float
    ay: float
    fy: float


class IdentifyState(NamedTuple):
    """`spring` and `friction` are p and f; `gain` is their reduction of Σ y² in new flights, (m/s²)²."""

    pending: Sample
    has_pending: bool
    sums: Sums
    normal: Normal
    flights: int
    gain: float
    spring: float
    friction: float


_NO_SAMPLE = zeroed(Sample)
_NO_SUMS = zeroed(Sums)

INITIAL = zeroed(IdentifyState)


def _added(s: Sums, sample: Sample) -> Sums:
    t, a, f, y = sample.t_s, sample.spring, sample.friction, sample.off
    q = t * t
    return Sums(
        s.n + 1.0,
        s.t + t,
        s.t2 + q,
        s.t3 + q * t,
        s.t4 + q * q,
        s.a + a,
        s.f + f,
        s.y + y,
        s.ta + t * a,
        s.tf + t * f,
        s.ty + t * y,
        s.qa + q * a,
        s.qf + q * f,
        s.qy + q * y,
        s.aa + a * a,
        s.af + a * f,
        s.ff + f * f,
        s.ay + a * y,
        s.fy + f * y,
        s.yy + y * y,
    )


def without_parabola(s: Sums) -> tuple[Normal, float]:
    """The normal equations with 1, t and t² eliminated one after another, and the remainder of Σ y²."""
    # 1
    tt, tq, qq = s.t2 - s.t * s.t / s.n, s.t3 - s.t * s.t2 / s.n, s.t4 - s.t2 * s.t2 / s.n
    ta, tf, ty = s.ta - s.t * s.a / s.n, s.tf - s.t * s.f / s.n, s.ty - s.t * s.y / s.n
    qa, qf, qy = s.qa - s.t2 * s.a / s.n, s.qf - s.t2 * s.f / s.n, s.qy - s.t2 * s.y / s.n
    aa, af, ay = s.aa - s.a * s.a / s.n, s.af - s.a * s.f / s.n, s.ay - s.a * s.y / s.n
    ff, fy, yy = s.ff - s.f * s.f / s.n, s.fy - s.f * s.y / s.n, s.yy - s.y * s.y / s.n
    # t
    qq -= tq * tq / tt
    qa, qf, qy = qa - tq * ta / tt, qf - tq * tf / tt, qy - tq * ty / tt
    aa, af, ay = aa - ta * ta / tt, af - ta * tf / tt, ay - ta * ty / tt
    ff, fy, yy = ff - tf * tf / tt, fy - tf * ty / tt, yy - ty * ty / tt
    # t²
    left = Normal(
        aa - qa * qa / qq, af - qa * qf / qq, ff - qf * qf / qq, ay - qa * qy / qq, fy - qf * qy / qq
    )
    return left, yy - qy * qy / qq


def solved(config: IdentifyConfig, normal: Normal) -> tuple[float, float]:
    """p and f, bounded; while the flights contain little information, the prior keeps them near 0."""
    aa, ff = normal.aa + config.prior_spring, normal.ff + config.prior_friction
    determinant = aa * ff - normal.af * normal.af
    if not determinant > 0.0:
        return 0.0, 0.0
    spring = (normal.ay * ff - normal.fy * normal.af) / determinant
    friction = (normal.fy * aa - normal.ay * normal.af) / determinant
    return clamp(spring, LARGEST_SPRING), clamp(friction, LARGEST_FRICTION)


def sample_of(
    config: IdentifyConfig,
    striker: NominalStriker,
    estimate: EstimatorState,
    angle_rad: float,
    omega_rad_s: float,
) -> Sample:
    """The newest reading and the nominal model at the flight's own x, both with the delay of the low-pass."""
    flight = estimate.flight
    crank_m = striker.amplitude_m * sin(angle_rad - omega_rad_s * config.delay_s)
    late_m = flight.x_m - flight.v_m_s * config.delay_s
    spring = -striker.stiffness_1_s2 * (late_m - striker.rest_length_m - crank_m)
    dry_m_s2 = striker.dry_m_s2 if estimate.v_m_s > 0.0 else -striker.dry_m_s2
    friction = -(striker.damping_1_s * flight.v_m_s + dry_m_s2)
    return Sample(
        flight.ticks * config.tick_s,
        spring,
        friction,
        estimate.sensor.acceleration_m_s2 - spring - friction,
    )


def _sampled(state: IdentifyState, sample: Sample, usable: bool, begins: bool) -> IdentifyState:
    """Add the pending sample to the sums, as no impact has followed it, and keep the new one pending."""
    sums = _NO_SUMS if begins else state.sums
    if state.has_pending and not begins:
        sums = _added(sums, state.pending)
    return state._replace(pending=sample, has_pending=usable, sums=sums)


def _flown(config: IdentifyConfig, state: IdentifyState) -> IdentifyState:
    """Update p and f at a touch-down, if the flight had enough samples and a small residual."""
    normal, flights, gain = state.normal, state.flights, state.gain
    spring, friction = state.spring, state.friction
    if state.sums.n >= FEWEST_SAMPLES:
        new, rest = without_parabola(state.sums)
        if rest < state.sums.n * LARGEST_RESIDUAL_M_S2 * LARGEST_RESIDUAL_M_S2:
            keep = 1.0 - 1.0 / config.memory
            better = 2.0 * (spring * new.ay + friction * new.fy) - (
                spring * spring * new.aa + 2.0 * spring * friction * new.af + friction * friction * new.ff
            )
            gain = keep * gain + better
            normal = Normal(
                keep * normal.aa + new.aa,
                keep * normal.af + new.af,
                keep * normal.ff + new.ff,
                keep * normal.ay + new.ay,
                keep * normal.fy + new.fy,
            )
            flights = min(flights + 1, 1_000_000)
            spring, friction = solved(config, normal)
    return IdentifyState(_NO_SAMPLE, False, _NO_SUMS, normal, flights, gain, spring, friction)


def towards(
    config: IdentifyConfig, state: IdentifyState, holding: bool, estimate: EstimatorState
) -> EstimatorState:
    """The estimate with its model a step nearer to p and f; to the nominal model if they are not trusted."""
    corrects = holding and trusted(config, state)
    to_spring, to_friction = (state.spring, state.friction) if corrects else (0.0, 0.0)
    spring = estimate.spring_share + clamp(to_spring - estimate.spring_share, config.spring_step)
    friction = estimate.friction_share + clamp(to_friction - estimate.friction_share, config.friction_step)
    return estimate._replace(spring_share=spring, friction_share=friction)


def trusted(config: IdentifyConfig, state: IdentifyState) -> bool:
    """Whether p and f have explained new flights better than the parameters do."""
    return config.feeds and state.flights >= FEWEST_FLIGHTS and state.gain > 0.0


def step(
    config: IdentifyConfig,
    striker: NominalStriker,
    state: IdentifyState,
    estimate: EstimatorState,
    holding: bool,
    contact: Contact,
    angle_rad: float,
    omega_rad_s: float,
) -> IdentifyState:
    """One tick; called only in ticks in which a sample is due or a contact begins."""
    if contact.touch_down:
        return _flown(config, state)
    ticks = estimate.flight.ticks
    if ticks < 0 or ticks % SAMPLE_TICKS != 0 or not holding:
        return state
    usable = striker.dry_m_s2 <= 0.0 or abs(estimate.v_m_s) > SLOWEST_M_S
    sample = sample_of(config, striker, estimate, angle_rad, omega_rad_s)
    return _sampled(state, sample, usable, ticks == 0)
