"""Current of a motor for a torque command: ideal, or through windings in the rotor's frame.

Permanent-magnet synchronous motor, d-q frame, peak values (Krause et al., Analysis of Electric Machinery, 3rd
ed. 2013, chapter 4), ω_e = p ω:

L_d i_d' = v_d − R i_d + ω_e L_q i_q;  L_q i_q' = v_q − R i_q − ω_e L_d i_d − ω_e ψ;
T = 3/2 p (ψ i_q + (L_d − L_q) i_d i_q), with ψ = K_t / (3/2 p).

Current loop, i_d* = 0, i_q* = T*/K_t within the drive's limit: PI with internal-model gains α L and α R
(Harnefors, Nee, IEEE Trans. Ind. Appl. 34(1), 1998) and feed-forward of cross-coupling and back-EMF, so
that i' = α (i* − i) within the voltage limit. The voltage is clamped to the circle V/√3 in the commanded
direction; the difference is fed back to the integrals (anti-windup). The loop runs in continuous time: α is
some thousand rad/s, and a loop of 20 kHz would add 75 µs of delay to a lag of 1 ms, yet cost twenty restarts
of a solver every tick.
"""

from typing import NamedTuple, TypeAlias

from pydantic import Field

from plant_sim.kernels import one_of, subroutine
from plant_sim.parts.drive import MotorDrive
from plant_sim.tables.quantities import AngularSpeed, Inductance
from plant_sim.tables.table import Table


class IdealCurrent(NamedTuple):
    """An ideal current source within the drive's limits; an ideal drive has no current."""


class DqWinding(NamedTuple):
    """Windings in the rotor's frame with their current loop; `motor` has R, K_t, pole pairs and limits."""

    d_inductance_h: float
    q_inductance_h: float
    bandwidth_rad_s: float


Winding: TypeAlias = IdealCurrent | DqWinding

is_wound = one_of(DqWinding)
"""Whether the windings of the motor are modelled."""


@subroutine
def flux_wb(drive: MotorDrive) -> float:
    """ψ = K_t / (3/2 p)."""
    flux: float = drive.torque_constant_n_m_a / (1.5 * drive.pole_pairs)
    return flux


class WindingTable(Table):
    """[winding]: a dq-motor's parameters beside [motor]; R and L are per phase, K_t per peak ampere."""

    d_inductance_h: Inductance | None = Field(
        default=None, gt=0.0, description="the inductance along the magnets in H (default: the motor's)"
    )
    q_inductance_h: Inductance | None = Field(
        default=None, gt=0.0, description="the inductance across them in H (default: the motor's)"
    )
    # An ODrive's own default. With the 1 ms tick of the torque command a faster loop shows little.
    bandwidth_rad_s: AngularSpeed = Field(
        default=1000.0, gt=0.0, description="the bandwidth of the current loop in rad/s"
    )

    def part(self, inductance_h: float) -> DqWinding:
        """The windings of a motor with this inductance."""
        return DqWinding(
            self.d_inductance_h or inductance_h,
            self.q_inductance_h or inductance_h,
            self.bandwidth_rad_s,
        )
