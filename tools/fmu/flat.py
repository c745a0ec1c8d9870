"""Blocks of an instance's memory without arrays."""

from typing import Any, NamedTuple

import numpy as np

from firmware_py.builds.flat import stored


class Flat(NamedTuple):
    """Words of an instance's memory that hold no array."""

    words: list[int]
    record: tuple[()] = ()


def flat(record: tuple[Any, ...]) -> Flat:
    """A record of the firmware's subset, as in `firmware_py.builds.flat`."""
    content = stored(record).tobytes()
    return Flat(np.frombuffer(content.ljust(-(-len(content) // 8) * 8, b"\0"), np.int64).tolist())
