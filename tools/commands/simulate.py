"""`vibrohil simulate SCENE`: the plant alone."""

import time
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import Change, Json, load_changed_scene, number
from tools.commands.places import PICTURES, file_option
from tools.output import BadInputError, answer, show_tables

LONGEST_S = 86_400.0
LONGEST_PLOT_S = 3600.0
"""Longest simulation with a plot; the plot's samples are 1 ms apart."""
OF_IMPACTS = ("impacts_t_s", "impacts_v_m_s", "impulses_n_s", "peak_forces_n")
"""Keys of the result with a number for each impact."""


def simulate(
    scene: Annotated[str, typer.Argument(help="A scene's name or its TOML file.")],
    until: Annotated[float, number("Simulated time in s.")] = 10.0,
    torque: Annotated[float, number("Constant motor torque in N m, in a scene with a motor.")] = 0.0,
    change: Change = None,
    plot: Annotated[
        Path | None, file_option("Draw position and phase portrait into this file.", PICTURES)
    ] = None,
    as_json: Json = False,
) -> None:
    """Simulate the plant alone and list its impacts."""
    longest_s = LONGEST_S if plot is None else LONGEST_PLOT_S
    if not 0.0 < until <= longest_s:
        raise BadInputError(
            f"--until is {until}: wanted above 0 and at most {longest_s:g} simulated seconds, e.g. --until 10"
        )
    loaded = load_changed_scene(scene, change)
    from plant_sim.simulation import simulate as simulate_plant  # imports numba: after the input's checks

    started = time.perf_counter()
    result = simulate_plant(loaded, until, torque_n_m=torque, samples_s=1e-3 if plot else None)
    wall_s = time.perf_counter() - started
    electrical = result.electrical
    payload = {
        "scene": scene,
        "impacts_t_s": result.impacts.t_s,
        "impacts_v_m_s": result.impacts.v_m_s,
        "impulses_n_s": result.impacts.impulse_n_s,
        "peak_forces_n": result.impacts.peak_force_n,
        "final": asdict(result.final) | {"phase": result.final.phase.name.lower().replace("_", "-")},
        "energy": asdict(result.energy),
        "energy_residual": result.energy.residual,
        "electrical": None if electrical is None else {**asdict(electrical), "residual": electrical.residual},
        "peak_felt_force_n": result.peak_felt_force_n,
        "method": result.method,
        "notes": list(result.notes),
        "wall_s": wall_s,
    }
    if plot is not None:
        from tools.plots import plot_motion

        plot_motion(result, loaded, plot)
        payload["plot"] = str(plot)
    answer(payload, as_json, lambda: show(payload))


def show(payload: dict[str, Any]) -> None:
    """Print the result, with a row for each impact."""
    columns = {name.removeprefix("impacts_"): name for name in OF_IMPACTS}
    rows = zip(*(payload[name] for name in columns.values()), strict=True)
    rest = {name: value for name, value in payload.items() if name not in OF_IMPACTS}
    show_tables(rest | {"impacts": [dict(zip(columns, row, strict=True)) for row in rows]})
