"""The peer scipy: solve_ivp with events, the paper's own method."""

import math
from functools import partial
from typing import Any

from scipy.integrate import solve_ivp

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.stop import KelvinVoigt, RigidStop
from tools.trade.answers import Method
from tools.trade.cases import Case
from tools.trade.peers.automaton import Event, Piece, drag_n, run, static_limit_n

SETTINGS: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("scipy RK45", "default", {}),
    ("scipy RK45", "1e-08", {"rtol": 1e-8, "atol": 1e-10}),
    ("scipy DOP853", "1e-06", {"rtol": 1e-6, "atol": 1e-8}),
    ("scipy DOP853", "1e-10", {"rtol": 1e-10, "atol": 1e-12}),
)


class ScipyFlow:
    """Flow by solve_ivp, with terminal events for the stop and, with dry friction, for zero velocity."""

    def __init__(self, case: Case, method: str, tolerances: dict[str, float]) -> None:
        self.parts = case.scene.parts()
        self.method: Any = method
        self.tolerances: Any = tolerances
        self.torque_n_m = case.torque_n_m
        self.is_dry = static_limit_n(self.parts) > 0.0

    def __call__(
        self, t_s: float, state: list[float], until_s: float, direction: float, in_contact: bool
    ) -> Piece:
        """Integrate from `t_s` to the first event."""
        events = [self._stop_event(in_contact)]
        if self.is_dry:
            events.append(_terminal(lambda t, y: y[1], -direction))
        solution: Any = solve_ivp(
            self._slopes(direction, in_contact),
            (t_s, until_s),
            state,
            method=self.method,
            events=events,
            **self.tolerances,
        )
        end = [float(value) for value in solution.y[:, -1]]
        if len(solution.t_events[0]):
            return Piece(float(solution.t[-1]), end, Event.STOP)
        if self.is_dry and len(solution.t_events[1]):
            return Piece(float(solution.t[-1]), end, Event.HALT)
        return Piece(float(solution.t[-1]), end, Event.END)

    def _stop_event(self, in_contact: bool) -> Any:
        stop = self.parts.stop
        if isinstance(stop, KelvinVoigt) and in_contact:
            slope_s = stop.damping_n_s_m / stop.stiffness_n_m
            return _terminal(lambda t, y: y[0] - stop.position_m + slope_s * y[1], -1.0)
        if isinstance(stop, KelvinVoigt | RigidStop):
            return _terminal(lambda t, y: y[0] - stop.position_m, 1.0)
        raise TypeError(f"{stop!r} is no stop of a case that peers are given")

    def _slopes(self, direction: float, in_contact: bool) -> Any:
        striker, drive, friction, stop = self.parts[:4]
        m, c, l0 = striker.mass_kg, striker.spring_n_m, striker.rest_length_m
        weight_n, amplitude_m = m * striker.gravity_m_s2, drive.amplitude_m

        def slopes(t: float, y: Any) -> list[float]:
            x, v = y[0], y[1]
            angle = drive.omega_rad_s * t + drive.phase_rad if isinstance(drive, IdealDrive) else y[2]
            spring = c * (amplitude_m * math.sin(angle) + l0 - x)
            push = 0.0
            if in_contact and isinstance(stop, KelvinVoigt):
                push = stop.stiffness_n_m * (x - stop.position_m) + stop.damping_n_s_m * v
            drag = drag_n(friction, weight_n, v, abs(v), direction, math.exp)
            acceleration = (spring + drag - push) / m
            if not isinstance(drive, MotorDrive):
                return [v, acceleration]
            loss = drive.viscous_n_m_s * y[3] + spring * amplitude_m * math.cos(angle)
            return [v, acceleration, y[3], (self.torque_n_m - loss) / drive.inertia_kg_m2]

        return slopes


def _terminal(function: Any, direction: float) -> Any:
    function.terminal = True
    function.direction = direction
    return function


def methods(case: Case) -> list[Method]:
    """Return scipy's methods at the default and at finer tolerances."""
    return [
        Method(name, setting, partial(run, case, ScipyFlow(case, name.removeprefix("scipy "), tolerances)))
        for name, setting, tolerances in SETTINGS
    ]
