"""Every bus behind one `open_bus(spec)`."""

from hil.bus.base import Bus, BusCounters, BusError, BusFailedError
from hil.bus.opening import ProvidedBus, is_own_bus, join, join_in_turns, open_bus, provide, shared

__all__ = [
    "Bus",
    "BusCounters",
    "BusError",
    "BusFailedError",
    "ProvidedBus",
    "is_own_bus",
    "join",
    "join_in_turns",
    "open_bus",
    "provide",
    "shared",
]
