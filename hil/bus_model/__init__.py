"""A CAN bus in integer bit times: arbitration, exact lengths, errors and what they do to the nodes."""

from hil.bus_model.fault_confinement import ErrorCounters, Standing
from hil.bus_model.in_process import ModelledInProcessBus, ModelledNode
from hil.bus_model.modelled_bus import BusFigures, Delivery, ModelledBus
from hil.bus_model.state import Corruption

__all__ = [
    "BusFigures",
    "Corruption",
    "Delivery",
    "ErrorCounters",
    "ModelledBus",
    "ModelledInProcessBus",
    "ModelledNode",
    "Standing",
]
