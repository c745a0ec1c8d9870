"""The strides of a walk, sampled one after the other: rows for `plant_sim.parts.walking`.

Frequency, size and length of a stride differ from the desired ones by a few per cent, at random and
independently (stride times of healthy walkers vary by 1 to 3 %, after a stroke by more: Hausdorff et al.,
J. Appl. Physiol. 80, 1996, and later work). A start or a stop takes one stride. A walker trips in mid-swing,
puts the foot down early, waits, and returns to the desired gait within three strides.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.parts.walking import COLUMNS
from plant_sim.tables.gait_tables import GaitTable, PaceTable

NATURAL_HZ = 0.9
"""Stride frequency of natural walking, for which the curves of `plant_sim.parts.walking` hold."""
SAMPLED_S = 600.0
"""Strides are sampled for this duration and until the script has ended; a longer walk continues evenly."""
AFTER_SCRIPT_S = 30.0
"""Time after the script's last pace or trip until it has happened at the slowest cadence. Trips that follow
each other faster than the strides take longer."""
STARTING_SHARE, STOPPING_SHARE = 0.8, 0.8
"""Frequency of the first and of the last stride, divided by that of the walk."""
TRIP_PHASE = 0.75
"""Phase of mid-swing, at which a foot trips."""
TRIP_FACTORS = ((1.6, 0.7), (0.6, 0.7), (0.85, 0.9))
"""Frequency and size, relative to the desired ones, at the end of a stride with a trip and of two more."""


class _Stride(NamedTuple):
    """State at one heel strike."""

    hertz: float
    size: float
    stride_m: float


STILL = _Stride(0.0, 0.0, 0.0)


def wanted_hz(paces: Sequence[PaceTable], t_s: float) -> float:
    """Desired stride frequency at `t_s`: linear between two paces that walk, otherwise constant.

    The paces are in the order of time.
    """
    now = max(bisect_right(paces, t_s, key=attrgetter("at_s")) - 1, 0)
    here = paces[now]
    if now + 1 == len(paces) or here.stride_hz == 0.0 or paces[now + 1].stride_hz == 0.0 or t_s < here.at_s:
        return here.stride_hz
    there = paces[now + 1]
    share = (t_s - here.at_s) / (there.at_s - here.at_s)
    return here.stride_hz + share * (there.stride_hz - here.stride_hz)


def sample_strides(walk: GaitTable, dice: np.random.Generator) -> FloatArray:
    """Rows from t = 0 on; the last one has no end."""
    sampling = _Sampling(walk, dice)
    script_s = [pace.at_s for pace in walk.pace] + [trip.at_s for trip in walk.stumble]
    until_s = max(SAMPLED_S, max(script_s) + AFTER_SCRIPT_S)
    while sampling.t_s < until_s or sampling.is_tripping:
        if sampling.is_walking or wanted_hz(walk.pace, sampling.t_s) > 0.0:
            sampling.stride()
        elif not sampling.stand():
            return sampling.rows()
    return sampling.rows(endless=True)


class _Sampling:
    def __init__(self, walk: GaitTable, dice: np.random.Generator) -> None:
        self._walk = walk
        self._dice = dice
        self._rows: list[tuple[float, ...]] = []
        self._trips = sorted(walk.stumble, key=lambda trip: (trip.at_s, trip.knock_m_s2))
        self._recovering: list[tuple[float, float]] = []
        self._now_factor = 1.0
        self.t_s = 0.0
        self._cycles = 0.0
        first_hz = wanted_hz(walk.pace, 0.0)
        self._now = self._sampled(first_hz) if first_hz > 0.0 else STILL

    @property
    def is_walking(self) -> bool:
        """Whether the last stride ended in walking, not in standing."""
        return self._now is not STILL

    @property
    def is_tripping(self) -> bool:
        """Whether a walker has a trip due by now, or has not yet recovered from one."""
        is_due = bool(self._trips) and self._trips[0].at_s <= self.t_s
        return self.is_walking and (is_due or self._now_factor != 1.0)

    def _sampled(self, hertz: float, size_factor: float = 1.0) -> _Stride:
        by_hertz, by_size, by_length = np.exp(self._walk.variability * self._dice.standard_normal(3)).tolist()
        pace = hertz * by_hertz
        size = self._walk.range_share * range_of_motion(hertz) * size_factor
        return _Stride(pace, size * by_size, self._walk.walk_ratio_m_s * hertz * size_factor * by_length)

    def _row(self, length_s: float, here: _Stride, there: _Stride, strike: float, knock: float) -> None:
        pairs = (value for pair in zip(here, there, strict=True) for value in pair)
        self._rows.append((self.t_s, length_s, self._cycles, *pairs, strike, knock))

    def _go(
        self, cycles: float, here: _Stride, there: _Stride, strike: float = 0.0, knock: float = 0.0
    ) -> None:
        length_s = 2.0 * cycles / (here.hertz + there.hertz)
        self._row(length_s, here, there, strike, knock)
        self.t_s += length_s
        self._cycles += cycles

    @property
    def _strike_m_s2(self) -> float:
        """Peak of a heel strike now."""
        return float(self._walk.heel_strike_m_s2 * (self._now.hertz / NATURAL_HZ) ** 2)

    def stand(self) -> bool:
        """Stand until the next pace; return whether there is one."""
        later = [pace.at_s for pace in self._walk.pace if pace.at_s > self.t_s and pace.stride_hz > 0.0]
        until_s = min(later, default=math.inf)
        self._row(until_s - self.t_s, STILL, STILL, 0.0, 0.0)
        self._now = STILL
        self.t_s = until_s
        return math.isfinite(until_s)

    def stride(self) -> None:
        """Append one stride, from heel strike to heel strike."""
        here, strike = self._now, self._strike_m_s2
        if here is STILL:
            goal = self._sampled(wanted_hz(self._walk.pace, self.t_s))
            self._go(1.0, _Stride(STARTING_SHARE * goal.hertz, 0.0, 0.0), goal)
            self._now, self._now_factor = goal, 1.0
            return
        ends_s = self.t_s + 1.0 / here.hertz
        next_hz = wanted_hz(self._walk.pace, ends_s)
        if next_hz == 0.0:
            self._go(1.0, here, _Stride(STOPPING_SHARE * here.hertz, 0.0, 0.0), strike)
            self._now = STILL
            return
        factor, size = self._recovering.pop(0) if self._recovering else (1.0, 1.0)
        if self._trips and self._trips[0].at_s <= self.t_s + TRIP_PHASE / here.hertz:
            trip = self._trips.pop(0)
            (factor, size), *self._recovering = TRIP_FACTORS
            goal = self._sampled(next_hz, size)
            goal = goal._replace(hertz=goal.hertz * factor)
            self._go(TRIP_PHASE, here, here, strike)
            self._go(1.0 - TRIP_PHASE, here, goal, 0.0, trip.knock_m_s2)
        else:
            goal = self._sampled(next_hz, size)
            goal = goal._replace(hertz=goal.hertz * factor)
            self._go(1.0, here, goal, strike)
        self._now, self._now_factor = goal, factor

    def rows(self, endless: bool = False) -> FloatArray:
        """All rows; `endless` adds one that continues as the last one ended."""
        if endless:
            self._row(math.inf, self._now, self._now, self._strike_m_s2, 0.0)
        rows = np.array(self._rows)
        assert rows.shape[1] == COLUMNS
        return rows


def range_of_motion(hertz: float) -> float:
    """Size of the leg's motion at a cadence, divided by that of natural walking: smaller at a slow, slightly
    larger at a brisk cadence (a straight line through 1 at 0.9 Hz and 0.85 at half of it, after the slow,
    natural and fast curves of Winter 1991)."""
    return min(0.7 + 0.3 * hertz / NATURAL_HZ, 1.1)
