"""Longer runs: the script's end moves, and growing memory is seen."""

import mmap
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from firmware_py.shell.builds import Build
from hil.bench.lockstep import run_lockstep
from hil.scenario.files import read_scenario
from hil.scenario.scenario import check_scenario
from hil.scenario.soak import (
    FEWEST_SAMPLES,
    SAMPLE_S,
    SHORTEST_S,
    MemoryWatch,
    duration_s,
    grown_mb,
    own_memory_mb,
    prolonged,
    status_of,
)


@pytest.mark.parametrize(("text", "seconds"), [("90s", 90.0), ("10m", 600.0), ("1.5h", 5400.0)])
def test_durations(text: str, seconds: float) -> None:
    assert duration_s(text) == seconds


@pytest.mark.parametrize("text", ["10", "m", "-1m", "ten minutes", ""])
def test_what_is_no_duration_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="such as 10m"):
        duration_s(text)


def test_time_comes_before_the_last_command() -> None:
    before = check_scenario(read_scenario("soft-start-multistable"), "short")
    document = dict(before.document)
    after = check_scenario(prolonged(document, 600.0, "real"), "long")
    assert after.duration_s == before.duration_s + 600.0
    assert [command.at_s for command in after.commands[:-1]] == [c.at_s for c in before.commands[:-1]]
    assert after.commands[-1].at_s == before.commands[-1].at_s + 600.0
    assert after.checks[:-2] == before.checks
    assert [check.name for check in after.checks[-2:]] == [
        "memory.nodes_growth_mb",
        "memory.recorder_growth_mb_min",
    ]
    assert before.document == document


def test_faults_keep_their_time_unless_the_last_command_comes_before() -> None:
    before = check_scenario(read_scenario("a-silent-encoder-stops-the-motor"), "short")
    after = check_scenario(prolonged(before.document, 60.0, "real"), "long")
    last_s = max(command.at_s for command in before.commands)
    moved = [60.0 if fault.at_s >= last_s else 0.0 for fault in before.faults]
    assert [fault.at_s for fault in after.faults] == [
        fault.at_s + by_s for fault, by_s in zip(before.faults, moved, strict=True)
    ]


def test_growth_is_what_comes_after_settling() -> None:
    assert grown_mb([float(k) for k in range(10)] + [10.0] * 90) == 0.0
    assert grown_mb([0.1 * k for k in range(400)]) == pytest.approx(27.0, abs=0.1)


def test_memory_that_grows_is_seen() -> None:
    watch = MemoryWatch({"self": os.getpid()})
    kept = []
    block = 4 << 20  # fresh pages: of what was freed before, an allocator might give some again
    for _ in range(FEWEST_SAMPLES):
        kept.append(mmap.mmap(-1, block, flags=mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS))
        kept[-1].write(b"x" * block)
        watch.sample()
    assert watch.growth_mb()["self"] == pytest.approx(4 * 0.675 * FEWEST_SAMPLES, rel=0.2)
    assert own_memory_mb(status_of(2**22 + 1)) is None
    assert MemoryWatch({"self": os.getpid()}).growth_mb() == {}


def test_a_run_that_is_too_short_is_refused_with_the_shortest_that_works() -> None:
    document = dict(read_scenario("soft-start-multistable"))
    missing_s = SHORTEST_S - document["script"]["duration_s"]
    prolonged(document, missing_s, "lockstep")
    with pytest.raises(ValueError, match=f"give --soak {missing_s:g}s or longer"):
        prolonged(document, missing_s - 0.5, "lockstep")


@pytest.mark.parametrize("build", ["python", "compiled"])
def test_lockstep_lets_memory_be_sampled_often_enough(build: Build, tmp_path: Path) -> None:
    document = dict(read_scenario("soft-start-multistable"))
    scenario = check_scenario({**document, "script": {"duration_s": 5.0, "commands": []}}, "rests")
    looks_s: list[float] = []
    run_lockstep(scenario, tmp_path, 1, lambda done, _: looks_s.append(5.0 * done), build)
    edges_s = [0.0, *looks_s, 5.0]
    assert max(later - before for before, later in pairwise(edges_s)) <= SAMPLE_S


LOOKS_AT_ITSELF = """
import os
from hil.scenario.soak import MemoryWatch, own_memory_mb, status_of
watch, own = MemoryWatch({"self": os.getpid()}), status_of(os.getpid())
watch.sample()
before = own_memory_mb(own)
for _ in range(20_000):
    watch.sample()
print(own_memory_mb(own) - before)
"""


def test_watch_does_not_grow_what_it_watches() -> None:
    """Its 20,000 samples themselves take 0.16 MB."""
    looked = subprocess.run(
        [sys.executable, "-c", LOOKS_AT_ITSELF], capture_output=True, text=True, check=True
    )
    assert float(looked.stdout) < 0.3
