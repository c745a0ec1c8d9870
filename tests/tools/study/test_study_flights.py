"""Flights of given duration as if there were no stop: their ends against the solver, their derivatives."""

import math

import pytest

from plant_sim.scene import load_scene
from plant_sim.simulation import simulate
from tools.study.orbits.flights import FlightEnd, fly

TURN_RAD = 2.0 * math.pi
FLIGHTS = [
    ("viscous", 0.2, 1.3, 0.06, -0.45, 2.0, 1.0),
    ("viscous", 0.0, 1.0, 0.06, -0.2, 1.0, 2.3),
    ("coulomb", 0.2, 1.0, 0.06, -0.45, 2.0, 1.0),  # turns, and sticks before its end
    ("coulomb", 0.1, 1.2, 0.06, -0.3, 1.5, 0.9),  # turns without sticking
]


def flown(law: str, value: float, ratio: float, *flight: float) -> FlightEnd:
    y_m, v_m_s, crank_rad, turns = flight
    parts = tables(law, value, ratio).parts()
    duration_s = turns * TURN_RAD / parts.drive.omega_rad_s
    return fly(parts.striker, parts.drive, parts.friction, y_m, v_m_s, crank_rad, duration_s)


def tables(law: str, value: float, ratio: float, **initial: float):
    coefficient = {"b_n_s_m": value} if law == "viscous" else {"mu": value}
    return load_scene(
        {
            "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
            "drive": {
                "model": "ideal",
                "amplitude_m": 0.03,
                "ratio": ratio,
                "phase_rad": initial.pop("phase_rad", 0.0),
            },
            "friction": {"law": law, **coefficient},
            "initial": initial,
        }
    )


@pytest.mark.parametrize("flight", FLIGHTS)
def test_a_flight_ends_where_the_exact_solver_ends_without_a_stop(flight) -> None:
    law, value, ratio, y_m, v_m_s, crank_rad, turns = flight
    scene = tables(law, value, ratio, x_m=0.12 + y_m, v_m_s=v_m_s, phase_rad=crank_rad)
    final = simulate(scene, turns * TURN_RAD / scene.parts().drive.omega_rad_s).final
    end = flown(*flight)
    assert end.y_m == pytest.approx(final.x_m - 0.12, abs=1e-14)
    assert end.v_m_s == pytest.approx(final.v_m_s, abs=1e-13)


@pytest.mark.parametrize("flight", FLIGHTS)
def test_the_derivative_is_that_of_central_differences(flight) -> None:
    law, value, ratio, y_m, v_m_s, crank_rad, turns = flight
    end, h = flown(*flight), 1e-6
    ahead = flown(law, value, ratio, y_m + h, v_m_s, crank_rad, turns)
    behind = flown(law, value, ratio, y_m - h, v_m_s, crank_rad, turns)
    assert end.yy == pytest.approx((ahead.y_m - behind.y_m) / (2 * h), abs=1e-7)
    assert end.vy == pytest.approx((ahead.v_m_s - behind.v_m_s) / (2 * h), abs=1e-7)
    ahead = flown(law, value, ratio, y_m, v_m_s + h, crank_rad, turns)
    behind = flown(law, value, ratio, y_m, v_m_s - h, crank_rad, turns)
    assert end.yv == pytest.approx((ahead.y_m - behind.y_m) / (2 * h), abs=1e-7)
    assert end.vv == pytest.approx((ahead.v_m_s - behind.v_m_s) / (2 * h), abs=1e-7)


def test_a_striker_that_sticks_forgets_its_speed_exactly() -> None:
    end = flown("coulomb", 0.2, 1.0, 0.06, -0.45, 2.0, 0.5)
    assert end.margin_m < 0.0
    assert (end.v_m_s, end.vy, end.vv) == (0.0, 0.0, 0.0)


def test_the_margin_says_whether_a_turn_sticks() -> None:
    assert flown(*FLIGHTS[2]).margin_m < 0.0 < flown(*FLIGHTS[3]).margin_m < math.inf
    assert flown(*FLIGHTS[0]).margin_m == math.inf


def test_the_highest_turning_point_is_that_of_the_samples() -> None:
    scene = tables("viscous", 0.0, 1.0, x_m=0.18, v_m_s=-0.2, phase_rad=1.0)
    turn_s = TURN_RAD / scene.parts().drive.omega_rad_s
    sampled = simulate(scene, 2.3 * turn_s, samples_s=1e-4).samples
    assert sampled is not None
    highest = max(
        x
        for before, x, after in zip(sampled.x_m, sampled.x_m[1:], sampled.x_m[2:], strict=False)
        if before < x >= after
    )
    assert flown(*FLIGHTS[1]).highest_m == pytest.approx(highest - 0.12, abs=1e-6)
