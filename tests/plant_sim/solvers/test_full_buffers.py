"""A buffer of a kernel that is full: nothing is written past its end, and no impact is lost."""

from typing import Any

import numpy as np
import pytest
from changed_scenes import HERTZ, changed

from plant_sim.plant import Plant
from plant_sim.scene import load_scene
from plant_sim.sensors.sensing import PULSES, allocate_filters, sense_jump
from plant_sim.simulation import simulate

CHATTER = {"stop": {"law": "rigid", "position_m": 0.12, "restitution": 0.8}, "drive.ratio": 0.3}


@pytest.mark.parametrize("room", [1, 2, 7])
@pytest.mark.parametrize(
    ("changes", "kick_m_s"),
    [({"stop": HERTZ}, -1.0), ({"stop": HERTZ | {"law": "kelvin-voigt"}}, -1.0), (CHATTER, 0.3)],
)
def test_impacts_wait_in_any_room(
    changes: dict[str, Any], kick_m_s: float, room: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Kicks end contacts between two steps, with the buffer as full as it gets."""
    found = []
    for most in (room, 1000):
        monkeypatch.setattr("plant_sim.plant.MOST_IMPACTS", most)
        plant = Plant(load_scene(changed("table1-viscous", changes | {"solver.method": "adaptive"})), seed=0)
        for tick in range(3000):
            plant.advance(0.0, 2e-3)
            assert plant.run.memory[0].mode.impacts <= most
            if plant.now.stop_force_n > 0.0 or tick % 100 == 99:
                plant.kick(kick_m_s)
            assert plant.run.memory[0].mode.impacts <= most
        found.append(plant.take_impacts())
    assert len(found[0]) > 8
    assert np.array(found[0]) == pytest.approx(np.array(found[1]), nan_ok=True)


def test_further_jumps_join_the_last_half_sine() -> None:
    probe = allocate_filters(3, 0.01)
    for _ in range(3 * PULSES):
        sense_jump(probe, 0.5)
    assert probe.active[0] == PULSES
    assert np.sum(probe.pulses) == pytest.approx(1.5 * PULSES)


@pytest.mark.parametrize("method", ["exact", "adaptive"])
def test_impacts_and_samples_of_a_long_run_fit(method: str) -> None:
    scene = load_scene(changed("table1-viscous", CHATTER | {"solver.method": method}))
    found = simulate(scene, 60.0, samples_s=0.01)
    assert len(found.impacts.t_s) > 1024
    assert found.samples is not None
    assert len(found.samples.t_s) == 6001
    assert np.all(np.diff(found.impacts.t_s) > 0.0)
