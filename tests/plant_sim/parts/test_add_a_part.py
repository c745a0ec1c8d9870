"""The page on adding a part: the changes, put into a copy of the packages, do what the page says.

A new part moves as scipy says it does; a new sensor's frames are the plant's truth and correct the estimate.
"""

import ast
import json
import math
import re
from pathlib import Path
from typing import Any

import pytest
from patched_packages import REPOSITORY, applied, copied, files_of, python
from reference import Reference

from plant_sim.parts.stop import HuntCrossley
from plant_sim.scene import load_scene
from plant_sim.simulation import initial_state

PAGE = (REPOSITORY / "docs/how-to/add-a-part.md").read_text("utf-8")
BESIDE = re.findall(r"\]\((add-a-part/(\w+)\.diff)\)", PAGE)
CHANGES = {name: (REPOSITORY / "docs/how-to" / file).read_text("utf-8") for file, name in BESIDE}
COUNTS = re.findall(r"^\| .* \| (\d+) \| (\d+) \|", PAGE, re.MULTILINE)
COMMANDS = re.findall(r"^python -m (\S+)", PAGE, re.MULTILINE)

SOFT = HuntCrossley(0.18, 2e4, 1.0, 0.0)
"""A soft stop, whose force `OnRubber` replaces."""

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
        return striker.spring_n_per_m * math.copysign(max(abs(stretch) - self.backlash_m, 0.0), stretch)


class OnRubber(Reference):
    """The stop of the page's second change."""

    def _stop_force(self, depth: float, v: float) -> float:
        return (2e4 + 1e9 * depth * depth) * depth * max(1.0 + 0.5 * v, 0.0)


class TippingOver(Reference):
    """The housing of the page's third change."""

    def _shaken(self, t: float) -> float:
        return self.parts.striker.gravity_m_s2 * math.sin(0.1 + 0.05 * t) / math.cos(0.1)


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the packages with the changes of the plant's parts; all share the plant's one kernel."""
    folder = copied(tmp_path_factory.mktemp("changed"), "firmware_py", "hil", "plant_sim", "tools", "docs")
    for name in ("law", "stop", "housing", "backlash"):
        applied(CHANGES[name], folder)
    return folder


@pytest.fixture(scope="module")
def results(packages: Path) -> dict[str, list]:
    """What each of the page's scripts leaves, interpreted."""
    scripts = "".join(script_of(name) for name in ("law", "stop", "housing", "backlash"))
    print_results = RESULTS.format(results="adaptive, pad, tipping, backlash")
    runs = json.loads(python(packages, "-c", scripts + print_results, interpreted=True))
    return dict(zip(("law", "stop", "housing", "backlash"), runs, strict=True))


def script_of(name: str) -> str:
    lines = re.search(rf"^```python {name}\n(.*?)^```$", PAGE, re.DOTALL | re.MULTILINE)
    assert lines is not None
    return lines[1]


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


def by_scipy(kind: type[Reference], name: str, changes: dict, **parts: Any) -> Reference:
    scene = load_scene(name).with_(changes)
    start = initial_state(scene)
    run = kind(scene.parts()._replace(**parts), start.x_m, start.v_m_s, start.crank_rad, start.omega_rad_s)
    run.run(3.0)
    return run


def error_m(result: list, truth: Reference) -> float:
    """Of position, or of velocity over ω."""
    natural = math.sqrt(truth.parts.striker.spring_n_per_m / truth.parts.striker.mass_kg)
    return max(abs(result[0] - truth.x), abs(result[1] - truth.v) / natural)


@pytest.mark.parametrize(
    ("name", "place", "most"), [("law", 0, 1), ("stop", 1, 1), ("housing", 2, 3), ("backlash", 3, 3)]
)
def test_a_change_alone_fits_and_has_as_few_files_as_the_page_says(name: str, place: int, most: int) -> None:
    applied(CHANGES[name], REPOSITORY, "--check")
    files = files_of(CHANGES[name])
    assert COUNTS[place][0] == str(len(files))
    assert len(files) <= most


@pytest.mark.parametrize(
    ("name", "kind", "base", "changes", "parts", "energy"),
    [
        ("law", HessSoom, "table1-coulomb", {}, {}, 1e-8),
        ("stop", OnRubber, "table1-viscous", {"drive.ratio": 1.0}, {"stop": SOFT}, 1e-8),
        ("housing", TippingOver, "table1-viscous", {"housing": {"tilt_rad": 0.1}}, {}, 1e-8),
        ("backlash", WithBacklash, "table1-viscous", {}, {}, 1e-7),
    ],
)
def test_a_changed_module_moves_as_scipy_says(
    results: dict[str, list], name: str, kind: type, base: str, changes: dict, parts: dict, energy: float
) -> None:
    truth = by_scipy(kind, base, changes, **parts)
    assert results[name][4] == "adaptive"
    assert error_m(results[name], truth) < 1e-8
    assert results[name][2] == len(truth.impacts_t)
    assert abs(results[name][3]) < energy


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
from firmware_py.core.measurements import measurements_of, model_sensors
from firmware_py.interface.arrivals import NOTHING_YET, Now
from firmware_py.interface.generated.received import INITIAL, receive
from firmware_py.shell.parameters import DEFAULTS, parameters_of
from hil.nodes.plant.sampled import sampled_frame
from plant_sim.sensors.sampled import SAMPLED
register()
compiled = numba.njit(lambda *arguments: sampled_frame(*arguments))
sensors, observed, noise = tuple(kind(0.01) for kind in SAMPLED), np.arange(20) * 0.01, np.ones(1)
for which in range(len(sensors)):
    frame = sampled_frame(sensors, which, observed, noise, 3)
    assert compiled(sensors, which, observed, noise, 3) == frame, which
    arguments = Now(7, 0.001), INITIAL, NOTHING_YET, frame
    taken = numba.njit(lambda *arguments: receive(*arguments))(*arguments)
    assert taken == receive(*arguments), which
    assert taken[2]
    readings = numba.njit(lambda *arguments: measurements_of(*arguments))(taken[0], 7)
    assert readings == measurements_of(taken[0], 7)
    print(frame.can_id)
defaults = parameters_of(DEFAULTS).estimator
assert numba.njit(lambda estimator: model_sensors(estimator))(defaults) == model_sensors(defaults)
"""


def test_a_sensor_is_four_files(packages: Path) -> None:
    """Through all packages: sampled, sent, received and used.

    Firmware and plant run interpreted: to compile both anew takes minutes. What the sensor changes in them is
    compiled: it makes the same frames, and receives them alike.
    """
    original = contents(packages)
    applied(CHANGES["sensor"], packages)
    edited = changed(original, contents(packages))
    assert edited == set(files_of(CHANGES["sensor"]))
    for command in COMMANDS:
        python(packages, "-m", command)
    written = changed(original, contents(packages)) - edited
    assert COUNTS[4] == (str(len(edited)), str(len(written)))
    assert len(edited) <= 4
    assert python(packages, "-c", COMPILED_FRAMES).split() == ["41", "52"]
    script = script_of("sensor").replace("set=", 'firmware="python", set=')
    (by_sensor, without), frames, noise_m_s, bias_m_s = json.loads(
        python(packages, "-c", script + SENSOR_RESULTS, interpreted=True)
    )
    assert frames == 400
    assert 0.009 < noise_m_s < 0.011
    assert abs(bias_m_s) < 0.002
    assert by_sensor < 0.8 * without
