"""Flights of given duration from the stop, as if there were no rigid stop, with their derivatives.

In closed form (`ClosedFlight`) for viscous or Coulomb friction, otherwise by the adaptive solver with central
differences (`AdaptiveFlight`). In closed form, between two events the flow is linear in the state, so its
derivative is the free response [[C, S], [−ω² S, D]] (`oscillator`). At a turn of dry friction the
acceleration jumps from a⁻ to a⁺ and the derivative is multiplied by the saltation matrix

    [[1, 0], [0, a⁺/a⁻]]     (guard v = 0; Leine & Nijmeijer, Dynamics and Bifurcations of Non-Smooth
                              Mechanical Systems, 2004, ch. 7)

which is [[1, 0], [0, 0]] if the striker sticks: all speeds end at rest. When friction releases the striker,
the net force is zero, so the derivative does not jump.
"""

import math
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from plant_sim.kernels import jit
from plant_sim.parts.drive import IdealDrive, constant_speed_rad_s
from plant_sim.parts.friction import ClosedForm
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import NoStop, RigidStop
from plant_sim.parts.striker import Striker
from plant_sim.result import MotionState, Phase, SimulationResult
from plant_sim.solvers.adaptive import adaptive
from plant_sim.solvers.bernstein import new_scratch
from plant_sim.solvers.cost import SolverError
from plant_sim.solvers.event import Event
from plant_sim.solvers.exact.automaton import after, begin, next_event
from plant_sim.solvers.exact.oscillator import flow, free_flow, launch, oscillator_of, point

Vector: TypeAlias = NDArray[np.float64]
ADAPTIVE_ACCURACY, ADAPTIVE_DIFFERENCE = 1e-12, 1e-4
"""Accuracy of the adaptive solver in m, and the step of its differences in rad and in v⁺ over its scale."""
SAME_IMPACT = 1e-6
"""Share of a flight's duration within which an impact is the one at its start or end."""


class Leg(NamedTuple):
    """The motion from one impact to the next: its end (y, v) and the derivatives of (y, v) with respect to
    the crank angle at its start, the speed v⁺ at its start and the crank angle at its end.

    `margin_m`: least margin by which a turn passes without sticking (`FlightEnd`).
    """

    end: Vector
    by_start_rad: Vector
    by_speed_m_s: Vector
    by_end_rad: Vector
    margin_m: float


class Flight(NamedTuple):
    """A flight from the stop, with v⁺ at one crank angle, to another crank angle."""

    start_rad: float
    v_m_s: float
    end_rad: float


class FlightEnd(NamedTuple):
    """The end of a flight: y = x − l0 and v, the accelerations at both ends, and the derivative.

    `yv` is ∂y(end)/∂v(start), and so on. `highest_m`: highest turning point, −∞ if there is none. `margin_m`:
    least distance |A sin θ − y| − μ g/ω² by which a turn passes without sticking; negative if the striker
    sticks, ∞ without a turn.
    """

    y_m: float
    v_m_s: float
    start_m_s2: float
    end_m_s2: float
    yy: float
    yv: float
    vy: float
    vv: float
    highest_m: float
    margin_m: float


@jit
def fly(
    striker: Striker,
    drive: IdealDrive,
    friction: ClosedForm,
    y_m: float,
    v_m_s: float,
    crank_rad: float,
    duration_s: float,
) -> FlightEnd:
    """The end of the flight of `duration_s` that begins at y = x − l0, v and a crank angle."""
    law = oscillator_of(striker, drive, friction, NoStop(), drive.omega_rad_s)
    o = law._replace(is_dry=True)  # without dry friction, a turn is one of dry friction without a force
    motion, scratch = begin(o, 0.0, y_m, v_m_s, crank_rad), new_scratch()
    yy, yv, vy, vv = 1.0, 0.0, 0.0, 1.0
    highest, margin, start, end = -math.inf, math.inf, math.nan, 0.0
    event = Event.HALT
    while event != Event.NONE:
        arrival, event = next_event(o, motion, duration_s, scratch)
        end = 0.0
        if motion.phase == Phase.FLIGHT:
            span = (arrival.t_s - motion.t_s) + (arrival.t_low_s - motion.t_low_s)
            flight = launch(o, motion.y_m, motion.v_m_s, motion.sin_crank, motion.cos_crank, motion.direction)
            if math.isnan(start):
                start = point(o, flight, 0.0, motion.y_m, motion.v_m_s, 0.0, 1.0).a_m_s2
            y, v, sin_drive, cos_drive = flow(o, flight, span)
            end = point(o, flight, span, y, v, sin_drive, cos_drive).a_m_s2
            C, S, D = free_flow(o, span)
            yy, vy = C * yy + S * vy, D * vy - o.stiffness_1_s2 * S * yy
            yv, vv = C * yv + S * vv, D * vv - o.stiffness_1_s2 * S * yv
        departure = after(o, arrival, event, 0.0)
        if event == Event.HALT:
            highest = max(highest, arrival.y_m)
        if event == Event.HALT and law.is_dry:
            push = o.amplitude_m * arrival.sin_crank - arrival.y_m
            margin = min(margin, abs(push) - o.dry_offset_m)
            share = 0.0
            if departure.phase == Phase.FLIGHT:
                share = (o.stiffness_1_s2 * (push - departure.direction * o.dry_offset_m)) / end
            vy, vv = share * vy, share * vv
        motion = departure
    if math.isnan(start):
        start = 0.0
    return FlightEnd(motion.y_m, motion.v_m_s, start, end, yy, yv, vy, vv, highest, margin)


class ClosedFlight(NamedTuple):
    """Flights of a scene with viscous or Coulomb friction from a rigid stop, in closed form."""

    parts: Parts
    gap_m: float

    def end(self, flight: Flight) -> Vector:
        """y = x − l0 and v at the end."""
        return np.array(self._fly(flight)[:2])

    def leg(self, flight: Flight) -> Leg:
        """The end and its derivatives."""
        end, omega_rad_s = self._fly(flight), constant_speed_rad_s(self.parts.drive)
        by_state = np.array([[end.yy, end.yv], [end.vy, end.vv]])
        start_rate, end_rate = np.array([flight.v_m_s, end.start_m_s2]), np.array([end.v_m_s, end.end_m_s2])
        by_start = -by_state @ start_rate / omega_rad_s  # a later start shortens the flight
        return Leg(np.array(end[:2]), by_start, by_state[:, 1], end_rate / omega_rad_s, end.margin_m)

    def clearance_m(self, flight: Flight) -> float:
        """Distance from the highest turning point to the stop; negative if the striker passes the stop."""
        return self.gap_m - self._fly(flight).highest_m

    def _fly(self, flight: Flight) -> FlightEnd:
        striker, drive, friction = self.parts[:3]
        assert isinstance(drive, IdealDrive)
        assert isinstance(friction, ClosedForm)
        duration_s = (flight.end_rad - flight.start_rad) / drive.omega_rad_s
        return fly(striker, drive, friction, self.gap_m, flight.v_m_s, flight.start_rad, duration_s)


class AdaptiveFlight(NamedTuple):
    """The same of any scene with an ideal drive, by the adaptive solver and central differences.

    With a soft stop a motion begins at touch-down and includes the contact. `speed_m_s`: the scale of v⁺.
    """

    parts: Parts
    gap_m: float
    speed_m_s: float

    def end(self, flight: Flight) -> Vector:
        """y = x − l0 and v at the end; nan for an end before the start, or if the solver fails."""
        stop = NoStop() if isinstance(self.parts.stop, RigidStop) else self.parts.stop
        found = self._simulated(self.parts._replace(stop=stop), flight)
        if found is None:
            return np.full(2, np.nan)
        return np.array([found.final.x_m - self.parts.striker.rest_length_m, found.final.v_m_s])

    def leg(self, flight: Flight) -> Leg:
        """The end and its derivatives."""
        h, dv_m_s = ADAPTIVE_DIFFERENCE, ADAPTIVE_DIFFERENCE * self.speed_m_s
        by_start, by_speed, by_end = (
            (self.end(Flight(*np.add(flight, step))) - self.end(Flight(*np.subtract(flight, step))))
            / (2.0 * sum(step))
            for step in ((h, 0.0, 0.0), (0.0, dv_m_s, 0.0), (0.0, 0.0, h))
        )
        return Leg(self.end(flight), by_start, by_speed, by_end, math.inf)

    def clearance_m(self, flight: Flight) -> float:
        """1 if the striker meets the stop nowhere between start and end, otherwise −1."""
        found = self._simulated(self.parts, flight)
        if found is None:
            return math.nan
        share = found.impacts.t_s / found.final.t_s
        return -1.0 if np.any((share > SAME_IMPACT) & (share < 1.0 - SAME_IMPACT)) else 1.0

    def _simulated(self, parts: Parts, flight: Flight) -> SimulationResult | None:
        """The motion of these parts from start to end; None for an end before the start or a failure."""
        omega_rad_s = constant_speed_rad_s(parts.drive)
        duration_s = (flight.end_rad - flight.start_rad) / omega_rad_s
        x_m = self.gap_m + parts.striker.rest_length_m
        start = MotionState(0.0, x_m, float(flight.v_m_s), float(flight.start_rad), omega_rad_s, Phase.FLIGHT)
        try:
            return (
                adaptive.simulate(parts, start, duration_s, accuracy=ADAPTIVE_ACCURACY)
                if duration_s > 0.0
                else None
            )
        except SolverError:
            return None
