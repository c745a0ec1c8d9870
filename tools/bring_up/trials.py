"""A blind test of `vibrohil bring-up`: hidden modules behind a seed, each in lockstep.

    python -m tools.bring_up.trials --trials 20 --seed 50000

Each module has another mass, spring, crank radius, stop, friction and encoder offset; one in six is wired
wrongly, one in ten is broken. The command gets the mass and the nominal data sheet only. A module whose own
steady impacts end below the wanted ratio, or come later in the turn than the firmware holds them, must end
with this reason and is counted apart. The others must end in a hold whose approach speed and peak force are
those of the module's steady impacts. The lines say how each ended; those after them how many ended as wanted,
how often the true values were within the intervals, both with Wilson's bounds of 95 %, and whether any step
exceeded its bounds.
"""

import argparse
import re
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from hil.scenario.scenario import check_scenario
from plant_sim.scene import read_scene
from tools.bring_up.lockstep import LockstepBench
from tools.bring_up.session import Session, User
from tools.campaign.identified import Orbit, steady_orbit
from tools.campaign.statistics import wilson

SCENE = "table1-motor-soft"
WRONG_SHARE, BROKEN_SHARE = 1 / 6, 1 / 10
RATIO = 1.25
READABLE_M_S2 = 1850.0
"""Acceleration that the high range shows beside its offset; times the mass it is the largest force limit."""
LARGEST_DEVIATION = 0.05
"""Of a hold's approach speed and peak force from those of the module's steady impacts."""
BEYOND = "no orbit"
NO_HOLD = "no impacts|hardly moves|dead centre"
"""What the reason says where the module's impacts end below the wanted ratio."""
RESOLVED, TINY = 1.001, 1e-6
"""A thousandth beyond a bound is the resolution of the bus; a crank at rest moves by rounding."""
STOPPING, JUDGED = 4, 10
"""Last impacts, which the stop may have changed, and those before them that are judged."""


def fault(kind: str, **keys: Any) -> dict[str, Any]:
    """A fault that acts from the power-up on."""
    return {"kind": kind, "at_s": 0.0, **keys}


WRONG = (
    [fault("sensor-wrong-sign", sensor="encoder")],
    [fault("sensor-wrong-sign", sensor="striker")],
    [fault("sensor-swapped", sensors=["striker-low", "housing"])],
)
BROKEN: dict[str, tuple[dict[str, Any], list[dict[str, Any]], str]] = {
    "no watchdog": ({"axis": {"watchdog_feed": "off"}}, [], "no watchdog"),
    "silent drive": ({}, [fault("dropped", frames=["DriveHeartbeat"])], "no frame DriveHeartbeat"),
    "striker stuck": (
        {"friction": {"law": "coulomb", "mu": 2.0}},
        [],
        "hardly moves|never moves",
    ),
    "stop missing": ({"stop": {"position_m": 0.35}}, [], "missing"),
}


class Hidden(NamedTuple):
    """A hidden module: changes of the scene, faults, the reason with which it must end (empty: none)."""

    scene: dict[str, dict[str, Any]]
    faults: list[dict[str, Any]]
    reason: str
    kind: str
    orbit: Orbit | None = None


def bench_of(
    scene: Mapping[str, Mapping[str, Any]], faults: Sequence[Mapping[str, Any]], seed: int
) -> LockstepBench:
    """A module with these changes of its scene, with faults from its power-up on."""
    tables = read_scene(SCENE)
    for table, keys in scene.items():
        tables[table] = dict(keys) if table == "friction" else {**tables.get(table, {}), **keys}
    script = {"duration_s": 1.0, "commands": [], "faults": list(faults)}
    document = {"title": "hidden", "scene": tables, "firmware": {}, "script": script, "checks": []}
    scenario = check_scenario(document, "hidden")
    return LockstepBench(scenario.scene, seed, scenario.faults)


def brought_up(
    bench: LockstepBench, folder: Path, last: str | None, agree: bool = True, mass_kg: float = 0.8
) -> dict[str, Any]:
    """The result of a bring-up on this bench, with the same answer to every question."""
    user = User(lambda _: None, lambda _: agree)
    return Session(
        bench,
        folder,
        {"striker.mass_kg": mass_kg, "limit.force_n": min(1500.0, READABLE_M_S2 * mass_kg)},
        RATIO,
        user,
    ).run(None, last)


def sampled(seed: int) -> Hidden:
    """The module of a seed."""
    rng = np.random.default_rng(seed)
    friction = (
        {"law": "viscous", "b_n_s_m": rng.uniform(0.05, 0.4)},
        {"law": "coulomb", "mu": rng.uniform(0.01, 0.15)},
        {
            "law": "stribeck",
            "mu": (mu := rng.uniform(0.01, 0.12)),
            "mu_s": 1.3 * mu,
            "v_s_m_s": 0.1,
            "delta": 1.0,
        },
    )[rng.integers(3)]
    scene: dict[str, dict[str, Any]] = {
        "striker": {"mass_kg": rng.uniform(0.5, 1.3), "spring_n_m": 70.0 * rng.uniform(0.6, 1.4)},
        "drive": {"amplitude_m": 0.02 * rng.uniform(0.75, 1.25)},
        "stop": {
            "position_m": 0.18 + rng.uniform(-0.006, 0.006),
            "restitution": rng.uniform(0.2, 0.8),
            "contact_s": rng.uniform(0.003, 0.025),
        },
        "friction": friction,
    }
    faults = [fault("sensor-biased", sensor="encoder", bias=rng.uniform(0.1, 6.2))]
    share = rng.uniform()
    if share < BROKEN_SHARE:
        name = list(BROKEN)[rng.integers(len(BROKEN))]
        changes, more, reason = BROKEN[name]
        for table, keys in changes.items():
            scene[table] = {**scene.get(table, {}), **keys} if table != "friction" else keys
        return Hidden(scene, faults + more, reason, name)
    kind = "sound"
    if share < BROKEN_SHARE + WRONG_SHARE:
        kind, faults = "wired wrongly", faults + WRONG[rng.integers(len(WRONG))]
    orbit = steady_orbit(bench_of(scene, [], seed).scene, RATIO)
    if orbit is None or orbit.phase_deg > DEFAULTS["hold.highest_phase_deg"]:
        return Hidden(scene, faults, NO_HOLD, BEYOND, orbit)
    return Hidden(scene, faults, "", kind, orbit)


def true_values(scene: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """The true values of the parameters that have intervals."""
    return {
        "striker.spring_n_m": scene["striker"]["spring_n_m"],
        "drive.amplitude_m": scene["drive"]["amplitude_m"],
        **{f"stop.{name}": scene["stop"][name] for name in ("position_m", "restitution", "contact_s")},
        **{f"friction.{name}": scene["friction"].get(name, 0.0) for name in ("b_n_s_m", "mu")},
        "motor.inertia_kg_m2": 5e-4,
        "motor.dry_n_m": 5e-3,
    }


class Trial(NamedTuple):
    """How a trial ended: kind, last step and its reason, bench time, beyond bounds, inside intervals."""

    seed: int
    kind: str
    passed: bool
    as_wanted: bool
    step: str
    reason: str
    bench_s: float
    beyond: list[str]
    inside: dict[str, bool]


def beyond_bounds(bench: LockstepBench, steps: Sequence[Mapping[str, Any]]) -> list[str]:
    """The quantities by which a step has exceeded its stated bounds, in the module itself."""
    bounds = {step["name"]: step["bound"] for step in steps}
    bounds |= {"hold": bounds.get("first-impacts")}
    return [
        f"{log}: {quantity} {value:.3g} of {bound[quantity]:.3g}"
        for log, largest in bench.largest.items()
        if (bound := bounds.get(re.sub(r"-\d+$", "", log)))
        for quantity, value in largest._asdict().items()
        if value > RESOLVED * bound[quantity] + TINY and (quantity != "angle_rad" or bound[quantity])
    ]


def deviation(orbit: Orbit, bench: LockstepBench) -> float:
    """The larger deviation of approach speed and peak force in the hold, its last motion, as a share."""
    held = bench.impacts[-JUDGED - STOPPING : -STOPPING]
    speed, force = np.median([(one.v_m_s, one.peak_force_n) for one in held], axis=0)
    return float(max(abs(speed / orbit.approach_speed_m_s - 1.0), abs(force / orbit.peak_force_n - 1.0)))


def run_trial(seed: int) -> Trial:
    """Bring up the module of a seed."""
    hidden = sampled(seed)
    bench = bench_of(hidden.scene, hidden.faults, seed)
    with tempfile.TemporaryDirectory(prefix="vibrohil-bring-up-") as folder:
        result = brought_up(bench, Path(folder) / "out", None, mass_kg=hidden.scene["striker"]["mass_kg"])
    last = result["steps"][-1]
    off = deviation(hidden.orbit, bench) if result["passed"] and hidden.orbit else np.nan
    says = bool(hidden.reason) and any(one in last["reason"] for one in hidden.reason.split("|"))
    as_wanted = says or off <= LARGEST_DEVIATION
    reason = last["reason"] or f"hold within {off:.1%} of the steady impacts"
    truth, found = true_values(hidden.scene), result["parameters"]
    inside = {
        name: found[name]["low"] <= value <= found[name]["high"]
        for name, value in truth.items()
        if name in found and hidden.kind not in BROKEN
    }
    beyond = beyond_bounds(bench, result["steps"])
    return Trial(
        seed,
        hidden.kind,
        result["passed"],
        as_wanted,
        last["name"],
        reason,
        bench.tick * 1e-3,
        beyond,
        inside,
    )


def share_of(hits: Sequence[bool]) -> str:
    """How many are true, with the bounds of the share."""
    share = wilson(sum(hits), len(hits))
    return f"{sum(hits)} of {len(hits)} ({share.low:.0%} to {share.high:.0%})"


def print_shares(trials: Sequence[Trial]) -> None:
    """Print how many have ended as wanted, and how many intervals contain the truth."""
    for kind in dict.fromkeys(one.kind for one in trials):
        print(f"{kind}: {share_of([one.as_wanted for one in trials if one.kind == kind])} ended as wanted")
    print(f"{sum(bool(one.beyond) for one in trials)} trials exceeded a step's bounds")
    print(f"longest bench time {max(one.bench_s for one in trials):.0f} s")
    groups = {"": trials, ", with no orbit": [one for one in trials if one.kind == BEYOND]}
    for name in dict.fromkeys(name for one in trials for name in one.inside):
        for among, some in groups.items():
            inside = share_of([one.inside[name] for one in some if name in one.inside])
            print(f"{name}{among}: the truth is inside {inside} intervals")


def main() -> None:
    """Run the trials and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=120)
    parser.add_argument("--seed", type=int, default=50_000)
    parser.add_argument("--workers", type=int, default=1)
    given = parser.parse_args()
    trials: list[Trial] = []
    with ProcessPoolExecutor(given.workers) as pool:
        for one in pool.map(run_trial, range(given.seed, given.seed + given.trials)):
            trials.append(one)
            word = "as wanted" if one.as_wanted else "NOT AS WANTED"
            print(
                f"{one.seed} {one.kind}: {word}, {one.step}, {one.bench_s:.0f} s. {one.reason} {one.beyond}",
                flush=True,
            )
    print_shares(trials)


if __name__ == "__main__":
    main()
