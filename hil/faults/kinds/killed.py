"""A process that is killed."""

from typing import ClassVar, Literal

from hil.faults.on_process import ProcessFault


class Killed(ProcessFault):
    """A process is killed and not restarted."""

    ends_process: ClassVar[bool] = True
    kind: Literal["killed"]

    def acts(self, t_s: float) -> bool:
        """Whether the process is dead, also after `end_s`."""
        return t_s >= self.at_s - 1e-9
