"""ODrive clients that nobody here wrote, unmodified, against `vibrohil plant` on the kernel's own CAN.

odrive-can and pyodrivecan come from PyPI. ODrive Robotics' own examples are in no package, and no licence was
found under which a copy could lie here: a test here and one of the plant's node exchange the same frames.

Where the machine's kernel has no CAN, `test_kernel_can.py` runs them under user-mode Linux.
"""

import os
import re
import shutil
import signal
import struct
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import can
import pytest
from kernel_interface import made_interface, needs_kernel_can
from waiting import message_data

from firmware_py.interface.enums import AxisState
from hil.runs.realtime import program

CHANNEL = "can0"
"""The interface that ODrive's examples join, and no other."""
AXIS = "{watchdog_s=1.0,encoder_s=0.01,control_mode='velocity'}"
"""ODrive's own periods, and a watchdog for clients that wait for state 8 in a heartbeat every 100 ms."""
HEARTBEAT, ADDRESS, ENCODER = 0x01, 0x06, 0x09
PATIENCE_S = 30.0
PRINTED = "printed.txt"


@pytest.fixture(scope="module")
def bus() -> Iterator[can.BusABC]:
    """What a bystander sees of the plant's bus, which is called as ODrive's examples want it."""
    plant = [
        program(),
        "plant",
        "soft-start-multistable",
        "--set",
        f"scene.axis={AXIS}",
        "--bus",
        f"socketcan:{CHANNEL}",
    ]
    with made_interface(CHANNEL), subprocess.Popen(plant, stderr=subprocess.PIPE) as process:
        try:
            assert process.stderr is not None
            assert process.stderr.readline().startswith(b"running")
            filters = [{"can_id": can_id, "can_mask": 0x7FF} for can_id in (HEARTBEAT, ADDRESS, ENCODER)]
            with can.Bus(CHANNEL, "socketcan", can_filters=filters) as listener:
                yield listener
        finally:
            process.terminate()


def seen(bus: can.BusABC, can_id: int, wanted: Callable[[bytes], bool], from_now: bool = True) -> bytes:
    """The first such message from now on; with `from_now` false, that of what nobody has taken yet."""
    while from_now and bus.recv(0.0) is not None:
        """What came before does not count."""
    return message_data(bus, can_id, wanted, PATIENCE_S)


def turns_faster(rev_s: float) -> Callable[[bytes], bool]:
    return lambda data: bool(struct.unpack("<ff", data)[1] > rev_s)


def is_idle(data: bytes) -> bool:
    return data[4] == AxisState.IDLE


@contextmanager
def client(command: Sequence[str | Path], folder: Path) -> Iterator[subprocess.Popen[bytes]]:
    """A program that writes what it prints into `PRINTED`."""
    # In CI=true odrive-can leaves the kernel's CAN alone.
    environment = {name: value for name, value in os.environ.items() if name != "CI"}
    with (folder / PRINTED).open("wb") as output:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env=environment | {"CAN_CHANNEL": CHANNEL, "PYTHONUNBUFFERED": "1"},
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
        )
    with process:
        try:
            yield process
        finally:
            process.kill()
            print((folder / PRINTED).read_text())


def printed_by(command: Sequence[str | Path], folder: Path) -> str:
    """What a program prints that comes to its end by itself."""
    with client(command, folder) as process:
        assert process.wait(PATIENCE_S) == 0
    return (folder / PRINTED).read_text()


def odrive_can_demo(name: str) -> list[str | Path]:
    return [sys.executable, "-m", "odrive_can.cli", "demo", name, "--axis-id", "0", "--amplitude", "2"]


@needs_kernel_can
def test_odrive_can_turns_the_crank_in_velocity_mode(bus: can.BusABC, tmp_path: Path) -> None:
    with client(odrive_can_demo("velocity"), tmp_path) as process:
        seen(bus, ENCODER, turns_faster(1.0))
        process.send_signal(signal.SIGINT)
        seen(bus, HEARTBEAT, is_idle)
        assert process.wait(PATIENCE_S) == 0
    printed = (tmp_path / PRINTED).read_text()
    assert "Running velocity control" in printed
    assert "Error" not in printed


@needs_kernel_can
def test_odrive_can_sees_the_watchdog_expire(bus: can.BusABC, tmp_path: Path) -> None:
    printed = printed_by(odrive_can_demo("watchdog"), tmp_path)
    assert "Axis Error: WATCHDOG_TIMER_EXPIRED" in printed
    seen(bus, HEARTBEAT, is_idle)


PYODRIVECAN = """
import asyncio, pyodrivecan

async def controller(odrive):
    odrive.clear_errors()
    odrive.setAxisState("closed_loop_control")
    odrive.set_controller_mode("velocity_control")
    for _ in range(20):
        odrive.set_velocity(1.0)
        await asyncio.sleep(0.1)
    print("velocity", await odrive.get_velocity(), "voltage", odrive.bus_voltage)
    odrive.setAxisState("idle")
    odrive.running = False

odrive = pyodrivecan.ODriveCAN(0)
odrive.run(controller(odrive))
odrive.bus_shutdown()
"""
"""As its documentation uses it."""


@needs_kernel_can
@pytest.mark.skipif(shutil.which("candump") is None, reason="pyodrivecan wants candump: install can-utils")
def test_pyodrivecan_turns_the_crank_and_keeps_its_records(bus: can.BusABC, tmp_path: Path) -> None:
    """Whether the state is the wanted one it asks one heartbeat, which may have left before its request."""
    with client([sys.executable, "-c", PYODRIVECAN], tmp_path) as process:
        seen(bus, HEARTBEAT, lambda data: data[4] == AxisState.CLOSED_LOOP_CONTROL)
        seen(bus, ENCODER, turns_faster(0.7))
        seen(bus, HEARTBEAT, is_idle)
        assert process.wait(PATIENCE_S) == 0
    printed = (tmp_path / PRINTED).read_text()
    assert "already operational" in printed
    assert re.search("ODrive 0 (is now in state|did not enter) closed_loop_control", printed)
    assert re.search("ODrive 0 (is now in state|did not enter) idle", printed)
    assert "voltage 24.0" in printed
    assert (tmp_path / "odrive_data.db").stat().st_size > 0


@needs_kernel_can
def test_a_discovery_as_by_odrives_can_enumerate_finds_the_drive(bus: can.BusABC) -> None:
    bus.send(can.Message(arbitration_id=0x7E6, is_remote_frame=True, is_extended_id=False))
    assert seen(bus, ADDRESS, lambda data: len(data) == 8, from_now=False)[0] == 0
