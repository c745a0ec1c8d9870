"""Adapters without descriptor, with device time, for one program, with own messages, late, or with errors."""

import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import can
import pytest
from host import PATIENT
from made_adapters import INTERFACES, REFUSING, installed
from resting import resting
from waiting import frames_within, waited_for

from firmware_py.interface import codec
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, DriveEstop, SetInputTorque
from hil.bus import Bus, BusFailedError, ProvidedBus, join, open_bus, provide, shared
from hil.processes.child import READY_TIMEOUT_S
from hil.record.run_traces import read_bus
from hil.show.recorder import Recorder
from hil.timing.realtime import BRIDGE_PRIORITY, fixed_priority
from tools import cli
from tools.output import EXIT_BAD_INPUT

TIMEOUT_S = 5.0
KINDS = [name for name in INTERFACES if name not in ("made-unplugged", "made-cut", "made-not-yet", *REFUSING)]


@pytest.fixture
def wire(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ProvidedBus]:
    """The hub that the made adapters are connected to."""
    (tmp_path / "adapters").mkdir()
    installed(tmp_path / "adapters", monkeypatch)
    with provide("local") as provided:
        yield provided


def address(kind: str, wire: ProvidedBus) -> str:
    return f"{kind}:{wire.address.removeprefix('local:')}"


@contextmanager
def on(kind: str, wire: ProvidedBus) -> Iterator[Bus]:
    """A node on an adapter."""
    with open_bus(address(kind, wire)) as (_, node):
        yield node


@pytest.mark.parametrize("kind", KINDS)
def test_a_node_receives_every_frame_and_none_of_its_own(kind: str, wire: ProvidedBus) -> None:
    frames = [Frame(number, bytes([number])) for number in range(50)]
    with closing(join(wire.address)) as sender, on(kind, wire) as node:
        for frame in frames:
            sender.send(frame)
            node.send(Frame(0x700, b""))
            time.sleep(0.002)
        assert frames_within(node, 50, TIMEOUT_S) == frames
        assert len(frames_within(sender, 50, TIMEOUT_S)) == 50


def test_an_adapter_that_fails_is_named(wire: ProvidedBus, capfd: pytest.CaptureFixture[str]) -> None:
    """By the process that opens it, and to the node, whose last frame still leaves."""
    with closing(join(wire.address)) as sender, on("made-unplugged", wire) as node:
        sender.send_all([Frame(number, b"") for number in range(20)])
        with pytest.raises(BusFailedError, match=r"the adapter has failed: .*: the device is gone; check"):
            frames_within(node, 20, TIMEOUT_S)
        node.send_all([Frame(0x700, b"last")])
        assert frames_within(sender, 1, TIMEOUT_S) == [Frame(0x700, b"last")]
    assert "the device is gone" in capfd.readouterr().err


def test_a_passing_receive_error_is_counted(wire: ProvidedBus) -> None:
    with closing(join(wire.address)) as sender, on("made-glitch", wire) as node:
        assert waited_for(lambda: node.receive() == [] and node.counters.receive_errors, TIMEOUT_S) == 1
        sender.send(Frame(1, b""))
        assert frames_within(node, 1, TIMEOUT_S) == [Frame(1, b"")]


def test_a_killed_bridge_is_a_failed_adapter(wire: ProvidedBus) -> None:
    with open_bus(address("made-late", wire)) as (provided, node):
        assert provided.bridge is not None
        os.kill(provided.bridge.pid, signal.SIGKILL)
        assert provided.bridge.wait(READY_TIMEOUT_S)
        with pytest.raises(BusFailedError, match="bridge was killed by SIGKILL"):
            node.receive()


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("command", "kind", "last"),
    [
        ("firmware soft-start-multistable", "made-unplugged", codec.encode(SetInputTorque(0.0))),
        ("operator soft-start-multistable", "made-unplugged", codec.encode(DriveEstop())),
        ("plant soft-start-multistable", "made-unplugged", None),
        ("plant soft-start-multistable", "made-cut", None),
        ("measure state.estimator.x_m", "made-unplugged", None),
        ("calibrate speed.gain_p_n_m_s=0.06", "made-unplugged", None),
    ],
)
def test_a_program_whose_adapter_fails_ends_at_once_after_its_last_frame(
    command: str, kind: str, last: Frame | None, wire: ProvidedBus
) -> None:
    with closing(join(wire.address)) as other:
        program = vibrohil(*command.split(), "--bus", address(kind, wire))
        if kind == "made-unplugged":
            received_from(other, program)
            other.send_all([Frame(0x7F0, b"")] * 10)
        _, errors = program.communicate(timeout=READY_TIMEOUT_S)
        assert program.returncode == EXIT_BAD_INPUT
        assert "error: the adapter has failed: " in errors
        assert "Traceback" not in errors
        assert last is None or last in frames_within(other, 10**6, 0.5)


def test_an_adapter_that_fails_to_send_is_named(wire: ProvidedBus, capfd: pytest.CaptureFixture[str]) -> None:
    """Not the hub, from which the message came."""
    with shared(provide(address("made-cut", wire))) as provided, closing(join(provided.address)) as node:
        node.send(Frame(1, b""))
        assert provided.bridge is not None
        bridge = provided.bridge
        assert waited_for(lambda: bridge.failure)
        assert bridge.ended
    assert not bridge.succeeded
    assert f"{wire.address}: the device does not answer" in capfd.readouterr().err


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no /proc")
def test_the_bridge_precedes_ordinary_processes_where_it_may(wire: ProvidedBus) -> None:
    """At ordinary priority, four runs at once held up a bridge's frames by 50 s."""
    with fixed_priority(BRIDGE_PRIORITY):
        permitted = os.sched_getscheduler(0)
    with shared(provide(address("made-late", wire))) as provided:
        assert provided.bridge is not None
        tasks = Path(f"/proc/{provided.bridge.pid}/task")

        def policies() -> list[int]:
            return [os.sched_getscheduler(int(thread.name)) for thread in tasks.iterdir()]

        started = len(("main", "to the adapter", "from the adapter"))
        assert waited_for(lambda: policies().count(permitted) >= started, TIMEOUT_S), policies()


@pytest.mark.parametrize("kind", ["made-late", "made-device-time"])
def test_the_recorder_loses_no_frame(kind: str, wire: ProvidedBus, tmp_path: Path) -> None:
    """Up to the last frame, which a late adapter delivers only after the recorder was asked to end."""
    run_dir = tmp_path / "run"
    run_dir.mkdir()
    (run_dir / "run.json").write_text(
        json.dumps({"wall_start_s": time.time(), "period_s": 1e-3, "scenario": "x", "clock": "real"})
    )
    (run_dir / "scenario.toml").write_text("checks = []\n")
    torque = codec.encode(SetInputTorque(0.25))
    with (
        shared(provide(address(kind, wire))) as provided,
        closing(join(provided.address, stamped=True)) as bus,
        closing(join(wire.address, accept=())) as sender,
    ):
        recorder = Recorder(run_dir, bus)
        for _ in range(100):
            sender.send(torque)
            time.sleep(0.001)
            recorder.drain()
        recorder.close()
    assert len(read_bus(run_dir / "can.log").whole().t_s) == 100


def vibrohil(*arguments: str, **options) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "tools.cli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.realtime
@pytest.mark.quiet
def test_a_run_works_on_an_adapter(wire: ProvidedBus, tmp_path: Path) -> None:
    """Its nodes receive each other's frames, the recorder loses nothing, and the wire carries all frames.

    The run does not know the adapter: its nodes meet at a hub, which the tests above join to every kind.
    """
    kind, listener = "made-late", join(wire.address, stamped=True)
    on_wire: Counter[int] = Counter()
    out = tmp_path / "run"
    program = vibrohil(
        *("run", str(resting(tmp_path, duration_s=1.0)), "--clock", "real", "--bus", address(kind, wire)),
        *("--out", str(out), "--json"),
        *(word for setting in PATIENT for word in ("--set", setting)),
    )
    while program.poll() is None:
        time.sleep(0.05)
        on_wire.update(frame.can_id for _, frame in listener.receive_stamped())
    printed, errors = program.communicate()
    assert "Traceback" not in errors
    verdict = json.loads(printed)
    assert verdict["reasons"] == [], errors
    assert verdict["bus"] == address(kind, wire)
    assert verdict["final_mode"] != "fault"
    recorded = Counter(read_bus(out / "can.log").whole().can_id.tolist())
    samples = codec.CODECS[Accelerometer].can_id
    sent = verdict["loops"]["plant"]["ticks"]  # in strict time the periods that the host took are left out
    assert recorded[samples] == sent > 0
    assert {codec.CODECS[SetInputTorque].can_id, samples} <= set(recorded)
    assert set(recorded) <= set(on_wire)
    assert on_wire[samples] >= recorded[samples]
    listener.close()


def received_from(listener, program: subprocess.Popen[str]) -> list[Frame]:
    """The first frames of a program; empty if it ends without any."""
    while program.poll() is None:
        listener.wait(0.5)
        if frames := listener.receive():
            return frames
    return listener.receive()


@pytest.mark.realtime
def test_the_loss_of_the_adapter_ends_a_run_with_its_reason(wire: ProvidedBus, tmp_path: Path) -> None:
    sender = join(wire.address)
    program = vibrohil(
        *("run", str(resting(tmp_path, duration_s=60.0)), "--clock", "real"),
        *("--bus", address("made-unplugged", wire), "--out", str(tmp_path / "run"), "--json"),
    )
    received_from(sender, program)
    sender.send_all([Frame(0x7F0, b"")] * 10)
    printed, errors = program.communicate()
    assert "the device is gone" in errors
    assert any(
        reason.startswith("the adapter has failed (") and "the device is gone) at " in reason
        for reason in json.loads(printed)["reasons"]
    )
    sender.close()


def test_an_adapter_that_does_not_open_is_refused_by_a_run(
    wire: ProvidedBus, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bus = address("made-one-program", wire)
    command = ["run", str(resting(tmp_path)), "--clock", "real", "--bus", bus, "--out", str(tmp_path / "run")]
    with on("made-one-program", wire):
        assert cli.run(command) == EXIT_BAD_INPUT
    assert "in use by another program" in " ".join(capsys.readouterr().err.split())


def test_after_shutdown_each_call_is_a_can_error(wire: ProvidedBus) -> None:
    bus = can.Bus(wire.address, "vibrohil")
    bus.shutdown()
    bus.shutdown()
    for call in (lambda: bus.recv(0), bus.recv, lambda: bus.send(can.Message()), bus.fileno):
        with pytest.raises(can.CanOperationError, match="shut down"):
            call()
