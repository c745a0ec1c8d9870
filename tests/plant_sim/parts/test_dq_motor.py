"""The motor in the rotor's frame: against motulator, closed forms and its own ledgers."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from changed_scenes import DELETE, changed
from motulator_drive import motulator_motion

from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.winding import DqWinding
from plant_sim.plant import Plant
from plant_sim.scene import Scene, load_scene
from plant_sim.sensors.sensing import NO_SENSING
from plant_sim.simulation import initial_state, simulate
from plant_sim.solvers.adaptive.adaptive import advance_by
from plant_sim.solvers.adaptive.state_layout import Run, allocate

SALIENT = {"d_inductance_h": 0.25e-3, "q_inductance_h": 0.35e-3}


def scene(changes: dict[str, Any], name: str = "table1-motor-soft") -> Scene:
    return load_scene(changed(name, {"drive.model": "dq-motor", "sensors": DELETE, **changes}))


def started(module: Scene, omega_rad_s: float = 0.0, accuracy: float = 1e-10) -> tuple[Parts, Run]:
    parts = module.parts()
    start = replace(initial_state(module), omega_rad_s=omega_rad_s)
    return parts, allocate(parts, start, accuracy, 64, NO_SENSING)


@pytest.mark.parametrize(
    ("changes", "torque_n_m", "spun_rad_s"),
    [
        # Locked by dry friction: no speed, no back-EMF.
        ({"motor.dry_n_m": 50.0}, 0.3, 0.0),
        # Spun by a flywheel that no torque slows, with and against the torque.
        ({"motor.inertia_kg_m2": 1e9, "motor.dry_n_m": 0.0}, 0.3, 100.0),
        ({"motor.inertia_kg_m2": 1e9, "motor.dry_n_m": 0.0}, -0.6, 100.0),
        # Free, with a step of torque.
        ({"motor.inertia_kg_m2": 5e-5, "motor.dry_n_m": 0.0}, 0.4, None),
        # Light and on a weak bus: it runs up until the back-EMF has used up the bus.
        ({"motor.inertia_kg_m2": 2e-5, "motor.supply_v": 6.0, "motor.dry_n_m": 0.0}, 0.6, None),
        # Spun so fast that the back-EMF alone is more than the bus: the current is driven backwards.
        (
            {"motor.inertia_kg_m2": 1e9, "motor.supply_v": 6.0, "motor.dry_n_m": 0.0},
            0.4,
            80.0,
        ),
    ],
)
def test_agrees_with_motulator(changes: dict[str, Any], torque_n_m: float, spun_rad_s: float | None) -> None:
    """Currents, speed and torque to 1e-9 of the largest: both integrate the same equations to rounding.

    motulator has them in the stator's frame with flux linkages, and knows of no crank.
    """
    module = scene({"drive.amplitude_m": 0.0, "winding": SALIENT, **changes})
    parts, one = started(module, spun_rad_s or 0.0, accuracy=1e-12)
    assert isinstance(parts.drive, MotorDrive)
    assert isinstance(parts.winding, DqWinding)
    times_s = np.linspace(0.0, 8e-3, 17)
    theirs = motulator_motion(parts.drive, parts.winding, torque_n_m, times_s, spun_rad_s)
    memory: Any = one.memory[0]
    ours, limited = [], False
    for t_s in times_s:
        advance_by(one, torque_n_m, 0.0, float(t_s))
        limited = limited or memory.mode.voltage_limited == 1
        i_d, i_q = memory.y.i_d_a, memory.y.i_q_a
        torque = 1.5 * parts.drive.pole_pairs * (0.08 / 10.5 + (0.25e-3 - 0.35e-3) * i_d) * i_q
        ours.append([i_d, i_q, memory.y.crank_rad_s, torque])
    for mine, reference in zip(np.array(ours).T, theirs, strict=True):
        assert np.max(np.abs(mine - reference)) <= 1e-9 * max(np.max(np.abs(reference)), 1.0)
    assert limited == (parts.drive.supply_v == 6.0)


def test_a_fast_loop_is_the_torque_mode_motor() -> None:
    """The difference falls as 1/α does, through a run-up with load and impacts."""
    wanted = simulate(load_scene(changed("gait-motor-soft", {"sensors": DELETE})), 2.0, torque_n_m=0.05)
    away = []
    for bandwidth in (1e3, 1e4):
        module = scene({"winding": {"bandwidth_rad_s": bandwidth}}, "gait-motor-soft")
        result = simulate(module, 2.0, torque_n_m=0.05)
        assert result.impacts.t_s.size == wanted.impacts.t_s.size > 0
        away.append(abs(result.impacts.t_s[0] - wanted.impacts.t_s[0]))
    assert away[0] == pytest.approx(10.0 * away[1], rel=0.1)
    # A torque that comes 1/α late brings an impact some 1/α late.
    assert away[0] == pytest.approx(1e-3, rel=0.2)


def test_the_ledgers_balance() -> None:
    """Mechanical and electrical, with a bus that limits now and then."""
    plant = Plant(scene({"winding": SALIENT, "motor.supply_v": 4.0}), seed=1)
    limited = 0
    for tick in range(4000):
        plant.advance(0.08 + 0.3 * math.sin(0.013 * tick) + 0.1 * math.sin(0.17 * tick), 1e-3)
        limited += int(plant._memory.mode.voltage_limited)
    assert 100 < limited < 3900
    assert plant.energy.drive_work_j > 1.0
    assert plant.energy.residual < 1e-9
    electrical = plant.electrical
    assert electrical is not None
    assert electrical.shaft_j == plant.energy.drive_work_j
    assert electrical.copper_j > 1.0
    assert electrical.residual < 1e-9


def test_a_crank_that_dry_friction_holds_breaks_away_as_the_current_comes() -> None:
    """K_t i*(1 − e^(−α t)) = dry loss at t = −ln(1 − dry/T*)/α."""
    plant = Plant(scene({"drive.amplitude_m": 0.0}), seed=1)
    away_s = -math.log1p(-5e-3 / 0.02) / 1000.0
    plant.advance(0.02, away_s * 0.999)
    assert plant.state.omega_rad_s == 0.0
    plant.advance(0.02, away_s * 0.002)
    late_s = away_s * 0.001
    # From there on J ω' = α T* e^(−α t) t, to the leading order.
    growth = 1000.0 * 0.02 * (1.0 - 5e-3 / 0.02) / 5e-4
    assert plant.state.omega_rad_s == pytest.approx(0.5 * growth * late_s**2, rel=1e-3)


@pytest.mark.parametrize(
    ("changes", "supply_v"),
    [
        ({"motor.inertia_kg_m2": 1e-9}, 24.0),
        ({"motor.inertia_kg_m2": 1e6}, 24.0),
        ({"motor.inductance_h": 1e-7}, 24.0),
        ({"motor.inductance_h": 0.1}, 24.0),
        ({"motor.resistance_ohm": 1e-6}, 24.0),
        ({"winding": {"bandwidth_rad_s": 1e5}}, 24.0),
        ({"winding": {"bandwidth_rad_s": 1.0}}, 24.0),
        ({"motor.current_limit_a": 0.5}, 24.0),
        # The bus sags under a turning motor, to next to nothing.
        ({}, 1.0),
        ({}, 1e-9),
    ],
)
def test_extremes_balance(changes: dict[str, Any], supply_v: float) -> None:
    """Next to no inertia, inductance, resistance, bandwidth or bus, and next to endless ones; back-driven."""
    plant = Plant(scene(changes), seed=1)
    for tick in range(100):
        if tick == 50:
            drive = plant.parts.drive
            assert isinstance(drive, MotorDrive)
            plant.replace_parts(plant.parts._replace(drive=drive._replace(supply_v=supply_v)))
        plant.advance(0.3 if tick < 75 else -0.3, 1e-3)
    assert math.isfinite(plant.now.omega_rad_s)
    assert abs(plant.now.current_a) <= plant.parts.drive.current_limit_a * (1.0 + 1e-6)
    assert plant.energy.residual < 1e-9
    assert plant.electrical is not None
    assert plant.electrical.residual < 1e-9


@pytest.mark.parametrize(("supply_v", "omega_rad_s"), [(2.0, 20.0), (2.0, -20.0), (6.0, 60.0), (24.0, 20.0)])
def test_a_motor_and_its_windings_have_one_voltage_limit(supply_v: float, omega_rad_s: float) -> None:
    """At a given speed they settle at the same current, but for the voltage across the inductance."""
    changes = {"motor.supply_v": supply_v, "motor.inertia_kg_m2": 1e9, "motor.inductance_h": 1e-6}
    currents_a = []
    for model in ("motor", "dq-motor"):
        module = scene({**changes, "drive.model": model})
        start = replace(initial_state(module), omega_rad_s=omega_rad_s)
        plant = Plant(module, seed=0, initial=start)
        plant.advance(0.8, 0.1)
        currents_a.append(plant.now.current_a)
    assert currents_a[0] == pytest.approx(currents_a[1], rel=1e-3)
