"""The commands of a scenario's script: what the operator asks for, and when."""

from enum import StrEnum
from typing import Literal, NamedTuple, Self

from pydantic import Field, model_validator

from plant_sim.tables.quantities import Duration, Impulse, Number
from plant_sim.tables.table import Table

LARGEST_RATIO = 4.0
"""Largest ratio that the command frame can carry."""
LARGEST_IMPULSE_N_S = 6.5
"""Largest impulse that the command frame can carry."""


class Request(StrEnum):
    """The request of a line of the script, valid until the next line."""

    IDLE = "idle"
    RUN = "run"
    CLEAR_FAULTS = "clear-faults"
    E_STOP = "e-stop"
    PROVE_WATCHDOG = "prove-watchdog"
    SILENT = "silent"
    """The operator's node is absent: it sends no frames."""


class Command(NamedTuple):
    """The request from `at_s` on; the ratio is Ω over the nominal ω, and an impulse of 0 means none."""

    at_s: float
    request: Request
    target_ratio: float
    target_impulse_n_s: float = 0.0


class CommandTable(Table):
    """One line of the script."""

    at_s: Duration = Field(ge=0.0, description="the command's time, in s from the start")
    request: Literal["idle", "run", "clear-faults", "e-stop", "prove-watchdog", "silent"] = Field(
        description="the request: idle, run, clear-faults, e-stop (repeated until the firmware confirms it), "
        "prove-watchdog (of the drive, before a start) or silent"
    )
    target_ratio: Number | None = Field(
        default=None, gt=0.0, le=LARGEST_RATIO, description="the drive's speed as a ratio of the nominal ω"
    )
    target_impulse_n_s: Impulse | None = Field(
        default=None,
        gt=0.0,
        le=LARGEST_IMPULSE_N_S,
        description="the impulse of an impact to be held, in N s, once the drive has reached its ratio",
    )

    @model_validator(mode="after")
    def _run_has_a_target(self) -> Self:
        if (self.request == "run") == (self.target_ratio is None):
            given = "no target_ratio" if self.target_ratio is None else f"target_ratio = {self.target_ratio}"
            raise ValueError(
                f"the command at {self.at_s} s asks for {self.request!r} with {given}; "
                "'run' takes a target_ratio, e.g. 1.3, the others none"
            )
        if self.request != "run" and self.target_impulse_n_s is not None:
            raise ValueError(
                f"the command at {self.at_s} s asks for {self.request!r} with target_impulse_n_s = "
                f"{self.target_impulse_n_s}; only 'run' takes one, leave it out"
            )
        return self
