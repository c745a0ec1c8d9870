"""Quality of the impact detection: detections matched one to one with the true touch-downs.

A detection can belong to a touch-down that it follows by at most `LONGEST_LATENCY_S`.
"""

from typing import NamedTuple

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


class Matching(NamedTuple):
    """Pairs of indices into touch-downs and detections, shape (pairs,), in order of time.

    `found`: mask of the touch-downs that were detected. `false`: mask of the detections that belong to none.
    """

    truth: IntArray
    detection: IntArray
    latency_s: FloatArray
    found: BoolArray
    false: BoolArray


def select_reported(firmware: Records) -> Records:
    """The firmware's records of the ticks that report an impact."""
    some: Records = firmware[column(firmware, "outputs.impact") != 0.0]
    return some


def select_strong(impacts: Records) -> Records:
    """The impacts that must be detected by their approach speed."""
    some: Records = impacts[column(impacts, "v_m_s") >= WEAKEST_V_M_S]
    return some


def is_due(v_m_s: FloatArray, peak_force_n: FloatArray) -> BoolArray:
    """Mask of the touch-downs that must be detected; shapes (n,). The force on a rigid stop is NaN."""
    strong: BoolArray = (v_m_s >= WEAKEST_V_M_S) & ~(peak_force_n < WEAKEST_PEAK_N)
    return strong


def is_slept_through(touch_down_s: FloatArray, tick_t_s: FloatArray) -> BoolArray:
    """Mask of the touch-downs, shape (n,), that no tick in sorted `tick_t_s` follows within `ASLEEP_S`."""
    following = np.searchsorted(tick_t_s, touch_down_s)
    after_s = np.append(tick_t_s, np.inf)[following] - touch_down_s
    asleep: BoolArray = after_s > ASLEEP_S
    return asleep


def speed_errors(pairs: Matching, seen: Records, impacts: Records) -> FloatArray:
    """The reported approach speed of each pair minus the true one, in m/s; shape (pairs,)."""
    reported_m_s = column(seen, "outputs.impact_speed_m_s")[pairs.detection]
    errors: FloatArray = reported_m_s - column(impacts, "v_m_s")[pairs.truth]
    return errors


def match(truth_t_s: FloatArray, detection_t_s: FloatArray) -> Matching:
    """Pair each detection, in order of time, with the latest touch-down in its window that has none yet.

    Both are sorted, of shapes (n,) and (m,).
    """
    begins = np.searchsorted(truth_t_s, detection_t_s - LONGEST_LATENCY_S).tolist()
    ends = np.searchsorted(truth_t_s, detection_t_s + LARGEST_LEAD_S, side="right").tolist()
    found, false = np.zeros(len(truth_t_s), bool), np.ones(len(detection_t_s), bool)
    pairs: list[tuple[int, int]] = []
    for number, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        free = np.flatnonzero(~found[begin:end])
        if len(free):
            touch_down = begin + int(free[-1])
            found[touch_down], false[number] = True, False
            pairs.append((touch_down, number))
    truth, detection = np.array(sorted(pairs), np.int64).reshape(-1, 2).T
    return Matching(truth, detection, detection_t_s[detection] - truth_t_s[truth], found, false)


class Comparison(NamedTuple):
    """The reports of impacts beside the touch-downs, while the firmware ran.

    `seen`: the records of the ticks that report one. Masks of the touch-downs: `due`, which must be detected,
    and `slept_through`, in whose first half no tick came. `counts`: mask of the reports.
    """

    seen: Records
    pairs: Matching
    due: BoolArray
    slept_through: BoolArray
    counts: BoolArray


def compare(impacts: Records, firmware: Records) -> Comparison:
    """Compare the reports, timed by their ticks, with the touch-downs."""
    tick_t_s, touch_down_s = column(firmware, "t_s"), column(impacts, "t_s")
    alive_until_s = (tick_t_s[-1] if len(tick_t_s) else -np.inf) - LONGEST_LATENCY_S
    seen = select_reported(firmware)
    pairs = match(touch_down_s, column(seen, "t_s"))
    due = is_due(column(impacts, "v_m_s"), column(impacts, "peak_force_n")) & (touch_down_s <= alive_until_s)
    slept_through = due & ~pairs.found & is_slept_through(touch_down_s, tick_t_s)
    counts = column(seen, "t_s") <= alive_until_s
    return Comparison(seen, pairs, due & ~slept_through, slept_through, counts)
