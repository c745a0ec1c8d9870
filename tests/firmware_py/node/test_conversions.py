"""Every conversion of a float to an integer stays within 32 bits, for which processors have an instruction.

The emitted C converts to 32 bits (`firmware_py.builds.c99.operations`). The test interprets the
firmware with conversions that check their argument, and reaches each one that the sources have: a new one
fails it until it is reached.
"""

import ast
import importlib
import math
import random
import struct
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest
from walker import walk
from xcp_session import calibrate, commands_of

import firmware_py
from firmware_py.core import elementary
from firmware_py.core.estimation import crank
from firmware_py.interface import codec, framing
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import Accelerometer, EncoderEstimates, GaitSensors
from firmware_py.interface.parameter_table import TABLE
from firmware_py.shell.builds import node_of
from firmware_py.shell.parameters import ParameterError, config_from

ROOT = Path(firmware_py.__file__).parent
IN_A_TICK = [*ROOT.glob("core/**/*.py"), *ROOT.glob("node/*.py"), ROOT / "interface/framing.py"]
CONVERSIONS = {"int": int, "round": round, "floor": math.floor, "ceil": math.ceil}
REPLACED = {("firmware_py.node.elements", "word_at")}
"""Functions that compiled builds replace by others, which convert no float."""
FOLLOWS = {"gait.follow": 1, "gait.lowest_ratio": 0.5}

Site = tuple[str, str]
"""A function that converts: its module and its name."""


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT.parent).with_suffix("").parts)


def sites_of(path: Path) -> set[Site]:
    """The functions in a file that call a conversion."""
    return {
        (module_of(path), function.name)
        for function in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(function, ast.FunctionDef)
        for call in ast.walk(function)
        if isinstance(call, ast.Call)
        and (call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", ""))
        in CONVERSIONS
    }


SITES = set().union(*map(sites_of, IN_A_TICK)) - REPLACED


@pytest.fixture
def reached(monkeypatch: pytest.MonkeyPatch) -> set[Site]:
    """The functions that have converted a float; each conversion is checked."""
    found: set[Site] = set()

    def checked(convert: Callable[[Any], Any], name: str) -> Callable[[Any], Any]:
        def call(value: Any) -> Any:
            if isinstance(value, float):
                assert -(2.0**31) <= value < 2.0**31, (name, value)
                found.update(site for site in SITES if site[0] == name)
            return convert(value)

        return call

    for name in {name for name, _ in SITES}:
        module: ModuleType = importlib.import_module(name)
        for word in ("int", "round"):
            monkeypatch.setattr(module, word, checked(CONVERSIONS[word], name), raising=False)
        if "math" in vars(module):
            floors = {word: checked(CONVERSIONS[word], name) for word in ("floor", "ceil")}
            monkeypatch.setattr(module, "math", SimpleNamespace(**{**vars(math), **floors}))
    return found


def hostile_frames(dice: random.Random, tick: int, turns: float) -> list[Frame]:
    """Readings of sensors at the ends of their ranges, jumping or not."""
    far = dice.choice((0.0, 1.0, -1.0, 1e3, -1e3))
    position = dice.choice((turns, turns, turns, turns + far, 1e30, -3e38))
    sample = Accelerometer(far, 10.0 * far, -far)
    return [
        codec.encode(EncoderEstimates(position, dice.choice((2.0, 2.0, 1e20, -1e20))), tick),
        codec.ACCELEROMETER.encode(sample, tick),
    ]


def test_conversions_of_any_argument_stay_within_32_bits(reached: set[Site]) -> None:
    """Those whose functions bound their argument themselves; the others rely on their callers."""
    ends = (0.0, 1e-300, 1e-9, 1.0, 700.0, 709.0, 710.0, 2.0**31, 1e19, 1e300, math.inf, math.nan)
    values = [sign * value for value in ends for sign in (1.0, -1.0)]
    for value in values:
        elementary.exp(value)
        for low, high in ((0, 1), (-128, 127), (-(2**31), 2**31 - 1)):
            assert low <= framing.saturate(value, low, high) <= high
        for way_rad in filter(math.isfinite, values if math.isfinite(value) else []):
            late = crank.INITIAL._replace(late_ticks=3, missed_ticks=10)
            assert 0 <= crank.estimate_age(late, 1, way_rad, value) <= crank.LATEST_TICKS
    assert {name for name, _ in reached} == {one.__name__ for one in (crank, elementary, framing)}


def test_every_conversion_to_an_integer_stays_within_32_bits(reached: set[Site]) -> None:
    for parameter in TABLE:
        for bound in (parameter.low, parameter.high):
            try:
                config_from({parameter.name: bound})
            except ParameterError:  # no conflict with the other parameters is permitted
                continue
    dice = random.Random(1)
    node = node_of("python")(config_from(FOLLOWS))
    steps = walk(np.random.default_rng(1), stride_s=0.75, count=8)
    for tick in range(6000):
        frames = hostile_frames(dice, tick, 2e-3 * tick) if tick % 2 else []
        if tick % 5 == 0 and tick // 5 < len(steps.t_s):
            row = tick // 5
            shown = GaitSensors(float(steps.rate_rad_s[row]), 9.8, int(steps.heel[row]), int(steps.toe[row]))
            frames.append(codec.encode(shown, row))
        node.tick(frames, 1)
    for frame in commands_of(dice, 1000):
        node.tick([frame], 1)
    for parameter in TABLE:
        for value in (parameter.low, parameter.high, 1e30, -1e30, math.inf, math.nan):
            calibrate(node, parameter.name, struct.unpack("<f", struct.pack("<f", value))[0])
    assert reached == SITES
