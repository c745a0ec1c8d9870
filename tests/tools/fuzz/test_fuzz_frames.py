"""Random and mutated frames at the inputs of a running firmware and plant.

In each tick both nodes receive the closed loop's own frames and a burst of foreign frames: noise on any
identifier, random bytes under known identifiers, random bytes with a correct CRC, and the loop's own frames
with inverted bits, shortened or repeated. After each tick the torque must be a number within its limit, at
the firmware and at the drive. The firmware must account for every frame: accepted, or dropped with a reason.
"""

import itertools
from collections import Counter
from typing import Any

import numpy as np
import pytest
from crccheck.crc import Crc8SaeJ1850  # type: ignore[import-untyped]  # it carries no types

from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.frame import Frame, WordFrame
from firmware_py.interface.generated.kinds import DRIVE_ESTOP
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.node import tick
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import config_from
from hil.drive import axis as drive
from hil.nodes.operator.node import OperatorNode
from hil.nodes.plant.node import PlantNode
from hil.scenario.scenario import load_scenario

SCENARIO = "soft-start-multistable"
BURST = 50
"""Foreign frames a tick at each of the two inputs: about fifteen times the capacity of a bus at 1 Mbit/s."""
TICKS_A_LIFE = 500
"""Ticks with foreign frames before both nodes restart, which ends any state that the frames have caused."""
QUIET_TICKS = 1500
"""Ticks without foreign frames at the beginning of every other life; after these ticks the crank turns."""
REMEMBERED = 64
"""Number of the loop's last own frames that are kept as templates of foreign frames."""
LISTED_SHARE = 0.4
"""Share of the known identifiers that foreign frames use in one life."""
MOST_IDENTIFIERS = 0x800
REASONS = (
    "rejected_length",
    "rejected_crc",
    "rejected_value",
    "rejected_repeated",
    "rejected_sequence",
)
LISTED = tuple(CODEC_BY_ID.values())


class Strangers:
    """Generator of foreign frames of all four kinds; `seen` are frames of the bus that serve as templates.

    Each life uses a random subset of the known identifiers. In a life in which no frame stops the drive, the
    other frames reach later states (swarm testing; Groce, Zhang, Eide, Chen & Regehr, ISSTA 2012).
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._listed = [listed for listed in LISTED if self._random.random() < LISTED_SHARE] or LISTED
        self.seen: list[Frame] = [Frame(0, bytes(8))]

    def burst(self, count: int) -> list[Frame]:
        """Return `count` frames."""
        numbers = self._random.integers(0, 1 << 31, (count, 3)).tolist()
        noise = self._random.bytes(8 * count)
        return [
            self._frame(kind, first, second, noise[8 * k : 8 * k + 8])
            for k, (kind, first, second) in enumerate(numbers)
        ]

    def _frame(self, kind: int, first: int, second: int, noise: bytes) -> Frame:
        listed = self._listed[first % len(self._listed)]
        body = noise[: listed.length]
        match kind % 4:
            case 0:
                return Frame(first % MOST_IDENTIFIERS, noise[: second % 9])
            case 1:
                return Frame(listed.can_id, body)
            case 2:
                if listed.protected:
                    body = body[:-1]
                    body += bytes([Crc8SaeJ1850.calc(bytes([listed.can_id & 0xFF]) + body)])
                return Frame(listed.can_id, body)
            case _:
                return mutated(self.seen[first % len(self.seen)], second)


def mutated(frame: Frame, number: int) -> Frame:
    """Return the frame with one to three inverted bits, shortened, or unchanged, which is a repetition."""
    change, number = number % 8, number // 8
    data = bytearray(frame.data)
    if change == 0 or not data:
        return frame
    if change == 1:
        return Frame(frame.can_id, bytes(data[: number % len(data)]))
    for _ in range(1 + number % 3):
        number //= 3
        bit = number % (8 * len(data))
        data[bit // 8] ^= 1 << bit % 8
    return Frame(frame.can_id, bytes(data))


class Life:
    """A closed loop from power-up that receives foreign frames; `seen` counts what it has met."""

    def __init__(self, seed: int) -> None:
        scenario = load_scenario(SCENARIO, ())
        config = config_from(scenario.parameters)
        self.tick = 0
        self.seen: Counter[str] = Counter()
        self._firmware = FirmwareNode(config)
        self._plant = PlantNode(scenario.scene, seed, scenario.period_s)
        self._operator = OperatorNode(scenario.commands, scenario.period_s)
        self._strangers = Strangers(seed)
        self._commanded: list[Frame] = []
        self._addressed = 0
        self._firmware_limit_n_m = config.p.speed.torque_limit_n_m
        motor = self._plant.drive_config
        self._drive_limit_n_m = motor.current_limit_a * motor.torque_constant_n_m_a

    def step(self, strangers: int) -> None:
        """Advance both nodes by one tick, each with this number of foreign frames."""
        published = self._plant.publish()
        if self.tick >= self._operator.due_tick:
            published += self._operator.publish(self.tick)
        self._plant.advance(self._mixed(self._commanded, strangers))
        received = self._mixed(published, strangers)
        estops = sum(frame == Frame(DRIVE_ESTOP.can_id, b"") for frame in received)
        self._addressed += sum(frame.can_id in RECEIVED_IDS for frame in received) - max(estops - 1, 0)
        self._commanded = self._firmware.tick(received, 1)
        self._strangers.seen = [*self._strangers.seen, *published, *self._commanded][-REMEMBERED:]
        asked_n_m, given_n_m = self._firmware.outputs.torque_n_m, self._plant.record.torque_command_n_m
        assert abs(asked_n_m) <= self._firmware_limit_n_m * (1.0 + 1e-9), "torque of the firmware"
        assert abs(given_n_m) <= self._drive_limit_n_m * (1.0 + 1e-9), "torque of the drive"
        self.seen["ticks with torque"] += asked_n_m != 0.0
        self.tick += 1

    def _mixed(self, own: list[Frame], count: int) -> list[Frame]:
        """Return the loop's own frames between foreign frames."""
        strangers = self._strangers.burst(count)
        self.seen["frames"] += count + len(own)
        return [*strangers[: count // 2], *own, *strangers[count // 2 :]]

    def end(self) -> None:
        """The firmware has counted each frame that it received."""
        counters = self._firmware.counters
        dropped = {reason: getattr(counters, reason) for reason in REASONS}
        assert counters.frames + sum(dropped.values()) == self._addressed, "frames for the firmware"
        self.seen.update(dropped, rejected_by_the_plant=self._plant.state.rejected)


def one_life(seed: int) -> Counter[str]:
    """Run both nodes from power-up for TICKS_A_LIFE ticks with BURST foreign frames a tick at each input.

    In every other life the foreign frames begin when the crank already turns, because they usually prevent a
    start. Any error names the seed, which repeats it.
    """
    life = Life(seed)
    quiet_ticks = QUIET_TICKS if seed % 2 else 0
    try:
        while life.tick < TICKS_A_LIFE + quiet_ticks:
            life.step(BURST if life.tick >= quiet_ticks else 0)
        life.end()
    except Exception as error:
        error.add_note(f"seed {seed}, tick {life.tick}")
        raise
    return life.seen


def test_random_frames_do_no_harm(pytestconfig: pytest.Config) -> None:
    """No exception, no torque beyond its limit, every frame counted, and every kind of foreign frame came."""
    count, seen = pytestconfig.getoption("fuzz_count") or 60_000, Counter[str]()
    for seed in itertools.count(pytestconfig.getoption("fuzz_seed")):
        seen += one_life(seed)
        if seen["frames"] >= count:
            break
    assert min(seen[reason] for reason in (*REASONS, "rejected_by_the_plant")) > 10
    assert seen["ticks with torque"] > 100


def test_a_torque_beyond_its_limit_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drive, "torque_n_m", lambda _, state, __: state.setpoint.torque_n_m)
    with pytest.raises(AssertionError, match="torque of the drive"):
        one_life(2)


def test_a_frame_that_nobody_counts_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    receive = tick.receive

    def deaf(now: Any, before: Any, counters: Any, frame: WordFrame) -> Any:
        if frame.length == 1:
            return before, counters, False
        return receive(now, before, counters, frame)

    monkeypatch.setattr(tick, "receive", deaf)
    with pytest.raises(AssertionError, match="frames for the firmware"):
        one_life(1)
