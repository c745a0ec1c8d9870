"""The impact detector: a one-sided test on the innovation, with a second condition.

The stop only pushes back, so a touch-down causes an acceleration below the model's. It is detected if the
difference exceeds an absolute floor by a multiple of the estimate's deviation, and if the estimated striker
is near the stop and approaches it. If the estimate is lost, two successive readings must exceed several times
that threshold. After a separation the detector stays blind for the refractory time.

The touch-down lies between ticks. The excess at the first tick gives its age by the model of the stop; the
low-pass adds its delay.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation import stop_model
from firmware_py.core.estimation.estimator_state import Contact, Prediction
from firmware_py.core.estimation.striker_model import Nominal
from firmware_py.core.numbers import at_least, in_ticks
from firmware_py.interface.enums import ContactPhase
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

SIGMAS = 4.0
"""Deviations of the estimate, in addition to the floor."""
NEAR_M = 0.006
"""Distance that counts as near the stop; the estimate's deviation is added."""
SURE_FACTOR = 3.0
"""Factor of the threshold for two successive readings at any position."""
ROUGH_FACTOR = 2.0
"""Factor of the roughness, which is added to this threshold: 5 σ of white noise."""
ROUGH_S = 0.064
"""Time over which the roughness is averaged: noise is known after a tenth of a drive period."""
END_M_S2 = 1.5
"""Excess below which a contact has ended."""
SEPARATION_AGE_S = 0.0005
"""Time from separation to the tick that detects it."""
LONGEST_CONTACT_S = 0.08
"""Longest contact: eight times the nominal one."""


class Constants(NamedTuple):
    """The floor of the excess, and durations in ticks."""

    tick_s: float
    floor_m_s2: float
    refractory_ticks: int
    longest_contact_ticks: int
    rough_ticks: float


def derive(p: Parameters) -> Constants:
    """The constants of these parameters."""
    tick_s = p.control.tick_s
    return Constants(
        tick_s=tick_s,
        floor_m_s2=p.detector.floor_m_s2,
        refractory_ticks=in_ticks(p.detector.refractory_s, tick_s),
        longest_contact_ticks=in_ticks(LONGEST_CONTACT_S, tick_s),
        rough_ticks=max(ROUGH_S / tick_s, 1.0),
    )


class DetectorState(NamedTuple):
    """`excess_m_s2` is the model's acceleration minus the measured one; impulse and speed: last impact.

    `roughness_m_s2` is the mean second difference of the readings in flight, 2.4 σ of white noise.
    `area_m_s` is ∫excess dt over the contact so far. `since_touch_down_s` is the time from the last
    touch-down to the sensors' time; it stops at the separation.
    """

    phase: ContactPhase
    contact_ticks: int
    blind_ticks: int
    excess_m_s2: float
    roughness_m_s2: float
    peak_m_s2: float
    approach_speed_m_s: float
    impulse_n_s: float
    area_m_s: float
    since_touch_down_s: float
    measurable: bool
    impacts: int


INITIAL = zeroed(DetectorState, phase=ContactPhase.FREE, measurable=True)

FLYING = Contact(False, False, 0.0, 0.0, measured=True, settled=True)
SWINGING_OUT = FLYING._replace(settled=False)
"""Result during the refractory time after a contact."""


def step(
    own: Constants, nominal: Nominal, state: DetectorState, predicted: Prediction
) -> tuple[DetectorState, Contact]:
    """One tick, on the prediction before any correction."""
    fresh = predicted.sensor.missed_ticks == 0 and predicted.started
    excess_m_s2 = -predicted.innovation_m_s2 if fresh else 0.0
    if state.phase == ContactPhase.FREE:
        return step_in_flight(own, nominal, state, predicted, excess_m_s2, fresh)
    return step_in_contact(own, nominal, state, predicted, excess_m_s2, fresh)


def may_touch(
    own: Constants,
    nominal: Nominal,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    limit_m_s2: float,
    coming_m_s: float,
) -> bool:
    """Whether the striker may be at the stop, or the excess is so large that only the stop can cause it."""
    sure_m_s2 = SURE_FACTOR * limit_m_s2 + ROUGH_FACTOR * state.roughness_m_s2
    if excess_m_s2 > sure_m_s2 and state.excess_m_s2 > limit_m_s2:
        return True
    estimate = predicted.estimate
    reach_m = NEAR_M + 3.0 * math.sqrt(at_least(estimate.p.xx, 0.0))
    slack_m_s = 3.0 * math.sqrt(at_least(estimate.p.vv, 0.0))
    return estimate.x_m > nominal.stop.position_m - reach_m and coming_m_s > -slack_m_s


def follow_roughness(own: Constants, state: DetectorState, predicted: Prediction) -> float:
    """The mean second difference of the readings after this tick."""
    sensor = predicted.sensor
    if sensor.missed_ticks > 0:
        return state.roughness_m_s2
    bend_m_s2 = sensor.acceleration_m_s2 - 2.0 * sensor.before_m_s2 + sensor.second_m_s2
    return state.roughness_m_s2 + (abs(bend_m_s2) - state.roughness_m_s2) / own.rough_ticks


def step_in_flight(
    own: Constants,
    nominal: Nominal,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    fresh: bool,
) -> tuple[DetectorState, Contact]:
    """A tick in flight: whether the striker has touched the stop."""
    # The approach speed is the estimate plus the speed that the excess has removed in this tick (trapezoid,
    # and τ times its change). After a gap the model, which contains no stop, has carried the estimate: no
    # addition.
    coming_m_s = predicted.estimate.v_m_s
    if predicted.carried:
        dt_s = own.tick_s
        coming_m_s += excess_m_s2 * (0.5 * dt_s + nominal.sensor_delay_s)
        coming_m_s += state.excess_m_s2 * (0.5 * dt_s - nominal.sensor_delay_s)
    # If the velocity reverses on a dry guide, the error of the model is up to twice the friction.
    dry_m_s2 = (0.3 if coming_m_s > 0.04 else 2.0) * nominal.dry_m_s2
    limit_m_s2 = own.floor_m_s2 + dry_m_s2 + SIGMAS * predicted.spread_m_s2
    blind_ticks = max(state.blind_ticks - 1, 0)
    suspected = fresh and blind_ticks == 0 and excess_m_s2 > limit_m_s2
    if not (
        suspected
        and may_touch(own, nominal, state, predicted, excess_m_s2, limit_m_s2, coming_m_s=coming_m_s)
    ):
        quiet = state._replace(
            contact_ticks=0,
            blind_ticks=blind_ticks,
            excess_m_s2=excess_m_s2,
            roughness_m_s2=follow_roughness(own, state, predicted)
            if blind_ticks == 0
            else state.roughness_m_s2,
            peak_m_s2=0.0,
            area_m_s=0.0,
            measurable=True,
        )
        return quiet, FLYING if blind_ticks == 0 else SWINGING_OUT

    speed_m_s = at_least(coming_m_s, 0.03)
    age_s = stop_model.contact_age_s(nominal.contact_growth, excess_m_s2, speed_m_s)
    age_s = min(age_s, 3.0 * own.tick_s) + nominal.sensor_delay_s
    touched = DetectorState(
        phase=ContactPhase.CONTACT,
        contact_ticks=0,
        blind_ticks=0,
        excess_m_s2=excess_m_s2,
        roughness_m_s2=state.roughness_m_s2,
        peak_m_s2=excess_m_s2,
        approach_speed_m_s=speed_m_s,
        impulse_n_s=(1.0 + nominal.stop.restitution)
        * nominal.striker.mass_kg
        * speed_m_s,  # expected, until the separation
        area_m_s=excess_m_s2 * own.tick_s,
        since_touch_down_s=age_s,
        measurable=predicted.carried and not predicted.sensor.clipped,
        impacts=state.impacts + 1,
    )
    return touched, Contact(True, False, age_s, speed_m_s, measured=True, settled=False)


def step_in_contact(
    own: Constants,
    nominal: Nominal,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    fresh: bool,
) -> tuple[DetectorState, Contact]:
    """A tick in contact: the impulse so far, and whether the striker has left the stop."""
    # The excess contains neither spring nor friction, so the stop's impulse is J = m ∫excess dt; the integral
    # is incomplete if a tick has no sample.
    now = state._replace(
        contact_ticks=state.contact_ticks + 1,
        excess_m_s2=excess_m_s2,
        peak_m_s2=at_least(excess_m_s2, state.peak_m_s2),
        area_m_s=state.area_m_s + excess_m_s2 * own.tick_s,
        since_touch_down_s=state.since_touch_down_s + own.tick_s,
        measurable=state.measurable and fresh and not predicted.sensor.clipped,
    )
    before_m_s = now.approach_speed_m_s
    ended = fresh and excess_m_s2 < at_least(stop_model.END_FRACTION * now.peak_m_s2, END_M_S2)
    unseen = not fresh and now.contact_ticks >= nominal.contact_ticks
    if not (ended or unseen or now.contact_ticks >= own.longest_contact_ticks):
        return now, Contact(False, False, 0.0, before_m_s, measured=now.measurable, settled=False)

    # A stop returns at most the kinetic energy of the touch-down.
    plausible = -1.2 * before_m_s - 0.05 < predicted.estimate.v_m_s < 0.2 * before_m_s + 0.05
    measured = now.measurable and plausible
    # If readings are missing or contradict the estimate, the larger impulse counts: a lost reading may
    # hide a part of the integral, and the estimate misses a kick.
    expected_m_s = (1.0 + nominal.stop.restitution) * before_m_s
    change_m_s = now.area_m_s if measured else at_least(now.area_m_s, expected_m_s)
    freed = now._replace(
        phase=ContactPhase.FREE,
        contact_ticks=0,
        blind_ticks=own.refractory_ticks,
        impulse_n_s=nominal.striker.mass_kg * change_m_s,
        measurable=True,
    )
    return freed, Contact(False, True, SEPARATION_AGE_S, before_m_s, measured=measured, settled=False)
