"""The monitors' own crank: no tuning parameter, inertia or reading hides a jam under the largest torque."""

import math
from typing import Any

import pytest
from closed_loop import Bench, scene_with
from records import HEALTHY, replaced

from firmware_py.core.estimation import crank
from firmware_py.core.inputs import Inputs
from firmware_py.core.safety import monitors, own_crank
from firmware_py.core.safety.own_crank import OwnCrank
from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.parameters import config_from
from hil.scenario.scenario import load_scenario
from plant_sim.parts.drive import MotorDrive
from tools.campaign.run import run

CONFIG = config_from({})
QUICK_MODULE = {"striker.spring_n_m": 720.0, "drive.amplitude_m": 0.0065, "start.highest_ratio": 0.66}


def step(state: OwnCrank, inputs: Inputs, acting_n_m: float, touching: bool) -> OwnCrank:
    turned = crank.read(CONFIG.crank, inputs.encoder)
    return own_crank.step(CONFIG.own_crank, state, inputs.accelerometer, turned, acting_n_m, touching)


def jam(bench: Bench) -> None:
    """More dry friction than any torque overcomes."""
    drive = bench.plant.parts.drive
    assert isinstance(drive, MotorDrive)
    bench.plant.replace_parts(bench.plant.parts._replace(drive=drive._replace(dry_n_m=10.0)))


@pytest.mark.parametrize(
    ("parameters", "inertia_kg_m2"),
    [
        ({}, 5e-4),
        ({"crank.largest_disturbance_rad_s2": 0.0}, 5e-4),
        ({"crank.largest_disturbance_rad_s2": 250.0}, 5e-4),
        ({"crank.bandwidth_rad_s": 1.0}, 5e-4),
        ({"crank.bandwidth_rad_s": 3.0}, 5e-4),
        ({"speed.load_share": 0.0}, 5e-4),
        ({"estimator.model_memory_s": 0.1, "estimator.gate_sigmas": 2.0}, 5e-4),
        ({"motor.inertia_kg_m2": 9e-5, "speed.gain_p_n_m_s": 0.009, "speed.gain_i_n_m": 0.14}, 9e-5),
    ],
)
@pytest.mark.requirement("S-01")
def test_a_jam_is_found_in_a_tenth_of_a_second_of_torque(
    parameters: dict[str, Any], inertia_kg_m2: float
) -> None:
    bench = Bench(
        {"start.rise_s": 1.0, **parameters}, scene_with(motor={"inertia_kg_m2": inertia_kg_m2})
    ).started()
    bench.ratio = 1.1
    bench.run(3.0, keep=False)
    jam(bench)
    pushed_ticks = 0
    for _ in range(3000):
        bench.run(1e-3, keep=False)
        pushed_ticks += abs(bench.torque_n_m) > 0.5
        if bench.mode == Mode.FAULT:
            break
    assert bench.node.outputs.fault in (Fault.LOAD_IMPLAUSIBLE, Fault.STALL)
    assert pushed_ticks <= 100


def test_the_load_is_read_in_flight_and_explains_a_share_of_the_torque() -> None:
    """0.8 kg · 5 m/s² · 0.02 m · cos θ, at most 0.28 N m by the longest stretch."""
    turning = OwnCrank(own_crank.INITIAL.tracked._replace(omega_rad_s=12.0, missed_ticks=0), 5.0)
    read = replaced(HEALTHY, "accelerometer.low_m_s2", 4.9)
    assert step(turning, read, 0.0, False).pull_m_s2 == pytest.approx(4.9)
    for kept, touching in ((read, True), (replaced(read, "accelerometer.age_ticks", 1), False)):
        assert step(turning, kept, 0.0, touching).pull_m_s2 == 5.0
    for pull_m_s2, load_n_m in ((5.0, 0.08), (-5.0, -0.08), (100.0, 0.28), (math.nan, 0.0)):
        inputs = replaced(HEALTHY, "encoder.age_ticks", 5)  # the prediction alone
        moved = step(turning._replace(pull_m_s2=pull_m_s2), inputs, 0.1, True)
        torque_n_m = 0.1 - 12.0 * 1e-4 - 0.005 - load_n_m
        assert moved.tracked.omega_rad_s == pytest.approx(12.0 + 1e-3 * torque_n_m / 5e-4, abs=1e-4)
    # The middle of the tick decides which way the load acts.
    late = turning.tracked._replace(angle_rad=0.5 * math.pi - 0.5e-3 * 12.0)
    moved = step(OwnCrank(late, 5.0), replaced(HEALTHY, "encoder.age_ticks", 5), 0.1, True)
    assert moved.tracked.omega_rad_s == pytest.approx(12.0 + 1e-3 * (0.1 - 0.0062) / 5e-4, abs=1e-6)


@pytest.mark.parametrize("low_m_s2", [-100.0, 100.0, math.nan])
def test_readings_of_a_contact_that_is_not_seen_yet_hardly_count(low_m_s2: float) -> None:
    pulled = OwnCrank(own_crank.INITIAL.tracked._replace(omega_rad_s=12.0, missed_ticks=0), 5.0)
    for _ in range(3):
        inputs = replaced(HEALTHY, "accelerometer.low_m_s2", low_m_s2)
        pulled = step(pulled, inputs, 0.0, False)
    assert abs(pulled.pull_m_s2 - 5.0) <= 0.001 + 3.0 * 1e-3 * CONFIG.gate.flight_m_s3 < 1.0


def test_a_soft_contact_late_in_the_turn_is_no_implausible_load() -> None:
    """Two readings of the stop counted as the spring's pull, which was then taken as the load for 30 ms."""
    module = {"striker.spring_n_m": 69.13688, "friction.b_n_s_m": 0.244134, "drive.phase_rad": 3.239966}
    bias = {"sensors.striker_low.bias_m_s2": -0.4773364}
    settings = [f"scene.{name}={value}" for name, value in (module | bias).items()]
    seen = run(load_scenario("a-walker-who-stops-gets-no-more-pulses", settings), 1)
    assert {change.fault for change in seen.modes} == {Fault.NONE}


@pytest.mark.parametrize("parameters", [{}, {"motor.inertia_kg_m2": 1e-7}, QUICK_MODULE])
def test_the_monitor_can_act_with_every_module(parameters: dict[str, float]) -> None:
    """Beyond its limit the tracker is not clamped, and the largest load leaves more than the limit."""
    config = config_from(parameters)
    torque_n_m, inertia_kg_m2 = config.p.speed.torque_limit_n_m, config.p.motor.inertia_kg_m2
    assert config.own_crank.crank.tracker.largest_rad_s2 > 1.3 * config.monitors.implausible_rad_s2
    left_n_m = torque_n_m - config.own_crank.largest_load_n_m
    assert left_n_m / inertia_kg_m2 > 1.1 * config.monitors.implausible_rad_s2
    assert own_crank.LOAD_SHARE + monitors.IMPLAUSIBLE_SHARE < 1.0
    assert config.own_crank.crank.tracker.bandwidth_rad_s == 200.0
