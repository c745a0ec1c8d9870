"""The module written down a second time, plainly, for scipy from event to event: slow and sure."""

import math
from dataclasses import dataclass, field

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.friction import Coulomb, Stribeck, Viscous
from plant_sim.parts.housing import Moving, Tilted, housing_m_s2
from plant_sim.parts.linkage import Sine
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import HuntCrossley, KelvinVoigt, NoStop, RigidStop
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import Ankle
from plant_sim.scene import Scene
from plant_sim.simulation import initial_state

MOST_STEP_S = 2e-3
"""Short enough that scipy's own event search, by signs at step ends, sees every crossing of these runs."""

NUDGE = 1e-14
"""A speed, m/s or rad/s, with which a halted part sets off: scipy finds a zero at a step's start for ever."""


@dataclass
class Reference:
    """A module whose striker may stick (ideal drive, outside the stop) but does not rest on a stop."""

    parts: Parts
    x: float
    v: float
    theta: float
    omega: float
    t: float = 0.0
    touch_v: float | None = None
    touch_t: float = 0.0
    peak: float = 0.0
    is_crank_stuck: bool = False
    plate: float = 0.0
    plate_v: float = 0.0
    peak_felt: float = 0.0
    impacts_t: list[float] = field(default_factory=list)
    impacts_v: list[float] = field(default_factory=list)
    impacts_v_after: list[float] = field(default_factory=list)
    impacts_peak: list[float] = field(default_factory=list)

    def run(self, until: float, torque: float = 0.0, rtol: float = 1e-12) -> None:
        """Carry the state on to `until` under a held torque."""
        while self.t < until:
            if self.v == 0.0 and self.touch_v is None and abs(self._pull()) <= self._limit() > 0.0:
                self._stick(until)
                continue
            push = 0.0 if self.touch_v is None else self._stop_force(self.x - self.parts.stop.position_m, 0.0)
            direction = math.copysign(1.0, self.v if self.v != 0.0 else self._pull() - push)
            if self.v == 0.0 and self._limit() > 0.0:
                self.v = NUDGE * direction
            net, dry = self._crank_net(torque, self.x), self._dry()
            self.is_crank_stuck = self.omega == 0.0 and abs(net) <= dry > 0.0
            crank_direction = math.copysign(1.0, self.omega if self.omega != 0.0 else net)
            if dry > 0.0 and self.omega == 0.0 and not self.is_crank_stuck:
                self.omega = NUDGE * crank_direction
            events = [
                self._stop_event(),
                self._halt_event(direction),
                self._crank_event(crank_direction, torque),
            ]
            solution = solve_ivp(
                lambda t, y: self._derivative(t, y, torque, direction, crank_direction),  # noqa: B023
                (self.t, until),
                [self.x, self.v, self.theta, self.omega, self.plate, self.plate_v],
                method="DOP853",
                rtol=rtol,
                atol=1e-15,
                events=events,
                max_step=MOST_STEP_S,
            )
            self.t = float(solution.t[-1])
            self.x, self.v, self.theta, self.omega, self.plate, self.plate_v = solution.y[:, -1]
            self._follow_forces(solution.y)
            if len(solution.t_events[0]):
                self._meet_stop()
            elif len(solution.t_events[1]):
                self.v = 0.0
            elif len(solution.t_events[2]) and self.is_crank_stuck:
                self.omega = math.copysign(NUDGE, self._crank_net(torque, self.x))
            elif len(solution.t_events[2]):
                self.omega = 0.0

    def _dry(self) -> float:
        drive = self.parts.drive
        return drive.dry_n_m if isinstance(drive, MotorDrive) else 0.0

    def _crank_net(self, torque: float, x: float) -> float:
        return torque - self._spring(self.theta, x) * self._lever(self.theta)

    def _spring(self, theta: float, x: float) -> float:
        striker = self.parts.striker
        return striker.spring_n_per_m * (self._piston(theta) + striker.rest_length_m - x)

    def _piston(self, theta: float) -> float:
        """By the cosine theorem: L² = A² + s² − 2 A s sin θ in the triangle of crank, rod and axis."""
        a = self.parts.drive.amplitude_m
        if isinstance(self.parts.linkage, Sine):
            return a * math.sin(theta)
        rod, along = self.parts.linkage.rod_m, a * math.sin(theta)
        return along + math.sqrt(along * along + rod * rod - a * a) - rod

    def _lever(self, theta: float) -> float:
        """dx_A/dθ, by differentiating the cosine theorem: 0 = 2 s s' − 2 A s' sin θ − 2 A s cos θ."""
        a = self.parts.drive.amplitude_m
        if isinstance(self.parts.linkage, Sine):
            return a * math.cos(theta)
        s = self._piston(theta) + self.parts.linkage.rod_m
        return a * s * math.cos(theta) / (s - a * math.sin(theta))

    def _shaken(self, t: float) -> float:
        match self.parts.housing:
            case Tilted(along):
                return along
            case Moving(along, swing, rate, phase, peak, start, lasting):
                knock = (
                    peak * math.sin(math.pi * (t - start) / lasting) if start < t < start + lasting else 0.0
                )
                return along + swing * math.sin(rate * t + phase) + knock
            case Walking() as walking:
                return housing_m_s2(walking, t)
        return 0.0

    def _felt(self, plate, plate_v):
        match self.parts.wearer:
            case Ankle(_, stiffness, damping):
                return stiffness * plate + damping * plate_v
        return 0.0 * plate

    def _follow_forces(self, y) -> None:
        self.peak_felt = max(self.peak_felt, float(np.max(np.abs(self._felt(y[4], y[5])))))
        if self.touch_v is not None:
            depth = y[0] - y[4] - self.parts.stop.position_m
            forces = [self._stop_force(*one) for one in zip(depth, y[1] - y[5], strict=True)]
            self.peak = max(self.peak, *forces)

    def _crank_event(self, direction, torque):
        if self._dry() == 0.0:
            return _never
        if self.is_crank_stuck:
            beyond = (1.0 + 1e-12) * self._dry()
            return _event(lambda t, y: abs(self._crank_net(torque, y[0])) - beyond, 1.0)
        return _event(lambda t, y: y[3], -direction)

    def _pull(self) -> float:
        return self._spring(self.theta, self.x) - self.parts.striker.mass_kg * self._shaken(self.t)

    def _derivative(self, t, y, torque, direction, crank_direction):
        x, v, theta, omega, plate, plate_v = y
        drive, stop = self.parts.drive, self.parts.stop
        force = self._spring(theta, x)
        load = force * self._lever(theta)
        shaken = self._shaken(t)
        force -= self._drag(v, direction)
        push = 0.0
        if self.touch_v is not None:
            push = self._stop_force(x - stop.position_m - plate, v - plate_v)
            force -= push
        plate_a = 0.0
        if isinstance(self.parts.wearer, Ankle):
            plate_a = (push - self._felt(plate, plate_v)) / self.parts.wearer.plate_kg - shaken
        match drive:
            case IdealDrive():
                alpha = 0.0
            case MotorDrive():
                kt, r = drive.torque_constant_n_m_a, drive.resistance_ohm
                current = np.clip(torque / kt, -drive.current_limit_a, drive.current_limit_a)
                most_v, emf_v = drive.supply_v / math.sqrt(3.0), kt * omega / 1.5  # of a phase's amplitude
                current = np.clip(current, (-most_v - emf_v) / r, (most_v - emf_v) / r)
                losses = drive.viscous_n_m_s * omega + drive.dry_n_m * crank_direction
                alpha = (kt * current - losses - load) / drive.inertia_kg_m2
                if self.is_crank_stuck:
                    alpha = 0.0
        return [v, force / self.parts.striker.mass_kg - shaken, omega, alpha, plate_v, plate_a]

    def _drag(self, v: float, direction: float) -> float:
        weight = self.parts.striker.mass_kg * self.parts.striker.gravity_m_s2
        match self.parts.friction:
            case Viscous(b):
                return b * v
            case Coulomb(mu, b):
                return mu * weight * direction + b * v
            case Stribeck(mu, mu_s, v_s, delta, b):
                fall = math.exp(-((abs(v) / v_s) ** delta))
                return (mu + (mu_s - mu) * fall) * weight * direction + b * v
        return 0.0

    def _stop_force(self, depth: float, v: float) -> float:
        match self.parts.stop:
            case HuntCrossley(_, stiffness, exponent, dissipation):
                return (
                    stiffness * max(depth, 0.0) ** exponent * max(1.0 + dissipation / self.touch_v * v, 0.0)
                )
            case KelvinVoigt(_, stiffness, damping):
                return stiffness * depth + damping * v
        raise AssertionError

    def _stop_event(self):
        stop = self.parts.stop
        if isinstance(stop, NoStop):
            return _never
        if self.touch_v is None:
            return _event(lambda t, y: y[0] - y[4] - stop.position_m, 1.0)
        if isinstance(stop, KelvinVoigt):
            return _event(lambda t, y: self._stop_force(y[0] - y[4] - stop.position_m, y[1] - y[5]), -1.0)
        return _event(lambda t, y: y[0] - y[4] - stop.position_m, -1.0)

    def _halt_event(self, direction):
        if self._limit() == 0.0:
            return _never
        return _event(lambda t, y: y[1], -direction)

    def _limit(self) -> float:
        weight = self.parts.striker.mass_kg * self.parts.striker.gravity_m_s2
        match self.parts.friction:
            case Coulomb(mu, _):
                return mu * weight
            case Stribeck(_, mu_s, _, _, _):
                return mu_s * weight
        return 0.0

    def _stick(self, until: float) -> None:
        """Stay until the pull grows past the limit, looked for in steps and refined; leave a hair later."""
        begin, angle = self.t, self.theta

        def excess(t: float) -> float:
            self.theta, self.t = angle + self.omega * (t - begin), t
            return abs(self._pull()) - self._limit()

        grid = np.arange(begin, until + MOST_STEP_S, MOST_STEP_S)
        later = next((t for t in grid[1:] if excess(t) > 0.0), None)
        self.t = until if later is None else brentq(excess, later - MOST_STEP_S, later, xtol=1e-16)
        while self.t < until and excess(self.t) <= 0.0:
            self.t = math.nextafter(self.t, math.inf)
        self.t = min(self.t, until)
        excess(self.t)

    def _meet_stop(self) -> None:
        stop = self.parts.stop
        if isinstance(stop, RigidStop):
            self.impacts_t.append(self.t)
            self.impacts_v.append(self.v)
            self.x, self.v = stop.position_m, -stop.restitution * self.v
            self.impacts_v_after.append(self.v)
            self.impacts_peak.append(math.nan)
        elif self.touch_v is None:
            self.touch_t, self.touch_v, self.peak = self.t, self.v - self.plate_v, 0.0
        else:
            self.impacts_t.append(self.touch_t)
            self.impacts_v.append(self.touch_v)
            self.impacts_v_after.append(self.v - self.plate_v)
            self.impacts_peak.append(self.peak)
            self.touch_v = None


def simulated_again(scene: Scene, until_s: float, torque_n_m: float = 0.0) -> Reference:
    """The scene's module from its start to `until_s` under a held torque."""
    start = initial_state(scene)
    run = Reference(scene.parts(), start.x_m, start.v_m_s, start.crank_rad, start.omega_rad_s)
    run.run(until_s, torque_n_m)
    return run


def _event(function, direction):
    function.terminal = True
    function.direction = direction
    return function


def _never(t, y):
    return 1.0
