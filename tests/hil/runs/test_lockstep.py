"""Lockstep with the real plant and the real firmware: order of time, determinism, verdicts."""

from pathlib import Path

import numpy as np
import pytest

from firmware_py.shell.builds import Build
from hil.figures.figures import figures_of
from hil.record.traces import trace
from hil.runs import recording
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.runs.segments import Segment
from hil.scenario.files import read_scenario
from hil.scenario.scenario import Scenario, check_scenario, load_scenario
from hil.scenario.settings import apply_settings

MEASURED = ("wake_latency_us", "work_us")
"""The only columns that a second run of the same seed may change: they are of this machine."""

QUICK = [
    "script.duration_s=3.0",
    'script.commands=[{at_s=0.2,request="run",target_ratio=1.1},{at_s=2.5,request="idle"}]',
    "firmware.start.rise_s=1.0",
]


def run(scenario: Scenario, run_dir: Path, seed: int = 1, build: Build = "compiled") -> Path:
    return in_lockstep(Job(scenario, seed, build, run_dir))


@pytest.fixture(scope="module")
def quick_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return run(load_scenario("soft-start-multistable", QUICK), tmp_path_factory.mktemp("quick"))


def test_same_seed_gives_the_same_bytes(quick_run: Path, tmp_path: Path) -> None:
    again = run(load_scenario("soft-start-multistable", QUICK), tmp_path)
    assert (again / "can.log").read_bytes() == (quick_run / "can.log").read_bytes()
    for name in ("plant", "impacts", "operator", "firmware"):
        one, other = trace.read(quick_run / f"{name}.trace"), trace.read(again / f"{name}.trace")
        assert len(one) == len(other) > 0
        for column in one.dtype.names or ():
            if column not in MEASURED:
                np.testing.assert_array_equal(one[column], other[column], err_msg=f"{name}: {column}")


def test_what_the_firmware_makes_of_a_gait_is_recorded_where_a_scene_has_one(
    quick_run: Path, tmp_path: Path
) -> None:
    walk = run(
        load_scenario(
            "a-steady-walk-has-a-pulse-in-every-push-off", ["script.duration_s=0.2", "script.commands=[]"]
        ),
        tmp_path,
    )
    standing, walking = (
        trace.read(folder / "firmware.trace").dtype.names or () for folder in (quick_run, walk)
    )
    more = set(walking) - set(standing)
    assert {"state.gait.phase", "state.gait_lock.harmonic"} <= more
    assert {name.split(".")[1] for name in more} == {"gait", "gait_lock"}
    assert set(standing) < set(walking)


def test_a_process_is_warmed_up_once_for_each_scene_and_build(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    runs: list[tuple[str, object]] = []

    def noted(job: Job) -> list[Segment]:
        runs.append((job.scenario.name, job.firmware))
        return []

    monkeypatch.setattr(recording, "segments", noted)
    monkeypatch.setattr(recording, "WARM", [])
    soft, gait = "soft-start-multistable", "a-steady-walk-has-a-pulse-in-every-push-off"
    for name in (soft, soft, gait):
        recording.warm_lockstep(Job(load_scenario(name, QUICK), 1, "python"))
    recording.warm_lockstep(Job(load_scenario(soft), 1))
    assert runs == [(soft, "python"), (gait, "python"), (soft, "compiled")]


def test_another_seed_gives_other_noise(quick_run: Path, tmp_path: Path) -> None:
    other = run(load_scenario("soft-start-multistable", QUICK), tmp_path, seed=2)
    assert (other / "can.log").read_bytes() != (quick_run / "can.log").read_bytes()


def test_firmware_sees_the_state_of_its_own_tick(quick_run: Path) -> None:
    plant, firmware = trace.read(quick_run / "plant.trace"), trace.read(quick_run / "firmware.trace")
    np.testing.assert_array_equal(plant["tick"], np.arange(3000))
    np.testing.assert_array_equal(firmware["tick"], np.arange(3000))
    np.testing.assert_allclose(firmware["t_s"] - plant["t_s"], 0.5e-3, atol=1e-12)
    sensed = firmware["inputs.encoder.position_rev"] - plant["encoder_position_rev"]
    assert np.max(np.abs((sensed + 0.5) % 1.0 - 0.5)) < 1e-6
    assert set(firmware["inputs.accelerometer.age_ticks"]) == {0}


def test_torque_acts_from_the_next_tick(quick_run: Path) -> None:
    plant, firmware = trace.read(quick_run / "plant.trace"), trace.read(quick_run / "firmware.trace")
    driving = np.flatnonzero(plant["axis_state"] == 8)
    assert len(driving) > 1000
    late = driving[10:]
    np.testing.assert_allclose(
        plant["torque_command_n_m"][late], firmware["outputs.torque_n_m"][late - 1], atol=1e-6
    )


def test_can_log_has_each_frame_at_its_time(quick_run: Path) -> None:
    lines = (quick_run / "can.log").read_text().splitlines()
    stamps = [float(line[1 : line.index(")")]) for line in lines]
    assert stamps == sorted(stamps)
    accelerometer = [stamp for stamp, line in zip(stamps, lines, strict=True) if " 028#" in line]
    np.testing.assert_allclose(accelerometer, np.arange(3000) * 1e-3, atol=1e-9)
    torque = [stamp for stamp, line in zip(stamps, lines, strict=True) if " 00E#" in line]
    np.testing.assert_allclose(torque, np.arange(3000) * 1e-3 + 0.5e-3, atol=1e-9)


@pytest.mark.parametrize("tick_s", [0.00025, 0.004])
def test_other_control_periods_run_the_same_physics(tick_s: float, tmp_path: Path) -> None:
    scenario = load_scenario("soft-start-multistable", [*QUICK, f"firmware.control.tick_s={tick_s}"])
    run_dir = run(scenario, tmp_path)
    plant = trace.read(run_dir / "plant.trace")
    assert len(plant) == round(3.0 / tick_s)
    assert plant["t_s"][-1] == pytest.approx(3.0 - tick_s)
    rising = plant["omega_rad_s"][np.searchsorted(plant["t_s"], 2.3)]
    assert rising == pytest.approx(1.1 * 9.354, rel=0.02)


def test_at_1_mbit_s_no_sample_is_late(tmp_path: Path) -> None:
    document = apply_settings(read_scenario("soft-start-multistable"), ["script.duration_s=4.0", QUICK[1]])
    scenario = check_scenario({**document, "bus": {"bitrate": 1_000_000}}, "modelled")
    run_dir = run(scenario, tmp_path)
    plant, firmware = trace.read(run_dir / "plant.trace"), trace.read(run_dir / "firmware.trace")
    assert set(firmware["inputs.accelerometer.age_ticks"]) == {0}
    assert np.max(np.abs(firmware["inputs.accelerometer.low_m_s2"] - plant["striker_low_m_s2"])) < 0.01
    bus = figures_of(run_dir)
    assert bus.log.frames_unsent == 0
    assert bus.bus_load is not None
    assert 0.35 < bus.bus_load < 0.6


def test_at_250_kbit_s_samples_are_late(tmp_path: Path) -> None:
    document = apply_settings(read_scenario("soft-start-multistable"), QUICK)
    scenario = check_scenario({**document, "bus": {"bitrate": 250_000}}, "modelled")
    firmware = trace.read(run(scenario, tmp_path) / "firmware.trace")
    assert max(firmware["inputs.accelerometer.age_ticks"][10:]) > 0
