"""`tick` is a function of its arguments alone: from any snapshot the same bits, whatever ran in between."""

import struct
from typing import NamedTuple

import pytest
from closed_loop import Bench
from records import leaves

from firmware_py.core.config import Config
from firmware_py.node.tick import NodeState, tick
from firmware_py.shell.node import FirmwareNode
from firmware_py.shell.parameters import config_from


class Recorded(NamedTuple):
    """A tick: the state before it, its inbox, and the state after it."""

    before: NodeState
    inbox: list[int]
    after: NodeState


def bits(record: tuple) -> dict[str, object]:
    """Every field, floats by their bytes."""
    flat = leaves(record)
    return {k: struct.pack("<d", v) if isinstance(v, float) else int(v) for k, v in flat.items()}


@pytest.fixture(scope="module")
def config() -> Config:
    return config_from({"start.rise_s": 1.0})


@pytest.fixture(scope="module")
def recorded() -> list[Recorded]:
    bench, ticks = Bench({"start.rise_s": 1.0}, build="python"), []
    node = bench.node
    assert isinstance(node, FirmwareNode)
    run_period = node.run_period

    def keep() -> list:
        before, inbox = node._state, list(node.inbox)
        sent = run_period()
        ticks.append(Recorded(before, inbox, node._state))
        return sent

    node.run_period = keep  # type: ignore[method-assign]
    bench.started().run(3.0, keep=False)
    return ticks


def test_a_replay_from_any_snapshot_gives_the_same_bits(recorded: list[Recorded], config: Config) -> None:
    for start in range(500, 3000, 250):
        state = recorded[start].before
        for one in recorded[start : start + 40]:
            state, _ = tick(config, state, one.inbox)
            assert bits(state) == bits(one.after), state.ticks


def test_another_node_between_two_ticks_changes_nothing(recorded: list[Recorded], config: Config) -> None:
    """Every tick twice, with a tick of a node of another module in between."""
    other = config_from({"friction.mu": 0.1, "stop.position_m": 0.175, "drive.amplitude_m": 0.025})
    state = others = recorded[1000].before
    for one in recorded[1000:2500]:
        first = tick(config, state, one.inbox)
        others, _ = tick(other, others, one.inbox)
        second = tick(config, state, one.inbox)
        assert bits(first[0]) == bits(second[0]) == bits(one.after), state.ticks
        assert first[1] == second[1]
        state = second[0]
