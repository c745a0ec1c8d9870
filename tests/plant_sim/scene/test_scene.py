"""Scenes: what is accepted, and what is refused with which sentence."""

import math
from pathlib import Path
from typing import Any

import pytest
from changed_scenes import DELETE, changed

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.friction import NoFriction, Stribeck, Viscous
from plant_sim.parts.stop import HuntCrossley, KelvinVoigt, NoStop, RigidStop
from plant_sim.scene import SceneError, load_scene, scene_names


@pytest.mark.parametrize("name", scene_names())
def test_named_scenes_load(name: str) -> None:
    parts = load_scene(name).parts()
    assert parts.striker.mass_kg == 0.8
    # Table 1's, but for the module that is made for walking.
    assert parts.stop.position_m == (0.142 if name == "walking" else 0.18)


def test_a_scene_file_is_a_path_or_a_text(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('[striker]\nmass_kg = 1\nspring_n_m = 4\nrest_length_m = 0\n[drive]\nmodel = "ideal"\n')
    with path.open("a") as file:
        file.write("amplitude_m = 0.01\nfrequency_hz = 2\n")
    parts = load_scene(path).parts()
    assert parts == load_scene(str(path)).parts()
    assert parts.friction == NoFriction()
    assert parts.stop == NoStop()
    assert parts.drive == IdealDrive(0.01, 4.0 * math.pi, 0.0)
    assert isinstance(parts.striker.mass_kg, float)


def test_a_ratio_is_of_the_plants_own_natural_frequency() -> None:
    scene = load_scene("table1-viscous")
    assert scene.natural_rad_s == pytest.approx(9.354143466934854)
    assert scene.parts().drive.omega_rad_s == pytest.approx(1.3 * 9.354143466934854, rel=1e-15)


def test_defaults_of_motor_and_sensors() -> None:
    scene = load_scene("table1-motor-soft")
    parts = scene.parts()
    assert isinstance(parts.drive, MotorDrive)
    assert parts.drive.torque_constant_n_m_a * parts.drive.current_limit_a == pytest.approx(0.8)
    assert isinstance(parts.stop, HuntCrossley)
    assert scene.sensors is not None
    assert scene.sensors.striker_low.range_m_s2 == pytest.approx(16 * 9.80665)
    assert scene.sensors.striker_high.range_m_s2 == pytest.approx(200 * 9.80665)


def test_every_part_can_be_asked_for() -> None:
    stribeck = {"law": "stribeck", "mu": 0.15, "mu_s": 0.2, "v_s_m_s": 0.05, "delta": 2.0, "b_n_s_m": 0.1}
    kelvin_voigt = {"law": "kelvin-voigt", "position_m": 0.18, "restitution": 0.5, "stiffness": 1e5}
    parts = load_scene(changed("table1-viscous", {"friction": stribeck, "stop": kelvin_voigt})).parts()
    assert parts.friction == Stribeck(0.15, 0.2, 0.05, 2.0, 0.1)
    assert isinstance(parts.stop, KelvinVoigt)
    assert parts.stop.stiffness_n_per_m == 1e5


def test_a_soft_stop_allows_a_start_inside_it() -> None:
    scene = load_scene(changed("table1-motor-soft", {"initial.x_m": 0.181}))
    assert scene.initial_x_m == 0.181


def test_equal_parts_give_equal_types_however_numbers_are_written() -> None:
    whole = load_scene(changed("table1-viscous", {"friction.b_n_s_m": 1, "stop.restitution": 0})).parts()
    assert [type(value) for value in (*whole.friction, *whole.stop)] == [float] * 3
    assert isinstance(whole.friction, Viscous)
    assert isinstance(whole.stop, RigidStop)


@pytest.mark.parametrize(
    ("base", "changes", "said"),
    [
        (
            "table1-viscous",
            {"striker.mas_kg": 1.0},
            "striker.mas_kg = 1.0 is not a known key; did you mean mass_kg?",
        ),
        (
            "table1-viscous",
            {"frction": {"mu": 1.0}},
            "frction = a table of mu is not a known key; did you mean friction?",
        ),
        (
            "table1-viscous",
            {"stop.contact_s": 0.01},
            "stop.contact_s = 0.01 is not a known key of 'rigid'; known: law,",
        ),
        (
            "table1-viscous",
            {"striker.mass_kg": -0.8},
            "striker.mass_kg = -0.8 is not a number greater than 0; give",
        ),
        (
            "table1-viscous",
            {"striker.mass_kg": math.nan},
            "striker.mass_kg = nan is not a finite number; give",
        ),
        (
            "table1-viscous",
            {"drive.amplitude_m": math.inf},
            "drive.amplitude_m = inf is not a finite number; give",
        ),
        (
            "table1-viscous",
            {"striker.spring_n_m": 0},
            "striker.spring_n_m = 0 is not a number greater than 0; give",
        ),
        ("table1-viscous", {"striker.mass_kg": "0.8"}, "striker.mass_kg = '0.8' is not a number; give"),
        ("walking", {"gait.pace": 3}, "gait.pace = 3 is not a list; give the tables [[gait.pace]]"),
        ("walking", {"gait.pace": []}, "gait.pace = [] is not a list of at least 1; give the tables"),
        ("table1-viscous", {"striker.mass_kg": True}, "striker.mass_kg = True is not a number; give"),
        (
            "table1-viscous",
            {"striker.mass_kg": DELETE},
            "striker.mass_kg is missing; give the striker's mass in kg",
        ),
        ("table1-viscous", {"striker": DELETE}, "striker is missing; give the table [striker]"),
        ("table1-viscous", {"drive": DELETE}, "drive is missing; give the table [drive]"),
        ("table1-viscous", {"drive.model": DELETE}, "drive.model is missing; give one of ideal, motor"),
        (
            "table1-viscous",
            {"drive.model": "ideel"},
            "drive.model = 'ideel' is none of ideal, motor, dq-motor; did you mean ideal?",
        ),
        (
            "table1-viscous",
            {"drive.frequency_hz": 2.0},
            "drive.ratio = 1.3 and drive.frequency_hz = 2.0 are both given;",
        ),
        ("table1-viscous", {"drive.ratio": DELETE}, "drive has no speed; give one of drive.ratio"),
        (
            "table1-motor-soft",
            {"drive.ratio": 1.3},
            "drive.ratio = 1.3 is given for a motor, which takes a torque",
        ),
        (
            "table1-viscous",
            {"motor": {}},
            "motor is given while drive.model = 'ideal'; delete the table [motor]",
        ),
        (
            "table1-motor-soft",
            {"motor.pole_pairs": 7.5},
            "motor.pole_pairs = 7.5 is not a whole number; give",
        ),
        (
            "table1-viscous",
            {"initial.x_m": 0.19},
            "initial.x_m = 0.19 starts the striker beyond the rigid stop at",
        ),
        (
            "table1-viscous",
            {"stop.position_m": 0.1},
            "striker.rest_length_m = 0.12 starts the striker beyond the rigid",
        ),
        (
            "table1-viscous",
            {"stop.restitution": 1.2},
            "stop.restitution = 1.2 is not a number of at most 1; give",
        ),
        (
            "table1-motor-soft",
            {"stop.restitution": 0.0},
            "stop.restitution = 0.0 is not a number greater than 0; give",
        ),
        (
            "table1-motor-soft",
            {"stop.stiffness": 1e6},
            "stop.contact_s = 0.01 and stop.stiffness = 1000000.0 are both",
        ),
        (
            "table1-motor-soft",
            {"stop.contact_s": DELETE},
            "stop has no stiffness; give one of stop.contact_s",
        ),
        ("table1-stribeck", {"friction.mu_s": 0.1}, "friction.mu_s = 0.1 is below friction.mu = 0.15;"),
        (
            "table1-viscous",
            {"solver.method": "exakt"},
            "solver.method = 'exakt' is not 'auto', 'exact' or 'adaptive'",
        ),
        (
            "table1-motor-soft",
            {"solver.method": "exact"},
            "solver.method = 'exact' has no closed form for drive.model =",
        ),
        (
            "table1-viscous",
            {"solver.accuracy": 1e-15},
            "solver.accuracy = 1e-15 is not a number of at least 1e-13; give",
        ),
        (
            "table1-motor-soft",
            {"sensors.striker_low.bandwidth": 100.0},
            "sensors.striker_low.bandwidth = 100.0 is not a known key; did you mean bandwidth_hz?",
        ),
    ],
)
def test_a_bad_scene_is_refused_by_key_value_and_remedy(
    base: str, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed(base, changes))
    assert str(refusal.value).startswith(said)
    assert "\n" not in str(refusal.value)


def test_all_that_is_wrong_is_said_at_once() -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed("table1-viscous", {"striker.mass_kg": -1.0, "stop.restitution": 2.0}))
    assert len(str(refusal.value).splitlines()) == 2


def test_a_scene_that_cannot_be_read(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"'table1-viscos' is no named scene; did you mean table1-viscous\?"):
        load_scene("table1-viscos")
    with pytest.raises(SceneError, match=r"cannot be read \(No such file or directory\)"):
        load_scene(tmp_path / "none.toml")
    (tmp_path / "bad.toml").write_text("[striker\n")
    with pytest.raises(SceneError, match=r"is not valid TOML: .* \(at line 1, column 9\)"):
        load_scene(tmp_path / "bad.toml")


def test_a_scene_with_other_values_is_checked_as_a_new_one() -> None:
    scene = load_scene("table1-viscous")
    other = scene.with_({"drive.ratio": 1.2, "stop": {"law": "none"}, "initial.v_m_s": 0.5})
    assert (other.drive.ratio, other.stop.law, other.initial.v_m_s) == (1.2, "none", 0.5)  # type: ignore[union-attr]
    assert (scene.drive.ratio, scene.stop.law) == (1.3, "rigid")  # type: ignore[union-attr]
    assert scene.with_({"drive.ratio": None, "drive.frequency_hz": 2.0}).drive.frequency_hz == 2.0  # type: ignore[union-attr]
    assert scene.with_({}) == scene
    with pytest.raises(SceneError, match=r"drive.rato = 1.2 is not a known key.*did you mean ratio\?"):
        scene.with_({"drive.rato": 1.2})
