"""The object file on a board: its beginning, its headers, and the page's example, which C accepts."""

import ctypes
import struct
import subprocess
from pathlib import Path

import pytest
from closed_loop import Bench
from compilers import require_compiler
from xcp_session import command

from firmware_py.builds import c_compiler
from firmware_py.builds.c99.header import config_header, header
from firmware_py.builds.c_compiler import CompilerError, measure_sizes, object_code, shared_library
from firmware_py.builds.flat import Precision, to_flat, to_precision
from firmware_py.core.config import Config
from firmware_py.interface.enums import XcpCommandCode
from firmware_py.interface.frame import Frame, word_of
from firmware_py.interface.parameter_table import INDEX
from firmware_py.node import xcp
from firmware_py.node.memory import INITIAL
from firmware_py.shell.builds import node_of
from firmware_py.shell.parameters import config_from


def test_the_c_begins_as_the_compiled_build_does() -> None:
    require_compiler("gcc")
    wanted = to_flat(INITIAL)
    content = ctypes.create_string_buffer(b"\xff" * wanted.nbytes, wanted.nbytes)
    ctypes.CDLL(str(shared_library("host"))).vibro_power_up(content)
    assert content.raw == wanted.tobytes()


def test_without_a_compiler_the_build_names_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c_compiler.shutil, "which", lambda _: None)
    with pytest.raises(CompilerError, match=r"cortex-m7 needs arm-none-eabi-gcc; .*gcc-arm-none-eabi"):
        object_code("cortex-m7")
    with pytest.raises(CompilerError, match=r"host-single needs gcc; .*apt-get install gcc"):
        shared_library("host-single")


def test_sizes_are_counted() -> None:
    require_compiler("gcc")
    found, single = measure_sizes("host"), measure_sizes("host-single")
    assert found["state"] == to_flat(INITIAL).nbytes
    assert 0.5 * found["state"] < single["state"] < found["state"]
    assert 0.5 * found["config"] < single["config"] < found["config"]
    assert found["code"] > 20_000
    assert 5_000 < found["constants"] < found["code"]


EXAMPLE = Path(__file__).parents[3] / "docs/how-to/put-the-firmware-on-a-board/control.c"
DRIVER = """
static int64_t frames[4096][3];
static int64_t count;
int64_t *sent(void) { return &frames[0][0]; }
int64_t sent_count(void) { return count; }
const void *built_config(void) { return &VIBRO_CONFIG; }
void can_send(uint32_t can_id, uint32_t length, const void *data) {
    frames[count][0] = can_id;
    frames[count][1] = length;
    memcpy(&frames[count++][2], data, length);
}
"""


def example() -> str:
    """The code beside the page for people with a board."""
    return EXAMPLE.read_text("utf-8")


def compiled(compiler: str, source: Path, text: str, *options: str, precision: Precision = "double") -> None:
    require_compiler(compiler)
    (source.parent / "vibro_firmware.h").write_text(header(precision))
    (source.parent / "vibro_config.h").write_text(config_header(config_from({}), precision))
    source.write_text(text)
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
    subprocess.run([compiler, *strict, str(source), *options], check=True)


CONFIG = """#include "vibro_config.h"
const void *config(void);
const void *config(void) { return &VIBRO_CONFIG; }
"""


@pytest.mark.parametrize("precision", ["double", "single"])
@pytest.mark.parametrize(
    ("compiler", "standard"),
    [("gcc", "c99"), ("gcc", "c11"), ("g++", "c++11"), ("g++", "c++20"), ("arm-none-eabi-gcc", "c99")],
)
def test_the_headers_are_valid_and_describe_the_memory_of_the_structs(
    compiler: str, standard: str, precision: Precision, tmp_path: Path
) -> None:
    source = tmp_path / ("a.cpp" if compiler == "g++" else "a.c")
    options = [f"-std={standard}", "-pedantic-errors", "-c", "-o", str(tmp_path / "a.o")]
    compiled(compiler, source, CONFIG, *options, precision=precision)


@pytest.mark.parametrize("precision", ["double", "single"])
def test_the_example_for_a_board_compiles_for_one(precision: Precision, tmp_path: Path) -> None:
    options = ["-c", "-Wdouble-promotion", "-o", str(tmp_path / "a.o")]
    compiled("arm-none-eabi-gcc", tmp_path / "a.c", example(), *options, precision=precision)


def test_a_config_in_single_precision_is_rounded_once(tmp_path: Path) -> None:
    config = config_from({})
    options = ["-fPIC", "-shared", "-o", str(tmp_path / "config.so")]
    compiled("gcc", tmp_path / "a.c", CONFIG, *options, precision="single")
    library = ctypes.CDLL(str(tmp_path / "config.so"))
    library.config.restype = ctypes.c_void_p
    wanted = to_precision(to_flat(config), Config, "single")
    assert ctypes.string_at(library.config(), wanted.nbytes) == wanted.tobytes()


@pytest.fixture
def board(tmp_path: Path) -> ctypes.CDLL:
    """The example with the firmware as a shared library."""
    require_compiler("gcc")
    (tmp_path / "vibro_firmware.o").write_bytes(object_code("host"))
    library = tmp_path / "board.so"
    more = (str(tmp_path / "vibro_firmware.o"), "-fPIC", "-shared", "-lm", "-o", str(library))
    compiled("gcc", tmp_path / "a.c", example() + DRIVER, *more)
    board = ctypes.CDLL(str(library))
    board.sent.restype = ctypes.POINTER(ctypes.c_int64)
    board.built_config.restype = ctypes.c_void_p
    return board


@pytest.mark.requirement("S-07")
@pytest.mark.parametrize("elapsed_ticks", [1, 10])
def test_the_example_for_a_board_keeps_an_e_stop_before_a_flood(
    elapsed_ticks: int, board: ctypes.CDLL
) -> None:
    """The drive's E-stop is passed on in the next tick."""
    board.control_power_up()
    board.control_receive(0x002, 0, b"")
    for _ in range(1000):
        board.control_receive(0x009, 8, bytes(8))
    board.control_tick(ctypes.c_int64(elapsed_ticks))
    assert 0x002 in board.sent()[: 3 * board.sent_count() : 3]


def test_the_example_for_a_board_sends_what_the_compiled_build_does(board: ctypes.CDLL) -> None:
    wanted = to_flat(config_from({}))
    assert ctypes.string_at(board.built_config(), wanted.nbytes) == wanted.tobytes()
    sent: list[tuple[int, int, int]] = []
    board.control_power_up()

    gain = 4 * INDEX["speed.gain_p_n_m_s"]
    writes = [(gain, struct.pack("<f", 0.06)), (4 * xcp.COMMIT, struct.pack("<I", 1))]
    commands = [command(XcpCommandCode.CONNECT)]
    for address, data in writes:
        mta = (0, 0, xcp.CHARACTERISTICS, *struct.pack("<I", address))
        commands += [command(XcpCommandCode.SET_MTA, *mta), command(XcpCommandCode.DOWNLOAD, 4, *data)]

    def change(tick: int, frames: list[Frame]) -> list[Frame]:
        if tick % 10 == 0 and commands:
            frames = [*frames, commands.pop(0)]
        for frame in frames:
            board.control_receive(frame.can_id, len(frame.data), frame.data)
        board.control_tick(ctypes.c_int64(1))
        sent.extend((frame.can_id, len(frame.data), word_of(frame.data)) for frame in node.tick(frames, 1))
        return frames

    node = node_of("compiled")(config_from({}))
    bench = Bench(change=change, build="python")
    bench.started()
    bench.run(0.5, keep=False)
    words = board.sent()[: 3 * board.sent_count()]
    assert list(zip(words[::3], words[1::3], words[2::3], strict=True)) == sent
    assert len(sent) > 500
    assert node.values["speed.gain_p_n_m_s"] == pytest.approx(0.06, abs=1e-8)
