"""Step 3, drive: its watchdog, its direction, and the crank's inertia and friction, by short torque pulses.

The step itself commands the drive, with its own bounds of torque, angle, time and speed; behind it stands the
drive's own watchdog, which is proven before the first torque.

After the pulses that find the torque at which the crank begins to move, a torque that changes its sign at
each `SWING_RAD_S` swings the crank to and fro. Some milliseconds of it give an acceleration α at an angle θ:

    J α = τ − d sign ω − b ω − a0 − a1 θ

whose last terms are the load by the coupling spring, with a striker too slow to follow. Least squares give
1/J, d/J and b/J.
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import AxisError, AxisState, ControlMode, InputMode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    ClearErrors,
    DriveHeartbeat,
    SetAxisState,
    SetControllerMode,
    SetInputTorque,
    SetLimits,
)
from hil.timing.clock import TICK_S
from plant_sim.arrays import FloatArray
from tools.bring_up.at_rest import find_exchanged
from tools.bring_up.operated import clear_errors, names_of
from tools.bring_up.step import Context, Curve, Findings, Largest, Step, StepFailedError
from tools.tuning.result import Value, make_value

TURN_RAD = 2.0 * math.pi
BOUND = Largest(torque_n_m=0.12, angle_rad=1.5, speed_rad_s=6.0)
"""Bounds of the step; the drive's own speed limit stands at the same speed."""
PULSE_END_RAD, PULSE_END_RAD_S = 0.25, 2.5
"""A pulse ends here, so that coasting ends within the bounds."""
SMALLEST_N_M, GROWTH, LONGEST_PULSE_S = 0.002, 1.25, 0.06
MOVED_RAD = 0.02
SWINGS, SWING_RAD_S, SWING_FACTOR, LEAST_SWING_N_M, LONGEST_SWING_S = 40, 3.0, 5.0, 0.06, 0.4
ARMING_S, SILENCE_S, RESTING_S, LONGEST_COAST_S = 1.0, 0.35, 0.1, 1.5
STILL_RAD_S = 0.15
WINDOW = 6
"""Periods over which an acceleration is measured."""
SETTLING = 7
"""Periods after a change of the torque until the encoder's speed follows it."""
PROBE_FACTOR, FASTEST_RAD_S2 = 1.5, 600.0
"""A last pulse of this factor over breakaway shows how light the crank is; no swing accelerates it more."""
SHORTEST_SWING, SWING_FALL = 28, 0.8
"""After a swing of fewer periods, in which too little can be measured, the torque falls to this share."""
FEWEST_ROWS = 15
"""Windows for the five unknowns of the fit."""
PLAUSIBLE_N_M_A = (0.005, 1.0)
NORMAL_95 = 1.96
SHARED = np.array([0.013, 6e-4, 4e-4, 0.0, 0.0])
"""Standard errors that all windows share, as the striker moves on: a share of 1/J, then d in N m and b in
N m s; from 15 modules (seed 72000)."""
TURNING_RAD_S = 0.4
"""Below this speed its sign is uncertain: the encoder's speed lags by a millisecond."""
LONGEST_S = 60.0
OLDEST_ENCODER, OLDEST_BEAT = 20, 350
"""Periods after which a report is too old to command a torque by it."""
Script = Iterator[Sequence[Frame]]


class Sample(NamedTuple):
    """One period: the torque commanded in it, and the encoder's unwrapped angle and speed at its begin."""

    torque_n_m: float
    angle_rad: float
    speed_rad_s: float
    tick: int


class Commander:
    """The drive's only commander: plays `script`, and follows the drive's reports."""

    moves = True
    step_ticks = 1

    def __init__(self, current_limit_a: float) -> None:
        self.beat: DriveHeartbeat | None = None
        self.tick = self._encoder_tick = self._beat_tick = 0
        """The present period, and those of the newest frames."""
        self.is_armed = False
        self.current_limit_a = current_limit_a
        self.angle_rad, self.speed_rad_s = math.nan, 0.0
        self.begin_rad, self.farthest_rad = math.nan, 0.0
        """The angle at which the present pulse or swing began, and the largest angle of one so far."""
        self.samples: list[Sample] = []
        self.currents: list[tuple[float, float]] = []
        """Torque in N m and measured current in A."""
        self.swings: list[tuple[int, int]] = []
        """First sample of each swing, and the one after its last."""
        self.steady = 0
        """Periods since the torque changed."""
        self.breakaway_n_m: dict[int, float] = {}
        self._script = self.script()

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """Follow the reports, and send the script's next frames; StepFailedError after `LONGEST_S`."""
        self.tick = tick
        for frame in received:
            self._follow(frame)
        if tick >= round(LONGEST_S / TICK_S) - 1:
            raise StepFailedError(
                f"the pulses have not ended within {LONGEST_S:g} s: the crank does not come to rest between "
                "them, or the encoder's speed is noisy; mend it, then repeat the step"
            )
        return next(self._script, None)

    def _follow(self, frame: Frame) -> None:
        one = codec.CODEC_BY_ID.get(frame.can_id)
        if one not in (codec.DRIVE_HEARTBEAT, codec.ENCODER_ESTIMATES, codec.DRIVE_CURRENT):
            return
        try:
            record = one.decode(frame.data)
        except FrameError:
            return
        if one is codec.DRIVE_HEARTBEAT:
            self.beat, self._beat_tick = record, self.tick
        elif one is codec.DRIVE_CURRENT:
            if self.steady > SETTLING:
                self.currents.append((self.samples[-1].torque_n_m, record.measured_a))
        else:
            self._encoder_tick, angle_rad = self.tick, record.position_rev * TURN_RAD
            before_rad = angle_rad if math.isnan(self.angle_rad) else self.angle_rad
            self.angle_rad = before_rad + math.remainder(angle_rad - before_rad, TURN_RAD)
            self.speed_rad_s = record.velocity_rev_s * TURN_RAD

    # --- the script: each `yield` is a period ---------------------------------------------------------

    def torque(self, torque_n_m: float) -> list[Frame]:
        """The frame of a torque, within the bound; notes the period. Raises StepFailedError."""
        clamped = max(-BOUND.torque_n_m, min(BOUND.torque_n_m, torque_n_m))
        if self.tick - self._encoder_tick > OLDEST_ENCODER:
            raise StepFailedError(
                "the encoder's frames have stopped, and nothing shows how far the crank turns; the step was "
                "stopped. Look at the encoder's plug and encoder_msg_rate_ms, then repeat the step"
            )
        if self.is_armed:
            self.refuse_silence()
        if abs(self.speed_rad_s) > BOUND.speed_rad_s:
            raise StepFailedError(
                f"the crank turns at {self.speed_rad_s:.1f} rad/s; the step was stopped. End other work on "
                "this machine, which may have delayed a command, then repeat the step"
            )
        turned_rad = abs(self.angle_rad - self.begin_rad)
        self.farthest_rad = max(self.farthest_rad, turned_rad)  # not a number before the first pulse
        if turned_rad > BOUND.angle_rad:
            raise StepFailedError(
                f"a pulse has turned the crank by {turned_rad:.2f} rad; the step was stopped. Look for what "
                "else drives it, then repeat the step"
            )
        if self.is_armed and self.beat and self.beat.axis_state != AxisState.CLOSED_LOOP_CONTROL:
            raise StepFailedError(
                f"the drive has disarmed by itself (errors {names_of(self.beat.axis_error)}). If that is its "
                "watchdog, commands came late: end other work on this machine, then repeat the step"
            )
        self.steady = self.steady + 1 if self.samples and self.samples[-1].torque_n_m == clamped else 0
        self.samples.append(Sample(clamped, self.angle_rad, self.speed_rad_s, self.tick))
        return [codec.SET_INPUT_TORQUE.encode(SetInputTorque(clamped))]

    def refuse_silence(self) -> None:
        """Raise StepFailedError if the drive has not reported its state for `OLDEST_BEAT`."""
        if self.beat is None or self.tick - self._beat_tick > OLDEST_BEAT:
            raise StepFailedError("the drive has fallen silent; check its supply and plug")

    def periods(self, duration_s: float) -> Iterator[None]:
        """The periods of this time; those that this process has missed are among them."""
        end = self.tick + round(duration_s / TICK_S)
        while self.tick < end:
            yield

    def wait(self, duration_s: float) -> Script:
        """Send a torque of 0 for some time."""
        for _ in self.periods(duration_s):
            yield self.torque(0.0)

    def arm(self) -> Script:
        """Set mode and limits, and close the loop; raises StepFailedError if it stays open."""
        mode = SetControllerMode(ControlMode.TORQUE_CONTROL, InputMode.PASSTHROUGH)
        limits = SetLimits(BOUND.speed_rad_s / TURN_RAD, self.current_limit_a)
        settings = (
            codec.SET_CONTROLLER_MODE.encode(mode),
            codec.SET_LIMITS.encode(limits),
            codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.CLOSED_LOOP_CONTROL)),
        )
        for frame in settings:
            yield [*self.torque(0.0), frame]
        self.beat = None
        for _ in self.periods(ARMING_S):
            yield self.torque(0.0)
            if self.beat is not None and self.beat.axis_state == AxisState.CLOSED_LOOP_CONTROL:
                self.is_armed = True
                return
        self.refuse_silence()
        assert self.beat is not None
        raise StepFailedError(
            f"the drive does not close its loop (errors {names_of(self.beat.axis_error) or 'none'}, result "
            f"{self.beat.procedure_result}): calibrate it with the maker's tool, then repeat the step"
        )

    def prove_watchdog(self) -> Script:
        """Fall silent with a closed loop and no torque; the drive must disarm by itself.

        The error of this test, and no other one, is then cleared.
        """
        self.is_armed = False
        for _ in self.periods(SILENCE_S):
            yield []
        self.refuse_silence()
        assert self.beat is not None
        if self.beat.axis_state != AxisState.IDLE:
            yield [codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.IDLE))]
            raise StepFailedError(
                "the drive stays armed without commands: it has no watchdog, and nothing would end the "
                "torque if the controller died. Set enable_watchdog = True and watchdog_timeout = 0.05"
            )
        if self.beat.axis_error != AxisError.WATCHDOG_TIMER_EXPIRED:
            raise StepFailedError(
                f"the drive disarmed in the watchdog's test with errors {names_of(self.beat.axis_error)} "
                "instead of the watchdog's alone; mend the cause, then repeat the step"
            )
        yield [codec.CLEAR_ERRORS.encode(ClearErrors(0))]

    def pulse(self, torque_n_m: float, longest_s: float) -> Script:
        """A pulse that ends at its bounds, then coasting until the crank rests."""
        self.begin_rad, still = self.angle_rad, 0
        for _ in self.periods(longest_s):
            yield self.torque(torque_n_m)
            turned_rad = abs(self.angle_rad - self.begin_rad)
            if turned_rad > PULSE_END_RAD or abs(self.speed_rad_s) > PULSE_END_RAD_S:
                break
        for _ in self.periods(LONGEST_COAST_S):
            yield self.torque(0.0)
            still = still + 1 if abs(self.speed_rad_s) < STILL_RAD_S else 0
            if still > RESTING_S / TICK_S:
                break

    def swing(self, torque_n_m: float) -> Script:
        """A torque until the speed that it causes, of either direction, reaches `SWING_RAD_S`."""
        first, before_rad_s, self.begin_rad = len(self.samples), self.speed_rad_s, self.angle_rad
        for _ in self.periods(LONGEST_SWING_S):
            yield self.torque(torque_n_m)
            if abs(self.angle_rad - self.begin_rad) > BOUND.angle_rad / 2.0:
                raise StepFailedError("a swing has turned the crank by half its bound; repeat the step")
            gained_rad_s = abs(self.speed_rad_s - before_rad_s)
            if abs(self.speed_rad_s) > SWING_RAD_S and gained_rad_s > SWING_RAD_S / 2.0:
                break
        self.swings.append((first, len(self.samples)))

    def script(self) -> Script:
        """Watchdog, growing pulses until the crank moves in both directions, then pulses for the inertia."""
        for _ in self.periods(ARMING_S):
            if not math.isnan(self.angle_rad):
                break
            yield []
        yield from self.arm()
        yield from self.wait(0.1)
        yield from self.prove_watchdog()
        yield from self.arm()
        torque_n_m = SMALLEST_N_M
        while len(self.breakaway_n_m) < 2 and torque_n_m <= BOUND.torque_n_m:
            for sign in (1, -1):
                begin_rad, first = self.angle_rad, len(self.samples)
                yield from self.pulse(sign * torque_n_m, LONGEST_PULSE_S)
                turned_rad = max(abs(one.angle_rad - begin_rad) for one in self.samples[first:])
                if turned_rad > MOVED_RAD and sign not in self.breakaway_n_m:
                    self.breakaway_n_m[sign] = torque_n_m
            torque_n_m *= GROWTH
        if len(self.breakaway_n_m) < 2:
            raise StepFailedError(
                f"the crank does not move at {BOUND.torque_n_m:g} N m: check that it is free, that the "
                "motor's phases are connected, and the drive's calibration"
            )
        breakaway_n_m = max(self.breakaway_n_m.values())
        swing_n_m = min(max(SWING_FACTOR * breakaway_n_m, LEAST_SWING_N_M), BOUND.torque_n_m)
        probe_n_m, first = PROBE_FACTOR * breakaway_n_m, len(self.samples)
        yield from self.pulse(probe_n_m, LONGEST_PULSE_S)
        fastest = max(self.samples[first:], key=lambda one: abs(one.speed_rad_s))
        lasted_s = (fastest.tick - self.samples[first].tick) * TICK_S
        # Friction is below breakaway, so J > (probe − breakaway) t / ω.
        inertia_kg_m2 = (probe_n_m - breakaway_n_m) * lasted_s / max(abs(fastest.speed_rad_s), STILL_RAD_S)
        swing_n_m = min(swing_n_m, max(probe_n_m, FASTEST_RAD_S2 * inertia_kg_m2))
        for number in range(SWINGS):
            yield from self.swing(swing_n_m if number % 2 == 0 else -swing_n_m)
            first, end = self.swings[-1]
            if end - first < SHORTEST_SWING:
                swing_n_m = min(swing_n_m, max(SWING_FALL * swing_n_m, probe_n_m))
        yield [*self.torque(0.0), codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.IDLE))]
        for _ in self.periods(RESTING_S):
            yield []


# --- what the pulses say --------------------------------------------------------------------------------


def accelerations(played: Commander) -> FloatArray:
    """Rows of torque, mean angle, mean speed and acceleration over each window, shape (windows, 4)."""
    samples = np.array(played.samples)
    rows = []
    for first, last in played.swings:
        for start in range(first + SETTLING, last - WINDOW, WINDOW):
            part = samples[start : start + WINDOW]
            if np.min(np.abs(part[:, 2])) > TURNING_RAD_S:
                slope = np.polyfit(part[:, 3] * TICK_S, part[:, 2], 1)[0]
                rows.append((*part[:, :3].mean(axis=0), slope))
    return np.array(rows).reshape(-1, 4)


def fit_crank(rows: FloatArray) -> tuple[dict[str, Value], float]:
    """Inertia, dry and viscous friction with 95 % intervals, and the direction of torque against angle."""
    too_few = (
        f"{len(rows)} accelerations were measured, too few for the inertia: the crank is too light for its "
        "friction, as a motor without its crank is, or frames were lost; look for both, then repeat the step"
    )
    if len(rows) < FEWEST_ROWS:
        raise StepFailedError(too_few)
    torque_n_m, angle_rad, speed_rad_s, slope = rows.T
    load = np.column_stack([np.ones(len(rows)), angle_rad - angle_rad.mean()])
    table = np.column_stack([torque_n_m, -np.sign(speed_rad_s), -speed_rad_s, load])
    found, _, rank, _ = np.linalg.lstsq(table, slope)
    if rank < table.shape[1]:
        raise StepFailedError(too_few)
    left = slope - table @ found
    covariance = np.linalg.inv(table.T @ table) * float(left @ left) / (len(rows) - table.shape[1])
    error = NORMAL_95 * np.sqrt(np.diag(covariance) + (found[0] * SHARED) ** 2)
    by_inertia, inertia_kg_m2 = abs(found[0]), 1.0 / abs(found[0])
    low, high = 1.0 / (by_inertia + error[0]), 1.0 / max(by_inertia - error[0], 0.1 * by_inertia)
    values = {"motor.inertia_kg_m2": make_value("motor.inertia_kg_m2", inertia_kg_m2, low, high)}
    for name, place in (("motor.dry_n_m", 1), ("motor.viscous_n_m_s", 2)):
        bounds = (found[place] + sign * error[place] for sign in (0.0, -1.0, 1.0))
        values[name] = make_value(name, *(max(one * inertia_kg_m2, 0.0) for one in bounds))
    return values, math.copysign(1.0, found[0])


def note_currents(played: Commander, found: Findings) -> None:
    """The torque constant that the measured current suggests; raises StepFailedError if it is implausible."""
    pairs = np.array([one for one in played.currents if abs(one[0]) > 0.5 * LEAST_SWING_N_M])
    if len(pairs) < SWINGS // 4:
        return
    constant = float(np.sum(pairs[:, 0] ** 2) / np.sum(pairs[:, 0] * pairs[:, 1]))
    found.add("torque constant by torque and current", constant, "N m/A")
    if not PLAUSIBLE_N_M_A[0] <= constant <= PLAUSIBLE_N_M_A[1]:
        raise StepFailedError(
            f"{constant:.3g} N m/A by the drive's torque and current is implausible, wanted "
            f"{PLAUSIBLE_N_M_A[0]:g} to {PLAUSIBLE_N_M_A[1]:g}: check the drive's torque_constant"
        )


def drive(context: Context, found: Findings) -> None:
    """Play the pulses, and find direction, inertia and friction."""
    clear_errors(context)
    played, log = Commander(context.values["speed.current_limit_a"]), context.log("drive")
    try:
        context.bench.play(played, LONGEST_S, log)
    finally:
        note_largest(played, found)
    rows = accelerations(played)
    values, direction = fit_crank(rows)
    found.parameters |= values
    for sign, name in ((1, "forward"), (-1, "backward")):
        found.add(f"breakaway torque {name}", played.breakaway_n_m[sign], "N m")
    note_currents(played, found)
    if direction < 0.0:
        if not context.asks(
            "A positive torque turns the encoder backward. Set wiring.torque_reversed = 1? (To change the "
            "drive instead, calibrate its encoder's direction, and repeat the step.)"
        ):
            raise StepFailedError("torque and encoder have opposite directions; change one of them")
        found.parameters["wiring.torque_reversed"] = make_value("wiring.torque_reversed", 1.0)
    find_exchanged(context, found, log)


def note_largest(played: Commander, found: Findings) -> None:
    """The largest torque, angle of a pulse and speed, and the picture."""
    if not played.samples:
        return
    samples = np.array(played.samples)
    found.largest = Largest(
        torque_n_m=float(np.max(np.abs(samples[:, 0]))),
        angle_rad=played.farthest_rad,
        speed_rad_s=float(np.max(np.abs(samples[:, 2]))),
    )
    t_s = samples[:, 3] * TICK_S
    found.curves = [
        Curve("speed in rad/s", t_s, samples[:, 2]),
        Curve("torque in 0.1 N m", t_s, 10.0 * samples[:, 0]),
    ]
    found.axes = ("time in s", "speed and torque")


DRIVE = Step(
    "drive",
    "It proves the drive's watchdog, and finds its direction, inertia and friction by short torque pulses.",
    "The drive is armed, and the crank is turned to and fro: by pulses of torque of up to "
    f"{LONGEST_PULSE_S * 1e3:g} ms, and by {SWINGS} swings of up to {LONGEST_SWING_S:g} s; the striker "
    "follows a little. Keep hands off.",
    7.0,
    lambda _: BOUND,
    drive,
)
