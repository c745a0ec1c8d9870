"""The peer heyoka: adaptive Taylor series with event detection, compiled for the case."""

from functools import partial
from typing import Any

from plant_sim.parts.stop import KelvinVoigt
from tools.trade.cases import Case, Method
from tools.trade.peers.automaton import (
    Event,
    Functions,
    PeerError,
    Piece,
    depth_m,
    push_n,
    run,
    slopes,
    static_limit_n,
)

TOLERANCES = (1e-6, 1e-10, 1e-15)

MISSING = (
    "heyoka is not installed here, so that it is not among the peers; install it with "
    "`pip install heyoka` (it is one of the development dependencies)"
)


def is_installed() -> bool:
    """Return whether heyoka can be imported."""
    try:
        import heyoka  # noqa: F401
    except ImportError:
        return False
    return True


class HeyokaFlow:
    """Flow with one Taylor integrator for flight and another one for contact."""

    def __init__(self, case: Case, tolerance: float) -> None:
        import heyoka

        self.hy: Any = heyoka
        self.flight = self.contact = self._integrator(case, tolerance, in_contact=False)
        if isinstance(case.parts.stop, KelvinVoigt):
            self.contact = self._integrator(case, tolerance, in_contact=True)

    def __call__(
        self, t_s: float, state: list[float], until_s: float, direction: float, in_contact: bool
    ) -> Piece:
        """Integrate from `t_s` to the first event."""
        integrator = self.contact if in_contact else self.flight
        integrator.time = t_s
        integrator.state[:] = state
        integrator.pars[:] = direction  # an empty array without dry friction
        integrator.reset_cooldowns()
        outcome = integrator.propagate_until(until_s)[0]
        end = [float(value) for value in integrator.state]
        if outcome == self.hy.taylor_outcome.time_limit:
            return Piece(until_s, end, Event.END)
        if int(outcome) in (-1, -2):
            return Piece(float(integrator.time), end, (Event.STOP, Event.HALT)[-1 - int(outcome)])
        raise PeerError(f"heyoka stops at t = {integrator.time} s: {outcome}")

    def _integrator(self, case: Case, tolerance: float, in_contact: bool) -> Any:
        hy, parts = self.hy, case.parts
        state = hy.make_vars("x", "v", "theta", "omega")
        x, v, direction = state[0], state[1], hy.par[0]
        functions = Functions(hy.sin, hy.cos, hy.exp)
        derivatives = slopes(case, functions, hy.time, state, direction * v, direction, in_contact)
        events = [hy.t_event(depth_m(parts, x), direction=hy.event_direction.positive)]
        if in_contact:
            events = [hy.t_event(push_n(parts, x, v), direction=hy.event_direction.negative)]
        if static_limit_n(parts) > 0.0:
            events.append(hy.t_event(v))
        equations = list(zip(state, derivatives, strict=False))
        return hy.taylor_adaptive(equations, [0.0] * len(equations), tol=tolerance, t_events=events)


def methods(case: Case, quick: bool) -> list[Method]:
    """Return heyoka at several tolerances; the time of its compilation is not measured."""
    return [
        Method("heyoka", f"{tolerance:.0e}", partial(run, case, HeyokaFlow(case, tolerance)))
        for tolerance in (TOLERANCES[1:2] if quick else TOLERANCES)
    ]
