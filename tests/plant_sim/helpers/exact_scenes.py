"""Scenes and starts for the tests of the exact solver and of time stepping."""

import math

import numpy as np
from exact_reference import LongDouble, Reference

from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.friction import Coulomb, NoFriction, Viscous
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.result import MotionState, Phase

MASS_KG, SPRING_N_PER_M, REST_M, GRAVITY_M_S2 = 0.8, 70.0, 0.12, 9.80665
NATURAL_RAD_S = math.sqrt(SPRING_N_PER_M / MASS_KG)
STOP = RigidStop(0.18, 0.5)

Friction = NoFriction | Viscous | Coulomb


def module(
    amplitude_m: float,
    ratio: float,
    friction: Friction,
    stop: RigidStop | NoStop = STOP,
    mass_kg: float = MASS_KG,
    rest_m: float = REST_M,
) -> Parts:
    """Table 1 of the paper with a drive at `ratio` times the striker's own frequency."""
    striker = Striker(mass_kg, SPRING_N_PER_M, rest_m, GRAVITY_M_S2)
    omega = ratio * math.sqrt(SPRING_N_PER_M / mass_kg)
    return Parts(striker, IdealDrive(amplitude_m, omega, 0.0), friction, stop)


def start(x_m: float = REST_M, v_m_s: float = 0.0, crank_rad: float = 0.0, t_s: float = 0.0) -> MotionState:
    return MotionState(t_s, x_m, v_m_s, crank_rad, 0.0, Phase.FLIGHT)


def random_module(rng: np.random.Generator) -> tuple[Parts, MotionState]:
    """A scene around Table 1 and a start before its stop; off resonance, where long doubles suffice."""
    ratio = rng.uniform(0.3, 2.5)
    if abs(ratio - 1.0) < 0.01:
        ratio = 1.01
    kind = rng.integers(4)
    if kind == 0:
        friction: Friction = NoFriction()
    elif kind == 1:
        friction = Viscous(rng.choice([0.01, 0.1, 0.3, 3.0, 20.0]))
    else:
        friction = Coulomb(rng.uniform(0.01, 0.35), rng.choice([0.0, 0.1, 2.0]))
    gap = rng.choice([0.06, rng.uniform(-0.03, 0.08), 0.0])
    stop = RigidStop(REST_M + gap, rng.choice([0.0, rng.uniform(0.0, 0.95), 0.5]))
    x = stop.position_m - rng.choice([0.0, rng.uniform(0.0, 0.15), rng.uniform(0.0, 0.15)])
    v = rng.choice([0.0, rng.uniform(-1.0, 1.0), rng.uniform(-1.0, 1.0)])
    return module(rng.uniform(0.005, 0.04), ratio, friction, stop), start(
        x, v, rng.uniform(0.0, 2.0 * math.pi)
    )


def reference_impacts(parts: Parts, initial: MotionState, until_s: float, least_m_s: float) -> np.ndarray:
    """Times and speeds of the impacts harder than `least_m_s`, shape (n, 2), in long doubles."""
    reference = Reference(parts, LongDouble)
    y = min(np.longdouble(initial.x_m) - np.longdouble(parts.striker.rest_length_m), reference.gap)
    impacts = reference.run(y, initial.v_m_s, initial.crank_rad, until_s)
    return np.array([(float(b.t_s), float(b.v_m_s)) for b in impacts if b.v_m_s > least_m_s]).reshape(-1, 2)
