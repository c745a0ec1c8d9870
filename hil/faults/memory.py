"""The firmware's parameter memory, and its faults."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from firmware_py.shell.parameters import format_file, select_build, with_overrides
from hil.faults.fault import Fault
from hil.faults.on_process import MemoryFault

SEED_OF_MEMORY = 3000
"""Independent of the seeds of all other faults."""


class ParameterMemory:
    """The parameter file that the firmware reads when it starts.

    `of_the_build`: the parameters that are no part of the file, because they are settled in the build.
    """

    def __init__(self, parameters: Mapping[str, Any], faults: Sequence[Fault] = (), seed: int = 1) -> None:
        self.of_the_build = select_build(parameters)
        self._text = format_file(with_overrides(parameters))
        self._damages = [fault for fault in faults if isinstance(fault, MemoryFault)]
        self._noise = np.random.default_rng([seed, SEED_OF_MEMORY])

    def read(self, t_s: float) -> str:
        """The file's content for a firmware that starts at `t_s`."""
        text = self._text
        for damage in self._damages:
            if damage.acts(t_s):
                damage.count()
                text = damage.damaged(text, self._noise)
        return text
