"""Entry to the gait blocks: passes on the operator's request, or replaces it by one derived from the stride.

    accepts(own, lock) -> bool                        whether the crank can follow, as of the last tick
    ask(p, own, cycle, lock, harmonic, inputs, now) -> (cycle, lock, harmonic, request)

Without `gait.follow` the operator's request passes unchanged. An image for a drive that never follows a gait
contains none of the gait blocks.
"""

from firmware_py.core.control import hold
from firmware_py.core.gait import gait, gait_lock, stride_harmonic
from firmware_py.core.gait.gait import Constants, CycleState
from firmware_py.core.gait.gait_lock import LockState, Moment
from firmware_py.core.gait.stride_harmonic import StrideHarmonicState
from firmware_py.core.inputs import Inputs, OperatorInput
from firmware_py.core.request import Request
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import Refusal
from firmware_py.interface.generated.parameters import Parameters


def is_built_in() -> bool:
    """Whether the gait blocks are part of the firmware; an image for a board may leave them out."""
    return True


def accepts(own: Constants, lock: LockState) -> bool:
    """Whether a request to run can be followed, as of the last tick."""
    return not is_built_in() or own.gait.follow == 0 or lock.refusal == Refusal.NONE


def ask(
    p: Parameters,
    own: Constants,
    cycle: CycleState,
    lock: LockState,
    harmonic: StrideHarmonicState,
    inputs: Inputs,
    now: Moment,
) -> tuple[CycleState, LockState, StrideHarmonicState, Request]:
    """One tick: the gait blocks' states, and the request to start and hold."""
    request = operator_request(inputs.operator)
    if not is_built_in():
        return cycle, lock, harmonic, request
    if inputs.gait.age_ticks < NEVER_TICKS:
        cycle = gait.step(own, cycle, inputs.gait)
    if own.gait.follow == 0:
        return cycle, lock, harmonic, request
    lock = gait_lock.step(own, lock, cycle, now, harmonic.aim_ratio)
    target_n_s = request.impulse_n_s if hold.is_possible(p, request.impulse_n_s) else 0.0
    harmonic = stride_harmonic.step(own, harmonic, lock, now, target_n_s)
    request = Request(
        ratio=lock.base_ratio,
        impulse_n_s=request.impulse_n_s,
        sets_hold_ratio=True,
        trim=lock.trim,
        trim_rate_1_s=lock.trim_rate_1_s,
        refusal=lock.refusal,
        unmet=harmonic.refusal,
    )
    return cycle, lock, harmonic, request


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
