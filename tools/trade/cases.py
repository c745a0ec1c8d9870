"""The scenes on which methods are compared, each with one difficulty; a method's answer, and its errors."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.parts.drive import IdealDrive
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene, load_scene, read_scene, with_values


@dataclass(frozen=True, eq=False)
class Case:
    """A scene, the duration of its run, and its constant torque."""

    name: str
    base: str
    changes: Mapping[str, Any]
    until_s: float
    torque_n_m: float = 0.0

    @cached_property
    def scene(self) -> Scene:
        """The checked scene."""
        return load_scene(with_values(read_scene(self.base), self.changes))

    @cached_property
    def parts(self) -> Parts:
        """The scene's parts."""
        return self.scene.parts()

    @property
    def period_s(self) -> float:
        """Forcing period; for a motor the period of the free oscillation."""
        drive = self.parts.drive
        fast = drive.omega_rad_s if isinstance(drive, IdealDrive) else self.scene.natural_rad_s
        return 2.0 * math.pi / fast


CASES = (
    Case("periodic", "table1-viscous", {"drive.ratio": 1.0}, 50.0),
    Case("sensitive", "table1-coulomb", {"drive.ratio": 0.9}, 20.0),
    # The stop is at the spring's rest length: once a period chatter, rest on the stop, and release.
    Case("chattering", "table1-viscous", {"stop.position_m": 0.12, "drive.ratio": 0.3}, 50.0),
    Case("sticking", "table1-coulomb", {"drive.amplitude_m": 0.024}, 50.0),
    Case("Stribeck", "table1-stribeck", {}, 50.0),
    # Without the motor's dry loss, which no peer models, and with a stop smooth enough for Taylor series.
    Case("motor", "gait-motor-soft", {"motor.dry_n_m": 0.0, "stop.law": "kelvin-voigt"}, 3.0, 0.05),
)


LEAST_IMPACT_M_S = 1e-3
"""Slowest impact that is counted; chatter ends with infinitely many slower ones."""


class Answer(NamedTuple):
    """Result of a method: impacts of at least LEAST_IMPACT_M_S, and the state at the end."""

    t_s: FloatArray
    v_m_s: FloatArray
    v_after_m_s: FloatArray
    x_end_m: float
    v_end_m_s: float


def answer(t_s: FloatArray, v_m_s: FloatArray, v_after_m_s: FloatArray, x_m: float, end_m_s: float) -> Answer:
    """Return an answer without the impacts that are slower than LEAST_IMPACT_M_S."""
    counted = np.asarray(v_m_s) >= LEAST_IMPACT_M_S
    times, before, after = (np.asarray(a, dtype=np.float64)[counted] for a in (t_s, v_m_s, v_after_m_s))
    return Answer(times, before, after, float(x_m), float(end_m_s))


Solve = Callable[[], Answer]


class Method(NamedTuple):
    """A method with one setting; the time of `solve` is measured."""

    name: str
    setting: str
    solve: Solve


class Errors(NamedTuple):
    """Errors of an answer by their keys in a row; nan for single impacts if their number is wrong."""

    error: float
    """Error of the final state in m: of the position, or of the velocity over ω, whichever is larger."""
    impact_time_error_s: float
    impact_speed_error_m_s: float
    impulse_error: float
    """Relative error of the total momentum exchanged with the stop."""
    impacts: int
    impacts_wanted: int


def errors_of(case: Case, given: Answer, truth: Answer) -> Errors:
    """Compare an answer with the truth."""
    same = given.t_s.size == truth.t_s.size
    nan = math.nan
    exchanged = float(np.sum(truth.v_m_s - truth.v_after_m_s))
    difference = abs(float(np.sum(given.v_m_s - given.v_after_m_s)) - exchanged)
    return Errors(
        error=max(
            abs(given.x_end_m - truth.x_end_m),
            abs(given.v_end_m_s - truth.v_end_m_s) / case.scene.natural_rad_s,
        ),
        impact_time_error_s=_largest(given.t_s - truth.t_s) if same else nan,
        impact_speed_error_m_s=_largest(given.v_m_s - truth.v_m_s) if same else nan,
        impulse_error=difference / exchanged if exchanged > 0.0 else difference,
        impacts=given.t_s.size,
        impacts_wanted=truth.t_s.size,
    )


def _largest(values: FloatArray) -> float:
    return float(np.max(np.abs(values), initial=0.0))
