"""A requested impulse with a gait: the number of turns per stride whose impacts are nearest to it.

The cadence allows only a few ratios r = n f_stride 2π/ω, and the impulse J grows with r. From the mean J̄ at
the mean ratio r̄,

    r* = r̄ + (J* − J̄)/J'

is the ratio of the requested impulse J*, and the n whose ratio is nearest to r* is chosen. The
slope J' starts as a parameter. After two values of n have been tried, the secant through them replaces it, so
that both values rank the candidates alike and the search does not oscillate. Whole turns seldom meet a
request; the remainder is reported.
"""

from typing import NamedTuple

from firmware_py.core.gait.gait import Constants
from firmware_py.core.gait.gait_lock import LockState, Moment
from firmware_py.interface.enums import Refusal
from firmware_py.interface.zeroed import zeroed

SETTLING, MEAN, REPORTING = 1, 4, 6
"""Strides before impacts count, strides in their mean, and strides before a miss is reported."""

LARGEST_ERROR = 2.0
"""Largest error of the parameter J', as a factor; a secant outside results from a change of the walk."""


class StrideHarmonicState(NamedTuple):
    """`turns` of the crank with the present `harmonic`, their means, and the previous means (`left_…`)."""

    harmonic: int
    turns: int
    ratio: float
    impulse_n_s: float
    left_ratio: float
    left_impulse_n_s: float
    aim_ratio: float
    refusal: Refusal


INITIAL = zeroed(StrideHarmonicState, refusal=Refusal.NONE)
"""State without a request; an `aim_ratio` of 0 stands for the region's centre."""


def has_means(state: StrideHarmonicState) -> bool:
    """Whether the means are complete."""
    return state.harmonic > 0 and state.turns >= (SETTLING + MEAN) * state.harmonic


def slope_n_s(own: Constants, state: StrideHarmonicState) -> float:
    """J': the secant through two values of n, within `LARGEST_ERROR` of the parameter, N s per unit of r."""
    nominal_n_s = own.impulse_slope_n_s
    change = state.ratio - state.left_ratio
    if state.left_ratio == 0.0 or change == 0.0:
        return nominal_n_s
    secant_n_s = (state.impulse_n_s - state.left_impulse_n_s) / change
    return min(max(secant_n_s, nominal_n_s / LARGEST_ERROR), nominal_n_s * LARGEST_ERROR)


def find_unmet(own: Constants, state: StrideHarmonicState, target_impulse_n_s: float) -> Refusal:
    """The refusal if the impacts miss the request after enough strides."""
    if state.turns < REPORTING * state.harmonic:
        return Refusal.NONE
    miss_n_s = state.impulse_n_s - target_impulse_n_s
    if abs(miss_n_s) <= own.gait.impulse_tolerance * target_impulse_n_s:
        return Refusal.NONE
    return Refusal.IMPULSE_TOO_HIGH if miss_n_s < 0.0 else Refusal.IMPULSE_TOO_LOW


def aim(own: Constants, state: StrideHarmonicState, target_impulse_n_s: float) -> StrideHarmonicState:
    """The state with r* and the refusal."""
    aim_ratio = state.ratio + (target_impulse_n_s - state.impulse_n_s) / slope_n_s(own, state)
    return state._replace(
        aim_ratio=min(max(aim_ratio, own.gait.lowest_ratio), own.gait.highest_ratio),
        refusal=find_unmet(own, state, target_impulse_n_s),
    )


def step(
    own: Constants, state: StrideHarmonicState, lock: LockState, now: Moment, target_impulse_n_s: float
) -> StrideHarmonicState:
    """One tick. `lock`: of this tick; a target of 0: no impulse is requested."""
    harmonic, ratio, regime = lock.harmonic, lock.base_ratio + lock.trim, now.regime
    if not now.holding or harmonic == 0:
        return INITIAL
    turns, left_ratio, left_impulse_n_s = state.turns, state.left_ratio, state.left_impulse_n_s
    if harmonic != state.harmonic:
        if has_means(state):
            left_ratio, left_impulse_n_s = state.ratio, state.impulse_n_s
        turns = 0
    mean_ratio, impulse_n_s = state.ratio, state.impulse_n_s
    if regime.ended and regime.last.impacts == 1:
        turns = min(turns + 1, REPORTING * harmonic)
        counted = min(turns - SETTLING * harmonic, MEAN * harmonic)
        share = 1.0 / counted if counted > 0 else 1.0
        mean_ratio += share * (ratio - mean_ratio)
        impulse_n_s += share * (now.impact_n_s - impulse_n_s)
    asks = target_impulse_n_s > 0.0
    state = StrideHarmonicState(
        harmonic=harmonic,
        turns=turns,
        ratio=mean_ratio,
        impulse_n_s=impulse_n_s,
        left_ratio=left_ratio,
        left_impulse_n_s=left_impulse_n_s,
        aim_ratio=state.aim_ratio if asks else 0.0,
        refusal=state.refusal if asks else Refusal.NONE,
    )
    return aim(own, state, target_impulse_n_s) if asks and has_means(state) else state
