"""The optimum that the search finds equals a closed form: the hardest first impact after a kick."""

import numpy as np
import pytest
from scipy.optimize import brentq, minimize

from hil.scenario.scenario import load_scenario
from tools.falsify.evaluations import Evaluations, runner
from tools.falsify.search import EndedError, Hunt, adapt, start_of, targets_of
from tools.falsify.space_of_scenario import space_of

RATIO, LARGEST_M_S, LIMIT_M_S, FROM_S = 1.1, 0.5, 5.0, 5.3
SCENARIO = f"""
title = "No kick makes the first impact harder than this"
like = "quick-start-below-the-band"
scene = {{ stop = {{ law = "rigid", position_m = 0.18, restitution = 0.5 }} }}
checks = [{{ name = "largest_v_m_s", high = {LIMIT_M_S} }}]
script.duration_s = 6.6
script.commands = [{{ at_s = 0.05, request = "run", target_ratio = {RATIO} }}]
script.faults = [{{ kind = "kick", at_s = {FROM_S}, change_m_s = 0.1 }}]
search = [
    {{ key = "script.faults.0.at_s", low = {FROM_S}, high = 5.92 }},
    {{ key = "script.faults.0.change_m_s", low = -{LARGEST_M_S}, high = {LARGEST_M_S} }},
]
"""


class Flight:
    """m x″ + b x′ + c (x − l0 − A cos Ωt) = 0 in closed form, between impacts on a rigid stop."""

    def __init__(self) -> None:
        scene = load_scenario("a-rigid-stop-keeps-the-impacts").scene
        m, c, b = scene.striker.mass_kg, scene.striker.spring_n_m, scene.friction.b_n_s_m
        self.gap_m = scene.stop.position_m - scene.striker.rest_length_m
        self.k, natural = scene.stop.restitution, np.sqrt(c / m)
        self.omega, self.decay = RATIO * natural, 0.5 * b / m
        self.damped = np.sqrt(natural**2 - self.decay**2)
        self.forced = (
            scene.drive.amplitude_m * natural**2 / (natural**2 - self.omega**2 + 2j * self.decay * self.omega)
        )

    def state(self, t_s, at_s, x, v):
        """Position beyond l0 and velocity at `t_s`, from x and v at `at_s`."""
        turn = np.exp(1j * self.omega * np.array([at_s, t_s]))
        free, speed = x - (self.forced * turn[0]).real, v - (1j * self.omega * self.forced * turn[0]).real
        root = complex(-self.decay, self.damped)
        amplitude = complex(free, -(speed + self.decay * free) / self.damped)
        left = amplitude * np.exp(root * (t_s - at_s))
        return (
            left.real + (self.forced * turn[1]).real,
            (root * left).real + (1j * self.omega * self.forced * turn[1]).real,
        )

    def next_impact(self, at_s, x, v):
        """Time and approach speed of the next impact; NaN without one in three periods."""
        for t_s in np.arange(at_s + 1e-3, at_s + 6.0 * np.pi / self.omega, 5e-3):
            if self.state(t_s, at_s, x, v)[0] >= self.gap_m:
                hit_s = brentq(
                    lambda t: self.state(t, at_s, x, v)[0] - self.gap_m, max(t_s - 5e-3, at_s), t_s
                )
                return hit_s, self.state(hit_s, at_s, x, v)[1]
        return np.nan, np.nan


def hardest_after_a_kick() -> float:
    """The largest approach speed of the first impact after a kick, over its size and its phase."""
    flight = Flight()
    at_s, v = 0.0, 0.6
    for _ in range(60):  # to the orbit
        at_s, v = flight.next_impact(at_s, flight.gap_m, -flight.k * v)

    def speed(point):
        since_s, kick = np.clip(point, [0.0, -LARGEST_M_S], [2.0 * np.pi / flight.omega, LARGEST_M_S])
        x, before = flight.state(at_s + since_s, at_s, flight.gap_m, -flight.k * v)
        if x > flight.gap_m:
            return 0.0
        return -np.nan_to_num(flight.next_impact(at_s + since_s, x, before + kick)[1])

    grid = [
        (s, kick) for s in np.linspace(1e-3, 0.605, 60) for kick in np.linspace(-LARGEST_M_S, LARGEST_M_S, 9)
    ]
    return -minimize(speed, min(grid, key=speed), method="Nelder-Mead").fun


def test_the_hardest_impact_after_a_kick_is_that_of_the_closed_form(tmp_path):
    path = tmp_path / "kick.toml"
    path.write_text(SCENARIO)
    space = space_of(str(path), [])
    run_task = runner([space])
    evaluations = Evaluations(tmp_path, lambda tasks: enumerate(map(run_task, tasks)), lambda *_: None)
    hunt = Hunt("CMA-ES", evaluations, 120)
    with pytest.raises(EndedError):
        adapt(hunt, targets_of(start_of(hunt, [space], 1))[0], 1)
    found_m_s = LIMIT_M_S * (1.0 - hunt.best.margin)
    assert found_m_s == pytest.approx(hardest_after_a_kick(), rel=0.01)
