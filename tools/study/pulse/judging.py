"""Judge walks: the share of strides with one impact in the push-off window, and the impacts' properties."""

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
"""Number of judged strides of each walk."""

COLUMNS = store.columns(
    "way module ground axis stride_hz turns spring_n_m amplitude_m gap_m strides right without several "
    "phase_std impulse_n_s felt_low_n felt_median_n felt_high_n leg_alone_hz torque_n_m drive_w copper_w",
    texts="way module ground axis",
    counts="turns strides",
)


class Walked(NamedTuple):
    """A finished walk: its motion, its strides, the motor's largest torque, mean power and copper loss."""

    run: Driven
    walking: Walking
    torque_n_m: float = math.nan
    drive_w: float = math.nan
    copper_w: float = math.nan


def cycles(walking: Walking, t_s: float) -> float:
    """Return the number of gait cycles since the walk's first heel strike."""
    return cycles_at(walking.rows[row_at(walking.rows, t_s)], t_s)


def hits(impacts: Sequence[Impact]) -> list[Impact]:
    """Return the impacts without grazing ones, which are slower than SOFTEST_M_S."""
    return [impact for impact in impacts if impact.v_m_s >= SOFTEST_M_S]


def judged(walks: Sequence[Walked], first: int) -> dict[str, Any]:
    """Judge the strides of all walks from stride `first` on.

    Returns the shares of strides that are right, without an impact, and with several impacts; the deviation
    of the impacts' phase; impulse, felt force, torque and power.
    """
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
