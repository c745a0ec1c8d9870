"""A motor with little torque under a plain speed controller: where the Sommerfeld effect holds it."""

import numpy as np

from plant_sim.plant import Plant
from plant_sim.scene import Scene


def mean_speed_ratio(scene: Scene, limit_n_m: float) -> float:
    """Mean crank speed over the natural frequency, after a run-up towards 1.3 with at most this torque."""
    plant, natural, integral, speeds = Plant(scene, seed=1), scene.natural_rad_s, 0.0, []
    for tick in range(20000):
        error = 1.3 * natural * min(tick / 5000.0, 1.0) - plant.state.omega_rad_s
        integral = min(max(integral + 0.3 * error * 1e-3, -limit_n_m), limit_n_m)
        plant.advance(0.05 * error + integral, 1e-3)
        speeds.append(plant.state.omega_rad_s)
    return float(np.mean(speeds[-5000:])) / natural
