"""What a trial draws: the truth beside the firmware's beliefs, where the striker starts, the sensors' errors.

Every trial has a generator of its own, of the campaign's seed and the trial's number, so that a failure is
run again alone. Seeds below `FIRST_CAMPAIGN_SEED` are for tuning and tests: parameters were chosen on them,
so a campaign on one of them proves nothing, and says so.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from plant_sim.scene import Scene, load_scene

FIRST_CAMPAIGN_SEED = 10_000
DEFAULT_SEED = 20_260

STANDARD_GRAVITY_M_S2 = 9.80665


@dataclass(frozen=True)
class Mismatch:
    """Half-widths of uniform distributions; relative where the name has no unit."""

    spring: float = 0.02
    damping: float = 0.30
    restitution: float = 0.05
    rest_length_m: float = 1e-3
    stop_m: float = 3e-4
    dry_friction: float = 0.10
    bias_g: float = 0.05
    amplitude: float = 0.0


@dataclass(frozen=True)
class Drawn:
    """One trial's truth, and generators for its sensors' noise and its script."""

    scene: Scene
    noise: np.random.Generator
    more: np.random.Generator


def mismatch_of(table: Mapping[str, float]) -> Mismatch:
    """The mismatch with a campaign's own numbers, `mismatch_…` in its table."""
    return Mismatch(
        **{key.removeprefix("mismatch_"): value for key, value in table.items() if key[:9] == "mismatch_"}
    )


def draw(scene: Mapping[str, Any], mismatch: Mismatch, seed: int, trial: int) -> Drawn:
    """The truth of a trial; x₀ in −0.1…0.06 m about l₀ but not beyond the stop, v₀ in ±0.8 m/s, any phase."""
    noise, truth, more = (np.random.default_rng([seed, trial, stream]) for stream in range(3))

    def about(width: float) -> float:
        return float(truth.uniform(-width, width))

    drawn = deepcopy(dict(scene))
    striker, stop, friction, drive = drawn["striker"], drawn["stop"], drawn["friction"], drawn["drive"]
    striker["spring_n_m"] *= 1.0 + about(mismatch.spring)
    striker["rest_length_m"] += about(mismatch.rest_length_m)
    stop["position_m"] += about(mismatch.stop_m)
    stop["restitution"] += about(mismatch.restitution)
    drive["amplitude_m"] *= 1.0 + about(mismatch.amplitude)
    drive["phase_rad"] = float(truth.uniform(0.0, 2.0 * np.pi))
    damping, dry = 1.0 + about(mismatch.damping), 1.0 + about(mismatch.dry_friction)
    for name in ("b_n_s_m", "mu", "mu_s"):
        if name in friction:
            friction[name] *= damping if name == "b_n_s_m" else dry
    sensors = drawn.setdefault("sensors", {})
    for name in ("striker_low", "housing"):
        bias_m_s2 = about(mismatch.bias_g) * STANDARD_GRAVITY_M_S2
        sensors[name] = {"bias_m_s2": bias_m_s2, **sensors.get(name, {})}
    highest_m = min(0.06, stop["position_m"] - striker["rest_length_m"])
    drawn["initial"] = {
        "x_m": float(striker["rest_length_m"] + truth.uniform(-0.1, highest_m)),
        "v_m_s": about(0.8),
    }
    return Drawn(load_scene(drawn), noise, more)
