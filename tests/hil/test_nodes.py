"""What a loop does around a node after ticks were lost."""

import pytest

from firmware_py.interface import codec
from firmware_py.interface.records import DriveEstop
from hil.bus.in_process import InProcessBus, InProcessNode
from hil.nodes import FirmwareRunner, Pace
from hil.plant_node import PlantNode
from plant_sim.scene import load_scene


class PausedMachine(InProcessNode):
    """A bus on which the plant's frames arrive a moment after the firmware has woken up, or do not."""

    def __init__(self, plant: PlantNode, plant_is_back: bool) -> None:
        super().__init__()
        self.plant = plant
        self.plant_is_back = plant_is_back
        self.waits_s: list[float] = []

    def wait(self, timeout_s: float) -> None:
        self.waits_s.append(timeout_s)
        if self.plant_is_back:
            self.pending += self.plant.publish()


@pytest.mark.parametrize("plant_is_back", [True, False])
def test_firmware_takes_no_sample_from_before_its_pause_for_a_new_one(plant_is_back: bool) -> None:
    plant = PlantNode(load_scene("table1-motor-soft"), seed=1)
    bus = PausedMachine(plant, plant_is_back)
    firmware = FirmwareRunner({}, Pace(1e-3, 1.0), bus, None)
    bus.pending += plant.publish()
    plant.advance([])
    firmware.step(0, 1)
    assert bus.waits_s == []
    bus.pending += [*plant.publish(), codec.DRIVE_ESTOP.encode(DriveEstop())]
    plant.sleep_through(20, [])
    firmware.step(21, 21)
    assert bus.waits_s == [1e-3]
    assert firmware.node.inputs.accelerometer.age_ticks == (0 if plant_is_back else 21)
    assert firmware.node.inputs.encoder.age_ticks == (0 if plant_is_back else 21)
    assert firmware.node.inputs.elapsed_ticks == 21
    assert firmware.node.inputs.estop


def test_plant_obeys_what_came_in_its_pause_before_it_moves_on() -> None:
    bus = InProcessBus()
    plant_end, firmware_end = bus.join(), bus.join()
    firmware = FirmwareRunner({}, Pace(1e-3, 1.0), firmware_end, None)
    plant = PlantNode(load_scene("table1-motor-soft"), seed=1)
    plant_end.send_all(plant.publish())
    plant.advance([])
    for tick in range(40):
        firmware.step(tick, 1)
    commands = plant_end.receive()
    assert len(commands) >= 40
    plant.sleep_through(40, commands)
    assert plant.drive.since_command_s < 1e-3
