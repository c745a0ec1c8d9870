"""The housing that carries guide, crank and stop: at rest and level, tilted, moving, or on a walking leg.

In the frame of the housing the force −m a_b acts on the striker, with a_b the sum of the housing's
acceleration and gravity along +x: m (x'' + a_b) + c (x − l0 − x_A) = F. Accelerometers read x'' + a_b on the
striker and a_b on the housing. Gravity across the axis presses on the guide (see `Striker`).
"""

import math
from typing import NamedTuple, TypeAlias

from pydantic import Field

from plant_sim.arrays import FloatArray
from plant_sim.jets import add_sine
from plant_sim.kernels import by_part, one_of, subroutine
from plant_sim.parts.walking import Walking, along_axis, bump_m_s, expand_leg, leg_at, unbroken_s
from plant_sim.tables.quantities import Acceleration, Angle, Duration, Frequency
from plant_sim.tables.table import Table

SAME_INSTANT_S = 1e-12
"""A step that ends this close to the beginning or end of a shock counts as ending there, early in a run."""


class Level(NamedTuple):
    """a_b = 0."""


class Tilted(NamedTuple):
    """a_b = g sin α for an axis that rises by α towards the stop."""

    along_m_s2: float


class Moving(NamedTuple):
    """a_b = g sin α + â sin(ω_b t + φ) + â_s sin(π (t − t_s) / T) for t_s < t < t_s + T."""

    along_m_s2: float
    harmonic_m_s2: float
    harmonic_rad_s: float
    harmonic_phase_rad: float
    shock_m_s2: float
    shock_start_s: float
    shock_s: float


Housing: TypeAlias = Level | Tilted | Moving | Walking


@subroutine
def _same_s(t_s: float) -> float:
    """Largest distance, s, from `t_s` of a time that counts as the same instant: more than its rounding."""
    return SAME_INSTANT_S + 4e-16 * abs(t_s)


@by_part
def housing_m_s2(housing: Housing, t_s: float) -> float:
    """a_b, m/s²."""
    return 0.0


@housing_m_s2.register(Tilted)
def _tilted_housing_m_s2(housing: Tilted, t_s: float) -> float:
    return housing.along_m_s2


@housing_m_s2.register(Moving)
def _moving_housing_m_s2(housing: Moving, t_s: float) -> float:
    value = housing.along_m_s2 + housing.harmonic_m_s2 * math.sin(
        housing.harmonic_rad_s * t_s + housing.harmonic_phase_rad
    )
    into_s = t_s - housing.shock_start_s
    if 0.0 < into_s < housing.shock_s:
        value += housing.shock_m_s2 * math.sin(math.pi * into_s / housing.shock_s)
    return value


@housing_m_s2.register(Walking)
def _walking_housing_m_s2(housing: Walking, t_s: float) -> float:
    leg = leg_at(housing, t_s)
    return along_axis(housing, leg.up_m_s2, leg.forward_m_s2, leg.outward_m_s2)


_is_moving = one_of(Moving)


@subroutine
def steady_m_s2(housing: Housing) -> float:
    """The constant part of a_b, m/s², in which sensors are at rest; of any other motion a_b at t = 0."""
    return housing.along_m_s2 if _is_moving(housing) else housing_m_s2(housing, 0.0)


@by_part
def expand_housing(housing: Housing, t_s: float, series: FloatArray, work: FloatArray) -> None:
    """Taylor coefficients of a_b at `t_s`, into `series`, shape (order + 1,).

    `work` is scratch as for `expand_leg`.
    """
    raise NotImplementedError


@expand_housing.register(Level, Tilted)
def _expand_still_housing(housing: Level | Tilted, t_s: float, series: FloatArray, work: FloatArray) -> None:
    series[:] = 0.0
    series[0] = housing_m_s2(housing, t_s)


@expand_housing.register(Moving)
def _expand_moving_housing(housing: Moving, t_s: float, series: FloatArray, work: FloatArray) -> None:
    series[:] = 0.0
    series[0] = housing.along_m_s2
    rate = housing.harmonic_rad_s
    add_sine(housing.harmonic_m_s2, rate, rate * t_s + housing.harmonic_phase_rad, series)
    into_s = t_s - housing.shock_start_s
    if -_same_s(t_s) <= into_s < housing.shock_s - _same_s(t_s):
        rate = math.pi / housing.shock_s
        add_sine(housing.shock_m_s2, rate, rate * into_s, series)


@expand_housing.register(Walking)
def _expand_walking_housing(housing: Walking, t_s: float, series: FloatArray, work: FloatArray) -> None:
    expand_leg(housing, t_s, _same_s(t_s), series, work)


@by_part
def shock_m_s(housing: Housing, t_s: float) -> float:
    """The velocity, m/s, that a shock which begins at `t_s` gives the housing; 0 at all other times."""
    return 0.0


@shock_m_s.register(Moving)
def _moving_shock_m_s(housing: Moving, t_s: float) -> float:
    if abs(t_s - housing.shock_start_s) > _same_s(t_s):
        return 0.0
    return housing.shock_m_s2 * housing.shock_s * 2.0 / math.pi  # the integral of a half-sine


@shock_m_s.register(Walking)
def _walking_shock_m_s(housing: Walking, t_s: float) -> float:
    return bump_m_s(housing, t_s, _same_s(t_s))


@by_part
def smooth_for_s(housing: Housing, t_s: float) -> float:
    """Longest step from `t_s`, s: a radian of the motion at most, and not across a kink."""
    return math.inf


@smooth_for_s.register(Moving)
def _moving_smooth_for_s(housing: Moving, t_s: float) -> float:
    longest = 1.0 / housing.harmonic_rad_s if housing.harmonic_rad_s > 0.0 else math.inf
    into_s = t_s - housing.shock_start_s
    if into_s < -_same_s(t_s):
        longest = min(longest, -into_s)
    elif into_s < housing.shock_s - _same_s(t_s):
        longest = min(longest, housing.shock_s - into_s, housing.shock_s / math.pi)
    return longest


@smooth_for_s.register(Walking)
def _walking_smooth_for_s(housing: Walking, t_s: float) -> float:
    return unbroken_s(housing, t_s, _same_s(t_s))


is_level = one_of(Level)
"""Whether a_b = 0."""

is_still = one_of(Level, Tilted)
"""Whether a_b is constant."""


class HarmonicTable(Table):
    """The housing swings along the axis; a slow tilt of ±20° corresponds to 3.4 m/s²."""

    amplitude_m_s2: Acceleration = Field(gt=0.0, description="the amplitude in m/s²")
    frequency_hz: Frequency = Field(gt=0.0, description="the frequency in Hz")
    phase_rad: Angle = Field(default=0.0, description="the phase at t = 0 in rad")


class ShockTable(Table):
    """A single shock of the housing along the axis, a half-sine."""

    peak_m_s2: Acceleration = Field(
        description="the largest acceleration in m/s², negative away from the stop"
    )
    start_s: Duration = Field(ge=0.0, description="the shock's beginning in s")
    duration_s: Duration = Field(gt=0.0, description="the shock's duration in s")


NO_SWING = HarmonicTable.model_construct(amplitude_m_s2=0.0, frequency_hz=0.0)
NO_SHOCK = ShockTable.model_construct(peak_m_s2=0.0, start_s=0.0, duration_s=0.0)


@subroutine
def tilt_m_s2(gravity_m_s2: float, tilt_rad: float) -> float:
    """Gravity's part along an axis that rises by this angle towards the stop, as a_b."""
    return gravity_m_s2 * math.sin(tilt_rad)


@subroutine
def moving(along_m_s2: float, swing: HarmonicTable, shock: ShockTable) -> Moving:
    """A housing with this swing and this shock."""
    return Moving(
        along_m_s2=along_m_s2,
        harmonic_m_s2=swing.amplitude_m_s2,
        harmonic_rad_s=2.0 * math.pi * swing.frequency_hz,
        harmonic_phase_rad=swing.phase_rad,
        shock_m_s2=shock.peak_m_s2,
        shock_start_s=shock.start_s,
        shock_s=shock.duration_s,
    )


class MotionTable(Table):
    """[housing]: tilt and acceleration of the module's housing along the striker's axis."""

    tilt_rad: Angle = Field(
        default=0.0,
        ge=-math.pi / 2.0,
        le=math.pi / 2.0,
        description="the angle by which the axis rises towards the stop in rad",
    )
    harmonic: HarmonicTable | None = Field(default=None, description="the table [housing.harmonic]")
    shock: ShockTable | None = Field(default=None, description="the table [housing.shock]")

    def part(self, gravity_m_s2: float) -> Tilted | Moving:
        """The housing under this gravity."""
        along_m_s2 = tilt_m_s2(gravity_m_s2, self.tilt_rad)
        if self.harmonic is None and self.shock is None:
            return Tilted(along_m_s2)
        return moving(along_m_s2, self.harmonic or NO_SWING, self.shock or NO_SHOCK)
