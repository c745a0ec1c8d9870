"""The tables of a scene with a walker, as users write them."""

from itertools import pairwise
from typing import Literal, Self

from pydantic import Field, model_validator

from plant_sim.parts.walking import TOE_OFF
from plant_sim.tables.quantities import Acceleration, Duration, Frequency, Length, Number, WalkRatio
from plant_sim.tables.table import Table

LATEST_S = 86_400.0
"""Latest time in the script of a walk: the length of the longest run. Every stride up to it is sampled."""
MOST_ENTRIES = 1000
"""Largest number of paces, and of stumbles."""


class PaceTable(Table):
    """[[gait.pace]]: the walker's cadence from a time on."""

    at_s: Duration = Field(
        ge=0.0, le=LATEST_S, description="from when in s; between two paces that walk it changes evenly"
    )
    # The slowest is rehabilitation's 0.3 m/s at 0.44 Hz, the fastest a brisk 1.8 m/s at 1.1 Hz.
    stride_hz: Frequency = Field(
        ge=0.0, le=1.5, description="the strides a second, up to 1.5 and not between 0 and 0.2; 0: standing"
    )

    @model_validator(mode="after")
    def _walks_or_stands(self) -> Self:
        if 0.0 < self.stride_hz < _SLOWEST_HZ:
            raise ValueError(
                f"gait.pace.stride_hz = {self.stride_hz} is slower than anybody walks; give at least "
                f"{_SLOWEST_HZ}, or 0 for standing"
            )
        return self


_SLOWEST_HZ = 0.2


class StumbleTable(Table):
    """[[gait.stumble]]: the foot trips in the next mid-swing; the walk recovers in three strides."""

    at_s: Duration = Field(ge=0.0, le=LATEST_S, description="after when in s")
    # 15 m/s² for 80 ms take 0.6 m/s off a foot that swings at 4.
    knock_m_s2: Acceleration = Field(
        default=15.0, ge=0.0, description="the largest deceleration of the foot in m/s²"
    )


class GaitTable(Table):
    """[gait]: the module is on a walker's shank. The strides are sampled with the run's seed."""

    axis: Literal["up", "down", "forward", "backward", "outward", "inward"] = Field(
        description="where the striker's axis points, towards the stop: up or down along the shank, forward "
        "or backward across it, outward or inward"
    )
    pace: list[PaceTable] = Field(
        min_length=1,
        max_length=MOST_ENTRIES,
        description="the tables [[gait.pace]], in the order of time",
    )
    stumble: list[StumbleTable] = Field(
        default=[], max_length=MOST_ENTRIES, description="the tables [[gait.stumble]]"
    )
    # The lower third of the shank, above an ankle exoskeleton's joint.
    mount_m: Length = Field(default=0.1, description="the module's height over the ankle in m")
    # Healthy walkers; 3 to 6 % after a stroke.
    variability: Number = Field(
        default=0.02,
        ge=0.0,
        le=0.2,
        description="the deviation of each stride's frequency, size and length, as a share of itself",
    )
    # The curves have 0.62; a paretic leg stands shorter, the other one longer.
    stance_share: Number = Field(
        default=TOE_OFF, ge=0.5, le=0.75, description="the phase at which the foot leaves the ground"
    )
    range_share: Number = Field(
        default=1.0, ge=0.0, le=1.5, description="the leg's range of motion over a healthy one's"
    )
    # Step length over cadence is nearly the same at all speeds: 0.0065 m min (Sekiya & Nagasaki 1998), so
    # that a stride is 1.4 m long at 0.9 Hz.
    walk_ratio_m_s: WalkRatio = Field(
        default=1.56, ge=0.0, le=3.0, description="the stride's length over its frequency in m s"
    )
    # 1 g at the shank at natural cadence: the lower end of what bone-mounted accelerometers read.
    heel_strike_m_s2: Acceleration = Field(
        default=10.0,
        ge=0.0,
        description="a heel strike's peak at the shank in m/s² at 0.9 Hz, growing as the cadence's square",
    )

    @model_validator(mode="after")
    def _paces_in_order(self) -> Self:
        times = [pace.at_s for pace in self.pace]
        if times[0] != 0.0:
            raise ValueError(
                f"gait.pace begins at at_s = {times[0]}; the first pace is that of t = 0, set its at_s to 0"
            )
        for before, after in pairwise(times):
            if after <= before:
                raise ValueError(
                    f"gait.pace has at_s = {after} after at_s = {before}; put the paces in the order of time"
                )
        return self

    @property
    def direction(self) -> tuple[float, float, float]:
        """Direction of the axis in the shank's frame: up, forward, outward."""
        return _DIRECTIONS[self.axis]


_DIRECTIONS = {
    "up": (1.0, 0.0, 0.0),
    "down": (-1.0, 0.0, 0.0),
    "forward": (0.0, 1.0, 0.0),
    "backward": (0.0, -1.0, 0.0),
    "outward": (0.0, 0.0, 1.0),
    "inward": (0.0, 0.0, -1.0),
}
