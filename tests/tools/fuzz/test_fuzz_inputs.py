"""Damaged input does no harm at the command line, and the fuzzer finds what does."""

import subprocess
import tempfile
import time
from collections.abc import Callable, Iterable
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest
import watched
from fuzzing import file_cases, inputs
from fuzzing.damage import damaged_bytes

from tools import cli


@pytest.mark.parametrize(("kind", "count"), [("files", 20), ("scenes", 30)])
def test_damaged_input_ends_in_a_verdict_or_a_sentence(
    kind: inputs.Kind, count: int, pytestconfig: pytest.Config
) -> None:
    """No traceback, at most 20 s and 1.5 GB, no file changed but its own, no temporary file left.

    With `-s` the largest time and memory of each format are printed.
    """
    count = pytestconfig.getoption("fuzz_count") or count
    attempts = inputs.fuzz(kind, count, pytestconfig.getoption("fuzz_seed"))
    print("", *inputs.worst_by_format(attempts), sep="\n")
    assert [one for one in attempts if one.wrong] == []
    assert len(attempts) == count
    assert sum(one.status == 4 for one in attempts) > 3


def burn(seconds: float) -> int:
    began_s = time.process_time()
    while time.process_time() < began_s + seconds:
        pass
    return 0


def wait() -> int:
    time.sleep(60.0)
    return 0


def write(place: str) -> int:
    Path(place).write_text("touched")
    return 0


def remove() -> int:
    Path("../mine/mine.toml").unlink()
    return 0


def litter() -> int:
    return 0 * len(tempfile.mkdtemp())


def grow() -> int:
    return 0 * np.ones(80 << 17).size


PLANTED: tuple[tuple[Callable[[], int], str], ...] = (
    (lambda: 3, "exit status 3"),
    (lambda: 4, ""),
    (lambda: write("report.html"), "report.html"),
    (lambda: write("../mine/mine.toml.new"), "mine.toml.new"),
    (lambda: write("../../elsewhere"), "elsewhere"),
    (remove, "mine.toml"),
    (litter, "left behind"),
    (lambda: true_run(["tune", "diff"]), "No such command 'diff'"),
    (lambda: subprocess.call(["true"]), "subprocess.Popen"),
    (lambda: burn(9.0), "the process died (exit code -27)"),
    (wait, "the process died (exit code -14)"),
    (grow, "it took"),
)
"""What a command does instead of its work, by the seed, and what is found wrong in it."""


def planted_case(_: object, mine: Path, __: Path) -> list[str]:
    (mine / "mine.toml").touch()
    return ["planted"]


def serve(pipe: Connection, kind: inputs.Kind, seeds: Iterable[int], good: Path) -> None:
    """Serve with what is planted, and with limits that are soon reached."""
    inputs.case_of = lambda *_: ("planted", planted_case)
    inputs.MOST_BYTES = watched.peak_bytes() + (40 << 20)
    watched.LIMIT_S = 0.5
    for seed in seeds:
        watched.LIMIT_OF_WAITING_S = 1 if PLANTED[seed][0] is wait else 300
        cli.run = lambda _, planted=PLANTED[seed][0]: planted()
        true_serve(pipe, kind, [seed], good)


true_run, true_serve = cli.run, inputs.serve


def test_what_is_wrong_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(inputs, "serve", serve)
    monkeypatch.setattr(file_cases, "prepare", lambda _: None)
    for one in inputs.fuzz("files", len(PLANTED), 0):
        _, said = PLANTED[one.seed]
        assert said in one.wrong, one
        assert (said == "") == (one.wrong == ""), one


def test_a_seed_repeats_its_damage_and_seeds_differ() -> None:
    content = bytes(range(256)) * 8
    damage, again = (
        [damaged_bytes(np.random.default_rng(seed), content) for seed in range(200)] for _ in "12"
    )
    assert damage == again
    assert len(set(damage)) > 150
