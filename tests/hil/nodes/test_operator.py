"""The operator's script on the bus."""

from collections.abc import Callable

import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import Fault, Mode, OperatorRequest, Regime
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import FirmwareHeartbeat, OperatorCommand
from hil.nodes.operator.node import OperatorNode
from hil.scenario.commands import Command, Request

ESTOP_ID = codec.DRIVE_ESTOP.can_id
REPEAT_MS = 20
Reply = Callable[[int], list[Frame]]


def heartbeat(mode: Mode) -> Frame:
    return codec.FIRMWARE_HEARTBEAT.encode(FirmwareHeartbeat(mode, 0, Fault.NONE, 0.0, Regime.UNCERTAIN))


def play(
    commands: list[Command], until_s: float, reply: Reply = lambda _: [], period_s: float = 1e-3
) -> list[tuple[float, Frame]]:
    """The frames sent, each with its time in s; `reply` returns the frames received before a tick."""
    operator = OperatorNode(commands, period_s)
    sent, received = [], []
    for tick in range(round(until_s / period_s)):
        received += reply(tick)
        if tick >= operator.due_tick:
            sent += [(round(tick * period_s, 6), frame) for frame in operator.publish(tick, received)]
            received = []
    return sent


def commands_of(sent: list[tuple[float, Frame]]) -> list[tuple[float, OperatorCommand]]:
    return [
        (t_s, codec.OPERATOR_COMMAND.decode(frame.data))
        for t_s, frame in sent
        if frame.can_id == codec.OPERATOR_COMMAND.can_id
    ]


def estops_of(sent: list[tuple[float, Frame]]) -> list[float]:
    return [t_s for t_s, frame in sent if frame.can_id == ESTOP_ID]


def test_command_is_repeated_ten_times_a_second_with_a_rolling_counter() -> None:
    sent = play([], until_s=3.0)
    assert [t_s for t_s, _ in sent] == [round(0.1 * number, 3) for number in range(30)]
    assert {command for _, command in commands_of(sent)} == {OperatorCommand(OperatorRequest.IDLE, 0.0, 0.0)}
    counters = [codec.OPERATOR_COMMAND.counter(frame.data) for _, frame in sent]
    assert counters == [number % 16 for number in range(30)]


def test_change_leaves_at_once_and_the_rhythm_stays() -> None:
    sent = commands_of(play([Command(0.253, Request.RUN, 1.3)], until_s=0.5))
    assert [(t_s, command.request) for t_s, command in sent] == [
        (0.0, OperatorRequest.IDLE),
        (0.1, OperatorRequest.IDLE),
        (0.2, OperatorRequest.IDLE),
        (0.253, OperatorRequest.RUN),
        (0.3, OperatorRequest.RUN),
        (0.4, OperatorRequest.RUN),
    ]
    assert sent[-1][1].target_ratio == 1.3


@pytest.mark.parametrize("period_s", [0.25e-3, 1e-3, 4e-3])
def test_an_e_stop_leaves_in_its_tick_and_is_repeated_until_it_is_confirmed(period_s: float) -> None:
    script = [Command(0.1, Request.RUN, 1.1), Command(0.204, Request.E_STOP, 0.0)]
    confirmed = round(0.3 / period_s)
    sent = play(script, 1.0, lambda tick: [heartbeat(Mode.E_STOP)] if tick == confirmed else [], period_s)
    estops = estops_of(sent)
    assert estops == pytest.approx([0.204 + 0.02 * k for k in range(len(estops))])
    assert 0.28 < estops[-1] < 0.32
    after = {command.request for t_s, command in commands_of(sent) if t_s > 0.204}
    assert after == {OperatorRequest.IDLE}


@pytest.mark.parametrize("last", list(Request))
@pytest.mark.parametrize("after_s", [0.0, 0.001, 0.004, 0.0401])
def test_nothing_supersedes_an_e_stop(last: Request, after_s: float) -> None:
    """Neither a later command, in its instant or after it, nor the operator's own absence."""
    script = [
        Command(1.0, Request.RUN, 1.1),
        Command(2.001, Request.E_STOP, 0.0),
        Command(2.001 + after_s, last, 1.1 if last is Request.RUN else 0.0),
    ]
    never = play(script, 3.0)
    assert len(estops_of(never)) >= (3.0 - 2.001) / 0.02 - 1
    assert estops_of(never)[0] == 2.001
    assert {command.request for t_s, command in commands_of(never) if t_s > 2.0} == {OperatorRequest.IDLE}
    # Once the firmware has confirmed it, the last command of the script acts.
    sent = play(script, 3.0, lambda tick: [heartbeat(Mode.E_STOP)] if tick % 100 == 7 else [])
    assert estops_of(sent)[-1] < 2.15
    after = [command.request for t_s, command in commands_of(sent) if t_s > 2.2]
    if last is Request.SILENT:
        assert not after
    else:
        wanted = {
            Request.RUN: OperatorRequest.RUN,
            Request.CLEAR_FAULTS: OperatorRequest.CLEAR_FAULTS,
            Request.PROVE_WATCHDOG: OperatorRequest.PROVE_WATCHDOG,
        }
        assert set(after) == {wanted.get(last, OperatorRequest.IDLE)}


@pytest.mark.parametrize("first", [Request.IDLE, Request.RUN, Request.CLEAR_FAULTS, Request.SILENT])
def test_an_e_stop_wins_over_an_earlier_line_of_its_instant(first: Request) -> None:
    script = [Command(2.0, first, 1.1), Command(2.0, Request.E_STOP, 0.0)]
    assert estops_of(play(script, 2.1))[0] == 2.0


def test_a_heartbeat_from_before_the_e_stop_confirms_nothing() -> None:
    """E_STOP may be latched from an earlier one; a heartbeat under way as the E-stop leaves is no answer."""
    script = [Command(0.504, Request.E_STOP, 0.0)]
    for tick in range(400, 504 + REPEAT_MS):
        sent = play(script, 0.7, lambda t, at=tick: [heartbeat(Mode.E_STOP)] if t == at else [])
        assert len(estops_of(sent)) == 10
    for mode in set(Mode) - {Mode.E_STOP}:
        assert len(estops_of(play(script, 0.7, lambda _, mode=mode: [heartbeat(mode)]))) == 10


def test_a_corrupted_heartbeat_confirms_nothing() -> None:
    can_id, data = heartbeat(Mode.E_STOP)
    broken = Frame(can_id, bytes((data[0], data[1] ^ 1, *data[2:])))
    sent = play(
        [Command(0.1, Request.E_STOP, 0.0)], 0.5, lambda _: [broken, Frame(can_id, b""), Frame(5, b"")]
    )
    assert len(estops_of(sent)) == 20


def test_an_e_stop_in_the_last_tick_of_the_script_leaves() -> None:
    for at_ms in range(1995, 2000):
        sent = play([Command(1.0, Request.RUN, 1.1), Command(0.001 * at_ms, Request.E_STOP, 0.0)], 2.0)
        assert estops_of(sent) == [0.001 * at_ms]


def test_an_e_stop_by_hand_is_sent_as_one_of_the_script() -> None:
    operator = OperatorNode([Command(0.0, Request.RUN, 1.1)], 1e-3)
    assert operator.publish(0)
    operator.emergency_stop(3)
    assert operator.due_tick <= 3
    assert [frame.can_id for frame in operator.publish(3)] == [ESTOP_ID]
    assert operator.estop_is_unconfirmed
    operator.publish(50, [heartbeat(Mode.E_STOP)])
    assert not operator.estop_is_unconfirmed


def test_silent_operator_sends_nothing_until_it_is_back() -> None:
    sent = commands_of(
        play([Command(0.15, Request.SILENT, 0.0), Command(0.5, Request.IDLE, 0.0)], until_s=0.7)
    )
    assert [t_s for t_s, _ in sent] == [0.0, 0.1, 0.5, 0.6]


def test_record_says_what_is_asked_for_at_which_tick() -> None:
    operator = OperatorNode([Command(0.02, Request.E_STOP, 0.0)], 0.5e-3)
    operator.publish(40)
    assert operator.record() == (40, 0.02, OperatorRequest.IDLE, 0.0, 0.0, True)


def test_an_impulse_asked_for_goes_out_with_the_ratio() -> None:
    sent = commands_of(play([Command(0.1, Request.RUN, 1.2, 0.85)], until_s=0.3))
    assert sent[-1][1].target_ratio == pytest.approx(1.2)
    assert sent[-1][1].target_impulse_n_s == pytest.approx(0.85)
    assert sent[0][1].target_impulse_n_s == 0.0
