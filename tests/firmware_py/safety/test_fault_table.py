"""Every row of the fault table, provoked at the node by frames: code, reaction and deadline."""

import math
import re
from collections.abc import Callable, Mapping
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import pytest
from closed_loop import CONSENT_S, Bench, Change, bundled, instead, scene_with, without
from records import replaced

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Fault, Mode, OperatorRequest, Refusal
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    DriveCurrent,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
    FaultEvent,
    SetAxisState,
    SetInputTorque,
)
from plant_sim.parts.friction import Viscous

TAU = 2.0 * math.pi
SAFETY = Path(__file__).parents[3] / "docs" / "safety.md"
ROW = re.compile(r"^\| (\d+) \| ([A-Z_]+) \| .* \| ([\d.]+) s \|$", re.MULTILINE)
DEADLINE_S = {
    Fault(int(code)): float(seconds)
    for code, name, seconds in ROW.findall(SAFETY.read_text(encoding="utf-8"))
    if Fault(int(code)).name == name
}
"""The deadline of each fault on the page of safety."""


def doubtful_estimate(bench: Bench) -> None:
    """From now on the estimate's deviation is above its limit."""
    bench.configure(replaced(bench.node.config, "p.limit.position_std_m", 1e-6))


def show_position(bench: Bench, velocity_rev_s: float) -> None:
    """The encoder stands still, and reports this speed."""
    position_rev = bench.node.inputs.encoder.position_rev
    bench.change = instead(codec.ENCODER_ESTIMATES, EncoderEstimates(position_rev, velocity_rev_s))


def frozen_encoder(bench: Bench) -> None:
    show_position(bench, bench.node.inputs.encoder.velocity_rev_s)


def held_crank(bench: Bench) -> None:
    show_position(bench, 0.0)


def show_speed(bench: Bench, next_rad_s: Callable[[], float]) -> None:
    """The encoder of a crank that turns as it likes, whatever its torque."""
    position_rev = bench.node.inputs.encoder.position_rev

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        nonlocal position_rev
        omega_rad_s = next_rad_s()
        position_rev = (position_rev + 0.001 * omega_rad_s / TAU) % 1.0
        shown = EncoderEstimates(position_rev, omega_rad_s / TAU)
        return instead(codec.ENCODER_ESTIMATES, shown)(tick, frames)

    bench.change = change


def run_away(bench: Bench) -> None:
    """The crank gets 8 rad/s faster than it was, more slowly than any torque would have it."""
    start_rad_s, ticks = bench.node.state.crank.omega_rad_s, count(1)
    show_speed(bench, lambda: start_rad_s + min(0.1 * next(ticks), 8.0))


def go_on_in_a_stop(bench: Bench) -> None:
    """The crank follows its target down to 2 rad/s, and no further."""
    bench.request = OperatorRequest.IDLE
    show_speed(bench, lambda: max(bench.node.outputs.target_omega_rad_s, 2.0))


class Case(NamedTuple):
    """How to bring a fault about: the module moves for `moving_s`, then `cause` acts."""

    cause: Callable[[Bench], None]
    moving_s: float = 1.2
    parameters: Mapping[str, float] = MappingProxyType({})
    scene: Mapping[str, Any] = MappingProxyType(scene_with())


def change_to(change: Change) -> Callable[[Bench], None]:
    return lambda bench: setattr(bench, "change", change)


def rubbing_guide(bench: Bench) -> None:
    """The impact regime ends because the striker's guide takes its energy."""
    parts = bench.plant.parts
    bench.plant.replace_parts(parts._replace(friction=Viscous(b_n_s_m=4.0)))


def drive_with_an_error(bench: Bench) -> None:
    bench.axis_error, bench.axis_state = 0x200, AxisState.IDLE.value


def damaged_parameters(bench: Bench) -> None:
    bench.configure(bench.node.config._replace(parameters_damaged=True))


def request_of_the_test(bench: Bench) -> None:
    """The drive of this bench has no watchdog."""
    for request, duration_s in (
        (OperatorRequest.IDLE, 0.2),
        (OperatorRequest.PROVE_WATCHDOG, 0.2 + CONSENT_S),
    ):
        bench.request = request
        bench.run(duration_s, keep=False)
    assert bench.node.outputs.mode == Mode.PROOF


def nothing(bench: Bench) -> None:
    """What is wrong was there from the beginning."""


IMPACTS = {"start.rise_s": 1.0}
WEAK = {"speed.gain_p_n_m_s": 0.002, "speed.gain_i_n_m": 0.0}
"""Too weak a speed loop for its torque to be missed where the crank does not follow."""
CASES: dict[Fault, Case] = {
    Fault.SENSOR_TIMEOUT: Case(change_to(without(codec.ACCELEROMETER))),
    Fault.ENCODER_TIMEOUT: Case(change_to(without(codec.ENCODER_ESTIMATES))),
    Fault.DRIVE_TIMEOUT: Case(change_to(without(codec.DRIVE_HEARTBEAT))),
    Fault.OPERATOR_TIMEOUT: Case(change_to(without(codec.OPERATOR_COMMAND))),
    Fault.DRIVE_ERROR: Case(drive_with_an_error),
    Fault.DRIVE_FROZEN: Case(frozen_encoder),
    Fault.OVERSPEED: Case(change_to(instead(codec.ENCODER_ESTIMATES, EncoderEstimates(0.2, 7.0)))),
    Fault.OVERCURRENT: Case(change_to(instead(codec.DRIVE_CURRENT, DriveCurrent(1.0, 13.0)))),
    Fault.OVERTEMPERATURE: Case(change_to(instead(codec.DRIVE_TEMPERATURE, DriveTemperature(30.0, 95.0)))),
    Fault.UNDERVOLTAGE: Case(change_to(instead(codec.DRIVE_SUPPLY, DriveSupply(15.0, 0.5)))),
    Fault.OVERVOLTAGE: Case(change_to(instead(codec.DRIVE_SUPPLY, DriveSupply(33.0, 0.5)))),
    Fault.ESTIMATE_INVALID: Case(doubtful_estimate),
    Fault.STALL: Case(held_crank, 1.2, WEAK),
    Fault.PARAMETERS_DAMAGED: Case(damaged_parameters),
    Fault.DRIVE_WATCHDOG: Case(request_of_the_test, 0.1, {"watchdog.proof_required": 1.0}),
    Fault.STALE_SAMPLES: Case(lambda bench: setattr(bench, "change", bundled(16))),
    Fault.IMPULSE_LIMIT: Case(nothing, 0.0, IMPACTS | {"limit.impulse_n_s": 0.3}),
    Fault.FORCE_LIMIT: Case(nothing, 0.0, IMPACTS | {"limit.force_n": 60.0}),
    Fault.START_FAILED: Case(nothing, 0.0, {}, scene_with(stop={"position_m": 0.4})),
    Fault.RUNAWAY: Case(run_away, 1.2, WEAK),
    Fault.LOAD_IMPLAUSIBLE: Case(held_crank, 3.0),
    Fault.STOP_FAILED: Case(go_on_in_a_stop, 1.2, WEAK),
    Fault.ATTRACTOR_LOST: Case(rubbing_guide, 6.5, {"start.rise_s": 2.0, "start.attempts": 0.0}),
}


def events_of(records: list[Any]) -> list[FaultEvent]:
    return [record for record in records if isinstance(record, FaultEvent)]


@pytest.mark.parametrize("fault", CASES, ids=lambda fault: fault.name)
@pytest.mark.requirement("S-01", "S-08", "S-09", "S-11", "S-15")
def test_each_row(fault: Fault) -> None:
    case, deadline_s = CASES[fault], DEADLINE_S[fault]
    bench = Bench(dict(case.parameters), dict(case.scene)).started()
    bench.run(case.moving_s, keep=False)
    assert bench.node.outputs.fault == Fault.NONE
    case.cause(bench)
    from_tick, impact_tick, events = bench.tick, 0, []
    for _ in range(round(1000 * deadline_s) if case.cause is not nothing else 30_000):
        sent = bench.sent_in(0.001)
        impact_tick = bench.tick if bench.node.outputs.impact else impact_tick
        events += [event for event in events_of(sent) if event.fault != Fault.REQUEST_REFUSED]
        if events:
            break
    assert [(event.fault, event.refusal) for event in events] == [(fault, Refusal.NONE)]
    assert SetInputTorque(0.0) in sent
    assert bench.node.outputs.mode == Mode.FAULT
    assert bench.axis_state == AxisState.IDLE or SetAxisState(AxisState.IDLE) in sent
    since = impact_tick if fault in (Fault.IMPULSE_LIMIT, Fault.FORCE_LIMIT) else from_tick
    assert bench.tick - since <= 1000 * deadline_s
    # Latched: the cause gone and RUN still asked for, nothing moves again.
    bench.change = lambda _, frames: frames
    assert {record for record in bench.sent_in(0.3) if isinstance(record, SetInputTorque)} == {
        SetInputTorque(0.0)
    }
    assert bench.node.outputs.mode == Mode.FAULT
    assert bench.node.outputs.fault == fault


@pytest.mark.parametrize(
    ("impulse_n_s", "ratio", "refusal", "mode"),
    [
        (6.0, 1.3, Refusal.IMPULSE_OUT_OF_RANGE, Mode.SOFT_START),
        (0.0, 3.0, Refusal.RATIO_OUT_OF_RANGE, Mode.STOPPING),
    ],
)
def test_a_refused_request_is_said_once_and_latches_nothing(
    impulse_n_s: float, ratio: float, refusal: Refusal, mode: Mode
) -> None:
    bench = Bench().started()
    bench.run(1.0, keep=False)
    bench.impulse_n_s, bench.ratio = impulse_n_s, ratio
    events = events_of(bench.sent_in(0.3))
    assert [(event.fault, event.refusal) for event in events] == [(Fault.REQUEST_REFUSED, refusal)]
    assert bench.node.outputs.mode == mode
    assert bench.node.outputs.fault == Fault.NONE
    # Withdrawn, it can be refused again.
    bench.impulse_n_s, bench.ratio = 0.0, 1.3
    bench.run(0.2, keep=False)
    assert bench.node.outputs.refusal == Refusal.NONE


@pytest.mark.requirement("S-14")
def test_a_crank_that_the_striker_drives_is_waited_for() -> None:
    """Free after power-up it turns faster than motion allows; half a second after, the start begins."""
    fast = scene_with(initial={"x_m": 0.02, "v_m_s": 0.4}, drive={"phase_rad": 0.5})
    bench = Bench(scene=fast)
    bench.run(0.3)
    assert bench.node.outputs.mode == Mode.READY
    bench.request = OperatorRequest.RUN
    sent = bench.sent_in(0.7, keep=True)
    assert max(abs(state.crank.omega_rad_s) for state in bench.states) > 25.0
    assert bench.node.outputs.mode == Mode.READY
    assert {outputs.torque_n_m for outputs in bench.outputs} == {0.0}
    assert [(event.fault, event.refusal) for event in events_of(sent)] == [
        (Fault.REQUEST_REFUSED, Refusal.CRANK_TOO_FAST)
    ]
    bench.run(0.05)
    assert (bench.node.outputs.mode, bench.node.outputs.refusal) == (Mode.SOFT_START, Refusal.NONE)
    bench.run(1.0)
    assert bench.node.outputs.mode == Mode.SOFT_START
    assert all(outputs.fault == Fault.NONE for outputs in bench.outputs)


def test_the_page_has_every_fault_once_and_all_but_a_refusal_are_provoked() -> None:
    assert list(DEADLINE_S) == [fault for fault in Fault if fault != Fault.NONE]
    assert set(CASES) == set(DEADLINE_S) - {Fault.REQUEST_REFUSED}
