"""A host that pauses processes, and watchdogs that its pauses do not trip."""

import os
import signal
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

LONGEST_STALL_S = 1.0
"""Shorter host stalls trip none of these watchdogs."""
PATIENT = [
    f"firmware.ceiling.sensor_watchdog_s={2.0 * LONGEST_STALL_S}",
    f"firmware.ceiling.link_watchdog_s={2.0 * LONGEST_STALL_S}",
    f"firmware.watchdog.sensor_s={LONGEST_STALL_S}",
    f"firmware.watchdog.encoder_s={LONGEST_STALL_S}",
    f"firmware.watchdog.drive_s={LONGEST_STALL_S}",
    f"firmware.watchdog.operator_s={LONGEST_STALL_S}",
    f"scene.axis.watchdog_s={LONGEST_STALL_S}",
]
"""Settings for nodes in strict time, where nobody waits for a process that the host pauses."""


def stop(stalls: Sequence[tuple[int, float]]) -> None:
    """Stop processes one after another, each for some seconds, from a process that is none of them."""
    steps = (
        f"kill -STOP {pid}; sleep {stalled_s}; kill -CONT {pid}; sleep 0.05" for pid, stalled_s in stalls
    )
    subprocess.run(["/bin/sh", "-c", "; ".join(steps)], check=True)


@contextmanager
def stalled(pid: int) -> Iterator[None]:
    """A process that the host stalls meanwhile."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        os.kill(pid, signal.SIGCONT)
