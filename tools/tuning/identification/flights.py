"""A log divided into free flights and contacts.

The accelerometer's low-pass delays the reading, so the crank's angle gets the same delay.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import BoolArray, FloatArray, IntArray
from tools.tuning.recordings.readings import Readings

FALL_M_S2, FALL_S = 0.5, 0.006
"""At a touch-down the reading falls by this within this time, and by this more than in as long before."""
HARD_FALL_M_S2 = 8.0
"""Dry friction (5.9 for μ = 0.3) lets no reading fall by this at once."""
ONSET_M_S2 = 0.15
"""Fall below the line through the ticks before, from which on the contact has begun; ten times the noise."""
DEPTH_M_S2 = 1.5
"""Smallest fall of the reading over the whole contact."""
BACK_M_S2 = 1.0
"""The contact has ended where the reading is this near to that before it."""
LONGEST_CONTACT_S = 0.08
RINGING_S = 0.008
"""Time left out after a contact, until the low-pass has settled; before one, a tick or two suffice."""
BEFORE_S = 0.002
SHORTEST_FLIGHT_S = 0.1
STILL_S = 0.04
"""If the reading varies by less than `Division.still_m_s2` for this time, the striker stands still: only the
offset is observable."""
RESTING_M_S2 = 0.5
"""Second condition of standing still: the reading is this near to its value at rest. Where v changes its
sign, the reading is as constant, but far from this value; if such samples were left out by their variation
alone, noise would select them, and b would be 1 % too small."""


class Division(NamedTuple):
    """How a motion is divided: the longest flight, and the largest range of the noise at rest.

    Noise that is integrated twice grows with t^1.5. In a slow motion a flight must contain both ways: in one
    way dry friction looks like another place of the striker.
    """

    longest_s: float = 0.7
    still_m_s2: float = 0.15


USUAL = Division()


class Contact(NamedTuple):
    """The last row before the touch-down, and the first row after the separation."""

    before: int
    after: int


@dataclass(frozen=True)
class Flight:
    """Rows `begin` to `end` − 1 of a log."""

    begin: int
    end: int
    t_s: FloatArray
    z_m_s2: FloatArray
    crank: FloatArray
    """Sine of the crank's angle."""
    cosine: FloatArray
    """Cosine of the crank's angle."""
    still: BoolArray
    """Samples in which the striker stands still."""
    contact: Contact | None
    """The contact that ends the flight, if one does."""


def contacts_of(readings: Readings) -> list[Contact]:
    """All impacts on the stop: a steep fall of the reading and its recovery."""
    z, longest = readings.acceleration_m_s2, round(LONGEST_CONTACT_S / readings.period_s)
    ticks = max(round(FALL_S / readings.period_s), 1)
    at_rest_m_s2 = mean_m_s2(readings)
    found = []
    for begin, end in readings.pieces:
        behind = begin
        for first in (begin + steep_falls(z[begin:end], at_rest_m_s2, ticks)).tolist():
            if first < behind:
                continue
            before = first + onset(z[first - ticks : first + ticks + 1])
            is_away = z[before : min(before + longest, end)] < z[before] - BACK_M_S2
            away = int(np.argmax(is_away))
            back = np.flatnonzero(~is_away[away:])
            if is_away[away] and len(back):
                after = before + away + int(back[0])
                if np.min(z[before:after]) < z[before] - DEPTH_M_S2:
                    found.append(Contact(before, after))
                    behind = after
    return found


def mean_m_s2(readings: Readings) -> float:
    """The reading at rest: the mean acceleration of an oscillation is 0."""
    return float(np.nanmean(readings.acceleration_m_s2))


def steep_falls(z: FloatArray, at_rest_m_s2: float, ticks: int) -> IntArray:
    """The rows after which the reading falls as no spring lets it fall.

    At a stop beyond the crank's radius the spring pulls the striker back, and its reading is below that at
    rest. Above it, where the striker turns round at the back, dry friction makes a fall as steep as a soft
    stop's.
    """
    if len(z) <= 2 * ticks:
        return np.zeros(0, np.int64)
    change = z[ticks:] - z[:-ticks]
    before, after = change[:-ticks], change[ticks:]
    is_steep = (after < -FALL_M_S2) & (after - before < -FALL_M_S2)
    is_stop = (z[ticks:-ticks] < at_rest_m_s2) | (after < -HARD_FALL_M_S2)
    return np.flatnonzero(is_steep & is_stop) + ticks


def onset(z: FloatArray) -> int:
    """The last row, from the middle of `z` on, that continues the line through the rows before it."""
    ticks = len(z) // 2
    line = z[ticks] + (z[ticks] - z[0]) / ticks * np.arange(ticks + 1)
    return int(np.argmax(z[ticks:] < line - ONSET_M_S2)) - 1


def flights_of(
    readings: Readings, contacts: list[Contact], delay_s: float, division: Division = USUAL
) -> list[Flight]:
    """The free flights between contacts."""
    T = readings.period_s
    ringing, before = round(RINGING_S / T), round(BEFORE_S / T)
    at_rest_m_s2 = mean_m_s2(readings)
    found: list[Flight] = []
    for begin, end in readings.pieces:
        inside = [contact for contact in contacts if begin <= contact.before < end]
        starts = [begin, *(contact.after + ringing for contact in inside)]
        ends: list[tuple[int, Contact | None]] = [(contact.before - before, contact) for contact in inside]
        ends.append((end, None))
        for start, (stop, contact) in zip(starts, ends, strict=True):
            found += _cut(readings, start, stop, contact, delay_s, at_rest_m_s2, division)
    return found


def _cut(
    readings: Readings,
    start: int,
    stop: int,
    contact: Contact | None,
    delay_s: float,
    at_rest_m_s2: float,
    division: Division,
) -> list[Flight]:
    """Divide rows between contacts into flights; the last flight ends at the contact."""
    T = readings.period_s
    if stop - start < SHORTEST_FLIGHT_S / T:
        return []
    parts = int(np.ceil((stop - start) * T / division.longest_s))
    edges = np.round(np.linspace(start, stop, parts + 1)).astype(int).tolist()
    flights = []
    for one, two in pairwise(edges):
        still = is_at_rest(readings.acceleration_m_s2[one:two] - at_rest_m_s2, T, division.still_m_s2)
        flights.append(_flight(readings, one, two, contact if two == edges[-1] else None, delay_s, still))
    return flights


def _flight(
    readings: Readings, begin: int, end: int, contact: Contact | None, delay_s: float, still: BoolArray
) -> Flight:
    T = readings.period_s
    z = readings.acceleration_m_s2[begin:end]
    t = np.asarray(np.arange(len(z)) * T, np.float64)
    angle = readings.angle_rad[begin:end]
    delayed = angle - delay_s * np.gradient(angle, T)
    return Flight(
        begin,
        end,
        t,
        z,
        np.sin(delayed),
        np.cos(delayed),
        still,
        contact,
    )


def integrals(z: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """∫z dt and ∫∫z dt² from the first sample on, by the trapezoidal rule."""
    steps = 0.5 * period_s * (z[1:] + z[:-1])
    velocity = np.concatenate([[0.0], np.cumsum(steps)])
    # z linear over a tick: X += V T + (2 z0 + z1) T²/6
    way = velocity[:-1] * period_s + (2.0 * z[:-1] + z[1:]) * period_s**2 / 6.0
    return velocity, np.concatenate([[0.0], np.cumsum(way)])


def is_at_rest(moving_m_s2: FloatArray, period_s: float, range_m_s2: float) -> BoolArray:
    """Samples at rest: the reading, less its value at rest, is small and nearly constant for `STILL_S`."""
    width = round(STILL_S / period_s)
    near = np.abs(moving_m_s2) < RESTING_M_S2
    if len(moving_m_s2) <= width:
        return near & bool(np.ptp(moving_m_s2) < range_m_s2)
    windows = np.lib.stride_tricks.sliding_window_view(moving_m_s2, width)
    quiet = np.ptp(windows, axis=1) < range_m_s2
    still = np.zeros(len(moving_m_s2), bool)
    for shift in range(width):
        still[shift : shift + len(quiet)] |= quiet
    return near & still
