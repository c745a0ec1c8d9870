"""A host that pauses processes, and watchdogs that its pauses do not trip."""

import subprocess
from collections.abc import Sequence

PATIENT = [
    "firmware.ceiling.sensor_watchdog_s=2.0",
    "firmware.ceiling.link_watchdog_s=2.0",
    "firmware.watchdog.sensor_s=1.0",
    "firmware.watchdog.encoder_s=1.0",
    "firmware.watchdog.drive_s=1.0",
    "firmware.watchdog.operator_s=1.0",
    "scene.axis.watchdog_s=1.0",
]
"""Settings for nodes in strict time, where nobody waits for a process that the host pauses."""


def stop(stalls: Sequence[tuple[int, float]]) -> None:
    """Stop processes one after another, each for some seconds, from a process that is none of them."""
    steps = (
        f"kill -STOP {pid}; sleep {stalled_s}; kill -CONT {pid}; sleep 0.05" for pid, stalled_s in stalls
    )
    subprocess.run(["/bin/sh", "-c", "; ".join(steps)], check=True)
