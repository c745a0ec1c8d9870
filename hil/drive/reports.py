"""Schedule of the drive's reports: each on its period in `vibro.dbc`, one per tick beside the encoder's.

Pure steps that run interpreted and compiled. A report that is due while others wait is appended to a queue.
The queue is one integer with a digit per report; the lowest digit leaves next.
"""

from typing import Any, NamedTuple

from firmware_py.interface import codec
from plant_sim.kernels import subroutine

CURRENT, HEARTBEAT, ERRORS, TEMPERATURE, SUPPLY = range(1, 6)
"""The reports, and their digits in the queue."""
CODECS = (
    codec.DRIVE_CURRENT,
    codec.DRIVE_HEARTBEAT,
    codec.DRIVE_ERRORS,
    codec.DRIVE_TEMPERATURE,
    codec.DRIVE_SUPPLY,
)
"""The reports' frames, in the order in which reports that are due together leave."""
NOTHING = 0
DIGIT_BITS, DIGIT = 3, 7
FULL = 1 << 60
"""A queue from this number on has twenty digits and accepts no further report."""

Ticks = tuple[int, int, int, int, int]
"""The reports' periods in ticks."""


class Reports(NamedTuple):
    """The queue of waiting reports, the tick of the last check for due reports, and of the next check."""

    waiting: int
    looked_tick: int
    next_tick: int


def ticks_of(its_codec: codec.FrameCodec[Any], period_s: float) -> int:
    """A frame's period in ticks."""
    assert its_codec.period_s is not None
    return max(1, round(its_codec.period_s / period_s))


def report_ticks(period_s: float, heartbeat_s: float | None) -> Ticks:
    """The reports' periods in ticks of `period_s`; `heartbeat_s` replaces the period in `vibro.dbc`."""
    current, heartbeat, errors, temperature, supply = (ticks_of(its_codec, period_s) for its_codec in CODECS)
    if heartbeat_s is not None:
        heartbeat = max(1, round(heartbeat_s / period_s))
    return current, heartbeat, errors, temperature, supply


def first_reports(tick: int) -> Reports:
    """Initial state for a drive that powers up: an empty queue, first checked in `tick`."""
    return Reports(NOTHING, tick - 1, tick)


@subroutine
def look(ticks: Ticks, reports: Reports, tick: int) -> Reports:
    """Queue the reports whose period has begun since the last check."""
    if tick < reports.next_tick:
        return reports
    waiting, next_tick = reports.waiting, tick + ticks[0]
    for place in range(len(ticks)):
        period = tick // ticks[place]
        if period != reports.looked_tick // ticks[place] and waiting < FULL:
            waiting = _append(waiting, place + 1)
        next_tick = min(next_tick, (period + 1) * ticks[place])
    return Reports(waiting, tick, next_tick)


@subroutine
def _append(waiting: int, report: int) -> int:
    """Return the queue with a report appended."""
    end = 1
    while waiting >= end:
        end <<= DIGIT_BITS
    return waiting + report * end


@subroutine
def take(reports: Reports) -> tuple[Reports, int]:
    """Return the remaining reports and the report that leaves in this tick, `NOTHING` if none waits."""
    left = Reports(reports.waiting >> DIGIT_BITS, reports.looked_tick, reports.next_tick)
    return left, reports.waiting & DIGIT
