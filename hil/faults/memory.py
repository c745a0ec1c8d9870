"""The firmware's parameter memory, and its faults."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from firmware_py.shell.parameters import with_overrides, written
from hil.scenario.fault_tables import Fault, ParametersDamaged

SEED_OF_MEMORY = 3000
"""Independent of the seeds of all other faults."""
VALUE = re.compile(r"= (-?[0-9.e+-]+)$", re.MULTILINE)


def with_another_digit(text: str, noise: np.random.Generator) -> str:
    """The parameter file with one digit of one value changed."""
    digits = [
        place
        for match in VALUE.finditer(text)
        for place in range(match.start(1), match.end(1))
        if text[place].isdigit()
    ]
    place = digits[int(noise.integers(len(digits)))]
    other = (int(text[place]) + int(noise.integers(1, 10))) % 10
    return f"{text[:place]}{other}{text[place + 1 :]}"


class ParameterMemory:
    """The parameter file that the firmware reads when it starts."""

    def __init__(self, parameters: Mapping[str, Any], faults: Sequence[Fault], seed: int) -> None:
        self._text = written(with_overrides(parameters))
        self._damages = [fault for fault in faults if isinstance(fault, ParametersDamaged)]
        self._noise = np.random.default_rng([seed, SEED_OF_MEMORY])

    def read(self, t_s: float) -> str:
        """The file's content for a firmware that starts at `t_s`."""
        text = self._text
        for damage in self._damages:
            if damage.acts(t_s):
                text = with_another_digit(text, self._noise)
        return text
