"""Quality of the impact detection: detections matched one to one with the true touch-downs.

A detection belongs to the touch-down it follows by no more than `LONGEST_LATENCY_S`. Of all one-to-one
matchings the one with most pairs, and of those with the least total latency, is taken: an assignment problem,
solved in each group of neighbours on its own.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from plant_sim.arrays import BoolArray, FloatArray, IntArray

WEAKEST_V_M_S = 0.05
"""A touch-down slower than this need not be seen; seeing it is no false alarm either."""
WEAKEST_PEAK_N = 5.0
"""Nor one that a soft stop answers with less: 0.05 m/s on the default one are 8 N, a felt pulse has 10."""
LONGEST_LATENCY_S = 0.040
"""A detection later than this is not of that impact: four contact times of the default stop."""
ASLEEP_S = 0.005
"""Half a contact of the default stop: an impact whose first half falls between two ticks need not be seen."""
LARGEST_LEAD_S = 0.001
"""A detection may precede the located touch-down by a tick: the sensors are sampled, the event is not."""


@dataclass(frozen=True)
class Matching:
    """Pairs of indices into truth and detections, both of shape (pairs,), in order of time."""

    truth: IntArray
    detection: IntArray


def due(v_m_s: FloatArray, peak_force_n: FloatArray) -> BoolArray:
    """Which touch-downs have to be seen; shapes (n,). A rigid stop has no force, nan."""
    strong: BoolArray = (v_m_s >= WEAKEST_V_M_S) & ~(peak_force_n < WEAKEST_PEAK_N)
    return strong


def slept_through(touch_down_s: FloatArray, tick_t_s: FloatArray) -> BoolArray:
    """Which touch-downs, shape (n,), no tick of the sorted `tick_t_s` follows within `ASLEEP_S`."""
    following = np.searchsorted(tick_t_s, touch_down_s)
    after_s = np.append(tick_t_s, np.inf)[following] - touch_down_s
    asleep: BoolArray = after_s > ASLEEP_S
    return asleep


def match(truth_t_s: FloatArray, detection_t_s: FloatArray) -> Matching:
    """The best one-to-one matching of sorted touch-downs, shape (n,), with sorted detections, shape (m,)."""
    truth_pairs: list[int] = []
    detection_pairs: list[int] = []
    times = np.concatenate([truth_t_s, detection_t_s])
    is_truth = np.concatenate([np.ones(len(truth_t_s), bool), np.zeros(len(detection_t_s), bool)])
    index = np.concatenate([np.arange(len(truth_t_s)), np.arange(len(detection_t_s))])
    order = np.argsort(times, kind="stable")
    far = np.flatnonzero(np.diff(times[order]) > LONGEST_LATENCY_S) + 1
    for group in np.split(order, far):
        truths, detections = index[group[is_truth[group]]], index[group[~is_truth[group]]]
        if len(truths) == 0 or len(detections) == 0:
            continue
        latency = detection_t_s[detections][None, :] - truth_t_s[truths][:, None]
        allowed = (latency >= -LARGEST_LEAD_S) & (latency <= LONGEST_LATENCY_S)
        forbidden = LONGEST_LATENCY_S * (1 + min(latency.shape))  # dearer than any set of allowed pairs
        for row, at in _cheapest(np.where(allowed, np.abs(latency), forbidden)):
            if allowed[row, at]:
                truth_pairs.append(int(truths[row]))
                detection_pairs.append(int(detections[at]))
    by_time = np.argsort(truth_pairs, kind="stable")
    return Matching(
        truth=np.array(truth_pairs, np.int64)[by_time], detection=np.array(detection_pairs, np.int64)[by_time]
    )


def _cheapest(cost: FloatArray) -> Iterator[tuple[int, int]]:
    """Row and column of each pair of the cheapest assignment."""
    if cost.size == 1:
        return iter([(0, 0)])
    # Imported here because it takes a fifth of a run's start, and most runs leave nothing to choose.
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415

    return zip(*linear_sum_assignment(cost), strict=True)
