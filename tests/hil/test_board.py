"""The firmware on an emulated Cortex-M7: the same frames as the compiled build, in the same order."""

import gc
import os
from pathlib import Path

import pytest

from firmware_py.builds import board
from firmware_py.interface import codec
from firmware_py.interface.records import ParameterRequest
from firmware_py.shell.board_node import BoardDiedError, BoardNode
from firmware_py.shell.compiled_node import CompiledNode
from firmware_py.shell.parameters import config_from
from hil.lockstep import run_lockstep
from hil.scenario import load_scenario
from tools import cli, doctor
from tools.budget import budget
from tools.output import EXIT_BAD_INPUT


@pytest.fixture(scope="module")
def tools() -> None:
    """Skip where the tools are missing; on a CI machine that is a failure: no board was tested."""
    missing = board.missing_tools()
    if missing and os.environ.get("CI"):
        pytest.fail(f"{' and '.join(missing)} missing on a CI machine; {board.REMEDY}")
    if missing:
        pytest.skip(f"{' and '.join(missing)} missing; {board.REMEDY}")


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize(
    "name",
    [
        "a-hot-winding-stops-the-motor",
        "a-controller-that-pauses-for-long-stops-the-motor",
        "a-restarted-controller-moves-nothing-by-itself",
        "damaged-parameters-arm-nothing",
    ],
)
def test_every_frame_of_a_run_is_that_of_the_compiled_build(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    for build in ("compiled", "cortex-m7"):
        (tmp_path / build).mkdir()
        run_lockstep(scenario, tmp_path / build, 1, lambda *_: None, build)  # type: ignore[arg-type]
    logs = [(tmp_path / build / "can.log").read_bytes() for build in ("compiled", "cortex-m7")]
    assert logs[0].count(b"\n") > 3 * scenario.ticks
    assert logs[0] == logs[1]


@pytest.mark.usefixtures("tools")
def test_parameters_are_served_as_by_the_compiled_build() -> None:
    nodes = [make(config_from({}), {}) for make in (CompiledNode, BoardNode)]
    for number, request in enumerate([(7, 0, 0.0), (7, 1, 80.0), (7, 0, 0.0)]):
        frame = codec.PARAMETER_REQUEST.encode(ParameterRequest(*request), number)
        sent = [[node.tick([frame] if k == 0 else [], 1) for k in range(5)] for node in nodes]
        assert sent[0] == sent[1]
    assert nodes[1].parameters[7] == 80.0
    assert nodes[1].memory.tobytes() == nodes[0].memory.tobytes()


@pytest.mark.usefixtures("tools")
def test_a_board_ends_with_its_node_and_says_so_when_it_has_died() -> None:
    node = BoardNode(config_from({}), {})
    process = node._process
    node.tick([], 1)
    del node
    gc.collect()
    assert process.poll() == 0
    node = BoardNode(config_from({}), {})
    node._process.kill()
    with pytest.raises(BoardDiedError, match="status -9"):
        node.tick([], 1)


@pytest.mark.usefixtures("tools")
def test_the_firmware_keeps_its_budget() -> None:
    found = budget(["a-controller-that-pauses-for-long-stops-the-motor"], lambda *_: None)
    assert 100_000 < found["flash"]["image"] < 160_000
    assert sum(found["ram"].values()) < 8192
    assert 4096 < found["stack"] < 8192
    ordinary, late = found["instructions"]["ordinary"], found["instructions"]["after_a_pause"]
    assert 5_000 < ordinary["p50"] <= ordinary["p99"] <= ordinary["worst"] < 12_000
    assert ordinary["worst"] < late["worst"] < 40_000
    assert late["elapsed_ticks"] > 100


def test_without_the_tools_a_sentence_names_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for command in (["run", "damaged-parameters-arm-nothing"], ["suite", "damaged-parameters-arm-nothing"]):
        options = ["--clock", "lockstep", "--firmware", "cortex-m7", "--out", str(tmp_path / "out")]
        assert cli.run([*command, *options]) == EXIT_BAD_INPUT
        said = " ".join(capsys.readouterr().err.split())
        assert "arm-none-eabi-gcc and qemu-system-arm" in said
        assert "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm" in said
    assert not doctor._board().passed
    assert doctor._board().detail == "no arm-none-eabi-gcc, no qemu-system-arm"


def test_on_the_wall_clock_it_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["run", "damaged-parameters-arm-nothing", "--firmware", "cortex-m7"]) == EXIT_BAD_INPUT
    assert "--clock lockstep" in capsys.readouterr().err
