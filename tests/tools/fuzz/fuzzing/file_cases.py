"""Inputs of `fuzz files`: CAN logs of every format, and the logs, traces and whole folders of runs.

`prepare` makes valid inputs in `good`. A case damages copies of them in `mine` and returns a command that
reads them.
"""

import contextlib
import gzip
import io
import shutil
from pathlib import Path

import can
import tomli_w

from fuzzing.damage import Random, damaged_bytes
from fuzzing.scene_cases import PARAMETERS, SHORT_RUN, chosen
from hil.record.candump import parse_candump

WRITERS = ("log", "asc", "blf", "trc")
PACKED = ("log.gz", "asc.gz", "trc.gz")
"""Formats of python-can that `import` reads; text formats also compressed."""
OWN_NOTES = "notes.txt"
"""Name of a user's file in a run's folder."""


# --- valid inputs -------------------------------------------------------------------------------------


def prepare(good: Path) -> None:
    """Make a short scenario, its run, a suite of it, and the run's CAN log in every format.

    Kernels that are not compiled yet are compiled here, where no time is limited.
    """
    from tools.cli import run

    (good / "short.toml").write_text(tomli_w.dumps(SHORT_RUN))
    (good / "parameters.toml").write_text(tomli_w.dumps(PARAMETERS))
    short = str(good / "short.toml")
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        run(["run", short, "--clock", "lockstep", "--keep-traces", "--out", str(good / "run")])
        run(["suite", short, "--jobs", "1", "--out", str(good / "suite")])
        for scene in ("table1-viscous", "table1-motor-soft"):
            run(["simulate", scene, "--until", "0.01"])
    (good / "run" / OWN_NOTES).write_text("not to be touched")
    bus = parse_candump((good / "run" / "can.log").read_bytes())
    for ending in WRITERS:
        with can.Logger(good / f"bench.{ending}") as logger:
            for t_s, can_id, payload in zip(bus.t_s.tolist(), bus.can_id.tolist(), bus.payloads, strict=True):
                logger(
                    can.Message(
                        timestamp=t_s + 1e9,
                        arbitration_id=can_id,
                        data=payload,
                        is_extended_id=False,
                        channel=0,
                    )
                )
    for ending in PACKED:
        plain = good / f"bench.{ending.removesuffix('.gz')}"
        (good / f"bench.{ending}").write_bytes(gzip.compress(plain.read_bytes()))


# --- cases --------------------------------------------------------------------------------------------


def can_log(random: Random, mine: Path, good: Path) -> list[str]:
    """Damage the bytes of a CAN log; a compressed log is damaged before or after its compression."""
    ending = chosen(random, WRITERS + PACKED)
    log = mine / f"bench.{ending}"
    content = (good / log.name).read_bytes()
    if ending in PACKED and random.random() < 0.7:
        log.write_bytes(gzip.compress(damaged_bytes(random, gzip.decompress(content)), 1))
    else:
        log.write_bytes(damaged_bytes(random, content))
    commands = (
        ["import", str(log), "--out", "imported"],
        ["import", str(log), "--out", "imported", "--tolerant"],
        ["import", str(log), "--out", "imported", "--json"],
        ["import", str(log), "--out", "imported", "--channel", "can0"],
        ["tune", "identify", str(log)],
        ["replay", str(log)],
    )
    return chosen(random, commands)


def reading(random: Random, run: Path, good: Path) -> list[str]:
    """Return a command that reads a run's folder or log."""
    commands = (
        ["inspect", str(run), "--json"],
        ["inspect", str(run)],
        ["inspect", str(run), "--table", chosen(random, ("plant", "firmware", "can/Accelerometer"))],
        ["inspect", str(run), "--plot", "signals.svg"],
        ["compare", str(run), str(good / "run")],
        ["compare", str(good / "run"), str(run), "--must-be-equal"],
        ["compare", str(run), str(run), "--out", "both.rrd"],
        ["export", str(run), "--to", chosen(random, ("csv", "parquet", "mcap")), "--out", "exported"],
        ["tune", "identify", str(run)],
        ["view", str(run)],
        ["why", str(run)],
        ["replay", str(run)],
    )
    return chosen(random, commands)


def recording(random: Random, mine: Path, good: Path) -> list[str]:
    """Damage a .rrd file outside of a run's folder."""
    log = mine / "run.rrd"
    log.write_bytes(damaged_bytes(random, (good / "run" / "run.rrd").read_bytes()))
    return reading(random, log, good)


def traces(random: Random, mine: Path, good: Path) -> list[str]:
    """Damage or remove one to three traces in a run's folder without its log."""
    run = mine / "run"
    shutil.copytree(good / "run", run)
    (run / "run.rrd").unlink()
    names = sorted(path.name for path in run.glob("*.trace"))
    damage_some(random, run, names)
    return reading(random, run, good)


def run_folder(random: Random, mine: Path, good: Path) -> list[str]:
    """Damage or remove one to three files of a run's folder; a new run may also write to this folder."""
    run = mine / "run"
    shutil.copytree(good / "run", run)
    damage_some(random, run, sorted(path.name for path in run.iterdir() if path.name != OWN_NOTES))
    commands = (
        ["import", str(run / "can.log"), "--out", "imported"],
        ["runs", str(mine)],
        ["runs", str(mine), "--prune", "0d"],
        ["runs", str(mine), "--where", "passed=false", "--json"],
        ["run", str(good / "short.toml"), "--clock", "lockstep", "--firmware", "compiled", "--out", str(run)],
        ["run", str(run / "scenario.toml"), "--clock", "lockstep", "--out", "run"],
    )
    return chosen(random, commands) if random.random() < 0.3 else reading(random, run, good)


def suite_folder(random: Random, mine: Path, good: Path) -> list[str]:
    """Damage or remove one to three files of a suite's folder."""
    suite = mine / "run"
    shutil.copytree(good / "suite", suite)
    damage_some(
        random, suite, sorted(str(path.relative_to(suite)) for path in suite.rglob("*") if path.is_file())
    )
    commands = (
        ["compare", str(suite), str(good / "suite")],
        ["compare", str(good / "suite"), str(suite), "--json"],
        ["runs", str(suite)],
    )
    return chosen(random, commands)


def damage_some(random: Random, folder: Path, names: list[str]) -> None:
    """Damage or remove one to three of the files."""
    count = min(len(names), int(random.integers(1, 4)))
    for name in random.choice(names, count, replace=False).tolist():
        path = folder / name
        if random.random() < 0.15:
            path.unlink()
        else:
            path.write_bytes(damaged_bytes(random, path.read_bytes()))
