"""The page on adding a part: each change, put into a copy of the package, moves as scipy says it does."""

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
LAW_CHANGE, BACKLASH_CHANGE = re.findall(r"^```diff\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
COUNTS = re.findall(r"^\| (.*) \| (\d+) \|", PAGE, re.MULTILINE)

RESULTS = """
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
    shutil.copytree(
        REPOSITORY / "plant_sim", folder / "plant_sim", ignore=shutil.ignore_patterns("__pycache__")
    )
    subprocess.run(["git", "apply", "-"], input=change, text=True, cwd=folder, check=True)
    lines = re.search(rf"^```python {script}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert lines is not None
    begin = "from plant_sim import load_scene, simulate\nfrom plant_sim.scene import read_scene\n"
    done = subprocess.run(
        [sys.executable, "-c", begin + lines[1] + RESULTS.format(results=results)],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


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
    assert COUNTS[0] == ("a law of friction", str(len(files_of(LAW_CHANGE))))
    assert len(files_of(LAW_CHANGE)) <= 3


def test_backlash_in_the_crank_is_three_files(tmp_path: Path) -> None:
    [end] = with_change(BACKLASH_CHANGE, "backlash", "backlash,", tmp_path)
    truth = by_scipy(WithBacklash, "table1-viscous")
    assert end[4] == "adaptive"
    assert error_m(end, truth) < 1e-8
    assert end[2] == len(truth.impacts_t)
    assert abs(end[3]) < 1e-7
    assert COUNTS[1] == ("backlash in the crank", str(len(files_of(BACKLASH_CHANGE))))
    assert len(files_of(BACKLASH_CHANGE)) <= 4


def test_the_files_of_a_sensor_are_those_that_name_it() -> None:
    named = {
        str(path.relative_to(REPOSITORY / package))
        for package in ("plant_sim", "hil", "firmware_py")
        for path in (REPOSITORY / package).rglob("*.*")
        if path.suffix in (".py", ".dbc", ".toml")
        and "generated" not in path.parts
        and path.name != "parameter_values.py"
        and re.search(r"coarse(?!st)", path.read_text("utf-8"), re.IGNORECASE)
    }
    section = PAGE.partition("## A sensor")[2].partition("For a sensor of your own")[0]
    assert set(re.findall(r"`([\w/]+\.\w+)`", section)) == named
    assert COUNTS[2] == ("a sensor that the firmware uses", str(len(named)))
