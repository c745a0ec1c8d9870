"""Random and mutated frames at the inputs of a running firmware and plant.

In each tick both nodes receive the closed loop's own frames and a burst of foreign frames: noise on any
identifier, random bytes under known identifiers, random bytes with a correct CRC, and the loop's own frames
with inverted bits, shortened or repeated. After each tick the torque must be a number within its limit, at
the firmware and at the drive. Every frame must be accounted for: accepted, or dropped with a reason.
"""

from collections.abc import Sequence
from itertools import chain
from typing import NamedTuple

import numpy as np

from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.crc import frame_crc8
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.received import RECEIVED_IDS
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import config_from
from hil.nodes.plant import ACCEPTED_IDS, PlantNode
from hil.scenario.operator import OperatorNode
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
ENOUGH_FAILURES = 10
FIRMWARE, PLANT = range(2)
NAMES = ("the firmware", "the drive")
LISTED = tuple(CODEC_BY_ID.values())


class Failure(NamedTuple):
    """A failure: its description, the seed that repeats it, and its tick."""

    seed: int
    tick: int
    what: str


class Outcome(NamedTuple):
    """Numbers of frames at both inputs together, by their treatment, and the largest torques, N m."""

    frames: int
    taken: int
    dropped: int
    not_addressed: int
    ticks: int
    ticks_with_torque: int
    firmware_torque_n_m: float
    drive_torque_n_m: float
    failures: tuple[Failure, ...]


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
        match kind % 4:
            case 0:
                return Frame(first % MOST_IDENTIFIERS, noise[: second % 9])
            case 1:
                listed = self._listed[first % len(self._listed)]
                return Frame(listed.can_id, noise[: listed.length])
            case 2:
                listed = self._listed[first % len(self._listed)]
                body = noise[: listed.length]
                if listed.protected:
                    body = body[:-1] + bytes([frame_crc8(listed.can_id, body[:-1])])
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
    """A closed loop from power-up that receives foreign frames."""

    def __init__(self, seed: int) -> None:
        scenario = load_scenario(SCENARIO, ())
        config = config_from(scenario.parameters)
        self.seed = seed
        self.tick = 0
        self.firmware = FirmwareNode(config, scenario.parameters)
        self.plant = PlantNode(scenario.scene, seed, scenario.period_s)
        self.failures: list[Failure] = []
        self._operator = OperatorNode(scenario.commands, scenario.period_s)
        self._strangers = Strangers(seed)
        self._commanded: list[Frame] = []
        drive = self.plant.drive_config
        self._limits_n_m = (
            config.p.speed.torque_limit_n_m,
            drive.current_limit_a * drive.torque_constant_n_m_a,
        )
        self._largest_n_m = [0.0, 0.0]
        self._ticks_with_torque = 0
        self._frames = [0, 0]
        self._not_addressed = [0, 0]

    def step(self, strangers: int) -> None:
        """Advance both nodes by one tick, each with this number of foreign frames."""
        published = self.plant.publish()
        if self.tick >= self._operator.due_tick:
            published += self._operator.publish(self.tick)
        self.plant.advance(self._mixed(PLANT, self._commanded, strangers))
        self._commanded = self.firmware.tick(self._mixed(FIRMWARE, published, strangers), 1)
        self._strangers.seen = [*self._strangers.seen, *published, *self._commanded][-REMEMBERED:]
        torques_n_m = (self.firmware.outputs.torque_n_m, self.plant.record.torque_command_n_m)
        for which, torque_n_m in enumerate(torques_n_m):
            self._largest_n_m[which] = max(self._largest_n_m[which], abs(torque_n_m))
            if not abs(torque_n_m) <= self._limits_n_m[which] * (1.0 + 1e-9):
                self.fail(f"{NAMES[which]} gave {torque_n_m} N m; its limit is {self._limits_n_m[which]}")
        self._ticks_with_torque += torques_n_m[FIRMWARE] != 0.0
        self.tick += 1

    def fail(self, what: str) -> None:
        """Record a failure in this tick."""
        self.failures.append(Failure(self.seed, self.tick, what))

    def _mixed(self, which: int, own: list[Frame], count: int) -> list[Frame]:
        """Return the loop's own frames between foreign frames, and count all of them."""
        strangers = self._strangers.burst(count)
        frames = [*strangers[: count // 2], *own, *strangers[count // 2 :]]
        addressed = (RECEIVED_IDS, ACCEPTED_IDS)[which]
        self._frames[which] += len(frames)
        self._not_addressed[which] += sum(frame.can_id not in addressed for frame in frames)
        return frames

    def outcome(self) -> Outcome:
        """Return the counts of all frames; the firmware must have counted each frame that it received."""
        counters = self.firmware.counters
        dropped = (
            counters.rejected_length
            + counters.rejected_crc
            + counters.rejected_value
            + counters.rejected_repeated
        )
        addressed = self._frames[FIRMWARE] - self._not_addressed[FIRMWARE]
        if not self.failures and counters.frames + dropped != addressed:
            self.fail(f"{addressed} frames for the firmware, {counters.frames} taken and {dropped} dropped")
        dropped += self.plant.rejected
        return Outcome(
            frames=sum(self._frames),
            taken=sum(self._frames) - sum(self._not_addressed) - dropped,
            dropped=dropped,
            not_addressed=sum(self._not_addressed),
            ticks=self.tick,
            ticks_with_torque=self._ticks_with_torque,
            firmware_torque_n_m=self._largest_n_m[FIRMWARE],
            drive_torque_n_m=self._largest_n_m[PLANT],
            failures=tuple(self.failures),
        )


def one_life(seed: int) -> Outcome:
    """Run both nodes from power-up for TICKS_A_LIFE ticks with BURST foreign frames a tick at each input.

    In every other life the foreign frames begin when the crank already turns, because they usually prevent a
    start.
    """
    life = Life(seed)
    quiet_ticks = QUIET_TICKS if seed % 2 else 0
    try:
        while life.tick < TICKS_A_LIFE + quiet_ticks and not life.failures:
            life.step(BURST if life.tick >= quiet_ticks else 0)
    except Exception as error:  # any error is a failure: it is reported and ends this life
        life.fail(f"{type(error).__name__}: {error}")
    return life.outcome()


def together(outcomes: Sequence[Outcome]) -> Outcome:
    """Return the sums of the counts, the largest torques and all failures."""
    *counts, firmware_n_m, drive_n_m, failures = zip(*outcomes, strict=True)
    found = tuple(chain.from_iterable(failures))
    return Outcome._make([*map(sum, counts), max(firmware_n_m), max(drive_n_m), found])


def fuzz(frames: int, seed: int) -> Outcome:
    """Run lives with seeds from `seed` on until this number of frames or ENOUGH_FAILURES is reached."""
    outcomes: list[Outcome] = []
    so_far = failures = 0
    while so_far < frames and failures < ENOUGH_FAILURES:
        outcomes.append(one_life(seed + len(outcomes)))
        so_far += outcomes[-1].frames
        failures += len(outcomes[-1].failures)
    return together(outcomes)
