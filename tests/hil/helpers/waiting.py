"""Waiting for something that another process or the bus brings about."""

import time
from collections.abc import Callable
from typing import TypeVar

import can

from firmware_py.interface.frame import Frame
from hil.bus import Bus

T = TypeVar("T")


def waited_for(
    look: Callable[[], T | None], timeout_s: float = 120.0, instead: Callable[[], object] = lambda: "nothing"
) -> T:
    """What `look` finds, once it finds something; else an error with what is there `instead`."""
    deadline_s = time.monotonic() + timeout_s
    while not (found := look()):
        assert time.monotonic() < deadline_s, f"waited in vain; found instead: {instead()}"
        time.sleep(0.02)
    return found


def frames_within(bus: Bus, count: int, timeout_s: float = 2.0) -> list[Frame]:
    """Frames until there are `count`, which may arrive late; fewer once the time is over."""
    frames: list[Frame] = []
    deadline_s = time.monotonic() + timeout_s
    while len(frames) < count and (rest_s := deadline_s - time.monotonic()) > 0:
        bus.wait(rest_s)
        frames += bus.receive()
    return frames


def message_data(bus: can.BusABC, can_id: int, wanted: Callable[[bytes], bool], timeout_s: float) -> bytes:
    """The data of the first message with this identifier that is as wanted."""
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        message = bus.recv(1.0)
        if message is not None and message.arbitration_id == can_id and wanted(bytes(message.data)):
            return bytes(message.data)
    raise AssertionError(f"no message {can_id:#x} as wanted within {timeout_s} s")
