"""Damaged input does no harm at the command line, and the fuzzers find what does."""

import subprocess
import tempfile
import time
from collections import Counter
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from fuzzing import inputs, worker
from fuzzing.damage import damaged_bytes

from tools import cli


@pytest.mark.parametrize(("kind", "count"), [("files", 20), ("scenes", 30)])
def test_damaged_input_ends_in_a_verdict_or_a_sentence(
    kind: worker.Kind, count: int, pytestconfig: pytest.Config
) -> None:
    """No traceback, at most 20 s and 2 GB, no file changed but its own, no temporary file left."""
    count = pytestconfig.getoption("fuzz_count") or count
    outcome = inputs.fuzz(kind, count, pytestconfig.getoption("fuzz_seed"))
    assert outcome.failures == ()
    assert outcome.inputs == count == sum(outcome.statuses.values()) == sum(outcome.cases.values())
    assert outcome.statuses[4] > 3


@pytest.mark.parametrize("kind", ["files", "scenes"])
def test_every_case_of_a_kind_comes(kind: worker.Kind) -> None:
    came = Counter(worker.case_of(kind, np.random.default_rng(seed))[0] for seed in range(300))
    assert set(came) == set(worker.CASES[kind])


def wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, broken: object) -> str:
    good = tmp_path / "good"
    good.mkdir(exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "run", broken)
    seed = next(n for n in range(99) if "scene, bytes" in worker.case_of("scenes", np.random.default_rng(n)))
    return worker.attempt("scenes", seed, good).wrong


def test_an_exception_a_wrong_status_and_what_is_touched_or_left_are_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def raising(_: list[str]) -> int:
        raise ZeroDivisionError("planted")

    def touching(_: list[str]) -> int:
        Path("report.html").write_text("touched")
        return 0

    def rewriting(_: list[str]) -> int:
        Path("../mine/mine.toml").unlink()
        return 0

    def littering(_: list[str]) -> int:
        tempfile.mkdtemp()
        return 0

    def adding(_: list[str]) -> int:
        Path("../mine/mine.toml.new").touch()
        return 4

    def outdated(_: list[str]) -> int:
        return true_run(["tune", "diff"])

    true_run = cli.run
    started: list[subprocess.Popen[bytes]] = []

    def leaving(_: list[str]) -> int:
        started.append(subprocess.Popen(["sleep", "20"]))
        return 0

    assert wrong(monkeypatch, tmp_path, raising) == "ZeroDivisionError: planted"
    assert "report.html" in wrong(monkeypatch, tmp_path, touching)
    assert "mine.toml" in wrong(monkeypatch, tmp_path, rewriting)
    assert "left behind" in wrong(monkeypatch, tmp_path, littering)
    assert "mine.toml.new" in wrong(monkeypatch, tmp_path, adding)
    assert wrong(monkeypatch, tmp_path, lambda _: 3) == "exit status 3"
    assert wrong(monkeypatch, tmp_path, lambda _: 4) == ""
    assert "No such command 'diff'" in wrong(monkeypatch, tmp_path, outdated)
    monkeypatch.setattr(worker, "GONE_S", 0.1)
    assert "process" in wrong(monkeypatch, tmp_path, leaving)
    for process in started:
        process.kill()
        process.wait()


def busy(pipe: Connection, *_: object) -> None:
    pipe.send(None)
    pipe.recv()
    pipe.send(("planted", ("busy",)))
    while True:
        pass


def compiling(pipe: Connection, _: object, __: object, depth: Any) -> None:
    depth.value = 1
    pipe.send(None)
    pipe.recv()
    pipe.send(("planted", ("compiling",)))
    began_s = time.process_time()
    while time.process_time() < began_s + 1.5:
        pass
    pipe.send(worker.Attempt("planted", ("compiling",), 0, ""))
    time.sleep(60.0)


def asleep(pipe: Connection, *_: object) -> None:
    pipe.send(None)
    pipe.recv()
    pipe.send(("planted", ("asleep",)))
    time.sleep(60.0)


def large(pipe: Connection, *_: object) -> None:
    pipe.send(None)
    pipe.recv()
    pipe.send(("planted", ("large",)))
    content = np.ones(40 << 17)
    del content
    pipe.send(worker.Attempt("planted", ("large",), 0, ""))
    time.sleep(60.0)


@pytest.mark.parametrize(
    ("planted", "said"), [(busy, "did not end"), (asleep, "waited for"), (large, "it took")]
)
def test_what_hangs_or_grows_is_found_from_outside(
    planted: object, said: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(worker, "serve", planted)
    started = worker.Worker("files", tmp_path)
    monkeypatch.setattr(worker, "LONGEST_S", 0.5)
    if planted is large:
        monkeypatch.setattr(worker, "MOST_MEMORY_MB", worker.memory_mb(started.pid) + 30.0)
    try:
        watched = started.run(1)
    finally:
        started.close()
    assert said in watched.attempt.wrong
    assert watched.attempt.case == "planted"


def test_the_time_of_compiling_a_kernel_does_not_count(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(worker, "serve", compiling)
    started = worker.Worker("files", tmp_path)
    monkeypatch.setattr(worker, "LONGEST_S", 0.5)
    try:
        watched = started.run(1)
    finally:
        started.close()
    assert watched.attempt.wrong == ""
    assert watched.spent_s < 0.5


def test_a_seed_repeats_its_damage_and_seeds_differ() -> None:
    content = bytes(range(256)) * 8
    damage = [damaged_bytes(np.random.default_rng(seed), content) for seed in range(200)]
    assert damage == [damaged_bytes(np.random.default_rng(seed), content) for seed in range(200)]
    assert len(set(damage)) > 150
    assert any(len(one) < len(content) for one in damage)
    assert any(len(one) > len(content) for one in damage)


def test_enough_failures_end_it(monkeypatch: pytest.MonkeyPatch) -> None:
    class Failing:
        def __init__(self, *_: object) -> None:
            pass

        def run(self, seed: int) -> worker.Watched:
            return worker.Watched(worker.Attempt("planted", ("view",), 3, "broken"), 0.0, 0.0)

        def close(self) -> None:
            pass

    monkeypatch.setattr(inputs, "Worker", Failing)
    monkeypatch.setattr(inputs, "prepare", lambda _: None)
    assert inputs.fuzz("files", 1000, 5).inputs == inputs.ENOUGH_FAILURES
