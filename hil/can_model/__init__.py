"""A CAN bus in integer bit times: arbitration, exact frame lengths, errors and fault confinement."""

from hil.can_model.fault_confinement import ErrorCounters, ErrorState
from hil.can_model.in_process import ModelledInProcessBus, ModelledNode
from hil.can_model.modelled_bus import BusFigures, Delivery, ModelledBus
from hil.can_model.state import Corruption

__all__ = [
    "BusFigures",
    "Corruption",
    "Delivery",
    "ErrorCounters",
    "ErrorState",
    "ModelledBus",
    "ModelledInProcessBus",
    "ModelledNode",
]
