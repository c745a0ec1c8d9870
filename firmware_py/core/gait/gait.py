"""The phase of the gait cycle, from heel strike to heel strike, and the confidence in it.

The phase is the time since the last heel strike, divided by the expected duration T of the stride. Three more
events of a stride (toe down, heel off, toe off) occur at phases φ_k that are learnt from earlier strides.
Each event, at the time t_k, corrects T, and the phase with it, by a scalar Kalman gain:

    g = P / (P + (σ_k² + σ_t²)/φ_k²)      T ← T + g (t_k/φ_k − T)      P ← (1 − g) P

with P the variance of a stride about its expectation, and σ_k² and σ_t² the variances of the event's phase
and of its timing. If a heel strike does not come, its switch has missed it: the cycle continues without it,
and the learnt values stay. The shank's rate shows two conditions that the switches cannot show: whether the
leg has swung since its last heel strike, and whether it is at rest.

The alternative was an adaptive oscillator on the shank's rate (Ronsse et al., Med. Biol. Eng. Comput. 49,
2011), which lags if the cadence changes.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.striker_model import Nominal
from firmware_py.core.inputs import GaitInput
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.enums import GaitState
from firmware_py.interface.generated.kinds import GAIT_SENSORS
from firmware_py.interface.generated.parameters import Gait, Parameters

NEARLY_ONE = 0.9999
"""Largest phase of a stride that lasts longer than expected."""

LONGEST_S = 100.0
"""Largest value of a time count."""

SHORTEST_STRIDE_S = 0.5
"""Shortest stride; in a run it is 0.7 s."""
LONGEST_STRIDE_S = 3.0
"""Longest stride; in the slowest walk it is 2.5 s."""
SWING_RAD_S = 1.0
"""Backward rate of the shank above which the leg has swung."""
STILL_RAD_S = 0.25
"""Rate of the shank below which the leg is at rest; in stance it is 0.5 and more."""
STANDING_S = 1.0
"""Time at rest after which the wearer stands."""
GAIN_STRIDE = 0.5
"""Weight of a stride in the mean; it follows a change of 20 % in 5 strides."""
EVENT_STD = 0.0045
"""Deviation of an event, as a share of the cycle: 5 ms of frames, and the roll of the foot."""
EDGE_AGE_S = 0.5 * GAIT_SENSORS.period_s
"""Mean age of a switch's edge when its frame is sampled."""
IRREGULAR = 0.35
"""Relative change of a stride after which the estimate begins anew."""
LARGEST_SPREAD = 0.15
"""Relative spread of the strides at which the confidence is 0."""
STRIDES_TO_TRUST = 3
"""Strides before the confidence rises above 0."""
STRIKE_PHASE = 0.012
"""Phase at which the heel's switch closes: at a tenth of the load."""


class Constants(NamedTuple):
    """What all gait blocks read. `silent_ticks`: the longest silence of the sensors.

    `natural_rad_s`: the striker's, to which ratios refer. `impulse_slope_n_s`: J' of `stride_harmonic`.
    """

    tick_s: float
    gait: Gait
    impulse_slope_n_s: float
    natural_rad_s: float
    silent_ticks: int


def derive(p: Parameters, nominal: Nominal, limits: GateLimits) -> Constants:
    """The constants of these parameters."""
    slope_n_s = p.hold.impulse_slope_n_s
    return Constants(p.control.tick_s, p.gait, slope_n_s, nominal.natural_rad_s, limits.gait_ticks)


class Event(NamedTuple):
    """An event of the stride: its phase, the phase's variance, and its time in this stride, s (0: none)."""

    phase: float
    variance: float
    at_s: float


class Stride(NamedTuple):
    """`mean_s`: mean of recent strides. `expected_s`: estimate of this stride; `variance`: its variance.

    `since_s` counts from the heel strike at which the phase began, `since_seen_s` from the last heel strike
    that was detected; `missed` ones lie in between. `spread` is the relative deviation of strides from their
    expectation. `early` is the earliness of this stride's heel strike, in standard deviations.
    """

    mean_s: float
    expected_s: float
    variance: float
    spread: float
    since_s: float
    since_seen_s: float
    known: int
    missed: int
    early: float


class Events(NamedTuple):
    """The events between two heel strikes."""

    toe_down: Event
    heel_off: Event
    toe_off: Event


class Leg(NamedTuple):
    """The last switch states, whether the leg has swung since its heel strike, and its time at rest."""

    heel: bool
    toe: bool
    swung: bool
    still_s: float


class CycleState(NamedTuple):
    """`phase` is in 0…1 from heel strike, `confidence` in 0…1."""

    phase: float
    confidence: float
    doing: GaitState
    stride: Stride
    events: Events
    leg: Leg


FIRST_STRIDE_S = 1.2
FIRST_SPREAD = 0.03
_FIRST_VARIANCE = 0.0004
MOST_MISSED = 3
PACE = 1.15
"""Factor on the deviation for a heel strike alone, which may be early because of a new pace."""

INITIAL = CycleState(
    phase=0.0,
    confidence=0.0,
    doing=GaitState.STANDING,
    stride=Stride(
        mean_s=FIRST_STRIDE_S,
        expected_s=FIRST_STRIDE_S,
        variance=FIRST_SPREAD * FIRST_SPREAD,
        spread=FIRST_SPREAD,
        since_s=LONGEST_S,
        since_seen_s=LONGEST_S,
        known=0,
        missed=0,
        early=0.0,
    ),
    events=Events(
        toe_down=Event(0.10, _FIRST_VARIANCE, 0.0),
        heel_off=Event(0.38, _FIRST_VARIANCE, 0.0),
        toe_off=Event(0.62, _FIRST_VARIANCE, 0.0),
    ),
    leg=Leg(heel=False, toe=False, swung=False, still_s=0.0),
)


def learn_event(own: Constants, event: Event, stride_s: float, known: int) -> Event:
    """The event, its phase and variance updated by a complete stride (Welford's mean and variance)."""
    if event.at_s <= 0.0:
        return event
    if known == 1:
        return Event(event.at_s / stride_s, event.variance, 0.0)
    off = event.at_s / stride_s - event.phase
    share = max(own.gait.gain_learning, 1.0 / (known + 1))
    variance = event.variance + share * ((1.0 - share) * off * off - event.variance)
    return Event(event.phase + share * off, variance, 0.0)


def clear_times(events: Events) -> Events:
    """The events, with no times yet in the next stride."""
    return Events(
        events.toe_down._replace(at_s=0.0),
        events.heel_off._replace(at_s=0.0),
        events.toe_off._replace(at_s=0.0),
    )


def count_strides(stride: Stride, took_s: float) -> int:
    """Number of strides between two detected heel strikes: more than one if a switch missed some."""
    if stride.known < STRIDES_TO_TRUST:
        return 1
    return max(int(took_s / stride.mean_s + 0.5), 1)


def is_surprising(own: Constants, off: float, spread: float, early: float) -> bool:
    """Whether an event's deviation `off` exceeds the limit for its `spread`; both are shares of the cycle.

    A stumbling wearer puts the foot down early. `early` is the earliness of the heel strike, in standard
    deviations; the squares add up because innovations are independent. A late event is surprising only beyond
    the latest possible heel strike.
    """
    far = off < -own.gait.surprise or off > own.gait.overdue
    if off > 0.0:
        early = 0.0
    highest = own.gait.surprise_spread * spread
    return far and off * off + early * early * spread * spread > highest * highest


def strike_heel(own: Constants, stride: Stride) -> Stride:
    """The stride after a detected heel strike, which may end several strides if some were missed."""
    took_s = stride.since_seen_s - EDGE_AGE_S
    whole = count_strides(stride, took_s)
    one_s = took_s / whole
    mean_s, spread, known = stride.mean_s, stride.spread, stride.known
    off = one_s - mean_s
    late_s = stride.since_s - EDGE_AGE_S - (1.0 + STRIKE_PHASE) * stride.expected_s
    off_share = late_s / stride.expected_s
    off_spread = math.sqrt(stride.variance + EVENT_STD * EVENT_STD)
    plain = stride.missed == 0 and known > STRIDES_TO_TRUST
    stumbled = plain and is_surprising(own, off_share, PACE * off_spread, 0.0)
    early = -off_share / off_spread if plain and off_share < 0.0 else 0.0
    if stumbled or not SHORTEST_STRIDE_S < one_s < LONGEST_STRIDE_S or whole > MOST_MISSED:
        known = 0
    elif known == 0 or abs(off) > IRREGULAR * mean_s:
        # The first stride, or too irregular to follow: begin anew from this stride.
        mean_s, spread, known = one_s, FIRST_SPREAD, 1
    else:
        mean_s += GAIN_STRIDE * off
        known = min(known + 1, 1000)
        if known > STRIDES_TO_TRUST:
            # The mean of a normal distribution's magnitude is 0.8 σ.
            spread += 0.2 * (1.25 * abs(off) / mean_s - spread)
    since_s = EDGE_AGE_S + STRIKE_PHASE * mean_s
    return Stride(
        mean_s=mean_s,
        expected_s=mean_s,
        variance=spread * spread,
        spread=spread,
        since_s=since_s,
        since_seen_s=EDGE_AGE_S,
        known=known,
        missed=0,
        early=early,
    )


def correct_stride(own: Constants, stride: Stride, event: Event) -> Stride:
    """The expected stride, corrected by an event that has just occurred."""
    if stride.known <= STRIDES_TO_TRUST:
        return stride
    off_s = event.at_s / event.phase - stride.expected_s
    noise = (event.variance + EVENT_STD * EVENT_STD) / (event.phase * event.phase)
    gain = stride.variance / (stride.variance + noise)
    surprising = stride.missed == 0 and is_surprising(
        own,
        event.phase * off_s / stride.expected_s,
        event.phase * math.sqrt(stride.variance + noise),
        stride.early,
    )
    return stride._replace(
        expected_s=stride.expected_s + gain * off_s,
        variance=(1.0 - gain) * stride.variance,
        known=0 if surprising else stride.known,
        early=0.0,
    )


def is_due(stride: Stride, event: Event, at_s: float) -> bool:
    """Whether an edge at `at_s` may be this event: the first one in this stride, and near its phase."""
    usual_s = event.phase * stride.expected_s
    return event.at_s <= 0.0 and 0.4 * usual_s < at_s < 2.5 * usual_s


def update_events(
    own: Constants, stride: Stride, events: Events, leg: Leg, sensors: GaitInput
) -> tuple[Stride, Events, Leg]:
    """The stride, events and leg after a fresh frame."""
    rate_rad_s, heel, toe = sensors.shank_rate_rad_s, sensors.heel, sensors.toe
    swung = leg.swung or rate_rad_s < -SWING_RAD_S
    still_s = leg.still_s + 2.0 * EDGE_AGE_S if abs(rate_rad_s) < STILL_RAD_S else 0.0
    toe_down, heel_off, toe_off = events.toe_down, events.heel_off, events.toe_off
    at_s = stride.since_s - EDGE_AGE_S
    if heel and not leg.heel and swung:
        swung = False
        took_s = stride.since_seen_s - EDGE_AGE_S
        plain = stride.missed == 0 and count_strides(stride, took_s) == 1
        stride = strike_heel(own, stride)
        if plain and stride.known > 0:
            events = Events(
                learn_event(own, toe_down, took_s, stride.known),
                learn_event(own, heel_off, took_s, stride.known),
                learn_event(own, toe_off, took_s, stride.known),
            )
        return stride, clear_times(events), Leg(heel, toe, swung, still_s)
    if toe and not leg.toe and is_due(stride, toe_down, at_s):
        toe_down = toe_down._replace(at_s=at_s)
        stride = correct_stride(own, stride, toe_down)
    if leg.heel and not heel and is_due(stride, heel_off, at_s):
        heel_off = heel_off._replace(at_s=at_s)
        stride = correct_stride(own, stride, heel_off)
    if leg.toe and not toe and is_due(stride, toe_off, at_s):
        toe_off = toe_off._replace(at_s=at_s)
        stride = correct_stride(own, stride, toe_off)
    return stride, Events(toe_down, heel_off, toe_off), Leg(heel, toe, swung, still_s)


def pass_strike(stride: Stride) -> Stride:
    """The stride after a missed heel strike: the cycle continues from its expected time."""
    return stride._replace(
        expected_s=stride.mean_s,
        variance=2.0 * stride.spread * stride.spread,
        since_s=stride.since_s - stride.expected_s,
        missed=stride.missed + 1,
        early=0.0,
    )


def advance_stride(stride: Stride, dt_s: float, walking: bool) -> Stride:
    """The stride one tick later; if the wearer does not walk, no stride is known."""
    return stride._replace(
        since_s=min(stride.since_s + dt_s, LONGEST_S),
        since_seen_s=min(stride.since_seen_s + dt_s, LONGEST_S),
        known=stride.known if walking else 0,
    )


def decide_state(confidence: float, leg: Leg, forgotten: bool) -> GaitState:
    """The state of the leg."""
    if leg.still_s > STANDING_S or forgotten:
        return GaitState.STANDING
    if confidence <= 0.0:
        return GaitState.UNCERTAIN
    return GaitState.STANCE if leg.heel or leg.toe else GaitState.SWING


def step(own: Constants, state: CycleState, sensors: GaitInput) -> CycleState:
    """One tick: advances the time, and processes a fresh frame."""
    walking = (
        state.stride.since_seen_s < (MOST_MISSED + 1) * state.stride.mean_s
        and state.leg.still_s < own.gait.still_s
        and sensors.age_ticks <= own.silent_ticks
    )
    stride = advance_stride(state.stride, own.tick_s, walking)
    events, leg = state.events, state.leg
    if sensors.age_ticks == 0:
        stride, events, leg = update_events(own, stride, events, leg, sensors)
    trusted = stride.known >= STRIDES_TO_TRUST
    if (
        trusted
        and stride.missed < MOST_MISSED
        and stride.since_s > (1.0 + own.gait.overdue) * stride.expected_s
    ):
        stride, events = pass_strike(stride), clear_times(events)
    confidence = 0.0
    if trusted and stride.missed < MOST_MISSED:
        confidence = max(1.0 - stride.spread / LARGEST_SPREAD, 0.0) / (1.0 + stride.missed)
    phase = min(max(stride.since_s / stride.expected_s, 0.0), NEARLY_ONE)
    doing = decide_state(confidence, leg, stride.since_seen_s >= LONGEST_S)
    return CycleState(phase, confidence, doing, stride, events, leg)
