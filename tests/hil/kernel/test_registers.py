"""The library for user-mode Linux on processors with AMX; it does the same with registers of any size."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from hil.kernel import registers
from hil.kernel import user_mode_linux as uml

SETS_A_PART = """
import ctypes, errno, os, signal
libc = ctypes.CDLL(None, use_errno=True)
libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_void_p, ctypes.c_void_p]
libc.ptrace.restype = ctypes.c_long
TRACE_ME, PEEK, GET, SET, XSTATE = 0, 2, 0x4204, 0x4205, 0x202
word = ctypes.c_long(1234567)

class Part(ctypes.Structure):
    _fields_ = [("base", ctypes.c_void_p), ("length", ctypes.c_size_t)]

child = os.fork()
if child == 0:
    libc.ptrace(TRACE_ME, 0, None, None)
    os.kill(os.getpid(), signal.SIGSTOP)
    os._exit(7)
os.waitpid(child, 0)
assert libc.ptrace(PEEK, child, ctypes.addressof(word), None) == 1234567
held = ctypes.create_string_buffer(65536)
part = Part(ctypes.addressof(held), 65536)
assert libc.ptrace(GET, child, XSTATE, ctypes.addressof(part)) == 0
held[24:28] = (0x1F80 | 0x8000).to_bytes(4, "little")  # flush to zero, in the register MXCSR
whole, part.length = part.length, part.length - 64
status = libc.ptrace(SET, child, XSTATE, ctypes.addressof(part))
if status < 0:
    print(errno.errorcode[ctypes.get_errno()])
else:
    again = ctypes.create_string_buffer(65536)
    every = Part(ctypes.addressof(again), 65536)
    assert libc.ptrace(GET, child, XSTATE, ctypes.addressof(every)) == 0
    assert every.length == whole
    print("set" if again.raw[24:28] == held.raw[24:28] else "not set")
os.kill(child, signal.SIGKILL)
"""

KEEPS_ITS_NUMBERS = """
import multiprocessing, time
import numpy as np

def same(seed):
    values = np.random.default_rng(seed).normal(size=4096)
    first, end_s = np.sqrt(values @ values), time.monotonic() + 1.0
    while time.monotonic() < end_s:
        if np.sqrt(values @ values) != first:
            return False
    return True

with multiprocessing.Pool(3) as pool:
    print(pool.map(same, range(3)))
"""


def test_processors_with_amx_are_known_by_their_flags() -> None:
    assert registers.has_amx("processor : 0\nflags\t\t: fpu avx512f amx_bf16 amx_tile\n")
    assert not registers.has_amx("processor : 0\nflags\t\t: fpu avx512f\n")
    assert not registers.has_amx("")


@pytest.mark.skipif(shutil.which(registers.COMPILER) is None, reason=registers.REMEDY)
def test_a_part_of_the_registers_can_be_set(tmp_path: Path) -> None:
    """Linux refuses to; with the library the part is set and the rest stays."""
    program = [sys.executable, "-c", SETS_A_PART]
    alone = subprocess.run(program, check=False, capture_output=True, text=True, timeout=60)
    assert alone.stdout == "EFAULT\n", alone.stderr
    environment = {**os.environ, "LD_PRELOAD": str(registers.make_library(tmp_path))}
    with_it = subprocess.run(
        program, check=False, capture_output=True, text=True, timeout=60, env=environment
    )
    assert with_it.stdout == "set\n", with_it.stderr


def test_user_mode_linux_needs_the_compiler_on_such_a_processor_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    for needs, missing in ((True, ["linux.uml", "busybox", "gcc"]), (False, ["linux.uml", "busybox"])):
        monkeypatch.setattr(uml, "has_amx", lambda _, needs=needs: needs)
        assert uml.missing_programs() == missing


def test_without_a_compiler_the_error_names_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(registers.RegistersError, match=r"has AMX.*apt-get install gcc"):
        registers.make_library(tmp_path)


@pytest.mark.uml
def test_processes_in_the_guest_keep_their_vector_registers(capfd: pytest.CaptureFixture[str]) -> None:
    assert uml.run_in_kernel([sys.executable, "-c", KEEPS_ITS_NUMBERS]) == 0
    assert capfd.readouterr().out == "[True, True, True]\n"
