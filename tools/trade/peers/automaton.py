"""The phases of contact and stick, for integrators that have events but no phases.

The peers integrate smooth motion up to an event. This module applies the event to the state and chooses the
next phase, in the same way for all peers. A striker in stick or on the stop is released at the closed-form
instant.
"""

import math
from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.friction import Coulomb, Friction, Stribeck, Viscous
from plant_sim.parts.friction import static_limit_n as friction_limit_n
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import KelvinVoigt, RigidStop
from tools.trade.cases import Answer, Case, answer

NUDGE_M_S = 1e-14
"""Initial velocity of a released striker; at zero velocity the peers would find the same event again."""

REST_M_S = 1e-9
"""A striker with a slower rebound rests on the stop."""

MOST_EVENTS = 20_000


class PeerError(RuntimeError):
    """A peer that stops early, exceeds MOST_EVENTS or does not support a scene."""


class Event(Enum):
    """The event that ends a smooth piece of motion."""

    END = "end"
    STOP = "stop"
    """The start of contact (touch-down) in flight, its end (separation) in contact."""
    HALT = "halt"


class Piece(NamedTuple):
    """A smooth piece of motion."""

    t_s: float
    state: list[float]
    """State at the end of the piece: x, v and, with a motor, crank angle and speed."""
    event: Event


Flow = Callable[[float, list[float], float, float, bool], Piece]
"""An integrator: from a time and state to the first event, at most until a time; the direction in which the
striker slides, and whether it is in contact."""


def static_limit_n(parts: Parts) -> float:
    """Return the largest static friction force, N."""
    return friction_limit_n(parts.friction, parts.striker.mass_kg * parts.striker.gravity_m_s2)


class Functions(NamedTuple):
    """Sine, cosine and exponential of the numbers or symbols with which a peer computes."""

    sin: Callable[[Any], Any]
    cos: Callable[[Any], Any]
    exp: Callable[[Any], Any]


def drag_n(friction: Friction, weight_n: float, v: Any, speed: Any, direction: Any, of: Functions) -> Any:
    """Return the friction force on a striker that slides in `direction` with a velocity and a speed, N."""
    match friction:
        case Viscous(b):
            return -b * v
        case Coulomb(mu, b):
            return -mu * weight_n * direction - b * v
        case Stribeck(mu, mu_s, v_s, delta, b):
            share = speed / v_s
            fall = of.exp(-share if delta == 1.0 else -(share**delta))
            return -(mu + (mu_s - mu) * fall) * weight_n * direction - b * v
    return 0.0 * v


def depth_m(parts: Parts, x: Any) -> Any:
    """Return the striker's depth in the stop, m; negative before it."""
    stop = parts.stop
    if not isinstance(stop, KelvinVoigt | RigidStop):
        raise TypeError(f"{stop!r} is no stop of a case that peers are given")
    return x - stop.position_m


def push_n(parts: Parts, x: Any, v: Any) -> Any:
    """Return the force of a Kelvin–Voigt stop in contact, N."""
    stop = parts.stop
    if not isinstance(stop, KelvinVoigt):
        raise TypeError(f"{stop!r} has no contact that a peer integrates")
    return stop.stiffness_n_per_m * depth_m(parts, x) + stop.damping_n_s_m * v


def slopes(
    case: Case, of: Functions, t: Any, state: Any, speed: Any, sense: Any, in_contact: bool
) -> list[Any]:
    """Return the derivatives of x, v and, with a motor, of the crank's angle and speed.

    The striker slides in direction `sense` with `speed`, the size of v.
    """
    parts = case.parts
    striker, drive, friction = parts[:3]
    x, v = state[0], state[1]
    angle = drive.omega_rad_s * t + drive.phase_rad if isinstance(drive, IdealDrive) else state[2]
    spring = striker.spring_n_per_m * (drive.amplitude_m * of.sin(angle) + striker.rest_length_m - x)
    force = spring + drag_n(friction, striker.mass_kg * striker.gravity_m_s2, v, speed, sense, of)
    if in_contact:
        force = force - push_n(parts, x, v)
    if not isinstance(drive, MotorDrive):
        return [v, force / striker.mass_kg]
    loss = drive.viscous_n_m_s * state[3] + spring * drive.amplitude_m * of.cos(angle)
    return [v, force / striker.mass_kg, state[3], (case.torque_n_m - loss) / drive.inertia_kg_m2]


def run(case: Case, flow: Flow) -> Answer:
    """Run the whole case with one integrator; raises PeerError after MOST_EVENTS events."""
    parts = case.parts
    limit_n, stop = static_limit_n(parts), parts.stop
    t_s, state = 0.0, [case.scene.initial_x_m, case.scene.initial.v_m_s]
    if isinstance(parts.drive, MotorDrive):
        state += [parts.drive.phase_rad, 0.0]
    times: list[float] = []
    before: list[float] = []
    after: list[float] = []
    touched: tuple[float, float] | None = None
    direction = 1.0
    for _ in range(MOST_EVENTS):
        if t_s >= case.until_s:
            break
        x, v = state[0], state[1]
        if v == 0.0 and isinstance(parts.drive, IdealDrive):
            pull_n = _pull_n(parts, t_s, x)
            on_stop = isinstance(stop, RigidStop) and x == stop.position_m
            held = pull_n >= -limit_n if on_stop else abs(pull_n) <= limit_n > 0.0
            if held:
                t_s = min(_release_s(parts, t_s, x, on_stop), case.until_s)
                pull_n = -1.0 if on_stop else _pull_n(parts, t_s, x)
            direction = math.copysign(1.0, pull_n)
            if limit_n > 0.0 or on_stop:
                state[1] = NUDGE_M_S * direction
            if t_s >= case.until_s:
                state[1] = 0.0
                break
        t_s, state, event = flow(t_s, state, case.until_s, direction, touched is not None)
        if event is Event.HALT:
            state[1] = 0.0
        elif event is Event.STOP and isinstance(stop, RigidStop):
            v = state[1]
            times.append(t_s)
            before.append(v)
            after.append(-stop.restitution * v)
            state[0], state[1] = stop.position_m, after[-1] if after[-1] < -REST_M_S else 0.0
            direction = -1.0
        elif event is Event.STOP and touched is None:
            touched = (t_s, state[1])
        elif event is Event.STOP and touched is not None:
            times.append(touched[0])
            before.append(touched[1])
            after.append(state[1])
            touched = None
    else:
        raise PeerError(f"{MOST_EVENTS} events by t = {t_s} s in {case.name}")
    return answer(np.array(times), np.array(before), np.array(after), state[0], state[1])


def _pull_n(parts: Parts, t_s: float, x_m: float) -> float:
    striker, drive = parts.striker, parts.drive
    if not isinstance(drive, IdealDrive):
        raise PeerError("only an ideal drive's pull is a function of time")
    angle = drive.omega_rad_s * t_s + drive.phase_rad
    return striker.spring_n_per_m * (drive.amplitude_m * math.sin(angle) + striker.rest_length_m - x_m)


def _release_s(parts: Parts, t_s: float, x_m: float, on_stop: bool) -> float:
    """Return the next time at which the spring force exceeds static friction (forwards: and the stop), s."""
    striker, drive = parts.striker, parts.drive
    if not isinstance(drive, IdealDrive) or drive.amplitude_m == 0.0:
        return math.inf
    limit_m = static_limit_n(parts) / striker.spring_n_per_m
    best = math.inf
    for sign in (-1.0,) if on_stop else (1.0, -1.0):
        sine = (sign * limit_m + x_m - striker.rest_length_m) / drive.amplitude_m
        if abs(sine) <= 1.0:
            angle = math.asin(sine) if sign > 0.0 else math.pi - math.asin(sine)
            turns = (drive.omega_rad_s * t_s + drive.phase_rad - angle) / (2.0 * math.pi)
            angle += 2.0 * math.pi * (math.floor(turns + 1e-9) + 1.0)
            best = min(best, (angle - drive.phase_rad) / drive.omega_rad_s)
    return best


def has_peers(parts: Parts) -> bool:
    """Return whether the equations of the peers cover these parts."""
    drive, stop = parts.drive, parts.stop
    if isinstance(drive, MotorDrive):
        return drive.dry_n_m == 0.0 and isinstance(stop, KelvinVoigt) and static_limit_n(parts) == 0.0
    return isinstance(stop, RigidStop)
