"""`vibrohil simulate SCENE`: the plant alone."""

import time
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import Change, Json, changed_scene, number
from tools.output import BadInputError, answer, console, figure_table, table_of
from tools.outputs import PICTURES, file_option

LONGEST_S = 86_400.0
LONGEST_PLOT_S = 3600.0
"""Longest simulation with a plot; the plot's samples are 1 ms apart."""


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
    loaded = changed_scene(scene, change)
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
    """Print a summary of the run, without the figures that it does not have, then the last impacts."""
    times, speeds = payload["impacts_t_s"], payload["impacts_v_m_s"]
    electrical = payload["electrical"] or {}
    rows = [
        ("impacts", len(times), ""),
        ("last approach speed", float(speeds[-1]) if len(speeds) else None, "m/s"),
        ("largest approach speed", float(speeds.max()) if len(speeds) else None, "m/s"),
        ("final position", payload["final"]["x_m"], "m"),
        ("final velocity", payload["final"]["v_m_s"], "m/s"),
        ("final phase", payload["final"]["phase"], ""),
        ("energy residual", payload["energy_residual"], "of the energy exchanged"),
        ("peak felt force", payload["peak_felt_force_n"], "N"),
        ("work at the terminals", electrical.get("work_j"), "J"),
        ("copper loss", electrical.get("copper_j"), "J"),
        ("method", payload["method"], ""),
        ("computing", payload["wall_s"], "s"),
    ]
    title = f"{payload['scene']}, {payload['final']['t_s']:g} s"
    console.print(figure_table(title, (row for row in rows if row[1] is not None)))
    if len(times):
        impacts = zip(times, speeds, payload["impulses_n_s"], payload["peak_forces_n"], strict=True)
        last = (
            (f"{t_s:.6f}", f"{speed:.4f}", f"{impulse:.4f}", "—" if isnan(peak) else f"{peak:.1f}")
            for t_s, speed, impulse, peak in list(impacts)[-5:]
        )
        names = (">time [s]", ">v⁻ [m/s]", ">impulse [N s]", ">peak force [N]")
        console.print(table_of(names, last, title="last impacts"))
    for note in payload["notes"]:
        console.print(f"note: {note}", markup=False)
