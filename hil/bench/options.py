"""How scenarios are run."""

from dataclasses import dataclass

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
