"""The memory of a run's processes: whether it grows in a long run."""

import re
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

SETTLING_SHARE = 0.25
"""Share of a run's samples, at its start, in which processes may still grow by filling caches and pools."""
FEWEST_SAMPLES = 40
SAMPLE_S = 1.0
"""Sampling period of memory in simulated seconds."""


def status_of(pid: int) -> Path:
    """Path of the kernel's status file of a process."""
    return Path(f"/proc/{pid}/status")


def own_memory_mb(status: Path) -> float | None:
    """Private memory in MB of the process with this status file, without mapped files; None if unknown."""
    try:
        text = status.read_text()
    except OSError:
        return None
    match = re.search(r"^RssAnon:\s+(\d+) kB$", text, re.MULTILINE)
    return None if match is None else int(match[1]) / 1024.0


class MemoryWatch:
    """Samples the private memory of processes without growth of the sampling process.

    A new `Path` for each sample would cause growth: pathlib interns its parts, and the table of interned
    strings doubles after some ten thousand strings, by 1.8 MB in the bench.
    """

    def __init__(self, pids: Mapping[str, int]) -> None:
        self._pages = {name: status_of(pid) for name, pid in pids.items()}
        self._samples = {name: array("d") for name in pids}

    def sample(self) -> None:
        """Take a sample of each process."""
        for name, page in self._pages.items():
            memory_mb = own_memory_mb(page)
            if memory_mb is not None:
                self._samples[name].append(memory_mb)

    def growth_mb(self) -> dict[str, float]:
        """Growth of each process after settling, in MB; without processes with too few samples."""
        return {
            name: median_growth_mb(samples)
            for name, samples in self._samples.items()
            if len(samples) >= FEWEST_SAMPLES
        }


def median_growth_mb(samples_mb: Sequence[float]) -> float:
    """Median of the last samples minus the median of the first samples after settling, in MB.

    >>> median_growth_mb([1.0] * 10 + [50.0] * 30)
    0.0
    """
    settled = samples_mb[int(SETTLING_SHARE * len(samples_mb)) :]
    tenth = max(len(settled) // 10, 1)
    return float(np.median(settled[-tenth:]) - np.median(settled[:tenth]))
