"""The stop that takes the striker's energy: on the free swing, with a crank that has every speed at once."""

import math

import pytest

from firmware_py.core.control import spin_down
from firmware_py.core.control.spin_down import SpinDownStage
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.shell.parameters import config_from

CONFIG = config_from({"gait": {"follow": 1.0}})
AT_REST = estimator_state.striker_of(estimator_state.INITIAL)
NATURAL_RAD_S = CONFIG.nominal.natural_rad_s
MASS_KG, DAMPING_N_S_M = 0.8, 0.2
REST_M = CONFIG.p.striker.rest_length_m
TURNING = crank.INITIAL._replace(omega_rad_s=1.2 * NATURAL_RAD_S)
"""As fast as in the impact regime: no target of a stop is faster."""


def stopped(x_m: float, v_m_s: float, angle_rad: float, most_s: float = 3.0) -> list[tuple[float, ...]]:
    """A free striker and a crank that has every speed at once: (x, swing, angle, speed) tick by tick."""
    state, rows = spin_down.INITIAL, []
    for _ in range(round(most_s / CONFIG.tick_s)):
        state = spin_down.step(
            CONFIG.p,
            CONFIG.nominal,
            state,
            TURNING._replace(angle_rad=angle_rad),
            AT_REST._replace(x_m=x_m, v_m_s=v_m_s),
        )
        angle_rad = (angle_rad + state.target_omega_rad_s * CONFIG.tick_s) % (2.0 * math.pi)
        pull = REST_M + CONFIG.p.drive.amplitude_m * math.sin(angle_rad) - x_m
        v_m_s += (NATURAL_RAD_S**2 * pull - DAMPING_N_S_M / MASS_KG * v_m_s) * CONFIG.tick_s
        x_m += v_m_s * CONFIG.tick_s
        rows.append((x_m, state.swing_m, angle_rad, state.target_omega_rad_s, float(state.stage)))
    return rows


@pytest.mark.parametrize("angle_deg", range(90, 170, 15))
@pytest.mark.parametrize("v_m_s", [-0.4, -0.2])
def test_after_a_impact_the_striker_does_not_come_back_to_the_stop(angle_deg: int, v_m_s: float) -> None:
    rows = stopped(CONFIG.p.stop.position_m, v_m_s, math.radians(angle_deg))
    later = rows[round(0.3 / CONFIG.tick_s) :]
    assert max(row[0] for row in later) < CONFIG.p.stop.position_m
    assert later[-1][4] == SpinDownStage.PARK


def test_braking_takes_as_much_as_the_piston_s_pull_can() -> None:
    """P = c A R ω sin² ψ, π c A R in a swing: what a crank in step takes until the share is reached."""
    rows = stopped(REST_M - 0.09, 0.0, math.pi)
    reach_m = CONFIG.p.stop.position_m - REST_M + CONFIG.p.drive.amplitude_m
    braked = [row for row in rows if row[4] == SpinDownStage.BRAKE]
    assert braked[-1][1] == pytest.approx(CONFIG.p.spin_down.share * reach_m, abs=1e-3)
    swings = len(braked) * CONFIG.tick_s * NATURAL_RAD_S / (2.0 * math.pi)
    assert swings < 1.0


def test_the_crank_comes_to_rest_at_its_backward_dead_centre() -> None:
    for angle_rad in (0.3, 2.0, 4.6, 6.0):
        *_, last = stopped(CONFIG.p.stop.position_m, -0.3, angle_rad)
        assert last[2] == pytest.approx(1.5 * math.pi, abs=0.01)
        assert abs(last[3]) < 0.1


def test_braking_ends_whatever_the_striker_does() -> None:
    state = spin_down.INITIAL
    far = AT_REST._replace(x_m=CONFIG.p.stop.position_m, v_m_s=2.0)
    stages = []
    for _ in range(round(1.1 * spin_down.longest_s(CONFIG.p) / CONFIG.tick_s)):
        state = spin_down.step(CONFIG.p, CONFIG.nominal, state, crank.INITIAL, far)
        stages.append(state.stage)
    assert stages[0] == SpinDownStage.BRAKE
    assert stages.index(SpinDownStage.PARK) * CONFIG.tick_s == pytest.approx(
        spin_down.longest_s(CONFIG.p), abs=0.01
    )
    assert SpinDownStage.BRAKE not in stages[stages.index(SpinDownStage.PARK) :]


def test_an_estimate_that_is_no_number_parks_the_crank() -> None:
    lost = AT_REST._replace(x_m=math.nan, v_m_s=math.nan)
    state = spin_down.step(CONFIG.p, CONFIG.nominal, spin_down.INITIAL, crank.INITIAL, lost)
    assert state.stage == SpinDownStage.PARK
    assert abs(state.target_omega_rad_s) <= NATURAL_RAD_S


def test_speeds_stay_below_the_limit() -> None:
    for x_m in (REST_M - 0.1, REST_M, CONFIG.p.stop.position_m):
        for v_m_s in (-1.0, 0.0, 1.0):
            for degree in range(0, 360, 10):
                state = spin_down.step(
                    CONFIG.p,
                    CONFIG.nominal,
                    spin_down.INITIAL,
                    TURNING._replace(angle_rad=math.radians(degree)),
                    AT_REST._replace(x_m=x_m, v_m_s=v_m_s),
                )
                assert -NATURAL_RAD_S <= state.target_omega_rad_s <= 1.2 * NATURAL_RAD_S


def test_only_where_a_gait_is_followed() -> None:
    assert spin_down.longest_s(config_from({}).p) == 0.0
    assert spin_down.longest_s(CONFIG.p) == 2.0
