"""The live view: an open viewer gets all that is recorded, and its end is nobody's loss."""

import itertools
import os
import signal
import socket
import subprocess
import sys
import time
from types import SimpleNamespace

import pytest
from log_hashes import column_hashes, differing_entities
from run_folder import make_run, write_run

from hil.processes.child import Child, Start
from hil.record.rrd.log_file import repair
from hil.record.rrd.rerun_program import rerun_environment, rerun_program
from hil.runs.job import Outcome, RunOptions, silent
from hil.runs.realtime import ProcessesRun
from hil.show.follower import Follower
from hil.show.live import follow
from hil.show.rerun_log import rebuild
from tools import cli
from tools.output import EXIT_BAD_INPUT


@pytest.fixture
def run_dir(tmp_path):
    return write_run(make_run(), tmp_path / "run")


@pytest.fixture
def open_viewer():
    """Starts what takes the place of a viewer: it keeps what it is sent in `received.rrd` in a folder."""
    processes = []

    def open_viewer(folder):
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        received = folder / "received.rrd"
        process = subprocess.Popen(
            [rerun_program(), "--bind", "127.0.0.1", "--port", str(port), "--save", received],
            env={**rerun_environment(), "RUST_LOG": "off"},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        processes.append(process)
        deadline = time.monotonic() + 20.0
        while time.monotonic() < deadline:
            with socket.socket() as caller:
                if caller.connect_ex(("127.0.0.1", port)) == 0:
                    break
            time.sleep(0.05)
        return SimpleNamespace(process=process, url=f"rerun+http://127.0.0.1:{port}/proxy", received=received)

    yield open_viewer
    for process in processes:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        process.wait(10.0)


@pytest.fixture
def viewer(open_viewer, tmp_path):
    return open_viewer(tmp_path)


def end(viewer):
    """The viewer's end, once it has written what it got; its file lacks a footer."""
    size = -1
    while size != (size := viewer.received.stat().st_size):
        time.sleep(0.2)
    viewer.process.send_signal(signal.SIGINT)
    viewer.process.wait(10.0)
    repair(viewer.received)


def start(run_dir, viewer) -> Child:
    command = [sys.executable, "-m", "hil.show.live", str(run_dir), "--to", viewer.url]
    child = Child("live", command, run_dir / "live.log")
    child.wait_ready()
    child.start(Start(0))
    return child


def test_a_run_that_goes_on_is_shown_whole(run_dir, viewer):
    live = start(run_dir, viewer)
    time.sleep(1.0)
    live.signal(signal.SIGTERM)
    assert live.wait(30.0), "it is the last to get a busy machine's time"
    assert live.succeeded, live.last_errors()
    live.stop()
    end(viewer)
    shown, whole = column_hashes(viewer.received), column_hashes(rebuild(run_dir))
    differing = differing_entities(shown, whole)
    at_the_end = {"/events", "/estimate_error"}
    assert differing <= {"/stop", "/nis_expected", *at_the_end}, (
        "the lines come in pieces, the verdict at the end"
    )
    assert "/firmware:trace:record.outputs.mode" in shown


def shown(viewer):
    """Whether the viewer has got something."""
    return viewer.received.exists() and viewer.received.stat().st_size > 0


def test_a_viewer_that_is_gone_ends_only_the_view(open_viewer, tmp_path):
    """Killed or stopped, before the view connects or while it shows; all at once, as each is waited for."""
    views = []
    for number, before in itertools.product((signal.SIGKILL, signal.SIGSTOP), (True, False)):
        folder = write_run(make_run(), tmp_path / f"{number.name}-{before}")
        viewer = open_viewer(folder)
        if before:
            viewer.process.send_signal(number)
        live = start(folder, viewer)
        while not before and not shown(viewer):
            time.sleep(0.01)
        viewer.process.send_signal(number)
        views.append((folder / "can.log", viewer, live))
    line = views[0][0].read_text().splitlines(keepends=True)[-1]
    for _ in range(60):
        for can_log, _, _ in views:
            with can_log.open("a") as file:
                file.write(line)
        if all(live.wait(0.25) for _, _, live in views):
            break
    for _, viewer, live in views:
        live.stop()
        viewer.process.send_signal(signal.SIGCONT)
        assert live.how_it_ended() == "live ended with status 1", "of its own accord"
        assert "the live view ended" in live.last_errors()


def test_nothing_is_sent_to_a_listener_of_another_user(tmp_path, monkeypatch):
    """The viewer that was found before the run may have ended, and its port be another user's."""
    folder = write_run(make_run(), tmp_path / "run")
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen()
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        with pytest.raises(RuntimeError, match=r"another user listens at .*; nothing is sent"):
            follow(folder, f"rerun+http://127.0.0.1:{listener.getsockname()[1]}/proxy", [])
        listener.setblocking(False)
        with pytest.raises(BlockingIOError):
            listener.accept()


def test_a_run_in_lockstep_has_no_live_view(capsys):
    command = ["run", "soft-start-multistable", "--clock", "lockstep", "--live"]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert "after one in lockstep: `vibrohil view`" in capsys.readouterr().err


def test_a_run_does_not_end_with_its_live_view(run_dir):
    provided = SimpleNamespace(processes={"hub": object()}, address="local:x", name="local")
    url = "rerun+http://x/proxy"
    run = ProcessesRun(None, RunOptions(viewer=url), run_dir, 1, Outcome(), silent)
    run.provided = provided
    run.children = dict.fromkeys(("plant", "live"), object())
    assert set(run.watched) == {"plant", "hub"}


def test_a_line_that_is_being_written_waits_for_its_end(tmp_path):
    follower = Follower(tmp_path)
    assert follower.new_frames().payloads == ()
    (tmp_path / "can.log").write_bytes(b"(0.001000) can0 080#0102\n(0.002000) can0 0")
    assert follower.new_frames().payloads == (b"\x01\x02",)
    with (tmp_path / "can.log").open("ab") as file:
        file.write(b"81#03\n")
    frames = follower.new_frames()
    assert (frames.can_id.tolist(), frames.payloads) == ([0x81], (b"\x03",))
