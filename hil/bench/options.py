"""How scenarios are run."""

from dataclasses import dataclass

from hil.nodes.own_controller import load_own
from hil.record.traces.own_trace import NONE, is_build
from hil.scenario.files import ScenarioError
from hil.timing.clock import ClockName, TimeName


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions:
    """The options of a run, and of each run of a suite."""

    clock: ClockName = "real"
    time: TimeName = "held"
    """Whether real time is held while a node is late; on a bus that is not the run's own it never is."""
    bus: str = "auto"
    firmware: str = "compiled"
    """A build of the firmware (`firmware_py.shell.builds.Build`), a user's controller as `FILE.py:FUNCTION`,
    or `none` where another program on the bus is the controller.
    """
    viewer: str | None = None
    """URL of an open viewer, or `window`, which shows the run while it runs in real time."""
    keep_traces: bool = True
    """If False, the traces of a run that has passed are removed; its log remains."""
    only_if_failed: bool = False
    """Whether a run that has passed leaves only its verdict and its scenario."""
    of_a_suite: bool = False
    """Whether an interrupted run is not judged, since its suite runs it again."""

    @property
    def of_the_result(self) -> dict[str, str]:
        """The options on which the result of a suite depends, as stored in suite.json."""
        return {"clock": self.clock, "time": self.time, "bus": self.bus, "firmware": self.firmware}


def prepare(options: RunOptions) -> None:
    """Make the image of an emulated build, and look at a user's controller.

    Raises BoardError if the build cannot run here, TextInputError for a controller that cannot.
    """
    if options.firmware == NONE:
        if options.clock == "lockstep":
            raise ScenarioError(
                "--firmware none with --clock lockstep: another program joins the bus in real time; give "
                "--clock real, or --firmware FILE.py:FUNCTION for a controller that lockstep calls"
            )
        return
    if not is_build(options.firmware):
        load_own(options.firmware)
        return
    if options.firmware not in ("cortex-m7", "cortex-m4f"):
        return
    from firmware_py.builds.board import BoardError, image  # noqa: PLC0415 - imports LLVM

    if options.clock != "lockstep":
        raise BoardError(
            f"--firmware {options.firmware} with --clock {options.clock}: an emulated board keeps no wall "
            "clock's time; give --clock lockstep"
        )
    image("cortex-m7" if options.firmware == "cortex-m7" else "cortex-m4f")
