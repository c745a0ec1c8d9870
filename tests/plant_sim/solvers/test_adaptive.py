"""The adaptive solver against closed forms and against the exact solver; its accuracy, impacts and holds."""

import math
from dataclasses import astuple
from typing import Any

import numpy as np
import pytest
from changed_scenes import HERTZ, changed
from scipy.integrate import DOP853

from plant_sim.scene import Scene, load_scene
from plant_sim.simulation import simulate
from plant_sim.solvers.adaptive import dop853

ADAPTIVE = {"solver.method": "adaptive"}


def scene(name: str, changes: dict[str, Any]) -> Scene:
    return load_scene(changed(name, {**ADAPTIVE, **changes}))


@pytest.mark.parametrize(
    ("name", "changes"),
    [
        ("table1-viscous", {"drive.ratio": 1.0}),
        ("table1-viscous", {"stop.position_m": 0.11, "initial.x_m": 0.1, "drive.ratio": 0.3}),
        ("table1-viscous", {"stop.restitution": 0.0, "stop.position_m": 0.12, "drive.ratio": 0.5}),
        ("table1-viscous", {"initial.x_m": 0.18, "initial.v_m_s": 0.5}),
        ("table1-viscous", {"initial.x_m": 0.18, "initial.v_m_s": -0.5}),
        ("table1-coulomb", {}),
        ("table1-coulomb", {"drive.amplitude_m": 0.024}),
        ("table1-coulomb", {"stop.position_m": 0.11, "initial.x_m": 0.1, "drive.ratio": 0.3}),
        ("table1-coulomb", {"friction.b_n_s_m": 0.3, "initial.v_m_s": 0.7}),
        ("table1-viscous", {"housing.tilt_rad": -0.1, "drive.ratio": 1.0}),
    ],
)
def test_agrees_with_the_closed_forms(name: str, changes: dict[str, Any]) -> None:
    """Impact by impact above the chatter's last bounces, and the motion sample by sample."""
    exact = simulate(load_scene(changed(name, {**changes, "solver.method": "exact"})), 8.0, samples_s=0.01)
    adaptive = simulate(scene(name, changes), 8.0, samples_s=0.01)
    ours = adaptive.impacts.t_s[adaptive.impacts.v_m_s > 1e-6]
    theirs = exact.impacts.t_s[exact.impacts.v_m_s > 1e-6]
    assert ours.size == theirs.size
    assert np.max(np.abs(ours - theirs), initial=0.0) < 1e-7
    assert adaptive.samples is not None
    assert exact.samples is not None
    assert np.max(np.abs(adaptive.samples.x_m - exact.samples.x_m)) < 5e-9
    between = np.abs(adaptive.samples.t_s[:, None] - theirs).min(axis=1, initial=np.inf) > 1e-6
    assert np.max(np.abs(adaptive.samples.v_m_s - exact.samples.v_m_s)[between]) < 5e-8
    assert adaptive.final.phase == exact.final.phase
    ours_j, theirs_j = (astuple(result.energy) for result in (adaptive, exact))
    assert ours_j == pytest.approx(theirs_j, abs=1e-8)


@pytest.mark.requirement("P-13")
def test_a_soft_stop_gives_impulse_peak_and_restitution() -> None:
    """Light spring and drive beside the stop: the impact is the stop's own."""
    impacts = simulate(scene("table1-viscous", {"drive.ratio": 1.0, "stop": HERTZ}), 10.0).impacts
    steady = impacts.v_m_s > 0.3
    assert np.allclose(-impacts.v_after_m_s[steady] / impacts.v_m_s[steady], 0.5, atol=0.08)
    momentum = 0.8 * (impacts.v_m_s - impacts.v_after_m_s)
    assert np.allclose(impacts.impulse_n_s[steady], momentum[steady], rtol=0.12)
    # Against the peak π J / 2 T of a half-sine of the same impulse over the elastic contact time.
    ratio = impacts.peak_force_n[steady] / (math.pi * impacts.impulse_n_s[steady] / (2.0 * 0.01))
    assert np.all((ratio > 1.1) & (ratio < 1.6))


def test_samples_do_not_change_the_run() -> None:
    module = scene("table1-viscous", {"drive.ratio": 1.0})
    bare, fine = simulate(module, 5.0), simulate(module, 5.0, samples_s=1e-3)
    assert np.array_equal(bare.impacts.t_s, fine.impacts.t_s)
    assert bare.final == fine.final
    assert fine.samples is not None
    assert fine.samples.x_m[-1] == pytest.approx(fine.final.x_m, abs=1e-15)
    assert np.max(fine.samples.x_m) <= 0.18 + 1e-9


def test_the_numbers_of_dop853_are_scipys() -> None:
    assert np.array_equal(dop853.A[:12, :12], DOP853.A)
    assert np.array_equal(dop853.A[12, :12], DOP853.B)
    assert np.array_equal(dop853.A[13:], DOP853.A_EXTRA)
    assert not dop853.A[:13, 12:].any()
    assert dop853.C.tolist() == [*DOP853.C, 1.0, *DOP853.C_EXTRA]
    for own, theirs in (
        (dop853.E3, DOP853.E3),
        (dop853.E5, DOP853.E5),
        (dop853.D, DOP853.D),
    ):
        assert np.array_equal(own, theirs)


@pytest.mark.parametrize(
    "changes", [{"friction.mu": 0.0, "friction.mu_s": 0.0}, {"striker.gravity_m_s2": 0.0}]
)
@pytest.mark.parametrize("delta", [1.0, 2.0, 4.0])
def test_a_stribeck_law_without_force_is_none_at_any_speed(changes: dict[str, Any], delta: float) -> None:
    """It never halts the striker, which turns round a thousand Stribeck speeds fast."""
    steep = {"friction.v_s_m_s": 1e-3, "friction.delta": delta, "initial.v_m_s": -2.0, **changes}
    ours = simulate(scene("table1-stribeck", steep), 3.0)
    same = {"friction": {"law": "none"}, "initial.v_m_s": -2.0}
    theirs = simulate(load_scene(changed("table1-stribeck", same)), 3.0)
    assert theirs.method == "exact"
    assert ours.final.x_m == pytest.approx(theirs.final.x_m, abs=1e-8)
    assert ours.impacts.t_s == pytest.approx(theirs.impacts.t_s, abs=1e-8)
