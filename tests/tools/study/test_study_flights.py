"""Flights of given duration as if there were no stop: where they turn, and whether they stick there.

Their ends and derivatives are those of the orbits of `test_study_branches`, held to direct simulation.
"""

import math

import pytest

from plant_sim.scene import Scene, load_scene
from plant_sim.simulation import simulate
from tools.study.branches.flights import FlightEnd, fly

TURN_RAD = 2.0 * math.pi


def scene_of(law: str, value: float, ratio: float) -> Scene:
    coefficient = {"b_n_s_m": value} if law == "viscous" else {"mu": value}
    return load_scene(
        {
            "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
            "drive": {"model": "ideal", "amplitude_m": 0.03, "ratio": ratio, "phase_rad": 1.0},
            "friction": {"law": law, **coefficient},
            "initial": {"x_m": 0.18, "v_m_s": -0.2},
        }
    )


def flown(law: str, value: float, ratio: float, v_m_s: float, crank_rad: float, turns: float) -> FlightEnd:
    parts = scene_of(law, value, ratio).parts()
    duration_s = turns * TURN_RAD / parts.drive.omega_rad_s
    return fly(parts.striker, parts.drive, parts.friction, 0.06, v_m_s, crank_rad, duration_s)


@pytest.mark.parametrize(
    ("law", "value", "ratio", "v_m_s", "low", "high"),
    [
        ("coulomb", 0.2, 1.0, -0.45, -math.inf, 0.0),  # turns, and sticks
        ("coulomb", 0.1, 1.2, -0.3, 0.0, math.inf),  # turns without sticking
        ("viscous", 0.2, 1.3, -0.45, math.inf, math.inf),
    ],
)
def test_the_margin_says_whether_a_turn_sticks(
    law: str, value: float, ratio: float, v_m_s: float, low: float, high: float
) -> None:
    margin_m = flown(law, value, ratio, v_m_s, 2.0, 1.0).margin_m
    assert margin_m == low == high or low < margin_m < high


def test_the_highest_turning_point_is_that_of_the_samples() -> None:
    scene = scene_of("viscous", 0.0, 1.0)
    turn_s = TURN_RAD / scene.parts().drive.omega_rad_s
    sampled = simulate(scene, 2.3 * turn_s, samples_s=1e-4).samples
    assert sampled is not None
    highest = max(
        x
        for before, x, after in zip(sampled.x_m, sampled.x_m[1:], sampled.x_m[2:], strict=False)
        if before < x >= after
    )
    assert flown("viscous", 0.0, 1.0, -0.2, 1.0, 2.3).highest_m == pytest.approx(highest - 0.12, abs=1e-6)
