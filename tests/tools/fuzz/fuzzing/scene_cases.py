"""Inputs of the kind `scenes`: a user's TOML files and command lines.

A case writes its files to `mine`, the user's folder, and returns a command line that is run in the folder
`work` beside it. `good` contains the valid inputs that `prepare` has made.
"""

from collections.abc import Sequence
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
    if random.random() < 0.2:
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
