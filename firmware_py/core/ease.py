"""Slow the crank for a moment where a blow on the way up has not come, so that the next is none too hard.

Each blow costs energy and sets the striker back against the crank. Where one is missed, the striker swings on
for two periods near resonance, takes up energy all the while, and then strikes harder than in any steady
motion. Above resonance a free striker falls back against the crank, and the further it has fallen back the
more it takes up. So from the angle on by which a blow should have come until shortly before the next one may,

    ω_wanted = (1 − s) ω*,   τ ds/dt = d (1 − v/v_weak) − s

with v the running period's mean approach speed, 0 without a blow; d = 0 where that is not weak, and elsewhere
in the turn. What the crank loses by it is an angle, not speed: the S-curve goes on beneath.
"""

import math
from typing import NamedTuple

from firmware_py.core.compiled import compiled
from firmware_py.core.numbers import turned
from firmware_py.core.regime import RegimeState


class EaseConfig(NamedTuple):
    """Angles past the crank's forward dead centre. `depth` is the largest share of the speed given up."""

    tick_s: float
    depth: float
    late_rad: float
    early_rad: float
    weak_m_s: float
    lag_s: float


class EaseState(NamedTuple):
    """The share of the speed that is given up now, and how fast it changes."""

    share: float
    rate_1_s: float


INITIAL = EaseState(share=0.0, rate_1_s=0.0)


@compiled
def wanted(config: EaseConfig, angle_rad: float, regime: RegimeState) -> float:
    """The share of the speed to give up at this crank angle."""
    past_rad = turned(angle_rad - 0.5 * math.pi)
    if not config.late_rad < past_rad < config.early_rad:
        return 0.0
    # The period is cut a quarter turn before the dead centre: from there on it is the last one that counts.
    period = regime.last if past_rad >= 1.5 * math.pi else regime.running
    speed_m_s = period.speed_m_s if period.impacts > 0 else 0.0
    if not speed_m_s < config.weak_m_s:
        return 0.0
    return config.depth * (1.0 - speed_m_s / config.weak_m_s)


@compiled
def step(
    config: EaseConfig,
    state: EaseState,
    rising: bool,
    angle_rad: float,
    regime: RegimeState,
    elapsed_ticks: int,
) -> EaseState:
    """One tick; where nothing rises, what was given up comes back."""
    goal = wanted(config, angle_rad, regime) if rising else 0.0
    dt_s = elapsed_ticks * config.tick_s
    change = (goal - state.share) * min(dt_s / config.lag_s, 1.0)
    return EaseState(state.share + change, change / dt_s)


@compiled
def eased(state: EaseState, omega_rad_s: float, acceleration_rad_s2: float) -> tuple[float, float]:
    """The speed and its slope that are left of the S-curve's."""
    kept = 1.0 - state.share
    return kept * omega_rad_s, kept * acceleration_rad_s2 - state.rate_1_s * omega_rad_s
