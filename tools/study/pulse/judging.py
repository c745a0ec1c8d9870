"""The strides with one impact in the push-off window, and the properties of these impacts."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from plant_sim.parts.walking import BEGIN_S, Walking, cycles_at, row_at
from plant_sim.result import Impact
from tools.study import store
from tools.study.feasibility.feasibility import SOFTEST_M_S, Driven, pulses_n
from tools.study.pulse.gate import WINDOW_MIDDLE

WINDOW = (0.45, 0.60)
STRIDES_HZ = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1)
TURN, SUBHARMONIC, GATED = "turn", "subharmonic", "gated"
WAYS = (TURN, SUBHARMONIC, GATED)
WALKERS = {TURN: 2, SUBHARMONIC: 2, GATED: 6}
JUDGED = 40
"""Strides of each walk that are judged."""

COLUMNS = store.columns(
    "way module ground axis stride_hz turns spring_n_m amplitude_m gap_m strides right without several "
    "phase_std impulse_n_s felt_low_n felt_median_n felt_high_n leg_alone_hz torque_n_m drive_w copper_w",
    texts="way module ground axis",
    counts="turns strides",
)


class Walked(NamedTuple):
    """A walk's end: its motion, the strides' beginnings, and what the motor gave."""

    run: Driven
    walking: Walking
    torque_n_m: float = math.nan
    drive_w: float = math.nan
    copper_w: float = math.nan


def cycles(walking: Walking, t_s: float) -> float:
    """Cycles since the walk's first heel strike."""
    return cycles_at(walking.rows[row_at(walking.rows, t_s)], t_s)


def hits(impacts: Sequence[Impact]) -> list[Impact]:
    """Those that are none of a graze."""
    return [impact for impact in impacts if impact.v_m_s >= SOFTEST_M_S]


def judged(walks: Sequence[Walked], first: int) -> dict[str, Any]:
    """Strides of all walks from the `first` on: how many have one impact in the window, and its figures."""
    counts, right, phases, impulses, felt = [], 0, [], [], []
    for walked in walks:
        hard = hits(walked.run.impacts)
        at = np.array([cycles(walked.walking, impact.t_s) for impact in hard])
        last = math.floor(cycles(walked.walking, walked.run.t_s[-1]))
        for stride in range(first, min(first + JUDGED, last)):
            own = np.flatnonzero(np.floor(at) == stride)
            counts.append(len(own))
            phases += (at[own] - stride).tolist()
            impulses += [hard[k].impulse_n_s for k in own]
            right += len(own) == 1 and WINDOW[0] <= at[own[0]] - stride <= WINDOW[1]
        begins_s = walked.walking.rows[first, BEGIN_S]
        felt.append(pulses_n(walked.run, float(begins_s)))
    number, forces = np.array(counts), np.concatenate(felt)
    off = (np.array(phases) - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5
    low, middle, high = np.quantile(forces, (0.0, 0.5, 1.0)).tolist() if len(forces) else (math.nan,) * 3
    return {
        "strides": len(number),
        "right": float(right) / len(number),
        "without": float(np.mean(number == 0)),
        "several": float(np.mean(number > 1)),
        "phase_std": float(np.std(off)) if len(off) else math.nan,
        "impulse_n_s": float(np.median(impulses)) if impulses else math.nan,
        "felt_low_n": low,
        "felt_median_n": middle,
        "felt_high_n": high,
        "torque_n_m": float(max(walked.torque_n_m for walked in walks)),
        "drive_w": float(np.mean([walked.drive_w for walked in walks])),
        "copper_w": float(np.mean([walked.copper_w for walked in walks])),
    }
