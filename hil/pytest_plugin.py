"""A pytest plug-in that comes with the package: tests of the firmware as plain functions.

    def test_start(bench):
        run = bench.run("soft-start-multistable", set={"firmware.start.rise_s": 3.0})
        assert run.regime == "impact"

The same file runs on any clock, any bus and any build of the firmware: `pytest --vibrohil-clock real
--vibrohil-bus vcan --vibrohil-firmware compiled`. The folders of a test that fails are kept and named in
pytest's report; those of a test that passes are removed.
"""

import shutil
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from firmware_py.shell.builds import Build
    from hil.bench.recorded_run import Run
    from hil.scenario.settings import Settings
    from hil.timing.clock import ClockName

KEPT = pytest.StashKey[list[Path]]()
"""Key of the run folders of a test."""
FAILED = pytest.StashKey[bool]()


class Bench:
    """The fixture's object: calls `hil.run` with the clock, bus and build of pytest's options."""

    def __init__(self, clock: "ClockName", bus: str, firmware: "Build", folders: list[Path]) -> None:
        self.clock: ClockName = clock
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
        """Run one scenario, by its name or its file, and return it judged; see `hil.run`."""
        import hil

        run = hil.run(
            scenario,
            clock=self.clock,
            bus=self.bus,
            firmware=self.firmware,
            seed=seed,
            set=set,
            parameters=parameters,
        )
        self._folders.append(run.folder)
        return run


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the options for the clock, the bus and the build of all tests of a session."""
    group = parser.getgroup("vibrohil", "vibrohil: runs on the bench")
    group.addoption(
        "--vibrohil-clock",
        choices=("lockstep", "patient", "real"),
        default="lockstep",
        help="clock of the runs: lockstep (default, deterministic, fast), patient, or real time",
    )
    group.addoption(
        "--vibrohil-bus",
        default="auto",
        metavar="SPEC",
        help="in real time: the bus, such as vcan, local or socketcan:can0 (default: auto)",
    )
    group.addoption(
        "--vibrohil-firmware",
        choices=("python", "compiled", "host-single", "cortex-m7", "cortex-m4f"),
        default="python",
        help="build of the firmware: python (default), compiled, host-single in single precision, or in "
        "lockstep cortex-m7 or cortex-m4f on an emulator",
    )


@pytest.fixture
def bench(request: pytest.FixtureRequest) -> Iterator[Bench]:
    """The bench, for `bench.run(scenario)`."""
    folders: list[Path] = []
    request.node.stash[KEPT] = folders
    config = request.config
    clock, bus, firmware = (config.getoption(f"vibrohil_{name}") for name in ("clock", "bus", "firmware"))
    yield Bench(clock, bus, firmware, folders)
    if not request.node.stash.get(FAILED, False):
        for folder in folders:
            shutil.rmtree(folder)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """Name the run folders of a test that failed."""
    report: pytest.TestReport = yield
    if report.when == "call" and report.failed:
        item.stash[FAILED] = True
        folders: Any = item.stash.get(KEPT, [])
        if folders:
            report.sections.append(("vibrohil: run folders kept", "\n".join(map(str, folders))))
    return report
