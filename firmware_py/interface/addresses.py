"""The node numbers of a module on its bus, and the identifiers that follow from them.

`vibro.dbc` lists a module's identifiers for the drive at node 0 and the module's own senders at nodes 1 to 3.
With other node numbers, the identifiers of the drive and of the module's own senders move accordingly; a
frame's CRC keeps the identifier of `vibro.dbc`. The bus driver of each node translates the identifiers; all
other code uses the default ones.
"""

from typing import NamedTuple

NODE_SHIFT = 5
NODE_IDS = 1 << NODE_SHIFT
"""Number of identifiers per node number."""
OWN_NODES = 3
"""Number of own nodes: sensors, operator and firmware, in this order."""
HIGHEST_NODE = 62
"""Largest node number; 63 is used by drives without a number."""
BROADCAST_NODE = 63
"""Node number of drives without a number and of their discovery; the same in all modules."""
NOT_OURS = -1
DEFAULT_DRIVE_NODE, DEFAULT_OWN_NODE = 0, 1


class Addresses(NamedTuple):
    """The drive's node number, and the sensors'; operator and firmware have the next two."""

    drive_node: int
    own_node: int


DEFAULT = Addresses(DEFAULT_DRIVE_NODE, DEFAULT_OWN_NODE)


class AddressError(ValueError):
    """Node numbers that a module cannot have."""


def addresses(drive_node: int, own_node: int) -> Addresses:
    """The addresses of a module; raises `AddressError` if they are out of range or overlap.

    >>> addresses(5, 4)
    Traceback (most recent call last):
    firmware_py.interface.addresses.AddressError: drive_node = 5 is one of the module's own nodes 4 to 6; \
give the drive another number
    """
    highest_own = HIGHEST_NODE - OWN_NODES + 1
    if not (0 <= drive_node <= HIGHEST_NODE and 0 <= own_node <= highest_own):
        raise AddressError(
            f"drive_node = {drive_node} and own_node = {own_node}; wanted 0 to {HIGHEST_NODE} and "
            f"0 to {highest_own}"
        )
    if own_node <= drive_node < own_node + OWN_NODES:
        raise AddressError(
            f"drive_node = {drive_node} is one of the module's own nodes {own_node} to "
            f"{own_node + OWN_NODES - 1}; give the drive another number"
        )
    return Addresses(drive_node, own_node)


def bus_id(module: Addresses, can_id: int) -> int:
    """The identifier on the bus of the frame that `vibro.dbc` calls `can_id`.

    >>> hex(bus_id(Addresses(4, 5), 0x00E)), hex(bus_id(Addresses(4, 5), 0x028))
    ('0x8e', '0xa8')
    """
    if can_id >> NODE_SHIFT == BROADCAST_NODE:
        return can_id
    if can_id < NODE_IDS:
        return can_id + module.drive_node * NODE_IDS
    return can_id + (module.own_node - DEFAULT_OWN_NODE) * NODE_IDS


def module_id(module: Addresses, can_id: int) -> int:
    """The identifier in `vibro.dbc` of a frame on the bus; `NOT_OURS` for frames of other nodes.

    >>> hex(module_id(Addresses(4, 5), 0x08E)), module_id(Addresses(4, 5), 0x028)
    ('0xe', -1)
    """
    node = can_id >> NODE_SHIFT
    if node == BROADCAST_NODE:
        return can_id
    if node == module.drive_node:
        return can_id - module.drive_node * NODE_IDS
    if module.own_node <= node < module.own_node + OWN_NODES:
        return can_id - (module.own_node - DEFAULT_OWN_NODE) * NODE_IDS
    return NOT_OURS
