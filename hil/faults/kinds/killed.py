"""A process that is killed."""

import math
from typing import ClassVar, Literal

from hil.faults.on_process import ProcessFault


class Killed(ProcessFault):
    """A process is killed and not restarted."""

    ends_process: ClassVar[bool] = True
    kind: Literal["killed"]

    @property
    def end_s(self) -> float:
        """Never, whatever the duration: the process is not started again."""
        return math.inf
