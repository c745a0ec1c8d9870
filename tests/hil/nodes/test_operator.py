"""The operator's script on the bus."""

import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import OperatorCommand
from hil.scenario.operator import OPERATOR_PERIOD_S, Command, OperatorNode, Request

ESTOP_ID = codec.DRIVE_ESTOP.can_id


def play(commands: list[Command], until_s: float) -> list[tuple[float, Frame]]:
    operator = OperatorNode(commands, bench_period_s=1e-3)
    return [
        (period * OPERATOR_PERIOD_S, frame)
        for period in range(round(until_s / OPERATOR_PERIOD_S))
        for frame in operator.publish(period)
    ]


def commands_of(sent: list[tuple[float, Frame]]) -> list[tuple[float, OperatorCommand]]:
    return [
        (round(t_s, 3), codec.OPERATOR_COMMAND.decode(frame.data))
        for t_s, frame in sent
        if frame.can_id == codec.OPERATOR_COMMAND.can_id
    ]


def test_command_is_repeated_ten_times_a_second_with_a_rolling_counter() -> None:
    sent = play([], until_s=3.0)
    assert [round(t_s, 3) for t_s, _ in sent] == [round(0.1 * number, 3) for number in range(30)]
    assert {command for _, command in commands_of(sent)} == {OperatorCommand(OperatorRequest.IDLE, 0.0, 0.0)}
    counters = [codec.OPERATOR_COMMAND.counter(frame.data) for _, frame in sent]
    assert counters == [number % 16 for number in range(30)]


def test_change_leaves_at_once_and_the_rhythm_stays() -> None:
    sent = commands_of(play([Command(0.25, Request.RUN, 1.3)], until_s=0.5))
    assert [(t_s, command.request) for t_s, command in sent] == [
        (0.0, OperatorRequest.IDLE),
        (0.1, OperatorRequest.IDLE),
        (0.2, OperatorRequest.IDLE),
        (0.25, OperatorRequest.RUN),
        (0.3, OperatorRequest.RUN),
        (0.4, OperatorRequest.RUN),
    ]
    assert sent[-1][1].target_ratio == 1.3


def test_estop_goes_out_first_and_asks_for_nothing_more_until_released() -> None:
    script = [
        Command(0.1, Request.RUN, 1.1),
        Command(0.23, Request.E_STOP, 0.0),
        Command(0.4, Request.IDLE, 0.0),
    ]
    sent = play(script, until_s=0.6)
    assert [round(t_s, 3) for t_s, frame in sent if frame.can_id == ESTOP_ID] == [0.23, 0.3]
    at_stop = [(round(t_s, 3), frame.can_id) for t_s, frame in sent if 0.225 < t_s < 0.255]
    assert at_stop == [(0.23, ESTOP_ID), (0.24, codec.OPERATOR_COMMAND.can_id)]
    after = [command.request for t_s, command in commands_of(sent) if t_s >= 0.23]
    assert set(after) == {OperatorRequest.IDLE}


def test_silent_operator_sends_nothing_until_it_is_back() -> None:
    sent = commands_of(
        play([Command(0.15, Request.SILENT, 0.0), Command(0.5, Request.IDLE, 0.0)], until_s=0.7)
    )
    assert [t_s for t_s, _ in sent] == [0.0, 0.1, 0.5, 0.6]


def test_record_says_what_is_asked_for_at_which_tick() -> None:
    operator = OperatorNode([Command(0.02, Request.E_STOP, 0.0)], bench_period_s=0.5e-3)
    operator.publish(2)
    assert operator.record(2) == (40, 0.02, OperatorRequest.IDLE, 0.0, 0.0, True)


def test_an_impulse_asked_for_goes_out_with_the_ratio() -> None:
    sent = commands_of(play([Command(0.1, Request.RUN, 1.2, 0.85)], until_s=0.3))
    assert sent[-1][1].target_ratio == pytest.approx(1.2)
    assert sent[-1][1].target_impulse_n_s == pytest.approx(0.85)
    assert sent[0][1].target_impulse_n_s == 0.0
