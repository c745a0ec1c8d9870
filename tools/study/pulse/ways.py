"""The study of one pulse a stride: all ways at all cadences."""

from collections.abc import Sequence

import pyarrow as pa

from tools.study import store, work
from tools.study.pulse.gated import SCENES, gated_piece
from tools.study.pulse.judging import GATED, STRIDES_HZ, SUBHARMONIC, WALKERS
from tools.study.pulse.turns import GROUNDS, LADDER_HZ, MADE, WALK, made_piece


def compute(where: work.Where, ways: Sequence[str], strides_hz: Sequence[float] = STRIDES_HZ) -> pa.Table:
    """Compute the rows of the given ways."""
    made = [
        {"kind": kind._asdict(), "stride_hz": hz, "ground": ground._asdict()}
        for kind in MADE
        if kind.way in ways
        for hz in strides_hz
        for ground in (*(GROUNDS if kind.way == SUBHARMONIC and hz == LADDER_HZ else ()), WALK)
    ]
    paths = work.run("pulse-made", made_piece, made, where) if made else []
    if GATED in ways:
        specs = [
            {"module": module, "stride_hz": hz, "walkers": WALKERS[GATED]}
            for module in SCENES
            for hz in strides_hz
        ]
        paths += work.run("pulse-gated", gated_piece, specs, where)
    return pa.concat_tables([store.read(path)[0] for path in paths])
