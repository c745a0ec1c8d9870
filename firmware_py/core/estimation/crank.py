"""Angle and speed of the crank: a critically damped g-h-k tracker on the encoder.

Source: Zarchan & Musoff, Fundamentals of Kalman Filtering, ch. 1 (fading-memory filter of third order). The
commanded torque and the estimated load of the crank enter as a known acceleration, so that the tracker lags
only behind the unknown part of the acceleration, which is the third state. Differences of angles are wrapped,
so the encoder may count on or start again after each turn.
"""

from typing import NamedTuple

from firmware_py.core.elementary import exp
from firmware_py.core.inputs import EncoderInput
from firmware_py.core.numbers import TAU, clamp, fraction, wrap_pi, wrap_two_pi
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.generated.parameters import Motor, Parameters
from firmware_py.interface.zeroed import zeroed

FASTEST_RAD_S = 1000.0
"""Largest plausible speed: 25 times the motor's limit."""

LARGEST_RAD_S2 = 1e5
"""Largest plausible acceleration."""
LATEST_TICKS = 10
"""Largest age of a late reading; a reading that lags by more is wrong, and a longer gap is a fault."""
EARLIEST_TICKS = -1
"""Least age: the tick itself was late, and the reading of the next one has arrived in it, too."""
LASTING_TICKS = 2500
"""Late readings in surplus after which the age is one less: none is late, but the clocks have drifted apart.
Clocks that differ by 0.02 % drift by a tick in twice this time."""


class Tracker(NamedTuple):
    """A tracker's triple pole, its g, h and k of a tick, and the largest disturbance."""

    bandwidth_rad_s: float
    gains: tuple[float, float, float]
    largest_rad_s2: float


class Constants(NamedTuple):
    """`tracker`: that of the control, by tuning parameters; the monitors have another one (`own_crank`)."""

    tick_s: float
    zero_rad: float
    motor: Motor
    torque_limit_n_m: float
    tracker: Tracker


class CrankState(NamedTuple):
    """The crank at the time of the newest sensor sample. θ in [0, 2π): the piston's position is A sin θ.

    `late_ticks`: estimated age of the newest reading when it arrived; `lasting_ticks`: the number of late
    readings less that of timely ones, since it was 0 or the age was last taken for drift.
    """

    angle_rad: float
    omega_rad_s: float
    disturbance_rad_s2: float
    missed_ticks: int
    late_ticks: int
    lasting_ticks: int


class Turned(NamedTuple):
    """A reading of the encoder for the trackers; `frames`: those of its tick, 0 without a usable reading."""

    angle_rad: float
    omega_rad_s: float
    frames: int


INITIAL = zeroed(CrankState, missed_ticks=NEVER_TICKS)


def critically_damped_gains(bandwidth_rad_s: float, tick_s: float) -> tuple[float, float, float]:
    """g, h, k of the third-order fading-memory filter with a triple pole (Zarchan & Musoff, table 1.5)."""
    pole = exp(-bandwidth_rad_s * tick_s)
    rest = 1.0 - pole
    return 1.0 - pole * pole * pole, 1.5 * rest * rest * (1.0 + pole), 0.5 * rest * rest * rest


def tracker_of(bandwidth_rad_s: float, largest_rad_s2: float, tick_s: float) -> Tracker:
    """The constants of a tracker."""
    return Tracker(bandwidth_rad_s, critically_damped_gains(bandwidth_rad_s, tick_s), largest_rad_s2)


def derive(p: Parameters) -> Constants:
    """The constants of these parameters."""
    tracker = tracker_of(p.crank.bandwidth_rad_s, p.crank.largest_disturbance_rad_s2, p.control.tick_s)
    return Constants(p.control.tick_s, p.crank.zero_rad, p.motor, p.speed.torque_limit_n_m, tracker)


def known_acceleration(own: Constants, acting_n_m: float, crank: CrankState, load_n_m: float) -> float:
    """The known part of the crank's acceleration over the tick that ended with the newest sample, rad/s².

    `acting_n_m` is the torque that acted during that tick, `load_n_m` the striker's load that opposed it.
    """
    motor = own.motor
    losses_n_m = motor.viscous_n_m_s * crank.omega_rad_s
    if crank.omega_rad_s > 0.2:
        losses_n_m += motor.dry_n_m
    elif crank.omega_rad_s < -0.2:
        losses_n_m -= motor.dry_n_m
    elif abs(acting_n_m) < 2.0 * motor.dry_n_m:
        return 0.0
    known = (acting_n_m - losses_n_m - load_n_m) / motor.inertia_kg_m2
    return clamp(known, min(2.0 * own.torque_limit_n_m / motor.inertia_kg_m2, LARGEST_RAD_S2))


def estimate_age(state: CrankState, frames: int, way_rad: float, innovation_rad: float) -> int:
    """Estimated age of a reading, in ticks; the encoder's frame carries no time.

    It is the age that best explains how far the reading lags, if the crank turns by `way_rad` per tick. The
    number of frames that are still to come bounds it: those that were to come after the previous reading, and
    one for each tick since, less the tick's `frames`. If too many have come, the tick itself was late.
    """
    to_come = state.late_ticks + state.missed_ticks + 1 - frames
    if to_come == 0:
        return 0
    behind_rad = -innovation_rad if way_rad >= 0.0 else innovation_rad
    behind_ticks = behind_rad / max(abs(way_rad), 1e-9)
    if to_come < 0:
        return EARLIEST_TICKS if behind_ticks < 0.5 * EARLIEST_TICKS else 0
    return int(max(min(behind_ticks, float(min(to_come, LATEST_TICKS))), 0.0) + 0.5)


def read(own: Constants, encoder: EncoderInput) -> Turned:
    """The encoder's reading as angle and speed of the crank."""
    if encoder.age_ticks == 0 and abs(encoder.position_rev) < 1e6 and abs(encoder.velocity_rev_s) < 1e4:
        angle_rad = TAU * fraction(encoder.position_rev) - own.zero_rad
        return Turned(angle_rad, TAU * encoder.velocity_rev_s, encoder.frames)
    return Turned(0.0, 0.0, 0)


def step(own: Constants, state: CrankState, turned: Turned, known_acceleration_rad_s2: float) -> CrankState:
    """One tick: predict, then correct by a fresh reading of the encoder, if any."""
    if state.missed_ticks >= NEVER_TICKS:
        if turned.frames == 0:
            return state
        omega_rad_s = clamp(turned.omega_rad_s, FASTEST_RAD_S)
        return INITIAL._replace(
            angle_rad=wrap_two_pi(turned.angle_rad), omega_rad_s=omega_rad_s, missed_ticks=0
        )

    T = own.tick_s
    a = known_acceleration_rad_s2 + state.disturbance_rad_s2
    angle_rad = state.angle_rad + state.omega_rad_s * T + 0.5 * a * T * T
    omega_rad_s = state.omega_rad_s + a * T
    if turned.frames == 0:
        return state._replace(
            angle_rad=wrap_two_pi(angle_rad),
            omega_rad_s=clamp(omega_rad_s, FASTEST_RAD_S),
            missed_ticks=min(state.missed_ticks + 1, NEVER_TICKS - 1),
        )
    innovation_rad = wrap_pi(turned.angle_rad - angle_rad)
    late_ticks = estimate_age(state, turned.frames, omega_rad_s * T, innovation_rad)
    lasting_ticks = max(state.lasting_ticks - 1, 0)
    if late_ticks != 0:
        innovation_rad = wrap_pi(turned.angle_rad + late_ticks * omega_rad_s * T - angle_rad)
        lasting_ticks = state.lasting_ticks + 1
        if lasting_ticks >= LASTING_TICKS:
            drift_ticks = 1 if late_ticks > 0 else -1
            angle_rad -= drift_ticks * omega_rad_s * T
            late_ticks -= drift_ticks
            lasting_ticks = 0
    tracker = own.tracker
    g, h, k = tracker.gains
    if state.missed_ticks > 0 or late_ticks > 0:
        # A reading after missed ones covers the whole time since then: the same bandwidth with a longer T.
        # Late readings are extrapolated by the estimated speed, which feeds the error of that speed back: the
        # bandwidth must be lower.
        late_s = max(late_ticks, 0) * T
        T = (state.missed_ticks + 1) * T
        bandwidth_rad_s = tracker.bandwidth_rad_s
        g, h, k = critically_damped_gains(bandwidth_rad_s / (1.0 + bandwidth_rad_s * late_s), T)
    # θ += g e, ω += h e / T, a += 2 k e / T²
    return CrankState(
        wrap_two_pi(angle_rad + g * innovation_rad),
        clamp(omega_rad_s + h * innovation_rad / T, FASTEST_RAD_S),
        clamp(state.disturbance_rad_s2 + 2.0 * k * innovation_rad / (T * T), tracker.largest_rad_s2),
        0,
        late_ticks,
        lasting_ticks,
    )
