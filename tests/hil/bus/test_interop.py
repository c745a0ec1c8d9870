"""Other people's tools on the running bus: python-can's logger and player, cantools; nodes that meet."""

import os
import pty
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import can
import pytest
from host import LONGEST_STALL_S, PATIENT, stalled, stop
from waiting import message_data, waited_for

from firmware_py.interface import codec
from firmware_py.interface.enums import Fault, Mode
from firmware_py.interface.generated.records import Accelerometer
from hil.bus import provide
from hil.record.traces import trace
from hil.runs.bench import run_scenario
from hil.runs.job import Job, RunOptions
from hil.runs.realtime import program
from hil.runs.recording import in_lockstep
from hil.scenario.scenario import Scenario, load_scenario

SHORT = [
    "script.duration_s=3.0",
    'script.commands=[{at_s=0.2,request="run",target_ratio=1.1}]',
    "firmware.start.rise_s=1.0",
]
CREEPING = [*PATIENT, "firmware.start.approach_s=10.0", "firmware.start.rise_s=12.0"]
"""A crank so slow that positions which the host holds back, and delivers at once, are no overspeed."""
SILENCE = 'script.faults=[{kind="dropped",at_s=2.2,frames=["Accelerometer"]}]'
RUN_AT_S = LONGEST_STALL_S + 0.5
"""A firmware that is not READY by then does not start, and a host stall may have hidden all frames before."""
START_AT_S = RUN_AT_S + LONGEST_STALL_S
"""RUN counts once it has been repeated for as long as the firmware's watchdog of the operator."""
RUN = f'{{at_s={RUN_AT_S},request="run",target_ratio=1.1}}'
END_AT_S = START_AT_S + 1.0
"""In motion, frames that come in bundles stop the motor: the less of it, the busier the host may be."""
E_STOP = [
    f'script.commands=[{RUN},{{at_s={END_AT_S},request="e-stop"}}]',
    f"script.duration_s={END_AT_S + 0.5}",
]
LEFT_IN_THE_START = [f"script.commands=[{RUN}]", f"script.duration_s={END_AT_S}"]
DBC_PATH = Path(codec.__file__).with_name("vibro.dbc")
SUFFIXES = ("log", "asc", "blf")
PATIENCE_S = 60.0
STALL_S = 0.1
"""A host stall, several times as long as the firmware's ordinary watchdogs of the sensors."""
LONG_STALL_S = 0.5
"""A host stall at rest: it hides more frames from the firmware than its inbox holds."""


def scenario(*more: str) -> Scenario:
    return load_scenario("soft-start-multistable", [*SHORT, *more])


class Decision(NamedTuple):
    """What the firmware made of what it had received."""

    mode: str
    fault: str


STARTING = Decision("SOFT_START", "NONE")


def decisions(firmware_trace: Path) -> list[Decision]:
    """The modes with their faults in turn."""
    records = trace.read(firmware_trace)
    found: list[Decision] = []
    for mode, fault in zip(records["outputs.mode"], records["outputs.fault"], strict=True):
        decision = Decision(Mode(int(mode)).name, Fault(int(fault)).name)
        if not found or found[-1] != decision:
            found.append(decision)
    return found


def frames_of(path: Path) -> list[tuple[int, bytes]]:
    with can.LogReader(path) as messages:
        return [(message.arbitration_id, bytes(message.data)) for message in messages]


@contextmanager
def running(command: Sequence[str], **how: Any) -> Iterator[subprocess.Popen[bytes]]:
    """A process that is asked to end as by Ctrl-C."""
    with subprocess.Popen(command, **how) as process:
        try:
            yield process
            process.send_signal(signal.SIGINT)
            process.wait(PATIENCE_S)
        finally:
            process.kill()


def tool(name: str, channel: str, *more: str) -> list[str]:
    return [sys.executable, "-m", name, "-i", "vibrohil", "-c", channel, *more]


class Live(NamedTuple):
    """A run in real time that others have listened to."""

    folder: Path
    shown: str
    """What `cantools monitor` drew."""


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Live:
    folder = tmp_path_factory.mktemp("live")
    with ExitStack() as stack:
        address = stack.enter_context(provide("local")).address
        channel = address.removeprefix("local:")
        for suffix in SUFFIXES:
            logger = tool("can.logger", channel, "-f", str(folder / f"live.{suffix}"))
            stack.enter_context(running(logger, stdout=subprocess.DEVNULL))
        screen, terminal = pty.openpty()
        stack.callback(os.close, screen)
        monitor = tool("cantools", channel, str(DBC_PATH))
        monitor.insert(3, "monitor")
        environment = os.environ | {"TERM": "xterm", "LINES": "150", "COLUMNS": "160"}
        process = stack.enter_context(
            running(monitor, stdin=terminal, stdout=terminal, stderr=terminal, env=environment)
        )
        os.close(terminal)
        os.set_blocking(screen, False)
        # A logger makes its file, and the monitor shows frames, once it is on the bus.
        logs = [folder / f"live.{suffix}" for suffix in SUFFIXES]
        deadline_s = time.monotonic() + PATIENCE_S
        while not (all(log.exists() for log in logs) and select.select([screen], [], [], 0.0)[0]):
            assert process.poll() is None
            assert time.monotonic() < deadline_s, f"of {logs} and the monitor not all began"
            time.sleep(0.05)
        screen_bytes = bytearray()

        def look(_: float, __: str) -> None:
            try:
                screen_bytes.extend(os.read(screen, 1 << 20))
            except BlockingIOError:
                """Nothing new is shown."""

        run_scenario(scenario(SILENCE), RunOptions(bus=address), folder / "run", 1, look)
        look(1.0, "")
        process.kill()
    return Live(folder, screen_bytes.decode(errors="replace"))


@pytest.mark.realtime
def test_a_live_run_is_logged_whole_in_every_format(live: Live) -> None:
    sent = frames_of(live.folder / "run" / "can.log")
    assert len(sent) > 5000
    for suffix in SUFFIXES:
        assert frames_of(live.folder / f"live.{suffix}") == sent, suffix


def test_cantools_decodes_every_frame(tmp_path: Path) -> None:
    log = in_lockstep(Job(scenario(SILENCE), 1, folder=tmp_path / "run")) / "can.log"
    command = [sys.executable, "-m", "cantools", "decode", "--single-line", str(DBC_PATH)]
    with log.open("rb") as lines:
        decoded = subprocess.run(command, stdin=lines, capture_output=True, text=True, check=True).stdout
    ended = [line.partition(":: ")[2] for line in decoded.splitlines()]
    assert len(ended) == len(log.read_text().splitlines())
    names = {message.partition("(")[0] for message in ended}
    known = {record.__name__ for record in codec.CODECS}
    assert names <= known, names - known
    assert {"Accelerometer", "EncoderEstimates", "SetInputTorque", "FirmwareHeartbeat", "FaultEvent"} <= names


@pytest.mark.realtime
def test_cantools_monitor_shows_it(live: Live) -> None:
    for shown in ("EncoderEstimates", "position_rev", "SetInputTorque", "striker_low_m_s2"):
        assert shown in live.shown


def decided(firmware_trace: Path, wanted: Callable[[list[Decision]], bool]) -> None:
    """Wait for decisions as wanted."""

    def so_far() -> list[Decision]:
        return decisions(firmware_trace) if firmware_trace.exists() else []

    waited_for(lambda: wanted(so_far()), instead=so_far)


@pytest.mark.realtime
@pytest.mark.quiet
def test_a_log_played_back_gives_the_firmware_the_same_decisions(tmp_path: Path) -> None:
    """Also where the host pauses it as the log begins, and both of them in the start."""
    run_dir = in_lockstep(Job(scenario(*CREEPING, *E_STOP), 1, folder=tmp_path / "run"))
    expected = decisions(run_dir / "firmware.trace")
    assert expected[-2:] == [STARTING, Decision("E_STOP", "NONE")]
    with provide("local") as provided:
        firmware = [program(), "firmware", str(run_dir / "scenario.toml")]
        firmware += ["--bus", provided.address, "--out", str(tmp_path)]
        channel = provided.address.removeprefix("local:")
        with running(firmware, stderr=subprocess.PIPE) as process, can.Bus(channel, "vibrohil") as listener:
            assert shown(process).startswith(b"running")
            decided(tmp_path / "firmware.trace", lambda found: len(found) > 0)
            player = tool("can.player", channel, str(run_dir / "can.log"))
            with subprocess.Popen(player, stdout=subprocess.DEVNULL) as playing:
                with stalled(process.pid):
                    message_data(listener, codec.CODECS[Accelerometer].can_id, lambda _: True, PATIENCE_S)
                    time.sleep(LONG_STALL_S)
                decided(tmp_path / "firmware.trace", lambda found: STARTING in found)
                stop([(playing.pid, STALL_S), (process.pid, STALL_S)])
                assert playing.wait(PATIENCE_S) == 0
    played = decisions(tmp_path / "firmware.trace")
    assert played[: len(expected)] == expected


@pytest.mark.realtime
@pytest.mark.quiet
def test_plant_firmware_and_operator_meet_from_three_processes(tmp_path: Path) -> None:
    """Also where the host pauses each of them."""
    out = tmp_path / "deep" / "new"
    with provide("local") as provided, ExitStack() as stack:
        more = ["soft-start-multistable", "--bus", provided.address]
        change = [word for setting in (*CREEPING, *LEFT_IN_THE_START) for word in ("--set", setting)]
        nodes: dict[str, subprocess.Popen[bytes]] = {}
        for node in ("plant", "firmware"):
            command = [program(), node, *more, "--out", str(out), *change]
            nodes[node] = stack.enter_context(running(command, stderr=subprocess.PIPE))
            assert shown(nodes[node]).startswith(b"running")
        operator = [program(), "operator", *more, *change]
        with subprocess.Popen(operator, stderr=subprocess.PIPE) as playing:
            assert shown(playing).startswith(b"playing")
            decided(out / "firmware.trace", lambda found: STARTING in found)
            stop([(process.pid, STALL_S) for process in (*nodes.values(), playing)])
            assert b"mode: soft-start" in playing.communicate()[1]
            assert playing.returncode == 0
        left = [STARTING, Decision("FAULT", "OPERATOR_TIMEOUT")]
        decided(out / "firmware.trace", lambda found: found[-2:] == left)
        # One who leaves early leaves an E-stop behind.
        with subprocess.Popen(operator, stderr=subprocess.PIPE) as early:
            assert shown(early).startswith(b"playing")
            while b"mode: fault, latched fault operator-timeout\n" not in (line := shown(early)):
                assert line, "the operator ended before it had reported the firmware's mode"
            early.send_signal(signal.SIGINT)
            assert b"mode: e-stop" in early.communicate()[1]
            assert early.returncode == 0
        decided(out / "firmware.trace", lambda found: found[-1].mode == "E_STOP")
    plant = trace.read(out / "plant.trace")
    assert abs(plant["motor_torque_n_m"]).max() > 0.001
    assert plant["motor_torque_n_m"][-1] == 0.0


def shown(process: subprocess.Popen[bytes]) -> bytes:
    """The next line that a process has written on standard error."""
    assert process.stderr is not None
    return process.stderr.readline()
