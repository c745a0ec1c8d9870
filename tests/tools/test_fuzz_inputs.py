"""Damaged input does no harm at the command line, and the fuzzers find what does."""

import json
from pathlib import Path

import numpy as np
import pytest

from tools import cli
from tools.fuzz import inputs as fuzz_inputs


@pytest.mark.parametrize(("kind", "count"), [("files", 20), ("scenes", 30)])
def test_damaged_input_ends_in_a_verdict_or_a_sentence(
    kind: str, count: int, capsys: pytest.CaptureFixture[str]
) -> None:
    status = cli.run(["fuzz", kind, "--count", str(count), "--seed", "7", "--json"])
    outcome = json.loads(capsys.readouterr().out)
    assert outcome["failures"] == []
    assert status == 0
    assert outcome["inputs"] == count == sum(outcome["statuses"].values())
    assert outcome["statuses"]["4"] > 3


def wrong(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, broken: object) -> str:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli, "run", broken)
    return fuzz_inputs.attempt("scenes", 1, tmp_path)[2]


def test_an_exception_a_wrong_status_and_a_changed_file_are_found(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def raising(_: list[str]) -> int:
        raise ZeroDivisionError("planted")

    def touching(_: list[str]) -> int:
        Path("../mine/notes.txt").write_text("touched")
        return 0

    assert wrong(monkeypatch, tmp_path, raising) == "ZeroDivisionError: planted"
    assert "changed" in wrong(monkeypatch, tmp_path, touching)
    assert wrong(monkeypatch, tmp_path, lambda _: 3) == "exit status 3"
    assert wrong(monkeypatch, tmp_path, lambda _: 4) == ""


def test_a_seed_repeats_its_damage_and_seeds_differ() -> None:
    content = bytes(range(256)) * 8
    damage = [fuzz_inputs.damaged_bytes(np.random.default_rng(seed), content) for seed in range(200)]
    assert damage == [fuzz_inputs.damaged_bytes(np.random.default_rng(seed), content) for seed in range(200)]
    assert len(set(damage)) > 150
    assert any(len(one) < len(content) for one in damage)
    assert any(len(one) > len(content) for one in damage)
