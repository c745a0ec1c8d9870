"""Orbits of an ideal drive, followed from drive period to drive period and summarised without being stored.

Periods run from one passage of the crank through its backward dead centre, θ = −π/2, to the next: the striker
is then far from the stop, so that an impact never falls on the border between two of them. A row per period
holds the quantities that studies use. A solver's `Carrier` advances the motion (`closed`: the closed form;
`stepwise`: any scene with an ideal drive). All of this runs without the interpreter's lock.
"""

import math
from enum import IntEnum
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import IntArray, record_type
from plant_sim.kernels import by_part, jit, subroutine
from plant_sim.solvers.double_double import TURN_RAD

SECTION_RAD = -0.5 * math.pi

LONGEST_CYCLE = 8
"""Longest recognised cycle, in drive periods."""

DOUBT = 100.0
"""A longer cycle is in doubt while a shorter one repeats within this multiple of the tolerance."""

CHATTER_IMPACTS = 16
"""From this number of impacts in a drive period on, a motion is chatter even without rest on the stop."""

STUCK_M = 1e-9
"""A striker is stuck if its slides add up to less than this."""


class Period:
    """Record of a drive period: state at its end, impacts and their sums, measured values."""

    y_end_m: float
    v_end_m_s: float
    impacts: int
    impulse_n_s: float
    impulse_squares: float
    fastest_m_s: float
    slowest_m_s: float
    approaches_m_s: float
    """Sum of the impacts' v⁻."""
    peak_n: float
    rested: bool
    """The striker rested on the stop for some time, held there by the spring or by friction."""
    moved: bool
    """The striker moved; with dry friction: its slides added up to more than `STUCK_M`."""
    y_low_m: float
    y_high_m: float
    drive_j: float
    friction_j: float
    loss_j: float


PERIOD = record_type(Period)

Periods: TypeAlias = Any
"""An array of records as `Period`."""


class Regime(IntEnum):
    """Regime at the end of an orbit."""

    NON_IMPACT = 0
    IMPACT = 1
    PERIOD_N = 2
    LOST = 3
    CHATTERING = 4
    STUCK = 5
    UNCERTAIN = 6


class Protocol(NamedTuple):
    """Duration of an orbit and the quantities to record.

    With `stop_early` it ends once it has repeated itself within `tolerance` (of gap and amplitude together,
    in position and in velocity over ω) for longer than its own cycle, or provably never meets the stop again.
    """

    settle_s: float
    record_s: float
    tolerance: float
    stop_early: bool
    measure: bool
    """Whether extremes and energies are recorded; they take longer than the motion itself."""


PAPER = Protocol(settle_s=30.0, record_s=20.0, tolerance=1e-4, stop_early=False, measure=True)
"""The paper's protocol: 50 s, the first 30 s discarded."""

CLASSIFY = Protocol(settle_s=50.0, record_s=0.0, tolerance=1e-7, stop_early=True, measure=False)
"""Protocol for the attractor alone."""


class Outcome(NamedTuple):
    """Regime and end of an orbit, and means over the last cycle (if certain) or over the recorded periods."""

    regime: Regime
    certain: bool
    cycle: int
    """Drive periods after which the orbit repeats; 0 if it does not."""
    impacts: float
    """Impacts per drive period."""
    v_mean_m_s: float
    v_max_m_s: float
    v_min_m_s: float
    impulse_n_s: float
    repeatability: float
    """Standard deviation over mean of the impulses."""
    peak_n: float
    """Peak force, N; nan at a rigid stop."""
    x_low_m: float
    x_high_m: float
    drive_j: float
    """Work of the drive per period."""
    friction_j: float
    loss_j: float
    """Loss in the stop per period."""
    end_y_m: float
    """Position minus rest length."""
    end_v_m_s: float
    end_crank_rad: float


Carrier: TypeAlias = Any
"""Record of a solver that advances the motion of one scene, with a `size: Size` and a law for each of the
functions below."""


class Size(NamedTuple):
    """Size of a scene: crank speed, rest length, and the scales by which cycles are recognised."""

    drive_rad_s: float
    rest_length_m: float
    length_m: float
    speed_m_s: float


@by_part
def set_out(carrier: Carrier, y_m: float, v_m_s: float, crank_rad: float) -> Any:
    """The motion at t = 0 from y = x − l0, v and a crank angle, in the carrier's own representation."""
    raise NotImplementedError


@by_part
def carry(carrier: Carrier, motion: Any, until_s: float, looked_at: bool, row: Period) -> tuple[Any, bool]:
    """Advance the motion to `until_s` and fill its row; return the motion and whether the solver failed.

    `looked_at` requests extremes and energies.
    """
    raise NotImplementedError


@by_part
def ends_clear(carrier: Carrier, motion: Any, row: Period) -> bool:
    """Whether the striker provably never reaches the stop again; `row` is then the steady period's."""
    return False


@by_part
def section(carrier: Carrier, motion: Any) -> tuple[float, float, float]:
    """y, v and crank angle of a motion."""
    raise NotImplementedError


@subroutine
def follow_orbit(
    carrier: Carrier,
    y_m: float,
    v_m_s: float,
    crank_rad: float,
    protocol: Protocol,
    rows: Periods,
    streaks: IntArray,
) -> Outcome:
    """Follow an orbit from y = x − l0, v and a crank angle to its outcome.

    `rows` and `streaks` are scratch of `new_rows`.
    """
    size = carrier.size
    streaks[:] = 0
    turn_s = TURN_RAD / size.drive_rad_s
    first_s = ((SECTION_RAD - crank_rad) % TURN_RAD) / size.drive_rad_s
    total_s = protocol.settle_s + protocol.record_s
    motion, endless = carry(carrier, set_out(carrier, y_m, v_m_s, crank_rad), first_s, False, rows[0])
    period, recorded, cycle, now_s = 0, 0, 0, first_s
    certain = False
    while True:
        cycle, clear_cut = follow_cycles(
            rows, streaks, period, size.length_m, size.speed_m_s, protocol.tolerance
        )
        if protocol.stop_early:
            if ends_clear(carrier, motion, rows[(period + 1) % len(rows)]):
                certain, cycle = True, 1
                period += 1
                break
            if clear_cut and recorded >= cycle:
                certain = True
                break
        end_s = first_s + (period + 1) * turn_s
        if end_s > total_s or endless:
            break
        settled = protocol.stop_early or now_s >= protocol.settle_s
        period += 1
        row = rows[period % len(rows)]
        motion, endless = carry(carrier, motion, end_s, protocol.measure and settled, row)
        recorded = recorded + 1 if settled else 0
        now_s = end_s
    whole = recorded - recorded % max(cycle, 1)
    window = min(cycle if certain else whole, period, len(rows) - 1)
    return summary(
        rows,
        period,
        max(window, 1),
        0 if endless else cycle,
        certain,
        size.rest_length_m,
        section(carrier, motion),
    )


@jit
def classify_starts(
    carrier: Carrier,
    starts: NDArray[np.float64],
    protocol: Protocol,
    rows: Periods,
    streaks: IntArray,
    regimes: NDArray[np.int8],
    impacts: NDArray[np.float32],
) -> None:
    """Regime, and impacts per period, of each start (y, v, crank), shape (n, 3); negative if not certain."""
    for index in range(len(starts)):
        y_m, v_m_s, crank_rad = starts[index, 0], starts[index, 1], starts[index, 2]
        outcome = follow_orbit(carrier, y_m, v_m_s, crank_rad, protocol, rows, streaks)
        regimes[index] = outcome.regime.value if outcome.certain else -1 - outcome.regime.value
        impacts[index] = outcome.impacts


def new_rows(protocol: Protocol, drive_rad_s: float) -> tuple[Periods, IntArray]:
    """A ring of rows, long enough for the protocol's record and for recognising a cycle, and the streaks of
    `follow_cycles`."""
    recorded = math.ceil(protocol.record_s * drive_rad_s / (2.0 * math.pi)) + 2
    rows = np.zeros(max(recorded, 2 * LONGEST_CYCLE + 2), PERIOD)
    return rows, np.zeros(LONGEST_CYCLE + 1, np.int64)


@subroutine
def clear(row: Period) -> None:
    """Reset the row for a new period."""
    row.impacts, row.rested, row.moved = 0, False, False
    row.y_end_m = row.v_end_m_s = 0.0
    row.impulse_n_s = row.impulse_squares = row.approaches_m_s = row.fastest_m_s = 0.0
    row.drive_j = row.friction_j = row.loss_j = 0.0
    row.slowest_m_s = row.y_low_m = math.inf
    row.y_high_m = -math.inf
    row.peak_n = math.nan


@subroutine
def count_impact(row: Period, v_m_s: float, impulse_n_s: float, peak_n: float) -> None:
    """Add an impact to its period."""
    row.impacts += 1
    row.impulse_n_s += impulse_n_s
    row.impulse_squares += impulse_n_s * impulse_n_s
    row.approaches_m_s += v_m_s
    row.fastest_m_s = max(row.fastest_m_s, v_m_s)
    row.slowest_m_s = min(row.slowest_m_s, v_m_s)
    if not row.peak_n >= peak_n:
        row.peak_n = peak_n


@subroutine
def follow_cycles(
    rows: Periods,
    streaks: IntArray,
    period: int,
    length_m: float,
    speed_m_s: float,
    tolerance: float,
) -> tuple[int, bool]:
    """The shortest cycle that has repeated for longer than its own length (0: none), and whether it is
    certain.

    `streaks[n]` counts the latest consecutive periods that ended in the state of the n-th period before, with
    the same number of impacts. An orbit that converges to a short cycle from alternating sides repeats every
    second period before it repeats every period: a cycle is in doubt while one of its divisors nearly
    repeats.
    """
    size = len(rows)
    now = rows[period % size]
    found, nearly, doubted = 0, 0, False
    for n in range(1, LONGEST_CYCLE + 1):
        if period < n:
            break
        before = rows[(period - n) % size]
        distance = max(
            abs(now.y_end_m - before.y_end_m) / length_m, abs(now.v_end_m_s - before.v_end_m_s) / speed_m_s
        )
        repeated = distance <= tolerance and now.impacts == before.impacts
        streaks[n] = streaks[n] + 1 if repeated else 0
        if found == 0 and streaks[n] > max(n, 2):
            found, doubted = n, nearly > 0 and n % nearly == 0
        if nearly == 0 and distance <= DOUBT * tolerance:
            nearly = n
    return found, found > 0 and not doubted


@subroutine
def summary(
    rows: Periods,
    last: int,
    window: int,
    cycle: int,
    certain: bool,
    rest_length_m: float,
    end: tuple[float, float, float],
) -> Outcome:
    """The outcome of an orbit from its last `window` rows; `end` is y, v and crank angle."""
    size = len(rows)
    impacts, impulse, squares, approaches = 0, 0.0, 0.0, 0.0
    fastest, slowest, peak, low, high = 0.0, math.inf, math.nan, math.inf, -math.inf
    drive, friction, loss = 0.0, 0.0, 0.0
    rested, moved, most = False, False, 0
    for index in range(window):
        row = rows[(last - index) % size]
        impacts += row.impacts
        impulse += row.impulse_n_s
        squares += row.impulse_squares
        approaches += row.approaches_m_s
        fastest, slowest = max(fastest, row.fastest_m_s), min(slowest, row.slowest_m_s)
        if not peak >= row.peak_n:
            peak = row.peak_n
        low, high = min(low, row.y_low_m), max(high, row.y_high_m)
        moved = moved or row.moved
        drive += row.drive_j
        friction += row.friction_j
        loss += row.loss_j
        rested = rested or row.rested
        most = max(most, row.impacts)
    count = max(window, 1)
    regime = Regime.UNCERTAIN
    mean, spread = math.nan, math.nan
    if impacts == 0:
        regime = Regime.NON_IMPACT if moved else Regime.STUCK
    else:
        mean = impulse / impacts
        spread = math.sqrt(max(squares / impacts - mean * mean, 0.0)) / mean
        if rested or most >= CHATTER_IMPACTS:
            regime = Regime.CHATTERING
        elif cycle == 1:
            regime = Regime.IMPACT
        elif cycle > 1:
            regime = Regime.PERIOD_N
    return Outcome(
        regime,
        certain,
        cycle,
        impacts / count,
        approaches / impacts if impacts > 0 else math.nan,
        fastest if impacts > 0 else math.nan,
        slowest if impacts > 0 else math.nan,
        mean,
        spread,
        peak,
        rest_length_m + low,
        rest_length_m + high,
        drive / count,
        friction / count,
        loss / count,
        end[0],
        end[1],
        end[2],
    )
