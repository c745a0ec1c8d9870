"""The sensors' low-pass filters between two readings, driven exactly by the solver's polynomials.

An accelerometer has a second-order Butterworth filter, ω²/(s² + √2 ω s + ω²): one complex state z' = λ z + a
with λ = ω (−1 + j)/√2 and reading 2 Re(r z), r = −j ω/√2. The encoder's speed estimate is of first order.

At a rigid stop the velocity jumps by (1 + k) v⁻. The input of an accelerometer is then a half-sine of that
area over the contact time T: −(π/2T)(1 + k) v⁻ sin(π τ/T).

On a tilted or moving housing an accelerometer reads x'' + a_b, one on the housing a_b alone. The filters are
linear: the response to a_b, a polynomial over the step, is added to that of the motion.
"""

import cmath
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import FloatArray, IntArray
from plant_sim.jets import ROW
from plant_sim.kernels import subroutine
from plant_sim.parts.drive import constant_speed_rad_s, is_motor
from plant_sim.parts.housing import Housing, housing_m_s2, is_level, steady_m_s2
from plant_sim.parts.parts import Parts
from plant_sim.solvers.adaptive.event_location import Segment
from plant_sim.solvers.adaptive.state_layout import Run
from plant_sim.solvers.bernstein import DEGREE, NODES, ORDER, interpolate
from plant_sim.tables.sensor_tables import AccelerometerTable, SensorsTable

Complex = NDArray[np.complex128]

LOW, HIGH, SPEED_ESTIMATE, HOUSING = range(4)
"""Filters: the striker's two accelerometers, the encoder's speed, and the housing's if a_b ≠ 0."""

CRANK_SPEED, STRIKER_VELOCITY, SHAKEN = range(3)
"""Rows of Sensing.inputs."""

PULSES = 32
"""Most half-sines at once; during chatter, further small ones are added to the last."""

AGE, JUMP = range(2)
"""Columns of Sensing.pulses: time since the impact, s, and change of velocity, m/s; 0 in an unused row."""


class Sensing(NamedTuple):
    """Poles λ and states z of the filters, shape (3,), and `active[0]` half-sines, shape (PULSES, 2).

    `moments`: each filter's decay and moments of 1, s, s² … over a step of `step_s`, shape (3, ORDER + 2).
    `inputs`: power coefficients over a step of crank speed, striker velocity and a_b, shape (3, ORDER + 1).
    A tilted or moving housing has a fourth filter.
    `readings` are the outputs of the filters: accelerations, m/s², and the speed, rad/s; 0 without a filter.
    A module without sensors has no filters.
    """

    poles: Complex
    states: Complex
    moments: Complex
    step_s: FloatArray
    inputs: FloatArray
    pulses: FloatArray
    active: IntArray
    pulse_s: float
    readings: FloatArray


def allocate_filters(filters: int, pulse_s: float) -> Sensing:
    """This number of filters, with impacts at a rigid stop read as half-sines of `pulse_s`."""
    return Sensing(
        poles=np.zeros(filters, np.complex128),
        states=np.zeros(filters, np.complex128),
        moments=np.zeros((filters, ORDER + 2), dtype=np.complex128),
        step_s=np.zeros(1),
        inputs=np.zeros((3, ORDER + 1)),
        pulses=np.zeros((PULSES, 2)),
        active=np.zeros(1, np.int64),
        pulse_s=float(pulse_s),
        readings=np.zeros(HOUSING + 1),
    )


NO_SENSING = allocate_filters(0, 0.0)
"""The filters of a module without sensors: none."""


def allocate_sensing(sensors: SensorsTable, crank_speed_rad_s: float, housing: Housing) -> Sensing:
    """Filters in steady state for a striker at rest, the constant part of a_b and a steady crank."""
    sensing = allocate_filters(HOUSING if is_level(housing) else HOUSING + 1, sensors.rigid_contact_s)
    settle_filters(sensing, sensors, crank_speed_rad_s, housing)
    return sensing


@subroutine
def settle_filters(
    sensing: Sensing, sensors: SensorsTable, crank_speed_rad_s: float, housing: Housing
) -> None:
    """Set the filters' poles, and their states to the steady ones of `allocate_sensing`."""
    poles, states = sensing.poles, sensing.states
    poles[LOW], poles[HIGH] = pole(sensors.striker_low), pole(sensors.striker_high)
    poles[SPEED_ESTIMATE] = complex(-sensors.encoder.bandwidth_rad_s, 0.0)
    states[SPEED_ESTIMATE] = complex(crank_speed_rad_s, 0.0)
    if not is_level(housing):
        poles[HOUSING] = pole(sensors.housing)
        along_m_s2 = steady_m_s2(housing)
        for which in (LOW, HIGH, HOUSING):
            states[which] = -along_m_s2 / poles[which]  # where z' = λ z + a stays
    update_readings(sensing)


@subroutine
def pole(table: AccelerometerTable) -> complex:
    """λ of an accelerometer's filter."""
    return 2.0 * math.pi * table.bandwidth_hz * complex(-1.0, 1.0) / math.sqrt(2.0)


@subroutine(inline=True)
def is_sensing(probe: Sensing) -> bool:
    """Whether there are sensors, which need the motion within steps."""
    return probe.poles.size > 0


@subroutine(inline=True)
def update_readings(probe: Sensing) -> None:
    """Read the filters: an accelerometer's output is 2 Re(r z) with r = −j ω/√2 = −j Im λ."""
    if not is_sensing(probe):
        return
    poles, states, readings = probe.poles, probe.states, probe.readings
    for which in range(poles.size):
        readings[which] = 2.0 * poles[which].imag * states[which].imag
    readings[SPEED_ESTIMATE] = states[SPEED_ESTIMATE].real


@subroutine
def sense_jump(probe: Sensing, jump_m_s: float) -> None:
    """Start a half-sine for a loss of velocity by `jump_m_s` at a rigid stop, or add it to the last one.

    numpy's argmin would load numba's linear algebra, and scipy's with it, into every process with a plant.
    """
    if not is_sensing(probe):
        return
    pulses, last = probe.pulses, 0
    for i in range(PULSES if jump_m_s != 0.0 else 0):
        if pulses[i, JUMP] == 0.0:
            pulses[i, AGE] = 0.0
            pulses[i, JUMP] = jump_m_s
            probe.active[0] += 1
            return
        if pulses[i, AGE] < pulses[last, AGE]:
            last = i
    pulses[last, JUMP] += jump_m_s


@subroutine(inline=True)
def sense(run: Run, segment: Segment, used_s: float) -> None:
    """Drive the filters over the first `used_s` of a step."""
    probe, parts, series, dense = run.probe, run.parts, run.memory[0].series, segment.dense
    if not is_sensing(probe) or used_s == 0.0:
        return
    inputs, share, degree = probe.inputs, used_s / segment.h_s, DEGREE
    if segment.is_series:
        degree = segment.order
        _scaled(series.crank_rad_s, used_s, inputs[CRANK_SPEED], degree)
        _scaled(series.v_m_s, used_s, inputs[STRIKER_VELOCITY], degree)
        if not is_level(parts.housing):
            _scaled(series.housing_m_s2, used_s, inputs[SHAKEN], degree)
    else:
        to_power(dense[ROW.crank_rad_s], share, inputs[CRANK_SPEED])
        to_power(dense[ROW.v_m_s], share, inputs[STRIKER_VELOCITY])
        if not is_level(parts.housing):
            _interpolate_housing(run, used_s, segment.flow.time_s)
    _drive_filters(probe, parts, used_s, degree)


@subroutine
def _drive_filters(probe: Sensing, parts: Parts, used_s: float, degree: int) -> None:
    """Drive the filters over `used_s` by the polynomials of this degree in `probe.inputs`."""
    inputs, moments, states = probe.inputs, probe.moments, probe.states
    _update_moments(probe, used_s)
    speed, velocity = inputs[CRANK_SPEED], inputs[STRIKER_VELOCITY]
    if not is_motor(parts.drive):
        speed[:] = 0.0
        speed[0] = constant_speed_rad_s(parts.drive)
    for j in range(degree + 1):
        speed[j] *= -probe.poles[SPEED_ESTIMATE].real
    states[SPEED_ESTIMATE] = _driven(moments[SPEED_ESTIMATE], states[SPEED_ESTIMATE], speed, degree)
    for j in range(degree):  # a = v'
        velocity[j] = (j + 1) * velocity[j + 1] / used_s
    for which in (LOW, HIGH):
        states[which] = _driven(moments[which], states[which], velocity, degree - 1)
    for i in range(PULSES if probe.active[0] > 0 else 0):
        if probe.pulses[i, JUMP] != 0.0:
            _sense_pulse(probe, probe.pulses[i], used_s)
    if not is_level(parts.housing):
        for which in (LOW, HIGH):
            states[which] += _driven(moments[which], 0.0j, inputs[SHAKEN], degree)
        states[HOUSING] = _driven(moments[HOUSING], states[HOUSING], inputs[SHAKEN], degree)


@subroutine
def _interpolate_housing(run: Run, used_s: float, begin_s: float) -> None:
    """Power coefficients of a_b over a step."""
    scratch = run.memory[0].scratch
    values, through = scratch.poly, scratch.press[: DEGREE + 1]
    for i in range(DEGREE + 1):
        values[i] = housing_m_s2(run.parts.housing, begin_s + NODES[i] * used_s)
    interpolate(values, through)
    to_power(through, 1.0, run.probe.inputs[SHAKEN])


@subroutine
def _scaled(series: FloatArray, used_s: float, power: FloatArray, order: int) -> None:
    """Power coefficients in t/used of Taylor coefficients in t."""
    scale = 1.0
    for k in range(order + 1):
        power[k] = series[k] * scale
        scale *= used_s


@subroutine
def to_power(b: FloatArray, share: float, power: FloatArray) -> None:
    """Coefficients in s/share of p: c_j = shareʲ C(n, j) Δʲb_0, with Δ the forward difference."""
    for i in range(DEGREE + 1):
        power[i] = b[i]
    for j in range(1, DEGREE + 1):
        for i in range(DEGREE, j - 1, -1):
            power[i] -= power[i - 1]
    binomial = 1.0
    for j in range(1, DEGREE + 1):
        binomial *= share * (DEGREE - j + 1) / j
        power[j] *= binomial


@subroutine
def _update_moments(probe: Sensing, h_s: float) -> None:
    """Update the filters' moments if the step's length h has changed; most steps have equal length."""
    if probe.step_s[0] == h_s:
        return
    for which in range(probe.poles.size):
        _moments(probe.poles[which], h_s, probe.moments[which])
    probe.step_s[0] = h_s


@subroutine
def _moments(pole: complex, h_s: float, row: Complex) -> None:
    """e^(λh), and I_j = ∫ e^(λ(h−t)) (t/h)ʲ dt from j = 0 on.

    By parts λh I_j + h = j I_(j−1): downward recursion damps a wrong start value by (λh)ᵐ/m!, upward
    recursion is stable for large λh.
    """
    x = pole * h_s
    row[0] = cmath.exp(x)
    moment = 0.0j
    if abs(x) < 20.0:
        for j in range(int(30.0 + 4.0 * abs(x)), 0, -1):
            moment = (h_s + x * moment) / j
            if j < row.size:
                row[j] = moment
        return
    row[1] = (row[0] - 1.0) / pole
    for j in range(2, row.size):
        row[j] = ((j - 1) * row[j - 1] - h_s) / x


@subroutine
def _driven(moments: Complex, state: complex, power: FloatArray, degree: int) -> complex:
    """State after h of z' = λ z + u with u = Σ c_j (t/h)ʲ: e^(λh) z + Σ c_j I_j."""
    total: complex = moments[0] * state
    for j in range(degree, -1, -1):
        total += power[j] * moments[1 + j]
    return total


@subroutine
def _sense_pulse(probe: Sensing, pulse: FloatArray, used_s: float) -> None:
    """Drive the accelerometers' filters by one half-sine and advance its age."""
    age, jump, whole = pulse[AGE], pulse[JUMP], probe.pulse_s
    rate = math.pi / whole
    on_s = min(used_s, whole - age)
    for which in (LOW, HIGH):
        pole = probe.poles[which]
        # ∫ e^(λ(on−s)) e^(iβ(age+s)) ds = e^(iβ age) (e^(iβ on) − e^(λ on)) / (iβ − λ), and its conjugate's
        decay = cmath.exp(pole * on_s)
        ahead = cmath.exp(1j * rate * age) * (cmath.exp(1j * rate * on_s) - decay) / (1j * rate - pole)
        behind = cmath.exp(-1j * rate * age) * (cmath.exp(-1j * rate * on_s) - decay) / (-1j * rate - pole)
        response = (ahead - behind) / 2.0j
        probe.states[which] -= 0.5 * rate * jump * response * cmath.exp(pole * (used_s - on_s))
    pulse[AGE] = age + used_s
    if pulse[AGE] >= whole:
        pulse[JUMP] = 0.0
        probe.active[0] -= 1
