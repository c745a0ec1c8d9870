"""Commands that are lost, repeated or recorded, and those of a second sender: the live operator starts."""

import pytest
from closed_loop import Bench

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Fault, Mode, OperatorRequest, Refusal
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import OperatorCommand
from firmware_py.interface.modes import MOVING
from tools.dev import operator_sequences

COUNT = 400
IDLE, RUN = OperatorRequest.IDLE, OperatorRequest.RUN
COMMAND_ID = codec.OPERATOR_COMMAND.can_id


def command(request: OperatorRequest, counter: int, ratio: float = 1.3) -> Frame:
    return codec.OPERATOR_COMMAND.encode(OperatorCommand(request, ratio, 0.0), counter)


def without_operator(frames: list[Frame]) -> list[Frame]:
    return [frame for frame in frames if frame.can_id != COMMAND_ID]


def event_refusals(bench: Bench, seconds: float) -> set[int]:
    events = [record for record in bench.sent_in(seconds) if type(record).__name__ == "FaultEvent"]
    return {event.refusal for event in events}


# --- attacks --------------------------------------------------------------------------------------------


@pytest.mark.requirement("S-08")
@pytest.mark.parametrize("counters", [(1, 2), (5, 13), (0, 4, 8, 12), (3, 9, 14)])
def test_recorded_commands_in_turn_do_not_replace_an_operator_who_has_left(counters: tuple[int, ...]) -> None:
    left_tick = 1000

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick < left_tick:
            return frames
        recorded = [command(RUN, counters[tick // 50 % len(counters)])] if tick % 50 == 7 else []
        return [*without_operator(frames), *recorded]

    bench = Bench({"start.rise_s": 0.5}, change=change).started()
    bench.run(1e-3 * left_tick - 0.4)
    assert bench.mode == Mode.SOFT_START
    bench.run(0.9)
    assert bench.mode not in MOVING
    bench.run(5.0, keep=False)
    assert bench.mode not in MOVING


@pytest.mark.requirement("S-13")
@pytest.mark.parametrize("recorded", [(3,), (3, 4), (3, 4, 5), tuple(range(16))])
def test_recorded_commands_beside_an_operator_at_rest_start_nothing(recorded: tuple[int, ...]) -> None:
    """Every 50 ms, at every phase to the operator's own commands; two senders are reported."""
    for phase in (0, 1, 20, 49):

        def change(tick: int, frames: list[Frame], phase: int = phase) -> list[Frame]:
            place = tick // 50 % len(recorded)
            return [*frames, command(RUN, recorded[place])] if tick % 50 == phase else frames

        bench = Bench(change=change)
        refusals = event_refusals(bench, 3.0)
        modes = {Mode(int(mode)) for mode in (bench.mode,)}
        assert modes <= {Mode.INIT, Mode.READY}
        assert all(outputs.mode not in MOVING for outputs in bench.outputs)
        assert Refusal.OUT_OF_SEQUENCE in refusals
        assert bench.node.counters.rejected_sequence > 10


@pytest.mark.parametrize("rhythm", [10, 50, 100])
def test_recorded_commands_in_the_place_of_two_lost_ones_start_nothing(rhythm: int) -> None:
    """They continue the sequence until the operator's next command: the time for which RUN is repeated."""

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        if not 1001 <= tick < 1300:
            return frames
        recorded = [command(RUN, 10 + (tick - 1001) // rhythm + 1)] if (tick - 1001) % rhythm == 0 else []
        return [*without_operator(frames), *recorded]

    bench = Bench(change=change)
    bench.run(2.5)
    assert all(outputs.torque_n_m == 0.0 for outputs in bench.outputs)
    assert bench.axis_state == AxisState.IDLE


def test_a_stop_is_not_hidden_by_recorded_commands_that_count_ahead_of_the_operator() -> None:
    """Each recorded RUN is the next of the sequence; the operator's own IDLE then is out of sequence."""
    stop_tick = 1000

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        ahead = tick > stop_tick - 100 and tick % 100 == 99
        return [*frames, command(RUN, tick // 100 + 1, 1.2)] if ahead else frames

    bench = Bench({"start.rise_s": 0.5, "start.stop_s": 0.3}, change=change).started()
    bench.run(0.5)
    assert bench.mode == Mode.SOFT_START
    bench.run(0.1)
    bench.request = IDLE
    bench.run(1.0)
    assert bench.mode not in MOVING


def test_a_restarted_operator_counts_after_three_commands_and_asks_anew() -> None:
    restart_tick = 1000

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick < restart_tick or tick % 100:
            return frames
        again = (tick - restart_tick) // 100 + 2
        return [*without_operator(frames), command(bench.request, again)]

    bench = Bench({"start.rise_s": 0.5, "start.stop_s": 0.3}, change=change).started()
    bench.run(1e-3 * restart_tick - 0.4)
    assert bench.mode == Mode.SOFT_START
    bench.run(1.5)
    assert bench.node.counters.new_sequences == 1
    assert (bench.mode, bench.node.outputs.fault) == (Mode.READY, Fault.NONE)
    assert bench.asked_again() == Mode.SOFT_START


def test_a_lost_command_costs_nothing() -> None:
    """Nor do two in a row, while a request is to count and in motion."""
    lost = {3, 8, 9, 14, 15}
    bench = Bench(
        {"start.rise_s": 0.5},
        change=lambda tick, frames: without_operator(frames) if tick // 100 in lost else frames,
    ).started()
    bench.run(0.2)
    assert bench.mode == Mode.SOFT_START
    bench.run(1.4)
    assert (bench.mode in MOVING, bench.node.outputs.fault) == (True, Fault.NONE)


# --- any sequence ---------------------------------------------------------------------------------------


def test_no_sequence_of_commands_brings_torque_that_the_live_operator_did_not_ask_for() -> None:
    """A share of those of `python -m tools.dev.operator_sequences`."""
    scenario = operator_sequences.quick_scenario()
    found = [operator_sequences.run_sequence(scenario, number) for number in range(COUNT)]
    assert not {number: one.unasked_s[0] for number, one in enumerate(found) if one.unasked_s}
    assert sum(one.driven > 0 for one in found) > COUNT // 8
