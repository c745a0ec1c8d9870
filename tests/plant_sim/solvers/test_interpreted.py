"""NUMBA_DISABLE_JIT=1: Python runs every law and solver, so that a debugger can step through them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = """
import json
from plant_sim import Plant, load_scene, simulate
from plant_sim.scene import read_scene

def states():
    for name in ("table1-motor-soft", "table1-dq-motor", "table1-stribeck", "table1-walking"):
        plant = Plant(load_scene(name), seed=1)
        for _ in range(20):
            plant.advance(0.06, 1e-3)
        if plant.scene.sensors is not None:
            plant.sense()
        yield plant.state
    for method in ("exact", "adaptive"):
        scene = read_scene("table1-coulomb") | {"solver": {"method": method, "accuracy": 1e-3}}
        yield simulate(load_scene(scene), 0.6).final

print(json.dumps([[state.x_m, state.v_m_s, state.crank_rad] for state in states()]))
"""


def test_interpreted_kernels_move_as_the_compiled_ones_do() -> None:
    states = []
    for setting in ({"NUMBA_DISABLE_JIT": "1"}, {}):
        root = str(Path(__file__).parents[3])
        run = subprocess.run(
            [sys.executable, "-c", RUN],
            env=os.environ | setting | {"PYTHONPATH": root},
            capture_output=True,
            text=True,
            check=False,
        )
        assert run.returncode == 0, run.stderr
        states.append(json.loads(run.stdout))
    for interpreted, compiled in zip(*states, strict=True):
        assert interpreted == pytest.approx(compiled, abs=1e-9)
