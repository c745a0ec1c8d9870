"""For all tests: linear algebra's threads, garbage collection, Ctrl-C, untimed properties, layers, guests."""

import fcntl
import os
import signal
import tempfile
from collections import defaultdict
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import settings
from in_process import without_workers
from lacking import require

import tools  # noqa: F401 - keeps linear algebra to one thread
from hil.kernel import user_mode_linux
from hil.timing.realtime import collect_rarely

SLOW_TESTS = Path(__file__).with_name("slow.txt")
"""The names of the tests with the marker `slow`, a line each; `pytest --measure-slow` writes them."""
SLOW_S = 1.0
HIDDEN = Path(__file__).with_name("hidden")
collect_ignore = ["hidden"]
pytest_plugins = ["other_processor"]

collect_rarely()

# What a shell starts in its background is deaf to Ctrl-C, and so would be every process that tests start.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


def pytest_addoption(parser: pytest.Parser) -> None:
    """The long modes of the fuzzers and other tests, and the measurement of the slow tests."""
    group = parser.getgroup("long modes")
    group.addoption("--fuzz-count", type=int, help="number of frames, inputs or kills of each fuzzer")
    group.addoption("--fuzz-seed", type=int, default=7, help="seed of each fuzzer's first case")
    group.addoption("--endurance-ticks", type=int, default=300_000, help="ticks of the endurance run")
    group.addoption("--identification-trials", type=int, help="sampled modules that are identified")
    parser.addoption(
        "--measure-slow", action="store_true", help=f"write the slow tests into {SLOW_TESTS.name}"
    )


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One worker more than there are cores, because tests on the wall clock and in a guest kernel wait."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the slow tests, among them all that run on the wall clock or boot a kernel.

    The folders with the longest tests come first, so that no core waits for the last test of another.
    """
    items.sort(key=lambda item: item.path.relative_to(item.config.rootpath).parts[:2], reverse=True)
    slow = set(SLOW_TESTS.read_text(encoding="utf-8").split())
    for item in items:
        marked = item.get_closest_marker("realtime") or item.get_closest_marker("uml")
        if marked or getattr(item, "originalname", None) in slow:
            item.add_marker("slow")


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Run one guest kernel at a time: all have real-time priority on the same CPU."""
    if item.get_closest_marker("uml") is None:
        return (yield)
    with (Path(tempfile.gettempdir()) / f"vibrohil-tests-{os.geteuid()}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return (yield)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what boots a guest kernel where there is none; in CI no real bus would have been tested."""
    if item.get_closest_marker("uml") is not None:
        require(user_mode_linux.missing_programs(), user_mode_linux.REMEDY)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    """Write the names of the tests that took at least `SLOW_S`, all cases of a test together."""
    if not config.getoption("--measure-slow"):
        return
    seconds: defaultdict[str, float] = defaultdict(float)
    # Set-ups and teardowns are reports without a category.
    for report in (*terminalreporter.getreports("passed"), *terminalreporter.getreports("")):
        seconds[report.location[2].partition("[")[0]] += report.duration
    slow = sorted(name for name, took_s in seconds.items() if took_s >= SLOW_S)
    SLOW_TESTS.write_text("".join(f"{name}\n" for name in slow), encoding="utf-8")


@pytest.fixture(scope="session", autouse=True)
def as_after_setup() -> Iterator[None]:
    """Processes that tests start have neither asammdf nor pandas, as after `make setup`.

    python-can and pyarrow would import them wherever they are installed.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(HIDDEN), prepend=os.pathsep)
        yield


@pytest.fixture
def in_process() -> Iterator[None]:
    """Suites and campaigns run without worker processes."""
    with without_workers():
        yield
