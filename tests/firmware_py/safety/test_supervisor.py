"""Every mode against every combination of conditions, held to rules written independently of the code."""

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest

from firmware_py.core.safety import supervisor, watchdog_proof
from firmware_py.core.safety.gate import Findings
from firmware_py.core.safety.supervisor import Observed, SupervisorState, find_fault, transition
from firmware_py.core.safety.watchdog_proof import ProofState
from firmware_py.interface.enums import Fault, Mode, OperatorRequest
from firmware_py.interface.modes import LATCHED, MOVING
from firmware_py.interface.zeroed import zeroed

NO_FINDINGS = zeroed(Findings, watchdog=Fault.NONE, limit=Fault.NONE, drive=Fault.NONE)


OBSERVED = zeroed(
    Observed,
    standstill=True,
    request=OperatorRequest.IDLE,
    disarm_reason=0x200,
    target_valid=True,
    axis_idle=True,
    proven=True,
)
BOTH = (False, True)


def combinations(record: Any, **values: Iterable[object]) -> list[Any]:
    """The record with every combination of the values of some fields."""
    return [record._replace(**dict(zip(values, chosen, strict=True))) for chosen in product(*values.values())]


CONDITIONS = [
    *product(
        (supervisor.INITIAL,),
        (Fault.NONE, Fault.OVERSPEED),
        combinations(
            NO_FINDINGS,
            watchdog=(Fault.NONE, Fault.SENSOR_TIMEOUT),
            drive=(Fault.NONE, Fault.DRIVE_ERROR),
            operator_lost=BOTH,
        ),
        combinations(
            OBSERVED,
            request=OperatorRequest,
            **dict.fromkeys(
                ("standstill", "too_fast", "estop", "target_valid", "axis_idle", "captured", "proof_passed"),
                BOTH,
            ),
            proven=BOTH,
        ),
    )
]


@pytest.mark.parametrize("mode", list(Mode))
def test_every_mode_under_every_condition(mode: Mode) -> None:  # noqa: PLR0912 - one rule after the other
    for state, fault, findings, now in CONDITIONS:
        after = transition(state._replace(mode=mode), fault, findings, now)
        assert isinstance(after, Mode)
        all_fresh = not findings.operator_lost and findings.watchdog == Fault.NONE
        wants_run = now.request == OperatorRequest.RUN
        if now.estop:
            assert after == Mode.E_STOP
            continue
        # Motion begins in one place only: out of READY, asked for by a fresh operator.
        if after in MOVING and mode not in MOVING:
            assert (mode, after) == (Mode.READY, Mode.SOFT_START)
            assert wants_run
            assert now.axis_idle
            assert all_fresh
            assert now.target_valid
            assert now.proven
            assert not now.too_fast
            assert fault == Fault.NONE
        # A fault ends all motion in the same tick, and keeps it from beginning.
        if fault != Fault.NONE and mode in (*MOVING, Mode.READY, Mode.INIT, Mode.PROOF):
            assert after == Mode.FAULT
        # What is latched is left only for INIT, by a request to clear, with the cause gone.
        if mode in LATCHED:
            cleared = now.request == OperatorRequest.CLEAR_FAULTS
            assert after == (Mode.INIT if cleared and fault == Fault.NONE else mode)
        if mode == Mode.INIT and fault == Fault.NONE:
            assert after == (Mode.READY if all_fresh and findings.drive == Fault.NONE else Mode.INIT)
        runs_on = wants_run and now.target_valid
        if mode in (Mode.SOFT_START, Mode.RUN) and fault == Fault.NONE and not runs_on:
            assert after == Mode.STOPPING
        if mode == Mode.SOFT_START and fault == Fault.NONE and runs_on:
            assert after == (Mode.RUN if now.captured else Mode.SOFT_START)
        if mode == Mode.RUN and fault == Fault.NONE and runs_on:
            assert after == Mode.RUN
        if mode == Mode.STOPPING and fault == Fault.NONE:
            assert after == (Mode.READY if now.standstill else Mode.STOPPING)
        asked = now.request == OperatorRequest.PROVE_WATCHDOG
        if mode == Mode.READY and fault == Fault.NONE:
            may_close = now.axis_idle and not now.too_fast
            wanted = Mode.READY
            if runs_on and may_close and now.proven:
                wanted = Mode.SOFT_START
            if asked and may_close and now.standstill:
                wanted = Mode.PROOF
            assert after == (wanted if all_fresh else Mode.INIT)
        # The test of the drive's watchdog lasts while it is asked for; afterwards all conditions count again.
        if mode == Mode.PROOF and fault == Fault.NONE:
            assert after == (Mode.READY if now.proof_passed else Mode.PROOF if asked else Mode.INIT)
        if after == Mode.PROOF:
            assert mode in (Mode.READY, Mode.PROOF)
        # Clearing never arms.
        if now.request == OperatorRequest.CLEAR_FAULTS:
            assert after not in (Mode.SOFT_START, Mode.RUN, Mode.PROOF) or mode == after == Mode.PROOF


TESTED = (*MOVING, Mode.PROOF)
"""Modes in which the axis may be closed."""
WATCHDOG = NO_FINDINGS._replace(watchdog=Fault.SENSOR_TIMEOUT)
LIMIT = NO_FINDINGS._replace(limit=Fault.OVERCURRENT)
FAST = NO_FINDINGS._replace(overspeed=True)
DRIVE = NO_FINDINGS._replace(drive=Fault.DRIVE_ERROR)
ALONE = NO_FINDINGS._replace(operator_lost=True)
DAMAGED = OBSERVED._replace(parameters_damaged=True)
FAILED = OBSERVED._replace(start_failed=True)


@pytest.mark.parametrize(
    ("findings", "now", "expected"),
    [
        (NO_FINDINGS, OBSERVED, {}),
        (WATCHDOG, OBSERVED, dict.fromkeys((*TESTED, *LATCHED), Fault.SENSOR_TIMEOUT)),
        (LIMIT, OBSERVED, dict.fromkeys((*TESTED, *LATCHED, Mode.READY), Fault.OVERCURRENT)),
        (FAST, OBSERVED, dict.fromkeys((*TESTED, *LATCHED), Fault.OVERSPEED)),
        (DRIVE, OBSERVED, dict.fromkeys((*TESTED, Mode.READY), Fault.DRIVE_ERROR)),
        (ALONE, OBSERVED, dict.fromkeys(TESTED, Fault.OPERATOR_TIMEOUT)),
        (NO_FINDINGS, DAMAGED, dict.fromkeys(Mode, Fault.PARAMETERS_DAMAGED)),
        (WATCHDOG, DAMAGED._replace(start_failed=True), dict.fromkeys(Mode, Fault.PARAMETERS_DAMAGED)),
        (NO_FINDINGS, FAILED, {Mode.SOFT_START: Fault.START_FAILED, Mode.RUN: Fault.ATTRACTOR_LOST}),
    ],
)
def test_which_finding_is_a_fault_in_which_mode(
    findings: Findings, now: Observed, expected: dict[Mode, Fault]
) -> None:
    for mode in Mode:
        assert find_fault(mode, findings, now) == expected.get(mode, Fault.NONE), mode


def test_a_failed_test_of_the_watchdog_is_a_fault_in_proof_alone() -> None:
    for mode in Mode:
        wanted = Fault.DRIVE_WATCHDOG if mode == Mode.PROOF else Fault.NONE
        assert find_fault(mode, NO_FINDINGS, OBSERVED._replace(proof_failed=True)) == wanted
    state = supervisor.INITIAL._replace(mode=Mode.PROOF)
    asked = OperatorRequest.PROVE_WATCHDOG
    failed = step(state, request=asked, proof=watchdog_proof.INITIAL._replace(failed=True))
    assert (failed.mode, failed.fault) == (Mode.FAULT, Fault.DRIVE_WATCHDOG)
    passed = step(state, request=asked, proof=watchdog_proof.INITIAL._replace(passed=True))
    assert passed.mode == Mode.READY


def step(
    state: SupervisorState,
    findings: Findings = NO_FINDINGS,
    request: OperatorRequest = OperatorRequest.IDLE,
    estop: bool = False,
    captured: bool = False,
    failed: bool = False,
    axis_idle: bool = True,
    standstill: bool = True,
    proof: ProofState = watchdog_proof.INITIAL,
) -> SupervisorState:
    now = OBSERVED._replace(
        request=request,
        estop=estop,
        captured=captured,
        start_failed=failed,
        axis_idle=axis_idle,
        standstill=standstill,
        proof_passed=proof.passed,
        proof_failed=proof.failed,
    )
    return supervisor.step(state, findings, now)


def test_nothing_is_remembered_at_power_up() -> None:
    assert SupervisorState(Mode.INIT, Fault.NONE, 0) == supervisor.INITIAL


@pytest.mark.requirement("S-10")
def test_the_way_to_motion_and_back() -> None:
    state = supervisor.INITIAL
    modes = []
    for request, findings, captured, standstill in [
        (OperatorRequest.RUN, WATCHDOG, False, True),
        (OperatorRequest.IDLE, NO_FINDINGS, False, True),
        (OperatorRequest.IDLE, NO_FINDINGS, False, True),
        (OperatorRequest.RUN, NO_FINDINGS, False, True),
        (OperatorRequest.RUN, NO_FINDINGS, True, False),
        (OperatorRequest.IDLE, NO_FINDINGS, True, False),
        (OperatorRequest.IDLE, NO_FINDINGS, False, False),
        (OperatorRequest.IDLE, NO_FINDINGS, False, True),
    ]:
        state = step(state, findings, request, captured=captured, standstill=standstill)
        modes.append(state.mode)
        assert (state.fault, state.disarm_reason) == (Fault.NONE, 0)
    assert modes == [
        Mode.INIT,
        Mode.READY,
        Mode.READY,
        Mode.SOFT_START,
        Mode.RUN,
        Mode.STOPPING,
        Mode.STOPPING,
        Mode.READY,
    ]


def running() -> SupervisorState:
    return supervisor.INITIAL._replace(mode=Mode.RUN)


@pytest.mark.requirement("S-11")
def test_the_first_reason_stays_latched() -> None:
    state = step(running(), FAST, OperatorRequest.RUN)
    assert (state.mode, state.fault, state.disarm_reason) == (Mode.FAULT, Fault.OVERSPEED, 0)
    state = step(state, WATCHDOG, OperatorRequest.RUN)
    assert state.fault == Fault.OVERSPEED
    state = step(state, NO_FINDINGS, OperatorRequest.IDLE)
    assert (state.mode, state.fault) == (Mode.FAULT, Fault.OVERSPEED)


def test_the_drives_reason_is_latched_when_it_arrives() -> None:
    """The drive says that it is in error before it says why; what it says later is of no interest."""
    drive = NO_FINDINGS._replace(drive=Fault.DRIVE_ERROR)
    state = running()
    for arriving, latched in ((0, 0), (0, 0), (0x200, 0x200), (0x100, 0x200)):
        request = OperatorRequest.RUN
        state = supervisor.step(state, drive, OBSERVED._replace(request=request, disarm_reason=arriving))
        assert (state.mode, state.fault) == (Mode.FAULT, Fault.DRIVE_ERROR)
        assert state.disarm_reason == latched


@pytest.mark.requirement("S-13")
def test_a_cause_that_stands_cannot_be_cleared() -> None:
    state = step(running(), WATCHDOG, OperatorRequest.RUN)
    state = step(state, WATCHDOG, OperatorRequest.IDLE)
    assert step(state, WATCHDOG, OperatorRequest.CLEAR_FAULTS).mode == Mode.FAULT
    assert step(state, DRIVE, OperatorRequest.CLEAR_FAULTS).mode == Mode.INIT


def test_a_fault_before_an_e_stop_keeps_its_reason() -> None:
    state = step(running(), LIMIT, OperatorRequest.RUN)
    assert step(state, estop=True).fault == Fault.OVERCURRENT
