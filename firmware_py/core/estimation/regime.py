"""The regime of the striker's motion, decided once per drive period.

A period is one turn of the crank from θ = 0, a quarter turn before its forward dead centre: the impacts of a
steady motion lie 0° to 91° past that centre, far from the limit between two periods. A period is described by
its number of impacts, their mean approach speed, the crank angle of the last impact and the peak
acceleration; the last four, the one just ended included, decide. A new regime is reported once two
successive periods agree on it, so that a single outlier does not change the report. Below its slowest speed
the crank ends no period: there is no regime, and the decision starts anew.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.crank import CrankState
from firmware_py.core.estimation.estimator_state import Contact
from firmware_py.core.numbers import at_least, wrap_pi
from firmware_py.interface.enums import Regime
from firmware_py.interface.zeroed import zeroed

EQUAL_SPEED = 0.15
"""Relative difference of approach speeds up to which two periods count as alike; a rise changes 5 %."""
GRAZING_M_S = 0.05
"""Mean approach speed below which the regime of periods with impacts is uncertain."""
CHATTERING_IMPACTS = 4
"""Smallest number of impacts in a period of chattering."""
STILL_M_S2 = 0.6
"""Largest acceleration of a stuck striker: bias and noise."""
LONGEST_PERIOD_S = 6.0
SLOWEST_RAD_S = 2.0 * math.pi / LONGEST_PERIOD_S
"""Slowest crank speed with a regime, 1 rad/s; a slower or backward crank counts as standing."""
AGREEING_PERIODS = 2
"""Successive periods that must agree before a new regime is reported."""


class Period(NamedTuple):
    """Summary of one drive period. `speed_m_s` is the mean approach speed, 0 without an impact."""

    impacts: int
    speed_m_s: float
    phase_rad: float
    peak_m_s2: float


class RegimeState(NamedTuple):
    """The running period, the last three (newest first), and the decision."""

    angle_rad: float
    running: Period
    last: Period
    second: Period
    third: Period
    periods: int
    candidate: Regime
    agreed: int
    regime: Regime
    ended: bool


INITIAL = zeroed(RegimeState, candidate=Regime.UNCERTAIN, regime=Regime.UNCERTAIN)


def are_alike(one: Period, other: Period) -> bool:
    """Whether two periods have the same number of impacts at about the same speed."""
    larger_m_s = at_least(one.speed_m_s, other.speed_m_s)
    return one.impacts == other.impacts and abs(one.speed_m_s - other.speed_m_s) <= EQUAL_SPEED * larger_m_s


def decide(  # noqa: PLR0911 - a table, read top to bottom
    last: Period, second: Period, third: Period, fourth: Period
) -> Regime:
    """The regime according to the last four periods, newest first."""
    impacts = last.impacts + second.impacts + third.impacts + fourth.impacts
    if last.impacts + second.impacts == 0 and (third.impacts + fourth.impacts == 0 or impacts == 0):
        still = last.peak_m_s2 < STILL_M_S2 and second.peak_m_s2 < STILL_M_S2
        return Regime.STUCK if still else Regime.NON_IMPACT
    if last.impacts >= CHATTERING_IMPACTS and second.impacts >= CHATTERING_IMPACTS:
        return Regime.CHATTERING
    if at_least(last.speed_m_s, second.speed_m_s) < GRAZING_M_S:
        return Regime.UNCERTAIN
    if last.impacts > 0 and are_alike(last, second):
        return Regime.IMPACT
    if last.impacts == 1 and second.impacts == 1 and third.impacts == 1:
        # One impact per period with an alternating speed is an orbit of period two.
        alternating = are_alike(last, third) and are_alike(second, fourth)
        return Regime.PERIOD_N if alternating else Regime.IMPACT
    if are_alike(last, third) or are_alike(last, fourth):
        return Regime.PERIOD_N
    return Regime.UNCERTAIN


def add_sample(
    running: Period, touch_down: bool, speed_m_s: float, angle_rad: float, peak_m_s2: float
) -> Period:
    """The period after a sample; with a touch-down, its speed and the crank's angle count."""
    if not touch_down:
        return running._replace(peak_m_s2=peak_m_s2) if peak_m_s2 > running.peak_m_s2 else running
    impacts = running.impacts + 1
    return Period(
        impacts=impacts,
        speed_m_s=running.speed_m_s + (speed_m_s - running.speed_m_s) / impacts,
        phase_rad=wrap_pi(angle_rad - 0.5 * math.pi),
        peak_m_s2=at_least(peak_m_s2, running.peak_m_s2),
    )


def step(state: RegimeState, crank: CrankState, contact: Contact, acceleration_m_s2: float) -> RegimeState:
    """One sample; crank, contact and the striker's acceleration belong to the same time."""
    angle_rad, omega_rad_s = crank.angle_rad, crank.omega_rad_s
    touch_down, speed_m_s = contact.touch_down, contact.approach_speed_m_s
    if not omega_rad_s >= SLOWEST_RAD_S:
        return INITIAL._replace(angle_rad=angle_rad)  # no regime while the crank stands
    turned = state.angle_rad > 1.5 * math.pi and angle_rad < 0.5 * math.pi
    at_impact_rad = angle_rad - omega_rad_s * contact.age_s
    running = state.running
    if not turned:
        running = add_sample(running, touch_down, speed_m_s, at_impact_rad, abs(acceleration_m_s2))
        return state._replace(angle_rad=angle_rad, running=running, ended=False)
    running = add_sample(running, False, 0.0, 0.0, abs(acceleration_m_s2))
    fresh = add_sample(INITIAL.running, touch_down, speed_m_s, at_impact_rad, abs(acceleration_m_s2))
    candidate = decide(running, state.last, state.second, state.third)
    if state.periods < 2:
        candidate = Regime.UNCERTAIN
    agreed = state.agreed + 1 if candidate == state.candidate else 1
    regime = state.regime
    hit = regime in (Regime.IMPACT, Regime.PERIOD_N)
    if hit and running.impacts + state.last.impacts == 0:
        regime = Regime.LOST
    elif agreed >= AGREEING_PERIODS and not (
        regime == Regime.LOST and candidate == Regime.NON_IMPACT and agreed < 2 * AGREEING_PERIODS
    ):
        regime = candidate
    return RegimeState(
        angle_rad=angle_rad,
        running=fresh,
        last=running,
        second=state.last,
        third=state.second,
        periods=state.periods + 1,
        candidate=candidate,
        agreed=agreed,
        regime=regime,
        ended=True,
    )
