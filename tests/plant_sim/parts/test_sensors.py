"""Readings: their filters, their noise, their limits, and that one seed gives one run."""

import math
from typing import Any

import numpy as np
import pytest
from changed_scenes import SWING, changed
from scipy import signal

from plant_sim.plant import Plant, PlantError
from plant_sim.scene import load_scene
from plant_sim.sensors.readings import Noise

G = 9.80665
QUIET = {"noise_m_s2_rthz": 0.0, "bias_m_s2": 0.0, "count_m_s2": 1e-9, "range_m_s2": 1e5}
SENSORS = {
    "striker_low": {**QUIET, "bandwidth_hz": 150.0},
    "striker_high": QUIET,
    "housing": QUIET,
    "encoder": {"noise_rad_s": 0.0},
}


SHAKEN = SWING | {"housing.shock": {"peak_m_s2": 30.0, "start_s": 0.2, "duration_s": 0.03}}


def plant_of(name: str, changes: dict[str, Any], seed: int = 1) -> Plant:
    return Plant(load_scene(changed(name, changes)), seed=seed)


def filtered(times: np.ndarray, values: np.ndarray, corner_hz: float) -> np.ndarray:
    """scipy's Butterworth of second order over finely sampled values."""
    system = signal.butter(2, 2.0 * math.pi * corner_hz, analog=True, output="ba")
    return signal.lsim(system, values, times)[1]


def test_noise_of_many_samples_is_that_of_single_ones() -> None:
    many, single = Noise(np.random.default_rng(5)), Noise(np.random.default_rng(5))
    found = [[many.next()], many.take(300), many.take(0), many.take(7), [many.next()]]
    wanted = [single.next() for _ in range(309)]
    np.testing.assert_array_equal(np.concatenate([np.reshape(one, (-1, 4)) for one in found]), wanted)


@pytest.mark.parametrize(("housing", "tolerance"), [({}, 1e-4), (SHAKEN, 2e-3)], ids=["still", "shaken"])
def test_low_passes_follow_the_true_acceleration(housing: dict[str, Any], tolerance: float) -> None:
    """Of striker and housing, by scipy's filter on the truth of the same run in ticks of 20 µs."""
    changes = {"sensors": SENSORS, "initial.v_m_s": 1.5, **housing}
    coarse, fine = plant_of("gait-motor-soft", changes), plant_of("gait-motor-soft", changes)
    readings, striker, carried = [], [0.0], [fine.housing_m_s2]
    for _ in range(600):
        coarse.advance(0.06, 1e-3)
        readings.append(coarse.sense())
        for _ in range(50):
            fine.advance(0.06, 2e-5)
            striker.append(fine.now.accel_m_s2 + fine.housing_m_s2)
            carried.append(fine.housing_m_s2)
    assert len(fine.take_impacts()) > 0
    times = 2e-5 * np.arange(len(striker))
    for corner_hz, truth, ours in (
        (150.0, striker, [reading.striker_low_m_s2 for reading in readings]),
        (400.0, striker, [reading.striker_high_m_s2 for reading in readings]),
        (400.0, carried, [reading.housing_m_s2 for reading in readings]),
    ):
        theirs = filtered(times, np.array(truth), corner_hz)[50::50]
        assert np.max(np.abs(np.array(ours) - theirs)) <= tolerance * np.max(np.abs(theirs))


def test_a_rigid_stop_is_read_as_a_half_sine_of_its_impulse() -> None:
    """Never as a jump: the area under the reading is (1 + k) v⁻, and it lasts the contact time."""
    sensors = {**SENSORS, "rigid_contact_s": 0.02}
    changes = {"sensors": sensors, "initial.x_m": 0.179, "initial.v_m_s": 0.5, "drive.amplitude_m": 0.0}
    plant = plant_of("table1-viscous", {**changes, "striker.spring_n_m": 1e-3, "friction.b_n_s_m": 0.0})
    readings = []
    for _ in range(800):
        plant.advance(0.0, 1e-4)
        readings.append(plant.sense().striker_high_m_s2)
    (impact,) = plant.take_impacts()
    jump = 1.5 * impact.v_m_s
    assert -np.sum(readings) * 1e-4 == pytest.approx(jump, rel=1e-3)
    times = 1e-4 * np.arange(1, 801)
    age = times - impact.t_s
    pulse = np.where((age > 0.0) & (age < 0.02), -jump * math.pi / 0.04 * np.sin(math.pi * age / 0.02), 0.0)
    expected = filtered(times, pulse, 400.0)
    assert np.max(np.abs(np.array(readings) - expected)) < 0.01 * np.max(np.abs(expected))


def test_a_chatter_of_many_half_sines_keeps_its_impulse() -> None:
    changes = {"sensors": SENSORS, "initial.x_m": 0.1795, "stop.restitution": 0.9, "drive.amplitude_m": 0.0}
    plant = plant_of("table1-viscous", {**changes, "striker.rest_length_m": 0.5})
    readings, impacts, speeds = [], [], []
    for _ in range(2000):
        plant.advance(0.0, 1e-4)
        readings.append(plant.sense().striker_high_m_s2)
        speeds.append(plant.state.v_m_s)
        impacts += plant.take_impacts()
    assert len(impacts) > 60
    # Over the whole run the readings add up to the change of velocity, as they must.
    assert np.sum(readings) * 1e-4 == pytest.approx(speeds[-1], abs=2e-3)


def test_noise_and_bias_have_their_size() -> None:
    plant = plant_of("table1-motor-soft", {})
    readings = np.array([plant.sense() for _ in range(20000)])
    bandwidth = math.pi / (2.0 * math.sqrt(2.0)) * 400.0
    for column, density, bias, count in (
        (0, 70e-6 * G, 0.02 * G, G / 2048.0),
        (1, 5e-3 * G, -0.2 * G, 0.049 * G),
        (2, 70e-6 * G, -0.01 * G, G / 2048.0),
    ):
        sigma = math.hypot(density * math.sqrt(bandwidth), count / math.sqrt(12.0))
        assert np.mean(readings[:, column]) == pytest.approx(
            bias, abs=5.0 * sigma / math.sqrt(20000) + 0.02 * count
        )
        assert np.std(readings[:, column]) == pytest.approx(sigma, rel=0.05)
        counts = readings[:, column] / count
        assert np.max(np.abs(counts - np.round(counts))) < 1e-9
    assert np.std(readings[:, 4]) == pytest.approx(0.02 / (2.0 * math.pi), rel=0.05)
    correlation = np.corrcoef(readings[:, [0, 1, 2, 4]].T) - np.eye(4)
    assert np.max(np.abs(correlation)) < 0.05


def test_readings_clip_in_counts_within_their_range() -> None:
    stiff = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.001}
    plant = plant_of("table1-motor-soft", {"stop": stiff, "initial.x_m": 0.17, "initial.v_m_s": 1.5})
    readings = []
    for _ in range(100):
        plant.advance(0.0, 2e-4)
        readings.append(plant.sense())
    assert min(reading.striker_low_m_s2 for reading in readings) == -32767 * G / 2048.0
    assert min(reading.striker_high_m_s2 for reading in readings) == -4081 * 0.049 * G


def test_the_encoder_is_circular_and_counts() -> None:
    plant = plant_of("table1-motor-soft", {"sensors": {"encoder": {"counts": 64, "noise_rad_s": 0.0}}})
    for _ in range(3000):
        plant.advance(0.05, 1e-3)
        reading = plant.sense()
        turn = plant.state.crank_rad / (2.0 * math.pi)
        assert 0.0 <= reading.encoder_position_rev < 1.0
        assert reading.encoder_position_rev <= turn < reading.encoder_position_rev + 1.0 / 64.0
        assert reading.encoder_position_rev * 64.0 == round(reading.encoder_position_rev * 64.0)
    assert reading.encoder_velocity_rev_s * 2.0 * math.pi == pytest.approx(plant.state.omega_rad_s, rel=0.01)


def test_one_seed_gives_one_run_and_another_seed_another() -> None:
    def run(seed: int) -> list[tuple[float, ...]]:
        plant, rows = plant_of("gait-motor-soft", {}, seed), []
        for _ in range(1000):
            plant.advance(0.06, 1e-3)
            rows.append((*plant.sense(), plant.state.x_m))
        return rows

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_noise_does_not_touch_the_motion() -> None:
    silent, noisy = plant_of("gait-motor-soft", {"sensors": SENSORS}, 1), plant_of("gait-motor-soft", {}, 2)
    for _ in range(1000):
        for plant in (silent, noisy):
            plant.advance(0.06, 1e-3)
            plant.sense()
    assert silent.state == noisy.state


def test_a_scene_without_sensors_says_so() -> None:
    with pytest.raises(PlantError, match=r"add the table \[sensors\]"):
        plant_of("table1-viscous", {}).sense()
