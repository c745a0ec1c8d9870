"""Current of a motor for a torque command: ideal, or through windings in the rotor's frame.

Permanent-magnet synchronous motor, d-q frame, peak values (Krause et al., Analysis of Electric Machinery, 3rd
ed. 2013, chapter 4), ω_e = p ω:

L_d i_d' = v_d − R i_d + ω_e L_q i_q;  L_q i_q' = v_q − R i_q − ω_e L_d i_d − ω_e ψ(θ);
T = 3/2 p (ψ(θ) i_q + (L_d − L_q) i_d i_q), with ψ = K_t / (3/2 p) in the mean.

Current loop, i_d* = 0, i_q* = T*/K_t within the drive's limit: PI with internal-model gains α L and α R
(Harnefors, Nee, IEEE Trans. Ind. Appl. 34(1), 1998) and feed-forward of cross-coupling and mean back-EMF, so
that i' = α (i* − i) within the voltage limit. The voltage is clamped to the circle V/√3 in the commanded
direction; the difference is fed back to the integrals (anti-windup). The loop runs in continuous time: α is
some thousand rad/s, and a loop of 20 kHz would add 75 µs of delay to a lag of 1 ms, yet cost twenty restarts
of a solver every tick.
"""

import math
from collections.abc import Iterable
from typing import NamedTuple, TypeAlias

from pydantic import Field

from plant_sim.kernels import by_part, law, subroutine
from plant_sim.parts.drive import MotorDrive
from plant_sim.tables.table import Table


class Wave(NamedTuple):
    """amplitude · sin(order · angle + phase)."""

    order: float
    amplitude: float
    phase_rad: float


class Smooth(NamedTuple):
    """No waves."""


class Waves(NamedTuple):
    """A sum of one or more waves."""

    waves: tuple[Wave, ...]


Unevenness: TypeAlias = Smooth | Waves


class IdealCurrent(NamedTuple):
    """An ideal current source within the drive's limits; an ideal drive has no current."""


class DqWinding(NamedTuple):
    """Windings in the rotor's frame with their current loop; `motor` has R, K_t, pole pairs and limits."""

    d_inductance_h: float
    q_inductance_h: float
    bandwidth_rad_s: float
    cogging: Unevenness
    """Cogging torque on the crank, N m, over its angle; its work over a turn is 0."""
    ripple: Unevenness
    """Relative ripple of the flux ψ(θ), and with it of torque and back-EMF, over the electrical angle p θ."""


Winding: TypeAlias = IdealCurrent | DqWinding


@by_part
def wave_sum(waves: Unevenness, angle_rad: float) -> float:
    """Σ a sin(n θ + φ)."""
    return 0.0


@law(wave_sum, Waves)
def _(waves: Waves, angle_rad: float) -> float:
    total = 0.0
    for wave in waves.waves:
        total += wave.amplitude * math.sin(wave.order * angle_rad + wave.phase_rad)
    return total


@by_part
def wave_energy(waves: Unevenness, angle_rad: float) -> float:
    """Σ a/n cos(n θ + φ): the potential of the torque Σ a sin(n θ + φ)."""
    return 0.0


@law(wave_energy, Waves)
def _(waves: Waves, angle_rad: float) -> float:
    total = 0.0
    for wave in waves.waves:
        total += wave.amplitude / wave.order * math.cos(wave.order * angle_rad + wave.phase_rad)
    return total


@by_part
def cogging(winding: Winding) -> Unevenness:
    """Waves of the cogging torque, N m; positive torque accelerates the crank."""
    return Smooth()


@law(cogging, DqWinding)
def _(winding: DqWinding) -> Unevenness:
    return winding.cogging


@subroutine
def mean_flux_wb(drive: MotorDrive) -> float:
    """ψ = K_t / (3/2 p)."""
    flux: float = drive.torque_constant_n_m_a / (1.5 * drive.pole_pairs)
    return flux


@subroutine
def flux_wb(winding: DqWinding, drive: MotorDrive, angle_rad: float) -> float:
    """ψ(θ)."""
    return mean_flux_wb(drive) * (1.0 + wave_sum(winding.ripple, drive.pole_pairs * angle_rad))


@subroutine
def voltage_limit_v(drive: MotorDrive) -> float:
    """Largest voltage vector of a bus, V: the circle inscribed in the inverter's hexagon."""
    return drive.supply_v / math.sqrt(3.0)


@subroutine
def asked_current_a(drive: MotorDrive, torque_n_m: float) -> float:
    """i_q*, A."""
    asked_a = torque_n_m / drive.torque_constant_n_m_a
    return min(max(asked_a, -drive.current_limit_a), drive.current_limit_a)


class CoggingTable(Table):
    """[[winding.cogging]]: a wave of the magnets' torque on the slots."""

    order: int = Field(ge=1, description="the number of periods in a turn of the crank")
    amplitude_n_m: float = Field(ge=0.0, description="the amplitude in N m")
    phase_rad: float = Field(default=0.0, description="the phase at θ = 0 in rad, of a sine")


class RippleTable(Table):
    """[[winding.ripple]]: a wave of the magnets' flux, and with it of torque and back-EMF."""

    order: int = Field(ge=1, description="the number of periods in an electrical turn, p θ")
    share: float = Field(ge=0.0, lt=1.0, description="the amplitude as a share of the mean flux, below 1")
    phase_rad: float = Field(default=0.0, description="the phase at θ = 0 in rad, of a sine")


class WindingTable(Table):
    """[winding]: a dq-motor's parameters beside [motor]; R and L are per phase, K_t per peak ampere."""

    d_inductance_h: float | None = Field(
        default=None, gt=0.0, description="the inductance along the magnets in H (default: the motor's)"
    )
    q_inductance_h: float | None = Field(
        default=None, gt=0.0, description="the inductance across them in H (default: the motor's)"
    )
    # An ODrive's own default. With the 1 ms tick of the torque command a faster loop shows little.
    bandwidth_rad_s: float = Field(
        default=1000.0, gt=0.0, description="the bandwidth of the current loop in rad/s"
    )
    cogging: list[CoggingTable] = Field(default=[], description="the tables [[winding.cogging]]")
    ripple: list[RippleTable] = Field(default=[], description="the tables [[winding.ripple]]")

    def part(self, inductance_h: float) -> DqWinding:
        """The windings of a motor with this inductance."""
        return DqWinding(
            self.d_inductance_h or inductance_h,
            self.q_inductance_h or inductance_h,
            self.bandwidth_rad_s,
            _unevenness((wave.order, wave.amplitude_n_m, wave.phase_rad) for wave in self.cogging),
            _unevenness((wave.order, wave.share, wave.phase_rad) for wave in self.ripple),
        )


def _unevenness(waves: Iterable[tuple[int, float, float]]) -> Unevenness:
    """Waves, each with an order, an amplitude and a phase."""
    found = tuple(Wave(float(order), amplitude, phase_rad) for order, amplitude, phase_rad in waves)
    return Waves(found) if found else Smooth()
