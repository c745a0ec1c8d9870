"""The FMUs of firmware and plant with frames under a foreign master: the frames of lockstep, tick by tick."""

from collections import defaultdict
from pathlib import Path
from typing import Any

import pytest
from fmpy.validation import validate_fmu
from fmus import FmiError, Fmu, FramePort, require_no_runtime, run_alone

import hil
from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Mode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import SetAxisState, SetInputTorque
from hil.drive.axis_table import BenchScene
from hil.nodes.plant.node import PlantNode
from hil.runs.recorded_run import Run
from hil.scenario.scenario import load_scenario
from plant_sim.scene import load_scene
from tools.fmu.build import Version, export
from tools.fmu.firmware import FirmwareModel
from tools.fmu.plant_node import PlantNodeModel
from tools.fmu.variables import FmuError

SCENARIO = "soft-start-multistable"
MASTER = (Path(__file__).parents[2] / "docs/how-to/export-an-fmu/couple.py").read_text("utf-8")
"""The program of the how-to that couples two FMUs."""
TICKS = 33_000
Ticks = dict[int, list[Frame]]


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """A run in lockstep."""
    return hil.run(SCENARIO, out=tmp_path_factory.mktemp("runs") / "run")


@pytest.fixture(scope="module")
def logged(lockstep: Run) -> tuple[Ticks, Ticks]:
    """The frames of the run at t_k, by plant and operator, and at t_k + T/2, by the firmware."""
    others: Ticks = defaultdict(list)
    firmwares: Ticks = defaultdict(list)
    for line in (lockstep.folder / "can.log").read_text("ascii").splitlines():
        stamp, _, content = line.split()
        tick, micros = divmod(round(1e6 * float(stamp[1:-1])), 1000)
        can_id, data = content.split("#")
        (firmwares if micros else others)[tick].append(Frame(int(can_id, 16), bytes.fromhex(data)))
    return others, firmwares


@pytest.fixture(params=[2, 3])
def firmware(request: pytest.FixtureRequest, tmp_path: Path) -> Fmu:
    """The FMU of the scenario's firmware, by either version of FMI."""
    version: Version = request.param
    file = tmp_path / "firmware.fmu"
    export(FirmwareModel(load_scenario(SCENARIO).parameters), version, file)
    assert validate_fmu(str(file)) == []
    return Fmu(file)


def test_the_firmware_sends_the_frames_of_lockstep(firmware: Fmu, logged: tuple[Ticks, Ticks]) -> None:
    others, firmwares = logged
    one = firmware.instance()
    port = FramePort(one)
    for tick in range(TICKS):
        port.receive(others[tick])
        one.step(1e-3)
        assert port.sent() == firmwares[tick], tick


def test_a_restored_firmware_goes_on_as_it_did(firmware: Fmu, logged: tuple[Ticks, Ticks]) -> None:
    others, firmwares = logged
    one, other = firmware.instance(), firmware.instance()
    port = FramePort(one)
    for tick in range(1500):
        port.receive(others[tick])
        one.step(1e-3)
    other.slave.setFMUState(
        other.slave.deserializeFMUState(one.slave.serializeFMUState(one.slave.getFMUState()))
    )
    other.t_s = one.t_s
    again = FramePort(other)
    for tick in range(1500, 2000):
        again.receive(others[tick])
        other.step(1e-3)
        assert again.sent() == firmwares[tick], tick


def test_another_step_than_the_period_is_refused_and_changes_nothing(
    firmware: Fmu, logged: tuple[Ticks, Ticks]
) -> None:
    others, firmwares = logged
    one = firmware.instance()
    port = FramePort(one)
    port.receive(others[0])
    with pytest.raises(FmiError):
        one.slave.doStep(0.0, 2e-3)
    assert "wanted the period" in one.messages[-1]
    one.step(1e-3)
    assert port.sent() == firmwares[0]


def test_more_frames_than_fit_and_a_bad_length_are_refused(firmware: Fmu) -> None:
    one = firmware.instance()
    write = one.slave.setInt32 if one.is_fmi_3 else one.slave.setInteger
    for name, value in (("received.count", 9), ("received[0].length", 9), ("received[0].id", -1)):
        with pytest.raises(FmiError):
            write([firmware.variables[name].valueReference], [value])
        assert name in one.messages[-1]


def test_coupled_they_give_the_impacts_and_modes_of_lockstep(lockstep: Run) -> None:
    """The how-to's program, in a process without this project: every frame is that of lockstep."""
    assert len(MASTER.splitlines()) <= 63
    scenario, folder = load_scenario(SCENARIO), lockstep.folder.parent
    export(PlantNodeModel(scenario.scene, scenario.seed, scenario.period_s), 2, folder / "plant.fmu")
    export(FirmwareModel(scenario.parameters), 2, folder / "firmware.fmu")
    printed = [line.split() for line in run_alone(MASTER, folder=folder).splitlines()]
    assert (folder / "coupled.log").read_bytes() == (lockstep.folder / "can.log").read_bytes()
    impacts = [tuple(map(float, line[1:])) for line in printed if line[0] == "impact"]
    assert impacts == [(impact.t_s, impact.v_m_s) for impact in lockstep.impacts]
    assert len(impacts) > 40
    modes = [line[2] for line in printed if line[0] == "mode"]
    recorded = lockstep.signal("firmware.outputs.mode")[1].tolist()
    changes = zip([None, *recorded], recorded, strict=False)
    assert modes == [Mode(now).name for last, now in changes if now != last]


@pytest.fixture(params=[2, 3])
def node(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[BenchScene, Fmu]:
    """A scene and the FMU of its plant's node, by either version of FMI."""
    tables = {**load_scenario(SCENARIO).scene.model_dump(exclude_none=True), "axis": {"watchdog_s": 0.0203}}
    scene = BenchScene.model_validate(tables)
    version: Version = request.param
    export(PlantNodeModel(scene, 7, 1e-3), version, tmp_path / "node.fmu")
    assert validate_fmu(str(tmp_path / "node.fmu")) == []
    return scene, Fmu(tmp_path / "node.fmu")


def test_the_node_under_kicks_changed_parts_and_an_expired_watchdog(node: tuple[BenchScene, Fmu]) -> None:
    scene, fmu = node
    one, same = fmu.instance(), PlantNode(scene, 7)
    require_no_runtime(fmu)
    port = FramePort(one)
    arm = codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.CLOSED_LOOP_CONTROL))
    state = b""
    for tick in range(1200):
        if tick == 600:
            state = one.slave.serializeFMUState(one.slave.getFMUState())
            one = fmu.instance()
            one.slave.setFMUState(one.slave.deserializeFMUState(state))
            one.t_s, port = 1e-3 * tick, FramePort(one)
        if tick == 800:
            one.set("kicks.v_m_s", 1.25)
            same.plant.kick(1.25)
        if tick == 900:
            one.set("striker.mass_kg", 0.9)
            changed = scene.model_copy(update={"striker": scene.striker.model_copy(update={"mass_kg": 0.9})})
            same.plant.replace_parts(changed.parts(7))
        push = codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.2))
        commands = [arm] if tick in (3, 700) else [push] if tick < 300 or 700 < tick < 1100 else []
        port.receive(commands)
        one.step(1e-3)
        assert port.sent() == same.publish(), tick
        same.advance(commands)
        assert one.get("now.x_m") == same.plant.now.x_m, tick
        assert one.get("now.motor_torque_n_m") == same.plant.now.motor_torque_n_m
    assert len(same.take_impacts()) == one.get("impact.count") > 0


REFUSED: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("table1-viscous", {}, "no sensors"),
    ("table1-walking", {"sensors": {}}, "no gait sensors"),
    ("table1-motor-soft", {"sensors": {"coarse": {}}}, "no coarse position sensor"),
)


@pytest.mark.parametrize(("name", "tables", "reason"), REFUSED)
def test_scenes_with_other_frames_are_refused(name: str, tables: dict[str, Any], reason: str) -> None:
    scene = load_scene({**load_scene(name).model_dump(exclude_none=True), **tables})
    with pytest.raises(FmuError, match=reason):
        PlantNodeModel(scene, 1, 1e-3)
