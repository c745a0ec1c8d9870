"""Faults one by one, each against what it is to do; then a whole run with one of each place."""

import math
import signal
import time
from collections.abc import Iterable
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import numpy as np
import pytest
from pydantic import TypeAdapter
from run_folder import make_run, write_run

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisError, AxisState
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import (
    Accelerometer,
    DriveSupply,
    EncoderEstimates,
    SetAxisState,
    SetInputTorque,
)
from firmware_py.shell.parameters import DEFAULTS, ParameterError, format_file, parse_file
from hil.drive.axis import is_armed
from hil.faults.every import AnyFault
from hil.faults.fault import Fault
from hil.faults.kinds.delayed import Delayed
from hil.faults.kinds.encoder_wrap import EncoderWrap
from hil.faults.kinds.phase_loss import PhaseLoss
from hil.faults.line import FaultyBus, TrafficError
from hil.faults.on_bus import Step
from hil.faults.plant import SensorFaults
from hil.faults.processes import ProcessFaults, in_turns
from hil.figures.figures import figures_of
from hil.nodes.firmware.runner import ParameterMemory
from hil.nodes.plant.node import PlantNode
from hil.record.run_faults import RunFault
from hil.record.traces import trace
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.scenario.files import ScenarioError, read_scenario
from hil.scenario.scenario import check_scenario, refuse_modelled_bus
from hil.scenario.settings import apply_settings
from hil.timing.loop import LoopTiming
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import load_scene
from plant_sim.sensors.readings import SensorReading

ARM = codec.encode(SetAxisState(AxisState.CLOSED_LOOP_CONTROL))
READING = SensorReading(10.0, 10.5, 0.25, 0.75, 2.0)


def fault(kind: str, at_s: float = 0.005, **more: Any) -> Fault:
    made: Fault = TypeAdapter(AnyFault).validate_python({"kind": kind, "at_s": at_s, **more})
    return made


class Wire:
    """A bus that keeps what is sent."""

    def __init__(self) -> None:
        self.sent: list[Frame] = []

    def send_all(self, frames: Any) -> None:
        self.sent += frames

    def receive(self) -> list[Frame]:
        return [Frame(0x123, b"")]

    def wait(self, timeout_s: float) -> None:
        raise AssertionError


def sample(number: int) -> Frame:
    return codec.ACCELEROMETER.encode(Accelerometer(number * 0.1, 0.0, 0.0), number % 16)


def passed(broken: Fault, ticks: int = 20, node: str = "plant") -> list[list[Frame]]:
    """What leaves a node that sends a sample and an empty frame 0x7F0 in each tick of 1 ms."""
    wire = Wire()
    bus = FaultyBus(wire, node, [broken], seed=1, period_s=1e-3)
    sent = []
    for tick in range(ticks):
        bus.move_to(tick * 1e-3)
        bus.send_all([sample(tick), Frame(0x7F0, b"")])
        sent.append(wire.sent)
        wire.sent = []
    return sent


def samples(sent: list[list[Frame]]) -> list[tuple[int, int]]:
    """(tick sent in, tick made in) of each sample."""
    number = {sample(tick): tick for tick in range(len(sent))}
    return [(tick, number[frame]) for tick, frames in enumerate(sent) for frame in frames if frame in number]


def test_a_node_that_starts_on_a_bus_on_which_frames_never_cease_begins_in_spite_of_them() -> None:
    starting = Thread(target=FaultyBus(Wire(), "plant", [], seed=1, period_s=1e-3).restart, daemon=True)
    starting.start()
    starting.join(2.0)
    assert not starting.is_alive()


FRAMES = {"frames": ["Accelerometer"]}


def each(ticks: Iterable[int], late: int = 0) -> list[tuple[int, int]]:
    """A sample of each tick, sent that much later."""
    return [(tick + late, tick) for tick in ticks]


@pytest.mark.parametrize(
    ("kind", "keys", "expected"),
    [
        ("dropped", {"duration_s": 0.01}, each([*range(5), *range(15, 20)])),
        ("duplicated", {"copies": 3}, [*each(range(5)), *sorted(3 * each(range(5, 20)))]),
        (
            "delayed",  # each by as much, and all that are still held at the fault's end
            {"duration_s": 0.01, "delay_s": 0.004},
            [
                *each(range(5)),
                *each(range(5, 11), 4),
                *((15, made) for made in range(11, 16)),
                *each(range(16, 20)),
            ],
        ),
        (
            "frozen",  # with the counter of the first
            {"duration_s": 0.006},
            [*each(range(5)), *((tick, 5) for tick in range(5, 11)), *each(range(11, 20))],
        ),
        ("thinned", {"duration_s": 0.01, "period_s": 0.004}, each([*range(6), 9, 13, *range(15, 20)])),
        (
            "reordered",  # in pairs, the later one first
            {"duration_s": 0.006},
            [*each(range(5)), (6, 6), (6, 5), (8, 8), (8, 7), (10, 10), (10, 9), *each(range(11, 20))],
        ),
    ],
)
def test_when_samples_leave(kind: str, keys: dict[str, Any], expected: list[tuple[int, int]]) -> None:
    sent = passed(fault(kind, **keys, **FRAMES))
    assert samples(sent) == expected
    assert all(Frame(0x7F0, b"") in frames for frames in sent), "other frames pass"


def test_a_share_is_dropped_at_random() -> None:
    assert 600 < len(samples(passed(fault("dropped", at_s=0.0, share=0.3, **FRAMES), 1000))) < 800


def test_corrupted_frames_have_one_byte_wrong_and_fail_their_checksum() -> None:
    sent = [frames[0] for frames in passed(fault("corrupted", **FRAMES), 200)]
    for tick, frame in enumerate(sent):
        wrong = sum(one != other for one, other in zip(frame.data, sample(tick).data, strict=True))
        assert wrong == (0 if tick < 5 else 1)
        if wrong:
            with pytest.raises(codec.FrameError):
                codec.ACCELEROMETER.decode(frame.data)


@pytest.mark.parametrize(("period_s", "expected"), [(0.25e-3, 57), (3e-3, 5)])
def test_a_foreign_node_babbles_at_its_period_and_the_plant_receives_it_too(
    period_s: float, expected: int
) -> None:
    babble = fault("babbling", can_id=0x0E, data_hex="00ff", period_s=period_s)
    foreign = Frame(0x0E, b"\x00\xff")
    assert sum(frames.count(foreign) for frames in passed(babble)) == expected
    assert not any(foreign in frames for frames in passed(babble, node="firmware"))
    wire = Wire()
    bus = FaultyBus(wire, "plant", [babble], seed=1, period_s=1e-3)
    bus.move_to(0.005)
    assert bus.receive() == [foreign, Frame(0x123, b"")]
    assert bus.receive() == [Frame(0x123, b"")]
    bus.move_to(1.005)
    assert bus.receive().count(foreign) <= 4, "what was due while the plant was away does not come at once"


def test_a_flood_comes_on_every_identifier_with_any_length() -> None:
    frames = [frame for sent in passed(fault("flood", at_s=0.0, frames_a_tick=100), 300) for frame in sent]
    foreign = [frame for frame in frames if frame.can_id not in (0x028, 0x7F0)]
    assert len({frame.can_id for frame in foreign}) == 0x800 - 2
    assert {len(frame.data) for frame in foreign} == set(range(9))


@pytest.mark.parametrize("node", ["plant", "firmware"])
def test_an_unplugged_node_neither_sends_nor_receives(node: str) -> None:
    wire = Wire()
    bus = FaultyBus(wire, node, [fault("unplugged", node="plant", duration_s=0.01)], seed=1, period_s=1e-3)
    for t_s, plugged in ((0.0049, True), (0.005, node != "plant"), (0.0149, node != "plant"), (0.015, True)):
        bus.move_to(t_s)
        bus.send_all([sample(1)])
        assert bool(wire.sent) == bool(bus.receive()) == plugged
        wire.sent = []


@pytest.mark.parametrize(
    ("kind", "more", "changes"),
    [
        (
            "sensor-biased",
            {"sensor": "striker", "bias": 1.5},
            {"striker_low_m_s2": 11.5, "striker_high_m_s2": 12.0},
        ),
        ("sensor-biased", {"sensor": "encoder", "bias": math.pi}, {"encoder_position_rev": 0.25}),
        ("sensor-clipped", {"sensor": "striker-high", "limit_m_s2": 10.2}, {"striker_high_m_s2": 10.2}),
        (
            "sensor-wrong-sign",
            {"sensor": "encoder"},
            {"encoder_position_rev": 0.25, "encoder_velocity_rev_s": -2.0},
        ),
        ("sensor-wrong-sign", {"sensor": "striker-low"}, {"striker_low_m_s2": -10.0}),
        ("sensor-intermittent", {"sensor": "housing", "share": 1.0}, {"housing_m_s2": 0.0}),
        ("encoder-slip", {"slip_rev": 0.5}, {"encoder_position_rev": 0.25}),
        (
            "sensor-drifting",
            {"sensor": "housing", "rate": 2.0},
            {"housing_m_s2": READING.housing_m_s2 + 2e-3},
        ),
        (
            "sensor-swapped",
            {"sensors": ["striker-low", "housing"]},
            {"striker_low_m_s2": READING.housing_m_s2, "housing_m_s2": READING.striker_low_m_s2},
        ),
    ],
)
def test_what_a_broken_sensor_gives(kind: str, more: dict[str, Any], changes: dict[str, float]) -> None:
    sensors = SensorFaults([fault(kind, **more)], seed=1)
    assert sensors.published(0.004, READING) == READING
    assert sensors.published(0.005, READING) == pytest.approx(READING._replace(**changes))


def test_a_drift_grows_and_begins_anew_with_its_process() -> None:
    drift = fault("sensor-drifting", sensor="striker-low", rate=3.0, duration_s=0.1)
    for _ in range(2):
        sensors = SensorFaults([drift], seed=1)
        given = [sensors.published(k * 1e-3, READING).striker_low_m_s2 for k in range(105)]
        assert given[4] == READING.striker_low_m_s2
        assert given[54] == pytest.approx(READING.striker_low_m_s2 + 3.0 * 0.05)


def test_a_stuck_sensor_repeats_its_last_reading_until_it_is_well() -> None:
    sensors = SensorFaults([fault("sensor-stuck", sensor="striker", duration_s=0.01)], seed=1)
    given = [sensors.published(k * 1e-3, READING._replace(striker_low_m_s2=float(k))) for k in range(20)]
    assert [one.striker_low_m_s2 for one in given] == [*range(5), *[4.0] * 10, *range(15, 20)]


def test_a_slow_sensor_lags_by_its_time_constant() -> None:
    sensors = SensorFaults([fault("sensor-slow", sensor="striker-low", lag_s=0.01)], seed=1)
    for tick in range(5):
        sensors.published(tick * 1e-3, READING._replace(striker_low_m_s2=0.0))
    lows = [sensors.published(tick * 1e-3, READING).striker_low_m_s2 for tick in range(5, 60)]
    assert lows[:20] == pytest.approx([10.0 * -math.expm1(-0.1 * (k + 1)) for k in range(20)])
    assert lows[-1] == pytest.approx(10.0, abs=0.1)


def test_a_slow_encoder_lags_on_the_circle() -> None:
    sensors = SensorFaults([fault("sensor-slow", sensor="encoder", lag_s=0.02)], seed=1)
    turned = [
        sensors.published(
            k * 1e-3, READING._replace(encoder_position_rev=0.002 * k % 1.0, encoder_velocity_rev_s=2.0)
        )
        for k in range(2000)
    ]
    behind = [(0.002 * k - one.encoder_position_rev) % 1.0 for k, one in enumerate(turned)]
    # 2 rev/s times 20 ms, less what half of a tick's hold gives back.
    assert behind[300:] == pytest.approx([0.039] * 1700, abs=2e-4)
    assert {round(one.encoder_velocity_rev_s, 9) for one in turned} == {2.0}


def test_noise_has_its_spread() -> None:
    sensors = SensorFaults([fault("sensor-noisy", at_s=0.0, sensor="striker-low", std=2.0)], seed=1)
    lows = [sensors.published(k * 1e-3, READING).striker_low_m_s2 for k in range(4000)]
    assert np.std(lows) == pytest.approx(2.0, rel=0.05)
    assert np.mean(lows) == pytest.approx(10.0, abs=0.15)


def test_a_lost_phase_leaves_half_of_the_torque_on_average() -> None:
    lost = fault("phase-loss")
    assert isinstance(lost, PhaseLoss)
    shares = [lost.given_n_m(1.0, 7, angle) for angle in np.linspace(0.0, 2.0 * math.pi, 10_000)]
    assert np.mean(shares) == pytest.approx(0.5, abs=1e-3)
    assert (min(shares), max(shares)) == pytest.approx((0.0, 1.0), abs=1e-3)


def driven(broken: Fault, ticks: int, torque_n_m: float = 0.1) -> tuple[PlantNode, list[Frame]]:
    """A plant whose drive is asked for a torque in each tick, and what it has sent."""
    node = PlantNode(load_scene("table1-motor-soft"), seed=1, faults=[broken])
    sent = []
    for tick in range(ticks):
        sent += node.publish()
        command = codec.encode(SetInputTorque(torque_n_m))
        node.advance([ARM, command] if tick == 0 else [command])
    return node, sent


def test_a_phase_that_is_lost_after_the_watchdog_has_expired_in_a_pause_has_no_effect() -> None:
    lost = fault("phase-loss", at_s=0.15)
    node, _ = driven(lost, ticks=10)
    node.sleep_through(300, [])
    assert lost.effects == 0


def test_a_jammed_crank_stands_and_a_free_one_turns_on() -> None:
    jammed, _ = driven(fault("motor-stall", at_s=0.1), 200)
    assert jammed.record.omega_rad_s == 0.0
    freed, _ = driven(fault("motor-stall", at_s=0.1, duration_s=0.05), 300)
    assert freed.record.omega_rad_s > 5.0


def test_a_hot_winding_disarms_the_drive() -> None:
    warm, _ = driven(fault("over-temperature", motor_degc=99.0), 50)
    hot, _ = driven(fault("over-temperature", motor_degc=101.0), 50)
    assert (is_armed(warm.drive), is_armed(hot.drive)) == (True, False)
    assert hot.drive.axis.disarm_reason == AxisError.MOTOR_OVER_TEMP


def test_a_sagging_supply_is_reported_and_in_the_end_disarms_the_drive() -> None:
    low, sent = driven(fault("supply-sag", supply_v=15.0), 300)
    supplies = [codec.decode(frame) for frame in sent if frame.can_id == codec.DRIVE_SUPPLY.can_id]
    assert [supply.voltage_v for supply in supplies] == [24.0, 15.0, 15.0]
    assert isinstance(supplies[0], DriveSupply)
    assert is_armed(low.drive)
    dead, _ = driven(fault("supply-sag", supply_v=8.0), 50)
    assert dead.drive.axis.disarm_reason == AxisError.DC_BUS_UNDER_VOLTAGE


def test_a_drive_without_supply_is_silent_and_starts_anew_at_rest() -> None:
    node, sent = driven(fault("brown-out", at_s=0.02, duration_s=0.1), 200)
    encoders = [frame for frame in sent if frame.can_id == codec.ENCODER_ESTIMATES.can_id]
    assert len(encoders) == 100
    assert sum(frame.can_id == codec.ACCELEROMETER.can_id for frame in sent) == 200
    assert node.drive.axis.state == AxisState.IDLE
    assert node.record.motor_torque_n_m == 0.0


def test_a_count_of_turns_runs_on_and_wraps_round() -> None:
    counter = fault("encoder-wrap", count_rev=6, wraps_at_rev=8)
    assert isinstance(counter, EncoderWrap)
    counter.strike(Plant(load_scene("table1-motor-soft"), seed=1), powered_up_s=0.0)

    def counted(quarters: Iterable[int]) -> list[float]:
        circular = (EncoderEstimates(0.25 * quarter % 1.0, 0.0) for quarter in quarters)
        return [counter.reported(one).position_rev for one in circular]

    forwards = counted(range(14))
    assert forwards == [6.0, 6.25, 6.5, 6.75, 7.0, 7.25, 7.5, 7.75, -8.0, -7.75, -7.5, -7.25, -7.0, -6.75]
    assert counted(range(12, 6, -1)) == [-7.0, -7.25, -7.5, -7.75, -8.0, 7.75]


def test_a_drive_counts_on_for_as_long_as_it_does() -> None:
    _, sent = driven(fault("encoder-wrap", at_s=0.05, duration_s=0.1, count_rev=1000), 300)
    estimates = [codec.decode(frame) for frame in sent if frame.can_id == codec.ENCODER_ESTIMATES.can_id]
    positions = [estimate.position_rev for estimate in estimates]
    assert max(positions[:50] + positions[150:]) < 1.0
    assert positions[50] >= 1000.0
    assert positions[50:150] == sorted(positions[50:150])


def test_processes_are_killed_paused_and_restarted_by_signals() -> None:
    killed = fault("killed", at_s=2.0, process="plant")
    paused = fault("paused", at_s=1.0, duration_s=0.5, process="firmware")
    restarted = fault("restarted", at_s=0.2, duration_s=0.5, process="plant")
    processes = ProcessFaults([killed, paused, restarted])
    assert processes.signals() == [
        (0.2, "plant", signal.SIGKILL),
        (1.0, "firmware", signal.SIGSTOP),
        (1.5, "firmware", signal.SIGCONT),
        (2.0, "plant", signal.SIGKILL),
    ]
    assert processes.restarts() == [(0.2, "plant", 0.7)]
    assert [processes.runs("firmware", t_s) for t_s in (0.999, 1.0, 1.499, 1.5)] == [True, False, False, True]
    runs = [processes.runs("plant", t_s) for t_s in (0.199, 0.2, 0.699, 0.7, 1.999, 2.0, 9.0)]
    assert runs == [True, False, False, True, True, False, False]
    assert processes.kills("plant")
    assert not processes.kills("firmware")


class Steps:
    """A runner that notes what it is called with."""

    def __init__(self) -> None:
        self.steps: list[int] = []
        self.records: list[int] = []
        self.restarts: list[int] = []

    def step(self, tick: int) -> None:
        self.steps.append(tick)

    def record(self, tick: int, _: object) -> None:
        self.records.append(tick)

    def restart(self, tick: int) -> None:
        self.restarts.append(tick)

    def close(self) -> None:
        raise AssertionError


def turned(slots: range, *faults: Fault) -> tuple[Steps, list[list[int]]]:
    """The firmware's turns in each slot of 1 ms."""
    steps = Steps()
    turns = in_turns(steps, "firmware", faults, 1e-3, 1)
    a_slot = []
    for slot in slots:
        already = len(steps.steps)
        turns.step(slot)
        turns.record(slot, LoopTiming(0, 0.0, 0.0, 0))
        a_slot.append(steps.steps[already:])
    assert steps.records == steps.steps
    return steps, a_slot


def test_a_clock_that_leaps_ahead_skips_once_and_never_replays() -> None:
    _, turns = turned(range(20), fault("clock-jumped", at_s=0.01, by_s=1.0))
    assert turns[9:12] == [[9], [1010], [1011]]
    assert all(len(slot) == 1 for slot in turns)


def test_a_clock_that_falls_back_sleeps_until_its_time_has_come_again() -> None:
    _, turns = turned(range(40), fault("clock-jumped", at_s=0.01, by_s=-0.02))
    assert [slot for slot, steps in enumerate(turns) if not steps] == list(range(10, 30))
    assert turns[29:32] == [[], [10], [11]]


def test_jitter_delays_turns_and_skips_what_it_must_with_no_tick_twice() -> None:
    steps, turns = turned(range(2000), fault("clock-jitter", at_s=0.0, process="firmware", largest_s=0.0025))
    assert steps.steps == sorted(set(steps.steps))
    assert {0, 1, 2} == {len(slot) for slot in turns}
    assert {later - tick for tick, later in pairwise(steps.steps)} == {1, 2, 3}
    small, _ = turned(range(2000), fault("clock-jitter", at_s=0.0, process="firmware", largest_s=0.0004))
    assert small.steps == [*range(2000)]


@pytest.mark.parametrize("by_s", [0.05, -0.004])
def test_jitter_acts_at_its_own_time_after_a_jump_that_has_ended(by_s: float) -> None:
    leapt = fault("clock-jumped", at_s=0.01, duration_s=0.01, by_s=by_s)
    shaken = fault("clock-jitter", at_s=0.2, duration_s=0.05, process="firmware", largest_s=0.0025)
    _, turns = turned(range(400), leapt, shaken)
    late = [slot for slot, steps in enumerate(turns) if slot >= 100 and steps != [slot]]
    assert 200 <= min(late) < 205
    assert 245 < max(late) < 253


def test_a_restarted_node_is_made_anew_and_begins_at_its_tick() -> None:
    again = fault("restarted", at_s=0.005, duration_s=0.1, process="firmware")
    steps, turns = turned(range(105, 110), again)
    assert steps.restarts == [105]
    assert turns[:2] == [[105], [106]]
    assert in_turns(steps, "plant", [again], 1e-3, 1) is steps


def test_another_digit_is_damage_that_is_found() -> None:
    for seed in range(200):
        memory = ParameterMemory({}, [fault("parameters-damaged", at_s=1.0)], seed)
        assert parse_file(memory.read(0.5)) == DEFAULTS
        damaged = memory.read(1.0)
        assert sum(one != other for one, other in zip(damaged, format_file(DEFAULTS), strict=True)) == 1
        with pytest.raises(ParameterError):
            parse_file(damaged)


def test_a_record_names_the_frames_that_its_fault_is_limited_to() -> None:
    lost = fault("dropped", at_s=1.0, frames=["Accelerometer", "GaitSensors"])
    assert lost.as_record().frames == ("Accelerometer", "GaitSensors")
    assert fault("kick", at_s=1.0, change_m_s=1.0).as_record().frames == ()


@pytest.mark.parametrize(
    ("peaks_n", "expected_n"), [([90.0, 140.0], 140.0), ([90.0], 0.0), ([90.0, math.nan], None)]
)
def test_the_force_after_a_fault_is_that_of_impacts_after_it(
    tmp_path: Path, peaks_n: list[float], expected_n: float | None
) -> None:
    made_up = make_run()
    made_up.run["faults"] = [RunFault("kick", "plant", False, 3.0, 3.0, "kick")._asdict()]
    at_s = np.array([2.5, 3.5])[: len(peaks_n)]
    made_up.impacts.clear()
    made_up.impacts.update(
        {name: np.ones(len(at_s)) for name in Impact._fields}
        | {"t_s": at_s, "peak_force_n": np.array(peaks_n)}
    )
    assert figures_of(write_run(made_up, tmp_path)).after_fault.peak_force_n == expected_n


def scenario_with(*faults: dict[str, Any], bus: dict[str, Any] | None = None) -> Any:
    document = apply_settings(
        read_scenario("soft-start-multistable"), ["script.duration_s=3.0", "script.commands=[]"]
    )
    document["script"]["faults"] = list(faults)
    return check_scenario(document | ({} if bus is None else {"bus": bus}), "broken")


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ({"kind": "gremlins", "at_s": 1.0}, "'gremlins' is none of babbling, .*"),
        ({"kind": "dropped", "at_s": 1.0, "frames": ["Acelerometer"]}, "did you mean Accelerometer"),
        ({"kind": "kick", "at_s": 9.0, "change_m_s": 1.0}, "'kick' at 9.0 s comes after the end"),
        ({"kind": "kick", "at_s": 1.0}, "change_m_s is missing"),
        ({"kind": "paused", "at_s": 1.0, "process": "plant"}, "duration_s is missing"),
        ({"kind": "bus-off", "at_s": 1.0, "node": "plant"}, r"add the table \[bus\]"),
        ({"kind": "restarted", "at_s": 1.0, "process": "plant"}, "duration_s is missing"),
    ],
)
def test_faults_that_make_no_sense_are_refused(table: dict[str, Any], message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario_with(table)


def duplicated(copies: int, **keys: Any) -> dict[str, Any]:
    return {"kind": "duplicated", "at_s": 1.0, "frames": ["Accelerometer"], "copies": copies} | keys


FLOOD = {"kind": "flood", "at_s": 0.5, "frames_a_tick": 1000}
BUNDLED = {"kind": "bundled", "at_s": 1.0, "frames": ["Accelerometer"], "period_s": 1.0}
DELAYED = {"kind": "delayed", "at_s": 1.0, "frames": ["Accelerometer"], "delay_s": 1e6}
BABBLING = {"kind": "babbling", "at_s": 0.5, "can_id": 0, "period_s": 2e-5}


@pytest.mark.parametrize(
    ("tables", "message"),
    [
        ([duplicated(100)] * 6, r"send 1,000,000 frames at 1 s; wanted 100,000 at most, let fewer of them"),
        ([FLOOD] * 5, r"send 5,000 frames at 0\.5 s; wanted 4,096 at most"),
        ([BABBLING] * 90, r"send 4,500 frames at 0\.50\d s; wanted 4,096 at most"),
        ([duplicated(100), duplicated(2), BUNDLED], r"hold back 100,200 frames at 1\.501 s; wanted 100,000"),
        ([BUNDLED, duplicated(100), duplicated(2)], r"send 200,000 frames at 2 s; wanted 100,000 at most"),
        (
            [DELAYED | {"duration_s": 1.0}, duplicated(100, at_s=2.0), duplicated(2, at_s=2.0)],
            "send 100,100 frames at 2 s",
        ),
    ],
)
def test_faults_that_fill_the_memory_with_frames_end_the_run(
    tables: list[dict[str, Any]], message: str
) -> None:
    begun_s = time.process_time()
    bus = FaultyBus(Wire(), "plant", [fault(**table) for table in tables], seed=1, period_s=1e-3)

    def send_for_two_seconds() -> None:
        for tick in range(2001):
            bus.move_to(tick * 1e-3)
            bus.send_all([sample(tick)])

    with pytest.raises(TrafficError, match=message):
        send_for_two_seconds()
    assert time.process_time() - begun_s < 10.0


def test_too_many_faults_are_refused() -> None:
    with pytest.raises(
        ScenarioError, match=r"script\.faults = .{,100} is not a list of at most 100; give the"
    ):
        scenario_with(*[BUNDLED] * 101)


def test_a_delay_without_end_copies_no_held_frames() -> None:
    delayed = fault(**DELAYED)
    assert isinstance(delayed, Delayed)
    delayed.begin(np.random.default_rng(1))
    held = delayed.memory.held
    for tick in range(101):
        assert delayed.outgoing([sample(tick)], Step(2.0 + 1e-3 * tick, 1.999)) == []
    assert delayed.memory.held is held
    assert len(held) == 101


def test_too_many_commands_are_refused() -> None:
    document = read_scenario("soft-start-multistable")
    document["script"]["commands"] = [{"at_s": 0.1, "request": "idle"}] * 1001
    with pytest.raises(ScenarioError, match=r"script\.commands = .{,100} is not a list of at most 1000"):
        check_scenario(document, "broken")


def test_faults_of_many_frames_one_after_the_other_are_accepted() -> None:
    turns = [duplicated(100, at_s=0.1 * number, duration_s=0.09) for number in range(20)]
    scenario_with(*turns, FLOOD, DELAYED | {"duration_s": 0.5}, BUNDLED | {"at_s": 2.5})


def test_a_process_ends_once() -> None:
    away = {"kind": "restarted", "at_s": 1.0, "duration_s": 0.2, "process": "plant"}
    with pytest.raises(ScenarioError, match="ends twice"):
        scenario_with(away, away | {"at_s": 2.0})


def test_a_modelled_bus_is_for_lockstep() -> None:
    refuse_modelled_bus(scenario_with())
    with pytest.raises(ScenarioError, match="--clock lockstep"):
        refuse_modelled_bus(scenario_with(bus={}))


def run(run_dir: Path, scenario: Any) -> Path:
    return in_lockstep(Job(scenario, 1, folder=run_dir))


def test_the_reason_for_refused_parameters_stands_in_the_run_not_on_the_terminal(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    away = {"kind": "restarted", "at_s": 1.0, "duration_s": 0.2, "process": "firmware"}
    scenario = scenario_with({"kind": "parameters-damaged", "at_s": 0.0}, away)
    run_dir = run(tmp_path, scenario)
    assert capfd.readouterr().err == ""
    reasons = (run_dir / "firmware.log").read_text().splitlines()
    assert len(reasons) == 2  # at power-up and after the restart
    assert all("out of bounds" in reason or "it is damaged or was edited" in reason for reason in reasons)


def test_a_node_that_is_bus_off_is_silent_and_comes_back(tmp_path: Path) -> None:
    off = {"kind": "bus-off", "at_s": 1.0, "duration_s": 0.02, "node": "plant"}
    run_dir = run(tmp_path, scenario_with(off, bus={"bitrate": 1_000_000}))
    ages = trace.read(run_dir / "firmware.trace")["inputs.accelerometer.age_ticks"]
    assert 20 <= max(ages[1000:]) <= 23  # 128 runs of 11 bits more
    assert set(ages[1030:]) == {0}
    assert 40 <= (figures_of(run_dir).log.frames_unsent or 0) <= 80  # two to three frames a tick


def test_one_that_babbles_with_the_lowest_identifier_takes_the_bus_for_itself(tmp_path: Path) -> None:
    def ages(can_id: int) -> list[int]:
        babble = {"kind": "babbling", "at_s": 1.0, "can_id": can_id, "data_hex": "00" * 8, "period_s": 1e-4}
        run_dir = run(tmp_path / str(can_id), scenario_with(babble, bus={"bitrate": 1_000_000}))
        return list(trace.read(run_dir / "firmware.trace")["inputs.accelerometer.age_ticks"][1010:])

    assert min(ages(0x000)[100:]) > 100
    assert max(ages(0x7FF)) == 0
