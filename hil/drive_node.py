"""The motor drive as its bus sees it: an ODrive axis, CANSimple 0.6, node 0.

Positive torque and position turn the crank forward. Only what an ODrive does with these frames is modelled:
axis states, torque mode with its limits, errors that disarm, and the command watchdog. Where the current goes
is the plant's matter.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import AXIS_IDLE, CLOSED_LOOP, AxisError, AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.records import (
    ClearErrors,
    DriveCurrent,
    DriveErrors,
    DriveEstop,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetInputVelocity,
    SetLimits,
)

TORQUE_CONTROL = 1
"""ODrive's ControlMode."""
PASSTHROUGH = 1
"""ODrive's InputMode."""
SUCCESS, DISARMED = 0, 3
"""ODrive's ProcedureResult."""
TURN_RAD = 2.0 * math.pi
TIME_RESOLUTION_S = 1e-9
LARGEST_POSITION_REV = 1.0 - 2.0**-24
"""The largest float32 below 1."""

COMMAND_TYPES = (
    DriveEstop,
    SetAxisState,
    SetControllerMode,
    SetInputVelocity,
    SetInputTorque,
    SetLimits,
    ClearErrors,
    SetAbsolutePosition,
)
COMMANDS = {codec.CODECS[kind].can_id: codec.CODECS[kind] for kind in COMMAND_TYPES}
"""What the drive listens to, by identifier."""

HALF_MEANT = {codec.SET_AXIS_STATE.can_id, codec.SET_INPUT_TORQUE.can_id, codec.SET_ABSOLUTE_POSITION.can_id}
"""Commands whose second half means nothing: CANSimple's clients leave it out."""
NOTHING_MEANT = {codec.CLEAR_ERRORS.can_id, codec.DRIVE_ESTOP.can_id}
"""Commands whose data mean nothing to this drive: clients send none, or as much as they like."""


def at_full_length(frame: Frame, length: int) -> bytes:
    """A command's data, filled up or cut to `length` where that changes nothing that is meant."""
    can_id, data = frame
    if can_id in NOTHING_MEANT or (can_id in HALF_MEANT and len(data) == 4):
        return data[:length].ljust(length, b"\0")
    return data


class DriveConfig(NamedTuple):
    """The drive's configuration, which no frame changes but `SetLimits` its two limits."""

    torque_constant_n_m_a: float
    resistance_ohm: float
    supply_v: float
    current_limit_a: float
    velocity_limit_rad_s: float
    watchdog_s: float = 0.05
    """Without a command for so long the axis disarms: half of the 100 ms to a safe state."""
    velocity_tolerance: float = 1.2
    """ODrive's vel_limit_tolerance: beyond limit × tolerance the axis disarms."""
    velocity_gain_n_m_s: float = 0.167 / TURN_RAD
    """ODrive's vel_gain, 0.167 N m/(rev/s): how steeply torque mode gives way at the velocity limit."""
    idle_current_a: float = 0.05
    """The electronics' own draw."""
    ambient_degc: float = 25.0
    thermal_resistance_k_w: float = 3.0
    """Winding to air, a gimbal motor of 80 mm: 10 A (40 W) end 120 K above ambient."""
    thermal_time_s: float = 200.0
    over_temperature_degc: float = 100.0
    """ODrive's upper limit of the motor's thermistor."""
    lowest_supply_v: float = 10.5
    """ODrive's dc_bus_undervoltage_trip_level."""


class Telemetry(NamedTuple):
    """What the drive measures at one instant."""

    current_a: float
    torque_n_m: float
    omega_rad_s: float


@dataclass
class Drive:
    """One axis: frames in through `handle`, time through `elapse`, frames out through `publish`."""

    config: DriveConfig
    axis_state: AxisState = AXIS_IDLE
    active_errors: int = AxisError.NONE
    disarm_reason: int = AxisError.NONE
    procedure_result: int = SUCCESS
    control_mode: int = TORQUE_CONTROL
    input_mode: int = PASSTHROUGH
    input_torque_n_m: float = 0.0
    since_command_s: float = 0.0
    position_offset_rev: float = 0.0
    motor_degc: float = field(init=False)
    current_limit_a: float = field(init=False)
    velocity_limit_rad_s: float = field(init=False)
    rejected: int = 0
    """Frames with a drive identifier that could not be read."""

    def __post_init__(self) -> None:
        self.motor_degc = self.config.ambient_degc
        self.current_limit_a = self.config.current_limit_a
        self.velocity_limit_rad_s = self.config.velocity_limit_rad_s

    # --- frames in ---------------------------------------------------------------------------------

    def handle(self, frames: Sequence[Frame], encoder_position_rev: float) -> None:
        """Obey the commands among `frames`, in order."""
        for frame in frames:
            command_codec = COMMANDS.get(frame.can_id)
            if command_codec is None:
                continue
            try:
                command = command_codec.decode(at_full_length(frame, command_codec.length))
            except FrameError:
                self.rejected += 1
                continue
            self._obey(command, encoder_position_rev)

    def _obey(self, command: Any, encoder_position_rev: float) -> None:
        match command:
            case SetInputTorque(torque_n_m):
                self.input_torque_n_m = torque_n_m
                self.since_command_s = 0.0
            case SetInputVelocity(_, torque_feedforward_n_m):
                # In torque mode an ODrive takes the feed-forward alone; velocity mode is not modelled.
                self.input_torque_n_m = torque_feedforward_n_m
                self.since_command_s = 0.0
            case SetAxisState(requested_state):
                self._request_state(requested_state)
            case SetControllerMode(control_mode, input_mode):
                self.control_mode, self.input_mode = control_mode, input_mode
            case SetLimits(velocity_limit_rev_s, current_limit_a):
                self.velocity_limit_rad_s = max(0.0, velocity_limit_rev_s) * TURN_RAD
                self.current_limit_a = min(max(0.0, current_limit_a), self.config.current_limit_a)
            case ClearErrors():
                self.active_errors = AxisError.NONE
            case SetAbsolutePosition(position_rev):
                self.position_offset_rev = position_rev - encoder_position_rev
            case DriveEstop():
                self.disarm(AxisError.ESTOP_REQUESTED)

    def _request_state(self, requested_state: int) -> None:
        if requested_state == AXIS_IDLE:
            self.axis_state = AXIS_IDLE
            self.procedure_result = SUCCESS
        elif requested_state == CLOSED_LOOP:
            if self.active_errors != AxisError.NONE:
                self.procedure_result = DISARMED
            elif self.axis_state != CLOSED_LOOP:
                self.axis_state = CLOSED_LOOP
                self.procedure_result = SUCCESS
                self.disarm_reason = AxisError.NONE
                self.input_torque_n_m = 0.0
                self.since_command_s = 0.0

    def disarm(self, error: AxisError) -> None:
        """Let go of the motor and say why; the error stays until it is cleared."""
        self.active_errors |= error
        self.input_torque_n_m = 0.0
        if self.axis_state == CLOSED_LOOP:
            self.disarm_reason = int(error)
            self.procedure_result = DISARMED
        self.axis_state = AXIS_IDLE

    # --- time --------------------------------------------------------------------------------------

    @property
    def armed(self) -> bool:
        """Whether the motor carries current at all."""
        return self.axis_state == CLOSED_LOOP

    @property
    def watchdog_left_s(self) -> float:
        """Time until the watchdog disarms; infinite while there is nothing to disarm."""
        return self.config.watchdog_s - self.since_command_s if self.armed else math.inf

    def torque_n_m(self, omega_rad_s: float) -> float:
        """The torque asked of the motor, within the limits of current and velocity."""
        if not self.armed or self.control_mode != TORQUE_CONTROL:
            return 0.0
        config = self.config
        limit_n_m = self.current_limit_a * config.torque_constant_n_m_a
        highest = min(limit_n_m, (self.velocity_limit_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
        lowest = max(-limit_n_m, (-self.velocity_limit_rad_s - omega_rad_s) * config.velocity_gain_n_m_s)
        return min(max(self.input_torque_n_m, lowest), highest)

    def elapse(self, dt_s: float, omega_rad_s: float, current_a: float) -> None:
        """Let `dt_s` pass: watchdog, temperature and overspeed."""
        config = self.config
        self.since_command_s += dt_s
        heating_k = config.thermal_resistance_k_w * config.resistance_ohm * current_a * current_a
        excess_k = self.motor_degc - config.ambient_degc
        self.motor_degc += (heating_k - excess_k) * dt_s / config.thermal_time_s
        if not self.armed:
            return
        if self.since_command_s >= config.watchdog_s - TIME_RESOLUTION_S:
            self.disarm(AxisError.WATCHDOG_TIMER_EXPIRED)
        elif abs(omega_rad_s) > self.velocity_limit_rad_s * config.velocity_tolerance:
            self.disarm(AxisError.VELOCITY_LIMIT_VIOLATION)
        elif self.motor_degc > config.over_temperature_degc:
            self.disarm(AxisError.MOTOR_OVER_TEMP)
        elif config.supply_v < config.lowest_supply_v:
            self.disarm(AxisError.DC_BUS_UNDER_VOLTAGE)

    # --- frames out --------------------------------------------------------------------------------

    def position_rev(self, encoder_position_rev: float) -> float:
        """The position estimate, circular in [0, 1)."""
        return (encoder_position_rev + self.position_offset_rev) % 1.0

    def encoder_estimates(self, position_rev: float, velocity_rev_s: float) -> EncoderEstimates:
        """0x09. The last float32 below 1 may round up to it: that is 0 again."""
        position_rev = self.position_rev(position_rev)
        return EncoderEstimates(position_rev if position_rev <= LARGEST_POSITION_REV else 0.0, velocity_rev_s)

    def heartbeat(self, _: Telemetry) -> DriveHeartbeat:
        """0x01. The trajectory flag is 1 where there is none to follow."""
        return DriveHeartbeat(self.active_errors, self.axis_state, self.procedure_result, 1)

    def errors(self, _: Telemetry) -> DriveErrors:
        """0x03."""
        return DriveErrors(self.active_errors, self.disarm_reason)

    def current(self, telemetry: Telemetry) -> DriveCurrent:
        """0x14."""
        setpoint_n_m = self.torque_n_m(telemetry.omega_rad_s)
        return DriveCurrent(setpoint_n_m / self.config.torque_constant_n_m_a, telemetry.current_a)

    def temperature(self, _: Telemetry) -> DriveTemperature:
        """0x15. The inverter, on its heat sink, warms a quarter as much as the winding."""
        ambient = self.config.ambient_degc
        return DriveTemperature(ambient + 0.25 * (self.motor_degc - ambient), self.motor_degc)

    def supply(self, telemetry: Telemetry) -> DriveSupply:
        """0x17. Shaft power and copper loss over the supply's voltage."""
        config = self.config
        power_w = telemetry.torque_n_m * telemetry.omega_rad_s
        power_w += config.resistance_ohm * telemetry.current_a * telemetry.current_a
        return DriveSupply(config.supply_v, config.idle_current_a + power_w / config.supply_v)
