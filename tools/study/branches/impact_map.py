"""Periodic orbits of a scene as zeros of the impact map.

The section is the stop. An orbit with m impacts in n turns of the crank has 2 m unknowns, the crank angle θ
and the approach speed v⁻ of each impact, and as many equations: from each impact the motion must reach the
stop at the next impact's θ with its v⁻ (the last one 2π n later),

    y(end) = gap,   v(end) = v⁻ of the next impact,   start: y = gap, v⁺ = −k v⁻  (soft stop: v⁺ = v⁻)

The motion between two impacts has a given duration and disregards a rigid stop, so that the equations stay
smooth where the striker grazes it (a stroboscopic map has no derivative there). Whether the striker then
passes the stop elsewhere is asked afterwards: such an orbit is inadmissible.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.scene import Scene
from plant_sim.solvers.exact.exact import require_closed_form
from tools.study.branches.continuation import Vector
from tools.study.branches.flights import ADAPTIVE_DIFFERENCE, AdaptiveFlight, ClosedFlight, Flight, Leg
from tools.study.branches.parameters import PARAMETERS, TURN_RAD, value_in, with_values

DIFFERENCE = 1e-6
"""Step of central differences over a parameter, in its own scale."""
GRAZING_M_S = 1e-10
"""v⁻ below which an impact grazes, where the impact map has no derivative."""
GRAZING_DIFFERENCES = 2.0
"""The same by the step of central differences, which reach beyond v⁻ = 0 there."""


@dataclass(frozen=True)
class Orbit:
    """One periodic orbit: crank angles in rad and v⁻ in m/s of its impacts, and the varied parameters.

    `multipliers`: eigenvalues of the derivative of the impact map over the whole orbit, ∞ at grazing.
    `clearance_m`: distance of the highest turning point from the stop, negative beyond it; of the adaptive
    solver only its sign. `margin_m`: least margin by which a turn passes without sticking (`FlightEnd`).
    """

    crank_rad: Vector
    v_m_s: Vector
    values: dict[str, float]
    multipliers: NDArray[np.complex128]
    clearance_m: float
    margin_m: float

    @property
    def is_stable(self) -> bool:
        """Whether all multipliers lie within the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1.0))

    @property
    def is_admissible(self) -> bool:
        """Whether the striker approaches the stop at each impact and passes it nowhere else."""
        return bool(np.min(self.v_m_s) > 0.0) and self.clearance_m > 0.0


class ImpactMap:
    """Orbits with `impacts` impacts in `turns` turns of a scene's crank, over the parameters `over`.

    A point z of a curve has the unknowns of the impacts in order, (θ in rad, v⁻ over `speed_m_s`), then the
    parameters over their scales.
    """

    def __init__(self, scene: Scene, turns: int, impacts: int, over: tuple[str, ...]) -> None:
        self.scene, self.turns, self.impacts, self.over = scene, turns, impacts, over
        self.nominal = {name: value_in(scene, name) for name in over}
        self.length_m = abs(value_in(scene, "gap")) + scene.drive.amplitude_m
        self.speed_m_s = scene.natural_rad_s * self.length_m
        self.is_soft = scene.stop.law != "rigid"
        self.has_closed_form = not scene.beyond_closed_form
        if self.has_closed_form:
            require_closed_form(scene.parts())  # a tilt is no closed form's
        self._legs: dict[bytes, tuple[Course, list[Leg]]] = {}
        self._orbits: dict[bytes, Orbit] = {}

    def point(self, crank_rad: Vector, v_m_s: Vector, values: dict[str, float]) -> Vector:
        """The point z of an orbit."""
        impacts = np.column_stack((crank_rad, v_m_s / self.speed_m_s)).ravel()
        return np.append(impacts, [values[name] / PARAMETERS[name].scale for name in self.over])

    def values(self, z: Vector) -> dict[str, float]:
        """The varied parameters of a point."""
        given = z[2 * self.impacts :]
        return {
            name: float(share) * PARAMETERS[name].scale for name, share in zip(self.over, given, strict=True)
        }

    def __call__(self, z: Vector) -> tuple[Vector, NDArray[np.float64]]:
        """Residual and its derivative with respect to all of z (`continuation.System`)."""
        residual, by_impacts = self.equations(z)
        columns = [by_impacts]
        for index in range(2 * self.impacts, len(z)):
            step = np.zeros(len(z))
            step[index] = DIFFERENCE
            change = self.residual(z + step) - self.residual(z - step)
            columns.append(change[:, None] / (2.0 * DIFFERENCE))
        return residual, np.hstack(columns)

    def residual(self, z: Vector) -> Vector:
        """What each leg misses of the next impact's place and speed, scaled, shape (2 m,)."""
        course = self._course(z)
        return self._misses(z, course, [course.flyer.end(flight) for flight in course.flights])

    def equations(self, z: Vector) -> tuple[Vector, NDArray[np.float64]]:
        """The residual and its derivative with respect to the impacts, shape (2 m, 2 m)."""
        m, scale = self.impacts, np.array([self.length_m, self.speed_m_s])
        course, legs = self._course_and_legs(z)
        slope = np.zeros((2 * m, 2 * m))
        for i, leg in enumerate(legs):
            rows, here, there = slice(2 * i, 2 * i + 2), 2 * i, 2 * ((i + 1) % m)
            slope[rows, here] += leg.by_start_rad / scale
            slope[rows, there] += leg.by_end_rad / scale
            slope[rows, here + 1] += course.rebound * leg.by_speed_m_s * self.speed_m_s / scale
            slope[2 * i + 1, there + 1] -= 1.0
        return self._misses(z, course, [leg.end for leg in legs]), slope

    def _misses(self, z: Vector, course: "Course", ends: list[Vector]) -> Vector:
        v_m_s = np.roll(z[1 : 2 * self.impacts : 2], -1) * self.speed_m_s
        wanted = np.column_stack((np.full(self.impacts, course.gap_m), v_m_s))
        missed: Vector = ((np.array(ends) - wanted) / (self.length_m, self.speed_m_s)).ravel()
        return missed

    def orbit(self, z: Vector) -> Orbit:
        """The orbit at a zero."""
        key = z.tobytes()
        if key not in self._orbits:
            self._orbits[key] = self._orbit(z)
        return self._orbits[key]

    def _orbit(self, z: Vector) -> Orbit:
        m, (course, legs) = self.impacts, self._course_and_legs(z)
        margin_m = min(leg.margin_m for leg in legs)
        whole = np.eye(2)
        for leg in legs:
            # 0 = A δ(θ, v⁻) + B δ(θ, v⁻) of the next impact, B = [[y', 0], [v', −1]]
            A = np.column_stack((leg.by_start_rad, course.rebound * leg.by_speed_m_s))
            y_slope, v_slope = leg.by_end_rad
            with np.errstate(divide="ignore", invalid="ignore"):
                inverse = np.array([[1.0 / y_slope, 0.0], [v_slope / y_slope, -1.0]])
                whole = -inverse @ A @ whole
        v_m_s = z[1 : 2 * m : 2] * self.speed_m_s
        differences_m_s = 0.0 if self.has_closed_form else ADAPTIVE_DIFFERENCE * self.speed_m_s
        if np.min(np.abs(v_m_s)) < max(GRAZING_M_S, GRAZING_DIFFERENCES * differences_m_s) or not np.all(
            np.isfinite(whole)
        ):
            multipliers = np.full(2, np.inf + 0j)
        elif margin_m < 0.0:  # sticking projects all speeds onto rest, so that the derivative is singular
            multipliers = np.array([np.trace(whole), 0.0], np.complex128)
        else:
            multipliers = np.linalg.eigvals(whole).astype(complex)
        return Orbit(
            crank_rad=z[0 : 2 * m : 2],
            v_m_s=v_m_s,
            values=self.values(z),
            multipliers=multipliers,
            clearance_m=min(course.flyer.clearance_m(flight) for flight in course.flights),
            margin_m=margin_m,
        )

    def _course_and_legs(self, z: Vector) -> tuple["Course", list[Leg]]:
        """The flights from impact to impact with their derivatives; those of the latest point are kept."""
        key = z.tobytes()
        if key not in self._legs:
            course = self._course(z)
            self._legs = {key: (course, [course.flyer.leg(flight) for flight in course.flights])}
        return self._legs[key]

    def _course(self, z: Vector) -> "Course":
        """The flights from impact to impact at a point."""
        scene = with_values(self.scene, self.values(z))
        gap_m = value_in(scene, "gap")
        rebound = 1.0 if self.is_soft else -value_in(scene, "restitution")
        crank = np.append(z[0 : 2 * self.impacts : 2], z[0] + TURN_RAD * self.turns)
        v_m_s = rebound * z[1 : 2 * self.impacts : 2] * self.speed_m_s
        flights = [Flight(float(crank[i]), float(v_m_s[i]), float(crank[i + 1])) for i in range(self.impacts)]
        closed = ClosedFlight(scene.parts(), gap_m)
        flyer = closed if self.has_closed_form else AdaptiveFlight(*closed, self.speed_m_s)
        return Course(flyer, flights, gap_m, rebound)


class Course(NamedTuple):
    """The flights of an orbit and what flies them; v⁺ is `rebound` v⁻."""

    flyer: ClosedFlight | AdaptiveFlight
    flights: list[Flight]
    gap_m: float
    rebound: float
