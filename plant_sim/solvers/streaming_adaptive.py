"""Whole orbits by the adaptive solver, followed from drive period to drive period and summed up, not stored.

For an ideal drive with any friction and any stop; free of the interpreter's lock.
"""

import math

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import jit, subroutine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import is_rigid, is_soft, origin_m
from plant_sim.result import Phase
from plant_sim.sensing import NoSensing
from plant_sim.solvers.adaptive import BUFFER_FULL, DONE, advance
from plant_sim.solvers.double_double import TURN_RAD
from plant_sim.solvers.memory import (
    APPROACH,
    CRANK_ANGLE,
    ELAPSED,
    IMPACT_ANGLE,
    IMPACTS,
    PEAK_FORCE,
    PHASE,
    SAMPLES,
    UNSETTLED,
    Memory,
)
from plant_sim.solvers.memory import IMPULSE as IMPACT_IMPULSE
from plant_sim.solvers.motion import work_place
from plant_sim.solvers.orbits import (
    BLOWS,
    DRIVE,
    FRICTION,
    LOSS,
    MOVED,
    RESTED,
    SECTION_RAD,
    STUCK_M,
    V_END,
    Y_END,
    Y_HIGH,
    Y_LOW,
    Outcome,
    Protocol,
    clear,
    count_blow,
    follow_cycles,
    new_rows,
    summary,
)
from plant_sim.solvers.transitions import crank_speed

LOOKS = 64
"""Times per drive period at which the motion is looked at for its extremes."""


@jit
def follow_stepwise(
    parts: Parts, memory: Memory, y_m: float, v_m_s: float, crank_rad: float, protocol: Protocol
) -> Outcome:
    """Run an orbit from y = x − l0, v and a crank angle in `memory`, which was allocated for these parts."""
    rows = new_rows(protocol, crank_speed(parts.drive, memory))
    return _follow(parts, memory, y_m, v_m_s, crank_rad, protocol, rows)


@jit
def classify_stepwise(
    parts: Parts,
    memory: Memory,
    starts: NDArray[np.float64],
    protocol: Protocol,
    regimes: NDArray[np.int8],
    blows: NDArray[np.float32],
) -> None:
    """Regime, and blows per period, of each start (y, v, crank), shape (n, 3); negative if not certain."""
    rows = new_rows(protocol, crank_speed(parts.drive, memory))
    for index in range(len(starts)):
        outcome = _follow(parts, memory, starts[index, 0], starts[index, 1], starts[index, 2], protocol, rows)
        regimes[index] = outcome.regime.value if outcome.certain else -1 - outcome.regime.value
        blows[index] = outcome.blows


@subroutine
def _follow(
    parts: Parts,
    memory: Memory,
    y_m: float,
    v_m_s: float,
    crank_rad: float,
    protocol: Protocol,
    rows: NDArray[np.float64],
) -> Outcome:
    striker, drive = parts.striker, parts.drive
    shift_m = origin_m(parts.stop, striker) - striker.rest_length_m
    _restart(memory, y_m - shift_m, v_m_s, crank_rad)
    streaks = np.zeros(64, dtype=np.int64)
    length = abs(shift_m) + abs(drive.amplitude_m)
    speed = math.sqrt(striker.spring_n_m / striker.mass_kg) * length
    grid, samples = np.zeros(LOOKS + 1), np.zeros((LOOKS + 1, 3))
    speed_rad_s = crank_speed(drive, memory)
    turn_s = TURN_RAD / speed_rad_s
    first_s = ((SECTION_RAD - crank_rad) % TURN_RAD) / speed_rad_s
    total_s = protocol.settle_s + protocol.record_s
    endless = _period(parts, memory, 0.0, first_s, False, grid, samples, rows[0])
    period, recorded, cycle, now_s = 0, 0, 0, first_s
    certain = False
    while True:
        cycle, clear_cut = follow_cycles(rows, streaks, period, length, speed, protocol.tolerance)
        if protocol.stop_early and clear_cut and recorded >= cycle:
            certain = True
            break
        end_s = first_s + (period + 1) * turn_s
        if end_s > total_s or endless:
            break
        settled = protocol.stop_early or now_s >= protocol.settle_s
        period += 1
        row = rows[period % len(rows)]
        endless = _period(parts, memory, now_s, end_s, protocol.measure and settled, grid, samples, row)
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
        origin_m(parts.stop, striker) if protocol.measure else striker.rest_length_m,
        (memory.y[0] + shift_m, memory.y[1], memory.held[CRANK_ANGLE], now_s),
    )


@subroutine
def _restart(memory: Memory, depth_m: float, v_m_s: float, crank_rad: float) -> None:
    for place in range(len(memory.y)):
        memory.y[place] = 0.0
    for place in range(len(memory.mode)):
        memory.mode[place] = 0
    for place in range(len(memory.contact)):
        memory.contact[place] = 0.0
    memory.y[0], memory.y[1] = depth_m, v_m_s
    memory.mode[PHASE] = UNSETTLED
    memory.held[ELAPSED] = 0.0
    memory.held[CRANK_ANGLE] = crank_rad % TURN_RAD


@subroutine
def _period(
    parts: Parts,
    memory: Memory,
    begin_s: float,
    end_s: float,
    looked_at: bool,
    grid: NDArray[np.float64],
    samples: NDArray[np.float64],
    row: NDArray[np.float64],
) -> bool:
    """Carry the motion on to `end_s` and fill the row; whether the solver could not."""
    clear(row)
    y, mode = memory.y, memory.mode
    work = work_place(parts)
    drive_j, friction_j, loss_j, depth = y[work], y[work + 1], y[work + 2], y[0]
    looks = LOOKS + 1 if looked_at else 0
    for look in range(looks):
        grid[look] = begin_s + (end_s - begin_s) * look / LOOKS
    mode[SAMPLES] = 0
    status = BUFFER_FULL
    while status == BUFFER_FULL:
        status = advance(parts, NoSensing(), memory, 0.0, 0.0, end_s, grid[:looks], samples)
        for index in range(mode[IMPACTS]):
            blow = memory.impacts[index]
            peak = blow[PEAK_FORCE] if is_soft(parts.stop) else math.nan
            count_blow(row, blow[APPROACH], blow[IMPACT_IMPULSE], blow[IMPACT_ANGLE], peak)
        mode[IMPACTS] = 0
    row[Y_END], row[V_END] = y[0], y[1]
    row[RESTED] = 1.0 if mode[PHASE] == Phase.REST_ON_STOP.value else 0.0
    row[MOVED] = 0.0 if abs(y[0] - depth) <= STUCK_M and _is_held(mode[PHASE]) and row[BLOWS] == 0.0 else 1.0
    row[DRIVE], row[FRICTION], row[LOSS] = y[work] - drive_j, y[work + 1] - friction_j, y[work + 2] - loss_j
    if looked_at and status == DONE:
        row[Y_LOW], row[Y_HIGH] = _extremes(samples, (end_s - begin_s) / LOOKS)
        if is_rigid(parts.stop):
            row[Y_HIGH] = 0.0 if row[BLOWS] > 0.0 else min(row[Y_HIGH], 0.0)
    return status != DONE


@subroutine
def _is_held(phase: int) -> bool:
    return phase in (Phase.STICK.value, Phase.REST_ON_STOP.value)


@subroutine
def _extremes(samples: NDArray[np.float64], step_s: float) -> tuple[float, float]:
    """Lowest and highest depth, by cubic Hermite interpolation where the velocity changes sign."""
    low, high = math.inf, -math.inf
    for look in range(len(samples)):
        low, high = min(low, samples[look, 0]), max(high, samples[look, 0])
        if look == 0:
            continue
        v0, v1 = samples[look - 1, 1], samples[look, 1]
        if v0 * v1 < 0.0:
            y0, y1 = samples[look - 1, 0], samples[look, 0]
            s = v0 / (v0 - v1)
            y = (
                y0 * (1.0 + 2.0 * s) * (1.0 - s) ** 2
                + step_s * v0 * s * (1.0 - s) ** 2
                + y1 * s * s * (3.0 - 2.0 * s)
                + step_s * v1 * s * s * (s - 1.0)
            )
            if v0 < 0.0:
                low = min(low, y)
            else:
                high = max(high, y)
    return low, high
