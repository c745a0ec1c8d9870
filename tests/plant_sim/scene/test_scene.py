"""Scenes: what is accepted, and what is refused with which sentence."""

import math
from pathlib import Path
from typing import Any

import pytest
from changed_scenes import DELETE, HERTZ, KNOCK, SWING, changed

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


EXACT = {"solver.method": "exact"}
WEARER = {"plate_kg": 1.0, "ankle_n_m": 1e4, "ankle_n_s_m": 100.0}
HERTZ_STOP = {"stop": HERTZ}
WALKING = {"at_s": 0.0, "stride_hz": 0.9}
BAD: dict[str, list[tuple[dict[str, Any], str]]] = {
    "table1-viscous": [
        ({"striker.mas_kg": 1.0}, "striker.mas_kg = 1.0 is not a known key; did you mean mass_kg?"),
        ({"frction": {"mu": 1.0}}, "frction = a table of mu is not a known key; did you mean friction?"),
        ({"stop.contact_s": 0.01}, "stop.contact_s = 0.01 is not a known key of 'rigid'; known: law,"),
        ({"striker.mass_kg": math.nan}, "striker.mass_kg = nan is not a finite number; give"),
        ({"striker.spring_n_m": 0}, "striker.spring_n_m = 0 is not a number greater than 0; give"),
        ({"striker.mass_kg": "0.8"}, "striker.mass_kg = '0.8' is not a number; give"),
        ({"striker.mass_kg": True}, "striker.mass_kg = True is not a number; give"),
        ({"striker.mass_kg": DELETE}, "striker.mass_kg is missing; give the striker's mass in kg"),
        ({"striker": DELETE}, "striker is missing; give the table [striker]"),
        ({"drive": DELETE}, "drive is missing; give the table [drive]"),
        ({"drive.model": DELETE}, "drive.model is missing; give one of ideal, motor"),
        ({"drive.model": "ideel"}, "drive.model = 'ideel' is none of ideal, motor, dq-motor; did you mean"),
        ({"drive.frequency_hz": 2.0}, "drive.ratio = 1.3 and drive.frequency_hz = 2.0 are both given;"),
        ({"drive.ratio": DELETE}, "drive has no speed; give one of drive.ratio"),
        ({"motor": {}}, "motor is given while drive.model = 'ideal'; delete the table [motor]"),
        ({"initial.x_m": 0.19}, "initial.x_m = 0.19 starts the striker beyond the rigid stop at"),
        ({"stop.position_m": 0.1}, "striker.rest_length_m = 0.12 starts the striker beyond the rigid"),
        ({"stop.restitution": 1.2}, "stop.restitution = 1.2 is not a number of at most 1; give"),
        ({"solver.method": "exakt"}, "solver.method = 'exakt' is not 'auto', 'exact' or 'adaptive'"),
        ({"solver.accuracy": 1e-15}, "solver.accuracy = 1e-15 is not a number of at least 1e-13; give"),
        ({"drive.rod_m": 0.02}, "drive.rod_m = 0.02 is not longer than the crank"),
        ({"drive.rod_m": -1.0}, "drive.rod_m = -1.0 is not a number greater than 0"),
        (EXACT | {"drive.rod_m": 0.1}, "solver.method = 'exact' has no closed form for drive.rod_m"),
        ({"housing.tilt_deg": 5.0}, "housing.tilt_deg = 5.0 is not a known key; did you mean tilt_rad?"),
        ({"housing.tilt_rad": 2.0}, "housing.tilt_rad = 2.0 is not a number"),
        ({"housing.harmonic": {"amplitude_m_s2": 1.0}}, "housing.harmonic.frequency_hz is missing"),
        (
            {"housing.shock": {"peak_m_s2": 1.0, "start_s": 0.0, "duration_s": 0.0}},
            "housing.shock.duration_s = 0.0 is not a number greater than 0",
        ),
        (EXACT | SWING, "solver.method = 'exact' has no closed form for housing.harmonic"),
        (EXACT | KNOCK, "solver.method = 'exact' has no closed form for housing.shock"),
        ({"wearer": WEARER}, "wearer is given while stop.law = 'rigid'; a wearer feels a force, which only"),
        ({"wearer": WEARER, "stop": {"law": "none"}}, "wearer is given while stop.law = 'none'"),
        (
            HERTZ_STOP | {"wearer": WEARER, "friction": {"law": "coulomb", "mu": 0.1}},
            "wearer is given while friction.law",
        ),
        (
            HERTZ_STOP | {"wearer": {"plate_kg": 1.0, "ankle_n_s_m": 0.0}},
            "wearer.ankle_n_m is missing; give the ankle's",
        ),
        (
            HERTZ_STOP | {"wearer": WEARER | {"plate_kg": 0.0}},
            "wearer.plate_kg = 0.0 is not a number greater",
        ),
        (HERTZ_STOP | {"wearer": WEARER | {"foot_kg": 1.0}}, "wearer.foot_kg = 1.0 is not a known key"),
    ],
    "table1-stribeck": [
        ({"friction.mu_s": 0.1}, "friction.mu_s = 0.1 is below friction.mu = 0.15;"),
    ],
    "table1-motor-soft": [
        ({"drive.ratio": 1.3}, "drive.ratio = 1.3 is given for a motor, which takes a torque"),
        ({"drive.model": "dq-motor", "drive.ratio": 1.3}, "drive.ratio = 1.3 is given for a motor, which"),
        ({"motor.pole_pairs": 7.5}, "motor.pole_pairs = 7.5 is not a whole number; give"),
        ({"stop.restitution": 0.0}, "stop.restitution = 0.0 is not a number greater than 0; give"),
        ({"stop.stiffness": 1e6}, "stop.contact_s = 0.01 and stop.stiffness = 1000000.0 are both"),
        ({"stop.contact_s": DELETE}, "stop has no stiffness; give one of stop.contact_s"),
        (EXACT, "solver.method = 'exact' has no closed form for drive.model ="),
        (
            {"sensors.striker_low.bandwidth": 100.0},
            "sensors.striker_low.bandwidth = 100.0 is not a known key; did you mean bandwidth_hz?",
        ),
        ({"winding": {}}, "winding is given while drive.model = 'motor'; delete the table [winding], or set"),
    ],
    "table1-dq-motor": [
        ({"winding.bandwidth_rad_s": 0.0}, "winding.bandwidth_rad_s = 0.0 is not a number greater than 0"),
        (EXACT, "solver.method = 'exact' has no closed form for drive.model = 'dq-motor'"),
    ],
    "walking": [
        ({"gait.axis": "left"}, "gait.axis = 'left' is not"),
        ({"gait.cadence": 1.0}, "gait.cadence = 1.0 is not a known key"),
        ({"housing": {"tilt_rad": 0.1}}, "gait and housing are both given"),
        (EXACT, "solver.method = 'exact' has no closed form for"),
        ({"gait.pace": DELETE}, "gait.pace is missing"),
        ({"gait.pace": 3}, "gait.pace = 3 is not a list; give the tables [[gait.pace]]"),
        ({"gait.pace": []}, "gait.pace = [] is not a list of at least 1; give the tables"),
        (
            {"gait.pace": [WALKING | {"at_s": 5.0}]},
            "gait.pace begins at at_s = 5.0; the first pace is that of",
        ),
        ({"gait.pace": [WALKING, WALKING]}, "gait.pace has at_s = 0.0 after at_s = 0.0; put the paces in"),
        ({"gait.pace": [WALKING | {"stride_hz": 0.1}]}, "gait.pace.stride_hz = 0.1 is slower than anybody"),
        ({"gait.pace": [WALKING | {"stride_hz": 3.0}]}, "gait.pace.0.stride_hz = 3.0 is not a number"),
        (
            {"gait.pace": [WALKING, WALKING | {"at_s": 1e6}]},
            "gait.pace.1.at_s = 1000000.0 is not a number of at most 86400; give from when",
        ),
        (
            {"gait.stumble": [{"at_s": 86_401.0}]},
            "gait.stumble.0.at_s = 86401.0 is not a number of at most 86400; give after when",
        ),
    ],
}


@pytest.mark.parametrize(
    ("base", "changes", "said"), [(base, *one) for base, refused in BAD.items() for one in refused]
)
def test_a_bad_scene_is_refused_by_key_value_and_remedy(
    base: str, changes: dict[str, Any], said: str
) -> None:
    with pytest.raises(SceneError) as refusal:
        load_scene(changed(base, changes))
    assert str(refusal.value).startswith(said)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("script", [{"pace": [WALKING] * 1001}, {"stumble": [{"at_s": 1.0}] * 1001}])
def test_a_walk_of_too_many_events_is_refused_without_naming_all(script: dict[str, Any]) -> None:
    ((name, _),) = script.items()
    with pytest.raises(
        SceneError, match=rf"gait\.{name} = .{{,100}} is not a list of at most 1000; give the"
    ):
        load_scene(changed("walking", {f"gait.{name}": script[name]}))


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


def test_a_key_within_a_number_is_refused() -> None:
    with pytest.raises(SceneError, match=r"striker\.mass_kg = 0\.8 is no table and has no key"):
        load_scene("table1-viscous").with_({"striker.mass_kg.x": 1})


def test_a_scene_with_other_values_is_checked_as_a_new_one() -> None:
    scene = load_scene("table1-viscous")
    other = scene.with_({"drive.ratio": 1.2, "stop": {"law": "none"}, "initial.v_m_s": 0.5})
    assert (other.drive.ratio, other.stop.law, other.initial.v_m_s) == (1.2, "none", 0.5)  # type: ignore[union-attr]
    assert (scene.drive.ratio, scene.stop.law) == (1.3, "rigid")  # type: ignore[union-attr]
    assert scene.with_({"drive.ratio": None, "drive.frequency_hz": 2.0}).drive.frequency_hz == 2.0  # type: ignore[union-attr]
    assert scene.with_({}) == scene
    changes = {"stop": {"law": "none"}, "stop.position_m": 0.2}
    with pytest.raises(SceneError, match=r"stop\.position_m"):
        scene.with_(changes)
    assert changes["stop"] == {"law": "none"}, "the caller's tables stay as they are"
    with pytest.raises(SceneError, match=r"drive.rato = 1.2 is not a known key.*did you mean ratio\?"):
        scene.with_({"drive.rato": 1.2})
