"""The peer scipy: solve_ivp with events, the paper's own method."""

import math
from functools import partial
from typing import Any

from scipy.integrate import solve_ivp

from tools.trade.cases import Case, Method
from tools.trade.peers.automaton import Event, Functions, Piece, depth_m, push_n, run, slopes, static_limit_n

SETTINGS: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("scipy RK45", "default", {}),
    ("scipy RK45", "1e-08", {"rtol": 1e-8, "atol": 1e-10}),
    ("scipy DOP853", "1e-06", {"rtol": 1e-6, "atol": 1e-8}),
    ("scipy DOP853", "1e-10", {"rtol": 1e-10, "atol": 1e-12}),
)


NUMBERS = Functions(math.sin, math.cos, math.exp)


class ScipyFlow:
    """Flow by solve_ivp, with terminal events for the stop and, with dry friction, for zero velocity."""

    def __init__(self, case: Case, method: str, tolerances: dict[str, float]) -> None:
        self.case = case
        self.method: Any = method
        self.tolerances: Any = tolerances
        self.is_dry = static_limit_n(case.parts) > 0.0

    def __call__(
        self, t_s: float, state: list[float], until_s: float, direction: float, in_contact: bool
    ) -> Piece:
        """Integrate from `t_s` to the first event."""

        def at(t: float, y: Any) -> list[float]:
            return slopes(self.case, NUMBERS, t, y, abs(y[1]), direction, in_contact)

        events = [self._stop_event(in_contact)]
        if self.is_dry:
            events.append(_terminal(lambda t, y: y[1], -direction))
        solution: Any = solve_ivp(
            at, (t_s, until_s), state, method=self.method, events=events, **self.tolerances
        )
        end = [float(value) for value in solution.y[:, -1]]
        if len(solution.t_events[0]):
            return Piece(float(solution.t[-1]), end, Event.STOP)
        if self.is_dry and len(solution.t_events[1]):
            return Piece(float(solution.t[-1]), end, Event.HALT)
        return Piece(float(solution.t[-1]), end, Event.END)

    def _stop_event(self, in_contact: bool) -> Any:
        parts = self.case.parts
        if in_contact:
            return _terminal(lambda t, y: push_n(parts, y[0], y[1]), -1.0)
        return _terminal(lambda t, y: depth_m(parts, y[0]), 1.0)


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
