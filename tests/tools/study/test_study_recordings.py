"""Moving pictures of studies: what is in the files is what the studies have found."""

from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet
from rerun.chunk import RrdReader

from hil.bench.recorded_run import log_of
from hil.record.rerun_program import rerun
from tools.study import portraits, recordings, work
from tools.study.cases import case
from tools.study.sweep import diagrams


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    chosen = [case("table1", "viscous"), case("table1", "coulomb", 0.3)]
    return diagrams(chosen, work.here(tmp_path_factory.mktemp("swept"), cores=1), 12)


def columns(path: Path, entity: str, component: str) -> list:
    """The values of one component over all rows of an entity that move."""
    values = []
    for chunk in RrdReader(path).stream().to_chunks():
        batch = chunk.to_record_batch()
        if chunk.entity_path == entity and not chunk.is_static and component in batch.schema.names:
            values += batch[component].to_pylist()
    return values


def test_a_sweep_shows_its_orbits_at_every_ratio(found, tmp_path):
    path = tmp_path / "sweep.rrd"
    recordings.sweeps(found, path)
    assert log_of(path) == path, "what vibrohil view opens"
    assert rerun(["rrd", "verify", path]).returncode == 0
    for diagram in found:
        name = recordings.entity(diagram.case)
        for way, sweep in (("run-up", diagram.up), ("run-down", diagram.down)):
            strips = columns(path, f"/{name}/orbits/{way}", "LineStrips2D:strips")
            order = np.argsort(sweep.column("ratio"))
            assert len(strips) == len(order)
            for row, strip in zip(order, strips, strict=True):
                across = np.array(strip[0])[:, 0]
                reaches_stop = sweep.column("impacts")[row] > 0.0
                assert across.max() <= 1.0 + 1e-6
                assert (across.max() > 1.0 - 1e-6) == reaches_stop, (
                    "orbits reach the stop where there are impacts"
                )
            speeds = columns(path, f"/{name}/speeds/{way}", "Scalars:scalars")
            np.testing.assert_allclose(np.ravel(speeds), sweep.column("v_max_m_s")[order])


def test_a_portrait_runs_along_its_orbit(found, tmp_path):
    pairs = [portraits.pair(diagram) for diagram in found]
    path = tmp_path / "portrait.rrd"
    recordings.portraits(pairs, path)
    assert rerun(["rrd", "verify", path]).returncode == 0
    for both in pairs:
        for kind, motion in (("impact", both.impact), ("non-impact", both.non_impact)):
            name = f"/{recordings.entity(both.case)}/{kind}/striker"
            points = np.array(columns(path, name, "Points2D:positions")).reshape(-1, 2)
            if motion is None:
                assert len(points) == 0
                continue
            assert len(points) == pytest.approx(motion.t_s[-1] / recordings.FRAME_S, abs=1.0)
            assert bool(points[:, 0].max() > 0.97) == motion.reaches_stop
    assert pairs[0].impact is not None
    assert pairs[1].impact is None


def test_a_portraits_points_are_kept(found, tmp_path):
    pair = portraits.pair(found[0])
    table = portraits.as_table([pair])
    parquet.write_table(table, tmp_path / "portrait.parquet")
    again = parquet.read_table(tmp_path / "portrait.parquet")
    kinds, motions = (np.array(again[name].to_pylist()) for name in ("kind", "motion"))
    assert set(motions) == {"impact", "non-impact"}
    chosen = (kinds == "sample") & (motions == "impact")
    np.testing.assert_array_equal(again["x_m"].to_numpy()[chosen], pair.impact.x_m)
    assert (kinds == "section").sum() == 2 * portraits.SECTIONS
    assert again["t_s"].null_count == 2 * portraits.SECTIONS
