"""`vibrohil export-fmu NAME`: the plant or the firmware for other simulation programs."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from tools.commands.options import Change, Json, ParameterFiles, load_changed_scene
from tools.commands.places import file_option
from tools.output import BadInputError, answer, console

if TYPE_CHECKING:
    from tools.fmu.build import Model

Part = Literal["plant", "plant-node", "firmware"]
ROLES = ("input", "output", "fixed", "tunable")


def export_fmu(
    name: Annotated[
        str,
        typer.Argument(
            help="A scene, or for the firmware and the plant's node a scenario, by its name or its TOML file."
        ),
    ],
    out: Annotated[Path, file_option("The FMU to write.", (".fmu",))],
    of: Annotated[
        Part,
        typer.Option(
            help="The scene's plant, or with CAN frames in and out the scenario's plant (`plant-node`) or "
            "its firmware."
        ),
    ] = "plant",
    fmi: Annotated[Literal["2", "3"], typer.Option(help="Version of FMI.")] = "2",
    seed: Annotated[int, typer.Option(help="Seed of the sensors' noise and of a walk's strides.", min=0)] = 1,
    change: Change = None,
    parameters: ParameterFiles = None,
    as_json: Json = False,
) -> None:
    """Write the plant or the firmware as an FMU (co-simulation, x86-64 Linux), which needs no Python."""
    started = time.perf_counter()
    from tools.fmu.build import export  # imports numba, so after the checks of the input

    model = model_of(of, name, seed, change or [], parameters or [])
    export(model, 2 if fmi == "2" else 3, out)
    names = {role: [one.name for one in model.variables if one.role == role] for role in ROLES}
    payload = {
        "of": of,
        "scene" if of == "plant" else "scenario": name,
        "fmu": str(out),
        "fmi": int(fmi),
        "bytes": out.stat().st_size,
        "seed": seed,
        **names,
    }
    payload["wall_s"] = time.perf_counter() - started
    counts = ", ".join(f"{len(names[role])} {role}" for role in ROLES)
    answer(payload, as_json, lambda: console.print(f"written: {out} (variables: {counts})", markup=False))


def model_of(of: Part, name: str, seed: int, changes: Sequence[str], parameters: Sequence[Path]) -> "Model":
    """What is exported. Raises SceneError, ScenarioError, FmuError or BadInputError."""
    if of != "plant":
        from hil.scenario.scenario import load_scenario
        from tools.fmu.firmware import FirmwareModel
        from tools.fmu.plant_node import PlantNodeModel

        scenario = load_scenario(name, changes, parameters)
        if of == "firmware":
            return FirmwareModel(scenario.parameters)
        return PlantNodeModel(scenario.scene, seed, scenario.period_s)
    if parameters:
        raise BadInputError("--parameters are the firmware's; with them choose --of firmware")
    from tools.fmu.plant import PlantModel

    return PlantModel(load_changed_scene(name, changes), seed)
