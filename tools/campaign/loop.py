"""One closed loop from power-up on, in one kernel, in the order that time gives the nodes of the bench.

At t_k the sensors are sampled and the drive reports, the drive obeys what the firmware sent a tick ago and
the module moves on under that torque to t_{k+1}; the operator speaks; the firmware ticks on what has arrived.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.drive_link import DriveFrame
from firmware_py.core.estimator import EstimatorState
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
from firmware_py.core.step import Config, Outputs, State, step
from firmware_py.interface.enums import Mode, OperatorRequest, Refusal
from hil import drive as axis
from hil.drive import DriveConfig, DriveState, Telemetry
from hil.reports import Reports, Ticks, look, take
from plant_sim.parts.drive import motor_current_a, motor_torque_n_m
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import origin_m
from plant_sim.sensing import HIGH, HOUSING, LOW, SPEED_ESTIMATE
from plant_sim.sensors import (
    AccelerometerReader,
    Readers,
    read_accelerometer,
    read_position_rev,
    read_velocity_rev_s,
)
from plant_sim.solvers.memory import IMPACTS, PHASE
from plant_sim.solvers.motion import FLIGHT, felt_force_n, from_stop_m
from tools.campaign.columns import (
    DETECTIONS,
    FULL,
    KICKED,
    LEAST_AT,
    LEAST_EIGENVALUE,
    MODES,
    PERIODS,
    REFUSED_AT,
    SUM_NIS,
    SUM_OMEGA,
    SUM_OMEGA_2,
    SUM_TICKS,
    SUM_V,
    SUM_X,
    SUMS,
    TRACE_ANGLE,
    TRACE_COLUMNS,
    TRACE_CONFIDENCE,
    TRACE_FELT,
    TRACE_HIGH,
    TRACE_HOUSING,
    TRACE_IMPACT,
    TRACE_LOW,
    TRACE_MODE,
    TRACE_OMEGA,
    TRACE_PHASE,
    TRACE_POSITION,
    TRACE_REGIME,
    TRACE_TARGET,
    TRACE_TORQUE,
    TRACE_V,
    TRACE_V_ESTIMATED,
    TRACE_VELOCITY,
    TRACE_X,
    TRACE_X_ESTIMATED,
    TURNS_SEEN,
    WORST_V,
    WORST_X,
)
from tools.campaign.kernels import kernel, subroutine
from tools.campaign.plant import Filters, Module, advance
from tools.campaign.quantise import Counts, framed, single
from tools.campaign.shell import Heard, heard_at, obeyed, told

Vector = NDArray[np.float64]

OPERATOR_TICKS = 10
COMMAND_TICKS = 100
KICK_TICKS = 10
"""A kick is a constant force for this time; the striker's accelerometers feel it."""
COARSE_NOISE_M = 2e-3
"""A Hall or string sensor's, rms."""


class Scales(NamedTuple):
    """Scales and limits of signals on the bus."""

    striker_low: Counts
    striker_high: Counts
    housing: Counts
    coarse: Counts
    ratio: Counts
    impulse: Counts


class Script(NamedTuple):
    """The operator's commands, shapes (n,): from which tick on, what, at which ratio and impulse."""

    at_tick: NDArray[np.int64]
    request: NDArray[np.int64]
    target_ratio: Vector
    target_impulse_n_s: Vector


class GaitFrames(NamedTuple):
    """What the gait sensors say, a row every `ticks`, shape (n, 4).

    The shank's rate and the force along it, heel and toe on the ground; a row of NaN has dropped out. No
    rows: none are fitted.
    """

    rows: Vector
    ticks: int


class Plan(NamedTuple):
    """A kick that adds to the striker's velocity, from the first tick of flight since `kick_tick`; −1: none.

    `judged_tick`: from where on the sums are taken. `endless`: the covariance is watched, and what the
    record has no room for is forgotten instead of ending the run. `coarse_ticks`: how often a coarse position
    comes; 0: none is fitted.
    """

    kick_tick: int
    kick_m_s: float
    judged_tick: int
    endless: bool
    coarse_ticks: int


class Record(NamedTuple):
    """What a run leaves. The true impacts are in the module's memory.

    detections: (tick, age_s, approach_speed_m_s); periods: (tick, regime, impacts, phase_rad);
    modes: (tick, mode, fault); turns: ticks in which the true crank passed 0; kicked: the state after a kick.
    """

    detections: Vector
    periods: Vector
    modes: Vector
    turns: Vector
    kicked: Vector
    sums: Vector
    trace: Vector
    counts: NDArray[np.int64]


def record(duration_s: float, tick_s: float, traced: bool) -> Record:
    """Room for a run: up to 20 detections, periods and turns a second, 64 changes of mode."""
    rows = 64 + round(20.0 * duration_s)
    sums = np.zeros(SUMS)
    sums[LEAST_EIGENVALUE] = sums[REFUSED_AT] = np.inf
    return Record(
        detections=np.zeros((rows, 3)),
        periods=np.zeros((rows, 4)),
        modes=np.zeros((64, 3)),
        turns=np.zeros(rows),
        kicked=np.zeros(8),
        sums=sums,
        trace=np.zeros((round(duration_s / tick_s) if traced else 0, TRACE_COLUMNS)),
        counts=np.zeros(6, dtype=np.int64),
    )


class Speech(NamedTuple):
    """Whether the operator speaks now; the script's next line, when the command is due, and the command."""

    now: bool
    next_line: int
    due_tick: int
    request: int
    target_ratio: float
    target_impulse_n_s: float


@kernel
def run(  # noqa: PLR0915 - one tick, in the order that time gives the nodes
    parts: Parts,
    filters: Filters,
    module: Module,
    readers: Readers,
    scales: Scales,
    drive_config: DriveConfig,
    drive: DriveState,
    report_ticks: Ticks,
    reports: Reports,
    heard: Heard,
    config: Config,
    state: State,
    script: Script,
    gait: GaitFrames,
    plan: Plan,
    noise: np.random.Generator,
    record: Record,
    ticks: int,
) -> None:
    """Run a closed loop for this number of ticks, from power-up on."""
    y = module.memory.y
    tick_s = config.tick_s
    stop_m = origin_m(parts.stop, parts.striker)
    torque_n_m, frame, mode = 0.0, DriveFrame.NOTHING, Mode.INIT
    speech = Speech(False, 0, 0, 0, 0.0, 0.0)
    gait_input = GaitInput(0.0, 0.0, False, False, NEVER_TICKS)
    held_n_m = 0.0
    angle_rad = y[2]
    pushes = 0
    for tick in range(ticks):
        # Sensors and drive at t_k
        accelerometer = AccelerometerInput(
            _reading(readers.striker_low, scales.striker_low, _felt(filters, LOW), noise),
            _reading(readers.striker_high, scales.striker_high, _felt(filters, HIGH), noise),
            _reading(readers.housing, scales.housing, _felt_by_housing(filters), noise),
            0,
        )
        encoder = _encoder(readers, filters, y[2], noise.standard_normal())
        current_a = motor_current_a(parts.drive, held_n_m, y[3])
        telemetry = Telemetry(current_a, motor_torque_n_m(parts.drive, held_n_m, y[3]), y[3])
        reports, report = take(look(report_ticks, reports, tick))
        heard = heard_at(heard, report, drive, drive_config, telemetry)
        x_m, v_m_s, omega_rad_s = from_stop_m(parts.wearer, parts.drive, y) + stop_m, y[1], y[3]
        felt_n = felt_force_n(parts.wearer, parts.drive, y)
        gait_input = _gait(gait, gait_input, tick)
        coarse = _coarse(plan, scales, x_m, tick, noise)
        if y[2] < angle_rad and omega_rad_s > 0.0:
            record.turns[record.counts[TURNS_SEEN]] = tick
            record.counts[TURNS_SEEN] += 1
        angle_rad = y[2]

        # Drive and module until t_{k+1}
        drive = obeyed(
            drive,
            torque_n_m,
            frame,
            drive_config,
            config.drive_link.speed_limit_rad_s,
            config.drive_link.current_limit_a,
        )
        held_n_m = axis.torque_n_m(drive_config, drive, omega_rad_s)
        pushes = _moved(plan, parts, filters, module, record, held_n_m, pushes, tick, tick_s)
        current_a = motor_current_a(parts.drive, held_n_m, y[3])
        drive = axis.elapse(drive_config, drive, tick_s, y[3], current_a)

        # Operator
        if tick % OPERATOR_TICKS == 0:
            speech = _speech(speech, script, scales, tick)
            if speech.now:
                heard = told(heard, speech.request, speech.target_ratio, speech.target_impulse_n_s)

        # Firmware at t_k + T/2
        state, outputs = step(config, state, _inputs(accelerometer, coarse, encoder, heard, gait_input))
        torque_n_m, frame = single(outputs.torque_n_m), outputs.drive_frame
        if outputs.mode != mode:
            _book_mode(record, tick, outputs)
        mode = outputs.mode

        # Books
        _book(record, tick, outputs)
        estimate = state.estimator
        if outputs.mode == Mode.RUN and tick >= plan.judged_tick:
            _book_errors(record.sums, estimate, x_m, v_m_s, omega_rad_s)
        if plan.endless and estimate.started:
            _book_covariance(record.sums, estimate, tick)
        if record.trace.shape[0] > tick:
            row = record.trace[tick]
            _book_trace(row, estimate, outputs, x_m, v_m_s, omega_rad_s, angle_rad)
            row[TRACE_LOW], row[TRACE_HIGH] = accelerometer.low_m_s2, accelerometer.high_m_s2
            row[TRACE_HOUSING] = accelerometer.housing_m_s2
            row[TRACE_POSITION], row[TRACE_VELOCITY] = encoder.position_rev, encoder.velocity_rev_s
            row[TRACE_FELT] = felt_n
            row[TRACE_PHASE], row[TRACE_CONFIDENCE] = state.gait.phase, state.gait.confidence
        if _is_full(record, module):
            if not plan.endless:
                record.counts[FULL] = 1
                return
            record.counts[DETECTIONS] = record.counts[PERIODS] = record.counts[TURNS_SEEN] = 0
            module.memory.mode[IMPACTS] = 0


@subroutine
def _reading(
    reader: AccelerometerReader, scale: Counts, filtered_m_s2: float, noise: np.random.Generator
) -> float:
    return framed(scale, read_accelerometer(reader, filtered_m_s2, noise.standard_normal()))


@subroutine
def _encoder(readers: Readers, filters: Filters, angle_rad: float, noise: float) -> EncoderInput:
    velocity_rev_s = read_velocity_rev_s(readers, filters.states[SPEED_ESTIMATE].real, noise)
    return EncoderInput(single(read_position_rev(readers, angle_rad)), single(velocity_rev_s), 0)


@subroutine
def _coarse(plan: Plan, scales: Scales, x_m: float, tick: int, noise: np.random.Generator) -> CoarseInput:
    """A slow absolute sensor's reading where one is fitted and due."""
    if plan.coarse_ticks == 0 or tick % plan.coarse_ticks != 0:
        return CoarseInput(0.0, NEVER_TICKS)
    return CoarseInput(framed(scales.coarse, x_m + COARSE_NOISE_M * noise.standard_normal()), 0)


@subroutine
def _gait(gait: GaitFrames, before: GaitInput, tick: int) -> GaitInput:
    """The gait sensors' frame of this tick, or the last one, a tick older."""
    place = tick // gait.ticks
    if tick % gait.ticks == 0 and place < gait.rows.shape[0] and not np.isnan(gait.rows[place, 0]):
        row = gait.rows[place]
        return GaitInput(row[0], row[1], row[2] > 0.0, row[3] > 0.0, 0)
    return GaitInput(
        before.shank_rate_rad_s,
        before.along_m_s2,
        before.heel,
        before.toe,
        min(before.age_ticks + 1, NEVER_TICKS),
    )


@subroutine
def _moved(
    plan: Plan,
    parts: Parts,
    filters: Filters,
    module: Module,
    record: Record,
    held_n_m: float,
    pushes: int,
    tick: int,
    tick_s: float,
) -> int:
    """Move on by a tick, with its part of the kick, which begins in flight; how many parts there have been.

    The state after the last part is kept.
    """
    y = module.memory.y
    is_due = plan.kick_tick >= 0 and tick >= plan.kick_tick and pushes < KICK_TICKS
    is_pushed = is_due and (pushes > 0 or module.memory.mode[PHASE] == FLIGHT)
    part_m_s = plan.kick_m_s / KICK_TICKS
    if is_pushed:
        y[1] += part_m_s
    advance(parts, filters, module, held_n_m, tick * tick_s, tick_s)
    if not is_pushed:
        return pushes
    for which in (LOW, HIGH):
        filters.states[which] += filters.steps[0, which, 1] * (part_m_s / tick_s)
    if pushes + 1 == KICK_TICKS:
        record.counts[KICKED] = tick + 1
        for i in range(record.kicked.size):
            record.kicked[i] = y[i]
    return pushes + 1


@subroutine
def _speech(speech: Speech, script: Script, scales: Scales, tick: int) -> Speech:
    """The operator's look at the script; a command leaves at a change and every `COMMAND_TICKS`."""
    line = speech.next_line
    while line < script.at_tick.size and script.at_tick[line] <= tick:
        line += 1
    if line == speech.next_line and tick < speech.due_tick:
        return Speech(
            False, line, speech.due_tick, speech.request, speech.target_ratio, speech.target_impulse_n_s
        )
    due_tick = (tick // COMMAND_TICKS + 1) * COMMAND_TICKS
    if line == 0:
        return Speech(True, line, due_tick, 0, 0.0, 0.0)
    return Speech(
        True,
        line,
        due_tick,
        script.request[line - 1],
        framed(scales.ratio, script.target_ratio[line - 1]),
        framed(scales.impulse, script.target_impulse_n_s[line - 1]),
    )


@subroutine
def _book_mode(record: Record, tick: int, outputs: Outputs) -> None:
    place = record.counts[MODES]
    if place < record.modes.shape[0]:
        row = record.modes[place]
        row[0], row[1], row[2] = tick, outputs.mode.value, outputs.fault.value
        record.counts[MODES] += 1


@subroutine
def _book(record: Record, tick: int, outputs: Outputs) -> None:
    if outputs.impact:
        row = record.detections[record.counts[DETECTIONS]]
        row[0], row[1], row[2] = tick, outputs.impact_age_s, outputs.impact_speed_m_s
        record.counts[DETECTIONS] += 1
    if outputs.period_ended:
        row = record.periods[record.counts[PERIODS]]
        row[0], row[1] = tick, outputs.regime.value
        row[2], row[3] = outputs.period_impacts, outputs.impact_phase_rad
        record.counts[PERIODS] += 1
    if outputs.refusal == Refusal.RATIO_TOO_HIGH:
        record.sums[REFUSED_AT] = min(record.sums[REFUSED_AT], tick)


@subroutine
def _book_errors(
    sums: Vector, estimate: EstimatorState, x_m: float, v_m_s: float, omega_rad_s: float
) -> None:
    x_error, v_error = estimate.x_m - x_m, estimate.v_m_s - v_m_s
    sums[SUM_TICKS] += 1.0
    sums[SUM_X] += x_error * x_error
    sums[SUM_V] += v_error * v_error
    sums[SUM_OMEGA] += omega_rad_s
    sums[SUM_OMEGA_2] += omega_rad_s * omega_rad_s
    sums[WORST_X] = max(sums[WORST_X], abs(x_error))
    sums[WORST_V] = max(sums[WORST_V], abs(v_error))
    sums[SUM_NIS] += estimate.nis


@subroutine
def _book_covariance(sums: Vector, estimate: EstimatorState, tick: int) -> None:
    least = least_eigenvalue(
        estimate.p_xx, estimate.p_xv, estimate.p_xb, estimate.p_vv, estimate.p_vb, estimate.p_bb
    )
    if not least >= sums[LEAST_EIGENVALUE]:
        sums[LEAST_EIGENVALUE] = least
        sums[LEAST_AT] = tick


@subroutine
def _book_trace(
    row: Vector,
    estimate: EstimatorState,
    outputs: Outputs,
    x_m: float,
    v_m_s: float,
    omega_rad_s: float,
    angle_rad: float,
) -> None:
    row[TRACE_X], row[TRACE_V] = x_m, v_m_s
    row[TRACE_OMEGA], row[TRACE_ANGLE] = omega_rad_s, angle_rad
    row[TRACE_X_ESTIMATED], row[TRACE_V_ESTIMATED] = estimate.x_m, estimate.v_m_s
    row[TRACE_MODE], row[TRACE_REGIME] = outputs.mode.value, outputs.regime.value
    row[TRACE_IMPACT] = 1.0 if outputs.impact else 0.0
    row[TRACE_TORQUE], row[TRACE_TARGET] = outputs.torque_n_m, outputs.target_omega_rad_s


@subroutine
def _is_full(record: Record, module: Module) -> bool:
    """Whether the next tick might not find room."""
    counts = record.counts
    rows = max(counts[DETECTIONS], counts[PERIODS], counts[TURNS_SEEN]) + 1
    is_full: bool = (
        rows >= record.turns.size or module.memory.mode[IMPACTS] + 8 >= module.memory.impacts.shape[0]
    )
    return is_full


@subroutine
def least_eigenvalue(xx: float, xv: float, xb: float, vv: float, vb: float, bb: float) -> float:
    """The smallest eigenvalue of a symmetric 3×3 matrix, given by its upper triangle.

    Newton's method from 0 on det(P − λ) = −λ³ + t λ² − m λ + d: where P > 0 all roots lie to its right, and
    it converges to the smallest without passing it. Where P is not positive, the sign of the answer says so,
    but not by how much; NaN where P holds one.
    """
    t = xx + vv + bb
    m = xx * vv - xv * xv + xx * bb - xb * xb + vv * bb - vb * vb
    d = xx * (vv * bb - vb * vb) - xv * (xv * bb - vb * xb) + xb * (xv * vb - vv * xb)
    if np.isnan(d + m + t):
        return np.nan
    if not (d > 0.0 and m > 0.0 and t > 0.0):
        return min(d, m, t)
    eigenvalue = 0.0
    for _ in range(20):
        value = ((-eigenvalue + t) * eigenvalue - m) * eigenvalue + d
        slope = (-3.0 * eigenvalue + 2.0 * t) * eigenvalue - m
        change = -value / slope
        eigenvalue += change
        if abs(change) <= 1e-12 * eigenvalue:
            break
    return eigenvalue


@subroutine
def _felt(filters: Filters, which: int) -> float:
    """What an accelerometer's low-pass holds, m/s²: 2 Re(r z) with r = −j Im λ."""
    felt_m_s2: float = 2.0 * filters.poles[which].imag * filters.states[which].imag
    return felt_m_s2


@subroutine
def _felt_by_housing(filters: Filters) -> float:
    """The same of the housing's, which only one that is tilted or moves has."""
    return _felt(filters, HOUSING) if filters.states.size > HOUSING else 0.0


@subroutine
def _inputs(
    accelerometer: AccelerometerInput,
    coarse: CoarseInput,
    encoder: EncoderInput,
    heard: Heard,
    gait: GaitInput,
) -> Inputs:
    """What the firmware's shell hands to the core in an ordinary tick."""
    request = OperatorRequest.IDLE
    if heard.request == OperatorRequest.RUN.value:
        request = OperatorRequest.RUN
    elif heard.request == OperatorRequest.CLEAR_FAULTS.value:
        request = OperatorRequest.CLEAR_FAULTS
    return Inputs(
        elapsed_ticks=1,
        accelerometer=accelerometer,
        coarse=coarse,
        encoder=encoder,
        drive=DriveInput(heard.axis_state, heard.axis_error, heard.disarm_reason, heard.heartbeat_age),
        power=PowerInput(
            heard.current_a,
            heard.voltage_v,
            heard.inverter_degc,
            heard.motor_degc,
            max(heard.current_age, heard.temperature_age, heard.supply_age),
        ),
        operator=OperatorInput(request, heard.target_ratio, heard.target_impulse_n_s, heard.operator_age),
        gait=gait,
        estop=False,
    )


@kernel
def run_alone(
    parts: Parts,
    filters: Filters,
    module: Module,
    omega_rad_s: float,
    until_rad_s: float,
    ramp_ticks: int,
    ticks: int,
    tick_s: float,
) -> None:
    """The module alone, its crank led from one speed to another in `ramp_ticks`, then held."""
    y = module.memory.y
    for tick in range(ticks):
        share = min(1.0, tick / ramp_ticks) if ramp_ticks > 0 else 1.0
        y[3] = omega_rad_s + (until_rad_s - omega_rad_s) * share
        advance(parts, filters, module, 0.0, tick * tick_s, tick_s)
        if module.memory.mode[IMPACTS] + 8 >= module.memory.impacts.shape[0]:
            module.memory.mode[IMPACTS] = 0
