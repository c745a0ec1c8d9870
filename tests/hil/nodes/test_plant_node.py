"""The plant's node: what it sends when, and that its world goes on while its loop does not."""

import math
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from itertools import count, pairwise

import numpy as np
import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisError, AxisState, ProcedureResult
from firmware_py.interface.frame import Frame
from hil.bus.in_process import InProcessBus
from hil.drive.axis import is_armed
from hil.drive.axis_table import BenchScene
from hil.faults.kinds.stop_moved import StopMoved
from hil.faults.line import FaultyBus
from hil.nodes.plant.node import PlantNode
from hil.nodes.plant.runner import PlantRunner
from hil.nodes.runner import Pace
from hil.record.traces.plant_trace import PlantRecord
from plant_sim.parts.stop import RigidStop
from plant_sim.plant import Plant
from plant_sim.result import Observation
from plant_sim.scene import load_scene, read_scene
from plant_sim.sensors.readings import SensorReading

ARM = Frame(0x07, struct.pack("<I", AxisState.CLOSED_LOOP_CONTROL) + bytes(4))


def torque(torque_n_m: float) -> Frame:
    return Frame(0x0E, struct.pack("<f", torque_n_m) + bytes(4))


ODRIVES_AXIS = {"watchdog_s": 1.0, "encoder_s": 0.01, "control_mode": "velocity"}


def plant_node(period_s: float = 1e-3) -> PlantNode:
    return PlantNode(load_scene("table1-motor-soft"), seed=1, period_s=period_s)


SENSORS = [0x028, 0x009]
"""Both are sent in every tick, however long."""
SLOW = {0x014: 10e-3, 0x001: 0.1, 0x003: 0.1, 0x015: 0.1, 0x017: 0.1}
"""Current; heartbeat, errors, temperature and supply."""


@pytest.mark.parametrize("period_s", [0.25e-3, 0.5e-3, 1e-3, 4e-3])
def test_each_frame_comes_at_its_period_and_the_drives_slow_ones_one_by_one(period_s: float) -> None:
    node, sent = plant_node(period_s), []
    for _ in range(round(0.25 / period_s)):
        sent.append([frame.can_id for frame in node.publish()])
        node.advance([])
    assert all(can_ids[:2] == SENSORS for can_ids in sent)
    assert max(map(len, sent)) <= 3
    assert {can_id for can_ids in sent for can_id in can_ids} == {*SENSORS, *SLOW}, "nobody walks here"
    for can_id, every_s in SLOW.items():
        every = every_s / period_s
        if not every.is_integer():
            continue
        ticks = [tick for tick, can_ids in enumerate(sent) if can_id in can_ids]
        assert [tick // every for tick in ticks] == list(range(len(ticks)))
        assert len(ticks) == (len(sent) - 1 - ticks[0]) // every + 1
        assert all(tick % every < 5 for tick in ticks)  # they take turns


def test_accelerometer_counts_its_frames() -> None:
    node = plant_node()
    counters = []
    for _ in range(300):
        counters.append(codec.ACCELEROMETER.counter(node.publish()[0].data))
        node.advance([])
    assert counters == [number % 256 for number in range(300)]


class Client:
    """A client on the bus of a drive with ODrive's own periods."""

    def __init__(self) -> None:
        scene = BenchScene.load(read_scene("table1-motor-soft") | {"axis": ODRIVES_AXIS})
        self.node = PlantNode(scene, seed=1)

    def after(self, frames: Sequence[Frame], can_id: int, wanted: Callable[[bytes], bool]) -> bytes:
        """The first such message after the drive has received these frames."""
        for _ in range(30_000):
            data = [frame.data for frame in self.node.publish() if frame.can_id == can_id]
            self.node.advance(frames)
            frames = ()
            if data and wanted(data[0]):
                return data[0]
        raise AssertionError(f"no such message of {can_id:#x} within 30 s")


def test_as_odrives_examples_do_a_client_calibrates_the_drive_and_swings_its_crank() -> None:
    """The frames of can_calibrate and can_simple, whose programs are in no package."""
    client = Client()
    clear, calibrate = Frame(0x18, b"\0"), Frame(0x07, struct.pack("<I", 3))
    heartbeat = client.after([clear, calibrate], 0x01, lambda data: data[4] != AxisState.IDLE)
    assert struct.unpack("<IBB", heartbeat[:6]) == (0, 3, ProcedureResult.BUSY)
    heartbeat = client.after([], 0x01, lambda data: data[4] == AxisState.IDLE)
    assert struct.unpack("<IBB", heartbeat[:6]) == (0, AxisState.IDLE, ProcedureResult.SUCCESS)
    client.after([Frame(0x07, struct.pack("<I", 8))], 0x01, lambda data: data[:5] == bytes((0, 0, 0, 0, 8)))
    slowest = fastest = 0.0
    for step in range(40):
        wanted_rev_s = struct.pack("<ff", math.sin(math.pi * 0.1 * step), 0.0)
        sampled = count(1)
        data = client.after([Frame(0x0D, wanted_rev_s)], 0x09, lambda _, sampled=sampled: next(sampled) == 10)
        _, velocity_rev_s = struct.unpack("<ff", data)
        slowest, fastest = min(slowest, velocity_rev_s), max(fastest, velocity_rev_s)
    assert slowest < -0.5
    assert fastest > 0.5
    heartbeat = client.after([], 0x01, lambda data: data[4] == AxisState.IDLE)
    assert struct.unpack("<I", heartbeat[:4]) == (AxisError.WATCHDOG_TIMER_EXPIRED,)


def test_torque_turns_the_crank_forward_and_the_record_says_so() -> None:
    node = plant_node()
    for _ in range(100):
        node.publish()
        node.advance([ARM, torque(0.05)])
    record = node.record
    assert record.tick == 99
    assert record.t_s == pytest.approx(0.099)
    assert record.torque_command_n_m == pytest.approx(0.05)
    assert record.motor_torque_n_m == pytest.approx(0.05)
    assert record.current_a == pytest.approx(0.625)
    assert record.omega_rad_s > 5.0
    assert record.drive_work_j > 0.0
    assert record.axis_state == AxisState.CLOSED_LOOP_CONTROL
    assert record.encoder_position_rev == pytest.approx(record.crank_rad / (2.0 * np.pi) % 1.0, abs=1e-3)


WALK = {"axis": "outward", "pace": [{"at_s": 0.0, "stride_hz": 0.9}]}


def walking_node(**sensors: float) -> PlantNode:
    scene = {**read_scene("table1-motor-soft"), "gait": WALK, "sensors": {"gait": sensors}}
    return PlantNode(load_scene(scene), seed=1)


def test_gait_sensors_speak_every_five_ticks_and_count_their_frames() -> None:
    node = walking_node(rate_noise_rad_s=0.0, rate_bias_rad_s=0.0, twist_rad=0.0, along_noise_m_s2=0.0)
    received = []
    for tick in range(100):
        gait = [frame for frame in node.publish() if frame.can_id == codec.GAIT_SENSORS.can_id]
        node.advance([])
        assert node.gait is not None
        assert node.gait.phase == pytest.approx(0.9e-3 * tick, rel=0.1, abs=1e-9)
        received += [(tick, codec.GAIT_SENSORS.counter(frame.data), frame, node.gait) for frame in gait]
    assert [tick for tick, *_ in received] == list(range(0, 100, 5))
    assert [counter for _, counter, *_ in received] == [number % 16 for number in range(20)]
    for _, _, frame, truth in received:
        record = codec.GAIT_SENSORS.decode(frame.data)
        assert record.shank_rate_rad_s == pytest.approx(truth.shank_rad_s, abs=6e-4)
        assert record.toe_contact == 0 or truth.phase > 0.05


def test_a_coarse_sensor_sends_its_position_at_50_hz_with_its_noise() -> None:
    scene = read_scene("table1-motor-soft")
    scene["sensors"] = {**scene.get("sensors", {}), "coarse": {"noise_m": 2e-3}}
    node, ticks, counters, errors = PlantNode(load_scene(scene), seed=1), [], [], []
    for tick in range(8000):
        x_m = node.plant.now.x_m
        for frame in node.publish():
            if frame.can_id == codec.COARSE_POSITION.can_id:
                ticks.append(tick)
                counters.append(codec.COARSE_POSITION.counter(frame.data))
                errors.append(codec.COARSE_POSITION.decode(frame.data).striker_position_m - x_m)
        node.advance([])
    assert ticks == list(range(0, 8000, 20))
    assert counters == [number % 16 for number in range(400)]
    assert np.std(errors) == pytest.approx(2e-3, rel=0.1)
    assert abs(np.mean(errors)) < 3e-4


def test_a_gait_frame_that_drops_out_leaves_a_gap_in_the_count() -> None:
    node, counters = walking_node(dropout_share=0.5, dropout_s=0.02), []
    for _ in range(2000):
        counters += [
            codec.GAIT_SENSORS.counter(frame.data)
            for frame in node.publish()
            if frame.can_id == codec.GAIT_SENSORS.can_id
        ]
        node.advance([])
    assert 100 < len(counters) < 300
    assert any((after - before) % 16 != 1 for before, after in pairwise(counters))


def test_time_that_passes_asleep_counts_for_the_gait_too() -> None:
    node = walking_node()
    node.publish()
    node.advance([])
    node.sleep_through(40, [])
    frame = next(frame for frame in node.publish() if frame.can_id == codec.GAIT_SENSORS.can_id)
    assert codec.GAIT_SENSORS.counter(frame.data) == 8


def test_a_tilted_module_with_a_wearer_publishes_what_it_feels() -> None:
    scene = {
        **read_scene("table1-motor-soft"),
        "housing": {"tilt_rad": 0.5},
        "wearer": {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0},
    }
    node = PlantNode(load_scene(scene), seed=1)
    along_m_s2 = 9.80665 * np.sin(0.5)
    for _ in range(200):
        frame = node.publish()[0]
        node.advance([ARM, torque(0.1)])
        assert codec.ACCELEROMETER.decode(frame.data).housing_m_s2 == pytest.approx(along_m_s2, abs=0.2)
    record = node.record
    assert record.housing_work_j > 1e-3  # the striker has slid downhill
    assert record.ankle_j >= 0.0  # the plate hangs at rest until an impact
    taken = record.stored_j + record.friction_j + record.impact_loss_j + record.ankle_j
    assert record.drive_work_j + record.housing_work_j == pytest.approx(taken, abs=1e-8)


def held(torque_n_m: float, ticks: int, of_ticks: int) -> Plant:
    """The module alone under a torque for this number of ticks, then under none."""
    plant = Plant(load_scene("table1-motor-soft"), seed=1)
    for tick in range(of_ticks):
        plant.advance(torque_n_m if tick < ticks else 0.0, 1e-3)
    return plant


def assert_moves_as(node: PlantNode, plant: Plant) -> None:
    assert node.plant.t_s == pytest.approx(plant.t_s)
    assert node.plant.state.omega_rad_s == pytest.approx(plant.state.omega_rad_s, rel=1e-6)
    assert node.plant.state.crank_rad == pytest.approx(plant.state.crank_rad, rel=1e-6)


@pytest.mark.parametrize(("period_s", "ticks"), [(1e-3, 200), (4e-3, 50)])
def test_silence_ends_the_torque_after_fifty_milliseconds(period_s: float, ticks: int) -> None:
    """In ticks of 4 ms, within a tick."""
    node = plant_node(period_s=period_s)
    for tick in range(ticks):
        node.publish()
        node.advance([ARM, torque(0.1)] if tick == 0 else [])
    assert node.drive.axis.disarm_reason == AxisError.WATCHDOG_TIMER_EXPIRED
    assert_moves_as(node, held(0.1, ticks=50, of_ticks=200))


def test_pause_of_the_plant_itself_moves_the_world_but_is_no_silence_of_the_firmware() -> None:
    node = plant_node()
    node.publish()
    node.advance([ARM, torque(0.1)])
    node.sleep_through(199, [])
    assert node.tick == 200
    assert is_armed(node.drive)
    assert_moves_as(node, held(0.1, ticks=50, of_ticks=200))
    for _ in range(49):
        node.publish()
        node.advance([])
    assert not is_armed(node.drive)


def test_a_loop_that_is_late_from_the_very_start_begins_later() -> None:
    node = plant_node()
    node.sleep_through(3, [ARM])
    assert node.tick == 3
    assert is_armed(node.drive)
    frame = node.publish()[0]
    assert codec.ACCELEROMETER.counter(frame.data) == 3
    node.advance([torque(0.1)])
    assert node.record.t_s == pytest.approx(3e-3)


def test_what_was_commanded_during_a_pause_acts_in_it() -> None:
    node = plant_node()
    node.publish()
    node.advance([ARM, torque(0.1)])
    node.sleep_through(30, [torque(0.0)])
    assert_moves_as(node, held(0.1, ticks=1, of_ticks=31))


def test_pause_leaves_no_burst_of_frames_behind() -> None:
    node = plant_node()
    node.publish()
    node.advance([])
    node.sleep_through(1000, [])
    slow = []
    for _ in range(20):
        slow += [frame.can_id for frame in node.publish()[2:]]
        node.advance([])
    late = [0x001, 0x003, 0x015, 0x017]  # those of the first tick, and those of the pause's end: each twice
    assert sorted(slow) == sorted([*late, *late, 0x014, 0x014, 0x014])


def test_ideal_drive_turns_whatever_is_commanded() -> None:
    scene = load_scene({**read_scene("table1-viscous"), "sensors": {}})
    node = PlantNode(scene, seed=1)
    for _ in range(20):
        node.publish()
        node.advance([ARM, torque(-0.5)])
    assert node.record.omega_rad_s == pytest.approx(1.3 * 9.354, rel=1e-3)


def test_a_record_takes_truth_and_readings_in_their_own_order() -> None:
    """They are handed over by position."""
    fields, truth = PlantRecord._fields, Observation._fields
    assert fields[2 : 2 + len(truth)] == truth
    assert fields[-len(SensorReading._fields) :] == SensorReading._fields


def test_discovery_finds_the_drive_at_its_node_number() -> None:
    node = PlantNode(load_scene("table1-motor-soft"), 1, node_id=5)
    node.publish()
    node.advance([Frame(0x7E6, b"")])
    answer = node.publish()[-1]
    assert answer.data[0] == 5
    assert int.from_bytes(answer.data[1:7], "little") != 0


def test_the_drive_keeps_its_node_number_when_its_process_starts_anew() -> None:
    bus = InProcessBus()
    plant_end, client = bus.join(), bus.join()
    line = FaultyBus(plant_end, "plant", [], 1, 1e-3)
    runner = PlantRunner(load_scene("table1-motor-soft"), 1, Pace(1e-3, 1.0), line, node_id=5)
    runner.restart(0)
    client.send_all([Frame(0x7E6, b"")])
    runner.step(0)
    client.receive()
    runner.step(1)
    assert [frame.data[0] for frame in client.receive() if frame.can_id == 0x006] == [5]


@pytest.mark.parametrize("scene", ["table1-motor-soft", "gait-motor-soft"])
def test_a_plant_alone_sends_the_same_frames_in_compiled_ticks(scene: str) -> None:
    """With requests, which it answers, and a pause, in which its motion goes on."""
    sent = []
    for is_timed in (True, False):
        bus = InProcessBus()
        plant_end, client = bus.join(), bus.join()
        line = FaultyBus(plant_end, "plant", [], 1, 1e-3)
        runner = PlantRunner(load_scene(scene), 1, Pace(1e-3, None, is_timed), line)
        frames = []
        for tick in [*range(400), *range(450, 900)]:
            runner.step(tick)
            frames.append(client.receive())
            client.send_all([ARM if tick == 3 else torque(-0.2)])
            if tick % 97 == 5:
                client.send_all([Frame(0x01C, b""), Frame(0x7E6, b"")])
        sent.append((frames, runner.node.plant.now, runner.node.take_impacts()))
    assert sent[0] == sent[1]


def test_watchdog_and_periods_are_keys_of_the_scene() -> None:
    """A client that waits for state 8 in a heartbeat before its first command needs the longer watchdog."""
    table = {"watchdog_s": 0.5, "heartbeat_s": 0.02, "encoder_s": 0.01}
    scene = BenchScene.load(read_scene("table1-motor-soft") | {"axis": table})
    node = PlantNode(scene, 1)
    sent = Counter[int]()
    for tick in range(400):
        sent.update(frame.can_id for frame in node.publish())
        node.advance([ARM] if tick == 0 else [])
    assert (sent[0x001], sent[0x009]) == (20, 40)
    assert node.drive.axis.state == AxisState.CLOSED_LOOP_CONTROL


def test_a_stop_that_would_move_behind_the_striker_waits_until_the_striker_is_clear() -> None:
    fault = StopMoved(kind="stop-moved", at_s=0.05, by_m=-0.05)
    changes = {"initial": {"x_m": 0.179, "v_m_s": 0.0}, "sensors": {}}
    scene = load_scene({**read_scene("table1-viscous"), **changes})
    node = PlantNode(scene, 0, faults=[fault])
    stop = node.plant.parts.stop
    assert isinstance(stop, RigidStop)
    last_m, waited = 0.179, 0
    while node.plant.parts.stop == stop:
        node.publish()
        waited += node.has_waiting_fault
        assert abs(node.plant.state.x_m - last_m) < 2e-3
        last_m = node.plant.state.x_m
        if node.plant.parts.stop != stop:
            break
        node.advance([])
    assert waited > 0
    assert not node.has_waiting_fault
    assert node.plant.parts.stop.position_m == pytest.approx(stop.position_m - 0.05)
    assert node.plant.state.x_m <= stop.position_m - 0.05
