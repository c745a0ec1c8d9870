"""`python -m tools.dev.warm`: compiles all kernels of runs and studies, and all modules, in advance."""

import argparse
import compileall
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from compilation import PACKAGES
from compilation.kernel_cache import root
from firmware_py.builds.compiled import kernels
from hil.runs.job import Job
from hil.runs.recording import warm_lockstep
from hil.scenario.scenario import load_scenario
from hil.timing.realtime import collect_rarely
from plant_sim.scene import load_scene, read_scene
from plant_sim.simulation import simulate
from tools.study.branches.impact_map import ImpactMap
from tools.study.cases import case
from tools.study.orbits import AT_REST, CLASSIFY, classify, follow

DEFAULT_SCENARIO = "soft-start-multistable"
ROOT = Path(__file__).parents[2]


def warm_modules() -> None:
    """Compile all modules to bytecode: where PYTHONDONTWRITEBYTECODE is set, each start would do it again."""
    for package in PACKAGES:
        compileall.compile_dir(ROOT / package, quiet=2)


def warm_solver(method: str) -> None:
    """Compile the kernels of a solver. They serve every scene."""
    table = read_scene("table1-viscous") | {"solver": {"method": method, "accuracy": 1e-3}}
    simulate(load_scene(table), 0.1)


def warm_studies() -> None:
    """Compile the kernels of orbits and of branches."""
    for law in ("viscous", "stribeck"):
        scene = case("table1", law).scene(1.0)
        classify(scene, np.array([AT_REST]))
        follow(scene, AT_REST, CLASSIFY)
        module = ImpactMap(scene, 1, 1, ("ratio",))
        module.orbit(module.point(np.ones(1), np.ones(1), module.nominal))


def warm_firmware() -> None:
    """Compile the firmware."""
    collect_rarely()
    kernels()


def warm_loop() -> None:
    """Compile what couples firmware and plant."""
    warm_lockstep(Job(load_scenario(DEFAULT_SCENARIO), 1))


def main() -> None:
    """Compile everything, a line for each step, and print how long the whole set-up took."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.warm", description=__doc__)
    parser.add_argument(
        "--begun-s", type=float, default=time.time(), help="Unix time at which the set-up began"
    )
    begun_s = parser.parse_args().begun_s
    print(f"setup: compiling plant and firmware into {root()}; about half a minute, once", flush=True)
    collect_rarely()
    with ProcessPoolExecutor(1, get_context("spawn")) as beside:
        firmware = beside.submit(warm_firmware)
        steps: tuple[tuple[str, Callable[[], object]], ...] = (
            ("modules", warm_modules),
            ("the exact solver", partial(warm_solver, "exact")),
            ("the adaptive solver", partial(warm_solver, "adaptive")),
            ("orbits and branches", warm_studies),
            ("the firmware, in a process beside these", firmware.result),
            ("the closed loop", warm_loop),
        )
        for number, (name, compile_step) in enumerate(steps, 1):
            print(f"setup: {number} of {len(steps)}: {name}", flush=True)
            compile_step()
    print(f"setup: ready; it took {time.time() - begun_s:.0f} s in all", flush=True)


if __name__ == "__main__":
    main()
