"""Inputs of `fuzz scenes`: a user's TOML files and command lines.

A case writes its files to `mine`, the user's folder, and returns a command line that is run in the folder
`work` beside it. `good` contains the valid inputs that `prepare` has made.
"""

import os
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

import tomli_w

from firmware_py.interface.parameter_table import TABLE
from fuzzing.damage import NASTY, RAW_VALUES, Random, damaged_bytes, damaged_tables, other_value
from hil.scenario.files import read_scenario, scenario_names
from plant_sim.scene import read_scene, scene_names

One = TypeVar("One")

SHORT_RUN: dict[str, Any] = {
    "title": "A short start",
    "scene": "table1-motor-soft",
    "script": {"duration_s": 0.3, "commands": [{"at_s": 0.1, "request": "run", "target_ratio": 1.1}]},
    "checks": [{"name": "fault", "equals": "none"}],
}
PARAMETERS = {
    "format": 1,
    "parameters": {
        "speed.gain_p_n_m_s": {"value": 0.02, "unit": "N m s"},
        "start.rise_s": {"value": 4.0, "unit": "s"},
    },
}
USERS_OWN = ("notes.txt", "scenario.toml", "notes.log", "report.html", "mine.rrd", "mine.toml")
"""The user's files in the folder where commands run; no command may change them."""
SETTABLE = ("law", "model", "method")
"""Keys that get only invalid values; a valid value would select other kernels, which take long to compile."""
BOMB = "bomb.gz"
"""Name of a file of three megabytes that unpack to three gigabytes."""
LONGEST_RUN_S = 0.4
"""Longest duration of a scenario that is still valid after damage, so that no case waits for a long run."""


def chosen(random: Random, among: Sequence[One]) -> One:
    """Return an element of a sequence with its type unchanged; NumPy's `choice` may convert it to text."""
    return among[int(random.integers(0, len(among)))]


def written(path: Path, tables: dict[str, Any]) -> Path:
    """Write the tables as a TOML file and return its path."""
    path.write_text(tomli_w.dumps(tables), encoding="utf-8")
    return path


# --- the plant alone ----------------------------------------------------------------------------------


def scene_tables(random: Random, mine: Path, _: Path) -> list[str]:
    """Simulate a scene with values replaced, renamed or removed."""
    path = written(mine / "mine.toml", damaged_tables(random, read_scene(chosen(random, scene_names()))))
    return ["simulate", str(path), "--until", "0.2"]


def scene_bytes(random: Random, mine: Path, _: Path) -> list[str]:
    """Simulate a scene's file with damaged bytes."""
    path = written(mine / "mine.toml", read_scene(chosen(random, scene_names())))
    path.write_bytes(damaged_bytes(random, path.read_bytes()))
    return ["simulate", str(path), "--until", "0.2"]


def scene_setting(random: Random, _: Path, __: Path) -> list[str]:
    """Simulate a scene with a damaged value for --set or --until."""
    name = chosen(random, scene_names())
    until = (
        "0.2" if random.random() < 0.9 else str(chosen(random, ("1e308", "nan", "-1", "0", "", "9" * 400)))
    )
    return ["simulate", name, f"--until={until}", "--set", setting(random, {"scene": read_scene(name)})]


def setting(random: Random, tables: dict[str, Any]) -> str:
    """Return a --set of one value, mostly implausible."""
    keys: list[str] = []
    table: Any = tables
    while isinstance(table, dict) and table:
        keys.append(chosen(random, sorted(table)))
        table = table[keys[-1]]
    if random.random() < 0.2 or keys[-1] in SETTABLE:
        keys[-1] = chosen(random, ("", "x" * 3000, "a.b.c.d.e.f.g.h.i", "law"))
        return ".".join(keys) + "=x"
    if random.random() < 0.5:
        return f"{'.'.join(keys)}={chosen(random, RAW_VALUES)}"
    return f"{'.'.join(keys)}={other_value(random, table)}"


# --- runs ---------------------------------------------------------------------------------------------


def lockstep(random: Random, scenario: str, *more: str) -> list[str]:
    """Return a run of a scenario in lockstep, on one of two builds."""
    build = chosen(random, ("python", "compiled"))
    return ["run", scenario, "--clock", "lockstep", "--firmware", build, *more]


def scenario_tables(random: Random, mine: Path, _: Path) -> list[str]:
    """Run a scenario of the library or a short one with values replaced, renamed or removed."""
    tables = read_scenario(chosen(random, scenario_names())) if random.random() < 0.5 else dict(SHORT_RUN)
    damaged = shortened(damaged_tables(random, tables))
    return lockstep(random, str(written(mine / "mine.toml", damaged)), "--out", "run")


def shortened(tables: dict[str, Any]) -> dict[str, Any]:
    """Shorten a scenario that can still be run to LONGEST_RUN_S; other damage stays as it is."""
    script = tables.get("script")
    duration_s = script.get("duration_s") if isinstance(script, dict) else None
    if isinstance(script, dict) and isinstance(duration_s, float) and duration_s > LONGEST_RUN_S:
        script["duration_s"] = LONGEST_RUN_S
        for name in ("commands", "faults"):
            if isinstance(script.get(name), list):
                script[name] = [one for one in script[name] if comes_early(one)]
    return tables


def comes_early(line: Any) -> bool:
    """Return whether a line of a script is kept in a shortened run: if it is early enough or damaged."""
    at_s = line.get("at_s") if isinstance(line, dict) else None
    return not isinstance(at_s, float) or not at_s >= LONGEST_RUN_S


def scenario_bytes(random: Random, mine: Path, _: Path) -> list[str]:
    """Run a scenario's file with damaged bytes."""
    path = written(mine / "mine.toml", SHORT_RUN)
    path.write_bytes(damaged_bytes(random, path.read_bytes()))
    return lockstep(random, str(path), "--out", "run")


def run_setting(random: Random, _: Path, good: Path) -> list[str]:
    """Run a scenario with a damaged --set of a firmware parameter, a script's value or a scene's value."""
    firmware = {one.name: one.default for one in TABLE}
    tables = {"firmware": firmware, "script": SHORT_RUN["script"], "scene": read_scene(SHORT_RUN["scene"])}
    which = chosen(random, sorted(tables))
    changed = setting(random, {which: tables[which]})
    return lockstep(random, str(good / "short.toml"), "--out", "run", "--set", changed)


def parameter_file(random: Random, mine: Path, good: Path) -> list[str]:
    """Use a damaged parameter file for a run, alone or with a valid one."""
    path = written(mine / "mine.toml", PARAMETERS)
    if random.random() < 0.5:
        path.write_bytes(damaged_bytes(random, path.read_bytes()))
    else:
        names = [one.name for one in TABLE]
        entry = {"value": chosen(random, NASTY), "unit": chosen(random, ("s", "N m s", "", 1))}
        written(path, damaged_tables(random, {**PARAMETERS, "parameters": {chosen(random, names): entry}}))
    files = ["--parameters", str(path)]
    if random.random() < 0.5:
        files += ["--parameters", str(written(mine / "other.toml", PARAMETERS))]
    return lockstep(random, str(good / "short.toml"), "--out", "run", *files)


# --- places -------------------------------------------------------------------------------------------


def special_file(random: Random, mine: Path, good: Path) -> list[str]:
    """Give any command that reads a file a special file, a file of another kind, or a missing path."""
    endings = (".toml", ".toml", ".rrd", ".log", ".log.gz", ".asc", ".blf", ".trc", ".mf4", "")
    path = mine / f"mine{chosen(random, endings)}"
    makers: tuple[Callable[[Path], object], ...] = (*IMPLAUSIBLE, partial(shutil.copyfile, good / BOMB))
    make = chosen(random, makers)
    make(path)
    given = chosen(random, MISSING) if make is missing else str(path)
    commands = (
        ["simulate", given, "--until", "0.2"],
        ["run", given, "--clock", "lockstep", "--out", "run"],
        ["run", SHORT_RUN["scene"], "--clock", "lockstep", "--out", "run", "--parameters", given],
        ["tune", "identify", given],
        ["import", given, "--out", "imported"],
        ["inspect", given],
        ["compare", given, given],
        ["view", given],
        ["export", given, "--to", "csv", "--out", "exported"],
        ["runs", given],
        ["suite", given, "--out", "suite"],
        ["plant", given, "--until", "0.1", "--bus", "local"],
    )
    return chosen(random, commands)


def missing(_: Path) -> None:
    """Make no file."""


def nested(path: Path) -> None:
    """Write TOML that is nested 100,000 deep."""
    path.write_text("a = " + "[" * 100_000 + "]" * 100_000)


def endless(path: Path) -> None:
    """Make a link to an endless device."""
    path.symlink_to("/dev/zero")


def large(path: Path) -> None:
    """Make a sparse file of three gigabytes of zeros."""
    path.touch()
    os.truncate(path, 3 << 30)


def forbidden(path: Path) -> None:
    """Make a file that only root may read."""
    path.write_text("title = 1\n")
    path.chmod(0)


def circle(path: Path) -> None:
    """Make a link to itself."""
    path.symlink_to(path.name)


IMPLAUSIBLE: tuple[Callable[[Path], object], ...] = (
    *(missing, os.mkfifo, nested, endless, large, forbidden, circle, Path.mkdir, Path.touch),
)
MISSING = (
    "",
    "nowhere.toml",
    "nowhere/at.rrd",
    "x" * 300,
    "\udcff.log",
    "a\nb",
    "-",
    "/",
    "/proc/self/mem",
    "~",
)


def output_place(random: Random, _: Path, good: Path) -> list[str]:
    """Write to places that are the user's own, of another kind, missing or not writable."""
    folders = (".", "notes.txt", "missing/a/b", "/proc/nowhere", "/dev/full", "", "x" * 300, "work\n", "..")
    pictures = (
        "mine.rrd",
        "missing/a.svg",
        "a.xyz",
        "a",
        "/dev/full",
        "/proc/a.svg",
        "notes.txt",
        ".",
        "a.png",
    )
    folder, picture = chosen(random, folders), chosen(random, pictures)
    short, run = str(good / "short.toml"), str(good / "run")
    commands = (
        ["run", short, "--clock", "lockstep", "--out", folder],
        ["suite", short, "--out", folder],
        ["suite", short, short, "--out", "suite"],
        ["import", str(good / "bench.log"), "--out", folder],
        ["inspect", run, "--plot", picture],
        ["inspect", run, "--table", "plant", "--to", picture],
        [
            "inspect",
            run,
            "--plot",
            "a.svg",
            "--signal",
            chosen(random, ("plant.x_m", "x", "", "plant.", ".")),
        ],
        ["compare", run, run, "--out", picture],
        ["export", run, "--to", "csv", "--out", folder],
        ["simulate", SHORT_RUN["scene"], "--until", "0.1", "--plot", picture],
    )
    return chosen(random, commands)
