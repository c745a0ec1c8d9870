"""The firmware on the bus: frames to inputs, one step of the core, outputs to frames. No clock, no socket.

Frames that fail their CRC, length or ranges, and those that repeat the counter of the one before, are dropped
and counted; their source then simply grows older. A gap in a counter is counted, and the frame used. After a
silence in which the counter may have turned once round, the same number again is no repetition.
Every tick sends the torque and at most one other frame.
"""

import math
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, NamedTuple

from firmware_py.core.compiled import COMPILED
from firmware_py.core.configure import config_of
from firmware_py.core.drive_link import DriveFrame
from firmware_py.core.inputs import (
    NEVER_TICKS,
    AccelerometerInput,
    CoarseInput,
    DriveInput,
    EncoderInput,
    GaitInput,
    Inputs,
    OperatorInput,
    PowerInput,
)
from firmware_py.core.parameters import read_parameter, write_parameter
from firmware_py.core.step import INITIAL, INITIAL_OUTPUTS, Config, Outputs, State, step
from firmware_py.interface import codec
from firmware_py.interface.codec import FrameCodec, FrameError, FrameErrorReason
from firmware_py.interface.enums import (
    AXIS_IDLE,
    CLOSED_LOOP,
    E_STOP,
    FAULT,
    INIT,
    NO_FAULT,
    NO_REFUSAL,
    READY,
    AxisState,
    Fault,
    Mode,
    OperatorRequest,
    ParameterOperation,
    ParameterStatus,
)
from firmware_py.interface.frame import Frame
from firmware_py.interface.pacing import Pacer, Urgency
from firmware_py.interface.records import (
    Accelerometer,
    ClearErrors,
    CoarsePosition,
    DriveCurrent,
    DriveErrors,
    DriveEstop,
    DriveHeartbeat,
    DriveSupply,
    DriveTemperature,
    EncoderEstimates,
    FaultEvent,
    FirmwareHeartbeat,
    GaitReport,
    GaitSensors,
    ImpactEvent,
    OperatorCommand,
    ParameterRequest,
    ParameterValue,
    RegimeReport,
    SetAbsolutePosition,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetLimits,
    StrikerEstimate,
)
from firmware_py.shell.parameters import ParameterError, parameters_of, read_back, with_overrides

TAU = 2.0 * math.pi
TORQUE_CONTROL = 1
PASSTHROUGH = 1
REGIME_S = 0.05
"""The shortest time between two regime reports."""

_REQUESTS = {request.value: request for request in OperatorRequest}
_AXIS_STATES = {state.value: state for state in AxisState}
_UNDEFINED = AxisState.UNDEFINED
_STILL = (INIT, READY, FAULT, E_STOP)
"""Modes in which parameters may be written."""


NO_COARSE = CoarseInput(0.0, NEVER_TICKS)
NO_GAIT = GaitInput(0.0, 0.0, heel=False, toe=False, age_ticks=NEVER_TICKS)
"""What modules without such a sensor read."""

_REJECTED = {FrameErrorReason.LENGTH: 0, FrameErrorReason.CRC: 1}
"""Which of the three counters of rejections a reason belongs to; all others are wrong values."""


class NodeError(RuntimeError):
    """The node cannot run in this process."""


class Counters(NamedTuple):
    """Since power-up: frames taken, frames dropped by reason, gaps in rolling counters, skipped ticks, and
    own frames that found no place in the queue."""

    frames: int
    rejected_length: int
    rejected_crc: int
    rejected_value: int
    rejected_repeated: int
    counter_gaps: int
    skipped_ticks: int
    unsent: int


class _Source:
    """One identifier the node listens to: the tick of its newest frame, and that frame's counter.

    `counted_tick` is that of the newest counter, of dropped repetitions too.
    """

    def __init__(self, its_codec: FrameCodec[Any], take: Callable[[Any], None], tick_s: float) -> None:
        self.codec = its_codec
        self.take = take
        self.heard_tick = self.counted_tick = -NEVER_TICKS
        self.counter = -1
        self.modulus = 1 << its_codec.layout.counter_bits
        period_ticks = max((its_codec.period_s or 0.0) / tick_s, 1.0)
        self.turn_ticks = (self.modulus - 1) * period_ticks
        """Of silence, after which the counter may be where it was: a period early, as frames jitter."""


class FirmwareNode:
    """One controller. `tick` is called once a control period with the frames that have arrived since.

    `inputs`, `state` and `outputs` are the newest tick's, `counters` all ticks'.
    """

    def __init__(self, config: Config, parameters: Mapping[str, Any] | None = None) -> None:
        """`parameters`: the overrides that `config` was made of, for the bus to read and write."""
        if COMPILED:
            raise NodeError(
                "VIBROHIL_COMPILED=1 is set: called tick by tick from Python, a compiled core costs three "
                "times the interpreted one; unset it to run a node"
            )
        self.config = config
        self.parameters = parameters_of(with_overrides(parameters or {}))
        self.state: State = INITIAL
        self.outputs: Outputs = INITIAL_OUTPUTS
        self.counters = Counters(0, 0, 0, 0, 0, 0, 0, 0)
        self._frames = 0
        self._gaps = 0
        self._rejected = [0, 0, 0]
        self._repeated = 0
        self._skipped_ticks = 0

        self._ticks = 0
        self._sent: dict[int, int] = {}
        self._due_ticks: dict[int, int] = {}
        self._pacer: Pacer[Callable[[], Frame]] = Pacer()
        self._pending_regime = False
        self._requests: list[ParameterRequest] = []

        self._estop = False
        self._acceleration = Accelerometer(0.0, 0.0, 0.0)
        self._coarse = CoarsePosition(0.0)
        self._position = EncoderEstimates(0.0, 0.0)
        self._heartbeat = DriveHeartbeat(0, 0, 0, 0)
        self._disarm_reason = 0
        self._current_a = 0.0
        self._temperature = DriveTemperature(0.0, 0.0)
        self._voltage_v = 0.0
        self._command = OperatorCommand(OperatorRequest.IDLE.value, 0.0)
        self._gait = GaitSensors(0.0, 0.0, 0, 0)
        listens: tuple[tuple[FrameCodec[Any], Callable[[Any], None]], ...] = (
            (codec.ACCELEROMETER, self._take_acceleration),
            (codec.COARSE_POSITION, self._take_coarse),
            (codec.ENCODER_ESTIMATES, self._take_position),
            (codec.DRIVE_HEARTBEAT, self._take_heartbeat),
            (codec.DRIVE_ERRORS, self._take_errors),
            (codec.DRIVE_CURRENT, self._take_current),
            (codec.DRIVE_TEMPERATURE, self._take_temperature),
            (codec.DRIVE_SUPPLY, self._take_supply),
            (codec.DRIVE_ESTOP, self._take_estop),
            (codec.OPERATOR_COMMAND, self._take_command),
            (codec.PARAMETER_REQUEST, self._take_request),
            (codec.GAIT_SENSORS, self._take_gait),
        )
        self._sources = {
            its_codec.can_id: _Source(its_codec, take, config.tick_s) for its_codec, take in listens
        }
        self._acceleration_source = self._sources[codec.ACCELEROMETER.can_id]
        self._coarse_source = self._sources[codec.COARSE_POSITION.can_id]
        self._position_source = self._sources[codec.ENCODER_ESTIMATES.can_id]
        self._heartbeat_source = self._sources[codec.DRIVE_HEARTBEAT.can_id]
        self._command_source = self._sources[codec.OPERATOR_COMMAND.can_id]
        self._gait_source = self._sources[codec.GAIT_SENSORS.can_id]
        self._power_sources = [
            self._sources[its_codec.can_id]
            for its_codec in (codec.DRIVE_CURRENT, codec.DRIVE_TEMPERATURE, codec.DRIVE_SUPPLY)
        ]
        self.inputs: Inputs = self._inputs(1)

    @property
    def can_ids(self) -> Collection[int]:
        """The identifiers it listens to; frames with others are not counted."""
        return self._sources.keys()

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run one control tick; `elapsed_ticks` is 1, or more after ticks that were skipped."""
        if elapsed_ticks < 1:
            raise ValueError(
                f"elapsed_ticks = {elapsed_ticks}; a tick comes at least one tick after the last"
            )
        self._ticks += elapsed_ticks
        self._skipped_ticks += elapsed_ticks - 1
        for frame in frames_in:
            self._receive(frame)
        self.inputs = self._inputs(elapsed_ticks)
        self._estop = False
        before = self.outputs
        self.state, self.outputs = step(self.config, self.state, self.inputs)
        frames_out = self._frames_out(before, self.outputs)
        if frames_in or elapsed_ticks > 1:
            self.counters = self._counted()
        return frames_out

    def _counted(self) -> Counters:
        length, crc, value = self._rejected
        return Counters(
            self._frames,
            length,
            crc,
            value,
            self._repeated,
            self._gaps,
            self._skipped_ticks,
            self._pacer.lost,
        )

    # --- in -----------------------------------------------------------------------------------------

    def _receive(self, frame: Frame) -> None:
        source = self._sources.get(frame.can_id)
        if source is None:
            return
        its_codec = source.codec
        try:
            record = its_codec.decode(frame.data)
        except FrameError as error:
            self._rejected[_REJECTED.get(error.reason, 2)] += 1
            return
        if its_codec.protected:
            counter = its_codec.counter(frame.data)
            silent_ticks = self._ticks - source.counted_tick
            source.counted_tick = self._ticks
            if counter == source.counter and silent_ticks < source.turn_ticks:
                self._repeated += 1
                return
            if source.counter >= 0 and counter != (source.counter + 1) % source.modulus:
                self._gaps += 1
            source.counter = counter
        self._frames += 1
        source.heard_tick = self._ticks
        source.take(record)

    def _take_acceleration(self, record: Accelerometer) -> None:
        self._acceleration = record

    def _take_coarse(self, record: CoarsePosition) -> None:
        self._coarse = record

    def _take_position(self, record: EncoderEstimates) -> None:
        self._position = record

    def _take_heartbeat(self, record: DriveHeartbeat) -> None:
        self._heartbeat = record

    def _take_errors(self, record: DriveErrors) -> None:
        self._disarm_reason = record.disarm_reason

    def _take_current(self, record: DriveCurrent) -> None:
        self._current_a = record.measured_a

    def _take_temperature(self, record: DriveTemperature) -> None:
        self._temperature = record

    def _take_supply(self, record: DriveSupply) -> None:
        self._voltage_v = record.voltage_v

    def _take_estop(self, _record: DriveEstop) -> None:
        self._estop = True

    def _take_command(self, record: OperatorCommand) -> None:
        self._command = record

    def _take_request(self, record: ParameterRequest) -> None:
        self._requests.append(record)

    def _take_gait(self, record: GaitSensors) -> None:
        self._gait = record

    def _inputs(self, elapsed_ticks: int) -> Inputs:
        heartbeat, temperature, command = self._heartbeat, self._temperature, self._command
        gait = self._gait
        current, warmth, supply = self._power_sources
        tick, never = self._ticks, NEVER_TICKS
        return Inputs(
            elapsed_ticks,
            AccelerometerInput(*self._acceleration, min(tick - self._acceleration_source.heard_tick, never)),
            NO_COARSE
            if self._coarse_source.heard_tick < 0
            else CoarseInput(
                self._coarse.striker_position_m, min(tick - self._coarse_source.heard_tick, never)
            ),
            EncoderInput(*self._position, min(tick - self._position_source.heard_tick, never)),
            DriveInput(
                _AXIS_STATES.get(heartbeat.axis_state, _UNDEFINED),
                heartbeat.axis_error,
                self._disarm_reason,
                min(tick - self._heartbeat_source.heard_tick, never),
            ),
            PowerInput(
                self._current_a,
                self._voltage_v,
                temperature.inverter_degc,
                temperature.motor_degc,
                min(tick - min(current.heard_tick, warmth.heard_tick, supply.heard_tick), never),
            ),
            OperatorInput(
                _REQUESTS[command.request],
                command.target_ratio,
                command.target_impulse_n_s,
                min(tick - self._command_source.heard_tick, never),
            ),
            NO_GAIT
            if self._gait_source.heard_tick < 0
            else GaitInput(
                gait.shank_rate_rad_s,
                gait.along_m_s2,
                gait.heel_contact == 1,
                gait.toe_contact == 1,
                min(tick - self._gait_source.heard_tick, never),
            ),
            self._estop,
        )

    # --- out ----------------------------------------------------------------------------------------

    def _frames_out(self, before: Outputs, outputs: Outputs) -> list[Frame]:
        """The torque, and one more frame: the drive's before all that wait."""
        if outputs.separation:
            self._impact_frame(outputs)
        if outputs.fault not in (before.fault, NO_FAULT):
            event = FaultEvent(outputs.fault.value, outputs.disarm_reason)
            self._send(codec.FAULT_EVENT, event, Urgency.AT_ONCE)
        if outputs.refusal not in (before.refusal, NO_REFUSAL):
            refused = FaultEvent(Fault.REQUEST_REFUSED.value, 0, outputs.refusal.value)
            self._send(codec.FAULT_EVENT, refused)
        self._pending_regime = self._pending_regime or outputs.period_ended
        if self._pending_regime and self._spaced(codec.REGIME_REPORT, REGIME_S):
            self._pending_regime = False
            self._send(codec.REGIME_REPORT, _regime_report(outputs))
        if self._due(codec.STRIKER_ESTIMATE):
            self._queue(codec.STRIKER_ESTIMATE, self._striker_estimate)
        if self._due(codec.FIRMWARE_HEARTBEAT):
            self._queue(codec.FIRMWARE_HEARTBEAT, self._firmware_heartbeat)
        if self._gait_source.heard_tick >= 0 and self._due(codec.GAIT_REPORT):
            self._queue(codec.GAIT_REPORT, self._gait_report)
        if self._requests:
            for request in self._requests:
                self._send(codec.PARAMETER_VALUE, self._answer(request, outputs.mode))
            self._requests.clear()
        frames = [codec.SET_INPUT_TORQUE.encode(SetInputTorque(outputs.torque_n_m))]
        if outputs.drive_frame != DriveFrame.NOTHING:
            frames.append(codec.encode(self._drive_record(outputs.drive_frame)))
            return frames
        encode = self._pacer.take()
        if encode is not None:
            frames.append(encode())
        return frames

    def _drive_record(self, frame: DriveFrame) -> Any:  # noqa: PLR0911 - a table
        """The content of a frame that the drive link sends."""
        limits = self.config.drive_link
        match frame:
            case DriveFrame.ESTOP:
                return DriveEstop()
            case DriveFrame.CONTROLLER_MODE:
                return SetControllerMode(TORQUE_CONTROL, PASSTHROUGH)
            case DriveFrame.LIMITS:
                return SetLimits(limits.speed_limit_rad_s / TAU, limits.current_limit_a)
            case DriveFrame.CLOSED_LOOP:
                return SetAxisState(CLOSED_LOOP.value)
            case DriveFrame.CLEAR_ERRORS:
                return ClearErrors(identify=0)
            case DriveFrame.RE_ZERO:
                # Whole turns only: the crank's angle stays what it is.
                position_rev = self._position.position_rev
                return SetAbsolutePosition(position_rev - math.floor(position_rev))
            case _:
                return SetAxisState(AXIS_IDLE.value)

    def _impact_frame(self, outputs: Outputs) -> None:
        """One impact, whose age counts on while its frame waits."""
        tick_s = self.config.tick_s
        # Half a tick: from the sensors' time to this tick's.
        touch_down_ticks = self._ticks - outputs.impact_age_s / tick_s - 0.5
        speed_m_s, impulse_n_s = outputs.impact_speed_m_s, max(outputs.impact_impulse_n_s, 0.0)

        def event() -> ImpactEvent:
            return ImpactEvent((self._ticks - touch_down_ticks) * tick_s, speed_m_s, impulse_n_s)

        self._queue(codec.IMPACT_EVENT, event, Urgency.PROMPT)

    def _striker_estimate(self) -> StrikerEstimate:
        estimate = self.state.estimator
        return StrikerEstimate(estimate.x_m, estimate.v_m_s, self.state.crank.omega_rad_s)

    def _firmware_heartbeat(self) -> FirmwareHeartbeat:
        outputs = self.outputs
        return FirmwareHeartbeat(
            mode=outputs.mode.value,
            fault=outputs.fault.value,
            acting_limit=outputs.acting_limit.value,
            regime=outputs.regime.value,
            target_omega_rad_s=outputs.target_omega_rad_s,
        )

    def _gait_report(self) -> GaitReport:
        cycle, lock = self.state.gait, self.state.lock
        walking = cycle.confidence > 0.0
        return GaitReport(
            gait_phase=cycle.phase if walking else 0.0,
            stride_hz=1.0 / cycle.stride.mean_s if walking else 0.0,
            confidence=cycle.confidence,
            gait_state=cycle.doing.value,
            harmonic=lock.harmonic,
            pulses_in_window=lock.in_window % 256,
            pulses_outside=lock.outside % 256,
        )

    def _answer(self, request: ParameterRequest, mode: Mode) -> ParameterValue:
        """Read or write one parameter; a write that is refused changes nothing."""
        index = request.parameter_index
        status = ParameterStatus.OK
        if request.operation == ParameterOperation.WRITE:
            if mode in _STILL:
                self.parameters, status = write_parameter(self.parameters, index, request.value)
                # Of damaged parameters one is written, and the others are as unknown as before.
                self.config = config_of(self.parameters, self.config.monitors.parameters_damaged)
            else:
                status = ParameterStatus.NOT_WHILE_MOVING
        value, tier, known = read_parameter(self.parameters, index)
        return ParameterValue(
            index, known.value if known != ParameterStatus.OK else status.value, value, tier
        )

    def _send(self, its_codec: FrameCodec[Any], record: Any, urgency: Urgency = Urgency.IN_TURN) -> None:
        """Send `record` as it is now, when its turn comes."""
        self._queue(its_codec, lambda: record, urgency)

    def _queue(
        self, its_codec: FrameCodec[Any], record: Callable[[], Any], urgency: Urgency = Urgency.IN_TURN
    ) -> None:
        """Send what `record` gives when its turn comes."""
        can_id = its_codec.can_id

        def encode() -> Frame:
            count = self._sent.get(can_id, 0)
            self._sent[can_id] = count + 1
            return its_codec.encode(record(), count)

        self._pacer.push(encode, urgency)
        self._due_ticks[can_id] = self._ticks

    def _spaced(self, its_codec: FrameCodec[Any], period_s: float) -> bool:
        """Whether `period_s` has passed since this frame was last sent."""
        last = self._due_ticks.get(its_codec.can_id)
        return last is None or self._ticks - last >= round(period_s / self.config.tick_s)

    def _due(self, its_codec: FrameCodec[Any]) -> bool:
        """Whether a cyclic frame's period has passed."""
        last = self._due_ticks.get(its_codec.can_id)
        return last is None or (self._ticks - last) * self.config.tick_s >= (its_codec.period_s or 0.0) - 1e-9


def powered_up(parameter_file: str, build: Mapping[str, float] | None = None) -> FirmwareNode:
    """A controller that starts with the content of its parameter file, and its build's own parameters.

    With a damaged one it is there on the bus and says so, with default parameters in place of those it cannot
    read, and does not arm.
    """
    try:
        values = read_back(parameter_file, build)
    except ParameterError as error:
        print(error, file=sys.stderr)
        return FirmwareNode(config_of(parameters_of(with_overrides(build or {})), True), build)
    return FirmwareNode(config_of(parameters_of(values), False), values)


def _regime_report(outputs: Outputs) -> RegimeReport:
    return RegimeReport(
        regime=outputs.regime.value,
        impacts=outputs.period_impacts,
        impact_phase_deg=math.degrees(outputs.impact_phase_rad) % 360.0,
        peak_acceleration_m_s2=outputs.peak_acceleration_m_s2,
    )
