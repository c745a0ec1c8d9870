"""Effect of the stop's model: one impact orbit with each stop."""

import math
import statistics
from functools import partial
from typing import Any

import numpy as np

from plant_sim.simulation import simulate
from tools.trade.costs import COST_UNIT, Progress, mean, spent_us
from tools.trade.parts import HERTZ, RATIO, RIGID, scene_with

UNTIL_S = 30.0
"""Duration of a run, s; its second half is evaluated."""

STOPS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("Hunt–Crossley, 10 ms", HERTZ),
    ("rigid", RIGID),
    ("Kelvin–Voigt, 10 ms", {**HERTZ, "law": "kelvin-voigt"}),
    ("Hunt–Crossley, 2 ms", {**HERTZ, "contact_s": 0.002}),
    ("Hunt–Crossley, 5 ms", {**HERTZ, "contact_s": 0.005}),
    ("Hunt–Crossley, 30 ms", {**HERTZ, "contact_s": 0.03}),
)
"""Stops; the first, the bench's own, is the reference for the others."""

QUICK_STOPS = 2


def measure(quick: bool, repeats: int, progress: Progress) -> list[dict[str, Any]]:
    """Run each stop and return its impulse, peak force, v⁻ and cost.

    The error is the impulse's relative deviation from the first stop's.
    """
    scenes = [(name, scene_with({"stop": stop})) for name, stop in (STOPS[:QUICK_STOPS] if quick else STOPS)]
    results = []
    for name, scene in scenes:
        progress(name)
        results.append(simulate(scene, UNTIL_S))
    rounds = [
        [spent_us(partial(simulate, scene, UNTIL_S)) / UNTIL_S for _, scene in scenes] for _ in range(repeats)
    ]
    wanted = math.nan
    rows: list[dict[str, Any]] = []
    for (name, scene), result, times in zip(scenes, results, zip(*rounds, strict=True), strict=True):
        late = result.impacts.t_s > 0.5 * UNTIL_S
        impulse_n_s = mean(result.impacts.impulse_n_s[late])
        wanted = wanted if rows else impulse_n_s
        period_s = 2.0 * math.pi / (RATIO * scene.natural_rad_s)
        rows.append(
            {
                "what": f"fidelity: {name}",
                "kind": "fidelity",
                "error": abs(impulse_n_s / wanted - 1.0),
                "impulse_n_s": impulse_n_s,
                "peak_force_n": mean(result.impacts.peak_force_n[late]),
                "approach_m_s": mean(result.impacts.v_m_s[late]),
                "impacts_per_period": np.count_nonzero(late) * period_s / (0.5 * UNTIL_S),
                "method": result.method,
                "cost": min(times),
                "cost_median": statistics.median(times),
                "unit": f"share of the impulse with the first stop; {COST_UNIT}",
            }
        )
    return rows
