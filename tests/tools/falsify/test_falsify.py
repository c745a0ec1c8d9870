"""`vibrohil falsify`: what it varies, what it counts, and that `run` repeats what it writes."""

import json
import tomllib
from collections import Counter
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import planted
import pytest
from matplotlib.figure import Figure

from hil.figures import moments
from hil.processes.signals import Interrupted
from hil.scenario import limits
from hil.scenario.files import ScenarioError, read_file, search_tables
from hil.scenario.scenario import load_scenario
from tools import cli
from tools.commands.options import MOST_SEED
from tools.falsify import evaluations as stored
from tools.falsify import pictures
from tools.falsify.objective import BROKEN, Result, judged, result_at
from tools.falsify.search import (
    OPTIMISERS,
    TURN,
    Best,
    Start,
    most_important,
    search,
    sobol,
    targets_of,
)
from tools.falsify.space import DELAY, IDLE, INSTANT, Dimension, Space
from tools.falsify.space_of_scenario import space_of
from tools.output import EXIT_BAD_INPUT, EXIT_CHECK_FAILED, EXIT_NOTHING_RAN, EXIT_PASSED, BadInputError

KICK = "a-kick-towards-the-stop-does-not-lose-the-impacts"
OWN = """
title = "The crank stays below a speed at every ratio"
like = "quick-start-below-the-band"
checks = [
    {{ name = "speed_rad_s", expression = "max(plant.omega_rad_s)", high = {limit}, unit = "rad/s" }},
    {{ name = "fault", equals = "none" }},
]
script.duration_s = 2.5
script.commands = [{{ at_s = 0.1, request = "run", target_ratio = 1.0 }}]
search = [
    {{ key = "script.commands.0.target_ratio", low = 0.8, high = {high} }},
    {{ key = "scene.friction.b_n_s_m", low = 0.1, high = 0.3 }},
]
"""


def written(folder: Path, text: str, name: str = "own") -> str:
    path = folder / f"{name}.toml"
    path.write_text(text)
    return str(path)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"key": "script.duration_s", "low": 1.0}, "give low and high, or choices"),
        ({"key": "script.duration_s", "low": 2.0, "high": 1.0}, "is not below"),
        ({"key": "script.duration_s", "low": "a", "high": "b"}, "must be numbers"),
        ({"key": "script.duration_s", "choices": [1]}, "search"),
        ({"key": "script.duration_s", "choices": [[1], [2]]}, "must be numbers, texts"),
        ({"key": "script..duration_s", "low": 1.0, "high": 2.0}, "no dotted key"),
        ({"key": "script.duration_s", "low": 1.0, "high": 2.0, "step": 1}, "step"),
    ],
)
def test_a_table_that_cannot_be_searched_is_refused(tmp_path, table, said):
    line = ", ".join(f"{key} = {json.dumps(value)}" for key, value in table.items())
    source = written(tmp_path, f'title = "x"\nlike = "{KICK}"\nsearch = [{{ {line} }}]\n')
    with pytest.raises(ScenarioError, match=said):
        search_tables(source)


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        (["scene.friction.c"], "no such value"),
        (["title"], "cannot be searched"),
        (["scene.friction"], "no single value"),
        (["script.commands"], "no single value"),
        (["firmware.watchdog"], "no single value"),
        (["scene.friction.b_n_s_m"] * 2, "is there twice"),
    ],
)
def test_a_key_that_cannot_be_searched_is_refused(tmp_path, keys, said):
    lines = ", ".join(f'{{ key = "{key}", low = 1, high = 2 }}' for key in keys)
    source = written(tmp_path, f'title = "x"\nlike = "quick-start-below-the-band"\nsearch = [{lines}]\n')
    with pytest.raises(BadInputError, match=said):
        space_of(source, [])


@pytest.mark.parametrize(
    ("dimension", "values"),
    [
        (Dimension("k", 1, 1, 3), [1, 1, 2, 3, 3]),
        (Dimension("k", 1.0, 1.0, 3.0), [1.0, 1.5, 2.0, 2.5, 3.0]),
        (Dimension("k", "a", choices=("a", "b")), ["a", "a", "b", "b", "b"]),
    ],
)
def test_whole_numbers_stay_whole(dimension, values):
    found = [dimension.value(share) for share in (0.0, 0.25, 0.5, 0.75, 1.0)]
    assert found == values
    assert [type(one) for one in found] == [type(one) for one in values]


def test_the_default_space_of_a_kick_varies_kick_module_sensors_and_disturbances():
    space = space_of(KICK, [])
    ranges = {one.key: one.text for one in space.dimensions}
    assert ranges[DELAY] == "0 … 0.61"
    assert ranges["script.faults.0.change_m_s"] == "-0.3 … 0.3"
    assert ranges["scene.stop.restitution"] == "0.45 … 0.55"
    assert "scene.drive.phase_rad" not in ranges  # the delay varies the phase of the fault
    assert ranges["script.faults.2.duration_s"].startswith("0.0, 0.001")
    assert {one.requirement for one in space.checks} == {"S-04", "S-05", "S-06", "P-07", "P-15"}
    # Nothing that is at its default is left in the script, and the requirement's limit counts.
    scenario = load_scenario(KICK)
    assert space.tables(space.defaults)["script"] == scenario.document["script"]
    [own] = [one for one in scenario.checks if one.name == "after_fault.peak_force_n"]
    [taken] = [one for one in space.checks if one.name == own.name]
    assert own.bounds.low is not None
    assert taken.bounds == own.required
    # The instant of a fault of size 0 is no change.
    instant = [0.3 if one.key == "script.faults.2.at_s" else one.default for one in space.dimensions]
    assert space.changed(instant) == {}
    assert space.kind_of("script.faults.2.at_s") == "dropped"
    kinds = {space.kind_of(key) for key in ranges} - {""}
    samples = {"dropped", "corrupted", "frozen", "delayed"}
    assert kinds == {"kick", *samples, "paused", "run"}
    # A fault comes with its size, and the delay moves all that follows.
    values = [0.5 if one.key == DELAY else one.default for one in space.dimensions]
    values[[one.key for one in space.dimensions].index("script.faults.2.duration_s")] = 0.002
    moved = space.scenario(values)
    assert [(one.kind, one.at_s) for one in moved.faults] == [("kick", 6.5), ("dropped", 6.5)]
    assert moved.duration_s == scenario.duration_s + 0.5


@pytest.mark.parametrize(
    ("name", "wanted"), [("a-silent-encoder-stops-the-motor", []), (KICK, ["S-05"]), (KICK, ["P-07"])]
)
def test_the_clock_jitters_where_no_detector_is_judged(name, wanted) -> None:
    space = space_of(name, wanted)
    assert "clock-jitter" in {space.kind_of(one.key) for one in space.dimensions}


@pytest.mark.parametrize("name", ["a-bus-off-of-ten-ticks-is-ridden-through", KICK])
def test_the_bus_is_disturbed_where_it_is_modelled(name) -> None:
    space = space_of(name, [])
    own = {fault.kind for fault in load_scenario(name).faults}
    kinds = {space.kind_of(one.key) for one in space.dimensions} & {"bus-off", "disturbed", "babbling"}
    assert kinds == (set() if own == {"kick"} else {"bus-off", "disturbed", "babbling"})


def test_faults_of_bus_and_process_at_once_act_and_keep_the_requirements() -> None:
    space = space_of("a-bus-off-of-ten-ticks-is-ridden-through", [])
    wanted = {"bus-off": 0.005, "disturbed": 0.002, "babbling": 0.1, "paused": 0.005}
    values = list(space.defaults)
    for place, one in enumerate(space.dimensions):
        if one.default == 0.0 and one.key.endswith(".duration_s"):
            values[place] = wanted.get(space.kind_of(one.key), 0.0)
        if one.key.endswith(".at_s") and space.kind_of(one.key) == "disturbed":
            values[place] = one.high  # the plant is back on the bus
    scenario = space.scenario(values)
    assert {fault.kind for fault in scenario.faults} == wanted.keys()
    verdict, _ = judged(scenario, scenario.checks)
    assert all(one.acted_on for one in verdict.faults)
    assert result_at(space, values).margin > 0.0


def test_disturbances_meet_at_one_instant() -> None:
    space = space_of(KICK, [])
    keys = [one.key for one in space.dimensions]
    values = list(space.defaults)
    values[keys.index(INSTANT)] = 0.4
    assert space.changed(values) == {}  # nothing is there that it could move
    for place, size in ((2, 0.002), (3, 0.005)):
        values[keys.index(f"script.faults.{place}.duration_s")] = size
    values[keys.index("script.faults.3.at_s")] += 0.03
    assert [(one.kind, one.at_s) for one in space.scenario(values).faults[1:]] == [
        ("dropped", 6.4),
        ("corrupted", 6.43),
    ]


def test_a_fault_that_ends_the_motion_may_come_in_the_start() -> None:
    space = space_of("lost-operator-commands-stop-the-motor", [])
    [delay] = [one for one in space.dimensions if one.key == DELAY]
    assert delay.low == 1.0 - 6.0003
    values = [-4.0 if one.key == DELAY else one.default for one in space.dimensions]
    assert [one.at_s for one in space.scenario(values).faults] == [2.0003]
    assert result_at(space, values).margin >= 0.0
    own = space_of("a-violent-kick-stops-the-motor", [])  # it restricts the delay to the flight
    assert next(one for one in own.dimensions if one.key == DELAY).low == 0.0


def values_of(space, **given):
    assert given.keys() <= {one.key for one in space.dimensions}
    return [given.get(one.key, one.default) for one in space.dimensions]


def test_an_operator_may_ask_for_idle_before_a_fault_that_ends_the_motion() -> None:
    space = space_of("a-silent-encoder-stops-the-motor", [])
    values = values_of(space, idle_before_s=0.15, delay_s=0.2)
    asked = [(one.request, one.at_s) for one in space.scenario(values).commands]
    assert asked == [("run", 0.5), ("idle", 6.05)]
    result = result_at(space, values)
    assert result.margin > 0.0
    early = values_of(space, idle_before_s=0.3, delay_s=-4.8)
    assert [one.request for one in space.scenario(early).commands] == ["run"], "the crank would stand"
    assert space.changed(early) == {DELAY: -4.8}
    step = {one.key: one.high for one in space.dimensions if one.key.endswith("target_ratio")}
    assert space.changed(values_of(space, idle_before_s=0.15, **step)) == {IDLE: 0.15}
    # The step is left out, so there is nothing that an instant could move.
    assert space.changed(values_of(space, idle_before_s=0.15, instant_s=0.4, **step)) == {IDLE: 0.15}


def test_no_idle_is_searched_where_the_hold_is_judged() -> None:
    keys = {one.key: one for one in space_of("a-silent-encoder-stops-the-motor", ["P-02"]).dimensions}
    assert IDLE not in keys
    assert keys[DELAY].low == 0.0


@pytest.mark.parametrize(
    "name",
    [
        "a-jammed-crank-is-let-go-of",  # STALL takes a second, in which a stop ends
        "a-stop-that-sees-no-standstill-is-given-up",  # it asks for idle itself
        "twenty-lost-samples-do-not-stop-it",
        "an-idle-in-the-start-ends-in-a-stop",
        "damaged-parameters-arm-nothing",
        "a-flood-of-frames-on-every-identifier-does-no-harm",
    ],
)
def test_idle_is_not_varied_where_the_motion_goes_on_or_ends_before_the_fault(name):
    assert IDLE not in [one.key for one in space_of(name, []).dimensions]


@pytest.mark.parametrize(
    ("bias_m_s2", "mode", "after_s"),
    [(0.0, "fault", 0.033), (0.4, "fault", 0.033), (0.25, "run", None), (-0.25, "run", None)],
)
def test_an_offset_of_half_a_count_hides_a_swap_with_the_housing(bias_m_s2, mode, after_s):
    settings = [f"scene.sensors.housing.bias_m_s2={bias_m_s2}", "script.duration_s=12"]
    scenario = load_scenario("swapped-accelerometers-stop-the-motor", settings)
    verdict, _ = judged(scenario, scenario.checks)
    found = {one.name: one.value for one in verdict.checks}
    assert found["final_mode"] == mode
    assert found["after_fault.torque_zero_after_s"] == (after_s and pytest.approx(after_s, abs=0.005))


def test_a_fault_of_a_stop_does_not_come_before_it() -> None:
    space = space_of("a-stop-that-sees-no-standstill-is-given-up", [])
    assert next(one for one in space.dimensions if one.key == DELAY).low == 0.0


def test_a_kick_near_a_limit_varies_in_size_because_what_passes_does_not_depend_on_a_trip() -> None:
    space = space_of("an-impact-beyond-its-limit-ends-the-torque", [])
    [size] = [one for one in space.dimensions if one.key == "script.faults.0.change_m_s"]
    assert (size.low, size.high) == (-2.6, 2.6)
    assert {"gate.passed_n", "gate.passed_n_s"} < {one.name for one in space.checks}
    assert "fault" not in {one.name for one in space.checks}
    other = space_of("a-violent-kick-stops-the-motor", [])
    assert "script.faults.0.change_m_s" not in {one.key for one in other.dimensions}


def test_a_walk_is_searched_over_its_strides() -> None:
    space = space_of("a-walker-who-stops-gets-no-more-pulses", [])
    keys = [one.key for one in space.dimensions]
    assert {"scene.gait.variability", "scene.gait.stance_share", "scene.gait.heel_strike_m_s2"} <= set(keys)
    values = [7 if one.key == "seed" else one.default for one in space.dimensions]
    assert space.scenario(values).seed == 7
    assert space.scenario(space.defaults).seed == load_scenario(space.name).seed
    assert "seed" not in [one.key for one in space_of(KICK, []).dimensions]


def test_no_disturbance_comes_before_the_operator_asks_for_motion() -> None:
    space = space_of("a-start-against-friction-ends-in-a-refusal", [])  # its fault comes at 0.1 s
    assert min(one.low for one in space.dimensions if one.key.endswith("at_s")) == 0.5


def test_a_run_without_a_fault_is_searched_without_disturbances():
    space = space_of("soft-start-multistable", [])
    assert not any("faults" in one.key for one in space.dimensions)
    assert {"P-04", "P-05", "P-06"} <= {one.requirement for one in space.checks}
    assert "P-03" not in {one.requirement for one in space.checks}  # its limit is this scenario's own
    assert [one.requirement for one in space_of("soft-start-multistable", ["P-03"]).checks] == ["P-03"]
    with pytest.raises(BadInputError, match="P-99"):
        space_of("soft-start-multistable", ["P-99"])


def test_each_planted_defect_is_a_change_of_one_place():
    defects = tomllib.loads(planted.DEFECTS.read_text("utf-8"))["defects"]
    counts = {
        one["name"]: (planted.ROOT / one["file"]).read_text("utf-8").count(one["old"]) for one in defects
    }
    assert counts
    assert {name: count for name, count in counts.items() if count != 1} == {}
    changes = Counter((one["file"], one["old"], one["new"]) for one in defects)
    assert max(changes.values()) == 1


class Valley:
    """Runs whose margin is a smooth function of their values, with one that is not judged."""

    def __init__(self):
        self.known = {}

    def results(self, space, values, _=""):
        for one in values:
            far = float(np.sum((np.array(one) - 0.37) ** 2))
            self.known[one] = Result((), "doubted") if one[0] > 0.98 else Result((far + 0.01, None))
        return [self.known[one] for one in values]


def test_a_key_matters_if_the_margin_is_a_function_of_it_in_whatever_form():
    values = np.random.default_rng(1).random((200, 4))
    assert set(most_important(values, (values[:, 1] - 0.5) ** 2 + 0.1 * values[:, 3])) == {1, 3}


def valley() -> Space:
    space = Space("valley", {}, tuple(Dimension(f"k{n}", 0.0, 0.0, 1.0) for n in range(6)), (0, 1))
    checks = load_scenario("soft-start-multistable").checks
    vars(space)["checks"] = checks[2:4]
    return space


@pytest.mark.parametrize("seed", [0, 3, MOST_SEED])
def test_the_optimisers_find_more_than_sobol_with_the_same_budget(seed):
    baseline, *others = search([valley()], 400, seed, Valley())
    assert [one.method for one in others] == list(OPTIMISERS)
    for one in others:
        assert one.runs <= 400
        assert one.best.margin < 0.5 * baseline.best.margin
    assert baseline.runs == 400  # with those that are not judged


def test_a_check_that_varies_towards_its_limit_comes_before_one_that_is_always_near_it() -> None:
    space = valley()
    places = sobol(space, 16, 1)
    results = [Result((0.001 + 1e-5 * one[0], 0.3 + one[1])) for one in places]
    first, second = targets_of([Start(space, places, results)])
    assert (first.check, second.check) == (1, 0)
    counts = [Result((one[0], float(one[1] > 0.5))) for one in places]
    assert [one.check for one in targets_of([Start(space, places, counts)])] == [0]
    far = [Result((one[0], min(float(one[1]), 0.8))) for one in places]  # equal only far from the limit
    assert [one.check for one in targets_of([Start(space, places, far)])] == [0, 1]


def test_a_broken_scenario_at_the_end_of_many_is_found_by_turns() -> None:
    class LastBreaks(Valley):
        def results(self, space, values, _=""):
            return [Result((-1.0 if space.name == "last" else 1.0, None)) for _ in values]

    spaces = [replace(valley(), name=name) for name in ("first", "second", "last")]
    for one in spaces:
        vars(one)["checks"] = valley().checks
    assert search(spaces, 400, 3, LastBreaks())[1].found_after <= 2 * TURN + 1


@pytest.mark.usefixtures("in_process")
def test_a_counterexample_is_small_and_run_repeats_it_bit_for_bit(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = written(tmp_path, OWN.format(limit=10.5, high=1.3))
    assert cli.run(["falsify", own, "--budget", "16", "--out", "found", "--json"]) == EXIT_CHECK_FAILED
    said = capsys.readouterr()
    assert "no direction, counted as broken or not: fault" in said.err
    result = json.loads(said.out)
    assert {"runs", "worst", "found", "baseline", "passed"} <= result.keys()
    worst = result["worst"]
    assert (worst["check"], worst["scenario"], result["passed"]) == ("speed_rad_s", "own", False)
    assert list(worst["values"]) == ["script.commands.0.target_ratio"]  # the friction has returned
    assert Path(result["picture"]).stat().st_size > 10_000
    counterexample = Path(result["counterexample"])
    assert set(read_file(counterexample)) == {"title", "like", "checks", "script", "seed"}
    assert cli.run(["inspect", result["run"], "--json"]) == EXIT_CHECK_FAILED  # what `view` opens
    [check] = json.loads(capsys.readouterr().out)["checks"]
    assert check["margin_share"] == worst["margin"] < 0.0


@pytest.mark.usefixtures("in_process")
def test_an_interrupted_search_goes_on_and_without_counterexample_shows_the_margins(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    own = written(tmp_path, OWN.format(limit=14.0, high=1.2))
    command = ["falsify", own, "--budget", "8", "--json"]
    whole, tasks = stored.run_task, []

    def interrupted(spaces, task):
        tasks.append(task)
        if len(tasks) > 1:
            raise Interrupted("interrupted by SIGINT")
        return whole(spaces, task)

    with monkeypatch.context() as patch:
        patch.setattr(stored, "run_task", interrupted)
        assert cli.run(command) == 2
    assert "the same command continues" in capsys.readouterr().err
    assert cli.run(command) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert result["taken_over"] == 1
    assert result["runs"] > result["taken_over"]
    assert result["worst"]["margin"] > 0.0
    assert result["baseline"]["margin"] >= result["worst"]["margin"]
    assert Path(result["picture"]).name == "margins.png"
    assert (result["counterexample"], result["kept"], result["run"]) == (None, None, None)
    assert cli.run([*command, "--keep"]) == EXIT_PASSED
    kept = json.loads(capsys.readouterr().out)
    assert (kept["worst"], kept["counterexample"]) == (result["worst"], None)
    assert cli.run(["inspect", kept["run"], "--json"]) == EXIT_PASSED
    [check] = json.loads(capsys.readouterr().out)["checks"]
    assert check["margin_share"] == kept["worst"]["margin"] > 0.0
    assert load_scenario(kept["kept"]).checks[0].name == check["name"]


@pytest.mark.usefixtures("in_process")
def test_checks_without_a_direction_pass_without_a_picture_of_margins(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    speed = next(line for line in OWN.splitlines() if "speed_rad_s" in line)
    command = ["falsify", written(tmp_path, OWN.replace(speed, "").format(high=1.2)), "--budget", "4"]
    assert cli.run([*command, "--json"]) == EXIT_PASSED
    result = json.loads(capsys.readouterr().out)
    assert (result["worst"]["margin"], result["picture"]) == (1.0, None)
    assert cli.run(command) == EXIT_PASSED
    assert "no picture: all runs have the same margin" in capsys.readouterr().out


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("arguments", "status", "said"),
    [
        (["soft-start-multistable", "--requirement", "S-09"], EXIT_BAD_INPUT, "no check to search"),
        (["own.toml", "other/own.toml"], EXIT_BAD_INPUT, "same name"),
        (["gone.toml"], EXIT_BAD_INPUT, "gone.toml"),
        (["own.toml", "--seed", str(MOST_SEED + 1)], EXIT_BAD_INPUT, "less than or equal to 1000000000"),
        (["never.toml", "--budget", "4"], EXIT_NOTHING_RAN, "refused"),
    ],
)
def test_what_proves_nothing_is_no_success(arguments, status, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    written(tmp_path, OWN.format(limit=14.0, high=1.2))
    (tmp_path / "other").mkdir()
    written(tmp_path / "other", OWN.format(limit=14.0, high=1.2))
    written(tmp_path, OWN.format(limit=14.0, high=6.0).replace("low = 0.8", "low = 5.0"), "never")
    assert cli.run(["falsify", *arguments]) == status
    printed = capsys.readouterr()
    assert said in printed.err + printed.out


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("key", "low", "high", "said"),
    [
        ("script.commands.0.target_ratio", 5.0, 6.0, "is not a number of at most 4"),
        (
            "firmware.control.tick_s",
            0.005,
            0.006,
            "is out of bounds",
        ),  # the firmware refuses it, not the scenario
    ],
)
def test_each_run_that_is_not_judged_is_counted_once_with_its_reason(
    key, low, high, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    table = f'{{ key = "{key}", low = {low}, high = {high} }}'
    own = OWN.format(limit=14.0, high=1.2).replace("search = [", f"search = [\n    {table},")
    own = "\n".join(line for line in own.splitlines() if "low = 0.8" not in line)
    assert cli.run(["falsify", written(tmp_path, own), "--budget", "4", "--json"]) == EXIT_NOTHING_RAN
    result = json.loads(capsys.readouterr().out)
    [why] = result["why_not_judged"]
    assert why["runs"] == result["not_judged"] == result["runs"]
    assert said in why["reason"]


def test_reasons_that_differ_only_in_numbers_are_one(tmp_path):
    evaluations = stored.Evaluations(tmp_path, None, None)
    whys = (
        "refused: a = 5.1 m",
        "refused: a = 6e-07 m",
        "refused: b = 5.1 m",
        "3 frames lost",
        "12 frames lost",
    )
    evaluations.known |= {stored.Task("own", (n,)): Result((), why) for n, why in enumerate((*whys, ""))}
    assert evaluations.unjudged == {whys[0]: 2, whys[2]: 1, whys[3]: 2}


@pytest.mark.parametrize("first", [Dimension("k0", "a", choices=("a", "b")), Dimension("k0", 0.0, 0.0, 1.0)])
def test_the_picture_of_margins_shows_a_single_key_and_choices_of_texts(first, monkeypatch):
    space, figure = valley(), Figure()
    vars(space)["dimensions"] = (first, Dimension("k1", 0.0, 0.0, 1.0))
    values = [(first.value(share if first.choices else 0.0), share) for share in (0.1, 0.4, 0.8)]
    known = {(space.name, one): Result((one[1], 1.0), "") for one in values}
    monkeypatch.setattr(pictures, "drawn", lambda *_: nullcontext(figure))
    pictures.plot_margins(Best(0.1, space, values[0], 0), SimpleNamespace(known=known), Path())
    labels = {figure.axes[0].get_xlabel(), figure.axes[0].get_ylabel()}
    assert labels == ({"k0", "k1"} if first.choices else {"k1", f"margin of {space.checks[0].name}"})


def test_the_picture_of_a_detector_shows_what_it_reports_beside_what_was():
    space = space_of("twenty-lost-samples-do-not-stop-it", ["P-15"])
    [place] = [n for n, one in enumerate(space.checks) if one.name == "detector.speed_rmse_m_s"]
    axes = Figure().subplots()
    pictures.draw_instant(Best(0.5, space, space.defaults, place), axes)
    speed, impacts, reports, *_ = axes.get_lines()
    assert axes.get_ylabel() == "velocity [m/s]"
    traces = judged(space.scenario(space.defaults), space.checks)[1]
    worst_s = moments.worst_reported_speed(traces)
    assert worst_s in impacts.get_xdata()
    assert np.mean(speed.get_xdata()) == pytest.approx(worst_s, abs=0.01), "not the fault in the middle"
    assert reports.get_ydata() == pytest.approx(impacts.get_ydata(), abs=0.2)


def test_each_stored_run_is_taken_over_whatever_the_budget(tmp_path):
    def run(tasks):
        return enumerate([{"margins": [0.5], "why": ""} for _ in tasks])

    values, taken_over = [(float(k),) for k in range(12)], []
    for asked in (values[:7], values[2:12]):
        found = stored.Evaluations(tmp_path, run, lambda *_: None)
        found.results(valley(), asked)
        taken_over.append(found.taken_over)
    assert taken_over == [0, 5]


def test_a_failed_check_without_a_margin_counts_as_broken(tmp_path):
    space = space_of(written(tmp_path, OWN.format(limit=14.0, high=1.2)), [])
    stopped = OWN.format(limit=14.0, high=1.2).replace('equals = "none"', 'equals = "stall"')
    assert result_at(space, space.defaults).margin > 0.0
    broken = space_of(written(tmp_path, stopped, "stopped"), [])
    assert result_at(broken, broken.defaults).margin == BROKEN


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    "check",
    [
        '"bus_load", low = 0.0, high = 1.0',
        '"x", expression = "max(firmware.state.estimator.gated_ticks)", high = 9.0, from_s = 0.1, unit = ""',
    ],
)
def test_records_in_memory_have_the_margins_of_a_run_folder(check, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    own = OWN.format(limit=14.0, high=1.2).replace('"fault", equals = "none"', check)
    source = written(tmp_path, own)
    cli.run(["run", source, "--clock", "lockstep", "--out", "run"])
    capsys.readouterr()
    cli.run(["inspect", "run", "--json"])
    checks = json.loads(capsys.readouterr().out)["checks"]
    space = space_of(source, [])
    found = result_at(space, space.defaults)
    assert list(found.margins) == [one["margin_share"] for one in checks]
    assert None not in found.margins


@pytest.mark.parametrize(
    "name", ["lost-operator-commands-stop-the-motor", "a-silent-encoder-stops-the-motor"]
)
def test_no_disturbance_of_the_default_space_acts_on_nothing(name: str) -> None:
    """Frames that the scenario loses, or of which none is due, would leave the run without a verdict."""
    space = space_of(name, [])
    for place in sobol(space, 8, 3):
        assert result_at(space, space.values(place.tolist())).why == ""


@pytest.mark.requirement("S-08")
@pytest.mark.parametrize(
    "late",
    [
        {"script.faults.8.duration_s": 0.005, INSTANT: 0.3507},
        {DELAY: 0.1001681, "script.faults.9.largest_s": 0.00064, INSTANT: 0.2793},
    ],
)
def test_a_controller_that_is_late_as_its_watchdog_ends_keeps_the_requirement(
    late: dict[str, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the ticks by which it is late it would break the limit."""
    space = space_of("lost-operator-commands-stop-the-motor", ["S-08"])
    values = [late.get(one.key, one.default) for one in space.dimensions]
    assert result_at(space, values).margin > 0.0
    monkeypatch.setattr(limits, "late_ticks", lambda _: 0)
    assert result_at(space, values).margin < 0.0


def test_the_target_is_the_last_in_time_whatever_the_order_of_the_commands() -> None:
    space = space_of("a-restarted-controller-goes-on-once-it-is-asked-anew", [])
    key = next(one.key for one in space.dimensions if one.key.endswith("target_ratio"))
    values = [1.067 if one.key == key else one.default for one in space.dimensions]
    assert result_at(space, values).margin > 0.0
