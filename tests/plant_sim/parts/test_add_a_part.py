"""The page on adding a part: each change, put into a copy of the packages, does what the page says.

A new part moves as scipy says it does; a new sensor's frames are the plant's truth and correct the estimate.
"""

import ast
import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from reference import Reference

from plant_sim.scene import load_scene
from plant_sim.simulation import initial_state

REPOSITORY = Path(__file__).parents[3]
PAGE = (REPOSITORY / "docs/how-to/add-a-part.md").read_text("utf-8")
LAW_CHANGE, BACKLASH_CHANGE, SENSOR_CHANGE = re.findall(
    r"^```diff\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE
)
COUNTS = re.findall(r"^\| (.*) \| (\d+) \| (\d+) \|", PAGE, re.MULTILINE)
COMMANDS = re.findall(r"^python -m (\S+)", PAGE, re.MULTILINE)

RESULTS = """
import ast
import json
print(json.dumps([[one.final.x_m, one.final.v_m_s, len(one.impacts.t_s), one.energy.residual, one.method]
                  for one in ({results})]))
"""


class HessSoom(Reference):
    """The law of the page's first change."""

    mu, mu_s, v_s = 0.1, 0.2, 0.1

    def _drag(self, v: float, direction: float) -> float:
        return (self.mu + (self.mu_s - self.mu) / (1.0 + (v / self.v_s) ** 2)) * self._weight() * direction

    def _limit(self) -> float:
        return self.mu_s * self._weight()

    def _weight(self) -> float:
        return self.parts.striker.mass_kg * self.parts.striker.gravity_m_s2


class WithBacklash(Reference):
    """The spring of the page's second change."""

    backlash_m = 1e-3

    def _spring(self, theta: float, x: float) -> float:
        striker = self.parts.striker
        stretch = self._piston(theta) + striker.rest_length_m - x
        return striker.spring_n_m * math.copysign(max(abs(stretch) - self.backlash_m, 0.0), stretch)


def files_of(change: str) -> list[str]:
    return re.findall(r"^\+\+\+ b/(.*)$", change, re.MULTILINE)


def with_change(change: str, script: str, results: str, folder: Path) -> list[list]:
    """What the page's script leaves on a package with that change."""
    copied("plant_sim", folder)
    applied(change, folder)
    begin = "from plant_sim import load_scene, simulate\nfrom plant_sim.scene import read_scene\n"
    return json.loads(python(folder, "-c", begin + script_of(script) + RESULTS.format(results=results)))


def copied(package: str, folder: Path) -> None:
    shutil.copytree(REPOSITORY / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))


def applied(change: str, folder: Path) -> None:
    subprocess.run(["git", "apply", "-"], input=change, text=True, cwd=folder, check=True)


def script_of(name: str) -> str:
    lines = re.search(rf"^```python {name}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert lines is not None
    return lines[1]


def python(folder: Path, *arguments: str) -> str:
    """What Python prints on the packages in `folder`."""
    done = subprocess.run(
        [sys.executable, *arguments],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def contents(folder: Path) -> dict[str, str]:
    """Every file's text; of Python what it says, however its lines are laid out."""
    texts = {}
    for path in folder.rglob("*"):
        if path.suffix in (".py", ".toml", ".dbc", ".md") and "__pycache__" not in path.parts:
            text = path.read_text("utf-8")
            texts[str(path.relative_to(folder))] = ast.dump(ast.parse(text)) if path.suffix == ".py" else text
    return texts


def changed(before: dict[str, str], after: dict[str, str]) -> set[str]:
    return {name for name in before.keys() | after.keys() if before.get(name) != after.get(name)}


def by_scipy(kind: type[Reference], name: str) -> Reference:
    scene = load_scene(name)
    start = initial_state(scene)
    run = kind(scene.parts(), start.x_m, start.v_m_s, start.crank_rad, start.omega_rad_s)
    run.run(3.0)
    return run


def error_m(result: list, truth: Reference) -> float:
    """Of position, or of velocity over ω."""
    natural = math.sqrt(truth.parts.striker.spring_n_m / truth.parts.striker.mass_kg)
    return max(abs(result[0] - truth.x), abs(result[1] - truth.v) / natural)


def test_a_law_of_friction_is_one_file(tmp_path: Path) -> None:
    adaptive, stepping = with_change(LAW_CHANGE, "law", "adaptive, stepping", tmp_path)
    truth = by_scipy(HessSoom, "table1-coulomb")
    assert adaptive[4] == "adaptive"
    assert stepping[4] == "stepping"
    assert error_m(adaptive, truth) < 1e-8
    assert error_m(stepping, truth) < 1e-3
    assert adaptive[2] == stepping[2] == len(truth.impacts_t)
    assert abs(adaptive[3]) < 1e-8
    assert COUNTS[0][:2] == ("a law of friction", str(len(files_of(LAW_CHANGE))))
    assert len(files_of(LAW_CHANGE)) <= 3


def test_backlash_in_the_crank_is_four_files(tmp_path: Path) -> None:
    [end] = with_change(BACKLASH_CHANGE, "backlash", "backlash,", tmp_path)
    truth = by_scipy(WithBacklash, "table1-viscous")
    assert end[4] == "adaptive"
    assert error_m(end, truth) < 1e-8
    assert end[2] == len(truth.impacts_t)
    assert abs(end[3]) < 1e-7
    assert COUNTS[1][:2] == ("backlash in the crank", str(len(files_of(BACKLASH_CHANGE))))
    assert len(files_of(BACKLASH_CHANGE)) <= 4


SENSOR_RESULTS = """
import json
import numpy as np
sent = used.table("can/StrikerSpeed")
truth = used.table("plant")
at = np.searchsorted(truth["t_s"].to_numpy(), sent["t_s"].to_numpy() - 1e-9)
errors = sent["striker_velocity_m_s"].to_numpy() - truth["v_m_s"].to_numpy()[at]
print(json.dumps([[one.figures.estimate.v_rmse_m_s for one in (used, ignored)], len(errors),
                  float(np.std(errors)), float(np.mean(errors))]))
"""

COMPILED_FRAMES = """
import numba
import numpy as np
from firmware_py.builds.numba_subset import register
from hil.nodes.sampled import sampled_frame
from plant_sim.sensors.sampled import SAMPLED
register()
compiled = numba.njit(lambda *arguments: sampled_frame(*arguments))
sensors, observed, noise = tuple(kind(0.01) for kind in SAMPLED), np.arange(20) * 0.01, np.ones(1)
for which in range(len(sensors)):
    frame = sampled_frame(sensors, which, observed, noise, 3)
    assert compiled(sensors, which, observed, noise, 3) == frame, which
    print(frame.can_id)
"""


def test_a_sensor_is_four_files(tmp_path: Path) -> None:
    """Through all packages: sampled, sent, received and used, in Python and in compiled code."""
    for package in ("firmware_py", "hil", "plant_sim", "tools", "docs"):
        copied(package, tmp_path)
    original = contents(tmp_path)
    applied(SENSOR_CHANGE, tmp_path)
    edited = changed(original, contents(tmp_path))
    assert edited == set(files_of(SENSOR_CHANGE))
    for command in COMMANDS:
        python(tmp_path, "-m", command)
    written = changed(original, contents(tmp_path)) - edited
    assert COUNTS[2] == ("a sensor that the firmware uses", str(len(edited)), str(len(written)))
    assert len(edited) <= 4
    assert python(tmp_path, "-c", COMPILED_FRAMES).split() == ["41", "52"]
    (by_sensor, without), frames, noise_m_s, bias_m_s = json.loads(
        python(tmp_path, "-c", script_of("sensor") + SENSOR_RESULTS)
    )
    assert frames == 400
    assert 0.009 < noise_m_s < 0.011
    assert abs(bias_m_s) < 0.002
    assert by_sensor < 0.8 * without
