"""What the tests of campaigns run in a worker, where the firmware is compiled."""

from typing import Any

import numpy as np


def closed_loop(scenario: str, settings: list[str], seed: int) -> dict[str, Any]:
    """The scenario's scene and parameters in a campaign's loop, on the noise of a bench of this seed."""
    from hil.scenario import load_scenario
    from tools.campaign.run import run

    loaded = load_scenario(scenario, settings)
    done = run(
        loaded.scene,
        loaded.config,
        loaded.commands,
        loaded.duration_s,
        np.random.default_rng(seed),
        traced=True,
        walk_seed=seed,
    )
    return {"impacts": done.impacts, "trace": done.trace}


def kicked(kick_m_s: float) -> Any:
    """A run's rows, of a module at rest whose striker is kicked at 0.2 s."""
    from firmware_py.shell.parameters import config_from
    from plant_sim.scene import load_scene
    from tools.campaign.run import UNDISTURBED, run

    plan = UNDISTURBED._replace(kick_tick=200, kick_m_s=kick_m_s)
    scene = load_scene("table1-motor-soft")
    return run(scene, config_from({}), [], 0.3, np.random.default_rng(1), plan, traced=True).trace


def dry_motion(settings: list[str], omega_rad_s: float, duration_s: float) -> tuple[Any, Any]:
    """Impacts of a led crank with dry friction by the campaign's plant, and by the adaptive solver."""
    from plant_sim.scene import load_scene
    from plant_sim.simulation import initial_state
    from plant_sim.solvers import adaptive
    from tools.campaign.cells import cells_of
    from tools.campaign.reference import alone, led

    cell = cells_of({"conditions": ((("coulomb",), (1.0,), (0.0,)),)}, settings)[0][0]
    scene = load_scene(cell.scene)
    start = initial_state(scene)
    quick = alone(scene, start, omega_rad_s, omega_rad_s, 0.0, duration_s)
    moving = type(start)(start.t_s, start.x_m, start.v_m_s, start.crank_rad, omega_rad_s, start.phase)
    exact = adaptive.simulate(led(scene.parts()), moving, duration_s).impacts
    return quick, np.column_stack([exact.t_s, exact.v_m_s, exact.v_after_m_s, exact.impulse_n_s])


def smallest_eigenvalues(seed: int) -> tuple[list[float], list[float]]:
    """Of random covariances as the estimator has them: by the campaign's function, and by LAPACK."""
    from tools.campaign.loop import least_eigenvalue

    interpreted: Any = least_eigenvalue
    rng = np.random.default_rng(seed)
    found, wanted = [], []
    for _ in range(200):
        scales = 10.0 ** rng.uniform(-5.0, 0.0, 3)
        root = rng.standard_normal((3, 3)) * scales[:, None]
        p = root @ root.T
        found.append(interpreted.py_func(p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]))
        wanted.append(np.linalg.eigvalsh(p)[0])
    return found, wanted


def indefinite() -> float:
    """The function's answer for a matrix that has lost its definiteness."""
    from tools.campaign.loop import least_eigenvalue

    interpreted: Any = least_eigenvalue
    return float(interpreted.py_func(1.0, 2.0, 0.0, 1.0, 0.0, 1.0))
