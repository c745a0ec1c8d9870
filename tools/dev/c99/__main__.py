"""`python -m tools.dev.c99 [RUN…]`: the emitted C under other compilers, checkers and sanitizers.

It compiles the C without a warning by gcc and clang, in both precisions, with and without the gait, and runs
cppcheck. The received frames of each run folder then go through the C of gcc, of clang and of gcc with ASan
and UBSan: all must send the same frames and end in the same state, in double precision those of the
`compiled` build. `--misra FILE` instead writes the table of the rules of MISRA C:2012 that the C does not
follow, found by cppcheck's addon, with the reason for each.
"""

import argparse
import itertools
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from firmware_py.builds.c99.emitter import emit
from firmware_py.builds.c99.folder import OPTIONS
from firmware_py.builds.c99.header import header
from firmware_py.builds.flat import Precision
from firmware_py.interface.frame import word_of
from firmware_py.shell.native import NativeNode, SinglePrecisionNode
from firmware_py.shell.parameters import config_from
from hil.run_files import RunFile
from hil.scenario.scenario import load_scenario
from tools.dev.builds import numbers_in
from tools.runs.replay import divide_on_grid, frames_of_run

DRIVER = Path(__file__).with_name("driver.c")
STRICT = ("-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Werror")
SANITIZED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
PRECISIONS: tuple[Precision, ...] = ("double", "single")
COMPILERS = {"gcc": ("gcc",), "clang": ("clang",), "gcc with ASan and UBSan": ("gcc", *SANITIZED)}
CPPCHECK = (
    "cppcheck",
    "--quiet",
    "--std=c99",
    "--enable=warning,performance,portability",
    "--error-exitcode=1",
)
MISRA = ("cppcheck", "--quiet", "--std=c99", "--addon=misra", "--template={id}")
PAGE = """\
# MISRA C:2012

Written by `python -m tools.dev.c99 --misra FILE`: the rules that the emitted C (`vibrohil firmware c`) does
not follow, as cppcheck's addon finds them, and why.

| rule | reason |
|---|---|
"""
REASONS = {
    "2.4": "A tag names an enum for readers; its values are stored as 64-bit integers.",
    "7.2": "The constant masks 64-bit integers, which hold it without a sign.",
    "8.9": "The constants stand together, each under its module's name.",
    "10.1": "Frames are packed by shifts and masks of 64-bit integers that are never negative.",
    "10.4": "Enums are compared with the 64-bit integers that store them.",
    "10.6": "A choice of 0 or 1 is stored as a 64-bit integer.",
    "10.8": "Counts become floats, and rounded floats within 32 bits become counts, where both are exact.",
    "12.1": "Products in sums need no parentheses; && with ||, shifts and bit operations have them.",
    "14.4": "The conditions are of type bool; the addon does not see the type of a member.",
    "15.5": "A function returns where its result is known, as its Python source does.",
    "15.7": "Nothing remains to be done where no condition holds.",
    "17.7": "memcpy and memset return their own argument.",
    "17.8": "A parameter that its Python source assigns is a variable.",
    "18.4": "Measurements and parameters are read at their offsets in a struct.",
}
"""Why a rule is not followed."""


class CheckError(AssertionError):
    """The C breaks a promise."""


def write_source(folder: Path, precision: Precision, has_gait: bool = True) -> Path:
    """Write source and header; the path of the source."""
    (folder / "vibro_firmware.h").write_text(header(precision), encoding="utf-8")
    source = folder / "vibro_firmware.c"
    source.write_text(emit(precision, has_gait).text(), encoding="utf-8")
    return source


def run(command: Sequence[str | Path], given: bytes = b"") -> bytes:
    """The output of a command; CheckError with its messages if it fails."""
    done = subprocess.run(command, input=given, capture_output=True, check=False)
    if done.returncode != 0:
        raise CheckError(f"{' '.join(map(str, command))}: {(done.stderr or done.stdout).decode()[-4000:]}")
    return done.stdout


def check_source(precision: Precision, has_gait: bool) -> None:
    """Compile without a warning by each compiler, and run cppcheck."""
    with tempfile.TemporaryDirectory() as temporary:
        source = write_source(Path(temporary), precision, has_gait)
        for compiler in ("gcc", "clang"):
            run([compiler, *OPTIONS, *STRICT, "-c", source, "-o", "/dev/null"])
        run([*CPPCHECK, source])


def programs(folder: Path, precision: Precision) -> dict[str, Path]:
    """The driver with the C by each compiler."""
    folder.mkdir()
    source, found = write_source(folder, precision), {}
    for index, (name, (compiler, *options)) in enumerate(COMPILERS.items()):
        found[name] = folder / f"driver{index}"
        run([compiler, *OPTIONS, *options, "-I", folder, DRIVER, source, "-lm", "-o", found[name]])
    return found


def received_words(run_folder: Path, node: NativeNode) -> list[NDArray[np.int64]]:
    """The received frames of each tick of a run as words: identifier, length and data of each."""
    scenario = load_scenario(str(run_folder / RunFile.SCENARIO))
    _, ticks = divide_on_grid(frames_of_run(run_folder / RunFile.CAN_LOG), node.config.tick_s, scenario.ticks)
    frames = ([(can_id, len(data), word_of(data)) for can_id, data in tick.received] for tick in ticks)
    return [np.array(one, np.int64).ravel() for one in frames]


def compare(run_folder: Path, drivers: dict[str, Path], precision: Precision) -> int:
    """Send the received frames of a run through each program; the number of ticks."""
    parameters = load_scenario(str(run_folder / RunFile.SCENARIO)).parameters
    node = (NativeNode if precision == "double" else SinglePrecisionNode)(config_from(parameters))
    ticks = received_words(run_folder, node)
    words = b"".join(np.int64(len(one) // 3).tobytes() + one.tobytes() for one in ticks)
    given = (
        node.native.config.tobytes() + node.native.state.tobytes() + np.int64(len(ticks)).tobytes() + words
    )
    found = {name: run([program], given) for name, program in drivers.items()}
    found["the build in this process"] = own_output(node, ticks)
    numbers = np.fromiter(numbers_in(node.native.state.dtype), np.int64)
    contents = {
        name: without_padding(output, node.native.state.nbytes, numbers) for name, output in found.items()
    }
    (first, wanted), *others = contents.items()
    for name, content in others:
        if content != wanted:
            raise CheckError(f"{run_folder}: {name} differs from {first} in {precision} precision")
    return len(ticks)


def without_padding(output: bytes, state_bytes: int, numbers: NDArray[np.int64]) -> tuple[bytes, bytes]:
    """The frames that a program has sent, and the numbers of its last state."""
    return output[:-state_bytes], np.frombuffer(output[-state_bytes:], np.uint8)[numbers].tobytes()


def own_output(node: NativeNode, ticks: Sequence[NDArray[np.int64]]) -> bytes:
    """What the driver writes, from a node of this process; its writes over XCP are judged in Python."""
    output = bytearray()
    for words in ticks:
        node.receive_rows(len(words) // 3, np.append(words, 0).tobytes())
        for _ in range(node.advance(1)):
            node.calibrate()
            node.run()
            sent = node.tx.view(np.int64)
            output += sent[: 1 + 3 * int(sent[0])].tobytes()
    return bytes(output) + node.native.state.tobytes()


def misra_table() -> str:
    """The page with the rules that the C does not follow; CheckError if a reason is missing."""
    with tempfile.TemporaryDirectory() as temporary:
        source = write_source(Path(temporary), "double")
        done = subprocess.run([*MISRA, source], capture_output=True, text=True, check=False)
    rules = {
        one.removeprefix("misra-c2012-") for one in done.stderr.split() if one.startswith("misra-c2012-")
    }
    if rules != set(REASONS):
        missing, needless = sorted(rules - set(REASONS)), sorted(set(REASONS) - rules)
        raise CheckError(
            f"rules of MISRA C:2012 without a reason in REASONS: {missing}; not broken: {needless}"
        )
    return PAGE + "\n".join(f"| {rule} | {reason} |" for rule, reason in REASONS.items()) + "\n"


def main() -> None:
    """Check the C, and exit with status 1 at the first promise that it breaks."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.c99", description=__doc__)
    parser.add_argument("runs", nargs="*", type=Path, metavar="RUN")
    parser.add_argument("--misra", type=Path, metavar="FILE")
    given = parser.parse_args()
    try:
        if given.misra:
            given.misra.write_text(misra_table(), encoding="utf-8")
            return
        for precision, has_gait in itertools.product(PRECISIONS, (True, False)):
            check_source(precision, has_gait)
            print(
                f"{precision}, {'with' if has_gait else 'without'} the gait: no warning, no finding",
                flush=True,
            )
        with tempfile.TemporaryDirectory() as temporary:
            drivers = {
                precision: programs(Path(temporary) / precision, precision) for precision in PRECISIONS
            }
            for folder in (one for one in given.runs if (one / RunFile.CAN_LOG).exists()):
                ticks = [compare(folder, drivers[precision], precision) for precision in PRECISIONS]
                print(
                    f"{folder.name}: {ticks[0]} ticks, the same frames and state from {', '.join(COMPILERS)}",
                    flush=True,
                )
    except CheckError as error:
        print(error, file=sys.stderr)
        sys.exit(1)


if __name__ == "__main__":
    main()
