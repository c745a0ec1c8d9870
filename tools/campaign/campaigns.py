"""All campaigns, and their trials by number."""

import time

from text_input import TextInputError
from tools.campaign.campaign import Campaign, Outcome, Plan, Trial
from tools.campaign.limits import LIMITS
from tools.campaign.module_campaigns import MODULE_CAMPAIGNS
from tools.campaign.run import run
from tools.campaign.walk import WALK
from tools.output import BadInputError

CAMPAIGNS: dict[str, Campaign] = {one.name: one for one in (*MODULE_CAMPAIGNS, LIMITS, WALK)}
"""Campaigns by their name on the command line."""


def trial_of(plan: Plan, number: int) -> Trial:
    """Sample the trial with this number: all cells take turns.

    Raises BadInputError, with the trial's number, if its values cannot be simulated.
    """
    cell = plan.cells[number % len(plan.cells)]
    try:
        scenario = CAMPAIGNS[plan.campaign].sampler.scenario(plan, cell, number)
    except TextInputError as error:
        raise BadInputError(
            f"trial {number} of {plan.campaign}, as sampled: {error}; "
            "give campaign.* numbers that keep all trials within its bounds"
        ) from error
    return Trial(cell, scenario, (plan.seed, number, 2))


def run_trial(plan: Plan, number: int) -> Outcome:
    """Sample, run and judge the trial with this number."""
    started_s = time.process_time()
    trial = trial_of(plan, number)
    outcome = Outcome(number, number % len(plan.cells), simulated_s=trial.scenario.duration_s)
    done = run(trial.scenario, trial.scenario.seed, firmware=plan.firmware)
    CAMPAIGNS[plan.campaign].judge(trial, done, outcome)
    outcome.compute_s = time.process_time() - started_s
    return outcome
