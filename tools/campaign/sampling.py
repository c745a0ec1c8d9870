"""The sampled quantities of a trial: true parameters, initial state, sensor errors.

Every trial has its own random generators, seeded by the campaign's seed and the trial's number, so that a
failed trial can be repeated alone. Seeds below `FIRST_CAMPAIGN_SEED` are for tuning and tests: parameters
were chosen with them, so a campaign with such a seed is no independent evidence, and its result is marked
accordingly.
"""

from collections.abc import Mapping
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np

from plant_sim.tables.table import STANDARD_GRAVITY_M_S2
from tools.output import BadInputError

FIRST_CAMPAIGN_SEED = 10_000
SWING_HZ = (0.5, 2.0)
"""Range of the frequency of the housing's oscillation: strides."""
LARGEST_RUN_SEED = 10**9
"""Upper bound of a run's seed; a scenario accepts no larger one."""


MISMATCH: Mapping[str, float] = {
    "mismatch_spring": 0.02,
    "mismatch_damping": 0.30,
    "mismatch_restitution": 0.05,
    "mismatch_rest_length_m": 1e-3,
    "mismatch_stop_m": 3e-4,
    "mismatch_dry_friction": 0.10,
    "mismatch_bias_g": 0.05,
    "mismatch_amplitude": 0.0,
}
"""Half-widths of uniform distributions of the true parameters; relative if the name has no unit."""


class Sampled(NamedTuple):
    """The truth of a trial as the tables of a scene, and the seed of its run."""

    tables: Mapping[str, Any]
    run_seed: int


def sample(
    scene: Mapping[str, Any], numbers: Mapping[str, float], seed: int, trial: int, at_rest: bool = False
) -> Sampled:
    """Sample the truth of a trial of a campaign with these numbers: the keys of MISMATCH, and `swing_m_s2`.

    The initial position is −0.1 to 0.06 m from l₀ but not beyond the stop, the initial velocity ±0.8 m/s, the
    crank's phase arbitrary. With `at_rest` the striker keeps the scene's initial state. The
    housing oscillates with an amplitude of up to `swing_m_s2`.
    """
    noise, truth = (np.random.default_rng([seed, trial, stream]) for stream in range(2))

    def mismatch(name: str) -> float:
        width = numbers[f"mismatch_{name}"]
        return float(truth.uniform(-width, width))

    sampled = deepcopy(dict(scene))
    striker, stop, friction, drive = (sampled[part] for part in ("striker", "stop", "friction", "drive"))
    striker["spring_n_m"] *= 1.0 + mismatch("spring")
    striker["rest_length_m"] += mismatch("rest_length_m")
    stop["position_m"] += mismatch("stop_m")
    stop["restitution"] += mismatch("restitution")
    drive["amplitude_m"] *= 1.0 + mismatch("amplitude")
    drive["phase_rad"] = float(truth.uniform(0.0, 2.0 * np.pi))
    damping, dry = 1.0 + mismatch("damping"), 1.0 + mismatch("dry_friction")
    for name in ("b_n_s_m", "mu", "mu_s"):
        if name in friction:
            friction[name] *= damping if name == "b_n_s_m" else dry
    sensors = sampled.setdefault("sensors", {})
    for name in ("striker_low", "housing"):
        bias_m_s2 = mismatch("bias_g") * STANDARD_GRAVITY_M_S2
        sensors[name] = {"bias_m_s2": bias_m_s2, **sensors.get(name, {})}
    highest_m = min(0.06, stop["position_m"] - striker["rest_length_m"])
    if not at_rest:
        if highest_m < -0.1:
            raise BadInputError(
                f"scene.stop.position_m = {scene['stop']['position_m']:g}, as sampled "
                f"{stop['position_m']:g}: the striker starts at up to 0.1 m behind striker.rest_length_m = "
                f"{striker['rest_length_m']:g}, and this stop is behind all starts; give a position further "
                "forward, or smaller mismatches"
            )
        sampled["initial"] = {
            "x_m": float(striker["rest_length_m"] + truth.uniform(-0.1, highest_m)),
            "v_m_s": float(truth.uniform(-0.8, 0.8)),
        }
    swing_m_s2 = numbers.get("swing_m_s2", 0.0)
    if swing_m_s2 > 0.0:
        harmonic = {
            "amplitude_m_s2": float(truth.uniform(0.0, swing_m_s2)),
            "frequency_hz": float(truth.uniform(*SWING_HZ)),
            "phase_rad": float(truth.uniform(0.0, 2.0 * np.pi)),
        }
        sampled["housing"] = {**sampled.get("housing", {}), "harmonic": harmonic}
    return Sampled(sampled, int(noise.integers(LARGEST_RUN_SEED)))
