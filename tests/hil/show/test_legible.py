"""The log's layout is legible: labels on every axis, limits, whole names of states, its own list of holds."""

import json
from dataclasses import asdict

import numpy as np
import pytest
from PIL import Image
from run_folder import make_run, write_run

from hil.record.log_reader import tables
from hil.show import layout, rerun_log
from hil.show.legible.extents import MARGIN, Extents, rounded
from hil.show.legible.limits import APPROACH_LIMITS
from hil.show.legible.state_labels import CHARACTER_PX, PADDING_PX, UNNAMED, WIDTH_PX, fit
from hil.show.rerun_log import rebuild
from hil.show.views import name_of
from hil.timing.pacemaker import Hold
from tools.dev.run_picture import ENTITIES, PICTURE, entities_of, overview_entities

BOUNDS = {"name": "impact_v_m_s", "low": 0.5, "high": 2.0}


@pytest.mark.parametrize("span", [3e-7, 0.012, 0.5, 4.0, 4.2, 99.0, 2e5])
def test_an_axis_contains_its_values_and_at_most_seven_round_numbers(span):
    for low in np.linspace(-2.0 * span, 2.0 * span, 41).tolist():
        bottom, top = rounded(low, low + span)
        assert bottom <= low
        assert low + span <= top
        room = (top - bottom) / (1.0 + 2.0 * MARGIN)
        step = 10.0 ** np.floor(np.log10(room * (1.0 + 1e-9)))
        assert 1.0 - 1e-6 <= room / step <= 6.0 + 1e-6


def test_values_that_are_not_finite_or_missing_have_no_range():
    extents = Extents()
    extents.add("a", np.array([np.nan, np.inf]))
    assert extents.of(["a", "b"]) is None
    extents.add("a", np.array([3.0, np.nan]))
    low, high = extents.of(["a", "b"])
    assert low < 3.0 < high, "also of a constant"


def concluded(made_up, folder, monkeypatch):
    """The log of a run, its plots by name with their series and their ranges, and what it contains."""
    plots, contents, make_layout, make_plot = {}, [], layout.layout, layout.plot

    def noted_plot(name, *series, **options):
        extents = options.get("extents")
        plots[name] = (series, None if extents is None else extents.of(map(name_of, series)))
        return make_plot(name, *series, **options)

    def noted_layout(highlights, found, *extents):
        contents.append(found)
        return make_layout(highlights, found, *extents)

    monkeypatch.setattr(layout, "plot", noted_plot)
    monkeypatch.setattr(rerun_log, "layout", noted_layout)
    log = tables(rebuild(write_run(made_up, folder)))
    return log, plots, contents[-1]


def test_every_plot_of_what_the_log_has_gets_a_range_and_the_limits_of_its_checks(tmp_path, monkeypatch):
    made_up = make_run()
    made_up.scenario["checks"] = [BOUNDS]
    log, plots, contents = concluded(made_up, tmp_path, monkeypatch)
    assert contents.limited == (APPROACH_LIMITS,)
    assert log[APPROACH_LIMITS]["Scalars:scalars"].to_pylist() == [[0.5, 2.0]] * 2
    for name, (series, range_y) in plots.items():
        fields = {getattr(item, "field", None) for item in series}
        written = {name for trace in (made_up.plant, made_up.firmware, made_up.impacts) for name in trace}
        if fields & (written - {"overruns"}):
            assert range_y is not None, name


@pytest.mark.parametrize("end_s", [7.0, 33.0, 600.0])
def test_no_name_of_a_state_is_wider_than_its_interval(end_s):
    names = ["ready", "soft-start", "run", "sensor-stuck (sensor striker)", "check failed: regime is lost"]
    changes = [(0.2 * number * number, name) for number, name in enumerate(names * 2)]
    for entity in ("states/mode", "states/axis"):
        shown = fit(entity, changes, dict.fromkeys(names, 0), end_s)
        ends_s = [*(one.t_s for one in shown[1:]), end_s]
        for one, until_s in zip(shown, ends_s, strict=True):
            width_px = WIDTH_PX.get(entity.partition("/")[2], 600.0) * (until_s - one.t_s) / end_s
            assert one.label == UNNAMED or len(one.label) * CHARACTER_PX + PADDING_PX <= width_px
            assert one.label == UNNAMED or one.label in one.state
    assert fit("states/mode", [(0.0, "run")], {"run": 1}, end_s)[0].label == "run"


def test_messages_of_held_time_are_a_list_of_their_own(tmp_path, monkeypatch):
    made_up = make_run()
    holds = [Hold(t_s=t_s, held_s=0.004, own_s=0.0, process="plant") for t_s in (1.0, 2.0)]
    made_up.outcome["holds"] = [asdict(hold) for hold in holds]
    log, _, contents = concluded(made_up, tmp_path, monkeypatch)
    assert contents.held
    texts = [text for (text,) in log["/held"]["TextLog:text"].to_pylist()]
    assert texts == [f"{hold.t_s:.3f} s  {hold.in_words}" for hold in holds]
    assert not any("held" in text for (text,) in log["/events"]["TextLog:text"].to_pylist())


def test_the_log_of_a_real_bench_has_the_tab_of_impacts_and_no_panel_of_the_truth():
    contents = layout.Contents(imported=True, measured=False, refused=False)
    tabs = {tab.name: entities_of(tab) for tab in layout.layout(None, contents).root_container.contents}
    assert "/impacts/detected" in tabs["Impacts"][layout.APPROACH_SPEED]
    assert "/impacts/detected_impulse" in tabs["Impacts"]["Impulse [N s]"]
    assert not {"Force, close up [N]", "Energy [J]"} & set(tabs["Impacts"])
    assert set(tabs["Estimator"]) == {"Velocity, close up [m/s]", "Acceleration, close up [m/s²]"}


def test_the_picture_in_the_readme_shows_the_entities_of_the_default_run_s_log():
    """`python -m tools.dev.run_picture` makes it again."""
    with Image.open(PICTURE) as picture:
        assert json.loads(picture.text[ENTITIES]) == overview_entities()
