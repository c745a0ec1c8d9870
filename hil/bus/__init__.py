"""Every bus behind one `open_bus(spec)`."""

from hil.bus.base import Bus, BusCounters, BusError, Loss
from hil.bus.opening import ProvidedBus, join, open_bus, provide

__all__ = ["Bus", "BusCounters", "BusError", "Loss", "ProvidedBus", "join", "open_bus", "provide"]
