"""What faults act on is counted, none leaves the run not judged, and they act at instants within a tick."""

import json

import numpy as np
import pytest
import tomli_w
from resting import resting

import hil
from hil.faults.fault import effects_of, of_a_node
from hil.faults.kinds.dropped import Dropped
from hil.faults.kinds.kick import Kick
from hil.scenario.scenario import load_scenario

WHOLE = {"at_s": 0.2, "duration_s": 0.2}


def toml(fault):
    lines = [f"{key} = {value!r}" for key, value in fault.items()]
    return "\n".join(["[[script.faults]]", *lines, ""])


def run_with(folder, *faults, firmware="compiled", **more):
    """A run of 0.6 s at rest with these faults."""
    path = resting(folder, duration_s=0.6)
    path.write_text(path.read_text() + "\n".join(map(toml, faults)))
    return hil.run(path, out=folder / "run", firmware=firmware, **more)


def test_a_fault_says_when_it_acted_whatever_ends_before_it(tmp_path):
    """A killed firmware never comes back, and its last record is before the other faults."""
    run = run_with(
        tmp_path,
        {"kind": "killed", "process": "firmware", "at_s": 0.2, "duration_s": 0.1},
        {"kind": "kick", "change_m_s": 0.1, "at_s": 0.3},
        {"kind": "unplugged", "node": "operator", "at_s": 0.4, "duration_s": 0.1},
        {"kind": "sensor-stuck", "sensor": "housing", "at_s": 0.5},
    )
    noted = json.loads((run.folder / "run.json").read_text())["faults"]
    keys = ("kind", "node", "silences", "from_s", "to_s")
    assert [tuple(one[key] for key in keys) for one in noted] == [
        ("killed", "firmware", True, 0.2, None),
        ("kick", "plant", False, 0.3, 0.3),
        ("unplugged", "operator", False, 0.4, 0.5),
        ("sensor-stuck", "plant", False, 0.5, None),
    ]
    assert [one["acted"] for one in noted] == [one["acted_on"] for one in run.verdict["faults"]]
    assert all(one["acted"] for one in noted)
    assert "faults_acted" not in (run.folder / "outcome.json").read_text()
    events = [text for text in run.table("events")["text"].to_pylist() if "injected" in text]
    assert [text.partition(" s  ")[2] for text in events] == [
        "injected fault: killed (process firmware)",
        "injected fault: kick (change_m_s 0.1)",
        "injected fault: unplugged (node operator)",
        "injected fault over: unplugged (node operator)",
        "injected fault: sensor-stuck (sensor housing)",
    ]


@pytest.mark.parametrize(
    ("fault", "counts"),
    [
        ({"kind": "dropped", "frames": ["Accelerometer"]}, range(200, 201)),
        ({"kind": "dropped", "frames": ["ImpactEvent"]}, range(1)),
        ({"kind": "delayed", "frames": ["Accelerometer"], "delay_s": 0.01}, range(200, 201)),
        ({"kind": "delayed", "frames": ["Accelerometer"], "delay_s": 1e-9}, range(1)),
        ({"kind": "bundled", "frames": ["Accelerometer"], "period_s": 0.01}, range(180, 181)),
        ({"kind": "bundled", "frames": ["Accelerometer"], "period_s": 0.001}, range(1)),
        ({"kind": "babbling", "can_id": 5, "period_s": 0.01}, range(20, 21)),
        ({"kind": "unplugged", "node": "operator"}, range(200, 5000)),
        ({"kind": "sensor-biased", "sensor": "housing", "bias": 1.0}, range(200, 201)),
        ({"kind": "sensor-clipped", "sensor": "striker", "limit_m_s2": 1e4}, range(1)),
        ({"kind": "motor-stall"}, range(200, 201)),
        ({"kind": "supply-sag", "supply_v": 24.0}, range(1)),
        ({"kind": "supply-sag", "supply_v": 12.0}, range(200, 201)),
        ({"kind": "torque-stuck", "torque_n_m": 0.1}, range(1, 201)),
        ({"kind": "kick", "change_m_s": 0.1}, range(1, 2)),
        ({"kind": "paused", "process": "firmware"}, range(200, 201)),
        ({"kind": "clock-jumped", "by_s": 0.05}, range(1, 1000)),
    ],
)
def test_what_a_fault_acted_on_stands_in_the_verdict(tmp_path, fault, counts):
    run = run_with(tmp_path, {**fault, **WHOLE})
    (effect,) = run.verdict["faults"]
    assert (effect["kind"], effect["at_s"]) == (fault["kind"], 0.2)
    assert effect["acted_on"] in counts
    nothing = f"the injected fault {fault['kind']!r} at 0.2 s acted on nothing"
    assert run.verdict["verdict"] == ("not-judged" if effect["acted_on"] == 0 else "passed")
    assert any(nothing in reason for reason in run.verdict["not_judged"]) is (effect["acted_on"] == 0)


def test_each_node_counts_for_itself_and_a_run_counts_from_nothing():
    dropped = Dropped(kind="dropped", at_s=0.0, frames=["Accelerometer"])
    kick = Kick(kind="kick", at_s=0.0, change_m_s=0.1)
    for _ in range(2):
        nodes = [of_a_node((dropped, kick)) for _ in range(2)]
        nodes[0][1].count(3)
        nodes[1][1].count()
        assert effects_of(nodes) == [0, 4]


def velocity(run):
    t_s, v_m_s = run.signal("plant.v_m_s")
    return dict(zip(np.round(1e3 * t_s).astype(int).tolist(), v_m_s.tolist(), strict=True))


@pytest.mark.parametrize("firmware", ["python", "compiled"])
def test_a_kick_within_a_tick_acts_at_its_instant(tmp_path, firmware):
    short = run_with(
        tmp_path, {"kind": "kick", "at_s": 0.2003, "duration_s": 4e-4, "change_m_s": 0.1}, firmware=firmware
    )
    assert short.verdict["faults"][0]["acted_on"] == 1
    after = velocity(short)
    assert after[200] == 0.0
    # Nearly free after 0.7 ms: the spring takes ω² x t ≈ 88 · 7e-5 · 3.5e-4 m/s of it, the damping less.
    assert after[201] == pytest.approx(0.1, abs=1e-3)
    whole = run_with(tmp_path / "b", {"kind": "kick", "at_s": 0.2, "change_m_s": 0.1}, firmware=firmware)
    assert after[201] > velocity(whole)[201], "a later kick has lost less"


def test_a_kick_in_a_stall_of_the_plant_acts_at_its_instant(tmp_path):
    kick = {"kind": "kick", "at_s": 0.2503, "duration_s": 4e-4, "change_m_s": 0.1}
    pause = {"kind": "paused", "process": "plant", "at_s": 0.22, "duration_s": 0.06}
    run = run_with(tmp_path, kick, pause)
    free = run_with(tmp_path / "b", kick)
    assert [one["acted_on"] for one in run.verdict["faults"]] == [1, 60]
    assert velocity(run)[285] == pytest.approx(velocity(free)[285], rel=1e-9)


def test_a_killed_firmware_stays_away_after_the_faults_duration(tmp_path):
    run = run_with(
        tmp_path, {"kind": "killed", "process": "firmware", "at_s": 0.1, "duration_s": 0.01}, clock="lockstep"
    )
    assert run.verdict["loops"]["firmware"]["ticks"] == 100


def test_a_kick_is_not_repeated_or_made_up_for_when_the_plant_restarts(tmp_path):
    kicks = [{"kind": "kick", "at_s": at_s, "change_m_s": 0.1} for at_s in (0.1, 0.25)]
    restart = {"kind": "restarted", "process": "plant", "at_s": 0.2, "duration_s": 0.1}
    run = run_with(tmp_path, *kicks, restart)
    assert [one["acted_on"] for one in run.verdict["faults"][:2]] == [1, 0]
    assert run.verdict["verdict"] == "not-judged", "the second kick had no plant to act on"
    velocity_m_s = velocity(run)
    assert {velocity_m_s[tick] for tick in range(300, 600)} == {0.0}, "a new striker is at rest"


def test_a_brown_out_shorter_than_a_tick_before_the_end_acts(tmp_path):
    run = run_with(tmp_path, {"kind": "brown-out", "at_s": 0.5995})
    assert run.verdict["faults"][0]["acted_on"] >= 1
    assert run.verdict["verdict"] == "passed"


@pytest.mark.parametrize(
    ("by_m", "verdict"),
    [(-0.05, "passed"), (-0.1, "not-judged")],
)
def test_a_stop_moves_only_once_the_striker_is_clear_of_its_new_place(tmp_path, by_m, verdict):
    """It swings by 0.03 m about 0.12 m: a stop at 0.13 m is free now and then, one at 0.08 m never."""
    path = tmp_path / "swing.toml"
    path.write_text(
        'title = "It swings"\nscene = "own.toml"\n[script]\nduration_s = 1.5\n'
        f'[[script.faults]]\nkind = "stop-moved"\nat_s = 0.0\nby_m = {by_m}\n'
        '[[checks]]\nname = "impact_count"\nhigh = 99\n'
    )
    scene = load_scenario("soft-start-multistable").document["scene"]
    own = {**scene, "stop": {"law": "rigid", "position_m": 0.18, "restitution": 0.5}}
    own["initial"] = {"x_m": 0.15, "v_m_s": 0.0}
    (tmp_path / "own.toml").write_text(tomli_w.dumps(own))
    run = hil.run(path, out=tmp_path / "run", firmware="compiled")
    assert run.verdict["verdict"] == verdict, run.verdict["not_judged"]
    _, x_m = run.signal("plant.x_m")
    assert np.abs(np.diff(x_m)).max() < 1e-3, "the striker does not jump"
