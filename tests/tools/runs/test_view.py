"""Opening a run: whatever was killed it opens, and nobody else can see it."""

import fcntl
import json
import os
import signal
import socket
import subprocess
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace

import pytest

from hil.record import run_folder
from hil.record.rrd.rerun_program import rerun, rerun_environment
from hil.record.run_traces import RunTraces
from hil.run_files import RunFile
from hil.runs import recorded_run
from hil.runs.recorded_run import RunError
from hil.show import window
from hil.show.rerun_log import RunLog
from tools import cli
from tools.output import BadInputError
from tools.runs import view


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / RunFile.LOG
    with closing(RunLog(path, {"scenario": "empty"}, {"title": "An empty run"})) as writer:
        writer.append(RunTraces())
    return path


def listening(pid: int) -> set[str]:
    """Local addresses, in the kernel's hexadecimal, of the listening sockets of one process."""
    sockets = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        try:
            sockets.add(descriptor.readlink().name)
        except OSError:
            continue
    addresses = set()
    for table in ("tcp", "tcp6"):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            _, local, _, state, *rest = line.split()
            if state == "0A" and f"socket:[{rest[5]}]" in sockets:
                addresses.add(local.split(":")[0])
    return addresses


def test_the_web_viewer_listens_on_loopback_only(log):
    environment = rerun_environment()
    process = subprocess.Popen(
        window.viewer_command(log, web=True),
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        addresses: set[str] = set()
        deadline = time.monotonic() + 20.0
        while len(addresses) == 0 and time.monotonic() < deadline:
            time.sleep(0.2)
            addresses = listening(process.pid)
        time.sleep(0.5)
        assert listening(process.pid) == {"0100007F"}
    finally:
        os.kill(process.pid, signal.SIGTERM)
        process.wait(10.0)


def test_usage_data_is_switched_off():
    settings = Path(rerun_environment()["XDG_CONFIG_HOME"]) / "rerun" / "analytics.json"
    assert '"analytics_enabled":false' in settings.read_text().replace(" ", "")


def test_a_cut_log_is_mended_before_it_is_opened(log):
    log.write_bytes(log.read_bytes()[:-200])
    assert recorded_run.log_of(log) == log
    assert rerun(["rrd", "verify", log]).returncode == 0


def test_a_run_that_goes_on_is_not_touched(log):
    (log.parent / "plant.trace").touch()
    log.write_bytes(log.read_bytes()[:-200])
    before = log.read_bytes()
    held = os.open(log.parent, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    opened = recorded_run.log_of(log.parent)
    os.close(held)
    assert opened != log
    assert log.read_bytes() == before
    assert rerun(["rrd", "verify", opened]).returncode == 0


def test_a_run_whose_log_has_only_begun_is_not_touched(log):
    (log.parent / "plant.trace").touch()
    log.write_bytes(log.read_bytes()[:12])
    held = os.open(log.parent, os.O_RDONLY)
    fcntl.flock(held, fcntl.LOCK_EX)
    with pytest.raises(RunError, match="has only begun"):
        recorded_run.log_of(log.parent)
    os.close(held)
    assert log.stat().st_size == 12


def test_a_folder_of_runs_names_them(tmp_path):
    run = tmp_path / "suite" / "one"
    run.mkdir(parents=True)
    (run / "run.json").touch()
    with pytest.raises(RunError, match=r"name one of the runs in it, e\.g\. ") as refused:
        recorded_run.log_of(run.parent)
    assert str(run) in str(refused.value)


def test_the_newest_run_is_the_one_without_a_name(log, tmp_path, monkeypatch):
    monkeypatch.setattr(recorded_run, "RUNS", tmp_path / "runs")
    with pytest.raises(RunError, match="no run in"):
        recorded_run.log_of(None)
    for age_s, name in ((100, "older"), (0, "newer")):
        run_dir = tmp_path / "runs" / name
        run_dir.mkdir(parents=True)
        (run_dir / "run.json").write_text("{}")
        (run_dir / "outcome.json").write_text("{}")
        (run_dir / RunFile.LOG).write_bytes(log.read_bytes())
        os.utime(run_dir / "run.json", (time.time() - age_s,) * 2)
    assert recorded_run.log_of(None) == tmp_path / "runs" / "newer" / RunFile.LOG
    note = tmp_path / "runs" / "older" / RunFile.NOTE
    note.write_text(json.dumps({"begun_s": time.time() - 50}))  # written again since, as by `touch`
    assert recorded_run.log_of(None) == tmp_path / "runs" / "newer" / RunFile.LOG


@pytest.mark.parametrize("name", ["nothing.rrd", "nothing"])
def test_a_run_that_does_not_exist_is_refused(tmp_path, name):
    with pytest.raises(RunError, match=f"{name} is not there; name a run folder or an .rrd file"):
        recorded_run.log_of(tmp_path / name)


def test_a_run_that_was_killed_before_its_log_began_is_a_run_all_the_same(tmp_path):
    run_folder.note(tmp_path, scenario="mine")
    with pytest.raises(RunError, match=r"has no log: its run has not begun, or was ended before"):
        recorded_run.log_of(tmp_path)


def test_a_seed_that_passed_says_how_to_repeat_it(tmp_path):
    """Its faults came later than in the scenario of its name."""
    run_folder.note(tmp_path, scenario="mine", clock="lockstep", seed=7)
    run_folder.write_json(tmp_path / "verdict.json", {"passed": True})
    again = rf"vibrohil run {tmp_path}/scenario\.toml --seed 7 --clock lockstep"
    with pytest.raises(RunError, match=f"passed as one of several seeds.*{again}"):
        recorded_run.log_of(tmp_path)


def test_without_a_display_the_browser_is_recommended(log, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with pytest.raises(BadInputError, match="--web"):
        view.view(log, web=False, live=False)


def test_a_live_run_needs_a_viewer_or_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        monkeypatch.setattr(view, "LIVE_PORT", taken.getsockname()[1])
        with pytest.raises(BadInputError, match="view --live --web"):
            view.live_viewer(may_open=True)
        taken.listen()
        assert view.live_viewer(may_open=True) == view.LIVE_URL
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        with pytest.raises(BadInputError, match="belongs to another user; nothing is sent"):
            view.live_viewer(may_open=True)


def test_a_window_opens_in_a_network_of_its_own(log, monkeypatch):
    """Its port takes commands that delete files, from every user who reaches it."""
    monkeypatch.setenv("DISPLAY", ":7")
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        monkeypatch.setattr(view, "LIVE_PORT", unused.getsockname()[1])
        assert view.live_viewer(may_open=True) == "window"
        with pytest.raises(BadInputError, match="view --live --web"):
            view.live_viewer(may_open=False)
    started = []
    ended = SimpleNamespace(returncode=4, stderr="error: shared\n")
    monkeypatch.setattr(view.subprocess, "run", lambda command, **_: started.append(command) or ended)
    with pytest.raises(BadInputError, match="shared"):
        view.view(log, web=False, live=False)
    assert started[0][1:4] == ["-P", "-m", "hil.processes.own_network"]


def test_a_viewer_for_live_runs_takes_no_other():
    with pytest.raises(BadInputError, match="--live"):
        view.view(Path("run"), web=True, live=True)
    with pytest.raises(BadInputError, match="--live waits in a browser; add --web"):
        view.view(None, web=False, live=True)


def test_a_viewer_is_bound_to_loopback():
    for web in (False, True):
        command = window.viewer_command(web=web, port=view.LIVE_PORT)
        assert command[command.index("--bind") + 1] == "127.0.0.1"


@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 0), (signal.SIGTERM, 2)])
def test_ctrl_c_is_the_way_to_end_a_viewer_in_a_browser(monkeypatch, tmp_path, number, status):
    def shown(*_):
        os.kill(os.getpid(), number)
        time.sleep(5.0)

    monkeypatch.setattr(view, "open_in_browser", shown)
    monkeypatch.setattr(view, "log_of", lambda _: tmp_path / "run.rrd")
    assert cli.run(["view", str(tmp_path), "--web"]) == status
