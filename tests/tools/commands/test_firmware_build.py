"""What `firmware build` prints and writes: the bytes of code, and of config and state by block."""

import json
from pathlib import Path

import pytest

from firmware_py.builds.flat import layout
from firmware_py.builds.machine_code import sizes
from firmware_py.node.tick import NodeState
from tools import cli
from tools.budget import blocks, ram_by_block


def test_blocks_fill_a_record() -> None:
    state = layout(NodeState, "single")
    assert sum(blocks(state).values()) == state.itemsize
    assert blocks(state)["ticks"] == 8


def test_every_byte_of_config_and_state_is_of_one_block(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["firmware", "build", "--target", "cortex-m4f", "--out", str(tmp_path / "b"), "--json"]
    assert cli.run(command) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["map"] == ram_by_block("single")
    assert printed["bytes"] == sizes("cortex-m4f", has_gait=False)  # its config does not follow one
    for part in ("config", "state"):
        assert sum(printed["map"][part].values()) == printed["bytes"][part]
    assert "float x_m;" in (tmp_path / "b" / "vibro_firmware.h").read_text()
