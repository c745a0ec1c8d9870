"""The pacemaker: the order of turns, holds by the host and by a node's own work, and the times of frames."""

import json
import os
import threading
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from hil.bus.hub_socket import TurnSocket
from hil.bus.opening import ProvidedBus, provide
from hil.roster import FIRMWARE, OPERATOR, PLANT
from hil.timing.loop import LoopTiming, run_turns
from hil.timing.pacemaker import (
    KEPT_TURNS,
    LONGEST_HOLD_NS,
    PACEMAKER,
    TOLERANCE_NS,
    Hold,
    Pacemaker,
    Plan,
    Takes,
    TurnTimes,
    shared_turn_times,
)

MS = 1_000_000
T0 = 1_000 * MS
TAKES = (Takes(PLANT), Takes(OPERATOR, 0, MS // 4), Takes(FIRMWARE, MS // 2, MS // 2))


def plan(ticks: int = 4, takes: tuple[Takes, ...] = TAKES) -> Plan:
    return Plan(T0, MS, ticks, takes)


def play(
    pacemaker: Pacemaker, work: Callable[[str, int], tuple[int, int]] = lambda *_: (20_000, 20_000)
) -> list[tuple[str, int, int]]:
    """All turns as member, tick and time of beginning; `work` gives a turn's duration and CPU time in ns."""
    now_ns, turns = T0 - MS, []
    while pacemaker.next is not None:
        now_ns = max(now_ns, pacemaker.turn.due_ns)
        member, tick = pacemaker.next, pacemaker.turn.tick
        pacemaker.begin(now_ns)
        turns.append((member, tick, now_ns))
        lasted_ns, cpu_ns = work(member, tick)
        now_ns += lasted_ns
        pacemaker.end(now_ns, cpu_ns, tick + (10 if member == OPERATOR else 1))
    return turns


def test_turns_come_in_the_order_of_lockstep_and_when_they_are_due() -> None:
    assert play(Pacemaker(plan(2))) == [
        (PLANT, 0, T0),
        (OPERATOR, 0, T0 + MS // 4),
        (FIRMWARE, 0, T0 + MS // 2),
        (PLANT, 1, T0 + MS),
        (FIRMWARE, 1, T0 + 3 * MS // 2),
    ]


def test_a_member_that_declines_its_turns_has_none_before_the_tick_it_names() -> None:
    ticks = [tick for member, tick, _ in play(Pacemaker(plan(25))) if member == OPERATOR]
    assert ticks == [0, 10, 20]


def test_a_stall_moves_all_later_turns_by_itself_and_is_the_hosts() -> None:
    pacemaker = Pacemaker(plan(3))
    turns = play(
        pacemaker, lambda member, tick: (31 * MS if (member, tick) == (PLANT, 1) else 20_000, 20_000)
    )
    assert turns[-1] == (FIRMWARE, 2, T0 + 2 * MS + MS // 2 + 31 * MS - MS // 2)
    assert pacemaker.holds == [Hold(0.0015, "plant", pytest.approx(0.0305), 0.0)]
    assert (pacemaker.held_ns, pacemaker.own_ns) == (31 * MS - MS // 2, 0)


def test_a_nodes_own_work_is_distinguished_from_the_host_by_its_cpu_time() -> None:
    pacemaker = Pacemaker(plan(3))
    slow = {(FIRMWARE, 1): (3 * MS, 3 * MS // 2)}  # 1.5 ms of work, and 1.5 ms without the CPU
    play(pacemaker, lambda member, tick: slow.get((member, tick), (20_000, 20_000)))
    assert pacemaker.holds == [Hold(0.002, "firmware", pytest.approx(0.0015), pytest.approx(0.001))]


def test_a_turn_that_is_hardly_late_moves_nothing() -> None:
    pacemaker = Pacemaker(plan(2))
    turns = play(pacemaker, lambda member, _: (MS // 2 + TOLERANCE_NS if member == FIRMWARE else 0, 0))
    assert turns[3] == (PLANT, 1, T0 + MS + TOLERANCE_NS)
    assert turns[4] == (FIRMWARE, 1, T0 + 3 * MS // 2)
    assert pacemaker.holds == []


def test_a_pause_of_the_scenario_and_a_member_that_ended_are_not_waited_for() -> None:
    takes = (Takes(PLANT, absent=[(1, 3)]), Takes(FIRMWARE, MS // 2, MS // 2))
    pacemaker = Pacemaker(plan(4, takes))
    pacemaker.begin(T0)
    pacemaker.leave(FIRMWARE, T0)
    pacemaker.end(T0 + 1, 0)
    assert (pacemaker.next, pacemaker.turn.tick) == (PLANT, 3)
    pacemaker.begin(pacemaker.turn.due_ns)
    pacemaker.leave(PLANT, pacemaker.turn.due_ns)
    assert pacemaker.is_over
    assert pacemaker.report()["holds"] == []


def test_an_hours_turns_are_not_walked_through_once_all_members_have_ended() -> None:
    asked: list[int] = []

    class Watched(Plan):
        def turns(self) -> Iterator[tuple[int, Takes]]:
            for tick, takes in super().turns():
                asked.append(tick)
                yield tick, takes

    pacemaker = Pacemaker(Watched(T0, *plan(ticks=3_600_000)[1:]))
    for takes in TAKES:
        pacemaker.leave(takes.member, T0)
    assert pacemaker.is_over
    assert max(asked) <= 1


def test_the_member_that_is_waited_for_in_vain_is_named() -> None:
    pacemaker = Pacemaker(plan())
    pacemaker.begin(T0)
    assert pacemaker.deadline_ns() == T0 + LONGEST_HOLD_NS
    pacemaker.abandon()
    assert (pacemaker.is_over, pacemaker.report()["abandoned"]) == (True, "plant")
    stopped = Pacemaker(plan())
    stopped.abandon()
    assert stopped.abandoned == PACEMAKER


def test_a_plan_is_the_same_after_it_was_sent() -> None:
    sent = plan(7, (Takes(PLANT, absent=[[1, 2]]), Takes(FIRMWARE, 5, 6, [])))
    assert Plan.from_line(sent.as_line()).takes == list(sent.takes)


@pytest.fixture
def descriptor() -> Iterator[int]:
    descriptor = shared_turn_times()
    yield descriptor
    os.close(descriptor)


def test_a_frame_belongs_to_the_last_turn_that_began_before_it(descriptor: int) -> None:
    pacemaker, recorder = TurnTimes(descriptor), TurnTimes(descriptor)
    stamps = np.array([900, 1000, 1499, 1500, 99_000])
    np.testing.assert_array_equal(recorder.since_start_ns(stamps), [-1] * 5)
    pacemaker.note(0, 1000)
    pacemaker.note(MS // 2, 1500)
    np.testing.assert_array_equal(recorder.since_start_ns(stamps), [-1, 0, 0, MS // 2, MS // 2])


def test_the_memory_of_turns_holds_the_newest(descriptor: int) -> None:
    times = TurnTimes(descriptor)
    for turn in range(KEPT_TURNS + 10):
        times.note(turn, 1000 * turn)
    newest = KEPT_TURNS + 9
    np.testing.assert_array_equal(times.since_start_ns(np.array([1000 * newest - 1])), [newest - 1])


@pytest.fixture
def local(descriptor: int) -> Iterator[ProvidedBus]:
    with provide("local", descriptor) as provided:
        yield provided


def burn(cpu_s: float) -> None:
    until_s = time.thread_time() + cpu_s
    while time.thread_time() < until_s:
        """Work."""


def test_the_hub_gives_the_turns_and_reports_work_planted_in_a_tick(local: ProvidedBus) -> None:
    order: list[tuple[int, str]] = []
    timings: list[LoopTiming] = []
    assert local.turns is not None
    assert local.pacemaker is not None

    def node(member: str, socket: TurnSocket) -> None:
        def step(tick: int) -> int:
            order.append((tick, member))
            if (member, tick) == (FIRMWARE, 50):
                burn(0.0015)
            return tick + 1

        run_turns(socket, step, lambda tick, timing: timings.append(timing) if tick == 50 else None)

    sockets = [TurnSocket(local.turns, member) for member in (PLANT, OPERATOR, FIRMWARE)]
    threads = [
        threading.Thread(target=node, args=(member, socket))
        for member, socket in zip((PLANT, OPERATOR, FIRMWARE), sockets, strict=True)
    ]
    for thread in threads:
        thread.start()
    local.pacemaker.tell(plan(100)._replace(t0_ns=time.monotonic_ns() + 50 * MS).as_line())
    for thread in threads:
        thread.join(30.0)
    for socket in sockets:
        socket.close()
    assert order == [(tick, member) for tick in range(100) for member in (PLANT, OPERATOR, FIRMWARE)]
    assert max(timing.cpu_us for timing in timings) >= 1500.0
    local.close()
    said = json.loads(local.said)
    planted = [hold for hold in said["holds"] if hold["process"] == "firmware" and hold["t_s"] == 0.051]
    assert [hold["own_s"] > 0.0008 for hold in planted] == [True]
