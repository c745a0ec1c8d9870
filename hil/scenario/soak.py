"""Long runs: extends any scenario, and checks the memory growth of its processes."""

import re
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hil.scenario.time_shift import later

SETTLING_SHARE = 0.25
"""Share of a run's samples, at its start, in which processes may still grow by filling caches and pools."""
FEWEST_SAMPLES = 40
SAMPLE_S = 1.0
"""Sampling period of memory in simulated seconds."""
SHORTEST_S = FEWEST_SAMPLES * SAMPLE_S
"""Shortest run whose memory growth is judged."""
LARGEST_GROWTH_MB = 1.0
"""Largest growth over a whole run; growth with each frame would reach tens of times this in ten minutes."""
LARGEST_RECORDER_GROWTH_MB_MIN = 10.0
"""Largest growth of the recorder, which keeps the log's index in memory: about 80 kB per second of log."""
UNITS_S = {"s": 1.0, "m": 60.0, "h": 3600.0}


def duration_s(text: str) -> float:
    """Convert `90s`, `10m` or `1.5h` to seconds; raises `ValueError`.

    >>> duration_s("10m")
    600.0
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text)
    if match is None:
        raise ValueError(f"duration {text!r}: wanted a number with s, m or h, such as 10m")
    return float(match[1]) * UNITS_S[match[2]]


def prolonged(document: Mapping[str, Any], by_s: float, clock: str) -> dict[str, Any]:
    """Extend a scenario by `by_s` before the script's last command.

    The last command, and all that comes at or after it in script and checks, are delayed; checks on the
    growth of memory are added. In lockstep there is one process and no recorder. Raises `ValueError` if the
    run would be too short.
    """
    script = document["script"]
    missing_s = SHORTEST_S - script["duration_s"]
    if by_s < missing_s:
        raise ValueError(
            f"the run would last {script['duration_s'] + by_s:g} s, and the growth of memory takes "
            f"{SHORTEST_S:g} s to see; give --soak {missing_s:g}s or longer"
        )
    longer = later(document, last_command_s(script), by_s)
    longer["checks"] = [
        *longer.get("checks", []),
        {"name": "memory.nodes_growth_mb", "high": LARGEST_GROWTH_MB, "unit": "MB"},
    ]
    if clock != "lockstep":
        name = "memory.recorder_growth_mb_min"
        longer["checks"].append({"name": name, "high": LARGEST_RECORDER_GROWTH_MB_MIN, "unit": "MB/min"})
    return longer


def last_command_s(script: Mapping[str, Any]) -> float:
    """The time of the script's last command; 0 without a command."""
    return max((float(command["at_s"]) for command in script.get("commands", [])), default=0.0)


def idles(script: Mapping[str, Any]) -> bool:
    """Whether the drive does not run in the time that `prolonged` adds."""
    last_s = last_command_s(script)
    before = [command for command in script.get("commands", []) if command["at_s"] < last_s]
    return not before or max(before, key=lambda command: command["at_s"])["request"] != "run"


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
            name: grown_mb(samples)
            for name, samples in self._samples.items()
            if len(samples) >= FEWEST_SAMPLES
        }


def grown_mb(samples_mb: Sequence[float]) -> float:
    """Median of the last samples minus the median of the first samples after settling, in MB.

    >>> grown_mb([1.0] * 10 + [50.0] * 30)
    0.0
    """
    settled = samples_mb[int(SETTLING_SHARE * len(samples_mb)) :]
    tenth = max(len(settled) // 10, 1)
    return float(np.median(settled[-tenth:]) - np.median(settled[:tenth]))
