"""A node with its connector off."""

from typing import ClassVar, Literal

from pydantic import Field

from hil.faults.on_bus import LineFault, Node


class Unplugged(LineFault):
    """A node with its connector off: it neither sends nor receives."""

    is_beyond_log: ClassVar[bool] = True
    kind: Literal["unplugged"]
    node: Node = Field(description="the node: plant, firmware or operator")

    def unplugs(self, node: str) -> bool:
        """Whether this is the node."""
        return node == self.node
