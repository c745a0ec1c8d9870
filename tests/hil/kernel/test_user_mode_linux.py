"""A command under user-mode Linux behaves as it would outside, and has a CAN bus."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from hil.kernel import user_mode_linux as uml
from hil.timing.realtime import NODE_PRIORITY

ROOT = Path(__file__).parents[3]
RUN = (
    "import sys; from hil.kernel.user_mode_linux import run_in_kernel; sys.exit(run_in_kernel(sys.argv[1:]))"
)
IN_THE_GUEST = """
import mmap, multiprocessing, os, subprocess, sys, time
deliverer = int(subprocess.check_output(["busybox", "pidof", "ksoftirqd/0"]))
print(os.sched_getscheduler(deliverer), os.sched_getparam(deliverer))
with open(sys.argv[1], "r+b") as file, mmap.mmap(file.fileno(), 0) as page:
    page[:6] = b"mapped"
queue = multiprocessing.Queue()
child = multiprocessing.Process(target=queue.put, args=("from a child",))
child.start()
print(queue.get(), flush=True)
child.join()
if os.fork() == 0:
    os.nice(10)
    while True:
        pass
for _ in range(100):
    time.sleep(0.001)
print("woken", flush=True)
"""


def start(*command: str, **environment: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", RUN, *command],
        cwd=ROOT,
        env=os.environ | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def kernel_of(starter: subprocess.Popen[str]) -> int:
    """Process id of the kernel that `starter` runs: it leads a session of its own."""
    (kernel,) = Path(f"/proc/{starter.pid}/task/{starter.pid}/children").read_text().split()
    return int(kernel)


def session_of(leader: int) -> list[int]:
    """Process ids of what runs in a session: of a kernel, all of it and of its guest's processes."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue  # ended since it was listed
        if int(fields[3]) == leader and fields[0] != "Z":
            found.append(int(stat.parent.name))
    return found


def gone(kernel: int, within_s: float) -> bool:
    """Whether a kernel and everything in it have ended in time."""
    limit_s = time.monotonic() + within_s
    while session_of(kernel):
        if time.monotonic() > limit_s:
            return False
        time.sleep(0.05)
    return True


@pytest.fixture
def sleeping() -> Iterator[subprocess.Popen[str]]:
    """A kernel whose command has said that it runs and then waits for a minute."""
    process = start("sh", "-c", "echo running; sleep 60")
    assert process.stdout is not None
    assert process.stdout.readline() == "running\n"
    yield process
    process.kill()
    process.communicate()


@pytest.mark.uml
def test_output_status_folder_and_environment_are_the_commands_own() -> None:
    """The bus vcan0 is there and up."""
    quoted = 'it\'s "$HOME"\nand more'
    flags = "cat /sys/class/net/vcan0/flags"
    script = f'echo out; echo err >&2; pwd; command -v python; {flags}; printf %s "$WORDS"; exit 255'
    process = start("sh", "-c", script, WORDS=quoted)
    out, err = process.communicate(timeout=60)
    own_python = Path(sys.executable).parent / "python"
    assert (out, err, process.returncode) == (f"out\n{ROOT}\n{own_python}\n0x81\n{quoted}", "err\n", 255)


@pytest.mark.uml
def test_the_status_of_a_killed_command_is_carried_out() -> None:
    process = start("sh", "-c", "kill -9 $$")
    assert process.communicate(timeout=60) == ("", "")
    assert process.returncode == 137


@pytest.mark.uml
def test_the_guests_processes_share_its_cpu_and_the_machines_files(tmp_path: Path) -> None:
    """The thread that delivers frames comes before the nodes; a process that only computes, and so makes no
    system call at which it could be interrupted, keeps nobody from waking up; mapped files reach the machine.
    """
    file = tmp_path / "trace"
    file.write_bytes(bytes(4096))
    process = start(sys.executable, "-c", IN_THE_GUEST, str(file))
    out, err = process.communicate(timeout=60)
    assert (out.splitlines(), err, process.returncode) == (
        [f"{os.SCHED_FIFO} {os.sched_param(NODE_PRIORITY + 10)}", "from a child", "woken"],
        "",
        0,
    )
    assert file.read_bytes()[:6] == b"mapped"


@pytest.mark.uml
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_reaches_the_command_and_ends_the_kernel(
    sleeping: subprocess.Popen[str], number: signal.Signals
) -> None:
    kernel = kernel_of(sleeping)
    sleeping.send_signal(number)
    assert sleeping.wait(timeout=5.0) == 128 + number
    assert gone(kernel, within_s=2.0)


@pytest.mark.uml
def test_the_kernel_keeps_to_one_cpu_and_does_not_outlive_a_killed_starter(
    sleeping: subprocess.Popen[str],
) -> None:
    kernel = kernel_of(sleeping)
    cpus = {frozenset(os.sched_getaffinity(pid)) for pid in session_of(kernel)}
    assert cpus == {frozenset({max(os.sched_getaffinity(0))})}
    assert os.sched_getaffinity(sleeping.pid) == os.sched_getaffinity(0)
    assert os.sched_getscheduler(sleeping.pid) == os.SCHED_OTHER
    folder = Path(f"/proc/{kernel}/environ").read_bytes().partition(b"HOME=")[2].partition(b"\0")[0]
    assert Path(folder.decode()).is_dir()
    sleeping.kill()
    assert gone(kernel, within_s=5.0)
    assert not Path(folder.decode()).exists()


@pytest.mark.uml
def test_a_command_that_ignores_signals_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    process = start("sh", "-c", "trap '' INT TERM; echo running; sleep 60; sleep 60")
    assert process.stdout is not None
    assert process.stdout.readline() == "running\n"
    kernel = kernel_of(process)
    process.send_signal(signal.SIGINT)
    time.sleep(0.2)
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=5.0) == 128 + signal.SIGINT
    assert gone(kernel, within_s=2.0)
    process.communicate()


@pytest.mark.uml
def test_a_panic_is_an_error_with_the_kernels_last_words(capfd: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(uml.UmlDeathError, match=r"(?s)died while the command ran.*sysrq triggered crash"):
        uml.run_in_kernel(["sh", "-c", "echo before; echo c > /proc/sysrq-trigger"])
    assert capfd.readouterr().out == "before\n"


def substitute(folder: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """Put a stand-in for the kernel first on PATH."""
    for name, text in (("linux.uml", script), ("busybox", "exit 0")):
        (folder / name).write_text(f"#!/bin/sh\n{text}\n")
        (folder / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")


def test_a_kernel_that_dies_at_once_is_an_error(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    substitute(tmp_path, monkeypatch, "echo 'ptrace: not permitted'; exit 1")
    with pytest.raises(
        uml.UmlDeathError, match=r"(?s)died before it had booted.*ptrace: not permitted.*SYS_PTRACE"
    ):
        uml.run_in_kernel(["true"])


def test_a_kernel_that_never_boots_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    substitute(tmp_path, monkeypatch, f"echo $$ > {tmp_path}/pid; sleep 60")
    monkeypatch.setattr(uml, "BOOT_LIMIT_S", 0.5)
    with pytest.raises(uml.UmlDeathError, match=r"has not booted within"):
        uml.run_in_kernel(["true"])
    assert gone(int((tmp_path / "pid").read_text()), within_s=2.0)


def test_a_missing_package_names_its_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name, **_: None if name == "linux.uml" else f"/bin/{name}")
    with pytest.raises(uml.UmlError, match=r"linux.uml is not installed.*apt-get install user-mode-linux"):
        uml.run_in_kernel(["true"])


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(uml.UmlError, match="no command"):
        uml.run_in_kernel([])
    with pytest.raises(uml.UmlError, match="no program 'no-such-program'"):
        uml.run_in_kernel(["no-such-program"])
    with pytest.raises(uml.UmlError, match="got 'much', wanted a number"):
        uml.run_in_kernel(["true"], memory="much")
