"""What the firmware costs: the bytes of code, of config and state by block, and instructions on a board.

The tests that compile the firmware without a gait stand together, so that one process of the tests makes it.
"""

import json
from pathlib import Path

import pytest
from emulated_board import require_board_programs

from firmware_py.builds import board
from firmware_py.builds.c_compiler import measure_sizes
from firmware_py.builds.flat import layout
from firmware_py.node.tick import NodeState
from tools import cli
from tools.budget import blocks, budget, ram_by_block


@pytest.fixture(scope="module")
def board_programs() -> None:
    require_board_programs()


def test_blocks_fill_a_record() -> None:
    state = layout(NodeState, "single")
    assert sum(blocks(state).values()) == state.itemsize
    assert blocks(state)["ticks"] == 8


@pytest.mark.usefixtures("board_programs")
def test_every_byte_of_config_and_state_is_of_one_block(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["firmware", "build", "--target", "cortex-m4f", "--out", str(tmp_path / "b"), "--json"]
    assert cli.run(command) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["map"] == ram_by_block("single")
    assert printed["bytes"] == measure_sizes("cortex-m4f", has_gait=False)  # its config does not follow one
    for part in ("config", "state"):
        assert sum(printed["map"][part].values()) == printed["bytes"][part]
    assert "float x_m;" in (tmp_path / "b" / "vibro_firmware.h").read_text()


@pytest.mark.usefixtures("board_programs")
@pytest.mark.parametrize(
    ("target", "most_ram", "most_stack"), [("cortex-m7", 12_288, 4096), ("cortex-m4f", 10_496, 3072)]
)
def test_the_firmware_keeps_its_budget(
    target: board.BoardName, most_ram: int, most_stack: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the RAM, 4 KiB are the inbox's, and 2 KiB XCP's: its lists, samples, and staged parameters.

    Of the flash, 15 KiB are calibration's: bounds, conflicts and the constants that follow from a commit.
    """
    if target != "cortex-m4f":  # the code without a gait is compiled for one board alone
        monkeypatch.setattr("tools.budget.measure_sizes", lambda name, has_gait=True: measure_sizes(name))
    found = budget(["a-controller-that-pauses-for-thirty-ticks-goes-on"], lambda *_: None, target)
    assert 48_000 < found["flash"]["image"] <= 58_000
    assert found["flash"]["image without a gait"] <= (52_000 if target == "cortex-m4f" else 58_000)
    assert 0.5 * most_ram < sum(found["ram"].values()) < most_ram
    assert 0.5 * most_stack < found["stack"] < most_stack
    assert found["instructions"]["ordinary"]["p99"] <= 9_500
    for ticks in found["instructions"].values():  # after a pause a tick looks through the frames that waited
        assert 5_000 < ticks["p50"] <= ticks["p99"] <= ticks["worst"] <= 15_500
