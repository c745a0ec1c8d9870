"""Extreme cases by every method: the measured error, or the method's error message."""

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from hil.record.new_file import write_anew
from plant_sim.plant import Plant
from plant_sim.result import MotionState
from plant_sim.scene import Scene, SceneError, load_scene, read_scene, with_values
from plant_sim.simulation import simulate
from plant_sim.solvers.cost import SolverError
from plant_sim.solvers.exact.exact import UnsupportedSceneError

METHODS = ("exact", "adaptive", "Plant")
REFUSALS = SceneError, UnsupportedSceneError, SolverError

FINE = 1e-13
"""Accuracy of the adaptive run that is the reference if there is no closed form."""

NATURAL_RAD_S = math.sqrt(70.0 / 0.8)
CRITICAL_N_S_M = 2.0 * math.sqrt(70.0 * 0.8)

HUNT_CROSSLEY = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
KELVIN_VOIGT = HUNT_CROSSLEY | {"law": "kelvin-voigt"}
THROWN = {"initial.v_m_s": 0.7, "drive.ratio": 1.0}
"""Initial state from which the striker reaches the stop within a tenth of a second."""
STILL = {"drive.ratio": None, "drive.speed_rad_s": 0.0, "drive.amplitude_m": 0.0}


class Disturbance(NamedTuple):
    """A kick of the striker, or a shift of its stop, within a run."""

    at_s: float
    kick_m_s: float = 0.0
    stop_by_m: float = 0.0


class Extreme(NamedTuple):
    """An extreme case: changes to a named scene, the run's duration, its torque, and `Plant`'s ticks."""

    what: str
    value: str
    base: str
    changes: Mapping[str, Any]
    until_s: float = 1.0
    torque_n_m: float = 0.0
    tick_s: float = 1e-3
    disturbance: Disturbance | None = None
    """Ideal drives only."""


class Cell(NamedTuple):
    """Result of a method in an extreme case: the error in m, or an error message.

    The error is that of the position, or of the velocity over ω, whichever is larger.
    """

    error_m: float
    refusal: str


VISCOUS, COULOMB, STRIBECK, MOTOR = (
    "table1-viscous",
    "table1-coulomb",
    "table1-stribeck",
    "table1-motor-soft",
)
WITHOUT_FRICTION = {"friction": {"law": "none"}}


def _extremes() -> Iterator[Extreme]:
    yield from _friction_and_impact()
    yield from _instants()
    yield from _scales()
    yield from _soft_stops_and_starts()
    yield from _motor()
    yield from _disturbances()
    yield from _nonsense()


def _friction_and_impact() -> Iterator[Extreme]:
    """Resonance, damping, restitution and the laws of friction at their ends."""
    yield Extreme(
        "resonance without damping", "r = 1, b = 0", VISCOUS, {**WITHOUT_FRICTION, "drive.ratio": 1.0}, 1.5
    )
    for factor, value in (
        (1.0 - 1e-12, "(1 − 1e-12) b_c"),
        (1.0, "b_c"),
        (1.0 + 1e-12, "(1 + 1e-12) b_c"),
        (10.0, "10 b_c"),
        (1e4, "1e4 b_c"),
    ):
        yield Extreme(
            "critical damping", value, VISCOUS, {**THROWN, "friction.b_n_s_m": factor * CRITICAL_N_S_M}
        )
    for k, value in ((0.0, "0"), (1.0 - 1e-12, "1 − 1e-12"), (1.0, "1")):
        yield Extreme("restitution k", value, VISCOUS, {**THROWN, "stop.restitution": k})
    yield Extreme("no excitation", "A = 0", VISCOUS, {"initial.v_m_s": 0.7, "drive.amplitude_m": 0.0})
    for mu in (0.0, 0.3, 1e6):
        yield Extreme("dry friction μ", f"{mu:g}", COULOMB, {**THROWN, "friction.mu": mu})
    yield Extreme(
        "Stribeck without a fall", "μ_s = μ", STRIBECK, {"friction.mu_s": 0.15, "friction.mu": 0.15}
    )
    for v_s_m_s in (1e-1, 1e-2, 1e-3, 1e-5, 1e-7, 1e-14):
        yield Extreme("Stribeck speed v_s", f"{v_s_m_s:g} m/s", STRIBECK, {"friction.v_s_m_s": v_s_m_s})
    for delta in (0.1, 0.5, 1.0, 2.0, 10.0):
        yield Extreme("Stribeck exponent δ", f"{delta:g}", STRIBECK, {"friction.delta": delta})


def _instants() -> Iterator[Extreme]:
    """Gaps of nothing, grazing, two events in one instant, chatter."""
    for gap_m, value in ((-1e-12, "−1e-12 m"), (0.0, "0"), (1e-12, "1e-12 m")):
        start = {"stop.position_m": 0.12 + gap_m, "initial.x_m": 0.12 + min(gap_m, 0.0)}
        yield Extreme("gap", value, VISCOUS, start, 2.0)
    laid = {"stop.position_m": 0.10, "initial.x_m": 0.10}
    yield Extreme("gap", "−20 mm: pre-loaded, rigid", VISCOUS, laid, 2.0)
    for stop in (HUNT_CROSSLEY, KELVIN_VOIGT):
        soft = {"stop": stop | {"position_m": 0.10}, "initial.x_m": 0.10}
        yield Extreme("gap", f"−20 mm: pre-loaded, {stop['law']}", VISCOUS, soft, 2.0)
    for beyond_m, value in ((-1e-12, "1e-12 m short of"), (0.0, "at"), (1e-12, "1e-12 m beyond")):
        swing = {**WITHOUT_FRICTION, **STILL, "initial.x_m": 0.06, "stop.position_m": 0.18 - beyond_m}
        yield Extreme("grazing: the swing ends", f"{value} the stop", VISCOUS, swing)
    dry_m = 0.15 * 0.8 * 9.80665 / 70.0
    yield Extreme(
        "two events in one instant",
        "halt and touch-down",
        COULOMB,
        {**STILL, "friction.mu": 0.15, "initial.x_m": 0.06 - 2.0 * dry_m},
    )
    yield Extreme(
        "chatter to rest on the stop, and release",
        "a turn at a time",
        VISCOUS,
        {"stop.position_m": 0.12, "drive.ratio": 0.3},
        5.0,
    )


def _scales() -> Iterator[Extreme]:
    """Crank speeds, durations and masses over many powers of ten."""
    for ratio in (0.0, 1e-6, 1e-3, 1.0, 10.0, 100.0, 1e4):
        speed = {"initial.v_m_s": 0.5, "drive.ratio": None, "drive.speed_rad_s": ratio * NATURAL_RAD_S}
        until_s = 0.05 if ratio > 100.0 else 1.0
        yield Extreme("crank speed Ω/ω", f"{ratio:g}", VISCOUS, speed, until_s)
    slow = {"striker.mass_kg": 1e3, "drive.ratio": 0.5}  # 24 s a swing, so that 1e6 s compute fast
    yield Extreme("long runs", "a day, in ticks of 0.1 s", VISCOUS, slow, 86400.0, tick_s=0.1)
    yield Extreme("long runs", "1e6 s, in ticks of 10 s", VISCOUS, slow, 1e6, tick_s=10.0)
    for mass_kg, until_s in ((1e-6, 2e-3), (1e3, 100.0)):
        natural = math.sqrt(70.0 / mass_kg)
        moving = {
            "striker.mass_kg": mass_kg,
            "friction.b_n_s_m": 0.02 * mass_kg * natural,
            "initial.v_m_s": 0.05 * natural,
        }
        yield Extreme("striker's mass", f"{mass_kg:g} kg", VISCOUS, moving, until_s, tick_s=until_s / 100.0)


def _soft_stops_and_starts() -> Iterator[Extreme]:
    """Stiffnesses, starts on and beyond the stop, rest inside a pad."""
    for stop in (HUNT_CROSSLEY, KELVIN_VOIGT):
        rigidless = {key: value for key, value in stop.items() if key != "contact_s"}
        for stiffness in (1e2, 1e4, 1e6, 1e9):
            yield Extreme(
                f"stiffness, {stop['law']}",
                f"{stiffness:g} N/m" + ("^1.5" if stop is HUNT_CROSSLEY else ""),
                VISCOUS,
                {**THROWN, "stop": rigidless | {"stiffness": stiffness}},
            )
    yield Extreme("start", "on the stop", VISCOUS, {"initial.x_m": 0.18, "drive.ratio": 1.0})
    yield Extreme("start", "1 mm beyond the stop", VISCOUS, {"initial.x_m": 0.181})
    for depth_m, value in ((1e-3, "1 mm"), (1.0, "1 m")):
        inside = {"stop": HUNT_CROSSLEY, "initial.x_m": 0.18 + depth_m}
        yield Extreme("start", f"{value} inside a soft stop", VISCOUS, inside, 0.2)
    pad = {"stop": HUNT_CROSSLEY | {"position_m": 0.11}, "initial.x_m": 0.10, "initial.v_m_s": 0.5}
    yield Extreme("dry friction inside a pad", "pre-loaded, it sticks there", COULOMB, {**STILL, **pad})


def _motor() -> Iterator[Extreme]:
    """A light motor, its dry loss, a striker that drives it, no supply."""
    for inertia in (1e-5, 1e-7, 1e-9):
        light = {"motor.inertia_kg_m2": inertia}
        yield Extreme("motor's inertia J", f"{inertia:g} kg m²", MOTOR, light, 0.5, 0.012)
    for torque_n_m, value in (
        (0.0049, "stalled below it"),
        (0.005, "equal to it"),
        (0.0051, "just above it"),
    ):
        yield Extreme("torque at the dry loss", value, MOTOR, {}, 1.0, torque_n_m)
    back = {"initial.x_m": 0.0, "drive.phase_rad": 0.5}
    yield Extreme("motor", "back-driven by the striker", MOTOR, back, 1.0)
    yield Extreme("motor", "supply sagged to 1 mV", MOTOR, {"motor.supply_v": 1e-3}, 1.0, 0.1)


def _nonsense() -> Iterator[Extreme]:
    """Scenes that are to be refused."""
    for value, wrong in (
        ("mass −1 kg", {"striker.mass_kg": -1.0}),
        ("mass nan", {"striker.mass_kg": math.nan}),
        ("spring 0 N/m", {"striker.spring_n_m": 0.0}),
        ("amplitude inf", {"drive.amplitude_m": math.inf}),
        ("k = 1.1", {"stop.restitution": 1.1}),
        ("an unknown key", {"striker.mass_g": 800.0}),
        ("a text for a number", {"striker.mass_kg": "0.8 kg"}),
    ):
        yield Extreme("nonsense", value, VISCOUS, wrong)


def _disturbances() -> Iterator[Extreme]:
    """Kicks and a moved stop in each phase; a striker in a pad without memory may be kicked in contact."""
    on_stop = {**STILL, "initial.x_m": 0.10, "stop.position_m": 0.10}
    in_pad = {**THROWN, "stop": KELVIN_VOIGT, "initial.x_m": 0.1795}
    for value, base, changes, disturbance in (
        ("−1 m/s in flight", VISCOUS, THROWN, Disturbance(0.05, -1.0)),
        ("+100 m/s in flight", VISCOUS, THROWN, Disturbance(0.05, 100.0)),
        ("−0.5 m/s at rest on the stop", VISCOUS, on_stop, Disturbance(0.5, -0.5)),
        ("+0.5 m/s at rest on the stop", VISCOUS, on_stop, Disturbance(0.5, 0.5)),
        ("0.5 m/s while friction holds", COULOMB, STILL, Disturbance(0.5, 0.5)),
        ("1e-12 m/s while friction holds", COULOMB, STILL, Disturbance(0.5, 1e-12)),
        ("−1.5 m/s in a Kelvin–Voigt pad", VISCOUS, in_pad, Disturbance(0.002, -1.5)),
    ):
        yield Extreme("a kick", value, base, changes, disturbance=disturbance)
    for value, by_m in (("by −20 mm", -0.02), ("by +20 mm", 0.02)):
        moved = Disturbance(0.05, stop_by_m=by_m)
        yield Extreme("the stop moves", value, VISCOUS, THROWN, disturbance=moved)


EXTREMES = tuple(_extremes())


def scene_of(extreme: Extreme, method: str, accuracy: float | None = None) -> Scene:
    """Return the scene of an extreme case for a method; raises `SceneError`."""
    solver: dict[str, Any] = {"method": "adaptive" if method == "Plant" else method}
    if accuracy is not None:
        solver["accuracy"] = accuracy
    return load_scene(with_values(read_scene(extreme.base), {**extreme.changes, "solver": solver}))


def end_of(extreme: Extreme, method: str, accuracy: float | None = None) -> MotionState:
    """Return the final state of an extreme case by a method; raises one of `REFUSALS`."""
    scene = scene_of(extreme, method, accuracy)
    disturbance = extreme.disturbance
    if method != "Plant":
        if disturbance is None:
            return simulate(scene, extreme.until_s, torque_n_m=extreme.torque_n_m).final
        return _simulate_disturbed(scene, extreme.until_s, disturbance)
    plant = Plant(scene, seed=1)
    for tick in range(round(extreme.until_s / extreme.tick_s)):
        if disturbance is not None and tick == round(disturbance.at_s / extreme.tick_s):
            plant.kick(disturbance.kick_m_s)
            stop: Any = plant.parts.stop
            moved = stop._replace(position_m=stop.position_m + disturbance.stop_by_m)
            plant.replace_parts(plant.parts._replace(stop=moved))
        plant.advance(extreme.torque_n_m, extreme.tick_s)
    return plant.state


def _simulate_disturbed(scene: Scene, until_s: float, disturbance: Disturbance) -> MotionState:
    """Return the final state of two runs, the second from the disturbed end of the first."""
    before = simulate(scene, disturbance.at_s).final
    stop: Any = scene.stop
    after = scene.with_(
        {
            "initial.x_m": before.x_m,
            "initial.v_m_s": before.v_m_s + disturbance.kick_m_s,
            "drive.phase_rad": before.crank_rad,
            "stop.position_m": stop.position_m + disturbance.stop_by_m,
        }
    )
    return simulate(after, until_s - disturbance.at_s).final


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
        fine = end_of(extreme, "adaptive", FINE)
        striker = scene_of(extreme, "adaptive").striker
        natural_rad_s = math.sqrt(striker.spring_n_m / striker.mass_kg)
        for method, end in ends.items():
            truth = ends["exact"] if "exact" in ends and method != "exact" else fine
            error_m = max(abs(end.x_m - truth.x_m), abs(end.v_m_s - truth.v_m_s) / natural_rad_s)
            cells[method] = Cell(error_m, "")
    return {method: cells[method] for method in METHODS}


INTRODUCTION = """\
# Extreme cases, by every solver

Written by `vibrohil trade extremes --page docs/extremes.md`. A cell is the error of the state at the end of a
run, in m: of the position or of the velocity divided by ω, whichever is larger. *refused* gives the number of
the error message below. `Plant` advances in ticks of 1 ms unless stated otherwise. A kick or a moved stop
disturbs the running plant; `exact` and `adaptive` begin a second run at the disturbed state. The requested
accuracy is 1e-9 m per period. Other parameters: scenes `table1-viscous`, `-coulomb`, `-stribeck` and
`-motor-soft`.

The reference is the closed form; for the closed form itself, and if there is none, the adaptive solver at
{fine:g}.

| extreme | value | exact | adaptive | Plant |
|---|---|---|---|---|
"""


def write(page: Path, progress: Callable[[str], None]) -> list[dict[str, Any]]:
    """Measure all extreme cases, write the page, and return the rows."""
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
    text = INTRODUCTION.format(fine=FINE)
    write_anew(page, text + "\n".join([*lines, "", "## Refusals", "", *refusals, ""]))
    return [
        {
            "what": f"{extreme.what}: {extreme.value}",
            **{method: cell._asdict() for method, cell in cells.items()},
        }
        for extreme, cells in measured
    ]
