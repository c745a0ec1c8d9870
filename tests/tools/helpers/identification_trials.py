"""The success rate of the identification: sampled modules of every friction law, recorded and identified.

A trial samples its module as a campaign does, with a slightly larger mismatch, records a minute with the
bench's compiled loop (`recorded` states the differences from a run's log) and identifies the module as from a
file. No log can identify l0, so the stop's position is compared relative to the true l0.
"""

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from firmware_py.core.estimation.striker_model import STANDARD_GRAVITY_M_S2
from firmware_py.shell.parameters import with_overrides
from plant_sim.scene import Scene, load_scene
from tools.campaign.modules import LAWS, Law
from tools.campaign.sampling import MISMATCH, sample
from tools.campaign.statistics import wilson
from tools.jobs import results
from tools.output import BadInputError
from tools.tuning.identification.identify import identify
from tools.tuning.recordings.readings import merge_ticks
from tools.tuning.recordings.recorded import read_received, record

SECONDS = 60.0
SEED = 30_000
WIDER = {**MISMATCH, "mismatch_spring": 0.05, "mismatch_amplitude": 0.03}
MODULES = {
    "viscous": LAWS["viscous"],
    "coulomb": LAWS["coulomb"],
    "stribeck": LAWS["stribeck"],
    "coulomb and viscous": Law({"law": "coulomb", "mu": 0.05, "b_n_s_m": 0.1}, 0.025),
}
"""The sampled modules by the name that identification gives to their friction law."""
RATIOS = {"viscous": (1.1, 1.2, 1.3)}
DRY_RATIOS = (1.0, 1.1, 1.2)
LIMITS = {
    "spring": 0.005,
    "amplitude": 0.005,
    "restitution": 0.01,
    "contact": 0.03,
    "stop": 1e-4,
    "damping": 0.05,
    "dry": 0.05,
}
"""The goals: largest error of each quantity, relative, k and the stop's in m absolute; μ's is as b's."""
ABSOLUTE = ("stop", "restitution")
GOAL = 0.99
"""Required share of the trials within each limit, and of the correctly named friction laws."""


@dataclass(frozen=True)
class Trial:
    """The friction law as named, the error of each quantity, and whether its 95 % bounds contain the truth.

    `scores`: the size of each error in standard errors. An error is None if the true value is 0.
    """

    trial: int
    law: str
    named: str
    why: str
    errors: dict[str, float | None]
    held: dict[str, bool]
    scores: dict[str, float]


def module_of(trial: int) -> tuple[str, float]:
    """The friction law and ratio of a trial: all laws in turn, then all ratios."""
    names = tuple(MODULES)
    law = names[trial % len(names)]
    ratios = RATIOS.get(law, DRY_RATIOS)
    return law, ratios[trial // len(names) % len(ratios)]


def run_trial(seed: int, trial: int, seconds: float) -> Trial:
    """Sample a module, record it, identify it, and compare the result with the truth."""
    law, ratio = module_of(trial)
    known = MODULES[law]
    cell = known.cell(law, ratio)
    sampled = sample(cell.scene, WIDER, seed, trial)
    nominal = with_overrides(known.nominal)
    ticks = read_received(record(cell, sampled, seconds))
    try:
        found = identify(
            merge_ticks(ticks, nominal["sensor.low_full_scale_m_s2"]), nominal["sensor.bandwidth_hz"]
        )
    except BadInputError as error:
        return Trial(trial, law, "", str(error), {}, {}, {})
    truths = truths_of(load_scene(sampled.tables))
    errors: dict[str, float | None] = {}
    held, scores = {}, {}
    for name, (key, truth) in truths.items():
        if key not in found.values:
            continue
        value, (low, high) = found.values[key], found.bounds[key]
        errors[name] = None if truth == 0.0 else value - truth if name in ABSOLUTE else value / truth - 1.0
        if truth != 0.0 and found.spread[key] > 0.0:
            held[name] = low <= truth <= high
            scores[name] = abs(value - truth) / found.spread[key]
    return Trial(trial, law, found.law.value, "", errors, held, scores)


def truths_of(scene: Scene) -> dict[str, tuple[str, float]]:
    """The name among the identified values, and the true value, of each quantity."""
    striker, stop, friction = scene.striker, scene.stop, scene.friction
    mass_kg = float(striker.mass_kg)
    return {
        "spring": ("stiffness_1_s2", striker.spring_n_m / mass_kg),
        "amplitude": ("amplitude_m", float(scene.drive.amplitude_m)),
        "damping": ("damping_1_s", getattr(friction, "b_n_s_m", 0.0) / mass_kg),
        "dry": ("dry_m_s2", getattr(friction, "mu", 0.0) * STANDARD_GRAVITY_M_S2),
        "stop": ("stop_m", float(getattr(stop, "position_m", np.nan)) - float(striker.rest_length_m)),
        "restitution": ("restitution", float(getattr(stop, "restitution", np.nan))),
        "contact": ("contact_s", float(getattr(stop, "contact_s", np.nan))),
    }


def run_trials(trials: int, seed: int = SEED, seconds: float = SECONDS) -> list[Trial]:
    """Run all trials on all cores."""
    found = dict(results(partial(run_trial, seed, seconds=seconds), range(trials)))
    return [found[number] for number in range(trials)]


def summary(trials: Sequence[Trial]) -> dict[str, Any]:
    """Counts with Wilson's bounds and quantiles of the errors of the trials whose law is named right."""
    right = [one for one in trials if one.named == one.law]
    within: dict[str, dict[str, Any]] = {}
    for name, limit in LIMITS.items():
        errors = np.abs([error for one in right if (error := one.errors.get(name)) is not None])
        held = [one.held[name] for one in right if name in one.held]
        if len(errors):
            p50, p95, worst = np.percentile(errors, [50, 95, 100]).tolist()
            share = wilson(int(np.count_nonzero(errors <= limit)), len(errors))
            within[name] = {**share._asdict(), "n": len(errors), "p50": p50, "p95": p95, "worst": worst}
            within[name]["in_bounds"] = {**wilson(sum(held), len(held))._asdict(), "n": len(held)}
    return {
        "named_right": {**wilson(len(right), len(trials))._asdict(), "n": len(trials)},
        "within": within,
        "wrong": [asdict(one) for one in trials if one.named != one.law],
        "passed": all(
            share >= GOAL for share in (len(right) / len(trials), *(one["value"] for one in within.values()))
        ),
    }
