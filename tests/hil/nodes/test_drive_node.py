"""The simulated ODrive axis: what each frame does to it, and what makes it let go."""

import math
import struct
from collections.abc import Sequence

import pytest

from firmware_py.builds.numba_subset import register
from firmware_py.interface import codec
from firmware_py.interface.enums import AxisError, AxisState, ProcedureResult
from firmware_py.interface.frame import Frame, WordFrame, word_of
from hil.drive import axis, messages
from hil.drive.axis import DISARMED, SUCCESS, TURN_RAD, DriveConfig, DriveState, Telemetry
from hil.drive.node import NOT_MODELLED_IDS, obey
from hil.nodes.compiled import kernel

CONFIG = DriveConfig(
    torque_constant_n_m_a=0.08,
    resistance_ohm=0.4,
    supply_v=24.0,
    current_limit_a=10.0,
    velocity_limit_rad_s=40.0,
)
TICK_S = 1e-3


class Drive:
    """An axis and what its commands have made of it."""

    def __init__(self, config: DriveConfig = CONFIG) -> None:
        self.config = config
        self.state = axis.power_up(config)
        self.rejected = 0

    def handle(self, frames: Sequence[Frame], encoder_position_rev: float) -> None:
        for can_id, data in frames:
            frame = WordFrame(can_id, len(data), word_of(data))
            self.state, was_read = obey(self.config, self.state, frame, encoder_position_rev)
            self.rejected += not was_read

    def elapse(self, dt_s: float, omega_rad_s: float, current_a: float) -> None:
        self.state = axis.elapse(self.config, self.state, dt_s, omega_rad_s, current_a)

    def torque_n_m(self, omega_rad_s: float) -> float:
        return axis.torque_n_m(self.config, self.state, omega_rad_s)

    @property
    def armed(self) -> bool:
        return axis.is_armed(self.state)


# CANSimple 0.6 by hand, not through the codec: node 0, little-endian.
def axis_state(state: int) -> Frame:
    return Frame(0x07, struct.pack("<I", state) + bytes(4))


def torque(torque_n_m: float) -> Frame:
    return Frame(0x0E, struct.pack("<f", torque_n_m) + bytes(4))


def velocity(velocity_rev_s: float, torque_n_m: float = 0.0) -> Frame:
    return Frame(0x0D, struct.pack("<ff", velocity_rev_s, torque_n_m))


def limits(velocity_rev_s: float, current_a: float) -> Frame:
    return Frame(0x0F, struct.pack("<ff", velocity_rev_s, current_a))


ARM = axis_state(AxisState.CLOSED_LOOP_CONTROL)
ESTOP = Frame(0x02, b"")
CLEAR = Frame(0x18, b"\0")
VELOCITY_MODE = Frame(0x0B, struct.pack("<II", 2, 1))
VELOCITY_RAMP_MODE = Frame(0x0B, struct.pack("<II", 2, 2))


def armed_drive(torque_n_m: float = 0.0) -> Drive:
    drive = Drive()
    drive.handle([ARM, torque(torque_n_m)], 0.0)
    assert drive.state.axis.state == AxisState.CLOSED_LOOP_CONTROL
    return drive


def test_torque_acts_only_in_closed_loop() -> None:
    drive = Drive()
    drive.handle([torque(0.5)], 0.0)
    assert drive.torque_n_m(0.0) == 0.0
    drive.handle([ARM], 0.0)
    assert drive.torque_n_m(0.0) == 0.0  # what was asked for before arming is forgotten
    drive.handle([torque(0.25)], 0.0)
    assert drive.torque_n_m(0.0) == 0.25
    drive.handle([axis_state(AxisState.IDLE)], 0.0)
    assert drive.torque_n_m(0.0) == 0.0


def test_commands_may_leave_out_what_means_nothing() -> None:
    """As ODrive's own examples in Python send them, and older clients."""
    drive = Drive()
    drive.state = axis.disarm(drive.state, AxisError.ESTOP_REQUESTED)
    drive.handle([Frame(0x18, b"")], 0.0)
    assert drive.state.axis.errors == AxisError.NONE
    drive.handle([Frame(0x07, struct.pack("<I", 8)), Frame(0x0E, struct.pack("<f", 0.25))], 0.0)
    assert (drive.armed, drive.torque_n_m(0.0)) == (True, 0.25)
    drive.handle([Frame(0x19, struct.pack("<f", 0.5))], 0.125)
    assert messages.position_rev(drive.state, 0.125) == 0.5
    drive.handle([Frame(0x02, bytes(8))], 0.0)
    assert drive.state.axis.errors == AxisError.ESTOP_REQUESTED
    drive.handle([Frame(0x18, struct.pack("<I", 1))], 0.0)
    assert (drive.state.axis.errors, drive.rejected) == (AxisError.NONE, 0)
    halves = [
        Frame(0x0B, struct.pack("<I", 1)),
        Frame(0x0D, bytes(4)),
        Frame(0x0F, bytes(4)),
    ]
    drive.handle(halves, 0.0)
    assert drive.rejected == len(halves)


@pytest.mark.parametrize(
    "mode", [(3, 1), (0, 1), (1, 2), (1, 6), (1, 0), (2, 0), (2, 3), (2, 6), (3, 2), (9, 1), (1, 9)]
)
def test_a_mode_that_is_not_modelled_disarms_and_does_not_arm(mode: tuple[int, int]) -> None:
    set_mode = Frame(0x0B, struct.pack("<II", *mode))
    drive = armed_drive(0.25)
    drive.handle([set_mode], 0.0)
    assert (drive.torque_n_m(0.0), drive.armed) == (0.0, False)
    assert drive.state.axis.errors == drive.state.axis.disarm_reason == AxisError.BAD_CONFIG
    drive = Drive()
    drive.handle([set_mode, ARM], 0.0)
    assert not drive.armed
    assert drive.state.axis.errors == AxisError.BAD_CONFIG
    drive.handle([Frame(0x0B, struct.pack("<II", 1, 1)), CLEAR, ARM], 0.0)
    assert drive.armed


@pytest.mark.parametrize("state", [0, 2, 5, 6, 9, 10, 12, 13, 14, 15, 255, 2**32 - 1])
def test_a_state_that_is_not_modelled_ends_as_invalid(state: int) -> None:
    for drive in (Drive(), armed_drive()):
        before = drive.state.axis
        drive.handle([axis_state(state)], 0.0)
        assert drive.state.axis == before._replace(procedure_result=ProcedureResult.INVALID_STATE)
        assert drive.rejected == 0


@pytest.mark.parametrize("can_id", NOT_MODELLED_IDS)
@pytest.mark.parametrize("length", [0, 4, 8])
def test_a_command_that_is_not_modelled_disarms(can_id: int, length: int) -> None:
    drive = armed_drive(0.25)
    drive.handle([Frame(can_id, bytes(length))], 0.0)
    assert drive.state.axis == (AxisState.IDLE, AxisError.BAD_CONFIG, AxisError.BAD_CONFIG, DISARMED)
    drive.handle([CLEAR, ARM], 0.0)
    assert drive.armed
    drive.handle([Frame(0x20 + can_id, bytes(length))], 0.0)  # to another node
    assert drive.armed


@pytest.mark.parametrize("length", range(1, 9))
def test_a_state_of_any_length_that_holds_it_is_taken(length: int) -> None:
    drive = Drive()
    drive.handle([Frame(0x07, (struct.pack("<I", 8) + bytes(4))[:length])], 0.0)
    assert drive.armed


def test_watchdog_disarms_after_fifty_milliseconds_without_a_command() -> None:
    drive = armed_drive(0.25)
    for _ in range(49):
        drive.elapse(TICK_S, 0.0, 0.0)
    assert drive.armed
    assert axis.watchdog_left_s(CONFIG, drive.state) == pytest.approx(TICK_S)
    drive.elapse(TICK_S, 0.0, 0.0)
    assert not drive.armed
    assert drive.torque_n_m(0.0) == 0.0
    assert drive.state.axis.errors == AxisError.WATCHDOG_TIMER_EXPIRED
    assert drive.state.axis.disarm_reason == AxisError.WATCHDOG_TIMER_EXPIRED
    assert drive.state.axis.procedure_result == DISARMED


EVERY_FRAME = [
    *(Frame(0x02, b""), Frame(0x07, struct.pack("<II", 8, 0)), Frame(0x0B, struct.pack("<II", 1, 1))),
    *(
        velocity(0.0),
        torque(0.0),
        limits(5.0, 10.0),
        Frame(0x18, b"\0"),
        Frame(0x19, bytes(8)),
        Frame(0x09, b""),
    ),
]


@pytest.mark.parametrize("frame", EVERY_FRAME)
def test_every_frame_to_a_real_odrive_feeds_its_watchdog(frame: Frame) -> None:
    drive = Drive(CONFIG._replace(is_fed_by_every_frame=True))
    drive.handle([ARM], 0.0)
    drive.elapse(0.049, 0.0, 0.0)
    drive.handle([frame], 0.0)
    assert axis.watchdog_left_s(drive.config, drive.state) >= 0.05
    drive.handle([ARM], 0.0)
    drive.elapse(0.049, 0.0, 0.0)
    before = drive.state
    drive.handle([Frame(frame.can_id + 0x20, frame.data)], 0.0)  # the frame of another drive
    assert drive.state == before


def test_a_drive_without_a_watchdog_keeps_its_torque() -> None:
    drive = Drive(CONFIG._replace(watchdog_s=math.inf))
    drive.handle([ARM, torque(0.25)], 0.0)
    for _ in range(100):
        drive.elapse(1.0, 0.0, 0.0)
    assert drive.torque_n_m(0.0) == 0.25


def test_each_command_feeds_the_watchdog_and_nothing_else_does() -> None:
    drive = armed_drive()
    for _ in range(200):
        drive.elapse(TICK_S, 0.0, 0.0)
        drive.handle([torque(0.1)], 0.0)
    assert drive.armed
    for _ in range(50):
        drive.elapse(TICK_S, 0.0, 0.0)
        drive.handle([limits(1.0, 1.0), ARM, Frame(0x068, bytes(6)), Frame(0x0E, b"short")], 0.0)
    assert not drive.armed
    assert drive.rejected == 50


def test_idle_axis_needs_no_commands() -> None:
    drive = Drive()
    for _ in range(1000):
        drive.elapse(TICK_S, 0.0, 0.0)
    assert drive.state.axis.errors == AxisError.NONE
    assert axis.watchdog_left_s(CONFIG, drive.state) == math.inf


@pytest.mark.parametrize(
    ("cause", "error"),
    [
        ("estop", AxisError.ESTOP_REQUESTED),
        ("overspeed", AxisError.VELOCITY_LIMIT_VIOLATION),
        ("hot", AxisError.MOTOR_OVER_TEMP),
        ("silence", AxisError.WATCHDOG_TIMER_EXPIRED),
    ],
)
def test_disarmed_axis_stays_so_until_its_errors_are_cleared(cause: str, error: AxisError) -> None:
    drive = armed_drive(0.25)
    if cause == "estop":
        drive.handle([ESTOP], 0.0)
    elif cause == "overspeed":
        drive.elapse(TICK_S, -48.1, 0.0)
    elif cause == "hot":
        drive.state = drive.state._replace(motor_degc=101.0)
        drive.elapse(TICK_S, 0.0, 0.0)
    else:
        drive.elapse(0.05, 0.0, 0.0)
    assert (drive.state.axis.errors, drive.state.axis.disarm_reason) == (error, error)
    drive.handle([ARM, torque(0.3)], 0.0)
    assert drive.state.axis.state == AxisState.IDLE
    assert drive.state.axis.procedure_result == DISARMED
    assert drive.torque_n_m(0.0) == 0.0
    drive.state = drive.state._replace(motor_degc=25.0)
    drive.handle([CLEAR], 0.0)
    assert drive.state.axis.errors == AxisError.NONE
    assert drive.state.axis.disarm_reason == error  # kept until the axis is armed again
    drive.handle([ARM, torque(0.3)], 0.0)
    assert drive.state.axis.state == AxisState.CLOSED_LOOP_CONTROL
    assert drive.state.axis.procedure_result == SUCCESS
    assert drive.state.axis.disarm_reason == AxisError.NONE
    assert drive.torque_n_m(0.0) == pytest.approx(0.3)


def test_speed_below_the_tolerance_does_not_disarm() -> None:
    drive = armed_drive()
    drive.elapse(TICK_S, 47.9, 0.0)
    assert drive.armed


@pytest.mark.parametrize(
    ("asked_n_m", "omega_rad_s", "current_a", "got_n_m"),
    [
        (2.0, 0.0, 20.0, 0.8),  # the drive's own current limit, whatever a client asks for
        (2.0, 0.0, 5.0, 0.4),
        (-2.0, 0.0, 5.0, -0.4),
        (0.3, 0.0, 5.0, 0.3),
        (0.3, 2 * math.pi * 5.0, 5.0, 0.167),  # a revolution a second below the limit: vel_gain × 1
        (0.3, 2 * math.pi * 7.0, 5.0, -0.167),  # beyond it torque mode brakes
        (-0.3, 2 * math.pi * 7.0, 5.0, -0.3),
        (-0.3, -2 * math.pi * 5.0, 5.0, -0.167),
    ],
)
def test_torque_is_limited_by_current_and_velocity(
    asked_n_m: float, omega_rad_s: float, current_a: float, got_n_m: float
) -> None:
    drive = armed_drive(asked_n_m)
    drive.handle([limits(6.0, current_a)], 0.0)
    assert drive.torque_n_m(omega_rad_s) == pytest.approx(got_n_m, rel=1e-6)


def test_limits_that_make_no_sense_stop_the_motor_rather_than_free_it() -> None:
    drive = armed_drive(0.5)
    drive.handle([limits(-1.0, -1.0)], 0.0)
    assert drive.torque_n_m(0.0) == 0.0


INERTIA_KG_M2 = 5e-4


def turn(
    drive: Drive,
    seconds: float,
    repeated: Sequence[Frame] = (),
    omega_rad_s: float = 0.0,
    load_n_m: float = 0.0,
) -> list[float]:
    """The speeds of a rotor that the drive turns, a tick each; `repeated` arrives in each tick."""
    speeds = []
    for _ in range(round(seconds / TICK_S)):
        drive.handle(repeated, 0.0)
        torque_n_m = drive.torque_n_m(omega_rad_s)
        omega_rad_s += (torque_n_m - load_n_m) / INERTIA_KG_M2 * TICK_S
        drive.elapse(TICK_S, omega_rad_s, torque_n_m / CONFIG.torque_constant_n_m_a)
        speeds.append(omega_rad_s)
    return speeds


@pytest.mark.parametrize("velocity_rev_s", [2.0, -2.0])
@pytest.mark.parametrize("load_n_m", [0.0, 0.1])
def test_velocity_mode_holds_the_speed_against_a_load(velocity_rev_s: float, load_n_m: float) -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, ARM], 0.0)
    speeds = turn(drive, 3.0, [velocity(velocity_rev_s)], load_n_m=load_n_m)
    assert speeds[-1] == pytest.approx(velocity_rev_s * TURN_RAD, rel=1e-2)
    assert drive.state.loop.integral_n_m == pytest.approx(load_n_m, abs=2e-3)
    assert drive.armed


def test_velocity_mode_needs_commands_like_any_other() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, ARM, velocity(1.0)], 0.0)
    turn(drive, 0.049)
    assert drive.armed
    turn(drive, 0.001)
    assert drive.state.axis.errors == AxisError.WATCHDOG_TIMER_EXPIRED


def test_a_velocity_ramp_rises_by_a_revolution_a_second_squared() -> None:
    drive = Drive()
    drive.handle([VELOCITY_RAMP_MODE, ARM], 0.0)
    speeds = turn(drive, 2.0, [velocity(1.5)])
    assert speeds[999] == pytest.approx(TURN_RAD, rel=0.05)
    assert speeds[-1] == pytest.approx(1.5 * TURN_RAD, rel=0.02)


def test_from_passed_through_to_a_ramp_the_speed_goes_on_from_where_it_is() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, ARM], 0.0)
    omega_rad_s = turn(drive, 2.0, [velocity(2.0)])[-1]
    drive.handle([VELOCITY_RAMP_MODE], 0.0)
    speeds = turn(drive, 0.5, [velocity(0.0)], omega_rad_s)
    assert speeds[-1] == pytest.approx(1.5 * TURN_RAD, rel=0.05)
    assert max(speeds) < 2.05 * TURN_RAD


def test_velocity_mode_keeps_within_the_limits_of_velocity_and_current() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, limits(3.0, 2.0), ARM, velocity(40.0)], 0.0)
    assert drive.torque_n_m(0.0) == pytest.approx(2.0 * 0.08)
    assert drive.torque_n_m(100.0) == pytest.approx(-2.0 * 0.08)
    assert turn(drive, 3.0, [velocity(40.0)])[-1] == pytest.approx(3.0 * TURN_RAD, rel=0.02)


def test_at_the_current_limit_the_integral_does_not_wind_up() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, limits(6.0, 1.0), ARM], 0.0)
    blocked = [velocity(5.0)]
    for _ in range(5000):
        drive.handle(blocked, 0.0)
        drive.elapse(TICK_S, 0.0, 1.0)
    assert abs(drive.state.loop.integral_n_m) < 0.08


def test_the_feed_forward_adds_to_velocity_mode_and_is_all_of_torque_mode() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, ARM, velocity(0.0, 0.125)], 0.0)
    assert drive.torque_n_m(0.0) == 0.125
    drive = armed_drive()
    drive.handle([velocity(3.0, 0.125)], 0.0)
    assert drive.torque_n_m(0.0) == 0.125


def test_what_was_asked_for_before_arming_is_forgotten_in_velocity_mode_too() -> None:
    drive = Drive()
    drive.handle([VELOCITY_MODE, velocity(3.0, 0.1), ARM], 0.0)
    assert drive.torque_n_m(0.0) == 0.0


def test_torque_mode_computes_nothing_of_velocity_mode() -> None:
    drive = armed_drive(0.25)
    loop = drive.state.loop
    turn(drive, 0.1, [torque(0.25)])
    assert drive.state.loop is loop


CALIBRATIONS = {3: 12.0, 4: 4.0, 7: 8.0}
"""ODrive's full, motor and encoder offset calibration, and how long they take in s."""


@pytest.mark.parametrize(("state", "takes_s"), CALIBRATIONS.items())
def test_a_calibration_takes_its_time_and_ends(state: int, takes_s: float) -> None:
    drive = Drive()
    drive.handle([axis_state(state)], 0.0)
    speeds = turn(drive, takes_s - TICK_S)
    assert drive.state.axis == (state, 0, 0, ProcedureResult.BUSY)
    speeds += turn(drive, TICK_S, omega_rad_s=speeds[-1])
    assert drive.state.axis == (AxisState.IDLE, 0, 0, SUCCESS)
    angles_rev = [sum(speeds[: tick + 1]) * TICK_S / TURN_RAD for tick in range(0, len(speeds), 50)]
    assert max(angles_rev) == pytest.approx(0.0 if state == 4 else 8 / 7, abs=0.05)
    assert angles_rev[-1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("state", [3, 7])
def test_a_calibration_of_a_blocked_crank_fails(state: int) -> None:
    drive = Drive()
    drive.handle([axis_state(state)], 0.0)
    for _ in range(12_000):
        drive.elapse(TICK_S, 0.0, 0.0)
    mismatch = ProcedureResult.POLE_PAIR_CPR_MISMATCH
    error = AxisError.CALIBRATION_ERROR
    assert drive.state.axis == (AxisState.IDLE, error, error, mismatch)
    drive.handle([CLEAR, ARM], 0.0)
    assert drive.armed


def test_a_calibration_can_be_called_off_and_stopped() -> None:
    drive = Drive()
    drive.handle([axis_state(3), axis_state(1)], 0.0)
    assert drive.state.axis == (AxisState.IDLE, 0, 0, ProcedureResult.CANCELLED)
    drive.handle([axis_state(7), ESTOP], 0.0)
    estop = AxisError.ESTOP_REQUESTED
    assert drive.state.axis == (AxisState.IDLE, estop, estop, DISARMED)
    drive.handle([axis_state(7)], 0.0)  # not before its errors are cleared
    assert drive.state.axis.state == AxisState.IDLE
    drive.handle([CLEAR, axis_state(7), ARM], 0.0)
    assert drive.state.axis == (AxisState.CLOSED_LOOP_CONTROL, 0, 0, SUCCESS)


def test_homing_finds_no_end_stop() -> None:
    drive = Drive()
    drive.handle([axis_state(11)], 0.0)
    assert drive.state.axis == (AxisState.IDLE, 0, 0, ProcedureResult.HOMING_WITHOUT_ENDSTOP)


register()


@kernel
def compiled_tick(
    drive: DriveState, frame: WordFrame, omega_rad_s: float, ticks: int
) -> tuple[DriveState, float, float]:
    drive, _ = obey(CONFIG, drive, frame, 0.0)
    torque_n_m = 0.0
    for _ in range(ticks):
        torque_n_m = axis.torque_n_m(CONFIG, drive, omega_rad_s)
        omega_rad_s += torque_n_m / INERTIA_KG_M2 * TICK_S
        drive = axis.elapse(CONFIG, drive, TICK_S, omega_rad_s, torque_n_m / CONFIG.torque_constant_n_m_a)
    return drive, omega_rad_s, torque_n_m


SESSIONS = {
    "velocity": [(VELOCITY_MODE, 1), (ARM, 1), *[(velocity(3.3), 40)] * 9, (velocity(-1.0, 0.2), 90)],
    "ramp": [(VELOCITY_RAMP_MODE, 1), (ARM, 1), *[(velocity(1.1), 45)] * 9, (torque(0.1), 45)],
    "full": [(axis_state(3), 12_001)],
    "encoder": [(axis_state(7), 5000), (axis_state(1), 3)],
    "refused": [(axis_state(11), 1), (axis_state(200), 1), (Frame(0x1B, bytes(8)), 1), (ARM, 1)],
    "bad mode": [(ARM, 1), (Frame(0x0B, struct.pack("<II", 9, 1)), 1)],
}


@pytest.mark.parametrize("session", SESSIONS.values(), ids=SESSIONS)
def test_both_builds_of_the_drive_agree_bit_by_bit(session: list[tuple[Frame, int]]) -> None:
    one = other = (axis.power_up(CONFIG), 0.0, 0.0)
    for (can_id, data), ticks in session:
        frame = WordFrame(can_id, len(data), word_of(data))
        one = compiled_tick(one[0], frame, one[1], ticks)
        other = compiled_tick.py_func(other[0], frame, other[1], ticks)
        assert one == other


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_a_torque_or_a_position_that_is_no_number_is_refused(value: float) -> None:
    drive = armed_drive(0.5)
    before = messages.position_rev(drive.state, 0.25)
    drive.handle([torque(value), Frame(0x19, struct.pack("<f", value) + bytes(4))], 0.0)
    assert drive.rejected == 2
    assert drive.torque_n_m(0.0) == 0.5
    assert messages.position_rev(drive.state, 0.25) == before


@pytest.mark.parametrize(
    "rev", [0.0, 0.25, 1.0 - 2.0**-25, math.nextafter(1.0, 0.0), 1.0, -1e-12, -0.25, 86_400.25]
)
def test_position_on_the_bus_is_circular(rev: float) -> None:
    drive = Drive()
    frame = codec.ENCODER_ESTIMATES.encode(messages.encoder_estimates(drive.state, rev, 1.5))
    position_rev, velocity_rev_s = struct.unpack("<ff", frame.data)
    assert 0.0 <= position_rev < 1.0
    assert abs((position_rev - rev + 0.5) % 1.0 - 0.5) < 1e-7
    assert velocity_rev_s == 1.5


def test_absolute_position_moves_the_zero() -> None:
    drive = Drive()
    drive.handle([Frame(0x19, struct.pack("<f", 0.25) + bytes(4))], 0.7)
    assert messages.position_rev(drive.state, 0.7) == pytest.approx(0.25)
    assert messages.position_rev(drive.state, 0.8) == pytest.approx(0.35)


def test_heartbeat_current_and_supply_say_what_the_motor_does() -> None:
    drive = armed_drive(0.4)
    telemetry = Telemetry(current_a=5.0, torque_n_m=0.4, omega_rad_s=10.0)
    assert messages.heartbeat(drive.state) == (0, AxisState.CLOSED_LOOP_CONTROL, SUCCESS, 1)
    assert messages.current(CONFIG, drive.state, telemetry) == pytest.approx((5.0, 5.0))
    supply = messages.supply(CONFIG, telemetry)
    assert supply.voltage_v == 24.0
    assert supply.current_a == pytest.approx(0.05 + (0.4 * 10.0 + 0.4 * 25.0) / 24.0)


def test_winding_warms_to_its_steady_temperature() -> None:
    drive = Drive()
    for _ in range(20_000):
        drive.elapse(0.1, 0.0, 5.0)
    assert drive.state.motor_degc == pytest.approx(25.0 + 3.0 * 0.4 * 25.0, rel=1e-3)
    drive.elapse(TICK_S, 0.0, 0.0)
    temperature = messages.temperature(CONFIG, drive.state)
    assert 25.0 < temperature.inverter_degc < temperature.motor_degc
