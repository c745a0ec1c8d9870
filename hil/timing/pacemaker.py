"""Real time of the bench's own nodes: lockstep's order of events, released by the wall clock.

One process, the pacemaker, gives each node its turn: at t_k the plant, then the operator; at t_k + T/2 the
firmware. The next turn begins when it is due and the turn before has ended. If a node is late, all wait: the
start of the run moves by the delay, and no node catches up. Each such hold is recorded, and divided into the
node's own work, by its CPU time, and the rest, for which the host is responsible.

A node that the scenario pauses, kills or restarts has no turns meanwhile, so that nobody waits for it.
"""

import json
import math
import mmap
import os
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.timing.clock import NS_PER_S

TOLERANCE_NS = 250_000
"""Largest delay of a turn that does not move the start: the next turn still has half of its half tick."""
SHORTEST_REPORTED_NS = 1_000_000
"""Shortest hold that is listed by itself, one tick; shorter ones only count in the sum."""
LONGEST_HOLD_NS = 10 * NS_PER_S
"""Longest hold; a longer one ends the run."""

MEMORY = Path("/dev/shm")
"""Folder of the shared memory; the temporary folder if it does not exist."""
KEPT_TURNS = 1 << 17
"""Turns whose times are kept: one minute, five times what the recorder's queue can hold."""


PACEMAKER = "pacemaker"
"""Name of the process that gives the turns: the hub of `local`, or one like it."""


class Turn(NamedTuple):
    """A node's turn: its tick, and the time at which it was due on the monotonic clock."""

    tick: int
    due_ns: int


class Takes(NamedTuple):
    """The turns of one member: a process, by its name as of `hil.roster.members`."""

    member: str
    offset_ns: int = 0
    """Simulated time of the turn within its tick."""
    due_ns: int = 0
    """Time within the tick at which the turn is due: later for a second turn at the same simulated time."""
    absent: Sequence[Sequence[int]] = ()
    """Intervals [from, to) of ticks without turns."""

    def has_turn(self, tick: int) -> bool:
        """Whether the member is not absent in this tick."""
        return not any(begin <= tick < end for begin, end in self.absent)


class Plan(NamedTuple):
    """All turns of a run: start on the monotonic clock and period in ns, number of ticks, the members'.

    The members act in the order of `takes` within a tick.
    """

    t0_ns: int
    period_ns: int
    ticks: int
    takes: Sequence[Takes]

    def as_line(self) -> str:
        """The plan as one line of text."""
        return json.dumps(self)

    @classmethod
    def from_line(cls, line: str) -> "Plan":
        """The plan of `as_line`."""
        t0_ns, period_ns, ticks, takes = json.loads(line)
        return cls(t0_ns, period_ns, ticks, [Takes(*one) for one in takes])

    def turns(self) -> Iterator[tuple[int, Takes]]:
        """Yield the turns in order: tick and member; a member may have declined its turn in the meantime."""
        for tick in range(self.ticks):
            for one in self.takes:
                if one.has_turn(tick):
                    yield tick, one


@dataclass(frozen=True, slots=True)
class Hold:
    """An interval in which simulated time stood still at `t_s`, in s; `process` was late."""

    t_s: float
    process: str
    held_s: float
    """The part for which the host is responsible."""
    own_s: float
    """The part that the process's own work, by its CPU time, took beyond its time."""

    @property
    def whole_s(self) -> float:
        """Duration of the hold."""
        return self.held_s + self.own_s

    @property
    def in_words(self) -> str:
        """The hold as text: `plant for 31.0 ms at 1.950 s`."""
        own = f", {1e3 * self.own_s:.1f} ms of them its own work" if self.own_s else ""
        return f"{self.process} for {1e3 * self.whole_s:.1f} ms at {self.t_s:.3f} s{own}"


class Pacemaker:
    """Decides when which turn begins, and counts the holds; reads no clock and sends nothing itself."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._turns = plan.turns()
        self._from_tick: dict[str, float] = {}
        """The tick from which on each member takes its turns again, infinite after its end."""
        self._t0_ns = plan.t0_ns
        self.running: str | None = None
        """The member whose turn has not ended."""
        self.next: str | None = None
        """The member whose turn is next; None after the last turn."""
        self.turn = Turn(-1, plan.t0_ns)
        """The present turn, or the next one while none is running."""
        self.t_ns = 0
        """Simulated time of `turn`."""
        self._begun_ns = self._ended_ns = plan.t0_ns
        self._last: str | None = None
        self._cpu_ns = 0
        self.held_ns = self.own_ns = 0
        self.holds: list[Hold] = []
        self.abandoned: str | None = None
        """The process that was waited for longer than `LONGEST_HOLD_NS`."""
        self._advance()

    def _advance(self) -> None:
        """Find the next turn."""
        self.next = None
        for tick, takes in self._turns:
            if tick >= self._from_tick.get(takes.member, 0):
                break
        else:
            return
        self.next = takes.member
        self.t_ns = tick * self._plan.period_ns + takes.offset_ns
        self.turn = Turn(tick, self._t0_ns + tick * self._plan.period_ns + takes.due_ns)

    @property
    def is_over(self) -> bool:
        """Whether there are no more turns."""
        return self.running is None and self.next is None

    def deadline_ns(self) -> int | None:
        """The time of the next decision: the due time, or the end of patience with the running member."""
        if self.running is not None:
            return self._begun_ns + LONGEST_HOLD_NS
        return None if self.next is None else self.turn.due_ns

    def begin(self, now_ns: int) -> None:
        """Begin the turn that is due; move the start of the run if it is late."""
        late_ns = now_ns - self.turn.due_ns
        if late_ns > TOLERANCE_NS:
            self._hold(late_ns)
        self.running, self._begun_ns = self.next, now_ns

    def _hold(self, late_ns: int) -> None:
        was_late = self._last is not None and self._ended_ns > self.turn.due_ns
        own_ns = 0
        if was_late:
            own_ns = min(late_ns, max(0, self._cpu_ns - (self.turn.due_ns - self._begun_ns)))
        self._t0_ns += late_ns
        self.turn = Turn(self.turn.tick, self.turn.due_ns + late_ns)
        self.held_ns += late_ns - own_ns
        self.own_ns += own_ns
        if late_ns >= SHORTEST_REPORTED_NS or own_ns:
            process = self._last if was_late and self._last is not None else PACEMAKER
            parts_s = (late_ns - own_ns) / NS_PER_S, own_ns / NS_PER_S
            self.holds.append(Hold(self.t_ns / NS_PER_S, process, *parts_s))

    def end(self, now_ns: int, cpu_ns: int = 0, next_tick: int = 0) -> None:
        """End the running turn, in which its member used the CPU for `cpu_ns`.

        The member takes no turn before `next_tick`.
        """
        if self.running is not None:
            self._from_tick[self.running] = max(self._from_tick.get(self.running, 0), next_tick)
        self._last, self._ended_ns, self._cpu_ns = self.running, now_ns, cpu_ns
        self.running = None
        self._advance()

    def leave(self, member: str, now_ns: int) -> None:
        """Give no more turns to a member, whose process has ended."""
        self._from_tick[member] = math.inf
        if all(self._from_tick.get(takes.member) == math.inf for takes in self._plan.takes):
            self.stop()
        elif self.running == member:
            self.end(now_ns)
        elif self.next == member:
            self._advance()

    def stop(self) -> None:
        """Give no more turns."""
        self.running = self.next = None

    def abandon(self) -> None:
        """Give up waiting for the running member, or the run if the pacemaker itself was stopped."""
        self.abandoned = PACEMAKER if self.running is None else self.running
        self.stop()

    def report(self) -> dict[str, Any]:
        """The holds of the run, for its outcome."""
        return {
            "held_s": self.held_ns / NS_PER_S,
            "own_late_s": self.own_ns / NS_PER_S,
            "holds": [asdict(hold) for hold in self.holds],
            "abandoned": self.abandoned,
        }


class TurnTimes:
    """Wall clock and simulated time of each turn's beginning, in memory that pacemaker and recorder share.

    A frame belongs to the last turn that began before it was on the bus, since a turn's frames are sent
    before its end.
    """

    def __init__(self, descriptor: int) -> None:
        self._words = memoryview(mmap.mmap(descriptor, turn_times_bytes())).cast("q")

    def note(self, t_ns: int, wall_ns: int) -> None:
        """Record that the turn at the simulated time `t_ns` begins."""
        words = self._words
        count = words[0]
        place = 1 + 2 * (count % KEPT_TURNS)
        words[place], words[place + 1] = t_ns, wall_ns
        words[0] = count + 1

    def since_start_ns(self, wall_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Convert wall-clock times to simulated times in ns; −1 before the first turn."""
        words: NDArray[np.int64] = np.frombuffer(self._words, np.int64)
        count = int(words[0])
        if count == 0:
            return np.full(wall_ns.shape, -1, np.int64)
        places = np.arange(max(0, count - KEPT_TURNS), count) % KEPT_TURNS
        t_ns, begun_ns = words[1:].reshape(-1, 2)[places].T
        turn = np.searchsorted(np.maximum.accumulate(begun_ns), wall_ns, side="right") - 1
        return np.where(turn < 0, -1, t_ns[np.maximum(turn, 0)])


def turn_times_bytes() -> int:
    """Size of the shared memory."""
    return 8 * (1 + 2 * KEPT_TURNS)


def shared_turn_times() -> int:
    """Make the memory for one run and return its descriptor; it is freed when no process has it open."""
    with tempfile.TemporaryFile(dir=MEMORY if MEMORY.is_dir() else None) as file:
        file.truncate(turn_times_bytes())
        return os.dup(file.fileno())
