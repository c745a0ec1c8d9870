"""The campaign `limits`: whether every impact beyond a limit stops the motor, and no impact far below does.

A trial samples a module, its limits, a kick towards the stop at any phase of a start, and lost, corrupted or
repeated samples near the impact. It lasts a second and a half, because the limits need no impact regime. The
judge compares each contact's true peak force and impulse with the limits.
"""

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.parameters import flatten
from hil.scenario.scenario import Scenario
from plant_sim.scene import read_scene
from tools.campaign.campaign import (
    BASE_SCENE,
    Campaign,
    Cell,
    Goal,
    Outcome,
    Plan,
    Sampler,
    Trial,
    first_tick_s,
    scenario_of,
    script_of,
)
from tools.campaign.run import Run, run
from tools.campaign.sampling import LARGEST_RUN_SEED

RUN_S = 0.4
KICK_S = (0.7, 1.2)
AFTER_S = 0.45
"""Times of the command RUN and of the kick, and time after it in which the striker reaches the stop, s."""
CONTACTS_MS = {
    f"{low:g} to {high:g}": (low, high) for low, high in ((1.5, 3.0), (3.0, 5.0), (5.0, 10.0), (10.0, 30.0))
}
"""Ranges of the elastic contact time at 0.9 m/s, one cell each."""
BASE_MASS_KG = 0.8
LOST, LOSSES_SHARE = 3, 0.25
"""Most lost, corrupted or repeated samples, and the share of the trials that have some."""
NEAR_S = 0.004
"""Samples are lost up to this time before and after the hardest contact."""
FORCE_BEYOND, IMPULSE_BEYOND, BELOW = 1.2, 1.15, 0.8
"""Shares of the limits above which a trip is required, and below which none may occur."""
IN_TICKS = 3
"""Ticks from the first valid sample after the separation to the latch and to torque 0."""
KICK_PULSE_S = 0.013
"""Duration for which the accelerometers show a kick: a half-sine of 10 ms and the low-pass. The plant changes
the velocity at once, so a contact within it shows the stop's force less the kick's."""
OF_THE_IMPACT = (Fault.FORCE_LIMIT, Fault.IMPULSE_LIMIT)
LIMIT_SPREAD = (-0.3, 0.7)
"""Logarithms of the limits over what the kick may cause. Every band then holds a seventh of the trials."""
CLEAN_MS = 5.0
"""Contact time of the stop from which a contact without a loss must be judged right without exception: the
elastic contact time at 0.9 m/s. With damping the pulse has a higher peak and a long, weak end."""


def limit_cell(contact_ms: str) -> Cell:
    """Return the cell of a range of contact times."""
    return Cell(f"{contact_ms} ms", (contact_ms,), read_scene(BASE_SCENE), {})


class SampledModule(NamedTuple):
    """A sampled module: its scene's tables, the firmware's parameters, and the kick."""

    scene: dict[str, Any]
    firmware: dict[str, Any]
    kick: dict[str, Any]


def sample_module(cell: Cell, numbers: Mapping[str, Any], dice: np.random.Generator) -> SampledModule:
    """Sample the truth, the nominal mass, the limits and the kick."""

    def between(low: float, high: float) -> float:
        return float(dice.uniform(low, high))

    scene = deepcopy(dict(cell.scene))
    mass_kg, contact_s = between(0.3, 1.5), 1e-3 * between(*CONTACTS_MS[cell.values[0]])
    k, share = between(0.1, 0.9), mass_kg / BASE_MASS_KG
    scene["striker"].update(mass_kg=mass_kg, spring_n_m=scene["striker"]["spring_n_m"] * share)
    scene["friction"]["b_n_s_m"] *= share
    scene["stop"].update(restitution=k, contact_s=contact_s)
    rest_m = scene["striker"]["rest_length_m"]
    scene["initial"] = {"x_m": rest_m + between(-0.1, 0.05), "v_m_s": between(-0.8, 0.8)}
    scene["drive"]["phase_rad"] = between(0.0, 2.0 * math.pi)
    offset_m_s2 = numbers["high_offset_m_s2"] * between(-1.0, 1.0)
    scene.setdefault("sensors", {})["striker_high"] = {"bias_m_s2": offset_m_s2}
    kick_m_s = between(0.0, 8.0)
    kick = {"kind": "kick", "at_s": first_tick_s(between(*KICK_S)), "change_m_s": kick_m_s}

    nominal_kg = mass_kg * (1.0 + numbers["mismatch_mass"] * between(-1.0, 1.0))
    # The limits lie around what this kick may cause, so that the trials fill both sides of the band.
    speed_m_s = between(0.3, 1.0) + kick_m_s
    impulse_n_s = (1.0 + k) * mass_kg * speed_m_s
    force_n = impulse_n_s * math.pi / (2.0 * contact_s)
    most_n = 0.999 * nominal_kg * (0.98 * 1961.33 - 10.0)
    limits = {
        "impulse_n_s": min(max(impulse_n_s * math.exp(between(*LIMIT_SPREAD)), 0.05), 100.0),
        "force_n": min(max(force_n * math.exp(between(*LIMIT_SPREAD)), 20.0), most_n),
    }
    firmware = {
        **cell.firmware,
        "ceiling": {"force_n": 10_000.0, "impulse_n_s": 100.0},
        "striker": {"mass_kg": nominal_kg, "spring_n_m": scene["striker"]["spring_n_m"]},
        "friction": {"b_n_s_m": scene["friction"]["b_n_s_m"]},
        "stop": {"contact_s": contact_s, "restitution": k},
        "start": {"rise_s": 0.5, "approach_s": 0.3},
        "limit": limits,
    }
    return SampledModule(scene, firmware, kick)


def limit_scenario(plan: Plan, cell: Cell, number: int) -> Scenario:
    """Sample a module; the samples that are lost lie near the hardest contact of the run without losses."""
    seed = plan.seed
    module = sample_module(cell, plan.numbers, np.random.default_rng([seed, number, 0]))
    run_seed = int(np.random.default_rng([seed, number, 1]).integers(LARGEST_RUN_SEED))
    duration_s = module.kick["at_s"] + AFTER_S

    def with_losses(losses: Sequence[Mapping[str, Any]]) -> Scenario:
        script = script_of(cell, RUN_S, duration_s, [module.kick, *losses])
        return scenario_of(plan.name_of(number), module.scene, module.firmware, script, run_seed)

    scenario = with_losses(())
    dice = np.random.default_rng([seed, number, 3])
    if dice.uniform() < LOSSES_SHARE:
        scenario = with_losses(sample_losses(run(scenario, run_seed, firmware=plan.firmware), dice))
    return scenario


def sample_losses(done: Run, dice: np.random.Generator) -> list[dict[str, Any]]:
    """Sample the lost, corrupted or repeated samples near the hardest contact; none without an impact."""
    if len(done.impacts) == 0:
        return []
    hardest = done.impacts[int(np.argmax(done.impacts["peak_force_n"]))]
    end_s = next(end_s for impact, end_s in contacts_of(done) if impact["t_s"] == hardest["t_s"])
    first = max(math.floor((float(hardest["t_s"]) - NEAR_S) / done.tick_s), 1)
    last = math.ceil((end_s + NEAR_S) / done.tick_s)
    ticks = sorted(dice.choice(np.arange(first, last), size=int(dice.integers(1, LOST + 1)), replace=False))
    kind = str(dice.choice(["dropped", "corrupted", "sensor-stuck"]))
    return [
        {"kind": kind, **TARGETS[kind], "at_s": (int(tick) - 0.5) * done.tick_s, "duration_s": done.tick_s}
        for tick in ticks
    ]


TARGETS: dict[str, dict[str, Any]] = {
    "dropped": {"frames": ["Accelerometer"]},
    "corrupted": {"frames": ["Accelerometer"]},
    "sensor-stuck": {"sensor": "striker"},
}


def contacts_of(done: Run) -> list[tuple[NDArray[np.void], float]]:
    """Return the impacts whose contacts have ended, oldest first, each with the end of its contact, s."""
    pushing = done.true("stop_force_n") > 0.0
    found = []
    for impact in done.impacts:
        tick = math.ceil(float(impact["t_s"]) / done.tick_s)
        free = np.flatnonzero(~pushing[tick:])
        if len(free):
            found.append((impact, (tick + int(free[0])) * done.tick_s))
    return found


def open_contact_s(done: Run) -> float:
    """Return the first tick of a contact that outlasts the run, s; infinite if there is none."""
    pushing = done.true("stop_force_n") > 0.0
    begun = len(pushing) - int(np.argmax(~pushing[::-1]))
    return begun * done.tick_s if begun < len(pushing) else math.inf


def judge_limits(trial: Trial, done: Run, outcome: Outcome) -> None:
    """Judge a trial by its contacts; one within the band (`within_band`) need not trip, but may."""
    is_within = judge_contacts(trial, done, outcome)
    if outcome.eligible:
        outcome.count("within_band", is_part=is_within)


def judge_contacts(trial: Trial, done: Run, outcome: Outcome) -> bool:
    """Judge the contacts up to the first that exceeds a limit; return whether one lies within the band.

    A trip within the pulse of the kick is the kick's; any other belongs to the contact before it. The shares
    have the number of the samples lost within the contact: `missed_0` of the contacts beyond a limit, those
    after which no limit's fault was latched in time; `tripped_0` of the contacts far below the limits, those
    with a limit's fault.
    """
    limit = flatten(trial.scenario.parameters)
    force_n, impulse_n_s = limit["limit.force_n"], limit["limit.impulse_n_s"]
    kicked, *losses = trial.scenario.faults
    latch = next((change for change in done.modes if change.mode == Mode.FAULT), None)
    tripped_s = latch.t_s if latch is not None and latch.fault in OF_THE_IMPACT else math.inf
    gone_s = latch.t_s if latch is not None and latch.fault not in OF_THE_IMPACT else math.inf
    by_kick = 0.0 <= tripped_s - kicked.at_s <= KICK_PULSE_S + IN_TICKS * done.tick_s
    contacts, open_s = contacts_of(done), open_contact_s(done)
    starts_s = [*(float(impact["t_s"]) for impact, _ in contacts), open_s]
    for (impact, end_s), following_s in zip(contacts, starts_s[1:], strict=True):
        if gone_s <= end_s:
            outcome.leave_out(f"{latch.fault.name.lower()} came first" if latch else "")
            return False
        force, impulse = float(impact["peak_force_n"]) / force_n, float(impact["impulse_n_s"]) / impulse_n_s
        lost = sum(bool(impact["t_s"] - done.tick_s <= one.at_s <= end_s) for one in losses)
        long = trial.scenario.document["scene"]["stop"]["contact_s"] >= 1e-3 * CLEAN_MS
        overlaps = impact["t_s"] - KICK_PULSE_S < kicked.at_s < end_s + KICK_PULSE_S
        group = "kicked" if overlaps else f"{lost}" if long else f"short_{lost}"
        if force > FORCE_BEYOND or impulse > IMPULSE_BEYOND:
            valid_s = end_s + done.tick_s * sum(one.at_s > end_s - done.tick_s for one in losses)
            later_n_m = done.firmware["outputs.torque_n_m"][round(valid_s / done.tick_s) + IN_TICKS :]
            in_time = tripped_s <= valid_s + IN_TICKS * done.tick_s and not np.any(later_n_m)
            outcome.count(f"missed_{group}", is_part=not in_time)
            if not in_time and group == "0":
                outcome.why = f"no trip at {force:.2f} of the force, {impulse:.2f} of the impulse limit"
            return False
        if max(force, impulse) >= BELOW:
            return True
        if by_kick and impact["t_s"] > tripped_s:
            continue
        until_s = end_s + IN_TICKS * done.tick_s if by_kick else following_s
        tripped = tripped_s <= until_s and tripped_s < math.inf
        outcome.count(f"tripped_{group}", is_part=tripped)
        if tripped and group == "0":
            outcome.why = f"tripped at {force:.2f} of the force and {impulse:.2f} of the impulse limit"
        if tripped:
            return False
    if by_kick:
        outcome.leave_out("the kick exceeded twice a limit, and no contact followed within the trial")
    elif open_s <= tripped_s < math.inf:
        outcome.leave_out("tripped in a contact that outlasts the trial")
    elif tripped_s < math.inf:
        outcome.count("tripped_0", is_part=True)
        outcome.why = "tripped without a contact"
    return False


LIMITS = Campaign(
    name="limits",
    title="every impact beyond a limit stops the motor, and no impact far below it does",
    trials=24_000,
    judge=judge_limits,
    sampler=Sampler({"contacts_ms": CONTACTS_MS}, limit_cell, limit_scenario),
    conditions=((tuple(CONTACTS_MS),),),
    numbers={"mismatch_mass": 0.02, "high_offset_m_s2": 4.0},
    units={},
    goals=(
        Goal("eligible", low=15_000, full_size=True),
        Goal("missed_0", high=0.0),
        Goal("tripped_0", high=0.0),
    ),
)
