"""The firmware on an emulated Cortex-M7: the same frames as the compiled build, in the same order.

In single precision, on a Cortex-M4F: the same decisions.
"""

import gc
import os
import random
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from closed_loop import Bench
from compilers import require_compiler
from emulated_board import require_board_programs
from xcp_session import answered, ask, calibrate, command, commands_of, configure, staged

from firmware_py.builds import board
from firmware_py.builds.flat import from_flat
from firmware_py.interface.enums import XcpCommandCode, XcpError
from firmware_py.node import elements
from firmware_py.node.tick import NodeState
from firmware_py.shell.board_node import (
    MEASURED_TICK,
    BoardDiedError,
    BoardNode,
    SinglePrecisionBoardNode,
)
from firmware_py.shell.builds import Build
from firmware_py.shell.native import NativeNode
from firmware_py.shell.parameters import config_from
from hil.record.traces.trace import read
from hil.runs.job import Job
from hil.runs.recording import record
from hil.scenario.scenario import load_scenario
from tools import cli, doctor
from tools.dev.builds import decisions_of, differences
from tools.output import EXIT_BAD_INPUT


@pytest.fixture(scope="module")
def tools() -> None:
    require_board_programs()
    require_compiler("gcc")


BUILDS: tuple[Build, ...] = ("compiled", "cortex-m7", "host-single", "cortex-m4f")


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
def test_boards_send_the_bytes_of_their_precision_here_and_decide_alike(name: str, tmp_path: Path) -> None:
    """The Cortex-M7 has every state of the compiled build, and the Cortex-M4F its decisions."""
    scenario = load_scenario(name)
    for build in BUILDS:
        (tmp_path / build).mkdir()
        record(Job(scenario, 1, build, tmp_path / build))
    double, on_m7, single, on_m4f = ((tmp_path / build / "can.log").read_bytes() for build in BUILDS)
    assert double.count(b"\n") > 3 * scenario.ticks
    assert double == on_m7
    assert single == on_m4f
    states = {build: read(tmp_path / build / "firmware.trace") for build in BUILDS}
    first, second, last = states["compiled"], states["cortex-m7"], states["cortex-m4f"]
    assert "state.estimator.x_m" in first.dtype.names
    for column in set(first.dtype.names) - {"work_us"}:
        assert first[column].tobytes() == second[column].tobytes(), column
    assert first.dtype == last.dtype
    assert not differences(decisions_of(first), decisions_of(last))
    x_m = last["state.estimator.x_m"]
    assert np.array_equal(x_m, x_m.astype(np.float32))
    assert not np.array_equal(x_m, first["state.estimator.x_m"])


@pytest.mark.usefixtures("tools")
def test_xcp_is_served_as_by_the_compiled_build() -> None:
    nodes = [make(config_from({})) for make in (NativeNode, BoardNode)]
    for frame in commands_of(random.Random(2), 1000):
        sent = [node.tick([frame], 1) for node in nodes]
        assert sent[0] == sent[1], frame
    assert [calibrate(node, "start.rise_s", 6.0) for node in nodes] == [XcpError.NONE] * 2
    assert nodes[1].values["start.rise_s"] == 6.0
    assert nodes[1].config == nodes[0].config
    assert nodes[1].whole.tobytes() == nodes[0].whole.tobytes()


@pytest.mark.usefixtures("tools")
def test_in_single_precision_a_parameter_that_is_written_is_in_the_next_config() -> None:
    node = SinglePrecisionBoardNode(config_from({}))
    before = node.config
    assert calibrate(node, "start.rise_s", 6.0) is XcpError.NONE
    assert staged(node, "start.rise_s") == 6.0
    assert node.config != before


@pytest.mark.usefixtures("tools")
def test_in_single_precision_the_measurements_are_the_members_of_its_own_state() -> None:
    """The offsets follow the state's layout: each measurement is read where the board has stored it."""
    node = SinglePrecisionBoardNode(config_from({}))
    ask(node, XcpCommandCode.CONNECT)
    for index, place in enumerate(elements.ALL):
        upload = command(XcpCommandCode.SHORT_UPLOAD, 4, 0, 0, *(4 * index).to_bytes(4, "little"))
        sent = node.tick([upload], 1)
        word = elements.word_at(from_flat(NodeState, node.memory[0].item()), index)
        assert int.from_bytes(answered(node, sent)[1:5], "little") == word, place.name


@pytest.mark.usefixtures("tools")
def test_a_gain_that_a_board_takes_in_motion_acts_as_in_the_compiled_build() -> None:
    benches = [Bench(build=build).started() for build in ("compiled", "cortex-m7", "compiled")]
    for bench in benches:
        bench.run(2.0, keep=False)
    for bench, gain in zip(benches, (0.5, 0.5, 0.05), strict=True):
        assert calibrate(bench.node, "speed.gain_p_n_m_s", gain) is XcpError.NONE
    differs = False
    for _ in range(300):
        for bench in benches:
            bench.run(0.001, keep=False)
        assert benches[0].sent == benches[1].sent
        differs |= benches[0].sent != benches[2].sent
    assert differs


class MeasuredNode(BoardNode):
    """A board that counts the instructions of each tick, and its stack in bytes."""

    kind = MEASURED_TICK

    def __init__(self) -> None:
        super().__init__(config_from({}))
        self.instructions: list[float] = []
        self.stack_bytes = 0

    def run(self) -> int:
        status = super().run()
        self.instructions.append(float(self.reply["timer_ticks"][0]) / board.TIMER_TICKS_AN_INSTRUCTION)
        self.stack_bytes = max(self.stack_bytes, int(self.reply["stack_bytes"][0]))
        return status


@pytest.mark.usefixtures("tools")
def test_measurement_costs_few_instructions() -> None:
    """Those of a session, and of forty signals at 25 Hz, beyond those of a tick without a session.

    All forty are converted in one tick of forty, which costs more than the others.
    """
    quiet, asked = MeasuredNode(), MeasuredNode()
    places_of_floats = [index for index, place in enumerate(elements.ALL) if place.kind is float][:40]

    def cost(ticks: int) -> list[float]:
        while len(quiet.instructions) < len(asked.instructions):
            quiet.tick([], 1)
        for _ in range(ticks):
            quiet.tick([], 1)
            asked.tick([], 1)
        both = zip(asked.instructions[-ticks:], quiet.instructions[-ticks:], strict=True)
        return [one - other for one, other in both]

    ask(asked, XcpCommandCode.CONNECT)
    connected = cost(100)
    configure(asked, [(places_of_floats, 40)])
    ask(asked, XcpCommandCode.START_STOP_SYNCH, 1)
    running = cost(400)
    print(f"session {max(connected):.0f}, DAQ mean {np.mean(running):.0f}, with a sample {max(running):.0f}")
    assert max(connected) <= 40
    assert np.mean(running) <= 280
    assert max(running) <= 1_700


@pytest.mark.usefixtures("tools")
def test_a_board_ends_with_its_node_and_says_so_when_it_has_died() -> None:
    node = BoardNode(config_from({}))
    process = node._process
    node.tick([], 1)
    del node
    gc.collect()
    assert process.poll() == 0
    node = BoardNode(config_from({}))
    node._process.kill()
    with pytest.raises(BoardDiedError, match="status -9"):
        node.tick([], 1)


@pytest.mark.usefixtures("tools")
@pytest.mark.parametrize(("target", "most_stack"), [("cortex-m7", 4096), ("cortex-m4f", 3072)])
def test_a_commit_of_parameters_fits_into_its_tick_and_into_the_stack(
    target: board.BoardName, most_stack: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """40,000 instructions at 1.3 cycles are 0.31 ms of a tick of 1 ms at 168 MHz."""
    monkeypatch.setattr(MeasuredNode, "target", target)
    node = MeasuredNode()
    assert calibrate(node, "start.rise_s", 6.0) is XcpError.NONE
    assert calibrate(node, "start.capture_ratio", node.values["start.capture_ratio"]) is XcpError.NONE
    print(f"{target}: {max(node.instructions):.0f} instructions, {node.stack_bytes} B")
    assert 10_000 < max(node.instructions) < 40_000
    assert node.stack_bytes < most_stack


@pytest.mark.usefixtures("tools")
def test_a_forked_process_leaves_the_board_of_its_parent_on() -> None:
    node = MeasuredNode()
    with ProcessPoolExecutor(1, get_context("fork")) as child:
        child.submit(os.getpid).result()
    node.tick([], 1)
    assert node.ticks == 1


def test_without_the_tools_a_sentence_names_the_packages(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for arguments in (["run", "damaged-parameters-arm-nothing"], ["suite", "damaged-parameters-arm-nothing"]):
        options = ["--clock", "lockstep", "--firmware", "cortex-m7", "--out", str(tmp_path / "out")]
        assert cli.run([*arguments, *options]) == EXIT_BAD_INPUT
        said = " ".join(capsys.readouterr().err.split())
        assert "arm-none-eabi-gcc and qemu-system-arm" in said
        assert "apt-get install gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm" in said
    board = next(check for check in doctor.checks() if check.name == "emulated board")
    assert not board.passed
    assert board.detail == "no arm-none-eabi-gcc, no qemu-system-arm"


def test_on_the_wall_clock_it_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["run", "damaged-parameters-arm-nothing", "--firmware", "cortex-m7"]) == EXIT_BAD_INPUT
    assert "--clock lockstep" in capsys.readouterr().err
