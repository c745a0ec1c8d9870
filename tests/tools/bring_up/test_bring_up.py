"""The bring-up on simulated modules that are wired wrongly, or broken, in lockstep."""

from pathlib import Path
from typing import Any

import pytest
import tomli_w

from firmware_py.interface.enums import AxisState
from firmware_py.shell.parameters import with_overrides
from hil.record.formats import PARAMETERS
from tools.bring_up.step import NOTHING
from tools.bring_up.trials import BROKEN as BROKEN_MODULES
from tools.bring_up.trials import bench_of, beyond_bounds, brought_up, fault
from tools.campaign.campaigns import CAMPAIGNS, trial_of
from tools.campaign.identified import explain_no_hold, read_spread
from tools.tuning.result import make_value

WIRED = {
    "as it should be": ([], set()),
    "encoder backward": ([fault("sensor-wrong-sign", sensor="encoder")], {"wiring.torque_reversed"}),
    "encoder turned on its shaft": ([fault("sensor-biased", sensor="encoder", bias=2.0)], set()),
    "low range and housing exchanged": (
        [fault("sensor-swapped", sensors=["striker-low", "housing"])],
        {"wiring.low_exchanged"},
    ),
}


@pytest.mark.parametrize("name", WIRED)
def test_the_drives_step_finds_wiring_and_inertia(name: str, tmp_path: Path) -> None:
    faults, wanted = WIRED[name]
    bench = bench_of({"motor": {"inertia_kg_m2": 4e-4}}, faults, 1)
    result = brought_up(bench, tmp_path / "out", "drive")
    assert result["passed"], result["steps"][-1]["reason"]
    found = result["parameters"]
    assert {one for one in found if one.startswith("wiring.")} == wanted
    assert found["motor.inertia_kg_m2"]["low"] < 4e-4 < found["motor.inertia_kg_m2"]["high"]
    assert 0.9 < found["motor.inertia_kg_m2"]["value"] / 4e-4 < 1.1
    assert beyond_bounds(bench, result["steps"]) == []
    assert bench.largest["drive"].force_n == 0.0


BROKEN = {
    "no watchdog": (*BROKEN_MODULES["no watchdog"][:2], "drive", "no watchdog"),
    "silent drive": (*BROKEN_MODULES["silent drive"][:2], "listen", "no frame DriveHeartbeat"),
    "slow encoder": ({"axis": {"encoder_s": 0.01}}, [], "listen", "encoder_msg_rate_ms"),
    "high range exchanged": (
        {},
        [fault("sensor-swapped", sensors=["striker-low", "striker-high"])],
        "at-rest",
        "Exchange their plugs",
    ),
    "low voltage": ({}, [fault("supply-sag", supply_v=14.0)], "at-rest", "14.0 V"),
    "jammed crank": ({}, [fault("motor-stall")], "drive", "does not move"),
    "stuck striker": (*BROKEN_MODULES["striker stuck"][:2], "below-impacts", "hardly moves"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_module_ends_the_step_that_sees_it_and_rests(name: str, tmp_path: Path) -> None:
    scene, faults, step, reason = BROKEN[name]
    bench = bench_of(scene, faults, 1)
    result = brought_up(bench, tmp_path / "out", "below-impacts")
    assert not result["passed"]
    assert result["steps"][-1]["name"] == step
    assert reason in result["steps"][-1]["reason"]
    assert beyond_bounds(bench, result["steps"]) == []
    assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.5


NO_HOLD = {
    "friction": ({"friction.mu": 0.12, "friction.b_n_s_m": 0.0}, "no impacts last"),
    "the fold": ({"friction.mu": 0.047, "friction.b_n_s_m": 0.0, "striker.mass_kg": 1.27}, "dead centre"),
    "nothing": ({}, ""),
}


@pytest.mark.parametrize("name", NO_HOLD)
def test_a_module_without_steady_impacts_there_is_refused_with_the_reason(name: str) -> None:
    changes, reason = NO_HOLD[name]
    found = explain_no_hold(with_overrides({**changes, "limit.force_n": 1000.0}), 1.25)
    assert reason in found
    assert bool(found) == bool(reason)


def test_a_campaign_samples_a_module_within_the_intervals_of_its_file(tmp_path: Path) -> None:
    found = {
        "striker.mass_kg": make_value("striker.mass_kg", 0.6, 0.6, 0.6),
        "limit.force_n": make_value("limit.force_n", 1000.0, 1000.0, 1000.0),
        "striker.spring_n_m": make_value("striker.spring_n_m", 90.0, 88.2, 91.8),
        "friction.mu": make_value("friction.mu", 0.02, 0.018, 0.022),
        "stop.position_m": make_value("stop.position_m", 0.178, 0.1779, 0.1782),
        "crank.zero_rad": make_value("crank.zero_rad", 2.0, 1.9, 2.1),
    }
    table = {"format": PARAMETERS, "parameters": {name: one._asdict() for name, one in found.items()}}
    path = tmp_path / "parameters.toml"
    path.write_text(tomli_w.dumps(table))
    plan = CAMPAIGNS["start-up"].plan(read_spread(path), 7)
    (cell, *others), numbers = plan.cells, plan.numbers
    assert {one.scene["friction"]["law"] for one in others} == {"coulomb"}
    assert (cell.scene["striker"]["mass_kg"], cell.firmware["striker"]["mass_kg"]) == (0.6, 0.6)
    assert "crank" not in cell.firmware
    assert numbers["mismatch_spring"] == pytest.approx(0.02)
    assert numbers["mismatch_dry_friction"] == pytest.approx(0.1)
    assert numbers["mismatch_stop_m"] == pytest.approx(0.0002)
    springs = [trial_of(plan, number).scenario.scene.striker.spring_n_m for number in range(40)]
    assert 88.2 <= min(springs) < 89.0
    assert 91.0 < max(springs) <= 91.8


def test_nothing_moves_without_a_yes_and_the_folder_is_resumed(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    refused = brought_up(bench, tmp_path / "out", "drive", agree=False)
    assert [one["passed"] for one in refused["steps"]] == [True, True, False]
    assert set(bench.largest.values()) == {NOTHING}
    listened = (tmp_path / "out" / "listen.log").stat().st_mtime_ns
    assert brought_up(bench, tmp_path / "out", "drive")["passed"]
    assert (tmp_path / "out" / "listen.log").stat().st_mtime_ns == listened
    assert "<svg" in (tmp_path / "out" / "bring-up.html").read_text()


def test_an_interruption_in_motion_is_an_e_stop_and_the_step_is_repeated(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    assert brought_up(bench, tmp_path / "out", "at-rest")["passed"]
    inner = bench.play

    def interrupted(player: Any, *others: Any) -> None:
        play = player.play

        def until_it_turns(tick: int, received: Any) -> Any:
            if tick > 2000 and abs(player.speed_rad_s) > 1.0:
                raise KeyboardInterrupt
            return play(tick, received)

        player.play = until_it_turns
        inner(player, *others)

    bench.play = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        brought_up(bench, tmp_path / "out", "drive")
    bench.play = inner  # type: ignore[method-assign]
    bench.rest(1.0)
    assert bench.plant.node.drive.axis.state == AxisState.IDLE
    assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.5
    assert brought_up(bench, tmp_path / "out", "drive")["passed"]
