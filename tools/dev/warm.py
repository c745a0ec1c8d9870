"""`python -m tools.dev.warm`: compiles all kernels of runs and studies, and all modules, in advance."""

import argparse
import compileall
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from firmware_py.builds.machine_code import object_code
from hil.bench.lockstep import warm_lockstep
from hil.scenario.scenario import load_scenario
from hil.timing.realtime import collect_rarely
from kernel_cache import root
from plant_sim.scene import load_scene, read_scene
from plant_sim.simulation import simulate
from tools.study.branches.impact_map import ImpactMap
from tools.study.cases import case
from tools.study.orbits import AT_REST, CLASSIFY, classify, follow

DEFAULT_SCENARIO = "soft-start-multistable"
ROOT = Path(__file__).parents[2]
PACKAGES = ("plant_sim", "firmware_py", "hil", "tools")


def warm_studies() -> None:
    """Compile the kernels of every solver, of orbits and of branches. They serve every scene."""
    for method in ("exact", "adaptive"):
        table = read_scene("table1-viscous") | {"solver": {"method": method, "accuracy": 1e-3}}
        simulate(load_scene(table), 0.1)
    for law in ("viscous", "stribeck"):
        scene = case("table1", law).scene(1.0)
        classify(scene, np.array([AT_REST]))
        follow(scene, AT_REST, CLASSIFY)
        module = ImpactMap(scene, 1, 1, ("ratio",))
        module.orbit(module.point(np.ones(1), np.ones(1), module.nominal))


def main() -> None:
    """Compile the kernels, and print the reason for the waiting time first."""
    argparse.ArgumentParser(prog="python -m tools.dev.warm", description=__doc__).parse_args()
    print(f"setup: compiling plant and firmware into {root()}; about half a minute, once", flush=True)
    started_s = time.perf_counter()
    collect_rarely()
    for package in PACKAGES:  # where PYTHONDONTWRITEBYTECODE is set, each start would compile them again
        compileall.compile_dir(ROOT / package, quiet=2)
    with ProcessPoolExecutor(1, get_context("spawn")) as beside:
        firmware = beside.submit(object_code, "host")
        warm_studies()
        firmware.result()
    with tempfile.TemporaryDirectory() as folder:
        warm_lockstep(load_scenario(DEFAULT_SCENARIO), "compiled", Path(folder))
    print(f"setup: ready after {time.perf_counter() - started_s:.1f} s", flush=True)


if __name__ == "__main__":
    main()
