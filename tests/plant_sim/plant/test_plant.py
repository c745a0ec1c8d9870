"""The plant tick by tick."""

import math
from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
from changed_scenes import HERTZ, KNOCK, SWING, TILT, changed
from reference import Reference, simulated_again

from plant_sim.plant import Plant, PlantError
from plant_sim.result import Phase
from plant_sim.scene import load_scene, read_scene
from plant_sim.sensors.sensing import NO_SENSING
from plant_sim.simulation import initial_state, simulate
from plant_sim.solvers.adaptive.state_layout import allocate
from plant_sim.solvers.cost import SolverError
from plant_sim.tick import MOST_IMPACTS

MOTOR = load_scene("gait-motor-soft")
WEARER = {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}
SHAKEN = {"harmonic": {"amplitude_m_s2": 1.0, "frequency_hz": 1.0}}


def torque_at(tick: int) -> float:
    """A torque that starts the crank and then wanders, N m."""
    return 0.05 + 0.02 * math.sin(0.013 * tick) + 0.01 * math.sin(0.17 * tick)


def test_ticks_of_recorded_torque_agree_with_scipy() -> None:
    plant, reference = Plant(MOTOR, seed=1), simulated_again(MOTOR, 0.0)
    for block in range(500):
        reference.run(5e-3 * (block + 1), torque_at(block))
        for _ in range(5):
            plant.advance(torque_at(block), 1e-3)
    assert len(plant.take_impacts()) == len(reference.impacts_t) > 2
    # Four impacts on, an orbit of this scene has grown an error some ten times.
    assert plant.state.x_m == pytest.approx(reference.x, abs=2e-8)
    assert plant.state.v_m_s == pytest.approx(reference.v, abs=2e-7)


def test_the_largest_forces_do_not_depend_on_where_in_a_tick_they_are() -> None:
    initial = {"x_m": 0.17, "v_m_s": 0.9}
    stop = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
    changes = {"stop": stop, "wearer": WEARER, "initial": initial, "solver.accuracy": 1e-10}
    scene = load_scene(changed("table1-viscous", changes))
    whole = simulate(scene, 0.06)
    for begin_s in np.arange(0.0, 1e-3, 5e-5):
        plant = Plant(scene, seed=1)
        for tick_s in (begin_s, *([1e-3] * 60)):
            plant.advance(0.0, tick_s)
        impact, *_ = plant.take_impacts()
        assert impact.peak_force_n == pytest.approx(whole.impacts.peak_force_n[0], rel=1e-9), begin_s
        assert plant.peak_felt_force_n == pytest.approx(whole.peak_felt_force_n, rel=1e-9), begin_s


HARD = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "stiffness": 1e9}
DQ = {"drive.model": "dq-motor", "winding": {"d_inductance_h": 0.25e-3, "q_inductance_h": 0.35e-3}}
WALK = {"gait": {"axis": "outward", "pace": [{"at_s": 0.0, "stride_hz": 0.9}]}}
WORN = {"wearer": WEARER}


@pytest.mark.parametrize(
    ("name", "changes", "until_s", "torque_n_m", "tick_s"),
    [
        ("gait-motor-soft", {}, 1.968, 0.05, 0.25e-3),
        ("gait-motor-soft", {}, 1.968, 0.05, 0.123),
        ("table1-viscous", {"drive.ratio": 1.0}, 5.0, 0.0, 1e-3),
        ("table1-viscous", {"drive.ratio": 1.0, "initial.v_m_s": 0.7, "stop": HARD}, 0.3, 0.0, 1e-3),
        ("gait-motor-soft", SWING | KNOCK | TILT | WORN | {"initial.v_m_s": 1.5}, 1.5, 0.05, 1e-3),
        ("gait-motor-soft", WALK | DQ | WORN, 1.968, 0.05, 1e-3),
        ("table1-motor-soft", DQ | {"motor.supply_v": 4.0}, 2.0, 0.25, 1e-3),
    ],
)
def test_a_run_does_not_depend_on_how_it_is_cut_into_ticks(
    name: str, changes: dict[str, Any], until_s: float, torque_n_m: float, tick_s: float
) -> None:
    scene = load_scene(changed(name, changes))
    whole, plant = simulate(scene, until_s, torque_n_m=torque_n_m), Plant(scene, seed=1)
    for _ in range(round(until_s / tick_s)):
        plant.advance(torque_n_m, tick_s)
    impacts = plant.take_impacts()
    assert len(impacts) == whole.impacts.t_s.size
    assert np.allclose([impact.t_s for impact in impacts], whole.impacts.t_s, rtol=0.0, atol=2e-9)
    peaks_n = [impact.peak_force_n for impact in impacts]
    assert np.allclose(peaks_n, whole.impacts.peak_force_n, rtol=1e-5, equal_nan=True)
    assert plant.t_s == pytest.approx(until_s, abs=1e-12)
    assert plant.state.phase == whole.final.phase
    assert plant.state.x_m == pytest.approx(whole.final.x_m, abs=1e-9)
    assert plant.state.crank_rad == pytest.approx(whole.final.crank_rad, abs=1e-7)
    assert astuple(plant.energy) == pytest.approx(astuple(whole.energy), abs=1e-8)
    if whole.peak_felt_force_n is not None:
        assert plant.peak_felt_force_n == pytest.approx(whole.peak_felt_force_n, rel=1e-6)
    if whole.electrical is not None:
        assert astuple(plant.electrical) == pytest.approx(astuple(whole.electrical), rel=1e-7)


def test_what_the_plant_shows_belongs_together() -> None:
    plant = Plant(MOTOR, seed=1)
    before = plant.state
    for tick in range(3000):
        plant.advance(torque_at(tick), 1e-3)
        now = plant.state
        if now.phase == Phase.FLIGHT == before.phase:
            assert plant.now.stop_force_n == 0.0
        if now.phase == Phase.CONTACT:
            assert plant.now.stop_force_n >= 0.0
            assert now.x_m >= 0.18 - 1e-12
        assert plant.now.motor_torque_n_m == pytest.approx(torque_at(tick), rel=1e-12)
        assert plant.now.current_a == pytest.approx(torque_at(tick) / 0.08, rel=1e-12)
        assert 0.0 <= now.crank_rad < 2.0 * math.pi
        before = now
    m, c, b, amplitude = 0.8, 505.0, 0.2, 0.012
    force = (
        c * (amplitude * math.sin(now.crank_rad) + 0.12 - now.x_m) - b * now.v_m_s - plant.now.stop_force_n
    )
    assert plant.now.accel_m_s2 == pytest.approx(force / m, rel=1e-12)
    assert plant.energy.drive_work_j > 1.0
    assert plant.energy.residual < 1e-9


def test_current_and_supply_limit_the_torque() -> None:
    plant = Plant(MOTOR, seed=1)
    plant.advance(5.0, 1e-3)
    assert plant.now.current_a == 10.0
    weak = Plant(load_scene(changed("gait-motor-soft", {"motor.supply_v": 2.0})), seed=1)
    for _ in range(2000):
        weak.advance(0.4, 1e-3)
    # At speed R i = V/√3 − K_t ω / 1.5; 0.4 N m would need 2 V of it at rest.
    back_emf_v = 0.08 * weak.state.omega_rad_s / 1.5
    assert weak.now.current_a == pytest.approx((2.0 / math.sqrt(3.0) - back_emf_v) / 0.4, rel=1e-12)
    assert weak.now.current_a < 5.0


@pytest.mark.parametrize(
    ("model", "limit_n_m", "low", "high"),
    [("motor", 0.06, 1.0, 1.15), ("motor", 0.15, 1.28, 1.32), ("dq-motor", 0.06, 1.0, 1.15)],
)
def test_a_weak_motor_stalls_below_the_speed_asked_for(
    model: str, limit_n_m: float, low: float, high: float
) -> None:
    """The Sommerfeld effect: near resonance the load takes all a weak motor can give."""
    changes = {"drive.model": model, "motor.current_limit_a": limit_n_m / 0.08, "sensors": None}
    scene = load_scene(changed("table1-motor-soft", changes))
    plant, natural, integral, speeds = Plant(scene, seed=1), scene.natural_rad_s, 0.0, []
    for tick in range(20000):
        error = 1.3 * natural * min(tick / 5000.0, 1.0) - plant.state.omega_rad_s
        integral = min(max(integral + 0.3 * error * 1e-3, -limit_n_m), limit_n_m)
        plant.advance(0.05 * error + integral, 1e-3)
        speeds.append(plant.state.omega_rad_s)
    assert low < float(np.mean(speeds[-5000:])) / natural < high


def test_a_striker_and_a_crank_set_off_at_once() -> None:
    """The torque turns the crank against the load by which it would have set off."""
    friction = {"law": "coulomb", "mu": 0.1, "b_n_s_m": 0.1}
    changes = {"friction": friction, "initial": {"x_m": 0.1, "v_m_s": 0.0}, "sensors": None}
    plant = Plant(load_scene(changed("gait-motor-soft", changes)), seed=0)
    reference = Reference(plant.parts, 0.1, 0.0, 0.0, 0.0)
    for _ in range(20):
        plant.advance(0.3, 1e-3)
    reference.run(0.02, 0.3)
    assert plant.state.x_m == pytest.approx(reference.x, abs=1e-9)
    assert plant.state.omega_rad_s == pytest.approx(reference.omega, abs=1e-7)


def test_torque_that_is_no_number_is_refused() -> None:
    plant = Plant(MOTOR, seed=1)
    for torque_n_m, dt_s in ((math.nan, 1e-3), (math.inf, 1e-3), (0.1, math.nan), (0.1, -1e-3)):
        with pytest.raises(PlantError, match="must be finite"):
            plant.advance(torque_n_m, dt_s)


def test_impacts_are_handed_out_once() -> None:
    plant = Plant(MOTOR, seed=1)
    taken = []
    for _ in range(3000):
        plant.advance(0.05, 1e-3)
        taken += plant.take_impacts()
    assert taken == sorted(taken)
    assert len(taken) == len({impact.t_s for impact in taken}) > 3
    assert all(impact.v_m_s > 0.0 > impact.v_after_m_s for impact in taken)
    assert plant.take_impacts() == []


@pytest.mark.parametrize(
    ("name", "changes", "state"),
    [
        # depth, velocity, work, friction | + loss | + loss, impulse | + crank angle and speed
        ("table1-viscous", {"stop": {"law": "none"}}, 4),
        ("table1-viscous", {}, 5),
        ("table1-viscous", {"stop": HERTZ}, 6),
        ("table1-motor-soft", {}, 8),
        # + currents, voltages of their loop, electrical work and loss
        ("table1-dq-motor", {}, 14),
        # a rod needs nothing; + work of a housing; + foot plate, its velocity, the ankle's loss
        ("table1-motor-soft", {"drive.rod_m": 0.1}, 8),
        ("table1-motor-soft", {"housing": {"tilt_rad": 0.1}}, 9),
        ("table1-motor-soft", {"wearer": WEARER}, 11),
        ("table1-motor-soft", {"wearer": WEARER, "housing": SHAKEN, "drive.rod_m": 0.1}, 12),
    ],
)
def test_the_places_are_those_of_the_parts_alone(name: str, changes: dict[str, Any], state: int) -> None:
    """Quantities of absent parts are neither integrated nor judged, and stay 0."""
    scene = load_scene(changed(name, changes))
    memory = allocate(scene.parts(), initial_state(scene), 1e-9, 1, NO_SENSING).memory[0]
    used = memory.places[: memory.progress.used]
    assert len(used) == state
    assert not np.any(np.delete(memory.all_y, used)[2:])  # an ideal drive's crank is not integrated


CHATTER = {
    "solver": {"method": "adaptive"},
    "friction": {"law": "none"},
    "stop": {"law": "rigid", "position_m": 0.07, "restitution": 0.9995},
    "initial": {"x_m": 0.06999, "v_m_s": 0.0},
    "drive": {"model": "motor", "amplitude_m": 0.02},
    "sensors": {},
}
"""It bounces over a preloaded stop for many seconds, more often than there is room for impacts."""
CHATTER_S = 20.0


def test_a_long_chatter_loses_no_impact() -> None:
    scene = load_scene({**read_scene("table1-viscous"), **CHATTER})
    plant = Plant(scene, seed=1)
    plant.advance(0.0, CHATTER_S)
    impacts = plant.take_impacts()
    assert len(impacts) > MOST_IMPACTS
    times_s = simulate(scene, until_s=CHATTER_S).impacts.t_s
    assert [one.t_s for one in impacts] == pytest.approx(times_s.tolist(), abs=1e-7)
    assert plant.t_s == CHATTER_S


def test_compiled_code_without_room_for_impacts_says_so() -> None:
    plant = Plant(load_scene({**read_scene("table1-viscous"), **CHATTER}), seed=1)
    status = plant._move(plant.run, 0.0, CHATTER_S)
    with pytest.raises(SolverError, match=rf"{MOST_IMPACTS:,} impacts at once at t = .*restitution"):
        plant.take_back(status)


def test_one_kernel_serves_every_scene() -> None:
    """Another combination of parts is advanced by the code that is already there."""
    stribeck = {"law": "stribeck", "mu": 0.15, "mu_s": 0.2, "v_s_m_s": 0.05, "delta": 1.0}
    kernels = {
        Plant(load_scene(changed("table1-viscous", changes)), seed=1)._move
        for changes in (
            {},
            {"friction": stribeck, "sensors": {}},
            {"stop": HERTZ, "drive.rod_m": 0.1, "wearer": WEARER},
            {"housing": SHAKEN},
            {"drive": {"model": "dq-motor", "amplitude_m": 0.02}},
        )
    }
    assert len(kernels) == 1
