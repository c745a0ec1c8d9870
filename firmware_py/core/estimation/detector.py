"""The impact detector: a one-sided test on the innovation, with a second condition.

The stop only pushes back, so a touch-down causes an acceleration below the model's. It is detected if the
difference exceeds an absolute floor by a multiple of the estimate's deviation, and if the estimated striker
is near the stop and approaches it. If the estimate is lost, two successive readings must exceed several times
that threshold. After a separation the detector stays blind for the refractory time.

The touch-down lies between ticks. A Hunt–Crossley stop starts as a Hertz contact, a(t) ∝ x'⁻^1.5 t^1.5, so
the excess at the first tick gives its age; the low-pass adds its delay.
"""

import math
from typing import NamedTuple

from firmware_py.core.elementary import cube_root
from firmware_py.core.estimation.estimator_state import Contact, Prediction
from firmware_py.core.numbers import at_least
from firmware_py.core.records import zeroed
from firmware_py.interface.enums import CONTACT, FREE, ContactPhase

SIGMAS = 4.0
"""Deviations of the estimate, in addition to the floor."""
NEAR_M = 0.006
"""Distance that counts as near the stop; the estimate's deviation is added."""
SURE_FACTOR = 3.0
"""Factor of the threshold for two successive readings at any position."""
END_M_S2 = 1.5
"""Excess below which a contact has ended."""
END_FRACTION = 0.02
"""Share of the peak below which a contact has ended."""
SEPARATION_AGE_S = 0.0005
"""Time from separation to the tick that detects it."""
LONGEST_CONTACT_S = 0.08
"""Longest contact: eight times the nominal one."""


class DetectorConfig(NamedTuple):
    """`growth` is the factor of the Hertz contact, a = growth · (x'⁻ t)^1.5, in m/s² per m^1.5."""

    tick_s: float
    floor_m_s2: float
    dry_m_s2: float
    stop_m: float
    growth: float
    delay_s: float
    refractory_ticks: int
    longest_contact_ticks: int
    newton_contact_ticks: int
    mass_kg: float
    restitution: float


class DetectorState(NamedTuple):
    """`excess_m_s2` is the model's acceleration minus the measured one; impulse and speed: last impact.

    `area_m_s` is ∫excess dt over the contact so far. `since_touch_down_s` is the time from the last
    touch-down to the sensors' time; it stops at the separation.
    """

    phase: ContactPhase
    contact_ticks: int
    blind_ticks: int
    excess_m_s2: float
    peak_m_s2: float
    approach_speed_m_s: float
    impulse_n_s: float
    area_m_s: float
    since_touch_down_s: float
    measurable: bool
    impacts: int


INITIAL = zeroed(DetectorState, phase=FREE, measurable=True)

REFERENCE_M_S = 0.9
"""Touch-down speed to which the contact time refers."""

FLYING = Contact(False, False, 0.0, 0.0, measured=True, settled=True)
SWINGING_OUT = FLYING._replace(settled=False)
"""Result during the refractory time after a contact."""


def _excess_of_dissipation(d: float, k: float) -> float:
    return (d - math.log1p(d)) - (-k * d - math.log1p(-k * d))


def hertz_dissipation(restitution: float) -> float:
    """d = λ x'⁻ of a Hunt–Crossley stop with this restitution k: d − ln(1 + d) = −k d − ln(1 − k d)."""
    if restitution >= 1.0:
        return 0.0
    k = at_least(restitution, 1e-3)
    low, high = 1e-9, (1.0 - 1e-12) / k
    for _ in range(200):
        middle = 0.5 * (low + high)
        if _excess_of_dissipation(middle, k) > 0.0:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


def contact_growth(mass_kg: float, contact_s: float, restitution: float) -> float:
    """`growth` of a(t) = growth · (x'⁻ t)^1.5 at the start of a contact, m/s² per m^1.5.

    Hertz: the elastic contact lasts 2.9432 δ_max/x'⁻ with δ_max = (5 m x'⁻²/(4 K))^(2/5).
    """
    deepest_m = contact_s * REFERENCE_M_S / 2.9432
    stiffness = 1.25 * mass_kg * REFERENCE_M_S * REFERENCE_M_S / math.pow(deepest_m, 2.5)
    return stiffness / mass_kg * (1.0 + hertz_dissipation(restitution))


def step(
    config: DetectorConfig, state: DetectorState, predicted: Prediction, elapsed_ticks: int
) -> tuple[DetectorState, Contact]:
    """One tick, on the prediction before any correction."""
    fresh = predicted.sensor.missed_ticks == 0 and predicted.started
    excess_m_s2 = -predicted.innovation_m_s2 if fresh else 0.0
    if state.phase == FREE:
        return _free(config, state, predicted, excess_m_s2, fresh, elapsed_ticks)
    return _contact(config, state, predicted, excess_m_s2, fresh, elapsed_ticks)


def _may_touch(
    config: DetectorConfig,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    limit_m_s2: float,
    coming_m_s: float,
) -> bool:
    """Whether the striker may be at the stop, or the excess is so large that only the stop can cause it."""
    sure_m_s2 = SURE_FACTOR * limit_m_s2
    if excess_m_s2 > sure_m_s2 and state.excess_m_s2 > limit_m_s2:
        return True
    estimate = predicted.estimate
    reach_m = NEAR_M + 3.0 * math.sqrt(at_least(estimate.p.xx, 0.0))
    slack_m_s = 3.0 * math.sqrt(at_least(estimate.p.vv, 0.0))
    return estimate.x_m > config.stop_m - reach_m and coming_m_s > -slack_m_s


def _free(
    config: DetectorConfig,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    fresh: bool,
    elapsed_ticks: int,
) -> tuple[DetectorState, Contact]:
    # The approach speed is the estimate plus the speed that the excess has removed in this tick (trapezoid,
    # and τ times its change). After a gap the model, which contains no stop, has carried the estimate: no
    # addition.
    coming_m_s = predicted.estimate.v_m_s
    if predicted.carried:
        dt_s = elapsed_ticks * config.tick_s
        coming_m_s += excess_m_s2 * (0.5 * dt_s + config.delay_s)
        coming_m_s += state.excess_m_s2 * (0.5 * dt_s - config.delay_s)
    # If the velocity reverses on a dry guide, the error of the model is up to twice the friction.
    dry_m_s2 = (0.3 if coming_m_s > 0.04 else 2.0) * config.dry_m_s2
    limit_m_s2 = config.floor_m_s2 + dry_m_s2 + SIGMAS * predicted.spread_m_s2
    blind_ticks = max(state.blind_ticks - elapsed_ticks, 0)
    suspected = fresh and blind_ticks == 0 and excess_m_s2 > limit_m_s2
    if not (suspected and _may_touch(config, state, predicted, excess_m_s2, limit_m_s2, coming_m_s)):
        quiet = state._replace(
            contact_ticks=0,
            blind_ticks=blind_ticks,
            excess_m_s2=excess_m_s2,
            peak_m_s2=0.0,
            area_m_s=0.0,
            measurable=True,
        )
        return quiet, FLYING if blind_ticks == 0 else SWINGING_OUT

    speed_m_s = at_least(coming_m_s, 0.03)
    # a = growth (x'⁻ t)^1.5
    root = cube_root(excess_m_s2 / config.growth)
    age_s = root * root / speed_m_s
    age_s = min(age_s, 3.0 * config.tick_s) + config.delay_s
    touched = DetectorState(
        phase=CONTACT,
        contact_ticks=0,
        blind_ticks=0,
        excess_m_s2=excess_m_s2,
        peak_m_s2=excess_m_s2,
        approach_speed_m_s=speed_m_s,
        impulse_n_s=(1.0 + config.restitution) * config.mass_kg * speed_m_s,  # expected, until the separation
        area_m_s=excess_m_s2 * config.tick_s,
        since_touch_down_s=age_s,
        measurable=predicted.carried and not predicted.sensor.clipped,
        impacts=state.impacts + 1,
    )
    return touched, Contact(True, False, age_s, speed_m_s, measured=True, settled=False)


def _contact(
    config: DetectorConfig,
    state: DetectorState,
    predicted: Prediction,
    excess_m_s2: float,
    fresh: bool,
    elapsed_ticks: int,
) -> tuple[DetectorState, Contact]:
    contact_ticks = state.contact_ticks + elapsed_ticks
    since_touch_down_s = state.since_touch_down_s + elapsed_ticks * config.tick_s
    peak_m_s2 = at_least(excess_m_s2, state.peak_m_s2)
    # The excess contains neither spring nor friction, so the stop's impulse is J = m ∫excess dt.
    area_m_s = state.area_m_s + excess_m_s2 * elapsed_ticks * config.tick_s
    # The integral is incomplete if a tick has no sample.
    measurable = state.measurable and fresh and elapsed_ticks == 1 and not predicted.sensor.clipped
    ended = fresh and excess_m_s2 < at_least(END_FRACTION * peak_m_s2, END_M_S2)
    unseen = not fresh and contact_ticks >= config.newton_contact_ticks
    if not (ended or unseen or contact_ticks >= config.longest_contact_ticks):
        held = state._replace(
            contact_ticks=contact_ticks,
            excess_m_s2=excess_m_s2,
            peak_m_s2=peak_m_s2,
            area_m_s=area_m_s,
            since_touch_down_s=since_touch_down_s,
            measurable=measurable,
        )
        return held, Contact(False, False, 0.0, state.approach_speed_m_s, measured=measurable, settled=False)

    before_m_s = state.approach_speed_m_s
    # A stop returns at most the kinetic energy of the touch-down.
    plausible = -1.2 * before_m_s - 0.05 < predicted.estimate.v_m_s < 0.2 * before_m_s + 0.05
    measured = measurable and plausible
    expected_m_s = (1.0 + config.restitution) * before_m_s
    change_m_s = area_m_s if measured else expected_m_s
    if measurable and not plausible:
        # Estimate and readings contradict each other: the larger impulse is used, for the limit on impacts.
        change_m_s = at_least(area_m_s, expected_m_s)
    freed = state._replace(
        phase=FREE,
        contact_ticks=0,
        blind_ticks=config.refractory_ticks,
        excess_m_s2=excess_m_s2,
        peak_m_s2=peak_m_s2,
        impulse_n_s=config.mass_kg * change_m_s,
        area_m_s=area_m_s,
        since_touch_down_s=since_touch_down_s,
        measurable=True,
    )
    return freed, Contact(False, True, SEPARATION_AGE_S, before_m_s, measured=measured, settled=False)
