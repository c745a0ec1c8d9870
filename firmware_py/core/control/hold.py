"""The hold after capture: a slow approach to the requested ratio or impulse, at a distance from the fold.

On the branch with one impact per period, the crank angle φ at impact and the impulse J both rise with the
speed. The branch ends at the fold, φ = 85° to 91° past the forward dead centre. Once a
period, if the last two periods had exactly one impact each, an integral law therefore changes the ratio
r = Ω/ω by the smaller of two steps

    Δ_want  = g_J (J* − J)/J'         towards the requested impulse, or else towards the requested ratio
    Δ_guard = g_φ (φ* − φ)/φ'(φ)      φ* = 64.5°; φ' is scheduled: it rises from 1 to 7° per 0.01 of r;
                                      g_φ is 0.15 below φ* and 0.5 beyond

(an override, as in Åström & Hägglund, Advanced PID Control, ch. 5). At a few degrees and less, φ hardly
depends on r, but there Δ_guard is the larger step and is not used.
"""

import math
from typing import NamedTuple

from firmware_py.core.estimation.regime import RegimeState
from firmware_py.core.numbers import clamp
from firmware_py.core.request import Request
from firmware_py.interface.enums import Refusal
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.zeroed import zeroed

RAD_PER_DEG = math.pi / 180.0

PHASE_SLOPE_RAD = 1.4
"""φ' at 0°, per unit of r: 0.8° per 0.01."""
PHASE_SLOPE_GROWTH = 1.6
"""Relative growth of φ' per rad of φ: 2.3° per 0.01 at 65°."""
GAIN_RETREAT = 0.5
"""Share of the error corrected in a period if φ exceeds φ*. A housing that swings at nearly the crank's
frequency reduces the amplitude, which brings the fold closer; 0.3 is too slow for that."""
GAIN_IMPULSE = 0.2
"""Share of the error corrected in a period; an impact settles in two periods."""
IMPULSE_TOLERANCE = 0.03
"""Relative error above which the requested impulse is not met."""


class HoldState(NamedTuple):
    """`trim` is the ratio's present difference from the S-curve's end, `wanted_trim` its target."""

    trim: float
    trim_rate_1_s: float
    wanted_trim: float
    guarded: bool
    bound_periods: int
    impulse_n_s: float
    refusal: Refusal


INITIAL = zeroed(HoldState, refusal=Refusal.NONE)


def phase_step(p: Parameters, phase_rad: float) -> float:
    """Δ_guard: the largest increase of the ratio at this phase; if negative, the ratio must fall."""
    within_rad = clamp(phase_rad, 1.5)
    slope_rad = PHASE_SLOPE_RAD * (1.0 + PHASE_SLOPE_GROWTH * (within_rad if within_rad > 0.0 else 0.0))
    error_rad = RAD_PER_DEG * p.hold.highest_phase_deg - within_rad
    gain = p.hold.gain_phase if error_rad >= 0.0 else max(p.hold.gain_phase, GAIN_RETREAT)
    return gain * error_rad / slope_rad


def wanted_step(p: Parameters, ratio: float, request: Request, impulse_n_s: float) -> float:
    """Δ_want, bounded by the largest step."""
    if request.impulse_n_s > 0.0:
        step = GAIN_IMPULSE * (request.impulse_n_s - impulse_n_s) / p.hold.impulse_slope_n_s
    else:
        step = request.ratio - ratio
    return clamp(step, p.hold.largest_step)


def is_possible(p: Parameters, target_impulse_n_s: float) -> bool:
    """Whether a requested impulse is possible; 0 means no request, and NaN is impossible."""
    return target_impulse_n_s == 0.0 or (
        p.hold.lowest_impulse_n_s <= target_impulse_n_s <= p.hold.highest_impulse_n_s
    )


def find_unmet(p: Parameters, target_impulse_n_s: float) -> Refusal:
    """The refusal of an impossible impulse, or NONE."""
    return Refusal.NONE if is_possible(p, target_impulse_n_s) else Refusal.IMPULSE_OUT_OF_RANGE


def rest(p: Parameters, request: Request) -> HoldState:
    """The state of a tick in which nothing is held."""
    return INITIAL._replace(refusal=find_unmet(p, request.impulse_n_s))


def find_bound(p: Parameters, ratio: float, guarded: bool, request: Request, impulse_n_s: float) -> Refusal:
    """The refusal if an end of the impact region limits the requested impulse or ratio, or NONE."""
    target_impulse_n_s = request.impulse_n_s
    if target_impulse_n_s <= 0.0:
        short = guarded and request.ratio - ratio > p.hold.largest_step
        return Refusal.RATIO_TOO_HIGH if short else Refusal.NONE
    if (guarded or ratio >= p.start.highest_ratio) and impulse_n_s < target_impulse_n_s * (
        1.0 - IMPULSE_TOLERANCE
    ):
        return Refusal.IMPULSE_TOO_HIGH
    if ratio <= p.hold.lowest_ratio and impulse_n_s > target_impulse_n_s * (1.0 + IMPULSE_TOLERANCE):
        return Refusal.IMPULSE_TOO_LOW
    return Refusal.NONE


def step(
    p: Parameters,
    state: HoldState,
    request: Request,
    base_ratio: float,
    regime: RegimeState,
    impact_n_s: float,
) -> HoldState:
    """One tick of a captured motion. `base_ratio`: the S-curve's end; `impact_n_s`: the last impact's."""
    unmet = find_unmet(p, request.impulse_n_s)
    if unmet != Refusal.NONE:
        request = request._replace(impulse_n_s=0.0)
    wanted_trim, guarded = state.wanted_trim, state.guarded
    bound_periods, impulse_n_s, refusal = state.bound_periods, state.impulse_n_s, state.refusal
    of_ratio = refusal in (Refusal.NONE, Refusal.RATIO_TOO_HIGH)
    if (
        unmet != Refusal.NONE
        or refusal == Refusal.IMPULSE_OUT_OF_RANGE
        or of_ratio != (request.impulse_n_s <= 0.0)
    ):
        refusal = unmet
    if regime.ended and regime.last.impacts == 1 and regime.second.impacts == 1:
        impulse_n_s = impact_n_s if impulse_n_s <= 0.0 else impulse_n_s + 0.5 * (impact_n_s - impulse_n_s)
        ratio = base_ratio + wanted_trim
        wanted = wanted_step(p, ratio, request, impulse_n_s)
        guard = phase_step(p, regime.last.phase_rad)
        guarded = guard < wanted
        moved = ratio + clamp(guard if guarded else wanted, p.hold.largest_step)
        moved = min(moved, p.start.highest_ratio)
        moved = max(moved, min(p.hold.lowest_ratio, base_ratio))
        wanted_trim = moved - base_ratio
        bound = find_bound(p, moved, guarded, request, impulse_n_s)
        bound_periods = bound_periods + 1 if bound != Refusal.NONE else 0
        is_settled = bound == Refusal.NONE or bound_periods >= p.hold.refusing_periods
        if unmet == Refusal.NONE and is_settled:
            refusal = bound
    dt_s = p.control.tick_s
    change = clamp(wanted_trim - state.trim, p.hold.rate_1_s * dt_s)
    return HoldState(
        trim=state.trim + change,
        trim_rate_1_s=change / dt_s,
        wanted_trim=wanted_trim,
        guarded=guarded,
        bound_periods=bound_periods,
        impulse_n_s=impulse_n_s,
        refusal=refusal,
    )
