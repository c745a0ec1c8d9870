"""Judges of campaigns on runs that go wrong: a run that is lost, never starts or trips late is no success."""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from firmware_py.interface.enums import Fault, Mode, Refusal
from hil.record.traces.firmware_trace import columns_of
from hil.record.traces.plant_trace import PlantRecord
from plant_sim.arrays import record_type
from plant_sim.result import Impact
from tools.campaign.campaign import Outcome, Trial
from tools.campaign.campaigns import CAMPAIGNS, trial_of
from tools.campaign.limits import judge_limits
from tools.campaign.run import SIGNALS, ModeChange, Run
from tools.campaign.walk import find_end_s, judge_walk

SEED = 20_000
TICK_S = 1e-3


def run_of(trial: Trial, modes: dict[float, Mode], refusal: Refusal = Refusal.NONE) -> Run:
    """A run without motion that enters these modes at these times, s."""
    ticks = trial.scenario.ticks
    firmware = np.zeros(ticks, columns_of(SIGNALS))
    firmware["outputs.refusal"] = refusal
    for at_s, mode in modes.items():
        firmware["outputs.mode"][round(at_s / TICK_S) :] = mode
    parts = trial.scenario.scene.parts(trial.scenario.seed)
    plant = np.zeros(ticks, record_type(PlantRecord))
    return Run(parts, TICK_S, plant, firmware, np.zeros(0, record_type(Impact)))


def judged_walk(course: str, modes: dict[float, Mode], refusal: Refusal = Refusal.NONE) -> Outcome:
    trial = trial_of(CAMPAIGNS["walk"].plan([f"campaign.courses='{course}'"], SEED), 0)
    outcome = Outcome(0, 0)
    judge_walk(trial, run_of(trial, modes, refusal), outcome)
    return outcome


@pytest.mark.parametrize("course", ["steady", "change", "stop", "stumble"])
def test_a_walk_that_is_lost_before_its_end_is_not_kept(course: str) -> None:
    outcome = judged_walk(course, {0.5: Mode.SOFT_START, 6.0: Mode.RUN, 14.0: Mode.FAULT})
    assert outcome.eligible
    assert outcome.why == "not kept: fault since 14.00 s"


def test_a_stop_that_the_firmware_expects_within_a_stride_is_no_loss() -> None:
    trial = trial_of(CAMPAIGNS["walk"].plan(["campaign.courses='stop'"], SEED), 0)
    stands_s = find_end_s(trial.scenario.scene.parts(trial.scenario.seed).housing)
    modes = {0.5: Mode.SOFT_START, 6.0: Mode.RUN, stands_s - 1.2: Mode.STOPPING}
    assert judged_walk("stop", modes).why == ""


def test_a_walk_that_never_starts_has_failed_unless_it_was_refused() -> None:
    failed = judged_walk("steady", {0.3: Mode.FAULT})
    assert (failed.eligible, failed.why) == (True, "never started: fault since 0.30 s")
    assert not judged_walk("steady", {0.3: Mode.READY}, Refusal.NO_HARMONIC).eligible


LIMITS = {"limit": {"force_n": 100.0, "impulse_n_s": 1.0}}
KICK_S = 1.0


def judged_limits(tripped_s: float, contacts: int = 1, last_s: float = math.inf) -> Outcome:
    """Contacts of 10 ms at 0.2 s far below the limits, and a trip of the force limit at `tripped_s`.

    A contact from `last_s` on outlasts the trial, and is no record.
    """
    pushing = np.zeros(1500)
    pushing[200:][:10] = 20.0
    pushing[np.arange(1500) * TICK_S >= last_s] = 20.0
    impacts = np.zeros(contacts, record_type(Impact))
    impacts["t_s"], impacts["peak_force_n"], impacts["impulse_n_s"] = 0.2, 20.0, 0.2
    done: Any = SimpleNamespace(
        tick_s=TICK_S,
        impacts=impacts,
        true=lambda _: pushing,
        modes=[ModeChange(tripped_s, Mode.FAULT, Fault.FORCE_LIMIT)],
    )
    scenario = SimpleNamespace(
        parameters=LIMITS,
        faults=[SimpleNamespace(at_s=KICK_S)],
        document={"scene": {"stop": {"contact_s": 0.01}}},
    )
    outcome = Outcome(0, 0)
    judge_limits(Trial(CAMPAIGNS["limits"].plan([], SEED).cells[0], scenario, ()), done, outcome)  # type: ignore[arg-type]
    return outcome


@pytest.mark.parametrize("tripped_s", [0.1, 0.211, 0.5, 0.99, 1.03])
def test_a_trip_far_below_the_limits_is_counted_however_long_after_the_contact_it_comes(
    tripped_s: float,
) -> None:
    outcome = judged_limits(tripped_s)
    assert (outcome.eligible, outcome.shares["tripped_0"]) == (True, (1, 1))
    assert outcome.why == "tripped at 0.20 of the force and 0.20 of the impulse limit"


def test_a_trip_by_the_kick_itself_is_none_of_the_contact_before() -> None:
    outcome = judged_limits(KICK_S + 0.013)
    assert (outcome.eligible, outcome.shares["tripped_0"]) == (False, (0, 1))


@pytest.mark.parametrize("contacts", [0, 1])
def test_a_trip_in_a_contact_that_outlasts_the_trial_is_not_judged(contacts: int) -> None:
    outcome = judged_limits(1.48, contacts, last_s=1.47)
    assert (outcome.eligible, outcome.why) == (False, "tripped in a contact that outlasts the trial")
    assert sum(count for count, _ in outcome.shares.values()) == 0
    assert judged_limits(1.46, contacts, last_s=1.47).shares["tripped_0"] == (1, 1)


def test_a_trial_without_a_contact_is_judged_by_its_trip() -> None:
    outcome = judged_limits(KICK_S + 0.013, contacts=0)
    assert (outcome.eligible, outcome.shares) == (False, {})
    outcome = judged_limits(0.5, contacts=0)
    assert (outcome.why, outcome.shares["tripped_0"]) == ("tripped without a contact", (1, 1))
