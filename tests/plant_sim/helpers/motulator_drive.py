"""The d-q motor by motulator's machine, inverter and shaft, with the current loop as one more subsystem.

motulator works in the stator's frame with flux linkages. Its own current controller is discrete; this one is
the model's law in continuous time, so that the two can be compared to rounding.
"""

from types import SimpleNamespace

import numpy as np
from motulator.common.model._simulation import Subsystem
from motulator.drive.model import (
    Drive,
    ExternalRotorSpeed,
    StiffMechanicalSystem,
    SynchronousMachine,
    VoltageSourceConverter,
)
from motulator.drive.utils import SynchronousMachinePars
from scipy.integrate import solve_ivp

from plant_sim.parts.drive import MotorDrive
from plant_sim.parts.winding import DqWinding


class CurrentLoop(Subsystem):
    """PI with feed-forward, the voltage held within the circle and its lack fed back."""

    def __init__(self, drive: MotorDrive, winding: DqWinding, system: Drive, torque: float) -> None:
        super().__init__()
        self.drive, self.winding, self.system = drive, winding, system
        limit = drive.current_limit_a
        self.asked = 1j * min(max(torque / drive.torque_constant_n_m_a, -limit), limit)
        self.state = SimpleNamespace(u=0j)

    def set_outputs(self, _t: float) -> None:
        machine, winding = self.system.machine, self.winding
        electrical = self.drive.pole_pairs * self.system.mechanics.out.w_M
        gain = self.product(winding.bandwidth_rad_s * (self.asked - machine.i_s))
        asked_v = self.state.u + gain + 1j * electrical * machine.state.psi_s
        most_v = self.drive.supply_v / np.sqrt(3.0)
        given_v = asked_v * min(1.0, most_v / abs(asked_v)) if asked_v != 0.0 else 0j
        self.lack = given_v - asked_v
        self.error = self.asked - machine.i_s
        self.system.converter.inp.q_cs = given_v * machine.state.exp_j_theta_m / self.drive.supply_v

    def product(self, current: complex) -> complex:
        return self.winding.d_inductance_h * current.real + 1j * self.winding.q_inductance_h * current.imag

    def rhs(self) -> list[complex]:
        R, alpha = self.drive.resistance_ohm, self.winding.bandwidth_rad_s
        back = (
            self.lack.real / self.winding.d_inductance_h + 1j * self.lack.imag / self.winding.q_inductance_h
        )
        return [R * (alpha * self.error + back)]


def motulator_motion(
    drive: MotorDrive,
    winding: DqWinding,
    torque_n_m: float,
    times_s: np.ndarray,
    spun_rad_s: float | None = None,
) -> np.ndarray:
    """i_d, i_q, speed and torque at `times_s`, shape (4, n), from no current; at a held speed where given."""
    flux = drive.torque_constant_n_m_a / (1.5 * drive.pole_pairs)
    pars = SynchronousMachinePars(
        n_p=drive.pole_pairs,
        R_s=drive.resistance_ohm,
        L_d=winding.d_inductance_h,
        L_q=winding.q_inductance_h,
        psi_f=flux,
    )
    shaft = (
        StiffMechanicalSystem(J=drive.inertia_kg_m2, B_L=drive.viscous_n_m_s)
        if spun_rad_s is None
        else ExternalRotorSpeed(w_M=lambda t: spun_rad_s)
    )
    system = Drive(VoltageSourceConverter(u_dc=drive.supply_v), SynchronousMachine(pars), shaft)
    # Last of the shaft's outputs first: the loop looks at the speed.
    loop = CurrentLoop(drive, winding, system, torque_n_m)
    system.subsystems = [shaft, loop, system.converter, system.machine]
    solution = solve_ivp(
        system.rhs,
        (0.0, times_s[-1]),
        np.array(system.get_initial_values(), dtype=complex),
        method="DOP853",
        t_eval=times_s,
        rtol=1e-12,
        atol=1e-13,
        max_step=2e-5,
    )
    rows = []
    for t_s, state in zip(solution.t, solution.y.T, strict=True):
        system.set_states(list(state))
        system.set_outputs(t_s)
        current = system.machine.i_s
        rows.append([current.real, current.imag, np.real(shaft.out.w_M), np.real(system.machine.tau_M)])
    return np.array(rows).T
