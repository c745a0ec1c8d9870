"""The comparison of precisions: decisions matched in time, and every real number of the state found."""

import numpy as np

from firmware_py.builds.flat import layout, stored
from firmware_py.node.tick import INITIAL, NodeState
from tools.dev.precision import PLACES, POSITION, SPEED, TORQUE, distances, spread


def test_each_decision_is_matched_with_the_nearest_equal_one() -> None:
    ours = np.array([[100, 1, 0], [200, 2, 0], [300, 1, 0], [400, 3, 7]])
    others = np.array([[101, 1, 0], [290, 1, 0], [199, 2, 0], [302, 1, 0]])
    assert distances(ours, others) == [1, 1, 2, -1]
    assert spread([1, 1, 2, -1]) == "1×-1 2×1 1×2"
    assert spread([]) == "none"


def test_the_places_are_those_of_the_real_numbers() -> None:
    memory = stored(INITIAL)
    memory["core"]["estimator"]["x_m"], memory["core"]["estimator"]["v_m_s"] = 1.5, -2.5
    memory["outputs"]["torque_n_m"] = 0.25
    values = memory.view(np.float64)
    assert [values[PLACES[name] // 8] for name in (POSITION, SPEED, TORQUE)] == [1.5, -2.5, 0.25]
    small, large = (layout(NodeState, precision).itemsize for precision in ("single", "double"))  # type: ignore[arg-type]
    assert len(PLACES) > 100
    assert 4 * len(PLACES) >= large - small > 3 * len(PLACES)
