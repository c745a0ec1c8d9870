"""The peer scipy: solve_ivp with events, the paper's own method."""

import math
from functools import partial
from typing import Any

from scipy.integrate import solve_ivp

from tools.trade.cases import Case, Method
from tools.trade.peers.automaton import (
    Event,
    Flow,
    Functions,
    Piece,
    depth_m,
    push_n,
    run,
    slopes,
    static_limit_n,
)

SETTINGS: tuple[tuple[str, str, dict[str, float]], ...] = (
    ("scipy RK45", "default", {}),
    ("scipy RK45", "1e-08", {"rtol": 1e-8, "atol": 1e-10}),
    ("scipy DOP853", "1e-06", {"rtol": 1e-6, "atol": 1e-8}),
    ("scipy DOP853", "1e-10", {"rtol": 1e-10, "atol": 1e-12}),
)


NUMBERS = Functions(math.sin, math.cos, math.exp)


def scipy_flow(case: Case, method: Any, tolerances: Any) -> Flow:
    """solve_ivp with terminal events for the stop and, with dry friction, for zero velocity."""
    parts = case.parts

    def integrate(
        t_s: float, state: list[float], until_s: float, direction: float, in_contact: bool
    ) -> Piece:
        def at(t: float, y: Any) -> list[float]:
            return slopes(case, NUMBERS, t, y, abs(y[1]), direction, in_contact)

        events = [_terminal(lambda t, y: depth_m(parts, y[0]), 1.0)]
        if in_contact:
            events = [_terminal(lambda t, y: push_n(parts, y[0], y[1]), -1.0)]
        if static_limit_n(parts) > 0.0:
            events.append(_terminal(lambda t, y: y[1], -direction))
        solution: Any = solve_ivp(at, (t_s, until_s), state, method=method, events=events, **tolerances)
        met = zip((Event.STOP, Event.HALT), solution.t_events, strict=False)
        event = next((event for event, times in met if len(times)), Event.END)
        return Piece(float(solution.t[-1]), [float(value) for value in solution.y[:, -1]], event)

    return integrate


def _terminal(function: Any, direction: float) -> Any:
    function.terminal = True
    function.direction = direction
    return function


def methods(case: Case) -> list[Method]:
    """Return scipy's methods at the default and at finer tolerances."""
    return [
        Method(name, setting, partial(run, case, scipy_flow(case, name.removeprefix("scipy "), tolerances)))
        for name, setting, tolerances in SETTINGS
    ]
