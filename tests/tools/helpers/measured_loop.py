"""The speed loop measured: firmware and plant in lockstep, with small sines on the torque frames.

The torque frames are changed on their way to the drive, so that the loop is cut where the torque reaches the
motor. By definition, the commanded torque over the acting torque is −L. The measured L includes tracker,
limits, load feed-forward, the quantised encoder and the delay on the bus.

All sines act at the same time. Each has a whole number of periods in the window, and a frequency midway
between harmonics of the crank's turn, at which the load acts; a Hann window separates sines and harmonics.
The commanded torque contains other frequencies too, so the neighbouring lines give the noise of a line.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.codec import CODECS
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import SetInputTorque
from hil.bus.base import NodeBus
from hil.bus.in_process import IdealBus
from hil.nodes.firmware.runner import FirmwareRunner, ParameterMemory, controller_of
from hil.nodes.operator.node import OperatorNode
from hil.nodes.plant.runner import PlantRunner
from hil.nodes.runner import Pace
from hil.roster import FIRMWARE, OPERATOR, PLANT
from hil.scenario.commands import Command, Request
from plant_sim.arrays import FloatArray, IntArray
from plant_sim.scene import load_scene, read_scene

ComplexArray = NDArray[np.complex128]

SCENE = "table1-motor-soft"
RATIO = 0.6
"""A speed ratio without impacts: the motion is smooth and the load has few harmonics."""
SETTLE_S = 10.0
WINDOW_S = 20.0
LINES = 10
AMPLITUDE_N_M = 0.02
"""Amplitude of each sine. Their sum is at most 0.2 N m, so that the torque is not limited."""
LOWEST_HZ, HIGHEST_HZ = 3.0, 110.0
TORQUE = CODECS[SetInputTorque]


class MeasuredLoop(NamedTuple):
    """L at `omega_rad_s`, shape (n,), and its noise (one standard deviation of |ΔL|)."""

    omega_rad_s: FloatArray
    loop: ComplexArray
    noise: FloatArray


class PushedBus:
    """The drive's end of the bus: adds a torque to each commanded torque, and records the latter by tick."""

    def __init__(self, bus: NodeBus, push_n_m: FloatArray) -> None:
        self._bus = bus
        self._push_n_m = push_n_m
        self._tick = 0
        self.commanded_n_m = np.zeros(len(push_n_m))

    def send_all(self, frames: Iterable[Frame]) -> None:
        """Send frames unchanged."""
        self._bus.send_all(frames)

    def receive(self) -> list[Frame]:
        """Return the received frames with the torque changed; call this once per tick."""
        tick = min(self._tick, len(self._push_n_m) - 1)
        self._tick += 1
        return [self._pushed(frame, tick) for frame in self._bus.receive()]

    def _pushed(self, frame: Frame, tick: int) -> Frame:
        if frame.can_id != TORQUE.can_id:
            return frame
        commanded = TORQUE.decode(frame.data).torque_n_m
        self.commanded_n_m[tick] = commanded
        return TORQUE.encode(SetInputTorque(commanded + float(self._push_n_m[tick])), 0)


def lines_of(turn_hz: float, window_s: float) -> IntArray:
    """Multiples of 1/window that carry a sine: evenly over octaves, midway between harmonics of the turn."""
    wanted_hz = np.geomspace(LOWEST_HZ, HIGHEST_HZ, LINES)
    between_hz = (np.floor(wanted_hz / turn_hz) + 0.5) * turn_hz
    return np.unique(np.round(between_hz * window_s).astype(np.int64))


def measure_loop(parameters: dict[str, object], window_s: float = WINDOW_S) -> MeasuredLoop:
    """L(jω) of the firmware with these parameters (a scenario's table `[firmware]`) on the bench's plant."""
    scene = load_scene(read_scene(SCENE))
    pace = Pace(1e-3, SETTLE_S + window_s)
    assert pace.ticks is not None
    first = round(SETTLE_S / pace.period_s)
    turn_hz = RATIO * scene.natural_rad_s / (2.0 * np.pi)
    lines = lines_of(turn_hz, window_s)
    t_s = np.arange(pace.ticks) * pace.period_s
    # Quadratic phases (Schroeder 1970) keep the sum of the sines low.
    phases = np.pi * np.arange(len(lines)) ** 2 / len(lines)
    push = AMPLITUDE_N_M * np.sum(np.cos(2.0 * np.pi * np.outer(t_s / window_s, lines) + phases), axis=1)
    push[: first // 2] = 0.0
    bus = IdealBus()
    pushed = PushedBus(bus.join(PLANT), push)
    plant = PlantRunner(scene, 1, pace, pushed)
    firmware = FirmwareRunner(
        ParameterMemory(parameters), pace, bus.join(FIRMWARE), controller=controller_of("compiled")
    )
    operator = OperatorNode((Command(0.2, Request.RUN, RATIO),), pace.period_s)
    operator_bus = bus.join(OPERATOR)
    for tick in range(pace.ticks):
        plant.step(tick)
        if tick >= operator.due_tick:
            operator_bus.send_all(operator.publish(tick, operator_bus.receive()))
        firmware.step(tick)
        bus.pass_time(0, 0)
    commanded = pushed.commanded_n_m[first:]
    assert np.any(commanded), "the firmware did not start"
    window = np.hanning(len(commanded))
    of_commanded = np.fft.rfft(window * (commanded - commanded.mean()))
    of_acting = of_commanded + np.fft.rfft(window * push[first:])
    beside = [np.abs(of_commanded[lines + shift]) ** 2 for shift in (-6, -5, -4, 4, 5, 6)]
    noise = np.sqrt(np.mean(beside, axis=0)) / np.abs(of_acting[lines])
    # commanded = −L acting; the noise of `commanded` enters numerator and denominator
    loop = -of_commanded[lines] / of_acting[lines]
    omega_rad_s = np.asarray(2.0 * np.pi * lines / window_s, np.float64)
    return MeasuredLoop(omega_rad_s, loop, noise * np.abs(1.0 + loop))
