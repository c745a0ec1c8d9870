"""A pytest plug-in that comes with the package: tests of the firmware as plain functions.

    def test_start(bench):
        run = bench.run("soft-start-multistable", set={"firmware.start.rise_s": 3.0})
        assert run.regime == "impact"

The same file runs on any clock, any bus and any build of the firmware: `pytest --vibrohil-clock real
--vibrohil-bus vcan --vibrohil-firmware compiled`. The folders of a test that fails are kept and named in
pytest's report; those of a test that passes are removed, except for files that no run made. A run that is
not judged proves nothing: it fails the test, with the reasons.
"""

from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, get_args

import pytest

from firmware_py.shell.builds import Build

if TYPE_CHECKING:
    from firmware_py.shell.builds import Build
    from hil.runs.recorded_run import Run
    from hil.scenario.settings import Settings
    from hil.timing.clock import ClockName, TimeName

KEPT = pytest.StashKey[list[Path]]()
"""Key of the absolute run folders of a test."""
FAILED = pytest.StashKey[bool]()


class Bench:
    """The fixture's object: calls `hil.run` with the clock, time, bus and build of pytest's options."""

    def __init__(
        self, clock: "ClockName", time: "TimeName", bus: str, firmware: "Build", folders: list[Path]
    ) -> None:
        self.clock: ClockName = clock
        self.time: TimeName = time
        self.bus = bus
        self.firmware: Build = firmware
        self._folders = folders

    def run(
        self,
        scenario: str | Path,
        *,
        set: "Settings" = (),
        parameters: str | Path | Sequence[str | Path] = (),
        seed: int | None = None,
    ) -> "Run":
        """Run one scenario, by its name or its file, and return the judged run; see `hil.run`.

        The test fails at once if the run is not judged. An error in the input is shown at the test's line.
        """
        __tracebackhide__ = True
        import hil
        from firmware_py.shell.parameters import ParameterError
        from hil.bus import BusError
        from hil.record.run_folder import RunFolderError
        from text_input import TextInputError

        try:
            run = hil.run(
                scenario,
                clock=self.clock,
                time=self.time,
                bus=self.bus,
                firmware=self.firmware,
                seed=seed,
                set=set,
                parameters=parameters,
            )
        except (TextInputError, ParameterError, RunFolderError, BusError) as error:
            raise error.with_traceback(None) from None
        self._folders.append(run.folder.absolute())
        if run.why_not_judged:
            pytest.fail(f"{run.folder} is not judged: {'; '.join(run.why_not_judged)}", pytrace=False)
        return run


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options for the clock, the time, the bus and the build of all tests of a session."""
    group = parser.getgroup("vibrohil", "vibrohil: runs on the bench")
    group.addoption(
        "--vibrohil-clock",
        choices=("lockstep", "real"),
        default="lockstep",
        help="clock of the runs: lockstep (default, deterministic, fast), or real time",
    )
    group.addoption(
        "--vibrohil-time",
        choices=("held", "strict"),
        default="held",
        help="in real time: held while a process is late (default, on a bus of the run's own), or strict",
    )
    group.addoption(
        "--vibrohil-bus",
        default="auto",
        metavar="SPEC",
        help="in real time: the bus, such as vcan, local or socketcan:can0 (default: auto)",
    )
    group.addoption(
        "--vibrohil-firmware",
        choices=get_args(Build),
        default="compiled",
        help="build of the firmware: compiled (default), python, host-single in single precision, or in "
        "lockstep cortex-m7 or cortex-m4f on an emulator",
    )


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Bench:
    """The bench, for `bench.run(scenario)`."""
    folders: list[Path] = []
    request.node.stash[KEPT] = folders
    config = request.config
    names = ("clock", "time", "bus", "firmware")
    clock, time, bus, firmware = (config.getoption(f"vibrohil_{name}") for name in names)
    return Bench(clock, time, bus, firmware, folders)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the run folders of a test that fails in set-up, call or teardown; remove those of one that passes.

    The report of the teardown is the last of a test.
    """
    report: pytest.TestReport = yield
    folders = item.stash.get(KEPT, [])
    if report.failed:
        item.stash[FAILED] = True
        if folders:
            report.sections.append(("vibrohil: run folders kept", "\n".join(map(str, folders))))
    if report.when == "teardown" and not item.stash.get(FAILED, False):
        from hil.record.run_folder import discard

        for folder in folders:
            discard(folder)
    return report
