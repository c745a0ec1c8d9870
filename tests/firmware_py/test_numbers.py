"""The scalar helpers: stated results for every float, the same bits interpreted and compiled."""

import math
import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest

from firmware_py.core.numbers import TAU, turned, wrapped

EVERY_KIND = (0.0, -0.0, 1e-20, -1e-20, 3.0, -3.0, math.pi, -math.pi, TAU, -TAU, 1e3, -1e5, 1e9, -1e9)
NO_ANGLES = (math.nan, math.inf, -math.inf, 1e19, -1e19, 1e300, -1e300)

COMPILED = """
import struct, sys
from firmware_py.core.numbers import turned, wrapped
for text in sys.argv[1:]:
    for function in (wrapped, turned):
        print(struct.pack("<d", function(float(text))).hex())
"""


@pytest.mark.xfail(strict=True, reason="math.floor raises on NaN and infinities")
def test_what_is_no_angle_is_wrapped_to_zero() -> None:
    for value in NO_ANGLES:
        assert wrapped(value) == 0.0
        assert turned(value) == 0.0


@pytest.mark.xfail(strict=True, reason="interpreted they raise, compiled the floor is an undefined integer")
def test_interpreted_and_compiled_give_the_same_bits() -> None:
    values = EVERY_KIND + NO_ANGLES
    run = subprocess.run(
        [sys.executable, "-c", COMPILED, *map(repr, values)],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | {"VIBROHIL_COMPILED": "1"},
        cwd=Path(__file__).parents[2],
    )
    here = [struct.pack("<d", function(value)).hex() for value in values for function in (wrapped, turned)]
    assert run.stdout.split() == here
