"""The end of child processes."""

import sys

import pytest

from hil.timing import processes
from hil.timing.processes import Child

LEADER_ENDS_FIRST = """
import ctypes, os, threading, time
def end_later():
    time.sleep(1.0)
    os.write(1, b"said")
    os._exit(0)
threading.Thread(target=end_later).start()
print("ready", flush=True)
ctypes.CDLL(None).pthread_exit(None)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="pthread_exit leaves a dead first thread on Linux")
def test_a_child_whose_first_thread_has_ended_is_not_killed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(processes, "STOP_TIMEOUT_S", 0.2)
    monkeypatch.setattr(Child, "ended", True)  # no request to end: the child ends by itself
    child = Child("late", [sys.executable, "-P", "-c", LEADER_ENDS_FIRST])
    child.wait_ready()
    assert child.stop() == "said"
    assert not child.killed_at_stop
