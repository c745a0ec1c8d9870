"""The tables of a scene file that describe no part of the module."""

from typing import Literal

from pydantic import Field

from plant_sim.tables.quantities import Length, Number, Speed
from plant_sim.tables.table import Table


class InitialTable(Table):
    """The striker at t = 0."""

    x_m: Length | None = Field(
        default=None, description="the striker's position in m (default: rest_length_m)"
    )
    v_m_s: Speed = Field(default=0.0, description="the striker's velocity in m/s")


class SolverTable(Table):
    """The solver and its accuracy."""

    method: Literal["auto", "exact", "adaptive"] = Field(
        default="auto", description="one of auto, exact, adaptive"
    )
    accuracy: Number = Field(
        default=1e-9,
        ge=1e-13,
        le=1e-2,
        description="the largest state error per forcing period, in m and in m/s over ω, from 1e-13 to 1e-2",
    )
