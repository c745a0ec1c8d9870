"""The campaigns: their conditions, metrics and goals."""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal, NamedTuple

from firmware_py.shell.builds import Build
from tools.campaign.limits import CONTACTS_MS, LIMIT_AXES, judge_limits, limit_cell, limit_trial
from tools.campaign.trial import judges
from tools.campaign.trial.cells import Axes, Cell, Condition, cells_of
from tools.campaign.trial.modules import MODULE_AXES, module_cell, module_trial
from tools.campaign.trial.outcome import Outcome
from tools.campaign.trial.run import Run, run
from tools.campaign.trial.sampling import Mismatch
from tools.campaign.trial.scenarios import Plan, Trial
from tools.campaign.trial.walk_cells import COURSES, WALK_AXES, walk_cell, walk_trial
from tools.campaign.trial.walk_judge import judge_walk

Quantile = Literal["lowest", "p50", "p95", "worst"]

WET_AND_DRY = ("viscous", "coulomb", "stribeck")
NO_IMPULSE = (0.0,)
RISE = "the first impacts after a soft start are harder than the steady ones"
WEAK_TURNS = "a few turns are below 10 N"
STUMBLE = "one stumble in 300 is followed by a harder impact"
WALKS = ((("walking",), COURSES), (("table1",), ("steady", "stop", "stumble")))


@dataclass(frozen=True)
class Goal:
    """A limit on a figure: a metric's quantile, a share of counts, or the share of successes.

    The goal applies to the cells whose names begin with `where`, taken together; an empty `where` means all
    cells. The figure must be at least `low` or at most `high`, in the unit in which the figure is printed.
    These limits decide the status. If the figure is known to miss the goal, `wanted` is the goal, `low` or
    `high` is a regression bound at the measured value, and `reason` says why the goal is missed.
    """

    figure: str
    quantile: Quantile | None = None
    where: str = ""
    low: float | None = None
    high: float | None = None
    wanted: float | None = None
    reason: str = ""
    full_size: bool = False
    """Whether the goal applies only to a campaign with all of its trials."""


class Sampler(NamedTuple):
    """What a campaign samples: the axes of its conditions, a cell of values on them, a trial of a cell."""

    axes: Axes
    cell: Callable[..., Cell]
    trial: Callable[[Plan, Cell, int], Trial]


MODULES = Sampler(MODULE_AXES, module_cell, module_trial)
WALKERS = Sampler(WALK_AXES, walk_cell, walk_trial)
LIMITS = Sampler(LIMIT_AXES, limit_cell, limit_trial)


@dataclass(frozen=True)
class Campaign:
    """A Monte Carlo campaign: what it samples, how it judges, and its goals.

    `conditions` span the cells over the sampler's axes. `numbers` may be changed by `--set
    campaign.KEY=VALUE`. `units` are the units in which the metrics are printed. `trials` is the number of
    trials that the goals need; with fewer trials a goal of full size does not apply.
    """

    name: str
    title: str
    trials: int
    judge: Callable[[Trial, Run, Outcome], None]
    conditions: tuple[Condition, ...]
    numbers: Mapping[str, Any]
    units: Mapping[str, str]
    goals: tuple[Goal, ...]
    sampler: Sampler = MODULES

    def plan(self, settings: Sequence[str], seed: int, firmware: Build = "compiled") -> Plan:
        """Return the plan of the trials after the `--set` changes; BadInputError for an unknown one."""
        sampler = self.sampler
        cells, numbers = cells_of(sampler.axes, sampler.cell, self.conditions, self.numbers, settings)
        return Plan(self.name, cells, numbers, seed, firmware)


MISMATCH: dict[str, Any] = {f"mismatch_{name}": width for name, width in asdict(Mismatch()).items()}

CAMPAIGNS: dict[str, Campaign] = {
    campaign.name: campaign
    for campaign in (
        Campaign(
            name="start-up",
            title="from random states into the impact regime, where one exists",
            trials=4800,
            judge=judges.start_up,
            conditions=((WET_AND_DRY, (1.1, 1.2, 1.3, 1.35), NO_IMPULSE),),
            numbers={"duration_s": 32.0, "swing_m_s2": 0.5, **MISMATCH},
            units={
                "capture": "s",
                "energy": "J",
                "overshoot": "x steady",
                "overshoot_low": "x path",
                "steady_v": "m/s",
            },
            goals=(
                Goal("eligible", low=3000, full_size=True),
                Goal("success", low=1.0),
                Goal("capture", "p95", high=8.0),
                Goal("overshoot", "worst", high=1.175, wanted=1.05, reason=RISE),
                Goal("overshoot_low", "worst", high=1.405, wanted=1.05, reason=RISE),
            ),
        ),
        Campaign(
            name="estimate",
            title="position and velocity in the impact regime",
            trials=300,
            judge=judges.estimate,
            conditions=((("viscous",), (1.1,), NO_IMPULSE), (("coulomb-0.2",), (0.95,), NO_IMPULSE)),
            numbers={"duration_s": 30.0, **MISMATCH},
            units={"x_rmse": "mm", "v_rmse": "m/s", "x_worst": "mm", "nis": "1"},
            goals=(
                Goal("x_rmse", "p50", "viscous", high=0.9),
                Goal("v_rmse", "p50", "viscous", high=0.010),
                Goal("x_rmse", "p50", "coulomb-0.2", high=3.0),
            ),
        ),
        Campaign(
            name="detect",
            title="touch-downs found, when, and the regime reported",
            trials=440,
            judge=judges.detect,
            conditions=(
                (("viscous",), (1.0, 1.1, 1.2, 1.3, 1.35), NO_IMPULSE),
                (("coulomb", "stribeck"), (1.0, 1.1, 1.2), NO_IMPULSE),
            ),
            numbers={"duration_s": 40.0, **MISMATCH},
            units={"latency": "ms", "speed_error": "m/s"},
            goals=(
                Goal("f1", low=0.999),
                Goal("latency", "p50", high=1.5),
                Goal("latency", "p95", high=2.5),
                Goal("regime_right", low=0.995),
                Goal("regime_uncertain", high=0.01),
            ),
        ),
        Campaign(
            name="hold",
            title="the impact regime, or a requested impulse, held for a minute",
            trials=700,
            judge=judges.hold,
            conditions=(
                (("viscous",), (1.3, 1.4), NO_IMPULSE),
                (("viscous",), (1.3,), (0.65, 0.75, 0.85, 0.95, 1.05)),
            ),
            numbers={"hold_s": 60.0, **MISMATCH, "mismatch_spring": 0.05, "mismatch_amplitude": 0.03},
            units={
                "impulse": "N s",
                "impulse_error": "%",
                "phase": "deg",
                "phase_asked": "deg",
                "ripple": "%",
                "speed_error": "%",
                "cycle_variation": "%",
            },
            goals=(
                Goal("success", low=1.0),
                Goal("ripple", "p50", "viscous r=1.3", high=0.2),
                Goal("impulse", "lowest", "viscous r=1.4", low=1.0),
                Goal("impulse_error", "worst", high=3.0),
                Goal("phase_asked", "worst", high=65.0),
            ),
        ),
        Campaign(
            name="recover",
            title="back into the impact regime after a kick out of it",
            trials=1800,
            judge=judges.recover,
            conditions=((("viscous",), (1.3, 1.35), NO_IMPULSE),),
            numbers={"duration_s": 50.0, "kick_low_m_s": 0.8, "kick_high_m_s": 1.4, **MISMATCH},
            units={"recovery": "s"},
            goals=(
                Goal("eligible", low=300, full_size=True),
                Goal("success", low=1.0),
                Goal("recovery", "p95", high=8.0),
            ),
        ),
        Campaign(
            name="limits",
            title="every impact beyond a limit stops the motor, and no impact far below it does",
            trials=24_000,
            judge=judge_limits,
            sampler=LIMITS,
            conditions=((tuple(CONTACTS_MS),),),
            numbers={"mismatch_mass": 0.02, "high_offset_m_s2": 4.0},
            units={},
            goals=(
                Goal("eligible", low=15_000, full_size=True),
                Goal("missed_0", high=0.0),
                Goal("tripped_0", high=0.0),
            ),
        ),
        Campaign(
            name="walk",
            title="a walk that the crank follows: pulses in late stance, felt force, end of the walk",
            trials=2100,
            judge=judge_walk,
            sampler=WALKERS,
            conditions=WALKS,
            numbers={"walk_s": 70.0, "variability": 0.02, **MISMATCH},
            units={
                "felt_low": "N",
                "felt_high": "N",
                "phase_rmse": "%",
                "pulses_per_stride": "1",
                "last_pulse": "s",
                "hardest_after": "x steady",
                "undriven": "pulses",
                "decision": "s",
            },
            goals=(
                Goal("success", where="walking steady", low=0.99),
                Goal("success", where="walking change", low=0.99),
                Goal("in_force", where="walking steady", low=0.9999, wanted=1.0, reason=WEAK_TURNS),
                Goal("in_force", where="walking change", low=1.0),
                Goal("in_window", where="walking steady", low=0.99),
                Goal("in_window", where="walking change", low=0.95),
                Goal("phase_rmse", "p95", "walking steady", high=2.0),
                Goal("phase_rmse", "p95", "walking change", high=4.0),
                Goal("last_pulse", "worst", "walking stop", high=0.8),
                Goal("last_pulse", "worst", "walking stumble", high=0.8),
                Goal("hardest_after", "worst", "walking stop", high=1.05),
                Goal("hardest_after", "worst", "walking stumble", high=1.115, wanted=1.05, reason=STUMBLE),
                Goal("success", where="table1 steady", low=0.99),
                Goal("in_force", where="table1 steady", low=0.9998, wanted=1.0, reason=WEAK_TURNS),
                Goal("in_window", where="table1 steady", low=0.99),
                Goal("last_pulse", "worst", "table1 stop", high=2.0),
                Goal("last_pulse", "worst", "table1 stumble", high=2.0),
                Goal("hardest_after", "worst", "table1 stop", high=1.05),
                Goal("hardest_after", "worst", "table1 stumble", high=1.053, wanted=1.05, reason=STUMBLE),
            ),
        ),
    )
}
"""Campaigns by their name on the command line."""


def trial_of(plan: Plan, number: int) -> Trial:
    """Sample the trial with this number."""
    return CAMPAIGNS[plan.campaign].sampler.trial(plan, plan.cell_of(number), number)


def run_trial(plan: Plan, number: int) -> Outcome:
    """Sample, run and judge the trial with this number."""
    started_s = time.process_time()
    trial = trial_of(plan, number)
    outcome = Outcome(number, number % len(plan.cells), simulated_s=trial.scenario.duration_s)
    done = run(trial.scenario, trial.scenario.seed, firmware=plan.firmware)
    CAMPAIGNS[plan.campaign].judge(trial, done, outcome)
    outcome.compute_s = time.process_time() - started_s
    return outcome
