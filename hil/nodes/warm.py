"""Runs all code of a node once before its clock starts: compiled kernels, imports, caches."""

from collections.abc import Mapping
from typing import Any

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, OperatorRequest
from firmware_py.interface.generated.records import OperatorCommand, SetAxisState, SetInputTorque
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.parameters import config_from
from hil.nodes.plant import PlantNode
from plant_sim.scene import Scene

WARM_TICKS = 300


def warm_plant(scene: Scene) -> None:
    """Compile and run the scene's kernels on a temporary plant."""
    node = PlantNode(scene, seed=0)
    arm = codec.SET_AXIS_STATE.encode(SetAxisState(AxisState.CLOSED_LOOP_CONTROL))
    push = codec.SET_INPUT_TORQUE.encode(SetInputTorque(0.1))
    for _ in range(WARM_TICKS):
        node.publish()
        node.advance([arm, push])
        node.take_impacts()


def warm_firmware(parameters: Mapping[str, Any], build: Build = "python") -> None:
    """Run a temporary firmware on the frames of a drive at rest."""
    node = node_of(build)(config_from(parameters))
    for tick in range(WARM_TICKS):
        command = OperatorCommand(OperatorRequest.IDLE, 0.0, 0.0)
        node.tick([codec.OPERATOR_COMMAND.encode(command, tick)], 1)
