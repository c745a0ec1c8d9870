"""The stop at x = position_m, which the striker approaches with x' > 0."""

import math
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import Field, model_validator

from plant_sim.kernels import by_part, one_of, subroutine
from plant_sim.parts.restitution import (
    HERTZ_EXPONENT,
    hertz_stiffness,
    hunt_crossley_dissipation,
    kelvin_voigt_damping,
    linear_stiffness,
)
from plant_sim.parts.striker import Striker
from plant_sim.parts.wearer import Wearer, contact_mass_kg
from plant_sim.tables.quantities import Duration, Length, Number, PadStiffness
from plant_sim.tables.table import Table


class NoStop(NamedTuple):
    """No stop."""


class RigidStop(NamedTuple):
    """x'⁺ = −k x'⁻ at x = position_m (Newton)."""

    position_m: float
    restitution: float


class KelvinVoigt(NamedTuple):
    """F = K δ + D δ', δ = x − position_m ≥ 0; the pair is released when F would pull."""

    position_m: float
    stiffness_n_per_m: float
    damping_n_s_m: float


class HuntCrossley(NamedTuple):
    """F = K δⁿ (1 + λ δ'), λ = dissipation / touch-down speed, so that k does not vary with speed.

    Hunt & Crossley 1975. `dissipation` is the dimensionless λ·v⁻ for the given restitution.
    """

    position_m: float
    stiffness_n_per_mn: float
    exponent: float
    dissipation: float


Stop: TypeAlias = NoStop | RigidStop | KelvinVoigt | HuntCrossley

LEAST_TOUCH_SPEED_M_S = 1e-3
"""Below this speed λ is constant: a striker laid on the stop would meet unbounded damping."""


has_no_stop = one_of(NoStop)
"""Whether there is no stop."""


@subroutine
def origin_m(stop: Stop, striker: Striker) -> float:
    """Origin of the depth, m: the stop, so that depths near it keep their digits."""
    return striker.rest_length_m if has_no_stop(stop) else stop.position_m


@by_part
def damping_s_m(stop: Stop, touch_speed_m_s: float) -> float:
    """λ, s/m, of a contact that began at this speed; 0 for stops whose damping does not depend on it."""
    return 0.0


@damping_s_m.register(HuntCrossley)
def _hunt_crossley_damping_s_m(stop: HuntCrossley, touch_speed_m_s: float) -> float:
    return stop.dissipation / max(touch_speed_m_s, LEAST_TOUCH_SPEED_M_S)


@by_part
def elastic_force_n(stop: Stop, depth_m: float) -> float:
    """Force, N, of the stop's spring alone on the striker, against +x."""
    return 0.0


@elastic_force_n.register(KelvinVoigt)
def _kelvin_voigt_elastic_force_n(stop: KelvinVoigt, depth_m: float) -> float:
    return stop.stiffness_n_per_m * depth_m


@elastic_force_n.register(HuntCrossley)
def _hunt_crossley_elastic_force_n(stop: HuntCrossley, depth_m: float) -> float:
    force_n: float = stop.stiffness_n_per_mn * max(depth_m, 0.0) ** stop.exponent
    return force_n


@by_part
def stop_force_n(stop: Stop, elastic_n: float, v_m_s: float, damping_s_m: float) -> float:
    """Force, N, of the stop on a striker in contact, against +x, from that of its spring."""
    return 0.0


@stop_force_n.register(KelvinVoigt)
def _kelvin_voigt_stop_force_n(
    stop: KelvinVoigt, elastic_n: float, v_m_s: float, damping_s_m: float
) -> float:
    return elastic_n + stop.damping_n_s_m * v_m_s


@stop_force_n.register(HuntCrossley)
def _hunt_crossley_stop_force_n(
    stop: HuntCrossley, elastic_n: float, v_m_s: float, damping_s_m: float
) -> float:
    return elastic_n * max(1.0 + damping_s_m * v_m_s, 0.0)  # it never pulls


@by_part
def elastic_energy_j(stop: Stop, depth_m: float) -> float:
    """Energy, J, in the stop's spring."""
    return 0.0


@elastic_energy_j.register(KelvinVoigt)
def _kelvin_voigt_elastic_energy_j(stop: KelvinVoigt, depth_m: float) -> float:
    return 0.5 * stop.stiffness_n_per_m * depth_m * depth_m


@elastic_energy_j.register(HuntCrossley)
def _hunt_crossley_elastic_energy_j(stop: HuntCrossley, depth_m: float) -> float:
    return elastic_force_n(stop, depth_m) * depth_m / (stop.exponent + 1.0)


@by_part
def stop_position_m(stop: Stop) -> float:
    """Position of a rigid stop, m; infinite without a stop."""
    return math.inf


@stop_position_m.register(RigidStop)
def _rigid_stop_position_m(stop: RigidStop) -> float:
    return stop.position_m


is_rigid = one_of(RigidStop)
"""Whether an impact takes no time."""

is_soft = one_of(KelvinVoigt, HuntCrossley)
"""Whether an impact is a contact of finite duration."""

stop_has_series = one_of(NoStop, RigidStop, KelvinVoigt)
"""Whether the stop's force has a Taylor series."""


@by_part
def release_s(stop: Stop) -> float:
    """D/K, s, of a stop with a linear damper, which releases the striker before its surface; otherwise 0."""
    return 0.0


@release_s.register(KelvinVoigt)
def _kelvin_voigt_release_s(stop: KelvinVoigt) -> float:
    return stop.damping_n_s_m / stop.stiffness_n_per_m


@by_part
def restitution(stop: Stop) -> float:
    """Newton's k of a rigid stop."""
    return 1.0


@restitution.register(RigidStop)
def _rigid_stop_restitution(stop: RigidStop) -> float:
    return stop.restitution


@by_part
def contact_rate_rad_s(stop: Stop, mass_kg: float, touch_speed_m_s: float) -> float:
    """Approach speed over greatest depth of an undamped contact, rad/s: the rate of change in a contact."""
    return 0.0


@contact_rate_rad_s.register(KelvinVoigt)
def _kelvin_voigt_contact_rate_rad_s(stop: KelvinVoigt, mass_kg: float, touch_speed_m_s: float) -> float:
    return math.sqrt(stop.stiffness_n_per_m / mass_kg)


@contact_rate_rad_s.register(HuntCrossley)
def _hunt_crossley_contact_rate_rad_s(stop: HuntCrossley, mass_kg: float, touch_speed_m_s: float) -> float:
    # ½ m v² = K δⁿ⁺¹ / (n + 1)
    speed = max(touch_speed_m_s, LEAST_TOUCH_SPEED_M_S)
    order = stop.exponent + 1.0
    depth_m: float = (0.5 * order * mass_kg * speed * speed / stop.stiffness_n_per_mn) ** (1.0 / order)
    return speed / depth_m


CONTACT_REFERENCE_SPEED_M_S = 0.9
"""Approach speed for which `contact_s` holds: the module's at r = 1.3 (0.91 m/s)."""


class NoStopTable(Table):
    """No stop."""

    law: Literal["none"]

    def part(self, striker_kg: float, wearer: Wearer) -> NoStop:
        """No stop."""
        return NoStop()


_Position = Annotated[Length, Field(description="the stop's position in m")]


class RigidStopTable(Table):
    """Newton's impact law."""

    law: Literal["rigid"]
    position_m: _Position
    restitution: Number = Field(ge=0.0, le=1.0, description="the coefficient of restitution, 0 to 1")

    def part(self, striker_kg: float, wearer: Wearer) -> RigidStop:
        """The stop."""
        return RigidStop(self.position_m, self.restitution)


class SoftStopTable(Table):
    """The keys of all soft stops."""

    position_m: _Position
    restitution: Number = Field(
        gt=0.0,
        le=1.0,
        description="the coefficient of restitution, above 0 (a soft stop always returns some) to 1",
    )
    contact_s: Duration | None = Field(
        default=None,
        gt=0.0,
        description=f"the elastic contact time in s at {CONTACT_REFERENCE_SPEED_M_S} m/s of approach "
        "(hunt-crossley: to a fixed stop)",
    )
    stiffness: PadStiffness | None = Field(
        default=None, gt=0.0, description="the stop's stiffness in N/m (hunt-crossley: N/m^1.5)"
    )

    @model_validator(mode="after")
    def _one_stiffness(self) -> Self:
        if self.contact_s is not None and self.stiffness is not None:
            raise ValueError(
                f"stop.contact_s = {self.contact_s} and stop.stiffness = {self.stiffness} are both given; "
                "each gives the other, keep one of them"
            )
        if self.contact_s is None and self.stiffness is None:
            raise ValueError("stop has no stiffness; give one of stop.contact_s (in s) or stop.stiffness")
        return self


class KelvinVoigtTable(SoftStopTable):
    """A linear spring and damper that cannot pull."""

    law: Literal["kelvin-voigt"]

    def part(self, striker_kg: float, wearer: Wearer) -> KelvinVoigt:
        """The stop of a striker of this mass, on this wearer."""
        mass_kg = contact_mass_kg(wearer, striker_kg)
        stiffness = self.stiffness or linear_stiffness(mass_kg, self.contact_s or math.nan)
        damping = kelvin_voigt_damping(mass_kg, stiffness, self.restitution)
        return KelvinVoigt(self.position_m, stiffness, damping)


class HuntCrossleyTable(SoftStopTable):
    """A Hertzian spring whose damping grows with depth."""

    law: Literal["hunt-crossley"]

    def part(self, striker_kg: float, wearer: Wearer) -> HuntCrossley:
        """The stop of a striker of this mass."""
        stiffness = self.stiffness or hertz_stiffness(
            striker_kg, self.contact_s or math.nan, CONTACT_REFERENCE_SPEED_M_S
        )
        dissipation = hunt_crossley_dissipation(self.restitution)
        return HuntCrossley(self.position_m, stiffness, HERTZ_EXPONENT, dissipation)


StopTable: TypeAlias = Annotated[
    NoStopTable | RigidStopTable | KelvinVoigtTable | HuntCrossleyTable, Field(discriminator="law")
]
