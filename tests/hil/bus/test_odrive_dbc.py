"""Every message of ODrive's own DBC (0.6.10, from odrive-can) is obeyed, answered, or refused by an error."""

import struct

import odrive_can.utils
import pytest
from cantools.database.can import Message

from firmware_py.interface.enums import AxisError, AxisState, ProcedureResult
from firmware_py.interface.frame import Frame
from hil.drive.axis import clear_errors
from hil.nodes.plant.node import ACCEPTED_IDS, PlantNode
from plant_sim import load_scene

MESSAGES = [
    one
    for one in odrive_can.utils.get_dbc().messages
    if one.name.startswith("Axis0_") and one.name != "Axis0_TxSdo"
]
"""All but the drive's answer to RxSdo, which is refused."""
COMMANDS = {
    "Set_Axis_State", "Set_Controller_Mode", "Set_Input_Vel", "Set_Input_Torque", "Set_Limits",
    "Clear_Errors", "Set_Absolute_Position", "Estop",
}  # fmt: skip
"""Those that are modelled."""


@pytest.mark.parametrize("message", MESSAGES, ids=lambda message: message.name)
def test_every_message_of_odrives_dbc_is_obeyed_answered_or_refused(message: Message) -> None:
    node, other = (PlantNode(load_scene("table1-motor-soft"), 1) for _ in range(2))
    for one in (node, other):
        one.publish()
        one.advance([Frame(0x07, struct.pack("<I", 8)), Frame(0x0E, struct.pack("<f", 0.0))])
        one.publish()
    assert message.frame_id in ACCEPTED_IDS
    name = message.name.removeprefix("Axis0_")
    if name.startswith("Get_") or name in ("Heartbeat", "Address"):
        node.advance([Frame(message.frame_id, b"")])
        other.advance([])
        *usual, answer = node.publish()
        assert usual == other.publish()
        assert (answer.can_id, len(answer.data)) == (message.frame_id, message.length)
        assert message.decode(answer.data)
        node.advance([Frame(message.frame_id, bytes(8))])  # another node's report, not a request
        other.advance([])
        assert node.publish() == other.publish()
        assert node.state.rejected == 0
        return
    idle_or_torque_passed_through = struct.pack("<II", 1, 1)
    node.advance([Frame(message.frame_id, idle_or_torque_passed_through[: message.length])])
    refused = (AxisState.IDLE, AxisError.BAD_CONFIG, AxisError.BAD_CONFIG, ProcedureResult.DISARMED)
    assert (node.drive.axis == refused) is (name not in COMMANDS)
    assert node.state.rejected == 0


@pytest.mark.parametrize(("number", "refused"), [(0, False), (7, True)])
def test_a_new_node_number_is_refused(number: int, refused: bool) -> None:
    """It is a parameter of the module; who gives the drive the one that it has changes nothing."""
    node = PlantNode(load_scene("table1-motor-soft"), 1)
    node.publish()
    node.advance([Frame(0x7E6, b"")])
    serial = node.publish()[-1].data[1:7]
    node.advance([Frame(0x7E6, bytes((number,)) + serial)])
    assert (node.drive.axis.errors == AxisError.BAD_CONFIG) is refused
    node.state = node.state._replace(drive=clear_errors(node.drive))
    node.publish()
    node.advance([Frame(0x7E6, bytes((7, 1, 2, 3, 4, 5, 6)))])  # another drive's
    assert node.drive.axis.errors == 0
