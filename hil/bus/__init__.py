"""Every bus behind `provide(spec)`, which makes or names it, and `join(address)`."""

from hil.bus.base import Bus, BusCounters, BusError, Loss
from hil.bus.opening import ProvidedBus, join, provide

__all__ = ["Bus", "BusCounters", "BusError", "Loss", "ProvidedBus", "join", "provide"]
