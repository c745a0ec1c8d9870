"""The detector's threshold, from the costs of a miss and of a false alarm.

The floor of the one-sided test (`detector.floor_m_s2`) is varied over almost two decades, with the same
trials for each floor. The detect campaign counts hits, misses and false alarms against the truth and measures
the latencies. Of the floors whose cost does not differ significantly from the least cost, the second lowest
is chosen: latency grows with the floor, and a margin of one step (a factor of two) remains to the floors at
which the cost rises steeply. The chosen floor and the default are compared on seeds that had no part in the
choice.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from plant_sim.tables.quantities import NUMBER
from tools.campaign.campaign import Outcome
from tools.campaign.results import shares_of, totals_of, values_of
from tools.output import BadInputError
from tools.progress import Progress
from tools.tuning.candidates import SAMPLING, Sampling, run_candidates
from tools.tuning.result import Merit, Tuning, make_value

PARAMETER = "detector.floor_m_s2"
FLOORS_M_S2 = (0.8, 1.5, 3.0, 6.0, 12.0, 24.0, 48.0)
TRIALS = 110
"""Ten for each condition: some 5000 impacts per floor."""
COST_MISS, COST_FALSE_ALARM = 1.0, 1.0


@dataclass(frozen=True)
class Operating:
    """One point of the detector's characteristic. Costs and alarms are per hour of simulated time."""

    floor_m_s2: float
    hits: int
    misses: int
    false_alarms: int
    hours: float
    recall: float
    recall_low: float
    recall_high: float
    precision: float
    latency_p50_ms: float
    latency_p95_ms: float
    cost_1_h: float
    cost_error_1_h: float
    false_alarms_1_h: float


def evaluate_floor(
    floor_m_s2: float, outcomes: Sequence[Outcome], cost_miss: float, cost_false_alarm: float
) -> Operating:
    """The results of a floor. The cost's standard error assumes two Poisson counts of at least one event."""
    totals = totals_of(outcomes)
    shares = shares_of(totals)
    latencies = np.array(values_of(outcomes).get("latency", [math.nan]))
    hours = sum(outcome.simulated_s for outcome in outcomes) / 3600.0
    (hits, touch_downs), (right, detections) = (totals.get(name, (0, 0)) for name in ("recall", "precision"))
    misses, alarms = touch_downs - hits, detections - right
    nothing = {"value": math.nan, "low": math.nan, "high": math.nan}
    recall, precision = shares.get("recall", nothing), shares.get("precision", nothing)
    # Var(c₁ n₁ + c₂ n₂) = c₁² n₁ + c₂² n₂
    variance = cost_miss**2 * max(misses, 1) + cost_false_alarm**2 * max(alarms, 1)
    return Operating(
        floor_m_s2=floor_m_s2,
        hits=hits,
        misses=misses,
        false_alarms=alarms,
        hours=hours,
        recall=recall["value"],
        recall_low=recall["low"],
        recall_high=recall["high"],
        precision=precision["value"],
        latency_p50_ms=float(np.median(latencies)),
        latency_p95_ms=float(np.percentile(latencies, 95)),
        cost_1_h=(cost_miss * misses + cost_false_alarm * alarms) / hours,
        cost_error_1_h=math.sqrt(variance) / hours,
        false_alarms_1_h=alarms / hours,
    )


def choose(points: Sequence[Operating]) -> tuple[Operating, list[Operating]]:
    """The adjacent floors within one standard error of the least cost: the second lowest, and all of them."""
    best = min(range(len(points)), key=lambda number: points[number].cost_1_h)
    limit = points[best].cost_1_h + points[best].cost_error_1_h
    first = last = best
    while first > 0 and points[first - 1].cost_1_h <= limit:
        first -= 1
    while last < len(points) - 1 and points[last + 1].cost_1_h <= limit:
        last += 1
    alike = list(points[first : last + 1])
    return alike[min(1, len(alike) - 1)], alike


def tune_detector(
    cost_miss: float = COST_MISS,
    cost_false_alarm: float = COST_FALSE_ALARM,
    trials: int = TRIALS,
    floors_m_s2: Sequence[float] | None = None,
    sampling: Sampling = SAMPLING,
    progress: Progress = lambda *_: None,
) -> tuple[Tuning, list[Operating]]:
    """The floor for these costs, judged on fresh trials, and the whole characteristic."""
    if not (0.0 < cost_miss <= NUMBER.largest and 0.0 < cost_false_alarm <= NUMBER.largest):
        raise BadInputError(
            f"--cost-miss {cost_miss:g}, --cost-false-alarm {cost_false_alarm:g}: wanted both above 0 and at "
            f"most {NUMBER.largest:g}"
        )
    floors_m_s2 = floors_m_s2 or FLOORS_M_S2

    def try_floors(floors: Sequence[float], its_seed: int) -> list[Operating]:
        candidates = [{PARAMETER: floor} for floor in floors]
        found = run_candidates("detect", candidates, its_seed, trials, progress, sampling.workers)
        return [
            evaluate_floor(floor, outcomes, cost_miss, cost_false_alarm)
            for floor, outcomes in zip(floors, found, strict=True)
        ]

    points = try_floors(floors_m_s2, sampling.seed)
    best, alike = choose(points)
    fresh, default = try_floors((best.floor_m_s2, DEFAULTS[PARAMETER]), sampling.fresh_seed)
    warnings = []
    if best.floor_m_s2 in (floors_m_s2[0], floors_m_s2[-1]) and len(alike) == 1:
        warnings.append("the best floor lies at the end of those tried: the costs ask for one beyond")
    tuning = Tuning(
        command="detector",
        source=(
            f"campaign detect, {trials} trials a floor, cost {cost_miss:g} a miss and {cost_false_alarm:g} a "
            f"false alarm; judged on seed {sampling.fresh_seed}"
        ),
        seed=sampling.seed,
        range_is="floors whose cost does not differ significantly from the least",
        parameters={
            PARAMETER: make_value(PARAMETER, best.floor_m_s2, alike[0].floor_m_s2, alike[-1].floor_m_s2)
        },
        figures_of_merit={**merits("", fresh), **merits("default_", default)},
        warnings=tuple(warnings),
    )
    return tuning, points


def merits(prefix: str, point: Operating) -> dict[str, Merit]:
    """Figures of merit of one point; each name begins with `prefix`."""
    return {
        f"{prefix}recall": Merit(point.recall, "1"),
        f"{prefix}recall_low": Merit(point.recall_low, "1"),
        f"{prefix}precision": Merit(point.precision, "1"),
        f"{prefix}false_alarms": Merit(point.false_alarms_1_h, "1/h"),
        f"{prefix}latency_p50": Merit(point.latency_p50_ms, "ms"),
        f"{prefix}latency_p95": Merit(point.latency_p95_ms, "ms"),
        f"{prefix}cost": Merit(point.cost_1_h, "1/h"),
    }
