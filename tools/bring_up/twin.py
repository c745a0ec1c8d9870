"""Step 6, twin: the module as a scene, the recorded hold repeated on it, and the safety scenarios with it.

The twin gets the parameters that were found, and the same commands. Its approach speed, impulse and impacts a
turn in the hold are compared with the module's. Starts of modules within the intervals follow.
"""

import shlex
from collections.abc import Mapping
from typing import Any

import numpy as np
import tomli_w

from firmware_py.interface.generated.records import ImpactEvent
from firmware_py.shell.parameters import DEFAULTS, with_overrides
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import StoredBus
from hil.record.new_file import write_anew
from hil.scenario.commands import Command, Request
from plant_sim.scene import load_scene
from tools.bring_up.first_impacts import HOLD_S, JUDGED_S, with_reason
from tools.bring_up.lockstep import LockstepBench
from tools.bring_up.operated import BEGUN_S, LatchedFaultError, Operated, RatioTooHighError
from tools.bring_up.step import NOTHING, Context, Curve, Findings, Step, StepFailedError
from tools.campaign.campaigns import CAMPAIGNS, run_trial
from tools.campaign.identified import scene_of, settings_on_twin, without_wiring
from tools.tuning.result import make_value
from tools.tuning.safety import Bench as SafetyBench
from tools.tuning.safety import judge_safety

SCENE, PARAMETER_FILE = "module.toml", "parameters.toml"
LARGEST_DEVIATION = 0.05
"""Largest deviation of the twin's approach speed and impulse from the module's."""
SEED = 1
STARTS = 16
"""Starts of sampled modules in the proof; `vibrohil campaign start-up --spread` runs more."""


def changed(values: Mapping[str, float]) -> dict[str, float]:
    """The parameters that differ from the firmware's defaults."""
    return {name: value for name, value in values.items() if value != DEFAULTS[name]}


def impacts_in(log: Any) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Time, approach speed and impulse of the impacts that a log of a hold reports, shape (n, 3)."""
    events = frames_of(StoredBus(log), ImpactEvent)
    rows = np.column_stack([events.t_s, events.signals[:, 1], events.signals[:, 2]])
    end_s = BEGUN_S + HOLD_S
    return rows[(rows[:, 0] > end_s - JUDGED_S) & (rows[:, 0] <= end_s)]


def prove(context: Context, found: Findings) -> None:
    """Write the twin's scene and prove it; a failure says whether the twin has steady impacts at all."""
    try:
        prove_twin(context, found)
    except StepFailedError as error:
        where = "on the twin " if isinstance(error, LatchedFaultError | RatioTooHighError) else ""
        raise StepFailedError(f"{where}{with_reason(error, context.values, context.ratio)}") from error


def prove_twin(context: Context, found: Findings) -> None:
    """Repeat the hold on the twin, run the safety scenarios on it, and start modules within the intervals."""
    scene = scene_of(context.values)
    values = with_overrides(without_wiring(context.values))
    write_anew(context.folder / SCENE, tomli_w.dumps(scene))
    bench = LockstepBench(load_scene(scene), SEED)
    player = Operated([Command(0.0, Request.RUN, context.ratio)], HOLD_S)
    log = context.log("twin")
    bench.play(player, player.longest_s, log, values)
    found.notes += player.notes
    measured, simulated = impacts_in(context.last_log("hold")), impacts_in(log)
    found.curves = [
        Curve("module", measured[:, 0], measured[:, 1]),
        Curve("twin", simulated[:, 0], simulated[:, 1]),
    ]
    found.axes = ("time in s", "approach speed in m/s")
    if not len(simulated):
        raise StepFailedError("the twin has no impacts in the hold: its friction or its stop is another one")
    found.add("impacts of module and twin in the hold", len(measured) / len(simulated), "1")
    for column, name in ((1, "approach speed"), (2, "impulse")):
        ratio = float(np.median(simulated[:, column]) / np.median(measured[:, column]))
        found.add(f"{name}, twin over module", ratio, "1")
        if abs(ratio - 1.0) > LARGEST_DEVIATION:
            raise StepFailedError(
                f"the twin's {name} is {ratio:.3f} of the module's, wanted within {LARGEST_DEVIATION:.0%}: "
                "repeat first-impacts, or look for another friction in the report"
            )
    forces_n = [one.peak_force_n for one in bench.impacts]
    found.add("peak force, twin", max(forces_n), "N")
    context.says("twin: the hold is repeated; the safety scenarios follow")
    results = judge_safety(changed(values), lambda _, __: None, SafetyBench(scene, ratio=context.ratio))
    for one in results:
        found.notes.append(f"{one.scenario}: {'passed' if one.passed else one.why}")
    if failed := [f"{one.scenario} ({one.why})" for one in results if not one.passed]:
        raise StepFailedError(f"on the twin these safety scenarios fail: {'; '.join(failed)}")
    start_within_intervals(context, found)


def start_within_intervals(context: Context, found: Findings) -> None:
    """Start modules within the intervals of the parameters, from random states."""
    context.says(f"twin: {STARTS} starts of modules within the intervals")
    given = {name: make_value(name, value) for name, value in changed(context.values).items()}
    settings = settings_on_twin(given | dict(context.bounds))
    plan = CAMPAIGNS["start-up"].plan([*settings, f"campaign.ratios=[{context.ratio!r}]"], SEED)
    starts = [run_trial(plan, number) for number in range(STARTS)]
    eligible = [one for one in starts if one.eligible]
    lost = [f"trial {one.trial}: {one.why}" for one in eligible if one.why]
    found.add("starts within the intervals that end in impacts", len(eligible) - len(lost), "1")
    found.add("starts within the intervals, of modules with such impacts", len(eligible), "1")
    if lost or not eligible:
        raise StepFailedError(
            f"{len(lost)} of {len(eligible)} starts of modules within the intervals fail: {'; '.join(lost)}; "
            "ask for a lower --ratio, or repeat first-impacts"
        )
    found.notes.append(run_next(context))


def run_next(context: Context) -> str:
    """The command that starts more modules within the intervals at this ratio."""
    path, ratio = context.folder / PARAMETER_FILE, f"campaign.ratios=[{context.ratio!r}]"
    words = ["vibrohil", "campaign", "start-up", "--spread", str(path), "--set", ratio]
    return f"run next: {shlex.join(words)}"


TWIN = Step(
    "twin",
    "It writes the module as a scene, repeats the hold on this twin, runs the safety scenarios on it, and "
    "starts modules within the intervals.",
    "",
    60.0,
    lambda _: NOTHING,
    prove,
)
