"""Sine, cosine, atan2, exp and cube root: true to the last bit or two, and the same bits in every build."""

import ctypes
import itertools
import math
import random
import re
import struct
import subprocess
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import mpmath
import numpy as np
import pytest
from compiled_calls import as_compiled
from compilers import require_compiler
from numba.extending import register_jitable
from numpy.typing import NDArray

from firmware_py.builds.c99.emitter import Emitter
from firmware_py.builds.c99.folder import OPTIONS
from firmware_py.builds.c99.header import header
from firmware_py.builds.c_compiler import TARGETS, TargetName, object_code
from firmware_py.core.elementary import LARGEST_EXACT_RAD, atan2, cube_root, exp, sin, sine_cosine
from firmware_py.core.numbers import wrap_pi

TRIALS = 20_000
dice = random.Random(4)
ANGLES = [
    *(dice.uniform(-LARGEST_EXACT_RAD, LARGEST_EXACT_RAD) for _ in range(TRIALS)),
    *(dice.uniform(-7.0, 7.0) for _ in range(TRIALS)),
    *(sign * 10.0**-k for k in range(300) for sign in (-1, 1)),
    *(math.nextafter(0.25 * k * math.pi, side) for k in range(-127, 128) for side in (-1e9, 1e9)),
    *(0.25 * k * math.pi for k in range(-127, 128)),
    *(LARGEST_EXACT_RAD, -LARGEST_EXACT_RAD),
]
EXPONENTS = [
    *(dice.uniform(-708.0, 709.0) for _ in range(TRIALS)),
    *(dice.gauss(0.0, 1.0) for _ in range(TRIALS)),
]
RATIOS = [
    *(2.0 ** dice.uniform(-1022.0, 1023.0) for _ in range(TRIALS)),
    *(2.0 ** dice.uniform(-9.0, 9.0) for _ in range(TRIALS)),
    *(float(k) for k in range(1, 1001)),
    *(5e-324, sys.float_info.min, sys.float_info.max),
]
PAIRS = [
    *((dice.gauss(0.0, 1.0), dice.gauss(0.0, 1.0)) for _ in range(TRIALS)),
    *((dice.gauss(0.0, 1.0) * 10.0 ** dice.uniform(-9.0, 9.0), dice.gauss(0.0, 1.0)) for _ in range(TRIALS)),
]
EDGES = (0.0, -0.0, 1.0, -1.0, 1e-320, -1e300, 1e300, math.inf, -math.inf, math.nan)


def cos(angle_rad: float) -> float:
    return sine_cosine(angle_rad)[1]


register_jitable(cos)


def ulps(value: float, truth: mpmath.mpf) -> float:
    """By how many units in the last place `value` is off."""
    return abs(float((mpmath.mpf(value) - truth) / math.ulp(float(truth))))


@pytest.mark.parametrize(
    ("function", "reference", "arguments", "most_ulps"),
    [
        (sin, mpmath.sin, [(x,) for x in ANGLES], 1.0),
        (cos, mpmath.cos, [(x,) for x in ANGLES], 1.0),
        (exp, mpmath.exp, [(x,) for x in EXPONENTS], 1.0),
        (cube_root, mpmath.cbrt, [(x,) for x in RATIOS], 0.7),
        (atan2, mpmath.atan2, PAIRS, 1.5),
    ],
)
def test_it_is_true_to_the_last_place(
    function: Callable[..., float],
    reference: Callable[..., mpmath.mpf],
    arguments: list[tuple[float, ...]],
    most_ulps: float,
) -> None:
    with mpmath.workprec(240):
        worst = max((ulps(function(*one), reference(*map(mpmath.mpf, one))), one) for one in arguments)
    assert worst < (most_ulps,)


def test_beyond_its_range_each_gives_what_it_says() -> None:
    for value in (100.1, -3e5, 9.9e8):
        assert sin(value) == sin(wrap_pi(value)) == pytest.approx(math.sin(value), abs=3e-7)
        assert cos(value) == cos(wrap_pi(value)) == pytest.approx(math.cos(value), abs=3e-7)
    for value in (1.1e9, -1e300, math.inf, -math.inf):
        assert (sin(value), cos(value)) == (0.0, 1.0)
    assert (exp(-708.1), exp(-math.inf), exp(709.1), exp(math.inf)) == (0.0, 0.0, math.inf, math.inf)
    assert exp(0.0) == 1.0
    assert [cube_root(x) for x in (0.0, -8.0, math.inf, -math.inf)] == [0.0, -2.0, math.inf, -math.inf]
    assert [f(math.nan) for f in (sin, cos, exp, cube_root)] == pytest.approx([math.nan] * 4, nan_ok=True)


def test_the_angle_of_every_kind_of_point() -> None:
    for y, x in itertools.product(EDGES, EDGES):
        if math.isnan(x) or math.isnan(y):
            assert math.isnan(atan2(y, x))
        else:
            # 0.0 + takes a zero's sign away
            assert atan2(y, x) == pytest.approx(math.atan2(0.0 + y, 0.0 + x), rel=4e-16)


def bits(value: float) -> str:
    """One NaN is as good as another."""
    return "nan" if math.isnan(value) else struct.pack("<d", value).hex()


@pytest.mark.parametrize(
    ("function", "arguments"),
    [
        *((f, [(x,) for x in (*ANGLES, *EDGES, 101.0, -5e8)]) for f in (sin, cos)),
        (exp, [(x,) for x in (*EXPONENTS, *EDGES)]),
        (cube_root, [(x,) for x in (*RATIOS, *EDGES)]),
        (atan2, [*PAIRS, *itertools.product(EDGES, EDGES)]),
    ],
)
def test_interpreted_and_compiled_give_the_same_bits(
    function: Callable[..., float], arguments: list[tuple[float, ...]]
) -> None:
    compiled = as_compiled(function)
    for one in arguments:
        assert bits(compiled(*one)) == bits(function(*one)), one


APPLY = """
void apply(int64_t count, const float *x, const float *y, float *results) {
    for (int64_t k = 0; k < count; k++) {
        float sine, *const result = results + 5 * k;
        result[0] = elementary_sin(x[k]);
        sine = elementary_sine_cosine(x[k], &result[1]);
        (void)sine;
        result[2] = elementary_exp(x[k]);
        result[3] = elementary_cube_root(x[k]);
        result[4] = elementary_atan2(y[k], x[k]);
    }
}
"""


@pytest.fixture(scope="module")
def apply(tmp_path_factory: pytest.TempPathFactory) -> Any:
    """The emitted functions in single precision, with a loop around them."""
    require_compiler("gcc")
    folder = tmp_path_factory.mktemp("apply")
    emitter = Emitter("single", False)
    for function in (sin, sine_cosine, exp, cube_root, atan2):
        emitter.call(function)
    (folder / "vibro_firmware.h").write_text(header("single"))
    (folder / "apply.c").write_text(emitter.text() + APPLY)
    command = ["gcc", *OPTIONS, "-fPIC", "-shared", "apply.c", "-lm", "-o", "apply.so"]
    subprocess.run(command, check=True, cwd=folder)
    return ctypes.CDLL(str(folder / "apply.so")).apply


def in_single_precision(apply: Any, x: NDArray[np.float32], y: NDArray[np.float32]) -> NDArray[np.float32]:
    """The five functions' results for each pair, shape (n, 5)."""
    results = np.zeros((len(x), 5), np.float32)
    pointers = (ctypes.c_void_p(one.ctypes.data) for one in (x, y, results))
    apply(ctypes.c_int64(len(x)), *pointers)
    return results


def floats(values: Iterable[float]) -> NDArray[np.float32]:
    with np.errstate(over="ignore"):
        return np.array(list(values), np.float64).astype(np.float32)


@pytest.mark.parametrize(
    ("column", "reference", "arguments", "most_ulps"),
    [
        (0, math.sin, ANGLES, 0.8),
        (1, math.cos, ANGLES, 0.8),
        (2, math.exp, [x for x in EXPONENTS if -87.0 < x < 88.3], 1.0),
        (3, math.cbrt, [x for x in RATIOS if 2.0**-126 < x < 2.0**128], 2.5),
        (4, math.atan2, PAIRS, 1.5),
    ],
)
def test_in_single_precision_it_is_true_to_the_last_places(
    apply: Any,
    column: int,
    reference: Callable[..., float],
    arguments: Sequence[Any],
    most_ulps: float,
) -> None:
    """The C library's double precision errs by less than 1e-8 of single precision's last place."""
    y = floats(one[0] if column == 4 else 0.0 for one in arguments)
    x = floats(one[1] if column == 4 else one for one in arguments)
    results = in_single_precision(apply, x, y)[:, column]
    worst = 0.0
    for a, b, result in zip(x.tolist(), y.tolist(), results.tolist(), strict=True):
        truth = reference(b, a) if column == 4 else reference(a)
        if abs(truth) > np.finfo(np.float32).tiny:
            worst = max(worst, abs(result - truth) / float(np.spacing(np.float32(abs(truth)))))
    assert 0.4 < worst < most_ulps


def test_in_single_precision_edges_are_what_they_are_in_double(apply: Any) -> None:
    edges = [0.0, -0.0, 1.0, -1.0, 1e38, -1e38, math.inf, -math.inf, math.nan, 710.0, -710.0]
    pairs = list(itertools.product(edges, edges))
    x, y = floats(pair[0] for pair in pairs), floats(pair[1] for pair in pairs)
    given = in_single_precision(apply, x, y)
    wanted = [
        [sin(a), cos(a), exp(a), cube_root(a), atan2(b, a)]
        for a, b in zip(x.tolist(), y.tolist(), strict=True)
    ]
    assert given == pytest.approx(floats(np.ravel(wanted)).reshape(-1, 5), rel=3e-7, abs=1e-4, nan_ok=True)


@pytest.mark.parametrize(
    ("target", "tools"), [("host", ""), ("cortex-m7", "arm-none-eabi-"), ("cortex-m4f", "arm-none-eabi-")]
)
def test_the_firmware_takes_nothing_inexact_from_outside(
    target: TargetName, tools: str, tmp_path: Path
) -> None:
    """No mathematics of a C library, and no multiply-add that rounds once instead of twice."""
    require_compiler(TARGETS[target].compiler)
    path = tmp_path / "firmware.o"
    path.write_bytes(object_code(target))
    symbols = printed(f"{tools}nm", "-u", str(path)).split()[1::2]
    assert symbols
    exact = {"memcpy", "memset", "memmove", "floor", "rint"}
    if target == "cortex-m4f":
        exact = {"memcpy", "memset", "memmove", "floorf", "rintf"}
    assert {symbol for symbol in symbols if not symbol.startswith("__aeabi_")} <= exact
    instructions = printed(f"{tools}objdump", "-d", str(path))
    multiplication = {"host": "mulsd", "cortex-m7": "vmul.f64", "cortex-m4f": "vmul.f32"}[target]
    assert multiplication in instructions
    assert not re.findall(r"\tvfn?m[as]\w*", instructions)
    if target == "cortex-m4f":
        assert not [symbol for symbol in symbols if re.match(r"__aeabi_c?d|__aeabi_\w*2d", symbol)]
        assert ".f64" not in instructions


def printed(*command: str) -> str:
    """What a program prints."""
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout
