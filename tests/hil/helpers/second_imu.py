"""A second IMU board, as somebody adds it to the bench: one frame in each tick."""

from firmware_py.interface.frame import Frame
from hil.nodes.runner import Making, NodeRunner
from hil.timing.loop import LoopTiming

CAN_ID = 0x5F0


class SecondImu(NodeRunner):
    """Sends the lowest byte of its tick."""

    def __init__(self, making: Making) -> None:
        self._bus, self._period_s = making.bus, making.pace.period_s
        self._trace = making.traces("imu", [("tick", int), ("t_s", float)])

    @classmethod
    def make(cls, making: Making) -> "SecondImu":
        return cls(making)

    def step(self, tick: int) -> None:
        self._bus.receive()
        self._bus.send_all([Frame(CAN_ID, bytes([tick & 255]))])

    def record(self, tick: int, _: LoopTiming) -> None:
        if self._trace is not None:
            self._trace.append(tick, tick * self._period_s)

    def restart(self, tick: int) -> None:
        self._bus.restart()

    def close(self) -> None:
        if self._trace is not None:
            self._trace.close()
