"""The whole bring-up on hidden modules, in lockstep: parameters, hold and twin, within each step's bounds."""

from pathlib import Path

import pytest

from tools.bring_up.trials import bench_of, beyond_bounds, brought_up, fault

MODULES = {
    "soft spring, striker's accelerometers the wrong way round": (
        {"striker": {"spring_n_m": 55.0}, "stop": {"position_m": 0.177, "restitution": 0.4}},
        [
            fault("sensor-wrong-sign", sensor="striker"),
            fault("sensor-wrong-sign", sensor="encoder"),
            fault("sensor-biased", sensor="encoder", bias=1.2),
        ],
        {"wiring.torque_reversed", "wiring.striker_reversed"},
    ),
}


@pytest.mark.parametrize("name", MODULES)
def test_a_hidden_module_ends_in_a_hold_with_its_true_parameters(name: str, tmp_path: Path) -> None:
    scene, faults, wiring = MODULES[name]
    bench = bench_of(scene, faults, 1)
    result = brought_up(bench, tmp_path / "out", None)
    assert result["passed"], result["steps"][-1]["reason"]
    found = result["parameters"]
    assert {one for one in found if one.startswith("wiring.")} == wiring
    truth = {
        "striker.spring_n_m": scene["striker"]["spring_n_m"],
        "stop.position_m": scene["stop"]["position_m"],
        "stop.restitution": scene["stop"]["restitution"],
        "stop.contact_s": 0.01,
        "drive.amplitude_m": 0.02,
    }
    for key, value in truth.items():
        assert abs(found[key]["value"] / value - 1.0) < 0.01, key
    assert beyond_bounds(bench, result["steps"]) == []
    assert Path(result["scene"]).exists()
