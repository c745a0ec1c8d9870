"""Basins with the firmware in the loop: closed loops from chosen starts, judged and kept."""

import json

import numpy as np
import pytest

from plant_sim.scene import load_scene
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, BadInputError
from tools.study import basin, soft_start, store, work
from tools.study.cases import LAWS, case


@pytest.mark.parametrize("law", LAWS)
def test_a_cells_scene_is_the_case_at_its_start(law):
    module = case("table1", law)
    scene = load_scene(soft_start.scene_of(module, 0.1, -0.3, 2.0))
    assert scene.initial.x_m == 0.1
    assert scene.initial.v_m_s == -0.3
    assert scene.drive.phase_rad == 2.0
    assert scene.drive.amplitude_m == module.amplitude_m
    assert scene.friction.law == law
    assert scene.stop.law == "hunt-crossley"
    assert soft_start.nominal_of(module)["friction"] == {"b_n_s_m": module.b_n_s_m, "mu": module.mu}


def test_the_firmware_has_impacts_from_where_an_instant_start_has_none(tmp_path, monkeypatch):
    where = work.here(tmp_path, cores=1)
    found = soft_start.compute(case("table1", "viscous"), 1.3, "state", 3, where)
    assert found.statistics["impact_fraction"] == 1.0
    assert found.statistics["failures"] == {}
    assert 0.0 < found.statistics["instant_fraction"] < 1.0
    assert found.statistics["impact_fraction_wilson"][0] > found.statistics["instant_fraction_wilson"][0]
    np.testing.assert_allclose(found.table["impacts"].to_numpy(), 1.0, atol=0.1)
    y_m, v_m_s = basin.axes(found.case, "state", 3)
    np.testing.assert_allclose(found.table["x_m"].to_numpy()[:3], y_m + found.case.rest_length_m)
    np.testing.assert_allclose(found.table["v_m_s"].to_numpy()[::3], v_m_s)
    kept, _ = store.read(tmp_path / f"{found.name}.parquet")
    assert kept.equals(found.table)

    monkeypatch.setattr(work, "running", None)  # what is there is not computed again
    again = soft_start.compute(case("table1", "viscous"), 1.3, "state", 3, where)
    assert again.table.equals(found.table)


def test_a_cluster_gives_the_same(tmp_path):
    from distributed import LocalCluster

    def found(where):
        return soft_start.compute(case("table1", "viscous"), 1.3, "phase", 2, where).table

    settings = {"n_workers": 1, "dashboard_address": None, "host": "127.0.0.1", "silence_logs": 50}
    with LocalCluster(threads_per_worker=1, **settings) as cluster:
        on_a_cluster = found(work.here(tmp_path / "cluster", None, cluster.scheduler_address))
    assert found(work.here(tmp_path / "here", 1)).equals(on_a_cluster)


def test_without_possible_impacts_no_start_has_any(tmp_path):
    weak = case("table1", "viscous", amplitude_m=0.002)
    found = soft_start.compute(weak, 1.3, "phase", 2, work.here(tmp_path, cores=1))
    assert found.statistics["impact_fraction"] == 0.0
    assert found.statistics["instant_fraction"] == 0.0
    assert sum(found.statistics["failures"].values()) == 4
    assert all("start_failed" in why for why in found.statistics["failures"])


def test_what_the_firmware_would_not_start_is_refused():
    with pytest.raises(BadInputError, match="--preset table1"):
        soft_start.check(case("gait", "viscous"), 1.2)
    for ratio in (0.1, 1.5):
        with pytest.raises(BadInputError, match="--ratio"):
            soft_start.check(case("table1", "viscous"), ratio)


def test_the_command_says_which_start(tmp_path, capsys):
    out = str(tmp_path)
    what = ["--start", "soft", "--plane", "phase", "--size", "2", "--cores", "1"]
    command = ["study", "basin", *what, "--out", out, "--json"]
    assert cli.run(command) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert result["basins"][0]["start"] == "soft"
    assert result["basins"][0]["impact_fraction"] == 1.0
    assert (tmp_path / "basin-table1-viscous-r1.3-phase-soft.svg").exists()
    assert cli.run(["study", "basin", "--start", "slow"]) == EXIT_BAD_INPUT
