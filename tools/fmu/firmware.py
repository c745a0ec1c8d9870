"""The firmware as an FMU: frames in, frames out, one tick a step."""

from collections.abc import Mapping
from typing import Any

from firmware_py.builds.c_compiler import object_code
from firmware_py.node.memory import INITIAL
from firmware_py.node.tick import NO_TX
from firmware_py.shell.parameters import config_from
from tools.fmu.machine_code import flat
from tools.fmu.variables import MOST_RECEIVED, frame_places, frame_variables


class FirmwareModel:
    """The firmware with the parameters that differ from its defaults: everything its FMU is made of."""

    name = "firmware"

    def __init__(self, parameters: Mapping[str, Any]) -> None:
        """Raises ParameterError for parameters that the firmware refuses."""
        config = config_from(parameters)
        self.fixed_step_s: float | None = config.p.control.tick_s
        self.variables = [
            *frame_variables("received", "input", MOST_RECEIVED),
            *frame_variables("sent", "output", len(NO_TX._fields) - 1),
        ]
        self.records: dict[str, Any] = {"config": flat(config), "state": flat(INITIAL), "tx": flat(NO_TX)}

    def code(self) -> list[bytes]:
        """The object file of the emitted C for this machine."""
        return [object_code("host")]

    def header(self) -> str:
        """The part of `model.h` that only the firmware has."""
        return f"{frame_places(self.variables)}\n#define ACTS_ON_PARTS(i) 0"
