"""The striker's true regime in a window, from the plant's impacts and crank angle.

The firmware decides its regime on line from its sensors; the bench compares that decision with this regime.
A drive period is one turn of the crank, cut half a turn away from the mean phase of the impacts, so that
jitter in the phase never moves an impact into the neighbouring period; without impacts it begins at angle 0.
"""

from typing import NamedTuple

import numpy as np

from firmware_py.interface.enums import Regime
from plant_sim.arrays import FloatArray, IntArray

TAIL = 0.5
"""Share of the window, at its end, that decides the regime; the earlier part shows lost impacts."""
FEWEST_PERIODS = 4
"""Lowest number of whole drive periods for a decision."""
STEADY = 0.95
"""The fraction of periods that must agree; the rest may be disturbed by a gust or a kick."""
LARGEST_N = 8
"""Largest number of periods after which an orbit may repeat; a longer orbit is uncertain."""
SPEED_SCATTER = 0.10
"""Relative change of v⁻ from one cycle to the next up to which two cycles count as equal."""
CHATTER_COUNT = 4
"""Impacts in one drive period from which on the striker counts as chattering."""
STILL_M_S = 1e-3
"""Largest speed of a striker that counts as stuck."""


def circular_mean(angles_rad: FloatArray) -> float:
    """The mean direction of `angles_rad`, shape (n,), in (−π, π]."""
    return float(np.angle(np.mean(np.exp(1j * angles_rad))))


def period_edges(crank_rad: FloatArray, t_s: FloatArray, cut_rad: float) -> FloatArray:
    """Times at which the unwrapped crank angle passes `cut_rad` modulo 2π; inputs of shape (n,)."""
    turns = (np.unwrap(crank_rad) - cut_rad) / (2.0 * np.pi)
    forward = np.maximum.accumulate(turns)
    wanted = np.arange(np.ceil(forward[0]), np.floor(forward[-1]) + 1.0)
    return np.asarray(t_s[np.searchsorted(forward, wanted)], np.float64)


def impacts_by_period(t_s: FloatArray, edges_s: FloatArray) -> IntArray:
    """Number of impacts in each period between neighbouring `edges_s`, shape (periods,)."""
    return np.histogram(t_s, bins=edges_s)[0].astype(np.int64) if len(edges_s) else np.zeros(0, np.int64)


def repeats_after(counts: IntArray, speeds: FloatArray, n: int) -> bool:
    """Whether counts and mean approach speeds, shape (periods,), repeat after `n` periods."""
    if len(counts) < 2 * n:
        return False
    same_count = counts[n:] == counts[:-n]
    scale = np.maximum(speeds[n:], speeds[:-n])
    same_speed = (counts[n:] == 0) | (np.abs(speeds[n:] - speeds[:-n]) <= SPEED_SCATTER * scale)
    return float(np.mean(same_count & same_speed)) >= STEADY


def mean_speeds(t_s: FloatArray, v_m_s: FloatArray, edges_s: FloatArray) -> FloatArray:
    """Mean approach speed in each period, nan where it had no impact; shape (periods,)."""
    counts = impacts_by_period(t_s, edges_s)
    sums = np.histogram(t_s, bins=edges_s, weights=v_m_s)[0]
    means: FloatArray = np.divide(sums, counts, out=np.full(len(counts), np.nan), where=counts > 0)
    return means


class Periods(NamedTuple):
    """Whole drive periods: their edges, shape (periods + 1,), and impacts in each, shape (periods,)."""

    edges_s: FloatArray
    counts: IntArray


def cut_periods(t_s: FloatArray, crank_rad: FloatArray, impacts_t_s: FloatArray) -> Periods:
    """The whole drive periods of a window of crank angles, shape (n,), with the impacts in it."""
    if len(t_s) == 0:
        return Periods(np.zeros(0), np.zeros(0, np.int64))
    at_impact = np.interp(impacts_t_s, t_s, np.unwrap(crank_rad))
    cut = circular_mean(at_impact) + np.pi if len(at_impact) else 0.0
    edges = period_edges(crank_rad, t_s, cut)
    return Periods(edges, impacts_by_period(impacts_t_s, edges))


def decide(
    t_s: FloatArray, v_m_s: FloatArray, periods: Periods, impacts_t_s: FloatArray, impacts_v_m_s: FloatArray
) -> Regime:
    """The regime of one window of motion.

    `t_s` and `v_m_s` (striker) are sampled, shape (n,); the impacts, shape (m,), are those of the same window
    above the lowest approach speed.
    """
    edges, counts = periods
    if len(counts) < FEWEST_PERIODS:
        return Regime.UNCERTAIN
    speeds = mean_speeds(impacts_t_s, impacts_v_m_s, edges)
    head = int(len(counts) * (1.0 - TAIL))
    if not counts[head:].any():
        still = np.max(np.abs(v_m_s[t_s >= edges[head]]), initial=0.0) < STILL_M_S
        return decide_without_impacts(counts[:head], still)
    return decide_with_impacts(counts[head:], speeds[head:])


def decide_without_impacts(earlier_counts: IntArray, still: np.bool_ | bool) -> Regime:
    """The regime of a window whose deciding part has no impact."""
    if np.count_nonzero(earlier_counts) >= 2:
        return Regime.LOST
    return Regime.STUCK if still else Regime.NON_IMPACT


def decide_with_impacts(counts: IntArray, speeds: FloatArray) -> Regime:
    """The regime from the number and the mean speed of the impacts in each period; shapes (periods,)."""
    if np.median(counts) >= CHATTER_COUNT:
        return Regime.CHATTERING
    for n in range(1, LARGEST_N + 1):
        if repeats_after(counts, speeds, n):
            return Regime.IMPACT if n == 1 else Regime.PERIOD_N
    return Regime.IMPACT if np.mean(counts == 1) >= STEADY else Regime.UNCERTAIN
