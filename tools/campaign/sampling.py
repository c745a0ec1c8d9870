"""The sampled quantities of a trial: true parameters, initial state, sensor errors.

Every trial has its own random generators, seeded by the campaign's seed and the trial's number, so that a
failed trial can be repeated alone. Seeds below `FIRST_CAMPAIGN_SEED` are for tuning and tests: parameters
were chosen with them, so a campaign with such a seed is no independent evidence, and its result is marked
accordingly.
"""

from collections.abc import Mapping
from copy import deepcopy
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from plant_sim.scene import Scene, load_scene
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2

FIRST_CAMPAIGN_SEED = 10_000
SWING_HZ = (0.5, 2.0)
"""Range of the frequency of the housing's oscillation: strides."""
LARGEST_RUN_SEED = 10**9
"""Upper bound of a run's seed; a scenario accepts no larger one."""


@dataclass(frozen=True)
class Mismatch:
    """Half-widths of uniform distributions of the parameters; relative if the name has no unit."""

    spring: float = 0.02
    damping: float = 0.30
    restitution: float = 0.05
    rest_length_m: float = 1e-3
    stop_m: float = 3e-4
    dry_friction: float = 0.10
    bias_g: float = 0.05
    amplitude: float = 0.0


MISMATCH: dict[str, Any] = {f"mismatch_{name}": width for name, width in asdict(Mismatch()).items()}
"""The keys of the mismatch in a campaign's table."""


@dataclass(frozen=True)
class Sampled:
    """The truth of a trial as tables and as a checked scene, and the seeds of the run and of all else."""

    tables: Mapping[str, Any]
    scene: Scene
    run_seed: int
    more_seed: tuple[int, ...]


def mismatch_of(table: Mapping[str, float]) -> Mismatch:
    """Return the mismatch from the keys `mismatch_…` of a campaign's table."""
    return Mismatch(
        **{key.removeprefix("mismatch_"): value for key, value in table.items() if key[:9] == "mismatch_"}
    )


def sample(
    scene: Mapping[str, Any],
    mismatch: Mismatch,
    seed: int,
    trial: int,
    swing_m_s2: float = 0.0,
    at_rest: bool = False,
) -> Sampled:
    """Sample the truth of a trial.

    The initial position is −0.1 to 0.06 m from l₀ but not beyond the stop, the initial velocity ±0.8 m/s, the
    crank's phase arbitrary. With `at_rest` the striker keeps the scene's initial state. The
    housing oscillates with an amplitude of up to `swing_m_s2`.
    """
    noise, truth = (np.random.default_rng([seed, trial, stream]) for stream in range(2))

    def about(width: float) -> float:
        return float(truth.uniform(-width, width))

    sampled = deepcopy(dict(scene))
    striker, stop, friction, drive = (sampled[part] for part in ("striker", "stop", "friction", "drive"))
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
    sensors = sampled.setdefault("sensors", {})
    for name in ("striker_low", "housing"):
        bias_m_s2 = about(mismatch.bias_g) * STANDARD_GRAVITY_M_S2
        sensors[name] = {"bias_m_s2": bias_m_s2, **sensors.get(name, {})}
    highest_m = min(0.06, stop["position_m"] - striker["rest_length_m"])
    if not at_rest:
        sampled["initial"] = {
            "x_m": float(striker["rest_length_m"] + truth.uniform(-0.1, highest_m)),
            "v_m_s": about(0.8),
        }
    if swing_m_s2 > 0.0:
        harmonic = {
            "amplitude_m_s2": float(truth.uniform(0.0, swing_m_s2)),
            "frequency_hz": float(truth.uniform(*SWING_HZ)),
            "phase_rad": float(truth.uniform(0.0, 2.0 * np.pi)),
        }
        sampled["housing"] = {**sampled.get("housing", {}), "harmonic": harmonic}
    run_seed = int(noise.integers(LARGEST_RUN_SEED))
    return Sampled(sampled, load_scene(sampled), run_seed, (seed, trial, 2))
