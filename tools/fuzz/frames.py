"""Random and mutated frames at the inputs of a running firmware and plant.

Each tick brings a closed loop's own frames and a burst of strangers': noise on any identifier, random bytes
under known identifiers, the same with their CRC put right, and the loop's own frames with bits turned, cut
short or repeated. After each tick the torque must be a number within its limit, at the firmware and at the
drive, and every frame accounted for: taken, or dropped with a reason.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.crc import frame_crc8
from firmware_py.interface.frame import Frame
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import config_from
from hil.nodes.plant import ACCEPTED_IDS, PlantNode
from hil.scenario.operator import OPERATOR_PERIOD_S, OperatorNode
from hil.scenario.scenario import load_scenario

SCENARIO = "soft-start-multistable"
BURST = 50
"""Strangers a tick at each of the two inputs: some fifteen times what a bus at 1 Mbit/s can carry."""
TICKS_A_LIFE = 500
"""Then both nodes start anew, out of whatever the strangers had got them into."""
CALM_TICKS = 1500
"""Before the strangers come in every other life: by then the crank turns."""
REMEMBERED = 64
"""Frames of the loop's own that bad ones are made of."""
LISTED_SHARE = 0.4
"""Of the known identifiers, those that strangers use in one life."""
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
    """Frames at the two inputs together, what became of them, and the largest torques, N m."""

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
    """Endless frames of all four kinds; `seen` are frames of the bus to make bad ones of.

    Known identifiers are a choice of each life's own: where no stranger happens to stop the drive, the others
    get further (swarm testing; Groce, Zhang, Eide, Chen & Regehr, ISSTA 2012).
    """

    def __init__(self, seed: int) -> None:
        self._random = np.random.default_rng(seed)
        self._listed = [listed for listed in LISTED if self._random.random() < LISTED_SHARE] or LISTED
        self.seen: list[Frame] = [Frame(0, bytes(8))]

    def burst(self, count: int) -> list[Frame]:
        """`count` frames."""
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
    """One to three bits turned, the end cut off, or nothing at all: a repetition."""
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
    """A closed loop from power-up, among strangers."""

    def __init__(self, seed: int) -> None:
        scenario = load_scenario(SCENARIO, ())
        config = config_from(scenario.parameters)
        self.seed = seed
        self.tick = 0
        self.firmware = FirmwareNode(config, scenario.parameters)
        self.plant = PlantNode(scenario.scene, seed, scenario.period_s)
        self.failures: list[Failure] = []
        self._operator = OperatorNode(scenario.commands, scenario.period_s)
        self._operator_ticks = round(OPERATOR_PERIOD_S / scenario.period_s)
        self._strangers = Strangers(seed)
        self._commanded: list[Frame] = []
        drive = self.plant.drive_config
        self._limits_n_m = (
            config.speed.torque_limit_n_m,
            drive.current_limit_a * drive.torque_constant_n_m_a,
        )
        self._largest_n_m = [0.0, 0.0]
        self._ticks_with_torque = 0
        self._frames = [0, 0]
        self._not_addressed = [0, 0]

    def step(self, strangers_at_firmware: int, strangers_at_plant: int) -> None:
        """One tick of both nodes, each with this number of foreign frames."""
        published = self.plant.publish()
        if self.tick % self._operator_ticks == 0:
            published += self._operator.publish(self.tick // self._operator_ticks)
        self.plant.advance(self._mixed(PLANT, self._commanded, strangers_at_plant))
        self._commanded = self.firmware.tick(self._mixed(FIRMWARE, published, strangers_at_firmware), 1)
        self._strangers.seen = [*self._strangers.seen, *published, *self._commanded][-REMEMBERED:]
        torques_n_m = (self.firmware.outputs.torque_n_m, self.plant.record.torque_command_n_m)
        for which, torque_n_m in enumerate(torques_n_m):
            self._largest_n_m[which] = max(self._largest_n_m[which], abs(torque_n_m))
            if not abs(torque_n_m) <= self._limits_n_m[which] * (1.0 + 1e-9):
                self.fail(f"{NAMES[which]} gave {torque_n_m} N m; its limit is {self._limits_n_m[which]}")
        self._ticks_with_torque += torques_n_m[FIRMWARE] != 0.0
        self.tick += 1

    def fail(self, what: str) -> None:
        """Note something that must not be."""
        self.failures.append(Failure(self.seed, self.tick, what))

    def _mixed(self, which: int, own: list[Frame], count: int) -> list[Frame]:
        """The loop's own frames among strangers, all counted."""
        strangers = self._strangers.burst(count)
        frames = [*strangers[: count // 2], *own, *strangers[count // 2 :]]
        addressed = (self.firmware.can_ids, ACCEPTED_IDS)[which]
        self._frames[which] += len(frames)
        self._not_addressed[which] += sum(frame.can_id not in addressed for frame in frames)
        return frames

    def outcome(self) -> Outcome:
        """Counts of all frames; the firmware must count each frame that it receives."""
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


def one_life(seed: int, burst: int = BURST, ticks: int = TICKS_A_LIFE) -> Outcome:
    """Both nodes from power-up for `ticks` ticks with `burst` strangers a tick at each.

    In every other life they come when the loop has begun to move; strangers seldom let it start.
    """
    life = Life(seed)
    calm_ticks = CALM_TICKS if seed % 2 else 0
    try:
        while life.tick < ticks + calm_ticks and not life.failures:
            count = burst if life.tick >= calm_ticks else 0
            life.step(count, count)
    except Exception as error:  # what is looked for: it is reported, and ends this life
        life.fail(f"{type(error).__name__}: {error}")
    return life.outcome()


def together(outcomes: Sequence[Outcome]) -> Outcome:
    """The sums, the largest torques and all failures."""
    return Outcome(
        frames=sum(outcome.frames for outcome in outcomes),
        taken=sum(outcome.taken for outcome in outcomes),
        dropped=sum(outcome.dropped for outcome in outcomes),
        not_addressed=sum(outcome.not_addressed for outcome in outcomes),
        ticks=sum(outcome.ticks for outcome in outcomes),
        ticks_with_torque=sum(outcome.ticks_with_torque for outcome in outcomes),
        firmware_torque_n_m=max(outcome.firmware_torque_n_m for outcome in outcomes),
        drive_torque_n_m=max(outcome.drive_torque_n_m for outcome in outcomes),
        failures=tuple(failure for outcome in outcomes for failure in outcome.failures),
    )


def fuzz(frames: int, seed: int, progress: Callable[[int], None] = lambda _: None) -> Outcome:
    """Life after life from `seed` on, until this number of frames has come in, or enough has failed."""
    outcomes: list[Outcome] = []
    so_far = failures = 0
    while so_far < frames and failures < ENOUGH_FAILURES:
        outcomes.append(one_life(seed + len(outcomes)))
        so_far += outcomes[-1].frames
        failures += len(outcomes[-1].failures)
        progress(min(so_far, frames))
    return together(outcomes)
