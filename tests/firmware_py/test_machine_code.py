"""The firmware as an object file: the same bits as numba's own code, and a header that C accepts."""

import ctypes
import random
import shutil
import subprocess
from pathlib import Path
from typing import Any

import llvmlite.binding as llvm
import pytest
from closed_loop import Bench

from firmware_py.builds.c_header import header
from firmware_py.builds.flat import stored
from firmware_py.builds.machine_code import object_code, sizes
from firmware_py.interface.frame import Frame, word_of
from firmware_py.node.tick import INITIAL, NO_TX
from firmware_py.shell.builds import node_of
from firmware_py.shell.node import fitting
from firmware_py.shell.parameters import config_from


@pytest.fixture(scope="module")
def loaded() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    engine = llvm.create_mcjit_compiler(
        llvm.parse_assembly(""), llvm.Target.from_default_triple().create_target_machine()
    )
    engine.add_object_file(llvm.ObjectFileRef.from_data(object_code("host")))
    engine.finalize_object()
    return engine


def test_the_object_file_computes_the_bits_of_the_compiled_build(loaded: Any) -> None:
    pointer, integer = ctypes.c_void_p, ctypes.c_int64
    prototype = ctypes.CFUNCTYPE(ctypes.c_int32, pointer, pointer, integer, integer, pointer, pointer)
    tick = prototype(loaded.get_function_address("vibro_tick"))
    dice = random.Random(1)
    parameters = {"start.rise_s": 2.0, "start.confirm_periods": 2}
    node = node_of("compiled")(config_from(parameters), parameters)
    config, state, tx = stored(config_from(parameters)), stored(INITIAL), stored(NO_TX)

    def change(_: int, frames: list[Frame]) -> list[Frame]:
        kept = [frame for frame in frames if dice.random() < 0.99]
        words = [
            word for frame in fitting(kept) for word in (frame.can_id, len(frame.data), word_of(frame.data))
        ]
        memory = (integer * len(words))(*words)
        status = tick(config.ctypes.data, state.ctypes.data, 1, len(words) // 3, memory, tx.ctypes.data)
        node.tick(kept, 1)
        assert status == 0
        assert node.memory is not None
        assert state.tobytes() == node.memory.tobytes(), bench.tick
        return kept

    bench = Bench(parameters, change=change)
    bench.started()
    bench.run(4.5, keep=False)
    assert bench.node.outputs.torque_n_m != 0.0


def test_it_begins_as_the_compiled_build_does(loaded: Any) -> None:
    for name, wanted in (("initial_state", stored(INITIAL)), ("default_config", stored(config_from({})))):
        content = ctypes.string_at(loaded.get_global_value_address(f"vibro_{name}"), wanted.nbytes)
        assert content == wanted.tobytes()


def test_sizes_are_counted() -> None:
    found = sizes(object_code("host"))
    assert found["state"] == stored(INITIAL).nbytes
    assert found["code"] > 20_000
    assert found["constants"] > found["state"] + found["config"]


@pytest.mark.parametrize("compiler", ["gcc", "g++", "arm-none-eabi-gcc"])
def test_the_header_describes_the_memory_of_the_structs(compiler: str, tmp_path: Path) -> None:
    if shutil.which(compiler) is None:
        pytest.skip(f"no {compiler} on this machine")
    (tmp_path / "vibro_firmware.h").write_text(header())
    source = tmp_path / ("a.cpp" if compiler == "g++" else "a.c")
    source.write_text('#include "vibro_firmware.h"\n')  # the header holds each struct's size itself
    options = ["-Wall", "-Wextra", "-Wpedantic", "-Werror", "-c", str(source), "-o", str(tmp_path / "a.o")]
    subprocess.run([compiler, *options], check=True)
