"""The whole bring-up on hidden modules, in lockstep: parameters, hold and twin, within each step's bounds."""

from pathlib import Path

import pytest

from tools.bring_up.trials import bench_of, beyond_bounds, brought_up, fault

MODULES = {
    "soft spring, striker's accelerometers the wrong way round": (
        {"striker": {"spring_n_m": 55.0}, "stop": {"position_m": 0.177, "restitution": 0.5}},
        [
            fault("sensor-wrong-sign", sensor="striker"),
            fault("sensor-wrong-sign", sensor="encoder"),
            fault("sensor-biased", sensor="encoder", bias=1.2),
        ],
        {"wiring.torque_reversed", "wiring.striker_reversed"},
    ),
    "light striker with little friction, which turns the crank on after a stop": (
        {
            "striker": {"mass_kg": 0.66, "spring_n_m": 98.0},
            "stop": {"position_m": 0.182, "restitution": 0.59, "contact_s": 0.0174},
            "drive": {"amplitude_m": 0.0226},
            "friction": {"law": "viscous", "b_n_s_m": 0.065},
        },
        [],
        set(),
    ),
}


@pytest.mark.parametrize("name", MODULES)
def test_a_hidden_module_ends_in_a_hold_with_its_true_parameters(name: str, tmp_path: Path) -> None:
    scene, faults, wiring = MODULES[name]
    bench = bench_of(scene, faults, 1)
    mass_kg = scene["striker"].get("mass_kg", 0.8)
    result = brought_up(bench, tmp_path / "out", None, mass_kg=mass_kg)
    assert result["passed"], result["steps"][-1]["reason"]
    found = result["parameters"]
    assert {one for one in found if one.startswith("wiring.")} == wiring
    truth = {
        "striker.spring_n_m": scene["striker"]["spring_n_m"],
        "stop.position_m": scene["stop"]["position_m"],
        "stop.restitution": scene["stop"]["restitution"],
        "stop.contact_s": scene["stop"].get("contact_s", 0.01),
        "drive.amplitude_m": scene.get("drive", {}).get("amplitude_m", 0.02),
    }
    for key, value in truth.items():
        assert abs(found[key]["value"] / value - 1.0) < 0.01, key
    assert beyond_bounds(bench, result["steps"]) == []
    assert Path(result["scene"]).exists()
