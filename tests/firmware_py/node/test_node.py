"""The node by frames alone: what it drops, what it counts, what it sends and when."""

import math
from collections.abc import Callable
from typing import Any

import pytest
from closed_loop import Bench
from xcp_session import calibrate, command

from firmware_py.interface import codec
from firmware_py.interface.arrivals import NEVER_TICKS
from firmware_py.interface.enums import (
    AxisState,
    Fault,
    Mode,
    OperatorRequest,
    XcpCommandCode,
    XcpError,
)
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    Accelerometer,
    DriveErrors,
    DriveTemperature,
    EncoderEstimates,
    FaultEvent,
    FirmwareHeartbeat,
    GaitSensors,
    OperatorCommand,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetLimits,
)
from firmware_py.shell.node import FirmwareNode, power_up
from firmware_py.shell.parameters import DEFAULTS, config_from, format_file

G = 9.80665


def node() -> FirmwareNode:
    return FirmwareNode(config_from({}))


IDLE = SetAxisState(AxisState.IDLE)


def is_drives(record: object) -> bool:
    """Whether the drive obeys such a record."""
    return isinstance(record, SetInputTorque | SetAxisState | SetControllerMode | SetLimits)


def sample(counter: int, low: float = 1.0) -> Frame:
    return codec.ACCELEROMETER.encode(Accelerometer(low, low, 0.0), counter)


def test_ages_count_elapsed_ticks() -> None:
    one = node()
    one.tick([sample(0)], 1)
    assert one.inputs.accelerometer.age_ticks == 0
    one.tick([], 1)
    one.tick([], 3)
    assert one.inputs.accelerometer.age_ticks == 4
    assert one.counters.skipped_ticks == 2


def test_a_tick_cannot_come_before_the_last() -> None:
    with pytest.raises(ValueError, match="elapsed_ticks = 0"):
        node().tick([], 0)


def test_bad_frames_are_dropped_and_counted_by_reason() -> None:
    one = node()
    good = sample(0)
    one.tick([good], 1)
    flipped = Frame(good.can_id, bytes([good.data[0] ^ 1]) + good.data[1:])
    one.tick([flipped], 1)
    assert one.counters.rejected_crc == 1
    one.tick([Frame(good.can_id, good.data[:5])], 1)
    assert one.counters.rejected_length == 1
    one.tick([good], 1)
    assert one.counters.rejected_repeated == 1
    one.tick([Frame(codec.ENCODER_ESTIMATES.can_id, b"\x00\x00\xc0\x7f" * 2)], 1)
    assert one.counters.rejected_value == 1
    assert one.inputs.accelerometer.age_ticks == 4
    assert one.inputs.encoder.age_ticks == NEVER_TICKS
    assert one.counters.frames == 1


def test_a_gap_in_the_counter_is_counted_and_the_frame_used() -> None:
    one = node()
    one.tick([sample(0)], 1)
    one.tick([sample(3)], 1)
    assert one.counters.counter_gaps == 1
    assert one.inputs.accelerometer.age_ticks == 0
    one.tick([sample(4)], 1)
    assert one.counters.counter_gaps == 1
    for count in range(5, 40):
        one.tick([sample(count)], 1)
    assert one.counters.counter_gaps == 1


def test_a_source_that_comes_back_after_a_silence_counts_from_the_third_frame_in_order() -> None:
    one = node()
    for count, elapsed in ((5, 1), (6, 256), (8, 1), (9, 1)):
        one.tick([sample(count)], elapsed)
    assert (one.counters.rejected_sequence, one.counters.new_sequences) == (2, 1)
    assert one.inputs.accelerometer.age_ticks == 0


@pytest.mark.parametrize(
    ("kind", "record", "period"),
    [
        (codec.ACCELEROMETER, Accelerometer(0.0, 0.0, 0.0), 1),
        (codec.GAIT_SENSORS, GaitSensors(0.0, 0.0, 1, 1), 5),
        (codec.OPERATOR_COMMAND, OperatorCommand(0, 1.3, 0.0), 100),
    ],
    ids=lambda value: getattr(value, "name", ""),
)
def test_every_counter_continues_its_sequence(kind: Any, record: Any, period: int) -> None:
    """Counter, ticks since the frame before, and whether it is used: gaps by the time that has passed."""
    late, silence = 20 // period, (1 << kind.kind.counter_bits - 1) * period - 20
    last = 2 + late
    one = node()
    for count, ticks, used in (
        (0, 1, True),
        (1, 1, True),
        (last, period, True),  # as many as can have been sent
        (last + 3 + late, period, False),  # too many
        (last - 1, period, False),  # an old one
        (last + 1, 1, True),
        (last + 2, silence - 1, True),
        (last + 3, silence + 1, False),
    ):
        accepted = one.counters.frames
        for _ in range(ticks - 1):
            one.tick([], 1)
        one.tick([kind.encode(record, count)], 1)
        assert one.counters.frames - accepted == used, count


def test_a_stuck_sender_never_counts_as_received_again() -> None:
    one = node()
    for _ in range(100):
        one.tick([sample(5)], 1)
    assert one.counters.rejected_repeated == 99
    assert one.inputs.accelerometer.age_ticks == 99


def test_frames_of_others_are_passed_over() -> None:
    one = node()
    one.tick([Frame(0x7FF, b""), codec.encode(SetInputTorque(0.3)), Frame(0x07E, b"\x01")], 1)
    assert one.counters == one.counters._replace(frames=0, rejected_crc=0, rejected_length=0)


def test_the_newest_of_several_frames_counts() -> None:
    one = node()
    one.tick([sample(0, 1.0), sample(1, 2.0)], 1)
    assert one.inputs.accelerometer.low_m_s2 == pytest.approx(2.0, abs=0.01)


def test_cyclic_frames_keep_their_periods() -> None:
    one, sent = node(), []
    for tick in range(1000):
        sent += [(tick, frame.can_id) for frame in one.tick([], 1)]
    for its_codec, period in (
        (codec.SET_INPUT_TORQUE, 1),
        (codec.STRIKER_ESTIMATE, 10),
        (codec.FIRMWARE_HEARTBEAT, 100),
    ):
        ticks = [tick for tick, can_id in sent if can_id == its_codec.can_id]
        due = range(0, 1000, period)
        # A frame to the drive may come before, once in 20 ticks.
        assert all(0 <= tick - at <= 2 for tick, at in zip(ticks, due, strict=True))


def test_own_counters_roll() -> None:
    one, counters = node(), []
    for _ in range(2000):
        for frame in one.tick([], 1):
            if frame.can_id == codec.FIRMWARE_HEARTBEAT.can_id:
                counters.append(codec.FIRMWARE_HEARTBEAT.counter(frame.data))
    assert counters == [k % 16 for k in range(20)]


def test_the_drive_is_enabled_only_on_a_start_and_let_go_on_a_stop() -> None:
    bench = Bench()
    sent = bench.sent_in(0.4)
    assert bench.node.outputs.mode == Mode.READY
    assert {record for record in sent if is_drives(record)} == {SetInputTorque(0.0), IDLE}
    bench.request = OperatorRequest.RUN
    sent = bench.sent_in(0.4)
    before = sent[: sent.index(SetAxisState(AxisState.CLOSED_LOOP_CONTROL))]
    assert {record for record in before if isinstance(record, SetInputTorque)} == {SetInputTorque(0.0)}
    kinds = [type(record) for record in sent if type(record) in (SetControllerMode, SetLimits, SetAxisState)]
    assert kinds[:7] == [*(SetControllerMode, SetLimits) * 3, SetAxisState]
    assert SetControllerMode(1, 1) in sent
    limits = next(record for record in sent if isinstance(record, SetLimits))
    assert limits.current_limit_a == 10.0
    assert limits.velocity_limit_rev_s == pytest.approx(35.0 / (2 * math.pi))
    assert bench.axis_state == AxisState.CLOSED_LOOP_CONTROL
    bench.request = OperatorRequest.IDLE
    bench.run(3.5, keep=False)
    assert bench.node.outputs.mode == Mode.READY
    assert bench.axis_state == AxisState.IDLE


def test_parameters_are_not_written_while_it_moves_unless_they_are_marked() -> None:
    bench = Bench().started()
    bench.run(0.5, keep=False)
    assert calibrate(bench.node, "start.rise_s", 6.0) is XcpError.WRITE_PROTECTED
    assert calibrate(bench.node, "speed.gain_p_n_m_s", 0.0625) is XcpError.NONE
    assert bench.node.config.p.speed.gain_p_n_m_s == 0.0625
    assert bench.node.config.p.start.rise_s == DEFAULTS["start.rise_s"]


def test_idle_and_the_fault_event_stand_behind_nothing() -> None:
    bench = Bench().started()
    bench.run(0.5, keep=False)
    assert bench.axis_state == AxisState.CLOSED_LOOP_CONTROL
    asked = [command(XcpCommandCode.CONNECT)] * 40
    hot = codec.DRIVE_TEMPERATURE.encode(DriveTemperature(95.0, 30.0))
    bench.change = lambda _, frames: [*frames, *asked, hot]
    bench.run(0.001, keep=False)
    assert bench.node.outputs.mode == Mode.FAULT
    assert IDLE in bench.records()
    bench.run(0.001, keep=False)
    assert FaultEvent(0, Fault.OVERTEMPERATURE, 0) in bench.records()


def test_the_reason_that_is_latched_and_reported_is_the_drives_newest() -> None:
    """The reason of an error that was cleared before is none of this one's."""
    bench = Bench()
    late: list[Frame] = []

    def one_tick_late(tick: int, frames: list[Frame]) -> list[Frame]:
        active, reason = (0, 0x100) if tick < 1400 else (0x200, 0x200)
        now = [frame for frame in frames if frame.can_id != codec.DRIVE_ERRORS.can_id] + late
        late.clear()
        if len(now) < len(frames):
            late.append(codec.DRIVE_ERRORS.encode(DriveErrors(active, reason)))
        return now

    bench.change = one_tick_late
    bench.started().run(0.95, keep=False)
    bench.axis_error = 0x200
    reported = [event for event in bench.sent_in(0.3) if isinstance(event, FaultEvent)]
    assert (bench.node.outputs.fault, bench.node.outputs.disarm_reason) == (Fault.DRIVE_ERROR, 0x200)
    assert {event.disarm_reason for event in reported} <= {0, 0x200}
    assert reported[-1].disarm_reason == 0x200


def test_the_heartbeat_says_where_the_firmware_stands() -> None:
    bench = Bench().started()
    beats = [record for record in bench.sent_in(0.8) if isinstance(record, FirmwareHeartbeat)]
    assert beats[0].mode == Mode.SOFT_START
    assert beats[0].target_omega_rad_s == 0.0
    assert beats[-1].mode == Mode.SOFT_START
    assert beats[-1].target_omega_rad_s > 0.0


def counted_from(turns: float) -> Callable[[int, list[Frame]], list[Frame]]:
    """A drive that has counted this number of turns already."""

    def change(_: int, frames: list[Frame]) -> list[Frame]:
        return [
            codec.ENCODER_ESTIMATES.encode(record._replace(position_rev=record.position_rev + turns))
            if isinstance(record := codec.decode(frame), EncoderEstimates)
            else frame
            for frame in frames
        ]

    return change


@pytest.mark.parametrize(("turns", "sent"), [(0.0, 0), (14_400.0, 1), (-100.0, 1)])
def test_a_position_that_has_run_far_is_brought_back_by_whole_turns_at_rest(turns: float, sent: int) -> None:
    bench = Bench(change=counted_from(turns))
    zeroed = [r.position_rev for r in bench.sent_in(0.9) if isinstance(r, SetAbsolutePosition)]
    assert bench.node.outputs.mode == Mode.READY
    assert len(zeroed) == sent
    at_rest = bench.node.inputs.encoder.position_rev
    for position_rev in zeroed:
        assert position_rev == pytest.approx(at_rest - math.floor(at_rest), abs=2e-3)
    bench.request = OperatorRequest.RUN
    for _ in range(1000):
        bench.run(0.001, keep=False)
        if bench.node.outputs.mode == Mode.SOFT_START and bench.node.state.crank.omega_rad_s > 1.0:
            assert not any(isinstance(record, SetAbsolutePosition) for record in bench.records())


def test_a_good_parameter_file_is_used() -> None:
    one = power_up(format_file(DEFAULTS | {"stop.restitution": 0.43}))
    assert one.values["stop.restitution"] == 0.43
    assert one.config == config_from({"stop.restitution": 0.43})


@pytest.mark.requirement("S-09")
def test_damaged_parameters_are_said_and_nothing_moves_whatever_is_asked_for() -> None:
    broken = power_up(format_file(DEFAULTS).replace("mass_kg = 0.8", "mass_kg = 0.9"))
    bench = Bench()
    bench.node = broken
    bench.started()
    sent = []
    for request in (OperatorRequest.CLEAR_FAULTS, OperatorRequest.IDLE, OperatorRequest.RUN):
        bench.request = request
        sent += bench.sent_in(0.4)
        # A parameter written makes one of them known, and the others no better.
        assert calibrate(bench.node, "start.rise_s", 6.0) is XcpError.NONE
    beats = [record for record in sent if isinstance(record, FirmwareHeartbeat)]
    assert {(beat.mode, beat.fault) for beat in beats} == {(Mode.FAULT, Fault.PARAMETERS_DAMAGED)}
    assert {record for record in sent if isinstance(record, SetInputTorque)} == {SetInputTorque(0.0)}
    assert SetAxisState(AxisState.CLOSED_LOOP_CONTROL) not in sent
