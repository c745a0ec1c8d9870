"""Entry to the gait blocks: passes on the operator's request, or replaces it by one derived from the stride.

    accepts(own, lock) -> bool                        whether the crank can follow, as of the last tick
    ask(own, state, leg, operator, now) -> (state, request)

Without `gait.follow` the operator's request passes unchanged. An image for a drive that never follows a gait
contains none of the gait blocks.
"""

from typing import NamedTuple

from firmware_py.core.control import hold
from firmware_py.core.gait import gait, gait_lock, stride_harmonic
from firmware_py.core.gait.gait import Constants
from firmware_py.core.gait.gait_lock import Moment
from firmware_py.core.inputs import GaitInput, OperatorInput
from firmware_py.core.request import Request
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import Refusal


class WalkState(NamedTuple):
    """The wearer's stride, the crank's lock to it, and the turns per stride for an impulse."""

    gait: gait.CycleState
    gait_lock: gait_lock.LockState
    stride_harmonic: stride_harmonic.StrideHarmonicState


def is_built_in() -> bool:
    """Whether the gait blocks are part of the firmware; an image for a board may leave them out."""
    return True


def accepts(own: Constants, lock: gait_lock.LockState) -> bool:
    """Whether a request to run can be followed, as of the last tick."""
    return not is_built_in() or own.gait.follow == 0 or lock.refusal == Refusal.NONE


def ask(
    own: Constants, state: WalkState, leg: GaitInput, operator: OperatorInput, now: Moment
) -> tuple[WalkState, Request]:
    """One tick: the request to start and hold."""
    if not is_built_in():
        return state, operator_request(operator)
    cycle = state.gait
    if leg.age_ticks < NEVER_TICKS:
        cycle = gait.step(own, state.gait, leg)
    if own.gait.follow == 0:
        return state._replace(gait=cycle), operator_request(operator)
    lock = gait_lock.step(own, state.gait_lock, cycle, now, state.stride_harmonic.aim_ratio)
    impulse_n_s = operator.target_impulse_n_s
    target_n_s = impulse_n_s if hold.is_possible(own.hold, impulse_n_s) else 0.0
    harmonic = stride_harmonic.step(own, state.stride_harmonic, lock, now, target_n_s)
    request = Request(
        ratio=lock.base_ratio,
        impulse_n_s=impulse_n_s,
        sets_hold_ratio=True,
        trim=lock.trim,
        trim_rate_1_s=lock.trim_rate_1_s,
        refusal=lock.refusal,
        unmet=harmonic.refusal,
    )
    return WalkState(cycle, lock, harmonic), request


def operator_request(operator: OperatorInput) -> Request:
    """The operator's own request."""
    return Request(
        ratio=operator.target_ratio,
        impulse_n_s=operator.target_impulse_n_s,
        sets_hold_ratio=False,
        trim=0.0,
        trim_rate_1_s=0.0,
        refusal=Refusal.NONE,
        unmet=Refusal.NONE,
    )
