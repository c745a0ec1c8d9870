"""A damaged parameter file."""

import re
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np

from hil.faults.fault import Fault
from hil.faults.on_process import MemoryFault, ProcessFault
from hil.roster import FIRMWARE
from plant_sim.scene import Scene

VALUE = re.compile(r"= (-?[0-9.e+-]+)$", re.MULTILINE)


class ParametersDamaged(MemoryFault):
    """A digit of the firmware's parameter file is changed, for a firmware that starts during the fault."""

    is_steady: ClassVar[bool] = True
    kind: Literal["parameters-damaged"]

    def damaged(self, text: str, noise: np.random.Generator) -> str:
        """The file with one digit of one value changed."""
        digits = [
            place
            for match in VALUE.finditer(text)
            for place in range(match.start(1), match.end(1))
            if text[place].isdigit()
        ]
        place = digits[int(noise.integers(len(digits)))]
        other = (int(text[place]) + int(noise.integers(1, 10))) % 10
        return f"{text[:place]}{other}{text[place + 1 :]}"

    def without_object(self, scene: Scene, faults: Sequence[Fault]) -> str | None:
        """No firmware starts during the fault."""
        starts_s = [
            fault.end_s
            for fault in faults
            if isinstance(fault, ProcessFault) and fault.starts_anew and fault.process == FIRMWARE
        ]
        if any(self.acts(start_s) for start_s in (0.0, *starts_s)):
            return None
        return (
            "no firmware starts while the parameter file is damaged; let it begin at 0 s, or add a fault "
            "'restarted' of the firmware that ends during it"
        )
