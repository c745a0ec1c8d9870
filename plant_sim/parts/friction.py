"""Friction laws of the striker's guide. Dry ones are set-valued at rest: the striker sticks.

Solvers name no law. The adaptive solver calls for the force and for its limit at rest; the closed form
supports only the laws of `ClosedForm`.
"""

import math
from typing import Annotated, Literal, NamedTuple, Self, TypeAlias

from pydantic import Field, model_validator

from plant_sim.jets import ROW, Jet, at_least, constant, exponential, product, square
from plant_sim.kernels import by_part, one_of, subroutine
from plant_sim.tables.quantities import Damping, Number, Speed
from plant_sim.tables.table import Table

ROUNDING = 1e-14
"""Tolerance of every limit at rest (friction, dry loss of a crank, stop), as a share of the largest term in
the sum of forces or torques: in every solver a part holds up to its limit plus this tolerance."""


class NoFriction(NamedTuple):
    """F_f = 0."""


class Viscous(NamedTuple):
    """F_f = −b x'."""

    b_n_s_m: float


class Coulomb(NamedTuple):
    """F_f = −μ m g sign(x') − b x'; sticks up to μ m g."""

    mu: float
    b_n_s_m: float


class Stribeck(NamedTuple):
    """F_f = −[μ + (μ_s − μ) exp(−(|x'|/v_s)^δ)] m g sign(x') − b x'; sticks up to μ_s m g."""

    mu: float
    mu_s: float
    v_s_m_s: float
    delta: float
    b_n_s_m: float


Friction: TypeAlias = NoFriction | Viscous | Coulomb | Stribeck
ClosedForm: TypeAlias = NoFriction | Viscous | Coulomb


@by_part
def static_limit_n(friction: Friction, normal_n: float) -> float:
    """Largest friction at rest, N, under the normal force m g; 0 for a law without sticking."""
    return 0.0


@static_limit_n.register(Coulomb)
def _coulomb_static_limit_n(friction: Coulomb, normal_n: float) -> float:
    return friction.mu * normal_n


@static_limit_n.register(Stribeck)
def _stribeck_static_limit_n(friction: Stribeck, normal_n: float) -> float:
    return friction.mu_s * normal_n


@subroutine
def set_off(pull: float, limit: float, margin: float, rate: float, is_on_stop: bool) -> int:
    """Direction, ±1, in which a body at rest sets off under a pull; 0 if it stays at rest.

    A pull that exceeds the limit by more than `margin` moves it. Within `margin` of the limit only a pull
    that grows outwards does; `rate` is its time derivative. A body on a stop does not set off forwards. Pull,
    limit and `margin` share a unit: of a force, a torque, or a spring's stretch.
    """
    if not is_on_stop and (pull > limit + margin or (pull > limit - margin and rate > 0.0)):
        return 1
    if pull < -limit - margin or (pull < margin - limit and rate < 0.0):
        return -1
    return 0


@by_part
def friction_force_n(friction: Friction, jet: Jet, normal_n: float, v_m_s: float, direction: float) -> float:
    """F_f, N, of a striker sliding in `direction`, ±1; within a solver's stage v may overshoot zero."""
    return 0.0


@friction_force_n.register(Viscous)
def _viscous_friction_force_n(
    friction: Viscous, jet: Jet, normal_n: float, v_m_s: float, direction: float
) -> float:
    return -friction.b_n_s_m * v_m_s


@friction_force_n.register(Coulomb)
def _coulomb_friction_force_n(
    friction: Coulomb, jet: Jet, normal_n: float, v_m_s: float, direction: float
) -> float:
    return -constant(jet, friction.mu * normal_n * direction) - friction.b_n_s_m * v_m_s


@friction_force_n.register(Stribeck)
def _stribeck_friction_force_n(
    friction: Stribeck, jet: Jet, normal_n: float, v_m_s: float, direction: float
) -> float:
    per_speed = direction / friction.v_s_m_s
    # Where a stage slides backwards the law is continued smoothly, as far as a solver may look ahead.
    if friction.delta == 1.0:
        power = at_least(jet, per_speed * v_m_s, -2.0)
    elif friction.delta == 2.0:
        power = per_speed * per_speed * square(jet, ROW.v_m_s, v_m_s)
    else:  # has no series
        power = abs(per_speed * v_m_s) ** friction.delta
    # Terms without the exponential come first, since the next stage of a solver waits for the exponential.
    weight_n = normal_n * direction
    sliding_n = -constant(jet, friction.mu * weight_n) - friction.b_n_s_m * v_m_s
    return sliding_n - (friction.mu_s - friction.mu) * weight_n * exponential(jet, -power)


@by_part
def friction_loss_w(
    friction: Friction, jet: Jet, force_n: float, normal_n: float, v_m_s: float, direction: float
) -> float:
    """−F_f x', W, of the friction force; a law by the square of x' has half as many terms in a series."""
    return -product(jet, ROW.drag_n, force_n, ROW.v_m_s, v_m_s)


@friction_loss_w.register(NoFriction, Viscous, Coulomb)
def _linear_friction_loss_w(
    friction: ClosedForm, jet: Jet, force_n: float, normal_n: float, v_m_s: float, direction: float
) -> float:
    dry_w = static_limit_n(friction, normal_n) * direction * v_m_s
    return dry_w + damping_n_s_m(friction) * square(jet, ROW.v_m_s, v_m_s)


is_stribeck = one_of(Stribeck)
"""Whether friction falls with speed as Stribeck's law has it."""

is_dry = one_of(Coulomb, Stribeck)
"""Whether the law has a dry part: the striker can stick, and friction reverses with its direction."""


@by_part
def friction_has_series(friction: Friction, normal_n: float) -> bool:
    """Whether the force of a sliding striker has a Taylor series."""
    return False


@friction_has_series.register(NoFriction, Viscous, Coulomb)
def _linear_friction_has_series(friction: ClosedForm, normal_n: float) -> bool:
    return True


@friction_has_series.register(Stribeck)
def _stribeck_friction_has_series(friction: Stribeck, normal_n: float) -> bool:
    """e^−p has a recurrence where the striker halts before it slides the other way, with p < 0."""
    return friction.delta in (1.0, 2.0) and static_limit_n(friction, normal_n) > 0.0


@by_part
def damping_n_s_m(friction: Friction) -> float:
    """b, N s/m, of the viscous part b v."""
    return 0.0


@damping_n_s_m.register(Viscous, Coulomb, Stribeck)
def _viscous_or_coulomb_or_stribeck_damping_n_s_m(friction: Viscous | Coulomb | Stribeck) -> float:
    return friction.b_n_s_m


@by_part
def bend_m_s(friction: Friction) -> float:
    """Speed, m/s, below which the force curves near rest; infinite for a linear law."""
    return math.inf


@bend_m_s.register(Stribeck)
def _stribeck_bend_m_s(friction: Stribeck) -> float:
    return friction.v_s_m_s if friction.mu_s > friction.mu else math.inf


@by_part
def times(friction: Friction, factor: float) -> Friction:
    """The law with its force multiplied by a factor at every speed."""
    raise NotImplementedError


@times.register(NoFriction, Viscous, Coulomb, Stribeck)
def times_coefficients(friction: Friction, factor: float) -> Friction:
    """All coefficients are multiplied: the force is linear in them."""
    coefficients = {"mu", "mu_s", "b_n_s_m"}.intersection(friction._fields)
    return friction._replace(**{name: factor * getattr(friction, name) for name in coefficients})


class NoFrictionTable(Table):
    """A guide without friction."""

    law: Literal["none"]

    def part(self) -> NoFriction:
        """The law's record."""
        return NoFriction()


class ViscousTable(Table):
    """Friction proportional to speed."""

    law: Literal["viscous"]
    b_n_s_m: Damping = Field(ge=0.0, description="the viscous coefficient in N s/m")

    def part(self) -> Viscous:
        """The law's record."""
        return Viscous(self.b_n_s_m)


class CoulombTable(Table):
    """Dry friction; it sticks."""

    law: Literal["coulomb"]
    mu: Number = Field(ge=0.0, description="the coefficient of dry friction")
    b_n_s_m: Damping = Field(default=0.0, ge=0.0, description="the viscous coefficient in N s/m")

    def part(self) -> Coulomb:
        """The law's record."""
        return Coulomb(self.mu, self.b_n_s_m)


class StribeckTable(Table):
    """Dry friction that falls from μ_s to μ with speed; it sticks."""

    law: Literal["stribeck"]
    mu: Number = Field(ge=0.0, description="the coefficient of sliding friction at speed")
    mu_s: Number = Field(ge=0.0, description="the coefficient of static friction, at least mu")
    v_s_m_s: Speed = Field(gt=0.0, description="the Stribeck speed in m/s")
    delta: Number = Field(gt=0.0, description="the Stribeck exponent")
    b_n_s_m: Damping = Field(default=0.0, ge=0.0, description="the viscous coefficient in N s/m")

    @model_validator(mode="after")
    def _static_not_below_sliding(self) -> Self:
        if self.mu_s < self.mu:
            raise ValueError(
                f"friction.mu_s = {self.mu_s} is below friction.mu = {self.mu}; "
                "static friction is at least the sliding one, raise mu_s or lower mu"
            )
        return self

    def part(self) -> Stribeck:
        """The law's record."""
        return Stribeck(self.mu, self.mu_s, self.v_s_m_s, self.delta, self.b_n_s_m)


FrictionTable: TypeAlias = Annotated[
    NoFrictionTable | ViscousTable | CoulombTable | StribeckTable, Field(discriminator="law")
]
