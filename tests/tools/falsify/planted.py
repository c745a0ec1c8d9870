"""Searches for the planted defects of planted.toml, and says of each whether it was found.

    python tests/tools/falsify/planted.py --out FOLDER [--budget N] [--workers N] [NAME…]

Each defect is made in a copy of the committed tree. If a scenario of the suite fails with it, it is not a
planted defect, and is not searched for. It is found if `vibrohil falsify` with its default spaces finds a run
that breaks a requirement there and none in the tree itself. A second start continues after the defects whose
result is in FOLDER.
"""

import argparse
import io
import json
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path
from typing import Any

from hil.scenario.files import scenario_names
from hil.scenario.scenario import load_scenario
from tools.falsify.objective import judged
from tools.jobs import pool

ROOT = Path(__file__).parents[3]
DEFECTS = Path(__file__).with_name("planted.toml")
SCENARIOS = (
    "a-kick-towards-the-stop-does-not-lose-the-impacts",
    "twenty-lost-samples-do-not-stop-it",
    "a-violent-kick-stops-the-motor",
    "a-controller-whose-clock-jitters-goes-on",
    "half-of-the-samples-lost-is-ridden-through",
    "lost-operator-commands-stop-the-motor",
    "e-stop-in-the-hold",
    "a-stumble-ends-the-pulses",
)
"""The scenarios that are searched for every defect."""


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


def search_for(defect: dict[str, str], tree: Path, budget: int, workers: int) -> dict[str, Any]:
    """Plant a defect in a copy of the tree, and search for it if the suite passes."""
    copy_of(tree)
    place = tree / defect["file"]
    before = place.read_text("utf-8")
    assert before.count(defect["old"]) == 1, defect["name"]
    place.write_text(before.replace(defect["old"], defect["new"]), "utf-8")
    suite = in_tree(tree, "-c", f"import planted; planted.print_first_failure({workers})")
    if suite.returncode != 0:
        return {"name": defect["name"], "error": suite.stderr[-500:]}
    fails = json.loads(suite.stdout.splitlines()[-1])
    if fails:
        return {"name": defect["name"], "suite": fails}
    options = ["--budget", str(budget), "--workers", str(workers), "--json"]
    ended = in_tree(tree, "-m", "tools.cli", "falsify", *SCENARIOS, *options)
    if ended.returncode not in (0, 1):
        return {"name": defect["name"], "error": ended.stderr[-500:]}
    found = json.loads(ended.stdout)
    result: dict[str, Any] = {"name": defect["name"], "suite": {}, "breaks": found["found"]}
    result |= {"worst": found["worst"], "methods": found["methods"]}
    if found["found"]:
        path = str(tree / found["counterexample"])
        command = ["run", path, "--clock", "lockstep", "--out", str(tree / "unplanted"), "--json"]
        result["is_the_defect"] = in_tree(ROOT, "-m", "tools.cli", *command).returncode == 0
    return result


def main() -> None:
    """Search for all defects, or the named ones."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--budget", type=int, default=2000)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--out", type=Path, required=True)
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    defects = tomllib.loads(DEFECTS.read_text("utf-8"))["defects"]
    for number, defect in enumerate(defects):
        path = asked.out / f"{number}.json"
        if path.exists() or (asked.names and not any(one in defect["name"] for one in asked.names)):
            continue
        tree = asked.out.resolve() / f"tree-{number}"
        path.write_text(json.dumps(search_for(defect, tree, asked.budget, asked.workers)))
        shutil.rmtree(tree)
        print(path.read_text(), flush=True)


if __name__ == "__main__":
    main()
