"""The memory of a run's processes: what grows is seen, and the watch itself does not grow."""

import mmap
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from firmware_py.shell.builds import Build
from hil.runs.job import Job
from hil.runs.recording import record
from hil.scenario.files import read_scenario
from hil.scenario.scenario import check_scenario
from hil.timing.memory import (
    FEWEST_SAMPLES,
    SAMPLE_S,
    MemoryWatch,
    median_growth_mb,
    own_memory_mb,
    status_of,
)


def test_growth_is_what_comes_after_settling() -> None:
    assert median_growth_mb([float(k) for k in range(10)] + [10.0] * 90) == 0.0
    assert median_growth_mb([0.1 * k for k in range(400)]) == pytest.approx(27.0, abs=0.1)


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


@pytest.mark.parametrize("build", ["python", "compiled"])
def test_lockstep_lets_memory_be_sampled_often_enough(build: Build, tmp_path: Path) -> None:
    document = dict(read_scenario("soft-start-multistable"))
    scenario = check_scenario({**document, "script": {"duration_s": 5.0, "commands": []}}, "rests")
    looks_s: list[float] = []

    def look(done: float, _: str) -> None:
        looks_s.append(5.0 * done)

    record(Job(scenario, 1, build, tmp_path, progress=look))
    edges_s = [0.0, *looks_s, 5.0]
    assert max(later - before for before, later in pairwise(edges_s)) <= SAMPLE_S


LOOKS_AT_ITSELF = """
import os
from hil.timing.memory import MemoryWatch, own_memory_mb, status_of
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
