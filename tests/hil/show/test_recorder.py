"""The recorder beside a run that goes on: on time, complete at its end, and short of a second when killed."""

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import closing
from pathlib import Path

import pytest
from log_hashes import column_hashes, differing_entities
from run_folder import T_S, make_run, write_run, write_trace
from waiting import waited_for

from firmware_py.interface import codec
from firmware_py.interface.addresses import Addresses, bus_id
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import SetInputTorque
from hil.bus import join, provide
from hil.bus.addressed import addressed
from hil.processes.child import Child, Start
from hil.record.log_reader import read_traces
from hil.record.rrd.log_file import repair
from hil.record.rrd.rerun_program import RerunError
from hil.record.run_traces import read_bus, read_run
from hil.record.traces.trace import TraceWriter
from hil.show.recorder import Recorder
from hil.show.rerun_log import rebuild

SPEED_UP = 4
"""The made-up run of 7 s is played to the recorder in less."""


@pytest.fixture
def run_dir(tmp_path):
    """A run folder as it is when the start is given: no traces yet."""
    made_up = make_run()
    made_up.run["wall_start_s"] = time.time()
    made_up.scenario["checks"] = []
    write_run(made_up, tmp_path)
    for path in (*tmp_path.glob("*.trace"), tmp_path / "can.log", tmp_path / "outcome.json"):
        path.unlink()
    return tmp_path


def ready(run_dir, *options) -> Child:
    command = [sys.executable, "-m", "hil.show.recorder", str(run_dir), *options]
    child = Child("recorder", command, run_dir / "recorder.log")
    child.wait_ready()
    return child


def start(run_dir, *options) -> Child:
    child = ready(run_dir, *options)
    child.start(Start(0))
    return child


def test_it_is_made_ready_at_the_priority_of_the_nodes_that_wait_for_it(run_dir):
    """On a busy machine a start at its later priority took 60 s, while all others had been ready for 50."""
    recorder = ready(run_dir)
    assert os.getpriority(os.PRIO_PROCESS, recorder.pid) == os.getpriority(os.PRIO_PROCESS, 0)
    recorder.start(Start(0))
    recorder.stop()


def play(run_dir, until_s: float, once_begun=lambda: None) -> None:
    """Write the made-up plant's trace as its process would, `SPEED_UP` times too fast.

    `once_begun` is called after the first row; the rest is timed from its end on.
    """
    columns = make_run().plant
    kinds = {"f": float, "i": int, "b": bool}
    fields = [(name, kinds[values.dtype.kind]) for name, values in columns.items()]
    rows = list(zip(*(values.tolist() for values in columns.values()), strict=True))
    writer = TraceWriter(run_dir / "plant.trace", fields)
    writer.append(*rows[0])
    once_begun()
    started = time.monotonic()
    for number, row in enumerate(rows[1 : round(until_s / T_S)], start=1):
        writer.append(*row)
        ahead_s = number * T_S / SPEED_UP - (time.monotonic() - started)
        if ahead_s > 0.01:
            time.sleep(ahead_s)
    writer.close()


def test_at_its_end_all_is_written_and_the_same_as_rebuilt(run_dir):
    with provide("local") as provided:
        recorder = start(run_dir, "--bus", provided.address)
        sender = join(provided.address, accept=())
        frame = codec.encode(SetInputTorque(0.25))
        play(run_dir, 2.0)
        for name in ("firmware", "impacts", "operator"):
            write_trace(run_dir / f"{name}.trace", getattr(make_run(), name))
        for _ in range(50):
            sender.send(frame)
            time.sleep(0.002)
        time.sleep(0.1)
        said = json.loads(recorder.stop(at_work_s=60.0))
        sender.close()
    assert recorder.succeeded, recorder.last_errors()

    assert not repair(run_dir / "run.rrd"), "an ordered end leaves a whole file"
    bus = read_bus(run_dir / "can.log")
    assert said == {"frames": 50, "lost": 0}
    assert bus.payloads == (frame.data,) * 50
    assert 0.0 < bus.t_s[0] < bus.t_s[-1] < 30.0
    live = column_hashes(run_dir / "run.rrd")
    whole = column_hashes(rebuild(run_dir))
    differing = differing_entities(live, whole)
    assert differing <= {"/stop", "/nis_expected", "/estimate_error"}, (
        "the lines come in pieces, the error at the end"
    )


def test_asked_to_end_it_does_not_wait_for_frames_that_come_later(run_dir):
    frame = codec.encode(SetInputTorque(0.25))
    with provide("local") as provided:
        recorder = start(run_dir, "--bus", provided.address)
        sender = join(provided.address, accept=())
        recorder.signal(signal.SIGTERM)
        deadline_s = time.monotonic() + 20.0
        while not recorder.ended and time.monotonic() < deadline_s:
            sender.send(frame)
            time.sleep(0.001)
        ended = recorder.ended
        recorder.stop()
        sender.close()
    assert ended, "others send for as long as they like"


def test_a_late_frame_behind_frames_of_others_is_recorded(run_dir):
    """Of another module on the bus, and of 29 bits: an adapter may deliver them before this module's last."""
    places = Addresses(drive_node=1, own_node=5)
    own = codec.encode(SetInputTorque(0.25))
    with provide("local") as provided, closing(join(provided.address, accept=())) as sender:
        recorder = Recorder(run_dir, addressed(join(provided.address, stamped=True), places))
        sender.send_all([own, Frame(0x80000001, b"")])
        late = threading.Timer(0.02, sender.send, [Frame(bus_id(places, own.can_id), own.data)])
        late.start()
        recorder.close()
        late.join()
        recorder.bus.close()
    assert read_bus(run_dir / "can.log").payloads == (own.data,)


def test_frames_are_read_on_while_the_wall_clock_has_fallen_back(run_dir):
    """The host's time steps by a minute: until then all frames would stay in the bus, and most be lost."""
    frame = codec.encode(SetInputTorque(0.25))
    with provide("local") as provided, closing(join(provided.address, accept=())) as sender:
        recorder = Recorder(run_dir, join(provided.address, stamped=True))
        recorder.bus.newest_ns = time.time_ns() + 60_000_000_000
        sender.send(frame)
        recorder.bus.wait(2.0)
        recorder.drain()
        recorder.append()
        recorder.close()
        recorder.bus.close()
    assert recorder.frames == 1


def test_it_ends_when_the_bus_has_ended(run_dir):
    with provide("local") as provided:
        recorder = start(run_dir, "--bus", provided.address)
        provided.holder.signal(signal.SIGKILL)
        assert provided.holder.wait(5.0)
        assert json.loads(recorder.stop(at_work_s=60.0)) == {"frames": 0, "lost": 0}
    assert not recorder.killed_at_stop


BURSTS = 1500
"""Of 100 frames each: more than the hub keeps for a recorder."""


def test_frames_it_lost_while_it_was_held_up_are_counted(run_dir):
    with provide("local") as provided:
        recorder = start(run_dir, "--bus", provided.address)
        sender = join(provided.address, accept=())
        frame = codec.encode(SetInputTorque(0.25))
        sender.send(frame)
        time.sleep(0.2)
        os.kill(recorder.pid, signal.SIGSTOP)
        for _ in range(BURSTS):
            sender.send_all([frame] * 100)
            time.sleep(0.001)
        os.kill(recorder.pid, signal.SIGCONT)
        said = json.loads(recorder.stop(at_work_s=60.0))
        sender.close()
    assert recorder.succeeded, recorder.last_errors()
    assert said["frames"] == len(read_run(run_dir).bus.whole().t_s) < 100 * BURSTS + 1
    assert said["lost"] == 100 * BURSTS + 1 - said["frames"]


def has_plant(run_dir) -> bool:
    """Whether the log of a run that goes on has a record of the plant yet."""
    if not (run_dir / "run.rrd").exists():
        return False
    so_far = Path(shutil.copy(run_dir / "run.rrd", run_dir / "so-far.rrd"))
    try:
        repair(so_far)
    except RerunError:  # not even its beginning is written
        return False
    return bool(len(read_traces(so_far).plant))


@pytest.mark.realtime
@pytest.mark.quiet
def test_killed_it_loses_a_second_at_most_and_the_traces_lose_nothing(run_dir):
    recorder = start(run_dir)
    play(run_dir, 7.0, once_begun=lambda: waited_for(lambda: has_plant(run_dir)))
    os.kill(recorder.pid, signal.SIGKILL)
    recorder.wait(5.0)
    recorder.stop()

    repair(run_dir / "run.rrd")
    # Played four times too fast, a second of the clock is four of the run.
    assert read_traces(run_dir / "run.rrd").plant["t_s"][-1] >= 7.0 - 1.2 * SPEED_UP
    assert read_traces(rebuild(run_dir)).plant["t_s"][-1] == pytest.approx(7.0 - T_S)


def test_it_ends_in_order_when_its_parent_is_gone(run_dir):
    command = [sys.executable, "-m", "hil.show.recorder", str(run_dir)]
    recorder = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert recorder.stdout.readline() == b"ready\n"
    recorder.stdin.write(b"0\n")
    recorder.stdin.flush()
    write_trace(run_dir / "plant.trace", make_run().plant)
    time.sleep(0.3)
    recorder.stdin.close()
    assert recorder.wait(10.0) == 0
    recorder.stdout.close()
    assert not repair(run_dir / "run.rrd")
    assert len(read_traces(run_dir / "run.rrd").plant) == len(make_run().plant["t_s"])
