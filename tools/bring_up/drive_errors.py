"""Errors that the drive has kept from before a step: named, and cleared after a yes only.

After its watchdog or an E-stop the drive does not arm until its error is cleared. Both may be this command's
own, and neither shows what has ended the torque, so the user decides. Any other error has a cause to mend.
"""

from collections.abc import Sequence

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import AxisError
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import ClearErrors
from tools.bring_up.step import Context, StepFailedError

CLEARED_S = 1.0
"""Longest time in which the drive clears its errors."""
ENDED_BY = {
    AxisError.ESTOP_REQUESTED: "an E-stop, which this command sends when a step ends early in motion",
    AxisError.WATCHDOG_TIMER_EXPIRED: "the drive's watchdog, as it must when the adapter or this command "
    "ends in motion",
}
"""What has ended the torque, by the errors that may be cleared."""


class ErrorCleared:
    """Clears the drive's errors if they are all among `cleared`; ends once they have gone, or are others."""

    moves = False

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


def names_of(error: int) -> str:
    """The names of errors, and the number of those without one.

    >>> names_of(AxisError.DRV_FAULT | AxisError.ESTOP_REQUESTED | 0x80)
    'DRV_FAULT, ESTOP_REQUESTED, 0x80'
    """
    names = [one.name for one in AxisError if error & one]
    unnamed = error & ~sum(AxisError)
    return ", ".join([*names, hex(unnamed)] if unnamed else names)


def clear_errors(context: Context) -> None:
    """Clear the errors of the drive after a yes.

    Raises StepFailedError without it, for errors that are not in `ENDED_BY`, and for those that stay.
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
