"""Random sequences of commands to the compiled closed loop: no torque that the live operator did not ask for.

    python -m tools.dev.operator_sequences [--count 100000] [--first 0]

A live operator asks for anything at any time, and sends a command at each change and every 0.1 s. On the way
up to two commands in a row are lost or late, and any comes again. Recorded commands, one or several in a row,
are replayed in their own rhythm or another, and a second operator sends commands of its own. Each sequence is
made by its number alone. Torque may act in SOFT_START and RUN while the live operator asks for RUN, and
`STALE_S` longer; in STOPPING, which only those modes reach; and in no other mode.
"""

import argparse
import dataclasses
import random
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface import codec
from firmware_py.interface.enums import Mode, OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import OperatorCommand
from firmware_py.interface.modes import MOVING
from hil.runs.compiled import Stretches
from hil.runs.job import Job
from hil.runs.lockstep import Lockstep
from hil.runs.segments import LONGEST_TICKS, taken
from hil.scenario.scenario import Scenario, load_scenario

DURATION_S = 3.0
QUICK = {"rise_s": 0.5, "approach_s": 0.3, "stop_s": 0.3, "confirm_periods": 1.0}
"""Every mode is reached soon."""
STALE_S = 0.4
"""Longest time that a request acts after the operator has ended it: two commands in a row are lost."""
COMMAND_S = 0.1
SCENARIO = "soft-start-multistable"


class Asked(NamedTuple):
    """What a sender asks for from a time on."""

    at_s: float
    request: OperatorRequest
    ratio: float


class Sent(NamedTuple):
    """A frame and the time of its arrival."""

    at_s: float
    frame: Frame


class Found(NamedTuple):
    """Ticks in which a sequence had torque, and those of them that the live operator did not ask for."""

    driven: int
    unasked_s: list[float]


def random_requests(dice: random.Random) -> list[Asked]:
    """Any request at any time."""
    at_s, found = 0.0, [Asked(0.0, OperatorRequest.IDLE, 1.3)]
    while at_s < DURATION_S:
        at_s += dice.choice((0.05, 0.4, 0.8, 1.6)) * dice.uniform(0.5, 1.5)
        common = (OperatorRequest.IDLE, OperatorRequest.IDLE, OperatorRequest.RUN, OperatorRequest.RUN)
        found.append(Asked(at_s, dice.choice((*common, *OperatorRequest)), dice.choice((0.9, 1.3))))
    return found


def commands_of(asked: Sequence[Asked], counter: int, phase_s: float) -> Iterator[Sent]:
    """A sender's commands: one at each change, and one every `COMMAND_S`."""
    times = {round(phase_s + COMMAND_S * number, 6) for number in range(int(DURATION_S / COMMAND_S))}
    for number, at_s in enumerate(sorted(times | {max(one.at_s, phase_s) for one in asked})):
        now = next(one for one in reversed(asked) if one.at_s <= at_s)
        record = OperatorCommand(now.request, now.ratio, 0.0)
        yield Sent(at_s, codec.OPERATOR_COMMAND.encode(record, counter + number))


def on_the_way(dice: random.Random, sent: Sequence[Sent]) -> Iterator[Sent]:
    """The operator's commands that arrive: at most two in a row are lost or late, and any may come again."""
    missing, well = 0, dice.choice((4, 40, 400))
    for one in sent:
        fate = dice.choice((*("well",) * well, "lost", "late", "again"))
        missing = missing + 1 if fate in ("lost", "late") and missing < 2 else 0
        if missing == 0:
            yield one
        elif fate == "late":
            yield one._replace(at_s=one.at_s + dice.uniform(0.01, 0.5))
        if fate == "again":
            yield one._replace(at_s=one.at_s + dice.choice((0.001, 0.01, 0.09, 0.11, 1.0, 1.6)))


def replayed(dice: random.Random, sent: Sequence[Sent]) -> Iterator[Sent]:
    """Recorded commands of the operator."""
    for _ in range(dice.choice((0, 0, 1, 2, 3))):
        first = dice.randrange(len(sent))
        piece = sent[first : first + dice.choice((1, 2, 3, 8))]
        at_s, rhythm = dice.uniform(0.0, DURATION_S), dice.choice((0.01, 0.2, 0.5, 1.0))
        for _ in range(dice.choice((1, 1, 5))):
            for one in piece:
                yield one._replace(at_s=at_s + rhythm * (one.at_s - piece[0].at_s))
            at_s += dice.choice((0.05, 0.1, 0.4))


def second_sender(dice: random.Random) -> Iterator[Sent]:
    """In three of ten sequences another operator, from some time on."""
    if dice.random() < 0.3:
        begin_s = dice.uniform(0.0, DURATION_S)
        sent = commands_of(random_requests(dice), dice.randrange(16), dice.uniform(0.0, COMMAND_S))
        yield from (one for one in sent if one.at_s >= begin_s)


def arriving(number: int) -> tuple[list[Asked], list[Sent]]:
    """What the live operator of a sequence asks for, and all commands in the order of their arrival."""
    dice = random.Random(number)
    asked = random_requests(dice)
    sent = list(commands_of(asked, dice.randrange(16), 0.0))
    every = [*on_the_way(dice, sent), *replayed(dice, sent), *second_sender(dice)]
    return asked, sorted(every, key=lambda one: one.at_s)


class Senders:
    """All senders of commands in the operator's place; at most one frame a tick, the others as soon after."""

    def __init__(self, sent: Sequence[Sent], period_s: float) -> None:
        self._frames: dict[int, Frame] = {}
        tick = -1
        for one in sent:
            tick = max(round(one.at_s / period_s), tick + 1)
            self._frames[tick] = one.frame
        self._ticks = [*self._frames, round(10.0 * DURATION_S / period_s)]
        self.due_tick = self._ticks.pop(0)

    def publish(self, tick: int, _received: Sequence[Frame]) -> list[Frame]:
        """The frame of `tick`."""
        self.due_tick = self._ticks.pop(0)
        return [self._frames[tick]]


def quick_scenario() -> Scenario:
    """The module on which the sequences run."""
    settings = [f"firmware.start.{name}={value}" for name, value in QUICK.items()]
    return dataclasses.replace(load_scenario(SCENARIO, settings), commands=(), duration_s=DURATION_S)


def run_sequence(scenario: Scenario, number: int) -> Found:
    """Run a sequence and judge it."""
    asked, sent = arriving(number)
    job = Job(scenario, 1, kept={"firmware": ("outputs.mode", "outputs.torque_n_m")})
    rows: list[NDArray[np.void]] = []
    with ExitStack() as stack:
        nodes = Lockstep(job, stack)
        nodes.operator.node = Senders(sent, scenario.period_s)
        stretches, tick = Stretches(job, nodes), 0
        while tick < scenario.ticks:
            ticks = stretches.advance(tick, LONGEST_TICKS)
            rows.append(taken(nodes, tick, tick + ticks).rows["firmware"].copy())
            tick += ticks
    return judge(asked, np.concatenate(rows), scenario.period_s)


def judge(asked: Sequence[Asked], rows: NDArray[np.void], period_s: float) -> Found:
    """The torque of a sequence against what the live operator asked for."""
    mode, times_s = rows["outputs.mode"], period_s * np.arange(len(rows))
    driven = rows["outputs.torque_n_m"] != 0.0
    allowed = np.zeros(len(rows), bool)
    ends_s = [*(one.at_s for one in asked[1:]), np.inf]
    for one, end_s in zip(asked, ends_s, strict=True):
        if one.request == OperatorRequest.RUN:
            allowed |= (times_s >= one.at_s) & (times_s <= end_s + STALE_S)
    in_motion = np.isin(mode, list(MOVING))
    begins = in_motion & ~np.concatenate(([False], in_motion[:-1]))
    unasked = driven & ~(in_motion & (allowed | (mode == Mode.STOPPING))) | begins & ~allowed
    return Found(int(driven.sum()), times_s[unasked].tolist())


def main() -> None:
    """Run the sequences, and print those with torque that nobody asked for."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.dev.operator_sequences",
        description=__doc__,
        formatter_class=argparse.RawTextHelpFormatter,
    )
    parser.add_argument("--count", type=int, default=100_000, help="number of sequences")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    asked = parser.parse_args()
    scenario = quick_scenario()
    driven = failed = 0
    for number in range(asked.first, asked.first + asked.count):
        found = run_sequence(scenario, number)
        driven += found.driven > 0
        if found.unasked_s:
            failed += 1
            print(f"sequence {number}: torque unasked for from {found.unasked_s[0]:.3f} s on", flush=True)
    print(f"{asked.count} sequences, {driven} with torque, {failed} with torque unasked for")


if __name__ == "__main__":
    main()
