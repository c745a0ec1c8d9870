"""The success rate of the identification: sampled modules of every friction law, recorded and identified.

A trial samples its module as a campaign does, with a slightly larger mismatch, records a minute with the
bench's compiled loop (`recorded` states the differences from a run's log) and identifies the module as from a
file. No log can identify l0, so the stop's position is compared relative to the true l0.

Each trial's outcome is appended to a file as a line of JSON. A killed run continues with this file, unless
its code or settings have changed.
"""

import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from firmware_py.core.configure import STANDARD_GRAVITY_M_S2
from firmware_py.shell.parameters import with_overrides
from hil.record import provenance
from tools.campaign.journal import journal
from tools.campaign.statistics import wilson
from tools.campaign.trial.cells import LAWS, Cell, Law
from tools.campaign.trial.sampling import Mismatch, sample
from tools.jobs import running
from tools.progress import Counted

SECONDS = 60.0
TRIALS = 300
SEED = 30_000
MISMATCH = Mismatch(spring=0.05, amplitude=0.03)
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
    "spring": (0.005, "of c"),
    "restitution": (0.01, "of k"),
    "stop": (1e-4, "m"),
    "damping": (0.05, "of b"),
    "dry": (0.05, "of mu"),
}
"""The goals: largest error of each quantity; the limit for μ is as wide as that for b."""
ABSOLUTE = ("stop", "restitution")
OF_FLIGHT = ("spring", "damping", "dry")
GOAL = 0.99
"""Required share of the trials within each limit, and of the correctly named friction laws."""


@dataclass(frozen=True)
class Trial:
    """The friction law as named, the error of each quantity, and whether its 95 % bounds contain the truth.

    `plain`: the errors of least squares alone. An error is None if the true value is 0.
    """

    trial: int
    law: str
    named: str
    why: str
    errors: dict[str, float | None]
    held: dict[str, bool]
    plain: dict[str, float | None]


def module_of(trial: int) -> tuple[str, float]:
    """The friction law and ratio of a trial: all laws in turn, then all ratios."""
    names = tuple(MODULES)
    law = names[trial % len(names)]
    ratios = RATIOS.get(law, DRY_RATIOS)
    return law, ratios[trial // len(names) % len(ratios)]


def run_trial(seed: int, trial: int, seconds: float) -> Trial:
    """Sample a module, record it, identify it, and compare the result with the truth."""
    from tools.output import BadInputError
    from tools.tuning.identification.identify import identify
    from tools.tuning.recordings.readings import of_ticks
    from tools.tuning.recordings.recorded import record

    law, ratio = module_of(trial)
    known = MODULES[law]
    cell = Cell(law, ratio, 0.0, known.scene, known.nominal)
    sampled = sample(cell.scene, MISMATCH, seed, trial)
    nominal = with_overrides(known.nominal)
    ticks, _ = record(cell, sampled, seconds)
    try:
        found = identify(
            of_ticks(ticks, nominal["sensor.low_full_scale_m_s2"]), nominal["sensor.bandwidth_hz"]
        )
    except BadInputError as error:
        return Trial(trial, law, "", str(error), {}, {}, {})
    striker, stop, friction = sampled.scene.striker, sampled.scene.stop, sampled.scene.friction
    mass_kg = float(striker.mass_kg)
    place_m = float(getattr(stop, "position_m", np.nan)) - float(striker.rest_length_m)
    fitted, impacts = found.fit.striker, np.median(np.array(found.impacts), axis=0) if found.impacts else None
    truths = {
        "spring": (fitted.stiffness_1_s2, "stiffness_1_s2", striker.spring_n_m / mass_kg),
        "damping": (fitted.damping_1_s, "damping_1_s", getattr(friction, "b_n_s_m", 0.0) / mass_kg),
        "dry": (fitted.dry_m_s2, "dry_m_s2", getattr(friction, "mu", 0.0) * STANDARD_GRAVITY_M_S2),
    }
    if impacts is not None:
        truths["stop"] = (float(impacts[0]), "stop_m", place_m)
        truths["restitution"] = (
            float(impacts[2]),
            "restitution",
            float(getattr(stop, "restitution", np.nan)),
        )
    errors: dict[str, float | None] = {}
    held: dict[str, bool] = {}
    for name, (value, key, truth) in truths.items():
        if truth == 0.0:
            errors[name] = None
            continue
        errors[name] = value - truth if name in ABSOLUTE else value / truth - 1.0
        if key in found.bounds:
            low, high = found.bounds[key]
            held[name] = low <= truth <= high
    plain = {
        name: None if truth == 0.0 else getattr(found.plain, key) / truth - 1.0
        for name, (_, key, truth) in truths.items()
        if name in OF_FLIGHT
    }
    return Trial(trial, law, found.law.value, "", errors, held, plain)


def run_trials(
    trials: int,
    path: Path,
    seed: int = SEED,
    seconds: float = SECONDS,
    progress: Counted = lambda *_: None,
    workers: int | None = None,
) -> list[Trial]:
    """Run all trials, except those whose outcomes are already in `path`."""
    key = provenance.key(seed, seconds)
    with journal(path) as (entries, add):
        known = [Trial(**entry) for entry in entries if entry.pop("key") == key]
        done = {one.trial: one for one in known if one.trial < trials}
        missing = [number for number in range(trials) if number not in done]
        progress(len(done), trials)
        if missing:
            one_of = partial(run_trial, seed, seconds=seconds)
            with running(one_of, min(workers or os.cpu_count() or 1, len(missing))) as run:
                for _, one in run(missing):
                    done[one.trial] = one
                    add({"key": key, **asdict(one)})
                    progress(len(done), trials)
    return [done[number] for number in sorted(done)]


def summary(trials: Sequence[Trial]) -> dict[str, Any]:
    """Rates with Wilson's bounds, quantiles of the errors, and the wrong identifications."""

    def share(hits: int, count: int) -> dict[str, float]:
        return {**wilson(hits, count)._asdict(), "hits": hits, "n": count}

    named = {
        law: share(sum(one.named == law for one in mine), len(mine))
        for law in MODULES
        if (mine := [one for one in trials if one.law == law])
    }
    within: dict[str, dict[str, Any]] = {}
    for name, (limit, unit) in LIMITS.items():
        errors = np.abs(
            [error for one in trials if (error := one.errors.get(name)) is not None and one.named == one.law]
        )
        if len(errors):
            holds = [one.held[name] for one in trials if name in one.held and one.named == one.law]
            within[name] = {
                **share(int(np.count_nonzero(errors <= limit)), len(errors)),
                "limit": limit,
                "unit": unit,
                "p50": float(np.median(errors)),
                "p95": float(np.percentile(errors, 95)),
                "worst": float(np.max(errors)),
                "in_bounds": share(sum(holds), len(holds)),
            }
    right = sum(one.named == one.law for one in trials)
    return {
        "trials": len(trials),
        "named_right": share(right, len(trials)),
        "named_by_law": named,
        "within": within,
        "wrong": [asdict(one) for one in trials if one.named != one.law],
        "passed": right >= GOAL * len(trials) and all(one["value"] >= GOAL for one in within.values()),
    }
