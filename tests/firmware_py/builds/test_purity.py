"""`step` is a function of its arguments alone: from any snapshot the same bits, whatever ran in between."""

import struct

import pytest
from closed_loop import Bench
from records import leaves, run_step

from firmware_py.core.config import Config
from firmware_py.core.state import Outputs, State
from firmware_py.shell.parameters import config_from


def bits(record: tuple) -> dict[str, object]:
    """Every field, floats by their bytes."""
    flat = leaves(record)
    return {k: struct.pack("<d", v) if isinstance(v, float) else int(v) for k, v in flat.items()}


@pytest.fixture(scope="module")
def recorded() -> Bench:
    bench = Bench({"start.rise_s": 1.0}, build="python").started()
    bench.run(3.0)
    return bench


def test_a_replay_from_any_snapshot_gives_the_same_bits(recorded: Bench) -> None:
    config = recorded.node.config
    for start in range(500, 3000, 250):
        state = recorded.states[start]
        for k in range(start + 1, start + 40):
            state, outputs = run_step(config, state, recorded.inputs[k])
            assert bits(state) == bits(recorded.states[k]), k
            assert bits(outputs) == bits(recorded.outputs[k]), k


def test_another_node_between_two_ticks_changes_nothing(recorded: Bench) -> None:
    """Every tick twice, with a tick of a node of another module in between."""
    other: Config = config_from({"friction.mu": 0.1, "stop.position_m": 0.175, "drive.amplitude_m": 0.025})
    others: State = recorded.states[1000]
    state: State = recorded.states[1000]
    for k in range(1001, 2500):
        first: tuple[State, Outputs] = run_step(recorded.node.config, state, recorded.inputs[k])
        others, _ = run_step(other, others, recorded.inputs[k])
        second = run_step(recorded.node.config, state, recorded.inputs[k])
        assert bits(first[0]) == bits(second[0]), k
        state = second[0]
        assert bits(state) == bits(recorded.states[k]), k
