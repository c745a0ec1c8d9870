"""The layout: every field it plots is one that the bench's processes write, and it is legible when opened."""

import subprocess

import numpy as np
import pytest
from PIL import Image
from run_folder import make_run, write_run
from screen import require_screen

from firmware_py.core.inputs import Inputs
from firmware_py.core.state import Outputs, State
from firmware_py.shell.node import Counters
from hil.bus.model.fault_confinement import BusErrorRecord
from hil.nodes.operator.node import OperatorRecord
from hil.record import state_timeline
from hil.record.rrd.rates import SLOW_BLOCKS
from hil.record.rrd.rerun_program import rerun_environment, rerun_program
from hil.record.traces.plant_trace import PlantRecord
from hil.record.traces.trace import flatten
from hil.show import layout
from hil.show.rerun_log import rebuild
from hil.timing.loop import LoopTiming
from plant_sim.result import Impact
from plant_sim.sensors.gait import GaitTruth

WIDTH, HEIGHT = 1280, 800


def columns(*fields):
    return {column.name for name, kind in fields for column in flatten(name, kind)}


WRITTEN = {
    "/plant": columns(("", PlantRecord), ("gait", GaitTruth), ("", LoopTiming)),
    "/firmware": columns(
        ("inputs", Inputs), ("state", State), ("outputs", Outputs), ("counters", Counters), ("", LoopTiming)
    ),
    "/impacts/truth": columns(("", Impact)),
    "/bus_errors": columns(("", BusErrorRecord)),
    "/estimate_error": {"x_m", "v_m_s"},
    "/operator": columns(("", OperatorRecord)),
}


def test_every_field_that_is_plotted_is_written_by_the_bench(monkeypatch):
    plotted = []
    plot = layout.plot

    def collecting(name, *series, **options):
        plotted.extend(series)
        return plot(name, *series, **options)

    monkeypatch.setattr(layout, "plot", collecting)
    highlights = layout.Highlights((0.0, 3.0), (2.0, 5.0))
    all_there_is = layout.Contents(worn=True, judged=True, failed=True, injected=True, bus_errors=True)
    layout.layout(highlights, all_there_is)
    assert not any(getattr(item, "field", "") == "gait.phase" for item in plotted)
    layout.layout(highlights, all_there_is._replace(walked=True))

    fields = [(item.entity, item.field) for item in plotted if not isinstance(item, layout.Whole)]
    fields += [
        (item.entity, item.variance) for item in plotted if isinstance(item, layout.Line) and item.variance
    ]
    assert len(fields) > 40
    assert ("/plant", "felt_force_n") in fields
    assert ("/plant", "gait.phase") in fields
    for entity, field in fields:
        if field is not None:
            assert field in WRITTEN[entity], f"{entity} has no {field}"


@pytest.mark.parametrize("block", SLOW_BLOCKS)
def test_every_slow_block_is_written_by_the_bench(block):
    trace, _, name = block.partition(".")
    assert any(f"{column}.".startswith(f"{name}.") for column in WRITTEN[f"/{trace}"])


def test_every_lane_is_written_by_the_bench():
    assert {timeline.column for timeline in state_timeline.PLANT_TIMELINES} <= WRITTEN["/plant"]
    assert {timeline.column for timeline in state_timeline.FIRMWARE_TIMELINES} <= WRITTEN["/firmware"]
    assert state_timeline.LEG_TIMELINE.column in WRITTEN["/plant"]
    assert state_timeline.LEG_ESTIMATED_TIMELINE.column in WRITTEN["/firmware"]


def test_a_state_that_has_no_name_is_shown_by_its_number():
    assert state_timeline.state_name(state_timeline.PLANT_TIMELINES[0].states, 17) == "unknown 17"


def near(picture, rgba, tolerance=40):
    """How many pixels have about this colour."""
    color = np.array([rgba >> 24, rgba >> 16 & 255, rgba >> 8 & 255])
    return int(np.count_nonzero((np.abs(picture - color) < tolerance).all(axis=-1)))


@pytest.mark.quiet
def test_the_overview_shows_truth_estimate_stop_and_modes(tmp_path):
    """Rendered as a user sees it, without a display: plots, state timelines and the picture are there.

    The viewer takes its picture after a number of images, on a busy machine before it has read the log.
    """
    require_screen()
    made_up = make_run()
    made_up.scenario["checks"] = [{"name": "peak_force_n", "high": 1.0}]
    log = rebuild(write_run(made_up, tmp_path))
    picture_path = tmp_path / "overview.png"
    viewer = [rerun_program(), log, "--screenshot-to", picture_path, "--window-size", f"{WIDTH}x{HEIGHT}"]
    quiet = {**rerun_environment(), "RUST_LOG": "error"}
    display = ["xvfb-run", "-a", "-s", f"-screen 0 {WIDTH}x{HEIGHT}x24"]
    loopback = ["--bind", "127.0.0.1", "--port", "auto", "--renderer", "vulkan"]
    outcome = subprocess.run(
        [*display, *viewer, *loopback], env=quiet, capture_output=True, text=True, timeout=120.0, check=False
    )
    assert picture_path.exists(), outcome.stderr

    picture = np.asarray(Image.open(picture_path).convert("RGB"), dtype=int)
    rows = len(picture)
    top, middle = picture[rows * 60 // HEIGHT : rows * 250 // HEIGHT], picture[rows // 3 : rows * 3 // 5]
    assert near(top, state_timeline.GOOD) > 2000, "the timeline of mode run"
    assert near(top, state_timeline.ALARM, tolerance=60) > 500, "the failed check"
    assert near(middle, state_timeline.TRUTH) > 300, "the true striker"
    assert near(middle, state_timeline.ALARM) > 500, "the stop's line"
    assert near(picture[rows * 3 // 4 :], state_timeline.TRUTH) > 100, "the striker in the moving picture"
