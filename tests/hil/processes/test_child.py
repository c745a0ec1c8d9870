"""The end of child processes."""

import subprocess
import sys

import pytest

from hil.processes.child import Child, ChildError

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
    monkeypatch.setattr("hil.processes.child.STOP_TIMEOUT_S", 0.2)
    monkeypatch.setattr(subprocess.Popen, "terminate", lambda _: None)  # the child ends by itself
    child = Child("late", [sys.executable, "-P", "-c", LEADER_ENDS_FIRST])
    child.wait_ready()
    assert child.stop() == "said"
    assert not child.killed_at_stop


def test_a_child_that_closes_its_output_and_lives_on_is_an_error_of_the_child(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As that of a host which is busy for long: the run fails for this reason, and does not break off."""
    monkeypatch.setattr("hil.processes.child.EXIT_TIMEOUT_S", 0.2)
    monkeypatch.setattr("hil.processes.child.STOP_TIMEOUT_S", 0.2)
    silent = Child("silent", [sys.executable, "-P", "-c", "import os, time; os.close(1); time.sleep(60.0)"])
    with pytest.raises(ChildError, match="silent has closed its output and not ended"):
        silent.wait_ready()
    silent.stop()
