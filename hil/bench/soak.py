"""Long runs: extends any scenario, and checks whether its processes grow."""

import copy
import re
from array import array
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

SETTLED_SHARE = 0.25
"""Of a run's samples, those at its start in which processes may still grow: caches fill, pools are made."""
FEWEST_SAMPLES = 40
SAMPLE_S = 1.0
"""Of simulated time, from one sample to the next at most."""
SHORTEST_S = FEWEST_SAMPLES * SAMPLE_S
"""Of a run whose memory is judged."""
LARGEST_GROWTH_MB = 1.0
"""Over a whole run; what grows with each frame would be tens of times that in ten minutes."""
LARGEST_RECORDER_GROWTH_MB_MIN = 10.0
"""The recorder keeps the index of the log that it writes at its end: some 80 kB for each second of log."""
UNITS_S = {"s": 1.0, "m": 60.0, "h": 3600.0}


def duration_s(text: str) -> float:
    """Seconds of `90s`, `10m` or `1.5h`; raises `ValueError`.

    >>> duration_s("10m")
    600.0
    """
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([smh])", text)
    if match is None:
        raise ValueError(f"duration {text!r}: wanted a number with s, m or h, such as 10m")
    return float(match[1]) * UNITS_S[match[2]]


def prolonged(document: Mapping[str, Any], by_s: float, clock: str) -> dict[str, Any]:
    """A scenario's tables with more time before the script's last command.

    That command and faults from then on come later; checks hold the growth of memory beside the others. In
    lockstep there is one process, and no recorder. Raises `ValueError` where the run would be too short.
    """
    longer = copy.deepcopy(dict(document))
    script = longer["script"]
    missing_s = SHORTEST_S - script["duration_s"]
    if by_s < missing_s:
        raise ValueError(
            f"the run would last {script['duration_s'] + by_s:g} s, and the growth of memory takes "
            f"{SHORTEST_S:g} s to see; give --soak {missing_s:g}s or longer"
        )
    script["duration_s"] += by_s
    last_s = max((command["at_s"] for command in script["commands"]), default=0.0)
    for line in [*script["commands"], *script.get("faults", [])]:
        if line["at_s"] >= last_s:
            line["at_s"] += by_s
    longer["checks"] = [
        *longer.get("checks", []),
        {"name": "memory.nodes_growth_mb", "high": LARGEST_GROWTH_MB, "unit": "MB"},
    ]
    if clock != "lockstep":
        name = "memory.recorder_growth_mb_min"
        longer["checks"].append({"name": name, "high": LARGEST_RECORDER_GROWTH_MB_MIN, "unit": "MB/min"})
    return longer


def status_of(pid: int) -> Path:
    """The kernel's page on a process."""
    return Path(f"/proc/{pid}/status")


def own_memory_mb(status: Path) -> float | None:
    """Private memory of the process with this page, without mapped files, in MB; None if unknown."""
    try:
        text = status.read_text()
    except OSError:
        return None
    match = re.search(r"^RssAnon:\s+(\d+) kB$", text, re.MULTILINE)
    return None if match is None else int(match[1]) / 1024.0


class MemoryWatch:
    """Samples of some processes' own memory, taken without growing the process that takes them.

    A `Path` made anew for each sample would: pathlib interns its parts, and the table of interned strings
    doubles after some ten thousand of them, by 1.8 MB in the bench.
    """

    def __init__(self, pids: Mapping[str, int]) -> None:
        self._pages = {name: status_of(pid) for name, pid in pids.items()}
        self._samples = {name: array("d") for name in pids}

    def sample(self) -> None:
        """Look at all of them."""
        for name, page in self._pages.items():
            memory_mb = own_memory_mb(page)
            if memory_mb is not None:
                self._samples[name].append(memory_mb)

    def growth_mb(self) -> dict[str, float]:
        """Growth of each process after its start; without processes with too few samples."""
        return {
            name: grown_mb(samples)
            for name, samples in self._samples.items()
            if len(samples) >= FEWEST_SAMPLES
        }


def grown_mb(samples_mb: Sequence[float]) -> float:
    """The last samples' median above that of the first ones after settling.

    >>> grown_mb([1.0] * 10 + [50.0] * 30)
    0.0
    """
    settled = samples_mb[int(SETTLED_SHARE * len(samples_mb)) :]
    tenth = max(len(settled) // 10, 1)
    return float(np.median(settled[-tenth:]) - np.median(settled[:tenth]))
