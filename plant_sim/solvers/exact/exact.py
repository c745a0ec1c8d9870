"""The exact solver: ideal drive, piecewise-linear friction, rigid stop or none; closed form between events.

Impact times and states are exact to rounding, independent of the grid of samples and of the division of a run
into calls.
"""

import math
from typing import Any

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import IdealDrive, constant_speed_rad_s
from plant_sim.parts.friction import ClosedForm
from plant_sim.parts.housing import Level
from plant_sim.parts.linkage import Sine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop, stop_position_m
from plant_sim.parts.wearer import NoWearer
from plant_sim.result import EnergyLedger, Impacts, MotionState, Phase, Samples, SimulationResult
from plant_sim.solvers.bernstein import new_scratch
from plant_sim.solvers.cost import ALLOWANCE, debt, too_costly
from plant_sim.solvers.double_double import TURN_RAD, turn_by
from plant_sim.solvers.event import Event
from plant_sim.solvers.exact.automaton import Motion, after, begin, next_event
from plant_sim.solvers.exact.ledger import book, empty_ledger, stored_j
from plant_sim.solvers.exact.oscillator import Oscillator, flow, launch, oscillator, point
from plant_sim.solvers.exact.tilt import remove_tilt, restore_tilt
from text_input import RefusalError

REST_SPEED_M_S = 1e-9
"""Chatter that is certain to end at rest ends below this speed; the later motion does not depend on the
value."""


class UnsupportedSceneError(RefusalError, ValueError):
    """The scene has no closed form, or its start is invalid."""


@jit
def _run(
    parts: Parts,
    start: tuple[float, float, float, float],
    until_s: float,
    rest_speed_m_s: float,
    samples_t_s: FloatArray,
    samples: FloatArray,
) -> tuple[FloatArray, Motion, tuple[float, float, float, float, float], bool]:
    """A whole run: impacts, end, energies (work, stored change, friction, impacts, stored), and whether it
    was too costly.

    `start` is (t, y, v, crank). Shapes: impacts (n, 6) in the order of `Impact`; samples
    (len(samples_t_s), 4) as y, v, acceleration, crank.
    """
    o = oscillator(parts)
    motion = begin(o, start[0], start[1], start[2], start[3])
    before_j = stored_j(o, motion)
    ledger, scratch = empty_ledger(), new_scratch()
    fastest_rad_s, behind = max(o.drive_rad_s, o.natural_rad_s), 0.0
    impacts, found, next_sample = np.empty((64, 6)), 0, 0
    event = Event.TOUCH
    while event != Event.NONE and behind <= ALLOWANCE:
        arrival, event = next_event(o, motion, until_s, scratch)
        departure = after(o, arrival, event, rest_speed_m_s)
        ledger = book(o, ledger, motion, arrival, departure)
        next_sample = _sample(o, motion, arrival, event, samples_t_s, samples, next_sample)
        if event == Event.TOUCH:
            if found == len(impacts):
                impacts = np.concatenate((impacts, np.empty_like(impacts)))
            row, v, v_after = impacts[found], arrival.v_m_s, departure.v_m_s
            row[0], row[1], row[2], row[3] = arrival.t_s, v, v_after, o.mass_kg * (v - v_after)
            row[4], row[5] = np.nan, arrival.crank_rad % TURN_RAD  # a rigid stop has no peak force
            found += 1
        behind = debt(behind, 1.0, (arrival.t_s - motion.t_s) * fastest_rad_s)
        motion = departure
    after_j = stored_j(o, motion)
    energies_j = (
        ledger.drive_j + ledger.drive_low_j,
        after_j - before_j,
        ledger.friction_j + ledger.friction_low_j,
        ledger.impact_j + ledger.impact_low_j,
        after_j,
    )
    return impacts[:found], motion, energies_j, event != Event.NONE


@subroutine
def _sample(
    o: Oscillator,
    motion: Motion,
    arrival: Motion,
    event: Event,
    samples_t_s: FloatArray,
    samples: FloatArray,
    index: int,
) -> int:
    """Fill the samples of one flow; a sample at the instant of an event shows the state after it."""
    if index >= len(samples_t_s):
        return index
    flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
    end = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
    while index < len(samples_t_s):
        if samples_t_s[index] >= arrival.t_s and event != Event.NONE:
            break
        h = min(max((samples_t_s[index] - motion.t_s) - motion.t_low_s, 0.0), end)
        y, v, a = motion.y_m, 0.0, 0.0
        if motion.phase == Phase.FLIGHT:
            y, v, sin_drive, cos_drive = flow(o, flight, h)
            a = point(o, flight, h, y, v, sin_drive, cos_drive).a_m_s2
        crank, _ = turn_by(motion.crank_rad, motion.crank_low_rad, o.drive_rad_s, 0.0, h)
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
    samples_t_s: FloatArray | None = None,
    rest_speed_m_s: float = REST_SPEED_M_S,
) -> SimulationResult:
    """Run the module from `initial` to the absolute time `until_s`.

    The crank starts at `initial.crank_rad` and turns at the drive's speed; the mode follows from the state.
    `samples_t_s`, shape (n,), ascending within the run, requests the motion at those times; a sample at
    the instant of an event shows the state after it. The bounces of chatter below `rest_speed_m_s` that are
    certain to end at rest count as one plastic impact.
    """
    level = remove_tilt(parts)
    require_closed_form(level)
    grid = sample_times(initial, until_s, samples_t_s)
    samples = np.empty((len(grid), 4))
    start = start_of(level, initial)
    arguments = (kernel_parts(level), start, float(until_s), float(rest_speed_m_s), grid, samples)
    impacts, end, energies_j, too_many = entry_point(_run, *arguments)(*arguments)
    if too_many:
        x_m = level.striker.rest_length_m + end.y_m
        place = f"at t = {end.t_s:.9g} s, x = {x_m:.9g} m, v = {end.v_m_s:.6g} m/s"
        raise too_costly(place, "the bounces do not die out: lower stop.restitution, or end the run earlier")
    result = SimulationResult(
        impacts=Impacts(*impacts.T.copy()),
        final=MotionState(
            end.t_s,
            float(_positions_m(level, end.y_m)),
            end.v_m_s,
            end.crank_rad % TURN_RAD,
            constant_speed_rad_s(parts.drive),
            end.phase,
        ),
        energy=EnergyLedger(*energies_j[:4], stored_j=energies_j[4]),
        method="exact",
        samples=None if samples_t_s is None else _samples(level, grid, samples),
    )
    return restore_tilt(result, parts, initial)


CLOSED_FORM: dict[str, Any] = {
    "drive": IdealDrive,
    "friction": ClosedForm,
    "stop": NoStop | RigidStop,
    "linkage": Sine,
    "housing": Level,
    "wearer": NoWearer,
}
"""The parts that this solver supports, by slot; a constant tilt has been removed before."""


def require_closed_form(parts: Parts) -> None:
    """Refuse parts that this solver does not support."""
    known = [(getattr(parts, slot), kinds) for slot, kinds in CLOSED_FORM.items()]
    others = [part for part, kinds in known if not isinstance(part, kinds)]
    if others:
        raise UnsupportedSceneError(
            "the exact solver has closed forms for an ideal drive on a sine, no, viscous or Coulomb "
            "friction, no or a rigid stop, a housing at rest and no wearer; this scene has "
            f"{' and '.join(map(repr, others))}: use the adaptive solver"
        )


def sample_times(initial: MotionState, until_s: float, requested_t_s: FloatArray | None) -> FloatArray:
    """The times of a run's samples, s, shape (n,); refuses invalid times."""
    samples_t_s = (
        np.zeros(0) if requested_t_s is None else np.ascontiguousarray(requested_t_s, dtype=np.float64)
    )
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


def start_of(parts: Parts, initial: MotionState) -> tuple[float, float, float, float]:
    """t, y, v and crank angle at the start; refuses a start beyond the stop."""
    rest_m, stop_m = parts.striker.rest_length_m, stop_position_m(parts.stop)
    if initial.x_m > stop_m:
        raise UnsupportedSceneError(
            f"the striker starts at x = {initial.x_m} m, beyond the rigid stop at {stop_m} m; "
            "start at or before the stop, or use a soft one"
        )
    y_m = min(initial.x_m - rest_m, stop_m - rest_m)
    return float(initial.t_s), float(y_m), float(initial.v_m_s), float(initial.crank_rad)


def _positions_m(parts: Parts, y_m: Any) -> Any:
    """x of y = x − l0, a number or an array, at most the stop's position and equal to it at the stop."""
    rest_m, stop_m = parts.striker.rest_length_m, stop_position_m(parts.stop)
    return np.where(y_m >= stop_m - rest_m, stop_m, np.minimum(rest_m + y_m, stop_m))


def _samples(parts: Parts, t_s: FloatArray, samples: FloatArray) -> Samples:
    y_m, v_m_s, accel_m_s2, crank_rad = samples.T.copy()
    none = np.zeros_like(t_s)
    return Samples(
        t_s=t_s,
        x_m=_positions_m(parts, y_m),
        v_m_s=v_m_s,
        accel_m_s2=accel_m_s2,
        crank_rad=crank_rad % TURN_RAD,
        omega_rad_s=np.full_like(t_s, constant_speed_rad_s(parts.drive)),
        motor_torque_n_m=none,
        current_a=none,
        stop_force_n=none,
        felt_force_n=none,
    )
