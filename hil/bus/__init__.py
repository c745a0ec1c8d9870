"""Every bus behind one `open_bus(spec)`."""

from hil.bus.base import Bus, BusCounters, BusError
from hil.bus.opening import ProvidedBus, is_own_bus, join, join_in_turns, open_bus, provide, shared

__all__ = [
    "Bus",
    "BusCounters",
    "BusError",
    "ProvidedBus",
    "is_own_bus",
    "join",
    "join_in_turns",
    "open_bus",
    "provide",
    "shared",
]
