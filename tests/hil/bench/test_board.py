"""The firmware on an emulated Cortex-M7: the same frames as the compiled build, in the same order.

In single precision, on a Cortex-M4F: the same decisions.
"""

import gc
import os
from pathlib import Path

import numpy as np
import pytest

from firmware_py.builds import board
from firmware_py.interface import codec
from firmware_py.interface.generated.records import ParameterRequest
from firmware_py.shell.board_node import BoardDiedError, BoardNode, SinglePrecisionBoardNode
from firmware_py.shell.builds import Build
from firmware_py.shell.compiled_node import CompiledNode
from firmware_py.shell.parameters import config_from
from hil.bench.bench import run_scenario
from hil.bench.lockstep import run_lockstep
from hil.judge.decisions import decisions_of, differences
from hil.record.traces.trace import read
from hil.scenario.scenario import load_scenario
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
def test_every_frame_and_every_state_of_a_run_is_that_of_the_compiled_build(
    name: str, tmp_path: Path
) -> None:
    scenario = load_scenario(name)
    for build in ("compiled", "cortex-m7"):
        (tmp_path / build).mkdir()
        run_lockstep(scenario, tmp_path / build, 1, lambda *_: None, build)  # type: ignore[arg-type]
    logs = [(tmp_path / build / "can.log").read_bytes() for build in ("compiled", "cortex-m7")]
    assert logs[0].count(b"\n") > 3 * scenario.ticks
    assert logs[0] == logs[1]
    first, second = (read(tmp_path / build / "firmware.trace") for build in ("compiled", "cortex-m7"))
    assert "state.estimator.x_m" in first.dtype.names
    for column in set(first.dtype.names) - {"work_us"}:
        assert first[column].tobytes() == second[column].tobytes(), column


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize(
    "name",
    [
        "a-hot-winding-stops-the-motor",
        "a-controller-that-pauses-for-long-stops-the-motor",
        "damaged-parameters-arm-nothing",
    ],
)
def test_in_single_precision_a_run_has_the_decisions_of_the_compiled_build(name: str, tmp_path: Path) -> None:
    builds: tuple[Build, ...] = ("compiled", "cortex-m4f")
    for build in builds:
        verdict = run_scenario(
            load_scenario(name),
            "lockstep",
            "auto",
            tmp_path / build,
            1,
            progress=lambda *_: None,
            firmware=build,
        )
        assert verdict["passed"]
    double, single = (read(tmp_path / build / "firmware.trace") for build in builds)
    assert double.dtype == single.dtype
    assert not differences(decisions_of(double), decisions_of(single))
    x_m = single["state.estimator.x_m"]
    assert np.array_equal(x_m, x_m.astype(np.float32))
    assert not np.array_equal(x_m, double["state.estimator.x_m"])


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize(
    "name",
    [
        "a-hot-winding-stops-the-motor",
        "a-controller-that-pauses-for-thirty-ticks-goes-on",
        "a-restarted-controller-moves-nothing-by-itself",
    ],
)
def test_a_cortex_m4f_sends_the_bytes_of_single_precision_here(name: str, tmp_path: Path) -> None:
    scenario = load_scenario(name)
    builds: tuple[Build, ...] = ("host-single", "cortex-m4f", "compiled")
    for build in builds:
        (tmp_path / build).mkdir()
        run_lockstep(scenario, tmp_path / build, 1, lambda *_: None, build)
    logs = [(tmp_path / build / "can.log").read_bytes() for build in builds]
    assert logs[0].count(b"\n") > 3 * scenario.ticks
    assert logs[0] == logs[1]
    assert logs[0] != logs[2]


@pytest.mark.usefixtures("tools")
def test_parameters_are_served_as_by_the_compiled_build() -> None:
    nodes = [make(config_from({}), {}) for make in (CompiledNode, BoardNode)]
    for number, request in enumerate([(0.0, 7, 0), (80.0, 7, 1), (0.0, 7, 0)]):
        frame = codec.PARAMETER_REQUEST.encode(ParameterRequest(*request), number)
        sent = [[node.tick([frame] if k == 0 else [], 1) for k in range(5)] for node in nodes]
        assert sent[0] == sent[1]
    assert nodes[1].parameters[7] == 80.0
    assert nodes[1].memory.tobytes() == nodes[0].memory.tobytes()


@pytest.mark.usefixtures("tools")
def test_in_single_precision_a_parameter_that_is_written_is_in_the_next_config() -> None:
    node = SinglePrecisionBoardNode(config_from({}), {})
    before = node.config
    answers = [
        frame
        for number, request in enumerate([(80.0, 7, 1), (0.0, 7, 0)])
        for k in range(5)
        for frame in node.tick(
            [codec.PARAMETER_REQUEST.encode(ParameterRequest(*request), number)] if k == 0 else [], 1
        )
        if frame.can_id == codec.PARAMETER_VALUE.can_id
    ]
    assert [codec.decode(frame).value for frame in answers] == [80.0, 80.0]
    assert node.config != before
    assert node.memory["ticks"][0] == 10


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
@pytest.mark.parametrize(
    ("target", "most_ram", "most_stack", "longest_tick"),
    [("cortex-m7", 8192, 8192, 90_000), ("cortex-m4f", 4096, 5120, 100_000)],
)
def test_the_firmware_keeps_its_budget(
    target: board.BoardName, most_ram: int, most_stack: int, longest_tick: int
) -> None:
    found = budget(["a-controller-that-pauses-for-thirty-ticks-goes-on"], lambda *_: None, target)
    assert 60_000 < found["flash"]["image"] <= 88 * 1024
    assert 0.5 * most_ram < sum(found["ram"].values()) < most_ram
    assert 0.5 * most_stack < found["stack"] < most_stack
    ordinary, late = found["instructions"]["ordinary"], found["instructions"]["after_a_pause"]
    assert 5_000 < ordinary["p50"] <= ordinary["p99"] <= ordinary["worst"] < 12_000
    assert ordinary["worst"] < late["worst"] < longest_tick
    assert late["elapsed_ticks"] == 31


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
