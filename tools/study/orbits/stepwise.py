"""Orbits by the adaptive solver: an ideal drive with any friction and any stop."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import constant_speed_rad_s
from plant_sim.parts.friction import static_limit_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import has_stop, is_rigid, is_soft, origin_m
from plant_sim.references import by_reference
from plant_sim.sensors.sensing import NoSensing, Probe
from plant_sim.solvers.adaptive.adaptive import BUFFER_FULL, DONE, call_advance, kernel_records
from plant_sim.solvers.adaptive.state_layout import (
    CONTACT,
    FLIGHT,
    REST,
    Grid,
    Memory,
    restart,
    work_place,
)
from tools.study.orbits import sections
from tools.study.orbits.sections import Period, Size

LOOKS = 64
"""Samples per drive period for the extremes of the motion."""


class Stepwise(NamedTuple):
    """Carrier of any other scene, with a grid of LOOKS + 1 times as scratch."""

    size: Size
    parts: Parts
    probe: Probe
    memory: Memory
    grid: Grid


def stepwise(parts: Parts, memory: Memory) -> Stepwise:
    """The carrier of a scene with an ideal drive, in a memory that was allocated for its parts."""
    grid = by_reference(Grid(np.zeros(LOOKS + 1), np.zeros((LOOKS + 1, 2))))
    return Stepwise(_size(parts), *kernel_records(parts, NoSensing(), memory), grid)


def with_parts(carrier: Stepwise, parts: Parts) -> Stepwise:
    """The same carrier for other parts, each of the same kind as before; both share their memory."""
    return carrier._replace(size=_size(parts), parts=kernel_parts(parts))


def _size(parts: Parts) -> Size:
    striker, drive = parts.striker, parts.drive
    length_m = abs(origin_m(parts.stop, striker) - striker.rest_length_m) + abs(drive.amplitude_m)
    natural_rad_s = math.sqrt(striker.spring_n_per_m / striker.mass_kg)
    return Size(constant_speed_rad_s(drive), striker.rest_length_m, length_m, natural_rad_s * length_m)


@subroutine
def _shift_m(parts: Parts) -> float:
    """y = x − l0 where depth is 0, m."""
    return origin_m(parts.stop, parts.striker) - parts.striker.rest_length_m


@sections.set_out.register(Stepwise)
def _stepwise_set_out(carrier: Stepwise, y_m: float, v_m_s: float, crank_rad: float) -> float:
    parts, memory = carrier.parts, carrier.memory
    restart(parts, memory, y_m - _shift_m(parts), v_m_s, crank_rad, carrier.size.drive_rad_s)
    return 0.0


@sections.section.register(Stepwise)
def _stepwise_section(carrier: Stepwise, motion: float) -> tuple[float, float, float]:
    memory = carrier.memory
    return memory.y[0] + _shift_m(carrier.parts), memory.y[1], memory.held[0].crank_rad


@sections.carry.register(Stepwise)
def _stepwise_carry(
    carrier: Stepwise, begin_s: float, until_s: float, looked_at: bool, row: Period
) -> tuple[float, bool]:
    parts, memory, grid = carrier.parts, carrier.memory, carrier.grid
    sections.clear(row)
    y, mode, shift_m = memory.y, memory.mode[0], _shift_m(parts)
    work = work_place(parts)
    drive_j, friction_j, loss_j = y[work], y[work + 1], y[work + 2] if has_stop(parts.stop) else 0.0
    looks = LOOKS + 1 if looked_at else 0
    for look in range(looks):
        grid.t_s[look] = begin_s + (until_s - begin_s) * look / LOOKS
    mode.samples, mode.seen = LOOKS + 1 - looks, 0
    status = BUFFER_FULL
    while status == BUFFER_FULL:
        status = call_advance(parts, carrier.probe, memory, 0.0, 0.0, until_s, grid)
        for index in range(mode.impacts):
            one = memory.impacts[index]
            peak = one.peak_force_n if is_soft(parts.stop) else math.nan
            sections.count_impact(row, one.v_m_s, one.impulse_n_s, peak)
        mode.impacts = 0
    row.y_end_m, row.v_end_m_s = y[0], y[1]
    row.drive_j, row.friction_j = y[work] - drive_j, y[work + 1] - friction_j
    row.loss_j = y[work + 2] - loss_j if has_stop(parts.stop) else 0.0
    row.rested = mode.seen & 1 << REST != 0
    row.moved = _slid_m(parts, row.friction_j, mode.seen) > sections.STUCK_M
    if looked_at and status == DONE:
        low, high = _extremes(grid.rows, (until_s - begin_s) / LOOKS)
        if is_rigid(parts.stop):
            high = 0.0 if row.impacts > 0 else min(high, 0.0)
        row.y_low_m, row.y_high_m = low + shift_m, high + shift_m
    return until_s, status != DONE


@subroutine
def _slid_m(parts: Parts, friction_j: float, seen: int) -> float:
    """Distance over which dry friction was overcome, m; without dry friction ∞ if the striker was ever
    free."""
    limit_n = static_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)
    if limit_n > 0.0:
        return friction_j / limit_n
    return math.inf if seen & (1 << FLIGHT | 1 << CONTACT) else 0.0


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
