"""The modules of the studies: the paper's Table 1, the retuned one, and the values that both leave open."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Coulomb, Friction, Stribeck, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.restitution import HERTZ_EXPONENT, hertz_stiffness, hunt_crossley_dissipation
from plant_sim.parts.stop import CONTACT_REFERENCE_SPEED_M_S, HuntCrossley, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2

LAWS = ("viscous", "coulomb", "stribeck")

VISCOUS_RANGE_N_S_M = (0.1, 0.2, 0.3)
"""Table 1."""

DRY_RANGE = (0.15, 0.2, 0.25, 0.3)
"""Table 1."""

SPRINGS_N_M = {
    "table1": 70.0,  # as printed
    "gait": 505.0,  # puts ω at 4.0 Hz, where the text has it
}

AMPLITUDES_M = {
    # The paper gives none. With a viscous guide 20 mm reaches the stop for r = 0.82 to 1.41; with dry
    # friction the spring's c A has to exceed μ m g, 22 mm at μ = 0.2, so that 30 mm is the first round figure
    # that moves.
    "table1": {"viscous": 0.02, "coulomb": 0.03, "stribeck": 0.03},
    # One amplitude for all laws puts their first impacts at r = 0.89 to 1.10.
    "gait": {"viscous": 0.012, "coulomb": 0.012, "stribeck": 0.012},
}

PRESETS = tuple(SPRINGS_N_M)

STATIC_OVER_SLIDING = 4.0 / 3.0
"""μ_s / μ. The paper gives none; static friction of liners exceeds the sliding one by a quarter to a half."""

STRIBECK_SPEED_M_S = 0.05
"""The paper gives none; a tenth of the striker's speed: friction falls within every stroke, and it shows."""

STRIBECK_EXPONENT = 1.0
"""The paper gives none; the plain exponential."""


@dataclass(frozen=True)
class Case:
    """One module without its crank's speed. `contact_s`: elastic contact of a soft stop; None: rigid."""

    preset: str
    law: str
    amplitude_m: float
    b_n_s_m: float = 0.0
    mu: float = 0.0
    mu_s: float = 0.0
    v_s_m_s: float = STRIBECK_SPEED_M_S
    delta: float = STRIBECK_EXPONENT
    restitution: float = 0.5  # middle of Table 1's 0.4 to 0.6
    contact_s: float | None = None
    mass_kg: float = 0.8  # Table 1
    spring_n_m: float = 70.0
    rest_length_m: float = 0.12  # Table 1
    stop_m: float = 0.18  # Table 1

    @property
    def natural_rad_s(self) -> float:
        """ω."""
        return math.sqrt(self.spring_n_m / self.mass_kg)

    @property
    def gap_m(self) -> float:
        """x_stop − l0."""
        return self.stop_m - self.rest_length_m

    @property
    def is_exact(self) -> bool:
        """Whether the motion has a closed form."""
        return self.law != "stribeck" and self.contact_s is None

    @property
    def label(self) -> str:
        """Law and what it is set to, for people."""
        value = f"b = {self.b_n_s_m:g} N s/m" if self.law == "viscous" else f"μ = {self.mu:g}"
        return f"{self.law}, {value}"

    def parameters(self) -> dict[str, Any]:
        """Everything that the results depend on."""
        return asdict(self)

    def striker(self) -> Striker:
        """Mass, spring and rest length."""
        return Striker(self.mass_kg, self.spring_n_m, self.rest_length_m, STANDARD_GRAVITY_M_S2)

    def drive(self, ratio: float) -> IdealDrive:
        """The crank at Ω = ratio ω."""
        return IdealDrive(self.amplitude_m, ratio * self.natural_rad_s, 0.0)

    def closed_friction(self) -> Viscous | Coulomb:
        """The law for the closed form."""
        return Viscous(self.b_n_s_m) if self.law == "viscous" else Coulomb(self.mu, self.b_n_s_m)

    def friction(self) -> Friction:
        """The law as Stribeck's, which holds the other two: one kernel serves all of them."""
        static = self.mu_s if self.law == "stribeck" else self.mu
        return Stribeck(self.mu, static, self.v_s_m_s, self.delta, self.b_n_s_m)

    def rigid_stop(self) -> RigidStop:
        """Newton's."""
        return RigidStop(self.stop_m, self.restitution)

    def stop(self) -> RigidStop | HuntCrossley:
        """Rigid, or soft with the wanted elastic contact time at the scenes' reference speed."""
        if self.contact_s is None:
            return self.rigid_stop()
        stiffness = hertz_stiffness(self.mass_kg, self.contact_s, CONTACT_REFERENCE_SPEED_M_S)
        dissipation = hunt_crossley_dissipation(self.restitution)
        return HuntCrossley(self.stop_m, stiffness, HERTZ_EXPONENT, dissipation)

    def parts(self, ratio: float) -> Parts:
        """For the adaptive solver."""
        return Parts(self.striker(), self.drive(ratio), self.friction(), self.stop())


def case(preset: str, law: str, value: float | None = None, **changes: Any) -> Case:
    """A preset's module with a friction law at `value` (b in N s/m, or μ); middle of Table 1 by default."""
    settings: dict[str, Any] = {
        "spring_n_m": SPRINGS_N_M[preset],
        "amplitude_m": AMPLITUDES_M[preset][law],
    }
    if law == "viscous":
        settings["b_n_s_m"] = 0.2 if value is None else value
    else:
        settings["mu"] = 0.15 if value is None else value
    if law == "stribeck":
        settings["mu_s"] = STATIC_OVER_SLIDING * settings["mu"]
    return replace(Case(preset, law, **settings), **changes)


def whole_range(presets: tuple[str, ...], laws: tuple[str, ...]) -> list[Case]:
    """Table 1's ranges of friction."""
    return [
        case(preset, law, value)
        for preset in presets
        for law in laws
        for value in (VISCOUS_RANGE_N_S_M if law == "viscous" else DRY_RANGE)
    ]
