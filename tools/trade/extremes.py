"""Extreme cases by every method: the measured error, or the method's error message."""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from pathlib import Path
from typing import Any, NamedTuple

from plant_sim.plant import Plant
from plant_sim.result import MotionState
from plant_sim.scene import Scene, SceneError, load_scene, read_scene
from plant_sim.simulation import simulate
from plant_sim.solvers.cost import SolverError
from plant_sim.solvers.exact.exact import UnsupportedSceneError

METHODS = ("exact", "adaptive", "stepping", "Plant")
REFUSALS = SceneError, UnsupportedSceneError, SolverError

FINE = 1e-13
"""Accuracy of the adaptive run that is the reference if there is no closed form."""

STEPPING_ACCURACY = 1e-4
"""Requested accuracy of time stepping, a first-order method: finer steps would take minutes."""

NATURAL_RAD_S = math.sqrt(70.0 / 0.8)
CRITICAL_N_S_M = 2.0 * math.sqrt(70.0 * 0.8)

HUNT_CROSSLEY = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
KELVIN_VOIGT = HUNT_CROSSLEY | {"law": "kelvin-voigt"}
THROWN = {"initial.v_m_s": 0.7, "drive.ratio": 1.0}
"""Initial state from which the striker reaches the stop within a tenth of a second."""
STILL = {"drive.ratio": None, "drive.speed_rad_s": 0.0, "drive.amplitude_m": 0.0}


class Extreme(NamedTuple):
    """An extreme case: changes to a named scene, the run's duration, its torque, and `Plant`'s ticks."""

    what: str
    value: str
    base: str
    changes: Mapping[str, Any]
    until_s: float = 1.0
    torque_n_m: float = 0.0
    tick_s: float = 1e-3
    axis: float | None = None
    """Value on the plot's axis, if `what` has a range."""


class Cell(NamedTuple):
    """Result of a method in an extreme case: the error in m, or an error message.

    The error is that of the position, or of the velocity over ω, whichever is larger.
    """

    error_m: float
    refusal: str


def changed(base: str, changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return a named scene's tables with dotted keys replaced; the value None deletes a key."""
    tables = deepcopy(read_scene(base))
    for dotted, value in changes.items():
        *path, key = dotted.split(".")
        table = tables
        for step in path:
            table = table.setdefault(step, {})
        if value is None:
            table.pop(key, None)
        else:
            table[key] = value
    return tables


def _range(
    what: str, base: str, key: str, values: Sequence[float], unit: str = "", **given: Any
) -> Iterator[Extreme]:
    common = given.pop("changes", {})
    for value in values:
        yield Extreme(what, f"{value:g}{unit}", base, {**common, key: value}, axis=value, **given)


def _extremes() -> Iterator[Extreme]:  # noqa: PLR0912  # a list; loops are its rows
    viscous, coulomb, stribeck, motor = (
        "table1-viscous",
        "table1-coulomb",
        "table1-stribeck",
        "table1-motor-soft",
    )
    none = {"friction": {"law": "none"}}
    yield Extreme("resonance without damping", "r = 1, b = 0", viscous, {**none, "drive.ratio": 1.0}, 1.5)
    for factor, value in (
        (1.0 - 1e-12, "(1 − 1e-12) b_c"),
        (1.0, "b_c"),
        (1.0 + 1e-12, "(1 + 1e-12) b_c"),
        (10.0, "10 b_c"),
        (1e4, "1e4 b_c"),
    ):
        yield Extreme(
            "critical damping", value, viscous, {**THROWN, "friction.b_n_s_m": factor * CRITICAL_N_S_M}
        )
    for k, value in ((0.0, "0"), (1.0 - 1e-12, "1 − 1e-12"), (1.0, "1")):
        yield Extreme("restitution k", value, viscous, {**THROWN, "stop.restitution": k})
    yield Extreme("no excitation", "A = 0", viscous, {"initial.v_m_s": 0.7, "drive.amplitude_m": 0.0})
    for mu in (0.0, 0.3, 1e6):
        yield Extreme("dry friction μ", f"{mu:g}", coulomb, {**THROWN, "friction.mu": mu})
    yield Extreme(
        "Stribeck without a fall", "μ_s = μ", stribeck, {"friction.mu_s": 0.15, "friction.mu": 0.15}
    )
    yield from _range(
        "Stribeck speed v_s", stribeck, "friction.v_s_m_s", (1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-14), " m/s"
    )
    yield from _range("Stribeck exponent δ", stribeck, "friction.delta", (0.1, 0.5, 1.0, 2.0, 10.0))
    for gap_m, value in ((-1e-12, "−1e-12 m"), (0.0, "0"), (1e-12, "1e-12 m")):
        start = {"stop.position_m": 0.12 + gap_m, "initial.x_m": 0.12 + min(gap_m, 0.0)}
        yield Extreme("gap", value, viscous, start, 2.0)
    laid = {"stop.position_m": 0.10, "initial.x_m": 0.10}
    yield Extreme("gap", "−20 mm: pre-loaded, rigid", viscous, laid, 2.0)
    for stop in (HUNT_CROSSLEY, KELVIN_VOIGT):
        soft = {"stop": stop | {"position_m": 0.10}, "initial.x_m": 0.10}
        yield Extreme("gap", f"−20 mm: pre-loaded, {stop['law']}", viscous, soft, 2.0)
    for beyond_m, value in ((-1e-12, "1e-12 m short of"), (0.0, "at"), (1e-12, "1e-12 m beyond")):
        swing = {**none, **STILL, "initial.x_m": 0.06, "stop.position_m": 0.18 - beyond_m}
        yield Extreme("grazing: the swing ends", f"{value} the stop", viscous, swing)
    dry_m = 0.15 * 0.8 * 9.80665 / 70.0
    yield Extreme(
        "two events in one instant",
        "halt and touch-down",
        coulomb,
        {**STILL, "friction.mu": 0.15, "initial.x_m": 0.06 - 2.0 * dry_m},
    )
    yield Extreme(
        "chatter to rest on the stop, and release",
        "a turn at a time",
        viscous,
        {"stop.position_m": 0.12, "drive.ratio": 0.3},
        5.0,
    )
    for ratio in (0.0, 1e-6, 1e-3, 1.0, 10.0, 100.0, 1e4):
        speed = {"initial.v_m_s": 0.5, "drive.ratio": None, "drive.speed_rad_s": ratio * NATURAL_RAD_S}
        until_s = 0.05 if ratio > 100.0 else 1.0
        yield Extreme("crank speed Ω/ω", f"{ratio:g}", viscous, speed, until_s, axis=ratio or None)
    slow = {"striker.mass_kg": 1e3, "drive.ratio": 0.5}  # 24 s a swing, so that 1e6 s compute fast
    yield Extreme("long runs", "a day, in ticks of 0.1 s", viscous, slow, 86400.0, tick_s=0.1)
    yield Extreme("long runs", "1e6 s, in ticks of 10 s", viscous, slow, 1e6, tick_s=10.0)
    for mass_kg, until_s in ((1e-6, 2e-3), (1e3, 100.0)):
        natural = math.sqrt(70.0 / mass_kg)
        moving = {
            "striker.mass_kg": mass_kg,
            "friction.b_n_s_m": 0.02 * mass_kg * natural,
            "initial.v_m_s": 0.05 * natural,
        }
        yield Extreme("striker's mass", f"{mass_kg:g} kg", viscous, moving, until_s, tick_s=until_s / 100.0)
    for stop in (HUNT_CROSSLEY, KELVIN_VOIGT):
        rigidless = {key: value for key, value in stop.items() if key != "contact_s"}
        for stiffness in (1e2, 1e4, 1e6, 1e9):
            yield Extreme(
                f"stiffness, {stop['law']}",
                f"{stiffness:g} N/m" + ("^1.5" if stop is HUNT_CROSSLEY else ""),
                viscous,
                {**THROWN, "stop": rigidless | {"stiffness": stiffness}},
                axis=stiffness,
            )
    yield Extreme("start", "on the stop", viscous, {"initial.x_m": 0.18, "drive.ratio": 1.0})
    yield Extreme("start", "1 mm beyond the stop", viscous, {"initial.x_m": 0.181})
    for depth_m, value in ((1e-3, "1 mm"), (1.0, "1 m")):
        inside = {"stop": HUNT_CROSSLEY, "initial.x_m": 0.18 + depth_m}
        yield Extreme("start", f"{value} inside a soft stop", viscous, inside, 0.2)
    pad = {"stop": HUNT_CROSSLEY | {"position_m": 0.11}, "initial.x_m": 0.10, "initial.v_m_s": 0.5}
    yield Extreme("dry friction inside a pad", "pre-loaded, it sticks there", coulomb, {**STILL, **pad})
    for inertia in (1e-5, 1e-7, 1e-9):
        light = {"motor.inertia_kg_m2": inertia}
        yield Extreme("motor's inertia J", f"{inertia:g} kg m²", motor, light, 0.5, 0.012, axis=inertia)
    for torque_n_m, value in (
        (0.0049, "stalled below it"),
        (0.005, "equal to it"),
        (0.0051, "just above it"),
    ):
        yield Extreme("torque at the dry loss", value, motor, {}, 1.0, torque_n_m)
    back = {"initial.x_m": 0.0, "drive.phase_rad": 0.5}
    yield Extreme("motor", "back-driven by the striker", motor, back, 1.0)
    yield Extreme("motor", "supply sagged to 1 mV", motor, {"motor.supply_v": 1e-3}, 1.0, 0.1)
    for value, wrong in (
        ("mass −1 kg", {"striker.mass_kg": -1.0}),
        ("mass nan", {"striker.mass_kg": math.nan}),
        ("spring 0 N/m", {"striker.spring_n_m": 0.0}),
        ("amplitude inf", {"drive.amplitude_m": math.inf}),
        ("k = 1.1", {"stop.restitution": 1.1}),
        ("an unknown key", {"striker.mass_g": 800.0}),
        ("a text for a number", {"striker.mass_kg": "0.8 kg"}),
    ):
        yield Extreme("nonsense", value, viscous, wrong)


EXTREMES = tuple(_extremes())


def scene_of(extreme: Extreme, method: str, accuracy: float | None = None) -> Scene:
    """Return the scene of an extreme case for a method; raises `SceneError`."""
    solver: dict[str, Any] = {"method": "adaptive" if method == "Plant" else method}
    if method == "stepping":
        solver["accuracy"] = STEPPING_ACCURACY
    if accuracy is not None:
        solver["accuracy"] = accuracy
    return load_scene(changed(extreme.base, {**extreme.changes, "solver": solver}))


def end_of(extreme: Extreme, method: str, accuracy: float | None = None) -> MotionState:
    """Return the final state of an extreme case by a method; raises one of `REFUSALS`."""
    scene = scene_of(extreme, method, accuracy)
    if method != "Plant":
        return simulate(scene, extreme.until_s, torque_n_m=extreme.torque_n_m).final
    plant = Plant(scene, seed=1)
    for _ in range(round(extreme.until_s / extreme.tick_s)):
        plant.advance(extreme.torque_n_m, extreme.tick_s)
    return plant.state


def measure(extreme: Extreme) -> dict[str, Cell]:
    """Return a cell for each method.

    The reference is the closed form; for the closed form itself it is the finest adaptive run.
    """
    ends: dict[str, MotionState] = {}
    cells: dict[str, Cell] = {}
    for method in METHODS:
        try:
            ends[method] = end_of(extreme, method)
        except REFUSALS as error:
            cells[method] = Cell(math.nan, str(error))
    if ends:
        finest = "adaptive" if "adaptive" in ends else "stepping"
        fine = end_of(extreme, finest, FINE if finest == "adaptive" else 0.1 * STEPPING_ACCURACY)
        striker = scene_of(extreme, finest).striker
        natural_rad_s = math.sqrt(striker.spring_n_m / striker.mass_kg)
        for method, end in ends.items():
            truth = ends["exact"] if "exact" in ends and method != "exact" else fine
            error_m = max(abs(end.x_m - truth.x_m), abs(end.v_m_s - truth.v_m_s) / natural_rad_s)
            cells[method] = Cell(error_m, "")
    return {method: cells[method] for method in METHODS}


INTRODUCTION = """\
# Extreme cases, by every solver

This page gives the error of each solver in extreme cases, or the reason why the solver rejects the case. It
is written by `vibrohil trade --extremes docs/extremes.md`, and tests measure each row again.

A cell is the error of the state at the end of a run, in m: the error of the position or of the velocity
divided by ω, whichever is larger. *refused* gives the number of the error message in the list below.
`Plant` advances the module tick by tick, with ticks of 1 ms unless stated otherwise. The requested accuracy
is 1e-9 m per period, and {stepping:g} for time stepping. All other parameters are those of the scenes
`table1-viscous`, `-coulomb`, `-stribeck` and `-motor-soft`.

The reference is the closed form. For the closed form itself, and if there is none, the reference is the
adaptive solver at {fine:g}, or time stepping at a tenth of its step if the adaptive solver rejects the
case. The first column therefore contains the errors of both methods.

![error over the parameter](extremes.svg)

| extreme | value | exact | adaptive | stepping | Plant |
|---|---|---|---|---|---|
"""

ROW = re.compile(r"^\| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \| ([^|]+) \|$", re.MULTILINE)
SENTENCE = re.compile(r"^(\d+)\. (.+)$", re.MULTILINE)


def write(page: Path, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Measure all extreme cases, write the page and its plot, and return the rows."""
    measured = []
    for extreme in EXTREMES:
        progress(f"{extreme.what}: {extreme.value}")
        measured.append((extreme, measure(extreme)))
    sentences: list[str] = []
    lines = []
    for extreme, cells in measured:
        shown = []
        for cell in cells.values():
            if cell.refusal and cell.refusal not in sentences:
                sentences.append(cell.refusal)
            shown.append(
                f"refused [{sentences.index(cell.refusal) + 1}]" if cell.refusal else f"{cell.error_m:.0e}"
            )
        lines.append(f"| {extreme.what} | {extreme.value} | {' | '.join(shown)} |")
    refusals = [f"{number}. {sentence}" for number, sentence in enumerate(sentences, 1)]
    text = INTRODUCTION.format(stepping=STEPPING_ACCURACY, fine=FINE)
    page.write_text(text + "\n".join([*lines, "", "## Refusals", "", *refusals, ""]), encoding="utf-8")
    draw(measured, page.with_suffix(".svg"))
    return [
        {
            "what": f"{extreme.what}: {extreme.value}",
            **{method: cell._asdict() for method, cell in cells.items()},
        }
        for extreme, cells in measured
    ]


def read(page: Path) -> dict[tuple[str, str], dict[str, Cell]]:
    """Return the cells of a page by extreme case and value."""
    text = page.read_text(encoding="utf-8")
    sentences = dict(SENTENCE.findall(text))
    rows = {}
    for what, value, *cells in ROW.findall(text)[1:]:
        read_cells = [
            Cell(math.nan, sentences[cell[len("refused [") : -1]])
            if cell.startswith("refused")
            else Cell(float(cell), "")
            for cell in cells
        ]
        rows[what, value] = dict(zip(METHODS, read_cells, strict=True))
    return rows


def draw(measured: Sequence[tuple[Extreme, Mapping[str, Cell]]], path: Path) -> None:
    """Draw the error over the parameter, with a panel for each range."""
    import matplotlib
    from matplotlib.figure import Figure

    matplotlib.rcParams["svg.hashsalt"] = "vibrohil"

    ranges = [what for what in dict.fromkeys(one.what for one, _ in measured) if _has_range(measured, what)]
    columns = 3
    figure = Figure(figsize=(12.0, 6.4), layout="constrained")
    grid = figure.subplots(-(-len(ranges) // columns), columns, squeeze=False, sharey=True)
    for axes, what in zip(grid.flat, ranges, strict=False):
        for method, marker in zip(METHODS, "*os^", strict=True):
            points = [
                (one.axis, max(cells[method].error_m, 1e-17))
                for one, cells in measured
                if one.what == what and one.axis is not None and not cells[method].refusal
            ]
            axes.plot([x for x, _ in points], [y for _, y in points], marker + "-", label=method, alpha=0.7)
        axes.set(xscale="log", yscale="log", title=what)
    for axes in grid.flat[len(ranges) :]:
        axes.set_visible(False)
    grid[0, 0].set_ylabel("error [m]")
    grid[0, 0].legend()
    figure.savefig(path, metadata={"Date": None})


def _has_range(measured: Sequence[tuple[Extreme, Mapping[str, Cell]]], what: str) -> bool:
    return sum(one.axis is not None for one, _ in measured if one.what == what) > 2
