"""The operator's part while the firmware drives: a script, and an eye on what the firmware reports."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import AxisError, Fault, Mode, Refusal, Regime
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import ClearErrors, FaultEvent, FirmwareHeartbeat, ImpactEvent
from hil.nodes.operator.node import OperatorNode
from hil.scenario.commands import Command, Request
from hil.timing.clock import OPERATOR_PERIOD_S, TICK_S
from tools.bring_up.step import Context, StepFailedError

BEGINNING = (
    Command(0.0, Request.IDLE, 0.0),
    Command(0.6, Request.PROVE_WATCHDOG, 0.0),
    Command(1.6, Request.IDLE, 0.0),
)
"""Before each start the firmware tests the drive's watchdog."""
BEGUN_S = 2.2
SILENT_S = 3.0
OPERATOR_TICKS = round(OPERATOR_PERIOD_S / TICK_S)
LINE_TICKS = round(10.0 / TICK_S)
"""Periods between two lines about the motion."""
LONGEST_STOP_S, LONGEST_REST_S = 4.0, 40.0
STILL_REV_S, STILL_S = 0.02, 1.0
"""A crank that is slower for this time rests."""
OLDEST_ENCODER_S = 0.1
"""An older frame of the encoder does not show that the crank rests."""
CLEARED_S = 1.0
"""Longest time in which the drive clears its errors."""
ENDED_BY = {
    AxisError.ESTOP_REQUESTED: "an E-stop, which this command sends when a step ends early in motion",
    AxisError.WATCHDOG_TIMER_EXPIRED: "the drive's watchdog, as it must when the adapter or this command "
    "ends in motion",
}
"""What has ended the torque, by the errors that may be cleared."""


class LatchedFaultError(StepFailedError):
    """The firmware has stopped the module with a fault."""

    def __init__(self, about: str, fault: Fault) -> None:
        super().__init__(about)
        self.fault = fault


class RatioTooHighError(StepFailedError):
    """The module's impacts do not last at the requested ratio, or come later than the firmware holds them."""


LATE = "End other work on this machine, look at the sensors' plugs and the adapter, then repeat the step"
HINTS = {
    Fault.SENSOR_TIMEOUT: f": samples came late or not at all. {LATE}",
    Fault.DRIVE_WATCHDOG: f": commands came late or not at all. {LATE}",
}
"""What to do about a fault that other causes than the module's have too."""


class ErrorCleared:
    """Clears the drive's errors if they are all among `cleared`; ends once they have gone, or are others."""

    moves = False
    step_ticks = OPERATOR_TICKS

    def __init__(self, cleared: int) -> None:
        self._cleared, self._beats = cleared, 0
        self.error = 0
        """The errors that the drive has last reported."""

    def play(self, _: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """Wait for the drive's heartbeats; the first one may be older than the E-stop."""
        before = self._beats
        for frame in received:
            self._follow(frame)
        if self._beats in (before, 1):
            return ()
        is_cleared = self.error and not self.error & ~self._cleared
        return [codec.CLEAR_ERRORS.encode(ClearErrors(0))] if is_cleared else None

    def _follow(self, frame: Frame) -> None:
        if frame.can_id != codec.DRIVE_HEARTBEAT.can_id:
            return
        try:
            self.error = codec.DRIVE_HEARTBEAT.decode(frame.data).axis_error
        except FrameError:
            return
        self._beats += 1


class Stillness:
    """Since when the crank has been slower than `STILL_REV_S`, by the encoder's frames."""

    def __init__(self) -> None:
        self.turning_tick = self._seen_tick = 0

    def follow(self, tick: int, frame: Frame) -> None:
        """Take a frame; others than the encoder's, and damaged ones, show nothing."""
        if frame.can_id != codec.ENCODER_ESTIMATES.can_id:
            return
        try:
            speed_rev_s = abs(codec.ENCODER_ESTIMATES.decode(frame.data).velocity_rev_s)
        except FrameError:
            return
        self._seen_tick = tick
        if not speed_rev_s <= STILL_REV_S:
            self.turning_tick = tick

    def is_seen(self, tick: int) -> bool:
        """Whether the newest frame is young enough to show that the crank rests."""
        return tick <= self._seen_tick + OLDEST_ENCODER_S / TICK_S

    def lasts(self, tick: int) -> bool:
        """Whether the crank has been still for `STILL_S`."""
        return tick > self.turning_tick + STILL_S / TICK_S


class Resting:
    """Waits until the crank rests: the striker may turn it after a stop, which delays the drive's proof."""

    moves = False
    step_ticks = OPERATOR_TICKS

    def __init__(self) -> None:
        self._crank = Stillness()

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """Wait; raises StepFailedError for a crank that does not come to rest."""
        for frame in received:
            self._crank.follow(tick, frame)
        if tick >= LONGEST_REST_S / TICK_S:
            raise StepFailedError(
                f"the crank does not rest within {LONGEST_REST_S:g} s: look for what turns it, or at the "
                "encoder's plug, then repeat the step"
            )
        return None if self._crank.is_seen(tick) and self._crank.lasts(tick) else ()


class Operated:
    """Plays a script behind `BEGINNING` with times from `BEGUN_S` on, and ends once the module stands still.

    A striker without much friction may turn the crank for longer than a stop may last; STOP_FAILED then ends
    the torque, and the module comes to rest by itself, which the encoder must show; `notes` says so.

    `done`: called with the player in each period; True ends the script. Raises LatchedFaultError for a fault
    of the firmware, StepFailedError for a refusal or a crank that does not come to rest.
    """

    moves = True
    step_ticks = OPERATOR_TICKS

    def __init__(
        self, commands: Sequence[Command], end_s: float, done: Callable[["Operated"], bool] = lambda _: False
    ) -> None:
        later = [one._replace(at_s=one.at_s + BEGUN_S) for one in commands]
        self._node = OperatorNode([*BEGINNING, *later], TICK_S, is_recorded=False)
        self._done, self._end_tick, self._waiting = done, round((BEGUN_S + end_s) / TICK_S), list[Frame]()
        self._is_ending = False
        self._free_tick: int | None = None
        """The tick in which a stop ended by STOP_FAILED."""
        self._crank = Stillness()
        self.notes: list[str] = []
        self.says: Callable[[str], None] = lambda _: None
        """Takes a line about the motion now and then."""
        self._line_tick = LINE_TICKS
        self.tick, self._beat_tick = 0, 0
        self.beat: FirmwareHeartbeat | None = None
        self.impacts: list[tuple[int, ImpactEvent]] = []
        """The tick in which each impact was reported."""
        self.held_regime = Regime.UNCERTAIN
        """The regime reported as the script ended."""

    @property
    def longest_s(self) -> float:
        """The longest duration of the whole script with its stop."""
        return self._end_tick * TICK_S + LONGEST_STOP_S + LONGEST_REST_S + STILL_S

    @property
    def ended_tick(self) -> int:
        """The tick in which the script ended."""
        return self._end_tick

    def play(self, tick: int, received: Sequence[Frame]) -> Sequence[Frame] | None:
        """Follow the firmware's reports, and send the script's frames."""
        self.tick = tick
        self._waiting += received
        for frame in received:
            self._follow(frame)
        if tick - self._beat_tick > SILENT_S / TICK_S:
            raise StepFailedError("the firmware's heartbeat is missing")
        if not self._is_ending and (tick >= self._end_tick or self._done(self)):
            self._is_ending, self._end_tick = True, tick
            self.held_regime = Regime(self.beat.regime) if self.beat is not None else Regime.UNCERTAIN
            self._node.finish(tick)
        if self._free_tick is not None:
            return () if self._is_turning(self._free_tick) else None
        if self._is_ending and self.beat is not None and tick > self._end_tick + 1.0 / TICK_S:
            if self.beat.mode == Mode.READY:
                return None
            if tick > self._end_tick + LONGEST_STOP_S / TICK_S:
                raise StepFailedError(f"the module is still in {Mode(self.beat.mode).name} after its stop")
        if tick >= self._line_tick and self.beat is not None:
            self._line_tick += LINE_TICKS
            target_rad_s = self.beat.target_omega_rad_s
            self.says(f"{tick * TICK_S:.0f} s: {Mode(self.beat.mode).name}, target {target_rad_s:.1f} rad/s")
        if tick < self._node.due_tick:
            return ()
        waiting, self._waiting = self._waiting, []
        return self._node.publish(tick, waiting)

    def _is_turning(self, free_tick: int) -> bool:
        """Whether the crank may still turn after a stop that has ended by STOP_FAILED."""
        if not self._crank.is_seen(self.tick):
            raise StepFailedError(
                "the stop ended by STOP_FAILED, and without frames of the encoder nothing shows that the "
                "crank rests: look at it, then mend the encoder's plug"
            )
        if self.tick >= free_tick + LONGEST_REST_S / TICK_S:
            raise StepFailedError(
                f"the stop ended by STOP_FAILED, and the crank still turns {LONGEST_REST_S:g} s later: "
                "switch off the drive's supply, and look for what drives the crank"
            )
        if not self._crank.lasts(self.tick):
            return True
        rests_s = (self._crank.turning_tick - free_tick) * TICK_S
        self.notes.append(
            "the stop ended by STOP_FAILED, which took the torque off; the crank came to rest "
            f"{rests_s:.1f} s later"
        )
        return False

    def _follow(self, frame: Frame) -> None:
        self._crank.follow(self.tick, frame)
        try:
            if frame.can_id == codec.FIRMWARE_HEARTBEAT.can_id:
                self.beat, self._beat_tick = codec.FIRMWARE_HEARTBEAT.decode(frame.data), self.tick
            elif frame.can_id == codec.IMPACT_EVENT.can_id:
                self.impacts.append((self.tick, codec.IMPACT_EVENT.decode(frame.data)))
            elif frame.can_id == codec.FAULT_EVENT.can_id:
                self._stop_for(codec.FAULT_EVENT.decode(frame.data))
        except FrameError:
            return

    def _stop_for(self, event: FaultEvent) -> None:
        if event.fault == Fault.REQUEST_REFUSED and event.refusal == Refusal.RATIO_TOO_HIGH:
            raise RatioTooHighError(
                "the firmware cannot hold this ratio (RATIO_TOO_HIGH): no impacts last there, or they come "
                "too late past the dead centre"
            )
        if event.fault == Fault.REQUEST_REFUSED:
            raise StepFailedError(f"the firmware refused the request: {Refusal(event.refusal).name}")
        if event.fault == Fault.STOP_FAILED and self._is_ending:
            self._free_tick = self._crank.turning_tick = self.tick
            return
        drive = f", the drive's reason {event.disarm_reason:#x}" if event.disarm_reason else ""
        hint = HINTS.get(Fault(event.fault), "")
        about = f"the firmware stopped the module: {Fault(event.fault).name}{drive}{hint}"
        raise LatchedFaultError(about, Fault(event.fault))


def names_of(error: int) -> str:
    """The names of errors, and the number of those without one.

    >>> names_of(AxisError.DRV_FAULT | AxisError.ESTOP_REQUESTED | 0x80)
    'DRV_FAULT, ESTOP_REQUESTED, 0x80'
    """
    names = [one.name for one in AxisError if error & one]
    unnamed = error & ~sum(AxisError)
    return ", ".join([*names, hex(unnamed)] if unnamed else names)


def clear_errors(context: Context) -> None:
    """Clear the errors that the drive has kept from before a step, after a yes.

    After its watchdog or an E-stop it does not arm. Both may be this command's own, and neither shows what
    has ended the torque, so the user decides. Raises StepFailedError without a yes, for any other error,
    whose cause has to be mended, and for errors that stay.
    """
    context.bench.play(found := ErrorCleared(0), CLEARED_S, context.log("before"))
    causes = [cause for one, cause in ENDED_BY.items() if found.error & one]
    if causes and not found.error & ~sum(ENDED_BY):
        asked = (
            f"The drive reports {names_of(found.error)}: its torque was ended by {' and by '.join(causes)}"
        )
        if context.asks(f"{asked}. Clear the error, so that the step may begin?"):
            context.bench.play(found := ErrorCleared(found.error), CLEARED_S, context.log("before"))
    if found.error:
        raise StepFailedError(
            f"the drive reports {names_of(found.error)}: mend its cause, clear the error with the maker's "
            "tool, then repeat the step"
        )


def operate(context: Context, player: Operated, log: Path, parameters: Mapping[str, float]) -> None:
    """Play a script with the firmware, once the drive has no errors and the crank rests."""
    clear_errors(context)
    context.bench.play(Resting(), LONGEST_REST_S + STILL_S, context.log("before"))
    player.says = context.says
    context.bench.play(player, player.longest_s, log, parameters)
