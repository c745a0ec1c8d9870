"""The peer heyoka: adaptive Taylor series with event detection, compiled for the case."""

from functools import partial
from typing import Any

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import KelvinVoigt, RigidStop
from tools.trade.answers import Method
from tools.trade.cases import Case
from tools.trade.peers.automaton import Event, PeerError, Piece, drag_n, run, static_limit_n

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
        self.parts = case.scene.parts()
        self.torque_n_m = case.torque_n_m
        self.flight = self._integrator(self.parts, tolerance, in_contact=False)
        self.contact = self.flight
        if isinstance(self.parts.stop, KelvinVoigt):
            self.contact = self._integrator(self.parts, tolerance, in_contact=True)

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

    def _integrator(self, parts: Parts, tolerance: float, in_contact: bool) -> Any:
        hy = self.hy
        striker, drive, friction, stop = parts[:4]
        m, c, l0 = striker.mass_kg, striker.spring_n_m, striker.rest_length_m
        if not isinstance(stop, KelvinVoigt | RigidStop):
            raise TypeError(f"{stop!r} is no stop of a case that peers are given")
        x, v, theta, omega = hy.make_vars("x", "v", "theta", "omega")
        angle = drive.omega_rad_s * hy.time + drive.phase_rad if isinstance(drive, IdealDrive) else theta
        spring = c * (drive.amplitude_m * hy.sin(angle) + l0 - x)
        depth = x - stop.position_m
        direction = hy.par[0]
        force = spring + drag_n(friction, m * striker.gravity_m_s2, v, direction * v, direction, hy.exp)
        events = [hy.t_event(depth, direction=hy.event_direction.positive)]
        if in_contact and isinstance(stop, KelvinVoigt):
            push = stop.stiffness_n_m * depth + stop.damping_n_s_m * v
            force -= push
            events = [hy.t_event(push / stop.stiffness_n_m, direction=hy.event_direction.negative)]
        if static_limit_n(parts) > 0.0:
            events.append(hy.t_event(v))
        equations = [(x, v), (v, force / m)]
        if isinstance(drive, MotorDrive):
            loss = drive.viscous_n_m_s * omega + spring * drive.amplitude_m * hy.cos(angle)
            equations += [(theta, omega), (omega, (self.torque_n_m - loss) / drive.inertia_kg_m2)]
        start = [0.0] * len(equations)
        return hy.taylor_adaptive(equations, start, tol=tolerance, t_events=events)


def methods(case: Case, quick: bool) -> list[Method]:
    """Return heyoka at several tolerances; the time of its compilation is not measured."""
    return [
        Method("heyoka", f"{tolerance:.0e}", partial(run, case, HeyokaFlow(case, tolerance)))
        for tolerance in (TOLERANCES[1:2] if quick else TOLERANCES)
    ]
