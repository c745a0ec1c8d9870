"""Quality of the impact detection: detections matched one to one with the true touch-downs.

A detection can belong to a touch-down that it follows by at most `LONGEST_LATENCY_S`. The matching is the
one with the most pairs and, among these, with the least total latency: an assignment problem, solved
separately in each group of neighbouring events.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hil.record.run_traces import column
from hil.record.traces.stored_trace import Records
from plant_sim.arrays import BoolArray, FloatArray, IntArray

WEAKEST_V_M_S = 0.05
"""Lowest approach speed that must be detected; the detection of a slower touch-down is no false alarm."""
WEAKEST_PEAK_N = 5.0
"""Lowest peak force on a soft stop that must be detected: 0.05 m/s on the default stop give 8 N, and a
felt pulse has at least 10 N."""
LONGEST_LATENCY_S = 0.040
"""Largest latency of a detection that belongs to an impact: four contact times of the default stop."""
ASLEEP_S = 0.005
"""Half a contact time of the default stop: an impact whose first half has no tick need not be detected."""
LARGEST_LEAD_S = 0.001
"""A detection may precede the located touch-down by a tick: the sensors are sampled, the event is not."""


@dataclass(frozen=True)
class Matching:
    """Pairs of indices into touch-downs and detections, shape (pairs,), in order of time.

    `found`: mask of the touch-downs that were detected. `false`: mask of the detections that belong to none.
    """

    truth: IntArray
    detection: IntArray
    latency_s: FloatArray
    found: BoolArray
    false: BoolArray


def reported(firmware: Records) -> Records:
    """The firmware's records of the ticks that report an impact."""
    some: Records = firmware[column(firmware, "outputs.impact") != 0.0]
    return some


def due(v_m_s: FloatArray, peak_force_n: FloatArray) -> BoolArray:
    """Mask of the touch-downs that must be detected; shapes (n,). The force on a rigid stop is NaN."""
    strong: BoolArray = (v_m_s >= WEAKEST_V_M_S) & ~(peak_force_n < WEAKEST_PEAK_N)
    return strong


def slept_through(touch_down_s: FloatArray, tick_t_s: FloatArray) -> BoolArray:
    """Mask of the touch-downs, shape (n,), that no tick in sorted `tick_t_s` follows within `ASLEEP_S`."""
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
        forbidden = LONGEST_LATENCY_S * (1 + min(latency.shape))  # costs more than any set of allowed pairs
        for row, at in _cheapest(np.where(allowed, np.abs(latency), forbidden)):
            if allowed[row, at]:
                truth_pairs.append(int(truths[row]))
                detection_pairs.append(int(detections[at]))
    by_time = np.argsort(truth_pairs, kind="stable")
    truth = np.array(truth_pairs, np.int64)[by_time]
    detection = np.array(detection_pairs, np.int64)[by_time]
    found, false = np.zeros(len(truth_t_s), bool), np.ones(len(detection_t_s), bool)
    found[truth], false[detection] = True, False
    return Matching(truth, detection, detection_t_s[detection] - truth_t_s[truth], found, false)


def _cheapest(cost: FloatArray) -> Iterator[tuple[int, int]]:
    """Row and column of each pair of the assignment with the least total cost."""
    if cost.size == 1:
        return iter([(0, 0)])
    # Imported here because the import takes a fifth of a run's start, and most runs need no assignment.
    from scipy.optimize import linear_sum_assignment  # noqa: PLC0415

    return zip(*linear_sum_assignment(cost), strict=True)
