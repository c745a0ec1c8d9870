"""Long motions of a module with an ideal drive, by the plant's solvers, and what they end in.

Turns of the crank count from its backward dead centre, θ = −π/2: the striker is then far from the stop, so
that an impact never falls on the border between two of them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface.enums import Regime
from plant_sim.kernels import jit, subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.stop import RigidStop
from plant_sim.result import MotionState, Phase, Samples, SimulationResult
from plant_sim.scene import Scene
from plant_sim.solvers.adaptive import adaptive
from plant_sim.solvers.bernstein import new_scratch
from plant_sim.solvers.double_double import TURN_RAD
from plant_sim.solvers.event import Event
from plant_sim.solvers.exact import exact
from plant_sim.solvers.exact.automaton import after, begin, next_event
from plant_sim.solvers.exact.oscillator import Oscillator, oscillator
from plant_sim.solvers.exact.tilt import remove_tilt
from tools.output import BadInputError

Vector = NDArray[np.float64]

SECTION_RAD = -0.5 * math.pi
ACCURACY_M = 1e-7
"""Accuracy of the adaptive solver per period, m: about a millionth of the gap."""
LONGEST_CYCLE = 8
"""Longest recognised cycle, in turns."""
LEAST_REPEATED = 3
"""Fewest turns that a cycle must repeat."""
LAST_TURNS = 2 * LONGEST_CYCLE + 1
"""Fewest turns at the end of a motion that give its outcome; the longest cycle needs them."""
DOUBT = 100.0
"""A longer cycle is in doubt while a shorter one repeats within this multiple of the tolerance."""
CHATTER_IMPACTS = 16
"""From this number of impacts in a turn on, a motion is chatter even without rest on the stop."""
REST_M_S = 1e-8
"""An impact whose rebound is slower ends at rest on the stop."""
STUCK_J = 1e-9
"""A striker at rest is stuck if friction takes less energy: with dry friction, slides of a nanometre."""


class State(NamedTuple):
    """State of the module: position less rest length, velocity, crank angle."""

    y_m: float
    v_m_s: float
    crank_rad: float


AT_REST = State(0.0, 0.0, 0.0)


class Protocol(NamedTuple):
    """Duration of a motion; its whole turns in the last `record_s`, or some more, give its outcome.

    `tolerance`: of the v⁻ of a repeated cycle, over the scale of speed. `looks`: samples a turn for the
    extremes of the motion; without them the extremes are nan.
    """

    settle_s: float
    record_s: float
    tolerance: float
    looks: int = 0


PAPER = Protocol(settle_s=30.0, record_s=20.0, tolerance=1e-4, looks=64)
"""The paper's protocol: 50 s, the first 30 s discarded."""
CLASSIFY = Protocol(settle_s=50.0, record_s=0.0, tolerance=1e-7)
"""Protocol for the attractor alone."""


class Outcome(NamedTuple):
    """Regime and end of a motion, and means over its last whole cycles, or all recorded turns without one.

    `cycle`: turns after which the impacts repeat; 0 if they do not. `impacts`: per turn. `repeatability`:
    standard deviation over mean of the impulses. `peak_n`: nan at a rigid stop. The energies are those of a
    turn.
    """

    regime: Regime
    cycle: int
    impacts: float
    v_mean_m_s: float
    v_max_m_s: float
    v_min_m_s: float
    impulse_n_s: float
    repeatability: float
    peak_n: float
    x_low_m: float
    x_high_m: float
    drive_j: float
    friction_j: float
    loss_j: float
    end: State


def turn_s(scene: Scene) -> float:
    """Duration of a turn of the crank, s. Raises BadInputError if it does not turn."""
    return TURN_RAD / turning_rad_s(scene)


def turning_rad_s(scene: Scene) -> float:
    """The crank's speed, rad/s. Raises BadInputError if it does not turn."""
    drive = scene.parts().drive
    assert isinstance(drive, IdealDrive)
    if drive.omega_rad_s == 0.0:
        raise BadInputError(
            "the drive's speed is 0: orbits and attractors are those of a turning crank; give drive.ratio, "
            "drive.frequency_hz or drive.speed_rad_s above 0"
        )
    return drive.omega_rad_s


def scale_m_s(scene: Scene) -> float:
    """The scale of a scene's speeds, m/s: ω times gap and amplitude."""
    gap_m = getattr(scene.stop, "position_m", math.inf) - scene.striker.rest_length_m
    return float(scene.natural_rad_s * (abs(gap_m) + scene.drive.amplitude_m))


def motion(
    scene: Scene,
    start: State,
    until_s: float,
    t_s: Vector | None = None,
    accuracy_m: float = ACCURACY_M,
) -> SimulationResult:
    """The motion from a start, by the closed form if there is one, otherwise by the adaptive solver.

    `t_s`: times of samples. `accuracy_m`: the adaptive solver's, per period.
    """
    parts = scene.parts()
    x_m = start.y_m + parts.striker.rest_length_m
    if isinstance(parts.stop, RigidStop):
        x_m = min(x_m, parts.stop.position_m)  # where rounding has put it beyond
    omega_rad_s = TURN_RAD / turn_s(scene)
    initial = MotionState(0.0, x_m, start.v_m_s, start.crank_rad, omega_rad_s, Phase.FLIGHT)
    if scene.beyond_closed_form:
        return adaptive.simulate(parts, initial, until_s, t_s, accuracy=accuracy_m)
    return exact.simulate(parts, initial, until_s, t_s)


def end_of(scene: Scene, found: SimulationResult) -> State:
    """The state at the end of a motion."""
    final = found.final
    return State(final.x_m - scene.striker.rest_length_m, final.v_m_s, final.crank_rad)


def follow(scene: Scene, start: State, protocol: Protocol) -> Outcome:
    """The outcome of one start."""
    a_turn_s = turn_s(scene)
    first_s = ((SECTION_RAD - start.crank_rad) % TURN_RAD) / TURN_RAD * a_turn_s
    recorded = max(math.floor(protocol.record_s / a_turn_s), LAST_TURNS)
    turns = math.floor((protocol.settle_s + protocol.record_s - first_s) / a_turn_s)
    settled = end_of(scene, motion(scene, start, first_s + max(turns - recorded, 0) * a_turn_s))
    looks_s = np.linspace(0.0, recorded * a_turn_s, recorded * protocol.looks + 1) if protocol.looks else None
    return outcome_of(
        scene, motion(scene, settled, recorded * a_turn_s, looks_s), recorded, protocol.tolerance
    )


def classify(scene: Scene, starts: Vector) -> tuple[NDArray[np.int64], Vector]:
    """The cycles (0: none) and the impacts a turn in which starts end: (y, v, crank angle), shape (n, 3)."""
    cycles, rates = np.empty(len(starts), np.int64), np.empty(len(starts))
    turning_rad_s(scene)
    tolerance_m_s = CLASSIFY.tolerance * scale_m_s(scene)
    if not scene.beyond_closed_form:
        parts, level = scene.parts(), remove_tilt(scene.parts())
        sag_m = parts.striker.rest_length_m - level.striker.rest_length_m
        o, shifted = oscillator(kernel_parts(level)), starts + np.array([sag_m, 0.0, 0.0])
        classify_in_closed_form(o, shifted, CLASSIFY.settle_s, tolerance_m_s, cycles, rates)
        return cycles, rates
    for index, start in enumerate(starts.tolist()):
        outcome = follow(scene, State(*start), CLASSIFY)
        cycles[index], rates[index] = outcome.cycle, outcome.impacts
    return cycles, rates


@jit
def classify_in_closed_form(
    o: Oscillator,
    starts: Vector,
    settle_s: float,
    tolerance_m_s: float,
    cycles: NDArray[np.int64],
    rates: Vector,
) -> None:
    """Fill the cycles and the impacts a turn in which starts end; a map has a million of them."""
    turn_s, scratch = TURN_RAD / o.drive_rad_s, new_scratch()
    counts, v_m_s = np.empty(LAST_TURNS, np.int64), np.empty(LAST_TURNS * CHATTER_IMPACTS)
    for index in range(len(starts)):
        y_m, start_m_s, crank_rad = starts[index, 0], starts[index, 1], starts[index, 2]
        first_s = ((SECTION_RAD - crank_rad) % TURN_RAD) / TURN_RAD * turn_s
        until_s = first_s + math.floor((settle_s - first_s) / turn_s) * turn_s
        recorded_s = until_s - LAST_TURNS * turn_s
        counts[:] = 0
        found = 0
        motion, event = begin(o, 0.0, min(y_m, o.gap_m), start_m_s, crank_rad), Event.TOUCH
        while event != Event.NONE:
            arrival, event = next_event(o, motion, until_s, scratch)
            motion = after(o, arrival, event, exact.REST_SPEED_M_S)
            if event == Event.TOUCH and arrival.t_s >= recorded_s:
                counts[min(int((arrival.t_s - recorded_s) / turn_s), LAST_TURNS - 1)] += 1
                if found == len(v_m_s):
                    v_m_s = np.concatenate((v_m_s, np.empty_like(v_m_s)))
                v_m_s[found] = arrival.v_m_s
                found += 1
        cycles[index] = cycle_of(counts, v_m_s[:found], tolerance_m_s)
        rates[index] = np.mean(counts[LAST_TURNS % max(cycles[index], 1) :])


def outcome_of(scene: Scene, found: SimulationResult, turns: int, tolerance: float) -> Outcome:
    """The outcome by a recorded motion of this number of turns."""
    impacts, energy, end = found.impacts, found.energy, end_of(scene, found)
    place = np.minimum((impacts.t_s / turn_s(scene)).astype(np.int64), turns - 1)
    counts = np.bincount(place, minlength=turns)
    cycle = cycle_of(counts, np.ascontiguousarray(impacts.v_m_s), tolerance * scale_m_s(scene))
    used = turns - turns % max(cycle, 1)
    kept = place >= turns - used
    v_m_s, impulses_n_s = impacts.v_m_s[kept], impacts.impulse_n_s[kept]
    low_m, high_m = (math.nan, math.nan) if found.samples is None else extremes(found.samples)
    if scene.stop.law == "rigid":
        high_m = scene.stop.position_m if len(v_m_s) else min(high_m, scene.stop.position_m)
    some = len(v_m_s) > 0
    return Outcome(
        regime=regime_of(
            counts, impacts.v_after_m_s, cycle, end.v_m_s == 0.0 and energy.friction_j < STUCK_J
        ),
        cycle=cycle,
        impacts=len(v_m_s) / used,
        v_mean_m_s=float(np.mean(v_m_s)) if some else math.nan,
        v_max_m_s=float(np.max(v_m_s)) if some else math.nan,
        v_min_m_s=float(np.min(v_m_s)) if some else math.nan,
        impulse_n_s=float(np.mean(impulses_n_s)) if some else math.nan,
        repeatability=float(np.std(impulses_n_s) / np.mean(impulses_n_s)) if some else math.nan,
        peak_n=float(np.max(impacts.peak_force_n[kept])) if some else math.nan,
        x_low_m=low_m,
        x_high_m=high_m,
        drive_j=energy.drive_work_j / turns,
        friction_j=energy.friction_j / turns,
        loss_j=energy.impact_loss_j / turns,
        end=end,
    )


@jit
def cycle_of(counts: NDArray[np.int64], v_m_s: Vector, tolerance_m_s: float) -> int:
    """The fewest turns after which the impacts repeat; 0 if none.

    `counts`: impacts in each turn. Their numbers repeat in all of the last turns, v⁻ for the cycle's length.
    A motion that converges to a short cycle from alternating sides repeats every second turn before it
    repeats every turn: 0 while a divisor of the cycle nearly repeats.
    """
    for cycle in range(1, LONGEST_CYCLE + 1):
        if change_m_s(counts, v_m_s, cycle) <= tolerance_m_s:
            for shorter in range(1, cycle):
                if cycle % shorter == 0 and change_m_s(counts, v_m_s, shorter) <= DOUBT * tolerance_m_s:
                    return 0
            return cycle
    return 0


@subroutine
def change_m_s(counts: NDArray[np.int64], v_m_s: Vector, cycle: int) -> float:
    """How much v⁻ changes from cycle to cycle of this number of turns; ∞ if the impacts do not repeat."""
    turns, repeated = len(counts), max(cycle, LEAST_REPEATED)
    if min(turns, LAST_TURNS) < repeated + cycle:
        return math.inf
    for turn in range(max(turns - LAST_TURNS, 0) + cycle, turns):
        if counts[turn] != counts[turn - cycle]:
            return math.inf
    compared, apart, largest_m_s = 0, 0, 0.0
    for turn in range(turns - repeated, turns):
        compared += counts[turn]
        apart += counts[turn] if turn >= turns - cycle else 0
    for place in range(len(v_m_s) - compared, len(v_m_s)):
        largest_m_s = max(largest_m_s, abs(v_m_s[place] - v_m_s[place - apart]))
    return largest_m_s


def regime_of(counts: NDArray[np.int64], v_after_m_s: Vector, cycle: int, is_still: bool) -> Regime:
    """The regime by the impacts in each turn, their rebounds, the cycle, and whether the striker stands."""
    if not counts.any():
        return Regime.STUCK if is_still else Regime.NON_IMPACT
    if not counts[-LAST_TURNS:].any():
        return Regime.LOST
    if np.max(counts) >= CHATTER_IMPACTS or np.min(np.abs(v_after_m_s)) < REST_M_S:
        return Regime.CHATTERING
    if cycle == 0:
        return Regime.UNCERTAIN
    return Regime.IMPACT if cycle == 1 else Regime.PERIOD_N


def extremes(samples: Samples) -> tuple[float, float]:
    """Lowest and highest position, by cubic Hermite interpolation where the velocity changes its sign."""
    x, v, step_s = samples.x_m, samples.v_m_s, np.diff(samples.t_s)
    turns = np.flatnonzero(v[:-1] * v[1:] < 0.0)
    x0, x1, v0, v1, h = x[turns], x[turns + 1], v[turns], v[turns + 1], step_s[turns]
    s = v0 / (v0 - v1)
    between = (1.0 - s) ** 2 * (x0 * (1.0 + 2.0 * s) + h * v0 * s) + s * s * (
        x1 * (3.0 - 2.0 * s) + h * v1 * (s - 1.0)
    )
    every = np.concatenate((x, between))
    return float(np.min(every)), float(np.max(every))
