"""The costs of a scene's parts: what is compared with what, and that it says so."""

import json

import pytest

from plant_sim.parts.housing import Level
from plant_sim.parts.wearer import NoWearer
from tools import cli
from tools.trade.parts import PARTS, figures_of, scene_with


def test_each_part_is_the_only_change() -> None:
    first = scene_with({}).parts()
    assert isinstance(first.housing, Level)
    assert isinstance(first.wearer, NoWearer)
    for name, changes in PARTS[1:]:
        scene = scene_with(changes)
        differences = [
            kind
            for kind, ours, theirs in zip(first._fields, scene.parts(), first, strict=True)
            if ours != theirs
        ]
        if scene.sensors is not None:
            assert differences == []
        elif scene.housing is not None:  # a tilt takes weight off the guide
            assert "housing" in differences
        elif scene.drive.model == "dq-motor":
            assert differences == ["drive", "winding"]
        else:
            assert len(differences) == 1, name


def test_figures_of_the_orbit() -> None:
    """v⁻ = 0.91 m/s and 247 N at r = 1.3, the fold between 1.35 and 1.45; pad and friction take the work."""
    figures = figures_of(scene_with({}))
    assert figures["impacts_per_period"] == 1.0
    assert figures["impulse_n_s"] == pytest.approx(1.066, abs=1e-3)
    assert figures["peak_force_n"] == pytest.approx(247.0, abs=2.0)
    assert 1.35 <= figures["fold_r"] <= 1.45
    lost_in_impact_j = 0.5 * 0.8 * 0.91**2 * (1.0 - 0.5**2)
    assert lost_in_impact_j < figures["energy_per_cycle_j"] < 1.4 * lost_in_impact_j


def test_the_command_prints_json(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["trade", "parts", "--quick", "--json"]) == 0
    payload = json.loads(capsys.readouterr().out)
    first, *others = payload["rows"]
    assert first["cost_ratio"] == 1.0
    assert first["error"] == 0.0
    assert len(others) == 2
    for row in payload["rows"]:
        assert row["kind"] == "part"
        assert row["cost"] > 0.0
        assert row["impulse_n_s"] > 0.5
        assert row["peak_felt_force_n"] is None
