"""The modules of the studies: the paper's Table 1, the retuned module, and values not in the paper."""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

from plant_sim.scene import Scene, load_scene

LAWS = ("viscous", "coulomb", "stribeck")

VISCOUS_RANGE_N_S_M = (0.1, 0.2, 0.3)
"""Range of b in Table 1."""

DRY_RANGE = (0.15, 0.2, 0.25, 0.3)
"""Range of μ in Table 1."""

SPRINGS_N_PER_M = {
    "table1": 70.0,  # as printed
    "gait": 505.0,  # puts ω at 4.0 Hz, where the text has it
}

AMPLITUDES_M = {
    # The paper gives no amplitude. With viscous friction and 20 mm the striker reaches the stop for r = 0.82
    # to 1.41. With dry friction c A must exceed μ m g, which takes 22 mm at μ = 0.2; 30 mm is the next round
    # value.
    "table1": {"viscous": 0.02, "coulomb": 0.03, "stribeck": 0.03},
    # With this amplitude the first impacts are at r = 0.89 to 1.10 for all laws.
    "gait": {"viscous": 0.012, "coulomb": 0.012, "stribeck": 0.012},
}

PRESETS = tuple(SPRINGS_N_PER_M)

STATIC_OVER_SLIDING = 4.0 / 3.0
"""μ_s / μ, not in the paper; static friction of liners exceeds sliding friction by a quarter to a half."""

STRIBECK_SPEED_M_S = 0.05
"""v_s, not in the paper; at a tenth of the striker's speed friction falls noticeably within every stroke."""

STRIBECK_EXPONENT = 1.0
"""δ, not in the paper; 1 is the plain exponential."""

COEFFICIENTS = {"viscous": ("b_n_s_m",), "coulomb": ("mu",), "stribeck": ("mu", "mu_s", "v_s_m_s", "delta")}
"""Coefficients of each law in a scene."""


@dataclass(frozen=True)
class Case:
    """A module without its crank's speed; `contact_s` is a soft stop's elastic contact time (None: rigid)."""

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
        """Natural frequency ω = √(c/m)."""
        return math.sqrt(self.spring_n_m / self.mass_kg)

    @property
    def gap_m(self) -> float:
        """Gap between rest length and stop, x_stop − l0."""
        return self.stop_m - self.rest_length_m

    @property
    def coefficient(self) -> float:
        """The friction law's coefficient: b in N s/m, or μ."""
        return self.b_n_s_m if self.law == "viscous" else self.mu

    @property
    def label(self) -> str:
        """Displayed name: the friction law and its coefficient."""
        symbol, unit = ("b", " N s/m") if self.law == "viscous" else ("μ", "")
        return f"{self.law}, {symbol} = {self.coefficient:g}{unit}"

    @property
    def name(self) -> str:
        """Name in the names of files: preset, law, its coefficient and the drive's amplitude."""
        return f"{self.preset}-{self.law}-{self.coefficient:.12g}-{1e3 * self.amplitude_m:.12g}mm"

    def parameters(self) -> dict[str, Any]:
        """Return all parameters on which the results depend."""
        return asdict(self)

    def tables(self, ratio: float) -> dict[str, Any]:
        """Return the tables of the scene at Ω = ratio · ω."""
        stop: dict[str, Any] = {"law": "rigid", "position_m": self.stop_m, "restitution": self.restitution}
        if self.contact_s is not None:
            stop |= {"law": "hunt-crossley", "contact_s": self.contact_s}
        return {
            "striker": {name: getattr(self, name) for name in ("mass_kg", "spring_n_m", "rest_length_m")},
            "drive": {"model": "ideal", "amplitude_m": self.amplitude_m, "ratio": ratio},
            "friction": {"law": self.law, **{name: getattr(self, name) for name in COEFFICIENTS[self.law]}},
            "stop": stop,
        }

    def scene(self, ratio: float) -> Scene:
        """Return the scene at Ω = ratio · ω."""
        return load_scene(self.tables(ratio))


def case(preset: str, law: str, value: float | None = None, **changes: Any) -> Case:
    """Return a preset's module with a friction law at `value` (b in N s/m, or μ).

    The default is b = 0.2 N s/m, the middle of Table 1, or μ = 0.15, its lowest value. `changes` replace
    fields.
    """
    settings: dict[str, Any] = {
        "spring_n_m": SPRINGS_N_PER_M[preset],
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
    """Return the cases of the presets and laws over Table 1's ranges of friction."""
    return [
        case(preset, law, value)
        for preset in presets
        for law in laws
        for value in (VISCOUS_RANGE_N_S_M if law == "viscous" else DRY_RANGE)
    ]
