"""Worst-case response times: the paper's example, brute force, and the project's own frames."""

import itertools
import json
import random
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import pytest
import typer
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_py.interface.dbc import database
from firmware_py.interface.frame import Frame, worst_case_bits
from firmware_py.interface.generated.kinds import XCP_COMMAND
from hil.bus.model.bits import BitRateError, bit_ns_of, frame_bits
from hil.bus.model.message_set import (
    ONE_ERROR,
    TICK_NS,
    bus_schedule,
    bus_streams,
)
from hil.bus.model.modelled_bus import ModelledBus
from hil.bus.model.schedulability import (
    ERROR_BITS,
    ErrorModel,
    Pacing,
    Stream,
    load,
    response_times,
)
from tools.commands import schedule as command

MS = 1_000_000
TAU = 1


def stream(
    can_id: int,
    period: int,
    transmission: int,
    jitter: int = 0,
    deadline: int | None = None,
    pacing: Pacing | None = None,
) -> Stream:
    deadline = period if deadline is None else deadline
    return Stream(can_id, f"frame {can_id}", "node", 8, period, jitter, deadline, transmission, pacing)


def worst(streams: Sequence[Stream], errors: ErrorModel | None = None) -> list[int | None]:
    return [response.response_ns for response in response_times(streams, TAU, errors)]


PAPER = [
    stream(1, 2_500_000, MS),
    stream(2, 3_500_000, MS, deadline=3_250_000),
    stream(3, 3_500_000, MS, deadline=3_250_000),
]


def test_the_example_that_refuted_the_analysis_of_1994() -> None:
    """Davis et al. 2007, section 3: the second instance of C is the late one."""
    a, b, c = response_times(PAPER, TAU)
    assert (a.response_ns, b.response_ns, c.response_ns) == (2 * MS, 3 * MS, 3_500_000)
    assert (a.in_time, b.in_time, c.in_time) == (True, True, False)
    assert c.instances == 2
    assert load(PAPER) == Fraction(34, 35)
    # The first instance alone, all that the analysis of 1994 looked at, meets its deadline.
    first = served(PAPER, PAPER[2], blocking=0, horizon=MS)
    assert first == 3 * MS <= PAPER[2].deadline_ns


def served(streams: Sequence[Stream], watched: Stream, blocking: int, horizon: int) -> int:
    """Play the bus from its critical instant and return the longest response of `watched`.

    Everything is queued at once and as late as its jitter allows, its successors as early; the bus is first
    taken by a frame of lower priority. A frame queued in the very instant in which the bus falls free takes
    part in the arbitration.
    """
    queue: list[tuple[int, int, int, int, int]] = []
    for index, one in enumerate(streams):
        if one.can_id > watched.can_id:
            continue
        for instance in itertools.count():
            queued = max(0, instance * one.period_ns - one.jitter_ns)
            if queued > horizon:
                break
            tie = 0 if one is not watched else 1
            queue.append((queued, one.can_id, tie, index, instance * one.period_ns - one.jitter_ns))
    queue.sort()
    now, longest = blocking, 0
    while queue:
        ready = [entry for entry in queue if entry[0] <= now]
        if not ready:
            now = queue[0][0]
            continue
        chosen = min(ready, key=lambda entry: (entry[1], entry[2], entry[0]))
        queue.remove(chosen)
        now += streams[chosen[3]].transmission_ns
        if streams[chosen[3]] is watched:
            longest = max(longest, now - chosen[4])
    return longest


@st.composite
def message_sets(draw: st.DrawFn) -> list[Stream]:
    count = draw(st.integers(1, 6))
    streams = []
    for can_id in range(1, count + 1):
        period = draw(st.integers(8, 120))
        jitter = draw(st.integers(0, 2 * period))
        streams.append(stream(can_id, period, draw(st.integers(1, 12)), jitter))
    return streams


@settings(max_examples=200)
@given(streams=message_sets())
def test_the_bound_is_reached_at_the_critical_instant(streams: list[Stream]) -> None:
    """Fixed-point equations against an event-by-event replay: equal, not only greater."""
    for response in response_times(streams, TAU):
        one = response.stream
        if response.response_ns is None:
            assert load([other for other in streams if other.can_id <= one.can_id]) >= 1
            continue
        horizon = response.instances * one.period_ns
        assert response.response_ns == served(streams, one, response.blocking_ns, horizon)


def played(
    streams: Sequence[Stream], dice: random.Random, duration: int, errors: ErrorModel | None = None
) -> dict[int, int]:
    """Play the bus with random phases, gaps, lateness and errors; return the longest responses by identifier.

    A destroyed frame takes its time in vain, and that of the longest error frame.
    """
    arrivals: list[tuple[int, int, Stream]] = []
    for one in streams:
        time, queued = dice.randrange(one.period_ns), 0
        if one.pacing is not None:
            continue
        while time < duration:
            queued = max(queued, time + dice.randint(0, one.jitter_ns))  # late, but in order
            arrivals.append((queued, time, one))
            time += one.period_ns + dice.choice((0, 0, dice.randrange(one.period_ns)))
    for pacing in {one.pacing for one in streams if one.pacing is not None}:
        ready = {one: dice.randrange(one.period_ns) for one in streams if one.pacing == pacing}
        latest = dict.fromkeys(ready, 0)
        for slot in range(dice.randrange(pacing.slot_ns), duration, pacing.slot_ns):
            waiting = [one for one, time in ready.items() if time <= slot]
            if waiting:
                chosen = dice.choice(waiting)
                ready[chosen] = slot + chosen.period_ns
                latest[chosen] = max(latest[chosen], slot + dice.randint(0, chosen.jitter_ns))
                arrivals.append((latest[chosen], slot, chosen))
    arrivals.sort(key=lambda arrival: arrival[0])
    longest = {one.can_id: 0 for one in streams}
    now = 0
    next_errors, to_destroy = dice.randrange(duration), 0
    pending: list[tuple[int, int, Stream]] = []
    while arrivals or pending:
        while arrivals and arrivals[0][0] <= now:
            pending.append(arrivals.pop(0))
        if not pending:
            now = arrivals[0][0]
            continue
        chosen_arrival = min(pending, key=lambda arrival: (arrival[2].can_id, arrival[0]))
        if errors is not None and now >= next_errors:
            next_errors, to_destroy = now + (errors.burst + 1) * errors.gap_ns, errors.burst
        if to_destroy:
            to_destroy -= 1
            now += chosen_arrival[2].transmission_ns + ERROR_BITS * TAU
            continue
        pending.remove(chosen_arrival)
        now += chosen_arrival[2].transmission_ns
        can_id = chosen_arrival[2].can_id
        longest[can_id] = max(longest[can_id], now - chosen_arrival[1])
    return longest


@pytest.mark.parametrize(
    ("streams", "responses"),
    [
        pytest.param(
            [stream(1, 100, 10), stream(1, 100, 10)._replace(sender="other"), stream(2, 100, 10)],
            [30, 30, 30],
            id="two senders of one identifier wait for one another",
        ),
        pytest.param(
            [stream(1, 100, 10, jitter=150), stream(2, 300, 10)],
            [170, 30],
            id="a late stream queues two frames at once",
        ),
        pytest.param(
            [stream(1, 10, 6), stream(2, 10, 5), stream(3, 1000, 1)],
            [11, None, None],
            id="an overload leaves nothing below the priority that fits",
        ),
        pytest.param([stream(1, 10, 10)], [None], id="full load"),
    ],
)
def test_bounds_by_hand(streams: list[Stream], responses: list[int | None]) -> None:
    assert worst(streams) == responses


def test_an_error_costs_its_signalling_and_the_repetition() -> None:
    streams = [stream(1, 1000, 100), stream(2, 1000, 80)]
    assert worst(streams, ErrorModel(burst=1, gap_ns=100_000)) == [
        80 + (ERROR_BITS * TAU + 100) + 100,
        0 + (ERROR_BITS * TAU + 100) + 100 + 80,
    ]
    assert worst(streams, ErrorModel(burst=2, gap_ns=100_000)) == [
        80 + 2 * (ERROR_BITS * TAU + 100) + 100,
        0 + 2 * (ERROR_BITS * TAU + 100) + 100 + 80,
    ]
    error = ERROR_BITS * TAU + 100
    until_sent = error + 100
    assert worst(streams[:1], ErrorModel(burst=1, gap_ns=until_sent + 1)) == [until_sent]
    assert worst(streams[:1], ErrorModel(burst=1, gap_ns=until_sent)) == [
        error + until_sent
    ]  # a second error
    assert worst(streams[:1], ErrorModel(burst=0, gap_ns=100)) == [None]  # errors outrun the bus


def test_paced_frames_take_their_places_one_by_one() -> None:
    pacing = Pacing("node", 50)
    streams = [
        stream(1, 1000, 10, pacing=pacing),
        stream(2, 1000, 12, pacing=pacing),
        stream(3, 1000, 9, pacing=pacing),
        stream(4, 1000, 5),
    ]
    free = [one._replace(pacing=None) for one in streams]
    assert worst(free)[3] == 10 + 12 + 9 + 5
    assert worst(streams)[3] == 12 + 5  # only the longest of them comes in between
    assert load(streams) == load(free)
    crowded = [one._replace(period_ns=100) if one.pacing else one for one in streams]
    # two places of 50 every 100: the two longest take them
    assert load(crowded) == Fraction(10 + 12, 100) + Fraction(5, 1000)


@settings(max_examples=100)
@given(
    streams=message_sets(),
    paced=st.sets(st.integers(1, 6)),
    errors=st.none() | st.builds(ErrorModel, burst=st.integers(1, 2), gap_ns=st.integers(60, 400)),
    seed=st.integers(0, 2**32),
)
def test_no_play_exceeds_the_bound(
    streams: list[Stream], paced: set[int], errors: ErrorModel | None, seed: int
) -> None:
    """Of frames that are free or paced, with and without errors."""
    pacing = Pacing("node", 15)
    streams = [one._replace(pacing=pacing) if one.can_id in paced else one for one in streams]
    longest = played(streams, random.Random(seed), 3000, errors)
    unpaced = worst([one._replace(pacing=None) for one in streams], errors)
    for response, without in zip(response_times(streams, TAU, errors), unpaced, strict=True):
        if response.response_ns is not None:
            assert longest[response.stream.can_id] <= response.response_ns
            assert without is None or response.response_ns <= without


# --- the project's own frames --------------------------------------------------------------------------


def test_every_frame_with_a_sender_is_analysed_with_the_timing_of_the_dbc() -> None:
    streams = bus_streams(1_000_000)
    messages = {message.frame_id: message for message in database().messages}
    assert [one.can_id for one in streams] == sorted(one.can_id for one in streams)
    assert {one.can_id for one in streams} == set(messages) - {0x00D}  # SetInputVelocity: no node sends it
    assert [one.sender for one in streams if one.can_id == 0x002] == ["Operator", "Firmware"]
    assert {one.sender for one in streams} == {"Drive", "Sensors", "Firmware", "Operator"}
    for one in streams:
        message = messages[one.can_id]
        assert one.transmission_ns == 1000 * worst_case_bits(message.length)
        assert one.period_ns % MS == 0
        if message.cycle_time is not None:
            assert one.period_ns == message.cycle_time * MS


def test_what_1_mbit_promises() -> None:
    """Every node's frames all in one tick are too much; one slow frame a tick and node is not."""
    unpaced = [one._replace(pacing=None) for one in bus_streams(1_000_000, is_measured=False)]
    late = [one.stream.name for one in response_times(unpaced, bit_ns_of(1_000_000)) if not one.in_time]
    assert late == ["SetInputTorque", "Accelerometer"]
    paced = bus_schedule(1_000_000)
    assert paced.schedulable
    accelerometer = next(one for one in paced.responses if one.stream.name == "Accelerometer")
    # jitter, blocking, one slow frame of drive and firmware each, the operator's E-stop, three of the tick's
    assert accelerometer.response_ns == 100_000 + 135_000 * 6 + 55_000
    assert bus_schedule(1_000_000, errors=ONE_ERROR).late == ["Accelerometer"]


def test_measurement_delays_no_frame_of_control() -> None:
    """Samples and responses are the least urgent frames of the module; a command is one of the operator's."""
    measured, alone = bus_schedule(1_000_000), bus_schedule(1_000_000, is_measured=False)
    assert alone.load < 0.60
    assert 0.95 < measured.load < 1.0
    assert measured.schedulable
    assert {one.stream.name for one in measured.responses[-2:]} == {"XcpResponse", "XcpSample"}
    bounds = {(one.stream.name, one.stream.sender): one.response_ns for one in measured.responses}
    for one in alone.responses:
        if one.stream.can_id < XCP_COMMAND.can_id:
            assert bounds[one.stream.name, one.stream.sender] == one.response_ns, one.stream.name


@pytest.mark.parametrize("bitrate", [500_000, 250_000])
def test_slower_buses_are_overloaded(bitrate: int) -> None:
    schedule = bus_schedule(bitrate)
    assert not schedule.schedulable
    assert schedule.load > 1


def test_only_slow_frames_are_paced() -> None:
    for one in bus_streams(1_000_000):
        assert (one.pacing is not None) == (one.period_ns > TICK_NS)


@pytest.mark.parametrize("bitrate", [0, -1, 300_000, 999_999, 2_000_000])
def test_an_odd_bit_rate_is_refused(bitrate: int) -> None:
    with pytest.raises(BitRateError, match="wanted 10000 to 1000000"):
        bus_schedule(bitrate)


BIT_NS = 1000


def stuffed_most(stream: Stream, dice: random.Random) -> Frame:
    """A long frame of this identifier and length."""
    pieces = [b"\x01", b"\x0f", b"\x07", b"\x1e", b"\x87", b"\xe1", b"\x78", b"\x3c"]
    frames = [
        Frame(stream.can_id, b"".join(dice.choice(pieces) for _ in range(stream.length))) for _ in range(400)
    ]
    return max(frames, key=frame_bits)


def test_the_critical_instant_reaches_the_bound() -> None:
    """All frames at once, one bit after the longest less urgent one has begun: the bound for frames of
    exactly these lengths, less that bit. Of streams that share an identifier one is played, since for both
    together the bound is safe, not exact."""
    streams = [stream._replace(jitter_ns=0, pacing=None) for stream in bus_streams(1_000_000)]
    streams = list({stream.can_id: stream for stream in reversed(streams)}.values())
    names = sorted({stream.sender for stream in streams})
    dice = random.Random(5)
    frames = {stream.can_id: stuffed_most(stream, dice) for stream in streams}
    exact = [
        stream._replace(transmission_ns=frame_bits(frames[stream.can_id]) * BIT_NS) for stream in streams
    ]
    for bound in response_times(exact, BIT_NS):
        watched = bound.stream
        less_urgent = [frames[stream.can_id] for stream in streams if stream.can_id > watched.can_id]
        bus = ModelledBus([*names, "less urgent", "listener"])
        if less_urgent:
            bus.submit("less urgent", max(less_urgent, key=frame_bits), 0)
        longest_ns = 0
        queued_ns: list[int] = []
        for tick in range(8):
            now_ns = BIT_NS + tick * TICK_NS
            for arrived in bus.deliver(now_ns):
                if arrived.frame.can_id == watched.can_id and arrived.sender != "less urgent":
                    longest_ns = max(longest_ns, arrived.t_ns + 3 * BIT_NS - queued_ns.pop(0))
            for stream in streams:
                if tick * TICK_NS % stream.period_ns == 0:
                    bus.submit(stream.sender, frames[stream.can_id], now_ns)
                    queued_ns += [now_ns] * (stream.can_id == watched.can_id)
        assert bound.response_ns is not None
        assert longest_ns == bound.response_ns - (BIT_NS if less_urgent else 0)


# --- the command -----------------------------------------------------------------------------------------


def run(*arguments: str) -> int:
    app = typer.Typer()
    app.command()(command.schedule)
    return app(list(arguments), standalone_mode=False) or 0


@pytest.mark.parametrize("bitrate", [1_000_000, 500_000])
def test_the_command_prints_one_object_and_fails_with_the_schedule(
    bitrate: int, capsys: pytest.CaptureFixture[str]
) -> None:
    status = run("--json", "--bitrate", str(bitrate))
    printed = json.loads(capsys.readouterr().out)
    expected = bus_schedule(bitrate)
    assert status == (0 if expected.schedulable else 1)
    assert printed["passed"] == expected.schedulable
    assert printed["late"] == expected.late
    assert len(printed["frames"]) == len(expected.responses)
    assert {other["bitrate"] for other in printed["others"]} == {1_000_000, 500_000, 250_000} - {bitrate}
    for row, response in zip(printed["frames"], expected.responses, strict=True):
        if response.response_ns is None:
            assert row["response_s"] is None
        else:
            assert row["response_s"] == pytest.approx(response.response_ns * 1e-9)
            assert row["slack_s"] == pytest.approx(row["deadline_s"] - row["response_s"])


def test_the_command_prints_a_table(capsys: pytest.CaptureFixture[str]) -> None:
    run("--bitrate", "250000")
    printed = capsys.readouterr().out
    assert "Accelerometer" in printed
    assert "inf" in printed
    assert "1000000" in printed


def test_the_page_states_the_load_of_two_modules(capsys: pytest.CaptureFixture[str]) -> None:
    page = (Path(__file__).parents[4] / "docs/how-to/own-adapter.md").read_text("utf-8")
    assert "vibrohil schedule --module 0,2 --module 1,5" in page
    assert run("--module", "0,2", "--module", "1,5", "--json") == 1
    printed = json.loads(capsys.readouterr().out)
    loads = (printed["load"], printed["without_xcp"]["load"])
    assert "load the bus with {:.0%}, without XCP with {:.0%}".format(*loads).replace("%", " %") in (
        " ".join(page.split())
    )
