"""The adaptive solver for any scene: steps by Taylor series or DOP853, from event to event."""

import math
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import FloatArray
from plant_sim.kernels import address_of, by_address, call_at, entry_point, jit
from plant_sim.parts.friction import bend_m_s
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import is_rigid, origin_m
from plant_sim.result import Impact, Impacts, MotionState, Observation, Phase, Samples, SimulationResult
from plant_sim.sensors.sensing import NO_SENSING, update_readings
from plant_sim.solvers.adaptive.automaton import determine_phase
from plant_sim.solvers.adaptive.crank import settle_crank
from plant_sim.solvers.adaptive.observation import (
    begin_ledger,
    electrical_ledger,
    ledger,
    motion_state,
    observation,
    observe,
    peak_felt_force_n,
    sample_now,
)
from plant_sim.solvers.adaptive.state_layout import (
    READINGS,
    UNSETTLED,
    Grid,
    Memory,
    Run,
    allocate,
    now_s,
)
from plant_sim.solvers.adaptive.step import take_step
from plant_sim.solvers.adaptive.wearer import from_stop_m
from plant_sim.solvers.adaptive.winding import settle_voltage
from plant_sim.solvers.cost import ALLOWANCE, SolverError, too_costly
from plant_sim.solvers.double_double import TURN_RAD

DONE, BUFFER_FULL, STEP_TOO_SMALL, TOO_COSTLY = range(4)
"""Status returned by `advance`."""

IMPACTS_AT_ONCE = 1024
"""Rows of the impacts' buffer; a run with more impacts empties it in between."""

TORQUE_PERIOD_S = 1e-3
"""Time for which a torque that varies is held: the tick of the bench's drive."""

Torque: TypeAlias = float | Callable[[float], float]
"""A motor's torque, N m: constant, or a function of time in s."""


@jit
def advance(run: Run) -> int:
    """Advance a run by `progress.duration_s` from `progress.start_s` on, under a constant torque.

    Returns the status; another call continues the run. `progress.elapsed_s` is the time reached. Samples at
    the times of the grid are written into it; its times are absolute.
    """
    memory, room = run.memory[0], run.impacts.shape[0]
    mode, progress = memory.mode, memory.progress
    if mode.impacts >= room:  # a disturbance may end an impact, as each step may
        return BUFFER_FULL
    if mode.phase == UNSETTLED:
        determine_phase(run)
    elif mode.crank_stuck == 1 or mode.zero_crank > 0:  # the torque may have changed
        settle_crank(run)
    settle_voltage(run)
    begin_ledger(run)
    status = DONE
    while True:
        sample_now(run)
        if progress.elapsed_s >= progress.duration_s:
            break
        if mode.impacts >= room:
            status = BUFFER_FULL
            break
        used = take_step(run)
        if used < 0.0:
            status = STEP_TOO_SMALL
            break
        if progress.debt > ALLOWANCE:
            status = TOO_COSTLY
            break
    observe(run)
    update_readings(run.probe)
    return status


def with_address(run: Run) -> Run:
    """The run for other kernels: its memory has the address of `advance`."""
    run.memory[0].progress.advance_at = address_of(advance, run)
    return run


call_advance = by_address(advance, lambda run: call_at(run.memory[0].progress.advance_at, (run,)))
"""`advance`, for other kernels; the run is one of `with_address`."""


def simulate(
    parts: Parts,
    initial: MotionState,
    until_s: float,
    samples_t_s: FloatArray | None = None,
    *,
    torque_n_m: Torque = 0.0,
    accuracy: float = 1e-9,
) -> SimulationResult:
    """Simulate from `initial` (whose phase is determined again) to `until_s` under a motor torque.

    `samples_t_s` ascends within the run. `accuracy` is the largest error per forcing period, m.
    """
    times_s = np.array(() if samples_t_s is None else samples_t_s, dtype=np.float64)
    grid = Grid(times_s, np.zeros((times_s.size, READINGS)))
    duration_s = until_s - initial.t_s
    rows: list[NDArray[np.void]] = []
    run = allocate(parts, initial, accuracy, IMPACTS_AT_ONCE, NO_SENSING, grid)
    memory: Any = run.memory[0]
    for step_n_m, step_until_s in _torque_steps(torque_n_m, initial.t_s, duration_s):
        while not rows or memory.progress.elapsed_s < step_until_s:  # again if the buffer of impacts was full
            rows.append(advance_by(run, step_n_m, initial.t_s, step_until_s))
    impacts = np.concatenate(rows)
    origin = origin_m(parts.stop, parts.striker)
    end = observation(memory.observed)
    return SimulationResult(
        impacts=Impacts(**{name: impacts[name] for name in Impact._fields}),
        final=motion_state(end, until_s),
        energy=ledger(end, memory),
        method="adaptive",
        samples=None if samples_t_s is None else _samples(grid, origin),
        peak_felt_force_n=peak_felt_force_n(parts, memory),
        electrical=electrical_ledger(parts, memory),
    )


def _samples(grid: Grid, origin_m: float) -> Samples:
    """The samples of a grid, whose positions count from `origin_m`."""
    columns = dict(zip(Observation._fields[:READINGS], grid.rows.T.copy(), strict=True))
    columns["x_m"] += origin_m
    columns["crank_rad"] %= TURN_RAD
    return Samples(t_s=grid.t_s, **columns)


def _torque_steps(torque_n_m: Torque, start_s: float, duration_s: float) -> Iterator[tuple[float, float]]:
    """Torques in their order, N m, each with the time after the start up to which it is held, s."""
    if not callable(torque_n_m):
        yield torque_n_m, duration_s
        return
    for tick in range(max(math.ceil(duration_s / TORQUE_PERIOD_S - 1e-9), 1)):
        until_s = min((tick + 1) * TORQUE_PERIOD_S, duration_s)
        yield torque_n_m(start_s + tick * TORQUE_PERIOD_S), until_s


def advance_by(run: Run, torque_n_m: float, start_s: float, duration_s: float) -> NDArray[np.void]:
    """Advance a run and raise failures; return and clear the impacts so far, records as `Impact`."""
    memory: Any = run.memory  # a field of the array takes a fiftieth of the time of a record's
    progress, mode = memory["progress"], memory["mode"]
    progress["torque_n_m"], progress["start_s"], progress["duration_s"] = torque_n_m, start_s, duration_s
    status = entry_point(advance, run)(run)
    if status in (STEP_TOO_SMALL, TOO_COSTLY):
        raise refusal(status, run)
    impacts: NDArray[np.void] = run.impacts[: mode["impacts"][0]].copy()
    mode["impacts"] = 0
    return impacts


def refusal(status: int, run: Run) -> SolverError:
    """The error for a failed run: cause, time and motion, remedy."""
    parts: Any = run.parts
    memory: Any = run.memory[0]
    x_m = from_stop_m(memory.y) + origin_m(parts.stop, parts.striker)
    place = f"at t = {now_s(memory):.9g} s, x = {x_m:.9g} m, v = {memory.y.v_m_s:.6g} m/s"
    if status == TOO_COSTLY:
        return too_costly(place, _remedy(parts, memory))
    if status == BUFFER_FULL:
        most = run.impacts.shape[0]
        return SolverError(f"more than {most:,} impacts at once {place}; lower stop.restitution")
    return SolverError(
        f"no step is small enough {place}; raise solver.accuracy, or make the parts less extreme"
    )


def _remedy(parts: Parts, memory: Memory) -> str:
    """Remedy that names the most likely keys for a run that is too costly."""
    if memory.mode.phase == Phase.CONTACT:
        return (
            "make the stop softer (stop.contact_s, stop.stiffness), start the striker outside it "
            "(initial.x_m, stop.position_m), or raise solver.accuracy"
        )
    if math.isfinite(bend_m_s(parts.friction)):
        return "make friction less steep at rest (friction.v_s_m_s), or raise solver.accuracy"
    if is_rigid(parts.stop):
        return "lower stop.restitution if it chatters, or raise solver.accuracy"
    return "raise solver.accuracy, or make the parts less extreme"
