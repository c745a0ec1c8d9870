"""Searches for the planted defects of planted.toml, and says of each whether it was found.

    python tests/tools/falsify/planted.py --out FOLDER [--budget N] [--workers N] [NAME…]

Each mutation is made in a copy of the committed tree. It is a planted defect if some of many runs in ranges
twice as wide break a requirement only with it, but all scenarios of the suite pass with it. It is found
if a search like `vibrohil falsify` of the default spaces finds a run that breaks a requirement there but not
in the tree itself; a scenario that breaks it in both is left out, and the search goes on without it. A second
start continues after the defects whose result is in FOLDER; a table of all results ends it.
"""

import argparse
import io
import json
import math
import os
import resource
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from hil.scenario.files import locate, scenario_names
from hil.scenario.scenario import load_scenario
from tools.commands.falsify import row_of
from tools.falsify.default_space import PHASE
from tools.falsify.evaluations import Evaluations, folder_of, runner
from tools.falsify.objective import Task, judged, result_at, run_task
from tools.falsify.search import BASELINE, OPTIMISERS, search, sobol
from tools.falsify.space import DELAY, INSTANT, Dimension, Space
from tools.falsify.space_of_scenario import space_of
from tools.jobs import pool
from tools.output import progress_console, table_of

ROOT = Path(__file__).parents[3]
DEFECTS = Path(__file__).with_name("planted.toml")
FOLDERS = (
    "drive",
    "frames_late",
    "frames_lost",
    "kicks",
    "module",
    "ordinary",
    "processes",
    "sensors",
    "stops",
)
WALKS = (
    "a-steady-walk-has-a-pulse-in-every-push-off",
    "a-stumble-ends-the-pulses",
    "a-walker-who-stops-gets-no-more-pulses",
    "silent-gait-sensors-stop-the-motor",
)
WIDE, WIDE_RUNS = 2.0, 800
"""Factor on the ranges, and number of Sobol points in them."""
UNMOVED = DELAY, INSTANT, PHASE
"""Keys whose ranges are no sizes, and stay."""
LARGEST = {"share": 1.0, "restitution": 0.95, "stance_share": 0.7, "mu": 0.9, "mu_s": 1.0}
"""Largest values that a scenario can have, by the keys' last parts."""
LEAST_JUDGED = 0.7
"""Least share of the wider runs that are judged in the tree itself."""
LEFT_OUT = frozenset(
    (
        # The tree itself breaks a requirement in the default space.
        "a-heavier-striker-than-believed-keeps-the-impacts",
        "a-guide-that-rubs-eight-times-as-much-keeps-the-impacts",
        "a-violent-kick-into-a-weak-stop-stops-the-motor",
        "an-estimate-too-wide-stops-the-motor",
        "instant-start-multistable",
        "a-swing-that-grows-is-waited-for",
        "swapped-accelerometers-stop-the-motor",
        # Most runs are not judged, because a disturbance acts on nothing.
        "a-controller-whose-clock-falls-back-a-second-stops-the-motor",
        "a-killed-controller-leaves-no-torque",
        "a-killed-plant-gets-no-more-torque",
        "a-plant-that-pauses-for-long-comes-back-without-torque",
        "an-encoder-at-a-tenth-of-its-rate-is-ridden-through",
        "bundles-of-eight-milliseconds-are-ridden-through",
        "bundles-of-sixteen-milliseconds-stop-the-motor",
        "samples-at-a-tenth-of-their-rate-do-no-harm",
        # Slower than 60 times real time.
        "a-plant-whose-clock-jitters-does-no-harm",
    )
)


def searched(left_out: Iterable[str] = LEFT_OUT) -> list[Space]:
    """The spaces that are searched for every defect: of scenarios of these folders but some, and walks."""
    folders = [name for name in scenario_names() if locate(name)[0].parent.name in FOLDERS]
    spaces = [space_of(name, []) for name in (*folders, *WALKS) if name not in left_out]
    return [one for one in spaces if one.chosen]


def widened(space: Space) -> Space:
    """The space with sizes and ranges up to `WIDE` times as large, as far as a scenario can have them."""

    def wide(one: Dimension) -> Dimension:
        if one.choices:
            return replace(one, choices=tuple(WIDE * size for size in one.choices))
        if one.is_whole or one.key in UNMOVED or one.key.endswith("at_s"):
            return one
        middle, half = 0.5 * (one.low + one.high), 0.5 * WIDE * (one.high - one.low)
        most = LARGEST.get(one.key.rpartition(".")[2], math.inf)
        smallest = -math.inf if one.low < 0.0 else min(one.low, 1e-4)
        return replace(one, low=max(middle - half, smallest), high=min(middle + half, most))

    return replace(space, dimensions=tuple(map(wide, space.dimensions)))


def failures(name: str) -> list[str]:
    """The failed checks of a scenario as it stands."""
    scenario = load_scenario(name)
    verdict, _ = judged(scenario, scenario.checks)
    memory = [
        one.name for one in verdict.checks if one.passed is False and not one.name.startswith("memory.")
    ]
    return [*memory, *verdict.reasons]


def print_first_failure(workers: int) -> None:
    """Print the first scenario of the suite that fails, with its failed checks."""
    names = scenario_names()
    with pool(failures, workers) as run:
        found = next(({names[number]: one} for number, one in run(names) if one), {})
    print(json.dumps(found))


def in_tree(tree: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run Python with the packages of a tree."""
    path = os.pathsep.join([str(tree), str(Path(__file__).parent)])
    environment = {**os.environ, "PYTHONPATH": path}
    command = [sys.executable, *arguments]
    return subprocess.run(command, cwd=tree, env=environment, capture_output=True, text=True, check=False)


def copy_of(tree: Path) -> None:
    """Make a copy of the committed tree."""
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=ROOT, capture_output=True, check=True).stdout
    with tarfile.open(fileobj=io.BytesIO(archive)) as found:
        found.extractall(tree, filter="data")


def print_search(budget: int, workers: int, left_out: list[str]) -> None:
    """Search as `vibrohil falsify` does; print each method's row and its best run."""
    spaces = searched(LEFT_OUT.union(left_out))
    with pool(runner(spaces), workers) as run:
        hunts = search(spaces, budget, 1, Evaluations(folder_of([]), run, lambda *_: None))
    best = {one.method: one.best for one in hunts if one.best is not None}
    rows = [{**row_of(one), "values": best[one.method].values} for one in hunts if one.method in best]
    print(json.dumps(rows))


def print_wide(workers: int) -> None:
    """Print the margins of runs in wider spaces; none for a run that is not judged."""
    spaces = {one.name: one for one in map(widened, searched())}
    count = WIDE_RUNS // len(spaces)
    tasks = [
        Task(name, one.values(place.tolist()))
        for name, one in spaces.items()
        for place in sobol(one, count, 2)
    ]
    with pool(partial(run_task, spaces), workers) as run:
        found = dict(run(tasks))
    print(json.dumps([found[n]["margins"] if not found[n]["why"] else [] for n in range(len(tasks))]))


def least(margins: Iterable[float | None]) -> float:
    """The smallest margin."""
    return min((one for one in margins if one is not None), default=1.0)


def print_margins(rows: list[dict[str, Any]]) -> None:
    """Print the margins of runs in this tree."""
    runs = [(space_of(row["scenario"], []), row["values"]) for row in rows]
    print(json.dumps([result_at(space, values).margin for space, values in runs]))


def called(tree: Path, function: str, *arguments: Any) -> Any:
    """Call a function of this file in a tree, and read what it prints; RuntimeError if it ends badly."""
    ended = in_tree(tree, "-c", f"import planted; planted.{function}{arguments!r}")
    if ended.returncode != 0:
        raise RuntimeError(ended.stderr[-500:])
    return json.loads(ended.stdout.splitlines()[-1])


def search_for(
    defect: dict[str, Any], tree: Path, wide_before: list[list[float | None]], asked: argparse.Namespace
) -> dict[str, Any]:
    """Make a mutation in a copy of the tree, and search for it if it is a planted defect."""
    copy_of(tree)
    place = tree / defect["file"]
    before = place.read_text("utf-8")
    assert before.count(defect["old"]) == 1, defect["name"]
    place.write_text(before.replace(defect["old"], defect["new"]), "utf-8")
    begin_s = spent_s()
    wide = called(tree, "print_wide", asked.workers)
    both = [(one, other) for one, other in zip(wide, wide_before, strict=True) if one and other]
    said: dict[str, Any] = {"name": defect["name"], "suite": None, "methods": []}
    said |= {"judged": len(both), "acts": sum(one != other for one, other in both)}
    said |= {"shown": sum(least(one) < 0.0 <= least(other) for one, other in both)}
    if said["shown"]:
        said["suite"] = called(tree, "print_first_failure", asked.workers)
    real: list[dict[str, Any]] = []
    while said["suite"] == {}:
        left_out = [one["scenario"] for one in real]
        said["methods"] = called(tree, "print_search", asked.budget, asked.workers, left_out)
        broken = [one for one in said["methods"] if one["margin"] < 0.0]
        margins = called(ROOT, "print_margins", broken)
        if not (also := [one for one, margin in zip(broken, margins, strict=True) if margin < 0.0]):
            break
        real += also
    return {**said, "real": real, "spent_s": spent_s() - begin_s}


def spent_s() -> float:
    """Processor time of all processes that have ended."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


def cells_of(result: dict[str, Any]) -> list[str]:
    """A row of the table: name, verdict of the suite, runs until each found it, and processor time."""
    found = {one["method"]: one["found_after"] for one in result.get("methods", ())}
    by_sobol, *others = (found.get(method) for method in (BASELINE, *OPTIMISERS))
    first = min((one for one in others if one is not None), default=None)
    suite = "not run" if result["suite"] is None else next(iter(result["suite"]), "passes")
    counts = [str(result.get(key, "")) for key in ("judged", "acts", "shown")]
    runs = [str(one or "none") for one in (first, by_sobol)] if result["methods"] else ["not searched"] * 2
    return [result["name"], suite, *counts, *runs, f"{result['spent_s']:.0f}"]


def margins_before(asked: argparse.Namespace) -> list[list[float | None]]:
    """The margins of the wider runs in the committed tree, from FOLDER if they are there."""
    of_head = subprocess.run(
        ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    path: Path = asked.out / f"before-{of_head.stdout.strip()}"
    if not path.exists():
        copy_of(tree := asked.out.resolve() / "tree-before")
        found = called(tree, "print_wide", asked.workers)
        if sum(map(bool, found)) < LEAST_JUDGED * len(found):
            raise RuntimeError(f"only {sum(map(bool, found))} of {len(found)} wider runs are judged")
        path.write_text(json.dumps(found))
    wide: list[list[float | None]] = json.loads(path.read_text())
    return wide


def main() -> None:
    """Search for all defects, or the named ones, and print the table of all results in the folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    wide = margins_before(asked)
    for number, defect in enumerate(tomllib.loads(DEFECTS.read_text("utf-8"))["defects"]):
        path = asked.out / f"{number}.json"
        is_asked = any(one in defect["name"] for one in asked.names) if asked.names else "tuned" not in defect
        if path.exists() or not is_asked:
            continue
        tree = asked.out.resolve() / f"tree-{number}"
        path.write_text(json.dumps(search_for(defect, tree, wide, asked)))
        shutil.rmtree(tree)
        print(path.read_text(), flush=True)
    results = [json.loads(path.read_text()) for path in sorted(asked.out.glob("*.json"))]
    of_wide = ["wider runs", "acts in", "broken by it alone"]
    head = ["mutation", "suite", *of_wide, "runs to find it: optimisers", "Sobol", "CPU [s]"]
    progress_console.print(table_of(head, map(cells_of, results)))


if __name__ == "__main__":
    main()
