"""What a soft stop is made of, held to plain integrations of one impact."""

import math

import pytest
from scipy.integrate import solve_ivp

from plant_sim.parts.restitution import (
    HERTZ_EXPONENT,
    hertz_stiffness,
    hunt_crossley_dissipation,
    kelvin_voigt_damping,
    linear_stiffness,
)

MASS_KG = 0.8


def one_impact(force, speed: float, ends) -> tuple[float, float]:
    """Rebound speed and duration of a free mass that meets `force(depth, v)`, until `ends` falls to 0."""

    def done(_, y):
        return ends(*y)

    done.terminal, done.direction = True, -1.0  # type: ignore[attr-defined]
    solution = solve_ivp(
        lambda _, y: [y[1], -force(*y) / MASS_KG],
        (0.0, 10.0),
        [1e-300, speed],
        events=done,
        method="DOP853",
        rtol=1e-12,
        atol=1e-15,
    )
    return -float(solution.y[1, -1]), float(solution.t[-1])


@pytest.mark.parametrize("exponent", [1.0, HERTZ_EXPONENT, 2.0])
@pytest.mark.parametrize("restitution", [0.02, 0.4, 0.5, 0.6, 0.95, 0.9999])
@pytest.mark.parametrize("speed", [0.05, 2.0])
def test_hunt_crossley_returns_the_wanted_share_at_any_speed(
    restitution: float, speed: float, exponent: float
) -> None:
    damping = hunt_crossley_dissipation(restitution) / speed
    rebound, _ = one_impact(
        lambda x, v: 1e6 * max(x, 0.0) ** exponent * (1.0 + damping * v), speed, lambda x, v: x
    )
    assert rebound / speed == pytest.approx(restitution, rel=1e-9)


def test_hunt_crossley_between_elastic_and_plastic() -> None:
    assert hunt_crossley_dissipation(1.0) == 0.0
    assert hunt_crossley_dissipation(1.0 - 1e-9) == pytest.approx(1.5e-9, rel=1e-6)
    assert hunt_crossley_dissipation(0.01) == pytest.approx(100.0, rel=1e-12)


@pytest.mark.parametrize("restitution", [0.02, 0.5, 0.95])
def test_kelvin_voigt_returns_the_wanted_share(restitution: float) -> None:
    stiffness = 1e5
    damping = kelvin_voigt_damping(MASS_KG, stiffness, restitution)
    rebound, _ = one_impact(
        lambda x, v: stiffness * x + damping * v, 0.9, lambda x, v: stiffness * x + damping * v
    )
    assert rebound / 0.9 == pytest.approx(restitution, rel=1e-9)


def test_kelvin_voigt_without_loss() -> None:
    assert kelvin_voigt_damping(MASS_KG, 1e5, 1.0) == 0.0


def test_contact_times_without_loss() -> None:
    hertz = hertz_stiffness(MASS_KG, 0.01, 0.9)
    _, duration = one_impact(lambda x, v: hertz * max(x, 0.0) ** 1.5, 0.9, lambda x, v: x)
    assert duration == pytest.approx(0.01, rel=1e-9)
    # Five times the speed: the contact is shorter by the fifth root, as Hertz has it.
    _, quicker = one_impact(lambda x, v: hertz * max(x, 0.0) ** 1.5, 4.5, lambda x, v: x)
    assert quicker == pytest.approx(0.01 / 5.0**0.2, rel=1e-9)
    linear = linear_stiffness(MASS_KG, 0.01)
    _, duration = one_impact(lambda x, v: linear * x, 0.9, lambda x, v: x)
    assert duration == pytest.approx(0.01, rel=1e-9)
    assert math.sqrt(linear / MASS_KG) == pytest.approx(math.pi / 0.01)
