"""`vibrohil study branches` and `boundaries`: periodic orbits and where they end."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from tools.commands.options import Change, Json, load_changed_scene
from tools.commands.places import digest, folder_option
from tools.output import BadInputError, answer, console, figure, figure_table, table_of

if TYPE_CHECKING:
    from plant_sim.scene import Scene
    from tools.study.branches.branches import Branch
    from tools.study.branches.impact_map import Orbit

SceneName = Annotated[str, typer.Argument(help="A scene's name or its TOML file; its drive is ideal.")]
OrbitKind = Annotated[
    str,
    typer.Option(
        "--orbit",
        help="n/m: orbits of n turns of the crank with m impacts; 2/1 impacts every second turn. "
        "Several are separated by commas, e.g. 1/1,2/2,2/1.",
    ),
]
Out = Annotated[Path, folder_option("Folder of the figures.")]
MOST_IMPACTS = 8


def branches(
    scene: SceneName = "table1-viscous",
    over: Annotated[
        Literal["ratio", "gap", "mu", "b", "amplitude", "restitution"],
        typer.Option(help="The parameter along which orbits are followed."),
    ] = "ratio",
    orbit: OrbitKind = "1/1",
    change: Change = None,
    out: Out = Path("studies"),
    as_json: Json = False,
) -> None:
    """Follow stable and unstable impact orbits through their folds, and locate where they end."""
    module, kinds = check_scene(scene, change, (over,)), parsed(orbit)
    from tools.study.branches import branches as following
    from tools.study.branches import figures
    from tools.study.branches.parameters import PARAMETERS, value_in

    nominal = value_in(module, over)
    started_s = time.perf_counter()
    found = [branch for kind in kinds for branch in following.branches(module, over, *kind)]
    wall_s = time.perf_counter() - started_s
    name = f"branches-{scene_name(scene, change)}-{over}-{number_kinds(kinds)}"
    payload = {
        "scene": scene,
        "over": over,
        "nominal": nominal,
        "unit": PARAMETERS[over].unit,
        "branches": [branch_json(module, branch) for branch in found],
        "figures": figures.branch_figure(found, nominal, out, name),
        "wall_s": wall_s,
    }
    answer(payload, as_json, lambda: show_branches(payload))


def boundaries(
    scene: SceneName = "table1-viscous",
    over: Annotated[str, typer.Option(help="Two parameters of `branches`, e.g. ratio,mu.")] = "ratio,b",
    orbit: OrbitKind = "1/1",
    change: Change = None,
    out: Out = Path("studies"),
    as_json: Json = False,
) -> None:
    """Follow folds, period doublings and grazing over two parameters; the scene's distance to each."""
    from tools.study.branches.parameters import PARAMETERS, value_in

    names = tuple(over.split(","))
    if len(set(names)) != 2 or not set(names) <= set(PARAMETERS):
        raise BadInputError(
            f"--over is {over!r}: wanted two of {', '.join(PARAMETERS)}, e.g. --over ratio,mu"
        )
    first, second = names
    module, kinds = check_scene(scene, change, names), parsed(orbit)
    from tools.study.branches import boundaries as following
    from tools.study.branches import figures
    from tools.study.branches.branches import branches as branches_of

    started_s = time.perf_counter()
    found = [branch for kind in kinds for branch in branches_of(module, first, *kind)]
    curves = following.boundaries(module, (first, second), found)
    margins = following.margins_on(found, module, first)
    margins += [one for kind in kinds for one in following.margins(module, (second,), *kind)]
    wall_s = time.perf_counter() - started_s
    nominal = value_in(module, first), value_in(module, second)
    name = f"boundaries-{scene_name(scene, change)}-{first}-{second}-{number_kinds(kinds)}"
    pictures = figures.boundary_figure(curves, (first, second), nominal, out, name)
    payload = {
        "scene": scene,
        "over": [first, second],
        "nominal": list(nominal),
        "boundaries": [
            {"kind": curve.kind, "points": [point_json(module, one) for one in curve.orbits]}
            for curve in curves
        ],
        "margins": [margin._asdict() for margin in margins],
        "figures": pictures,
        "wall_s": wall_s,
    }
    answer(payload, as_json)


def check_scene(source: str, change: list[str] | None, over: tuple[str, ...]) -> "Scene":
    """The scene; BadInputError if it has no impact orbits or lacks one of the parameters."""
    scene = load_changed_scene(source, change)
    if scene.drive.model != "ideal":
        raise BadInputError(
            f"{source} has drive.model = {scene.drive.model!r}: branches are orbits of a crank at constant "
            "speed; take a scene with an ideal drive, e.g. table1-viscous"
        )
    if scene.stop.law not in ("rigid", "hunt-crossley"):
        raise BadInputError(
            f"{source} has stop.law = {scene.stop.law!r}: impact orbits need a stop, rigid or hunt-crossley"
        )
    if scene.gait is not None or scene.housing is not None or scene.wearer is not None:
        raise BadInputError(
            f"{source} has a moving housing or a wearer: branches are orbits of the module alone; "
            "delete the tables [housing], [gait] and [wearer]"
        )
    friction = {"mu": ("coulomb", "stribeck"), "b": ("viscous", "coulomb", "stribeck")}
    for name in over:
        if scene.friction.law not in friction.get(name, (scene.friction.law,)):
            raise BadInputError(
                f"--over {name}: {source} has friction.law = {scene.friction.law!r}, which has no {name}; "
                f"wanted one of {', '.join(friction[name])}"
            )
    return scene


def parsed(orbit: str) -> list[tuple[int, int]]:
    """Turns and impacts of the kinds of orbits in `--orbit`."""
    kinds = []
    for kind in orbit.split(","):
        turns, _, impacts = kind.partition("/")
        if not (turns.isdecimal() and impacts.isdecimal()) or not (
            1 <= int(turns) <= MOST_IMPACTS and 1 <= int(impacts) <= MOST_IMPACTS
        ):
            raise BadInputError(
                f"--orbit has {kind!r}: wanted n/m with n turns and m impacts, each 1 to {MOST_IMPACTS}, "
                "e.g. 2/1"
            )
        kinds.append((int(turns), int(impacts)))
    return kinds


def scene_name(source: str, change: list[str] | None) -> str:
    """A scene in the name of a file; with a digest of its file's path and of its changes, if it has some."""
    own = [source] if source.endswith(".toml") else []
    return Path(source).stem + digest([*own, *(change or [])])


def number_kinds(kinds: list[tuple[int, int]]) -> str:
    """Kinds of orbits in the name of a file."""
    return "-".join(f"{turns}-{impacts}" for turns, impacts in kinds)


def point_json(scene: "Scene", orbit: "Orbit") -> dict[str, Any]:
    """An orbit as JSON; `v_m_s` is the v⁻ of its fastest impact, complex multipliers are [re, im]."""
    from tools.study.branches.parameters import value_in

    return {
        "ratio": value_in(scene, "ratio"),
        **orbit.values,
        "v_m_s": float(max(orbit.v_m_s)),
        "multipliers": [
            float(one.real) if one.imag == 0.0 else [float(one.real), float(one.imag)]
            for one in orbit.multipliers
        ],
        "stable": orbit.is_stable,
        "impacts": [
            {"crank_rad": float(crank), "v_m_s": float(v)}
            for crank, v in zip(orbit.crank_rad, orbit.v_m_s, strict=True)
        ],
    }


def branch_json(scene: "Scene", branch: "Branch") -> dict[str, Any]:
    """A branch as a JSON object."""
    return {
        "turns": branch.turns,
        "impacts": branch.impacts,
        "points": [point_json(scene, orbit) for orbit in branch.orbits],
        "special": [
            {"kind": one.kind, "ends": one.ends, **point_json(scene, one.orbit)} for one in branch.special
        ],
        "operating": [point_json(scene, orbit) for orbit in branch.operating],
    }


def show_branches(payload: dict[str, Any]) -> None:
    """Print the special points and the orbits at the scene's own value."""
    over, rows = payload["over"], []
    for branch in payload["branches"]:
        named = [(one["kind"], one) for one in branch["special"]]
        named += [
            ("the scene's, " + ("stable" if one["stable"] else "unstable"), one)
            for one in branch["operating"]
        ]
        for what, one in named:
            sizes = ", ".join(
                figure(abs(complex(*m) if isinstance(m, list) else m)) for m in one["multipliers"]
            )
            rows.append(
                (
                    f"{branch['turns']}/{branch['impacts']}",
                    what,
                    f"{one[over]:.9f}",
                    f"{one['v_m_s']:z.6f}",
                    sizes,
                )
            )
    columns = ("orbit", "point", f">{over} {payload['unit']}".rstrip(), ">v⁻ m/s", ">|multipliers|")
    console.print(table_of(columns, rows, title=f"{payload['scene']}: impact orbits over {over}"))
    if not rows:
        console.print("no simulation settled on such an orbit; try another --orbit or --over")
    console.print(figure_table("", [("figure", payload["figures"][0], "")]))
