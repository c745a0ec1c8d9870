"""The limits on an impact in whole runs: no clipped or lost reading switches one off."""

from pathlib import Path

import pytest

from firmware_py.shell.parameters import ParameterError
from hil.figures.figures import figures_of
from hil.figures.records import Figures
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.scenario.scenario import load_scenario
from hil.scenario.settings import Settings

WEAK_STOP = "a-violent-kick-into-a-weak-stop-stops-the-motor"
LIMITS = ("force-limit", "impulse-limit")
OFF_WITHIN_S = 0.05


def figures(scenario: str | Path, settings: Settings, out: Path) -> Figures:
    """The figures of a run."""
    run_dir = in_lockstep(Job(load_scenario(scenario, settings), 1, folder=out))
    return figures_of(run_dir)


def assert_motor_off(found: Figures) -> None:
    """A limit on impacts has ended the motion, and the motor is off soon after the kick."""
    assert found.fault in LIMITS
    assert found.after_fault.torque_zero_after_s is not None
    assert found.after_fault.torque_zero_after_s < OFF_WITHIN_S


@pytest.mark.parametrize(("mass_kg", "kick_m_s"), [(0.75, 5.0), (0.76, 5.0), (0.80, 8.0)])
def test_clipped_readings_do_not_hide_an_impact_from_the_highest_limits(
    mass_kg: float, kick_m_s: float, tmp_path: Path
) -> None:
    """A lighter striker than the nominal one, a kick that looks like a touch-down, three clipped readings."""
    settings = {
        "firmware.limit.force_n": 1500,
        "firmware.limit.impulse_n_s": 5,
        "scene.striker.mass_kg": mass_kg,
        "script.faults.0.at_s": 6.3,
        "script.faults.0.change_m_s": kick_m_s,
    }
    found = figures(WEAK_STOP, settings, tmp_path / "run")
    assert found.peak_force_n is not None
    assert found.peak_force_n > 1900.0
    assert_motor_off(found)


def test_a_force_limit_beyond_what_the_sensor_shows_is_refused() -> None:
    settings = {"firmware.limit.force_n": 1500, "firmware.striker.mass_kg": 0.75}
    with pytest.raises(ParameterError, match=r"exceeds the 1434.08 N that the high range shows"):
        load_scenario(WEAK_STOP, settings)


@pytest.mark.parametrize("lost_ms", [0, 4, 6, 8, 10, 12])
def test_a_lost_frame_does_not_hide_an_impact_after_a_kick(lost_ms: int, tmp_path: Path) -> None:
    """A kick of 3 m/s at 6.448 s, and one accelerometer frame lost a few milliseconds later."""
    scenario, lost_s = tmp_path / "kick.toml", 6.4475 + 1e-3 * lost_ms
    scenario.write_text(
        f"""
        like = "a-silent-encoder-stops-the-motor"
        title = "A kick of 3 m/s with a frame lost in its impact stops the motor"
        [script]
        duration_s = 8.0
        faults = [
            {{ kind = "kick", at_s = 6.448, change_m_s = 3.0 }},
            {{ kind = "dropped", frames = ["Accelerometer"], at_s = {lost_s}, duration_s = 0.001 }},
        ]
        """
    )
    found = figures(scenario, {}, tmp_path / "run")
    assert found.peak_force_n is not None
    assert found.peak_force_n > 1000.0
    assert_motor_off(found)
