"""A node that is bus-off."""

from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.on_bus import ModelledFault, Node


class BusOff(ModelledFault):
    """A node whose CAN controller is held bus-off; afterwards it recovers by the rules of CAN."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["bus-off"]
    node: Node = Field(description="the node: plant, firmware or operator")

    @property
    def node_off(self) -> str:
        """The node."""
        return self.node
