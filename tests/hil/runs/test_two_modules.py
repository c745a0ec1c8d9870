"""Two modules, two drives and two firmwares on one bus: each obeys its own operator alone, and both hold."""

import pytest

from firmware_py.interface import codec
from firmware_py.interface.addresses import (
    BROADCAST_NODE,
    DEFAULT,
    NOT_OURS,
    AddressError,
    Addresses,
    addresses,
    bus_id,
    module_id,
)
from firmware_py.interface.enums import Mode, Regime
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveEstop
from firmware_py.shell.builds import node_of
from firmware_py.shell.parameters import addresses_from, config_from
from hil.bus.addressed import AddressedBus, addressed
from hil.bus.in_process import InProcessBus
from hil.bus.model.message_set import bus_schedule
from hil.bus.model.modelled_bus import ModelledBus
from hil.nodes.operator.node import OperatorNode
from hil.nodes.plant.node import PlantNode
from hil.scenario.scenario import load_scenario

TICK_NS = 1_000_000
PLACES = (addresses(0, 2), addresses(1, 5))
RATIOS = (1.3, 1.25)
SECONDS = 6.0
NODES = ("plant", "firmware", "operator")
COMMANDS = {0x02, 0x04, 0x06, 0x07, 0x0B, 0x0C, 0x0D, 0x0E, 0x0F, 0x10, 0x11, 0x12, 0x13, 0x16, 0x18, 0x19}
COMMANDS |= {0x1A, 0x1B, 0x1F}


class Module:
    """Plant, firmware and operator of one module, at its place on a bus that all nodes join by name."""

    def __init__(self, join, places: Addresses, ratio: float, seed: int) -> None:
        scenario = load_scenario("soft-start-multistable", ["firmware.start.rise_s=2.0"])
        commands = [one._replace(target_ratio=ratio) for one in scenario.commands]
        buses = (addressed(join(name), places) for name in ("plant", "firmware", "operator"))
        self.plant_bus, self.firmware_bus, self.operator_bus = buses
        self.plant = PlantNode(scenario.scene, seed)
        self.firmware = node_of("compiled")(config_from(scenario.parameters))
        self.operator = OperatorNode(commands, 1e-9 * TICK_NS)
        self.speeds: list[float] = []

    def plant_turn(self, tick: int) -> None:
        self.plant_bus.send_all(self.plant.publish())
        self.plant.advance(self.plant_bus.receive())
        if tick >= self.operator.due_tick:
            self.operator_bus.send_all(self.operator.publish(tick))
        self.speeds.append(self.plant.plant.now.omega_rad_s)

    def firmware_turn(self) -> None:
        self.firmware_bus.send_all(self.firmware.tick(self.firmware_bus.receive(), 1))


def play(modules, seconds, move_to) -> None:
    for tick in range(round(seconds * 1e9) // TICK_NS):
        move_to(tick * TICK_NS)
        for module in modules:
            module.plant_turn(tick)
        move_to(tick * TICK_NS + TICK_NS // 2)
        for module in modules:
            module.firmware_turn()


@pytest.mark.parametrize("modelled", [False, True], ids=["ideal bus", "1 Mbit/s"])
def test_both_hold_their_own_target(modelled):
    """On the modelled bus each frame takes its time and the lower identifier goes first."""
    if modelled:
        model = ModelledBus([f"{name}{number}" for number in (0, 1) for name in NODES])
        joins = [lambda name, number=number: model.join(f"{name}{number}") for number in (0, 1)]
        move_to = model.move_to
    else:
        ideal = InProcessBus()
        joins = [lambda _: ideal.join()] * 2
        move_to = lambda _: None  # noqa: E731
    modules = [Module(*each) for each in zip(joins, PLACES, RATIOS, (1, 2), strict=True)]
    play(modules, SECONDS, move_to)
    for module in modules:
        outputs = module.firmware.outputs
        assert (outputs.mode, outputs.regime) == (Mode.RUN, Regime.IMPACT)
        assert module.plant.state.rejected == 0
        mean_rad_s = sum(module.speeds[-2000:]) / 2000
        assert mean_rad_s == pytest.approx(outputs.target_omega_rad_s, rel=0.02)
    assert (
        modules[1].firmware.outputs.target_omega_rad_s < 0.98 * modules[0].firmware.outputs.target_omega_rad_s
    )


def test_an_emergency_stop_of_one_drive_is_none_of_the_other():
    bus = InProcessBus()
    modules = [Module(lambda _: bus.join(), places, 1.3, 1) for places in PLACES]
    play(modules, 1.0, lambda _: None)
    modules[0].operator_bus.send_all([codec.DRIVE_ESTOP.encode(DriveEstop())])
    play(modules, 0.1, lambda _: None)
    assert [module.firmware.outputs.mode for module in modules] == [Mode.E_STOP, Mode.SOFT_START]


@pytest.mark.parametrize("places", [DEFAULT, *PLACES, addresses(62, 59), addresses(0, 60), addresses(62, 0)])
def test_no_frame_of_a_module_is_another_drives_command_wherever_it_is(places):
    own = {places.own_node, places.own_node + 1, places.own_node + 2}
    for one in codec.CODECS.values():
        on_bus = bus_id(places, one.can_id)
        assert module_id(places, on_bus) == one.can_id
        assert on_bus >> 5 == places.drive_node if one.can_id < 0x20 else on_bus >> 5 in own
        assert one.can_id < 0x20 or on_bus & 0x1F not in COMMANDS
    ours = {places.drive_node, *own, BROADCAST_NODE}
    others = [can_id for can_id in range(0x800) if can_id >> 5 not in ours]
    assert {module_id(places, can_id) for can_id in others} == {NOT_OURS}


@pytest.mark.parametrize(
    ("drive_node", "own_node"), [(1, 1), (2, 1), (3, 1), (63, 1), (-1, 1), (0, 61), (0, -1), (0, 0)]
)
def test_places_that_overlap_or_are_not_there_are_refused(drive_node, own_node):
    with pytest.raises(AddressError):
        addresses(drive_node, own_node)


def test_worst_case_of_two_modules_is_known():
    """Each of them alone is always in time; both together are not in the worst case, and it says so."""
    one = [bus_schedule(1_000_000, modules=[places]) for places in PLACES]
    both = bus_schedule(1_000_000, modules=PLACES)
    assert [schedule.schedulable for schedule in one] == [True, True]
    assert both.load == pytest.approx(one[0].load + one[1].load)
    assert both.load > 1.0
    assert not both.schedulable
    assert {response.stream.can_id for response in both.responses} == {
        bus_id(places, response.stream.can_id)
        for places in PLACES
        for response in bus_schedule(1_000_000).responses
    }


def test_they_are_parameters_of_the_build():
    assert addresses_from({}) == DEFAULT
    assert addresses_from({"bus": {"drive_node": 1, "own_node": 5}}) == (1, 5)


def test_at_the_default_place_nothing_stands_in_between():
    bus = InProcessBus().join()
    assert addressed(bus, DEFAULT) is bus
    assert isinstance(addressed(bus, PLACES[1]), AddressedBus)


def test_a_node_elsewhere_receives_from_its_own_module_only():
    bus = InProcessBus()
    speaker, listener = bus.join(), AddressedBus(bus.join(), PLACES[1])
    speaker.send_all([Frame(0x00E, b"\1"), Frame(0x02E, b"\2"), Frame(0x0A8, b"\3"), Frame(0x048, b"\4")])
    assert listener.receive() == [Frame(0x00E, b"\2"), Frame(0x028, b"\3")]
