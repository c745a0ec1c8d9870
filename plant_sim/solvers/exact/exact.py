"""The exact solver: ideal drive, piecewise-linear friction, rigid stop or none; closed form between events.

Impact times and states are exact to rounding, independent of the grid of samples and of the division of a run
into calls.
"""

import math

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import IdealDrive, constant_speed_rad_s
from plant_sim.parts.friction import ClosedForm
from plant_sim.parts.housing import Level
from plant_sim.parts.linkage import Sine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.parts.wearer import NoWearer
from plant_sim.result import EnergyLedger, Impacts, MotionState, Phase, Samples, SimulationResult
from plant_sim.solvers.bernstein import new_scratch
from plant_sim.solvers.cost import ALLOWANCE, debt, too_costly
from plant_sim.solvers.double_double import TURN_RAD, turned
from plant_sim.solvers.exact.automaton import Event, Motion, after, begin, next_event
from plant_sim.solvers.exact.ledger import booked, empty_ledger, stored_j
from plant_sim.solvers.exact.oscillator import Oscillator, flow, launch, oscillator, point

REST_SPEED_M_S = 1e-9
"""Chatter that is certain to end at rest ends below this speed; the later motion does not depend on the
value."""


class UnsupportedSceneError(ValueError):
    """The scene has no closed form, or its start is invalid."""


@jit
def _run(
    parts: Parts,
    start: tuple[float, float, float, float],
    until_s: float,
    rest_speed_m_s: float,
    samples_t_s: NDArray[np.float64],
    samples: NDArray[np.float64],
) -> tuple[
    NDArray[np.float64],
    tuple[float, float, float, float],
    tuple[float, float, float, float, float],
    int,
    bool,
]:
    """A whole run: impacts, final (t, y, v, crank), energies, phase, and whether it was too costly.

    `start` is (t, y, v, crank). Shapes: impacts (6, n) in the order of `Impacts`; samples
    (len(samples_t_s), 4) as y, v, acceleration, crank.
    """
    o = oscillator(parts)
    motion = begin(o, start[0], start[1], start[2], start[3])
    before_j = stored_j(o, motion)
    ledger, scratch = empty_ledger(), new_scratch(0)
    fastest_rad_s, behind = max(o.drive_rad_s, o.natural_rad_s), 0.0
    rows, found, next_sample = np.empty((64, 4)), 0, 0
    event = Event.IMPACT
    while event != Event.HORIZON and behind <= ALLOWANCE:
        arrival, event = next_event(o, motion, until_s, scratch)
        departure = after(o, arrival, event, rest_speed_m_s)
        ledger = booked(o, ledger, motion, arrival, departure)
        next_sample = _sample(o, motion, arrival, event, samples_t_s, samples, next_sample)
        if event == Event.IMPACT:
            if found == len(rows):
                rows = np.concatenate((rows, np.empty_like(rows)))
            rows[found, 0] = arrival.t_s
            rows[found, 1] = arrival.v_m_s
            rows[found, 2] = departure.v_m_s
            rows[found, 3] = arrival.crank_rad
            found += 1
        behind = debt(behind, 1.0, (arrival.t_s - motion.t_s) * fastest_rad_s)
        motion = departure
    impacts, after_j = np.empty((6, found)), stored_j(o, motion)
    for index in range(found):
        v, v_after = rows[index, 1], rows[index, 2]
        impacts[0, index] = rows[index, 0]
        impacts[1, index] = v
        impacts[2, index] = v_after
        impacts[3, index] = o.mass_kg * (v - v_after)
        impacts[4, index] = np.nan  # a rigid stop has no peak force
        impacts[5, index] = rows[index, 3] % TURN_RAD
    return (
        impacts,
        (motion.t_s, motion.y_m, motion.v_m_s, motion.crank_rad),
        (
            ledger.drive_j + ledger.drive_low_j,
            after_j - before_j,
            ledger.friction_j + ledger.friction_low_j,
            ledger.impact_j + ledger.impact_low_j,
            after_j,
        ),
        motion.phase.value,
        event != Event.HORIZON,
    )


@subroutine
def _sample(
    o: Oscillator,
    motion: Motion,
    arrival: Motion,
    event: Event,
    samples_t_s: NDArray[np.float64],
    samples: NDArray[np.float64],
    index: int,
) -> int:
    """Fill the samples of one flow; a sample at the instant of an event shows the state after it."""
    if index >= len(samples_t_s):
        return index
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
    end = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
    while index < len(samples_t_s):
        if samples_t_s[index] >= arrival.t_s and event != Event.HORIZON:
            break
        h = min(max((samples_t_s[index] - motion.t_s) - motion.t_low_s, 0.0), end)
        y, v, a = motion.y_m, 0.0, 0.0
        if motion.phase == Phase.FLIGHT:
            y, v, sin_drive, cos_drive = flow(o, flight, h)
            a = point(o, flight, h, y, v, sin_drive, cos_drive).a_m_s2
        crank, _ = turned(motion.crank_rad, motion.crank_low_rad, o.drive_rad_s, 0.0, h)
        samples[index, 0] = min(y, o.gap_m)
        samples[index, 1] = v
        samples[index, 2] = a
        samples[index, 3] = crank
        index += 1
    return index


def simulate(
    parts: Parts,
    initial: MotionState,
    until_s: float,
    samples_t_s: NDArray[np.float64] | None = None,
    rest_speed_m_s: float = REST_SPEED_M_S,
) -> SimulationResult:
    """Run the module from `initial` to the absolute time `until_s`.

    The crank starts at `initial.crank_rad` and turns at the drive's speed; the mode follows from the state.
    `samples_t_s`, shape (n,), ascending within the run, requests the motion at those times; a sample at
    the instant of an event shows the state after it. The bounces of chatter below `rest_speed_m_s` that are
    certain to end at rest count as one plastic impact.
    """
    striker, drive, friction, stop = parts.striker, parts.drive, parts.friction, parts.stop
    require_plain(parts)
    if (
        not isinstance(drive, IdealDrive)
        or not isinstance(friction, ClosedForm)
        or not isinstance(stop, NoStop | RigidStop)
    ):
        raise UnsupportedSceneError(
            "the exact solver has closed forms for an ideal drive, no, viscous or Coulomb friction and no or "
            f"a rigid stop; this scene has {drive!r}, {friction!r} and {stop!r}: use the adaptive solver"
        )
    grid = sample_times(initial, until_s, samples_t_s)
    until_s = float(until_s)
    start = start_of(striker, stop, initial)
    samples = np.empty((len(grid), 4))
    arguments = (kernel_parts(parts), start, until_s, float(rest_speed_m_s), grid, samples)
    impacts, final, energies, phase, too_many = entry_point(_run, *arguments)(*arguments)
    if too_many:
        t_s, y_m, v_m_s, _ = final
        place = f"at t = {t_s:.9g} s, x = {striker.rest_length_m + y_m:.9g} m, v = {v_m_s:.6g} m/s"
        raise too_costly(place, "the bounces do not die out: lower stop.restitution, or end the run earlier")
    t_s, y_m, v_m_s, crank_rad = final
    return SimulationResult(
        impacts=Impacts(*impacts),
        final=MotionState(
            t_s, _position_m(striker, stop, y_m), v_m_s, crank_rad % TURN_RAD, drive.omega_rad_s, Phase(phase)
        ),
        energy=ledger_of(energies),
        method="exact",
        samples=None if samples_t_s is None else _samples(parts, grid, samples),
    )


def ledger_of(energies: tuple[float, float, float, float, float]) -> EnergyLedger:
    """The ledger of the drive's work, stored change, friction, impact loss and energy stored at the end."""
    drive_j, change_j, friction_j, impact_j, stored_at_end_j = energies
    return EnergyLedger(drive_j, change_j, friction_j, impact_j, stored_j=stored_at_end_j)


def require_plain(parts: Parts) -> None:
    """Refuse parts that these solvers do not support; a tilt has been removed before (`plant_sim.tilt`)."""
    linkage, housing, wearer = parts.linkage, parts.housing, parts.wearer
    if not (isinstance(linkage, Sine) and isinstance(housing, Level) and isinstance(wearer, NoWearer)):
        raise UnsupportedSceneError(
            "this solver has a sine, a level housing and no wearer alone; this scene has "
            f"{linkage!r}, {housing!r} and {wearer!r}: use the adaptive solver"
        )


def sample_times(
    initial: MotionState, until_s: float, asked_t_s: NDArray[np.float64] | None
) -> NDArray[np.float64]:
    """The times of a run's samples, s, shape (n,); refuses invalid times."""
    samples_t_s = np.zeros(0) if asked_t_s is None else np.ascontiguousarray(asked_t_s, dtype=np.float64)
    numbers = (initial.t_s, initial.x_m, initial.v_m_s, initial.crank_rad, until_s)
    if not all(map(math.isfinite, numbers)):
        raise UnsupportedSceneError(
            f"start t, x, v, crank angle and end are {numbers}; all of them must be finite"
        )
    if until_s < initial.t_s:
        raise UnsupportedSceneError(
            f"the run ends at {until_s} s, before its start at {initial.t_s} s; set a later end"
        )
    if len(samples_t_s) and not (
        samples_t_s[0] >= initial.t_s and samples_t_s[-1] <= until_s and np.all(np.diff(samples_t_s) >= 0.0)
    ):
        raise UnsupportedSceneError(
            f"the sample times must ascend within [{initial.t_s}, {until_s}] s and go from "
            f"{samples_t_s[0]} to {samples_t_s[-1]} s; sort and clip them"
        )
    return samples_t_s


def start_of(
    striker: Striker, stop: NoStop | RigidStop, initial: MotionState
) -> tuple[float, float, float, float]:
    """t, y, v and crank angle at the start; refuses a start beyond the stop."""
    y_m = initial.x_m - striker.rest_length_m
    if isinstance(stop, RigidStop):
        if initial.x_m > stop.position_m:
            raise UnsupportedSceneError(
                f"the striker starts at x = {initial.x_m} m, beyond the rigid stop at {stop.position_m} m; "
                "start at or before the stop, or use a soft one"
            )
        y_m = min(y_m, stop.position_m - striker.rest_length_m)
    return float(initial.t_s), float(y_m), float(initial.v_m_s), float(initial.crank_rad)


def _position_m(striker: Striker, stop: NoStop | RigidStop, y_m: float) -> float:
    x_m = striker.rest_length_m + y_m
    if isinstance(stop, NoStop):
        return x_m
    return stop.position_m if y_m >= stop.position_m - striker.rest_length_m else min(x_m, stop.position_m)


def _samples(parts: Parts, t_s: NDArray[np.float64], samples: NDArray[np.float64]) -> Samples:
    y_m, v_m_s, accel_m_s2, crank_rad = samples.T.copy()
    rest_m, stop = parts.striker.rest_length_m, parts.stop
    x_m = rest_m + y_m
    if isinstance(stop, RigidStop):
        x_m = np.minimum(np.where(y_m >= stop.position_m - rest_m, stop.position_m, x_m), stop.position_m)
    omega_rad_s, none = np.full_like(t_s, constant_speed_rad_s(parts.drive)), np.zeros_like(t_s)
    return Samples(
        t_s=t_s,
        x_m=x_m,
        v_m_s=v_m_s,
        accel_m_s2=accel_m_s2,
        crank_rad=crank_rad % TURN_RAD,
        omega_rad_s=omega_rad_s,
        motor_torque_n_m=none,
        current_a=none,
        stop_force_n=none,
        felt_force_n=none,
    )
