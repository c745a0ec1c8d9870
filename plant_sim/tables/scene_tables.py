"""The tables of a scene file that describe no part of the module."""

from typing import Literal, Self

from pydantic import Field, model_validator

from plant_sim.tables.table import Table


class InitialTable(Table):
    """The striker at t = 0."""

    x_m: float | None = Field(
        default=None, description="the striker's position in m (default: rest_length_m)"
    )
    v_m_s: float = Field(default=0.0, description="the striker's velocity in m/s")


class SolverTable(Table):
    """The solver and its accuracy."""

    method: Literal["auto", "exact", "adaptive", "stepping"] = Field(
        default="auto", description="one of auto, exact, adaptive, stepping"
    )
    accuracy: float = Field(
        default=1e-9,
        ge=1e-13,
        le=1e-2,
        description="the largest state error per forcing period, in m and in m/s over ω, from 1e-13 to 1e-2",
    )
    step_s: float | None = Field(
        default=None, gt=0.0, description="the step of method = 'stepping' in s (default: from accuracy)"
    )

    @model_validator(mode="after")
    def _step_belongs_to_stepping(self) -> Self:
        if self.step_s is not None and self.method != "stepping":
            raise ValueError(
                f"solver.step_s = {self.step_s} is given while solver.method = {self.method!r} finds its own "
                "steps; delete it, or set solver.method = 'stepping'"
            )
        return self


class AxisTable(Table):
    """[axis]: the client's configuration of the drive, an ODrive axis."""

    # Half of the 100 ms in which the motor is to be free of torque.
    watchdog_s: float = Field(
        default=0.05, ge=1e-3, description="the time without a command after which the axis disarms, in s"
    )
    # ODrive's heartbeat_rate_ms, whose own default is 100 ms.
    heartbeat_s: float = Field(default=0.1, ge=1e-3, le=60.0, description="the heartbeat's period in s")
    # ODrive's encoder_msg_rate_ms, whose own default is 10 ms; the firmware needs a sample a tick.
    encoder_s: float | None = Field(
        default=None, ge=1e-3, le=60.0, description="the period of position and speed in s (default: a tick)"
    )
    control_mode: Literal["torque", "velocity"] = Field(
        default="torque", description="the drive's mode as its supply comes on: `torque` or `velocity`"
    )
