"""What a loop does around a node after ticks were lost."""

import subprocess
import sys
from collections.abc import Sequence

import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import Mode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveErrors, DriveEstop
from hil.bus.in_process import InProcessBus, InProcessNode
from hil.faults.memory import ParameterMemory
from hil.nodes.plant import PlantNode
from hil.nodes.resync import PATIENCE_TICKS
from hil.nodes.runners import FirmwareRunner, Pace
from plant_sim.scene import load_scene

ESTOP = codec.DRIVE_ESTOP.encode(DriveEstop())
ERRORS = codec.DRIVE_ERRORS.encode(DriveErrors(0x200, 0x200))


def plant_node() -> PlantNode:
    return PlantNode(load_scene("table1-motor-soft"), seed=1)


class ScriptedBus(InProcessNode):
    """A bus on which some frames lie when the firmware looks, and some arrive while it waits."""

    def __init__(self) -> None:
        super().__init__()
        self.arriving: list[Frame] = []
        self.waited_s: list[float] = []
        self.sent: list[Frame] = []

    def wait(self, timeout_s: float) -> None:
        self.waited_s.append(timeout_s)
        self.pending += self.arriving
        self.arriving = []

    def send_all(self, frames: Sequence[Frame]) -> None:  # type: ignore[override]
        self.sent += frames


class Paused:
    """A firmware and a plant that ran for twenty ticks together before the pause."""

    def __init__(self) -> None:
        self.plant = plant_node()
        self.bus = ScriptedBus()
        self.firmware = FirmwareRunner(ParameterMemory({}), Pace(1e-3, 1.0), self.bus, None)
        for tick in range(20):
            self.bus.pending += self.publish()
            self.firmware.step(tick, 1)
        assert self.bus.waited_s == []
        self.bus.sent.clear()

    def publish(self) -> list[Frame]:
        frames = self.plant.publish()
        self.plant.advance([])
        return frames

    def ages(self) -> tuple[int, int]:
        inputs = self.firmware.node.inputs
        return inputs.accelerometer.age_ticks, inputs.encoder.age_ticks


@pytest.mark.parametrize("pause_ticks", [2, 9, 16, 80, 252, 253, 255, 256, 300])
def test_sample_from_before_the_pause_does_not_pass_for_new(pause_ticks: int) -> None:
    run = Paused()
    old = run.publish()  # of tick 20, at which the machine stops
    run.plant.sleep_through(pause_ticks - 1, [])
    run.bus.pending += [*old, ESTOP]
    run.bus.arriving = run.publish()
    run.firmware.step(19 + pause_ticks + 1, pause_ticks + 1)
    assert run.ages() == (0, 0)
    position = codec.ENCODER_ESTIMATES.decode(run.plant.publish()[1].data).position_rev
    assert run.firmware.node.inputs.encoder.position_rev == pytest.approx(position, abs=1e-3)
    assert run.firmware.node.elapsed_ticks == pause_ticks + 1
    assert run.firmware.node.outputs.mode == Mode.E_STOP  # nothing else is lost
    assert len(run.bus.waited_s) == 1


@pytest.mark.parametrize(
    ("silent_ticks", "pause_ticks"), [(10, 16), (9, 17), (10, 6), (11, 20), (3, 14), (3, 254), (10, 256)]
)
def test_what_a_bus_held_up_before_the_pause_does_not_pass_for_new(
    silent_ticks: int, pause_ticks: int
) -> None:
    """The bus stops first, then the machine: a backlog lies there, older than the pause is long."""
    run = Paused()
    backlog = []
    for tick in range(20, 20 + silent_ticks):
        backlog += run.publish()
        run.firmware.step(tick, 1)
    assert run.ages() == (silent_ticks, silent_ticks)
    run.plant.sleep_through(pause_ticks - 1, [])
    run.bus.pending += backlog
    tick = 19 + silent_ticks + pause_ticks
    run.firmware.step(tick, pause_ticks)
    frames: list[Frame] = []
    while run.firmware.node.elapsed_ticks == 1:
        frames = run.publish()
        run.bus.pending += frames
        tick += 1
        run.firmware.step(tick, 1)
    own = codec.ENCODER_ESTIMATES.decode(frames[1].data)
    assert run.ages() == (0, 0)
    assert run.firmware.node.inputs.encoder.position_rev == pytest.approx(own.position_rev, abs=1e-6)
    assert run.firmware.node.elapsed_ticks == tick - 19 - silent_ticks


@pytest.mark.parametrize("pause_ticks", [5, 7, 12, 24])
def test_lone_sample_of_now_is_taken_at_once_and_the_next_one_left_alone(pause_ticks: int) -> None:
    """A firmware that woke up late in its tick and waited for another sample would take the next tick's."""
    run = Paused()
    run.plant.sleep_through(pause_ticks, [])
    run.bus.pending += run.publish()
    run.bus.arriving = run.publish()
    run.firmware.step(20 + pause_ticks, pause_ticks + 1)
    assert run.bus.waited_s == []
    position_rev = run.firmware.node.inputs.encoder.position_rev
    run.bus.pending += run.bus.arriving
    run.firmware.step(21 + pause_ticks, 1)
    assert run.ages() == (0, 0)
    assert run.firmware.node.elapsed_ticks == 1
    assert run.firmware.node.inputs.encoder.position_rev >= position_rev


def test_the_sample_of_the_tick_before_gives_way_to_one_that_is_just_coming() -> None:
    """Taken at once it would leave the firmware a tick behind, until two come in one tick."""
    run = Paused()
    run.bus.pending += run.publish()  # of the tick that the firmware slept through
    own = run.publish()
    run.bus.arriving = list(own)
    run.firmware.step(21, 2)
    assert run.firmware.node.inputs.encoder[:2] == codec.ENCODER_ESTIMATES.decode(own[1].data)
    assert len(run.bus.waited_s) == 1


def test_the_sample_of_the_tick_before_is_better_than_none() -> None:
    run = Paused()
    before = run.publish()
    run.bus.pending += before
    run.firmware.step(21, 2)
    assert run.firmware.node.inputs.encoder[:2] == codec.ENCODER_ESTIMATES.decode(before[1].data)
    assert run.firmware.node.elapsed_ticks == 2


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_samples_the_one_of_this_tick_is_taken_and_the_other_one_in_the_next(order: int) -> None:
    """Whichever of the sensors comes first on the bus."""
    run = Paused()
    run.plant.sleep_through(7, [])
    own, early = run.publish()[:2], run.publish()[:2]
    run.bus.pending += [*own[::order], ESTOP, *early[::order], ERRORS]
    for tick, elapsed_ticks, sample in ((27, 8, own), (28, 1, early)):
        run.firmware.step(tick, elapsed_ticks)
        node = run.firmware.node
        assert node._state.received.accelerometer_arrival.counter == codec.ACCELEROMETER.counter(
            sample[0].data
        )
        assert node.inputs.encoder[:2] == codec.ENCODER_ESTIMATES.decode(sample[1].data)
        assert run.ages() == (0, 0)
        assert node.inputs.drive.disarm_reason == 0x200  # nothing else waits
    assert run.bus.waited_s == []


def test_nothing_is_done_until_the_sensors_are_back() -> None:
    run = Paused()
    old = run.publish()
    run.plant.sleep_through(82, [])
    run.bus.pending += old
    for tick in (101, 102):  # the plant needs longer to wake up
        run.firmware.step(tick, 82 if tick == 101 else 1)
        assert run.bus.sent == []
    run.bus.pending += run.publish()
    run.firmware.step(103, 1)
    assert run.ages() == (0, 0)
    assert run.firmware.node.elapsed_ticks == 84
    assert run.bus.sent != []
    run.bus.pending += run.publish()
    run.firmware.step(104, 1)
    assert run.firmware.node.elapsed_ticks == 1


def test_firmware_that_paused_alone_goes_on_at_once() -> None:
    """It uses all that has come meanwhile."""
    run = Paused()
    before = run.firmware.node.counters
    for _ in range(30):
        run.bus.pending += run.publish()[:2]
    run.firmware.step(49, 30)
    assert run.ages() == (0, 0)
    assert run.firmware.node.elapsed_ticks == 30
    assert run.bus.waited_s == []
    assert run.firmware.node.counters == before._replace(frames=before.frames + 60, skipped_ticks=29)


def test_plant_that_does_not_come_back_is_silent_in_the_end() -> None:
    run = Paused()
    run.firmware.step(60, 41)
    for tick in range(61, 60 + PATIENCE_TICKS):
        run.firmware.step(tick, 1)
    assert run.ages() == (40 + PATIENCE_TICKS, 40 + PATIENCE_TICKS)
    assert run.bus.sent != []


def test_plant_obeys_what_came_in_its_pause_before_it_moves_on() -> None:
    bus = InProcessBus()
    plant_end, firmware_end = bus.join(), bus.join()
    firmware = FirmwareRunner(ParameterMemory({}), Pace(1e-3, 1.0), firmware_end, None)
    plant = plant_node()
    plant_end.send_all(plant.publish())
    plant.advance([])
    for tick in range(40):
        firmware.step(tick, 1)
    plant.drive = plant.drive._replace(setpoint=plant.drive.setpoint._replace(age_s=0.04))
    plant.sleep_through(40, plant_end.receive())
    assert plant.drive.setpoint.age_s == 0.0


def test_sample_that_was_a_tick_late_before_the_pause_does_not_make_later_ones_wrong() -> None:
    run = Paused()
    late = run.publish()
    run.firmware.step(20, 1)  # the plant is late: nothing has arrived yet
    run.bus.pending += late
    run.firmware.step(21, 1)
    run.plant.sleep_through(6, [])
    run.bus.arriving = run.publish()
    run.firmware.step(27, 6)
    assert run.ages() == (0, 0)


@pytest.mark.parametrize("wrong_by_ticks", [3, 7, 12])
def test_what_comes_after_the_first_tick_is_of_now_whatever_its_counter_says(wrong_by_ticks: int) -> None:
    """A sample that was misjudged in one pause must not keep the firmware waiting in the next one."""
    run = Paused()
    run.firmware._last_tick -= wrong_by_ticks
    run.plant.sleep_through(9, [])
    run.bus.pending += run.publish()
    run.firmware.step(29, 10)
    assert run.firmware.node.elapsed_ticks == 1
    run.bus.pending += run.publish()
    run.firmware.step(30, 1)
    assert run.firmware.node.elapsed_ticks == 11
    assert run.ages() == (0, 0)


@pytest.mark.parametrize("node", ["plant", "firmware"])
def test_a_node_alone_makes_its_folder(tmp_path, node):
    out = tmp_path / "deep" / "new"
    command = [sys.executable, "-m", "tools.cli", node, "soft-start-multistable", "--bus", "local"]
    subprocess.run([*command, "--out", str(out), "--until", "0.02"], check=True, capture_output=True)
    assert (out / f"{node}.trace").exists()


def test_a_firmware_alone_says_why_it_refuses_its_parameters():
    command = [sys.executable, "-m", "tools.cli", "firmware", "damaged-parameters-arm-nothing"]
    done = subprocess.run(
        [*command, "--bus", "local", "--until", "0.02"], check=True, capture_output=True, text=True
    )
    assert "is out of bounds" in done.stderr or "it is damaged or was edited by hand" in done.stderr


def test_a_nodes_process_loads_no_reader_of_databases_and_no_tables():
    """They take longer to load than everything else, in each process of each run."""
    heavy = ("cantools", "can", "pandas", "pyarrow", "rerun")
    look = f"import sys, hil.nodes.main; print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", look], check=True, capture_output=True, text=True)
    assert done.stdout == "[]\n"
