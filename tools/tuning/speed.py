"""Design of the crank's speed loop with python-control: gains and stability margins.

The elements of the loop, sampled at the control period T:

- the motor, J θ'' + B θ' = T_motor, with the torque held for one period;
- the delay of the torque: computed from the sensors' state at t_k, it acts from t_{k+1}, one tick later;
- the firmware's tracker (θ, θ', disturbance), which predicts with the acting torque and corrects by the
  encoder;
- PI on the tracker's speed.

Phase and gain margins are those of the loop cut at the motor's torque; the bandwidth is that of the closed
loop. The crank's load and dry friction are fed forward and act as disturbances. Proportional gain:
K_p = J ω_c puts the crossover near ω_c; the corner frequency of the integral is ω_c / `integral_ratio`. Disk
margin: Seiler, Packard & Gahinet, An Introduction to Disk Margins, IEEE Control Systems Magazine 40 (2020) 5,
skew 0.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import control
import numpy as np
from numpy.typing import NDArray

from firmware_py.core.estimation.crank import critically_damped_gains
from firmware_py.shell.parameters import DEFAULTS
from plant_sim.arrays import FloatArray
from tools.output import BadInputError
from tools.tuning.result import Merit, Tuning, make_value

ComplexArray = NDArray[np.complex128]

BANDWIDTH_HZ = 21.7
"""Ten times the crank's frequency at r = 1.45, so that the loop rejects the load's first harmonics."""
PHASE_MARGIN_DEG = 52.45
"""Each further tick of delay on the bus costs 5°; the loop would be stable with ten further ticks."""
LARGEST_PEAK = 2.0
"""Largest sensitivity in the range of a gain: a modulus margin of 0.5, the textbooks' usual minimum."""
INTEGRAL_RATIOS = (2.0, 100.0)
CROSSOVERS_RAD_S = (1.0, 500.0)
POINTS = 2000


class NominalDrive(NamedTuple):
    """The plant of the design: motor with crank, tick and tracker."""

    inertia_kg_m2: float = DEFAULTS["motor.inertia_kg_m2"]
    viscous_n_m_s: float = DEFAULTS["motor.viscous_n_m_s"]
    tick_s: float = DEFAULTS["control.tick_s"]
    tracker_rad_s: float = DEFAULTS["crank.bandwidth_rad_s"]


class LoopResponse(NamedTuple):
    """Responses at `omega_rad_s`, shape (n,): L cut at the motor, target to speed, load torque to speed."""

    omega_rad_s: FloatArray
    loop: ComplexArray
    closed: ComplexArray
    load_rad_s_n_m: ComplexArray


@dataclass(frozen=True)
class SpeedDesign:
    """Gains, rounded to two digits, and the properties of the loop with these gains.

    `bandwidth_rad_s`: frequency at which the closed loop, from target to speed, has fallen by 3 dB. `peak`:
    the largest sensitivity |1/(1 + L)|. `load_stiffness_n_m_s`: the smallest |load torque / speed| at any
    frequency. `disk_margin` α: L may change in gain and phase by any complex factor in the disk of size α.
    """

    gain_p_n_m_s: float
    gain_i_n_m: float
    crossover_rad_s: float
    bandwidth_rad_s: float
    phase_margin_deg: float
    gain_margin_db: float
    peak: float
    load_stiffness_n_m_s: float
    disk_margin: float
    disk_gain_db: float
    disk_phase_deg: float


def gains(nominal: NominalDrive, crossover_rad_s: float, integral_ratio: float) -> tuple[float, float]:
    """K_p = J ω_c, K_i = K_p ω_c / ratio."""
    gain_p = nominal.inertia_kg_m2 * crossover_rad_s
    return gain_p, gain_p * crossover_rad_s / integral_ratio


def respond(
    nominal: NominalDrive, gain_p_n_m_s: float, gain_i_n_m: float, omega_rad_s: FloatArray | None = None
) -> LoopResponse:
    """Frequency responses of the loop; by default from a hundredth of the crossover up to the Nyquist limit.

    At lower frequencies the double integrator has no margins, only rounding errors.
    """
    J, T = nominal.inertia_kg_m2, nominal.tick_s
    if omega_rad_s is None:
        omega_rad_s = np.geomspace(0.01 * gain_p_n_m_s / J, 0.99 * math.pi / T, POINTS)
    loop = _response(speed_loop(nominal, gain_p_n_m_s, gain_i_n_m), omega_rad_s)
    motor = _response(control.ss(*_motor(nominal), [[0.0, 1.0]], [[0.0]], T), omega_rad_s)
    # The tracker has the acting torque and so follows the motor exactly: the target sees K G / (1 + K G).
    tick = np.exp(-1j * omega_rad_s * T)
    pi = gain_p_n_m_s + gain_i_n_m * T * tick / (1.0 - tick)
    forward = pi * motor * tick
    return LoopResponse(omega_rad_s, loop, forward / (1.0 + forward), motor / (1.0 + loop))


def margins(nominal: NominalDrive, gain_p_n_m_s: float, gain_i_n_m: float) -> SpeedDesign:
    """Properties of the loop with these gains."""
    response = respond(nominal, gain_p_n_m_s, gain_i_n_m)
    omega, loop = response.omega_rad_s, response.loop
    gain_margin, phase_margin, _, _, crossover, _ = control.stability_margins(control.frd(loop, omega))
    fallen = np.flatnonzero(np.abs(response.closed) < math.sqrt(0.5))
    sensitivity = 1.0 / (1.0 + loop)
    # α = 1 / max |S − 1/2|; gain may change by (2 + α)/(2 − α), phase by 2 atan(α/2)
    disk = float(1.0 / np.max(np.abs(sensitivity - 0.5)))
    return SpeedDesign(
        gain_p_n_m_s=gain_p_n_m_s,
        gain_i_n_m=gain_i_n_m,
        crossover_rad_s=float(crossover),
        bandwidth_rad_s=float(omega[fallen[0]]) if len(fallen) else math.inf,
        phase_margin_deg=float(phase_margin),
        gain_margin_db=20.0 * math.log10(float(gain_margin)),
        peak=float(np.max(np.abs(sensitivity))),
        load_stiffness_n_m_s=float(np.min(1.0 / np.abs(response.load_rad_s_n_m))),
        disk_margin=disk,
        disk_gain_db=20.0 * math.log10((2.0 + disk) / (2.0 - disk)) if disk < 2.0 else math.inf,
        disk_phase_deg=math.degrees(2.0 * math.atan(0.5 * disk)),
    )


def is_stable(nominal: NominalDrive, gain_p_n_m_s: float, gain_i_n_m: float) -> bool:
    """Whether the closed loop is stable, except for the pole at 1 of the crank's uncontrolled angle."""
    loop = speed_loop(nominal, gain_p_n_m_s, gain_i_n_m)
    poles = np.sort(np.abs(np.linalg.eigvals(loop.A - loop.B @ loop.C)))
    return bool(poles[-2] < 1.0)


def shape(nominal: NominalDrive, bandwidth_hz: float, phase_margin_deg: float) -> tuple[float, float]:
    """Crossover and integral ratio for this bandwidth, with the strongest integral that leaves this margin.

    Bandwidth grows with the crossover and the phase margin with the ratio, so that both are bisected.
    """
    wanted_rad_s = 2.0 * math.pi * bandwidth_hz
    at_wanted = np.array([min(wanted_rad_s, 0.99 * math.pi / nominal.tick_s)])  # the Nyquist limit

    def crossover(ratio: float) -> float:
        def wide(one: float) -> bool:
            closed = respond(nominal, *gains(nominal, one, ratio), at_wanted).closed
            return bool(abs(closed[0]) >= math.sqrt(0.5))

        return _bisect(wide, *CROSSOVERS_RAD_S)

    def margin(ratio: float) -> float:
        return _phase_margin_deg(respond(nominal, *gains(nominal, crossover(ratio), ratio)))

    weakest = INTEGRAL_RATIOS[1]
    reached = margins(nominal, *gains(nominal, crossover(weakest), weakest))
    if abs(reached.bandwidth_rad_s / wanted_rad_s - 1.0) > 0.05:
        raise BadInputError(
            f"--bandwidth-hz {bandwidth_hz:g} cannot be reached with a control period of "
            f"{nominal.tick_s:g} s; the nearest is {reached.bandwidth_rad_s / (2.0 * math.pi):.3g} Hz"
        )
    if reached.phase_margin_deg < phase_margin_deg:
        raise BadInputError(
            f"--phase-margin-deg {phase_margin_deg:g} cannot be reached at --bandwidth-hz {bandwidth_hz:g}: "
            f"almost without integral it is {reached.phase_margin_deg:.3g}; ask for less of either, or raise "
            "--tracker-rad-s"
        )
    ratio = _bisect(lambda one: margin(one) >= phase_margin_deg, *INTEGRAL_RATIOS)
    return crossover(ratio), ratio


def _phase_margin_deg(response: LoopResponse) -> float:
    """180° plus the phase of L where |L| falls through 1; a hundred times as fast as python-control."""
    size = np.log(np.abs(response.loop))
    last = int(np.flatnonzero(size > 0.0)[-1])
    share = size[last] / (size[last] - size[last + 1])
    phases = np.angle(-response.loop[last : last + 2])
    return float(np.degrees((1.0 - share) * phases[0] + share * phases[1]))


def _bisect(holds: Callable[[float], bool], low: float, high: float) -> float:
    """The smallest value in [low, high] from which on a condition holds, to 1 part in 1000."""
    if holds(low):
        return low
    while high > 1.001 * low:
        middle = math.sqrt(low * high)
        if holds(middle):
            high = middle
        else:
            low = middle
    return high


def tune_speed(
    nominal: NominalDrive = NominalDrive(),  # noqa: B008 - a tuple of numbers
    bandwidth_hz: float = BANDWIDTH_HZ,
    phase_margin_deg: float = PHASE_MARGIN_DEG,
) -> tuple[Tuning, SpeedDesign]:
    """Gains for a bandwidth and a phase margin, the range of each gain alone, and the loop's properties."""
    gain_p, gain_i = (
        float(f"{gain:.2g}")  # two significant digits are enough for a gain
        for gain in gains(nominal, *shape(nominal, bandwidth_hz, phase_margin_deg))
    )
    design = margins(nominal, gain_p, gain_i)

    def sound(factor_p: float, factor_i: float) -> bool:
        moved = gain_p * factor_p, gain_i * factor_i
        peak = np.max(np.abs(1.0 / (1.0 + respond(nominal, *moved).loop)))
        return is_stable(nominal, *moved) and bool(peak <= LARGEST_PEAK)

    p_low = 1.0 / _bisect(lambda one: not sound(1.0 / one, 1.0), 1.0, 100.0)
    p_high = _bisect(lambda one: not sound(one, 1.0), 1.0, 100.0)
    i_high = _bisect(lambda one: not sound(1.0, one), 1.0, 100.0)
    return Tuning(
        command="speed",
        source=(
            f"design: J = {nominal.inertia_kg_m2:g} kg m², B = {nominal.viscous_n_m_s:g} N m s, tick "
            f"{nominal.tick_s:g} s, asked for {bandwidth_hz:g} Hz and {phase_margin_deg:g}°"
        ),
        seed=None,
        range_is=f"each gain alone, the loop's sensitivity within {LARGEST_PEAK:g}",
        parameters={
            "speed.gain_p_n_m_s": make_value("speed.gain_p_n_m_s", gain_p, p_low * gain_p, p_high * gain_p),
            "speed.gain_i_n_m": make_value("speed.gain_i_n_m", gain_i, 0.0, i_high * gain_i),
            **{
                name: make_value(name, value)
                for name, value in (
                    ("crank.bandwidth_rad_s", nominal.tracker_rad_s),
                    ("motor.inertia_kg_m2", nominal.inertia_kg_m2),
                )
            },
        },
        figures_of_merit=merits(design),
    ), design


def merits(design: SpeedDesign) -> dict[str, Merit]:
    """The properties of the loop as figures of merit."""
    return {
        "bandwidth": Merit(design.bandwidth_rad_s / (2.0 * math.pi), "Hz"),
        "crossover": Merit(design.crossover_rad_s, "rad/s"),
        "phase_margin": Merit(design.phase_margin_deg, "deg"),
        "gain_margin": Merit(design.gain_margin_db, "dB"),
        "largest_sensitivity": Merit(design.peak, "1"),
        "disk_margin": Merit(design.disk_margin, "1"),
        "disk_gain_margin": Merit(design.disk_gain_db, "dB"),
        "disk_phase_margin": Merit(design.disk_phase_deg, "deg"),
        "load_stiffness": Merit(
            design.load_stiffness_n_m_s,
            "N m s",
            "least load torque, at any frequency, that changes the speed by 1 rad/s",
        ),
    }


def speed_loop(nominal: NominalDrive, gain_p_n_m_s: float, gain_i_n_m: float) -> control.StateSpace:
    """L(z) = −(torque commanded) / (torque acting), cut where the torque reaches the motor.

    State at t_k, after the firmware's tick on the sensors of t_k: motor (θ, ω), tracker (θ̂, ω̂, d̂) after
    its correction, integral, the torque just commanded, and the torque of the last tick, which acts from t_k.
    """
    J, B, T, tracker_rad_s = nominal
    g, h, k = critically_damped_gains(tracker_rad_s, T)
    # One tick: the torque u acts from t_k to t_{k+1}; the sensors are read at t_{k+1}.
    a = np.zeros((8, 8))
    b = np.zeros((8, 1))
    a[0:2, 0:2], b[0:2] = _motor(nominal)
    # The tracker predicts with the torque that it assumes: the command of the tick before.
    predicted = np.zeros((3, 8))
    predicted[0, 2:5] = (1.0, T - 0.5 * T * T * B / J, 0.5 * T * T)
    predicted[1, 2:5] = (0.0, 1.0 - T * B / J, T)
    predicted[2, 2:5] = (0.0, 0.0, 1.0)
    predicted[0, 7], predicted[1, 7] = 0.5 * T * T / J, T / J
    error_a, error_b = a[0] - predicted[0], b[0, 0]
    corrections = np.array([g, h / T, 2.0 * k / (T * T)])
    a[2:5] = predicted + np.outer(corrections, error_a)
    b[2:5, 0] = corrections * error_b
    # PI on the tracker's speed against a target of 0.
    a[5] = -gain_i_n_m * T * a[3]
    a[5, 5] += 1.0
    b[5] = -gain_i_n_m * T * b[3]
    # K_p e + the integral of the tick before; e = −ω̂ of this tick.
    a[6] = -gain_p_n_m_s * a[3]
    a[6, 5] += 1.0
    b[6] = -gain_p_n_m_s * b[3]
    # The torque commanded at t_k acts from t_{k+1}.
    a[7, 6] = 1.0
    c = np.zeros((1, 8))
    c[0, 7] = -1.0
    return control.ss(a, b, c, np.zeros((1, 1)), T)


def closed_loops(
    nominal: NominalDrive, gain_p_n_m_s: float, gain_i_n_m: float
) -> tuple[control.StateSpace, control.StateSpace]:
    """Closed loops from target to speed and from crank torque to speed, without limits or feed-forward."""
    T = nominal.tick_s
    loop = speed_loop(nominal, gain_p_n_m_s, gain_i_n_m)
    a = loop.A - loop.B @ loop.C
    target = np.zeros((8, 1))
    # e = ω* − ω̂ enters the integral and the proportional part.
    target[5, 0], target[6, 0] = gain_i_n_m * T, gain_p_n_m_s
    speed = np.zeros((1, 8))
    speed[0, 1] = 1.0
    nothing = np.zeros((1, 1))
    return control.ss(a, target, speed, nothing, T), control.ss(a, loop.B, speed, nothing, T)


def _motor(nominal: NominalDrive) -> tuple[FloatArray, FloatArray]:
    """Exact discretisation of J θ'' + B θ' = T_motor, state (θ, θ'), with the torque held over a tick."""
    J, B, T, _ = nominal
    continuous = control.ss([[0.0, 1.0], [0.0, -B / J]], [[0.0], [1.0 / J]], np.eye(2), np.zeros((2, 1)))
    sampled = control.sample_system(continuous, T, method="zoh")
    return np.asarray(sampled.A), np.asarray(sampled.B)


def _response(system: control.StateSpace, omega_rad_s: FloatArray) -> ComplexArray:
    """C (z − A)⁻¹ B + D, for all frequencies at once."""
    z = np.exp(1j * omega_rad_s * system.dt)
    states = np.linalg.solve(z[:, None, None] * np.eye(len(system.A)) - system.A, system.B[None, :, :])
    return np.asarray((system.C @ states + system.D)[:, 0, 0], np.complex128)
