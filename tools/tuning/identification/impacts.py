"""Time, stiffness and restitution of an impact, from the accelerometer's dozen readings during it.

A Hunt–Crossley contact m δ'' = −K δ^1.5 (1 + λ δ') − m g − m f(δ'), where g is the spring's pull away from
the stop and f the friction, is a curve of two parameters if lengths are scaled by v⁻ S and times by S, with
K/m (v⁻ S)^0.5 S² = 1:

    δ'' = −δ^1.5 (1 + d δ') − (g + f) S/v⁻ − κ S² δ,   δ(0) = 0, δ'(0) = 1,   d = λ v⁻ by the restitution k

with κ the stiffness of the spring; without its term k would be 0.001 too large. g grows linearly while the
crank turns on; without that a contact time of 25 ms would be 0.1 ms too small. f is the whole friction law.

Friction changes its sign with the striker's velocity, which is later than the peak of the contact force; a
change at the peak instead would make an error of 0.007 in k on a guide with μ = 0.15.

The curve, filtered by the accelerometer's low-pass (Butterworth, second order), is fitted to the readings;
the unknowns are the time of touch-down, S and k. Because of the spring's pull, k is neither the impulse over
m v⁻ less one nor the ratio of the speeds: for k = 0.5, r = 1.3 they are 0.46 and 0.52.
"""

import functools
import math
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import butter, lfilter

from firmware_py.core.estimation.stop_model import hertz_dissipation
from plant_sim.arrays import FloatArray
from plant_sim.kernels import jit
from tools.tuning.identification.friction_laws import Striker, friction_m_s2

STEP = 0.02
"""Time step of the curve, in S; a contact lasts some 4 S."""
LONGEST = 12.0
GRID_S = 5e-5
"""Time step of the low-pass."""
SPREAD_M_S2, SPREAD_SHARE = 0.2, 0.02
"""Standard error of a fitted reading: of the low range, and a share of the peak for the stop's law."""
REFERENCE_M_S = 0.9
"""Approach speed for which the firmware's `stop.contact_s` is defined."""


class FittedImpact(NamedTuple):
    """`touch_down_s` counts from the first row; `scale_s` is S; `misfit` is the weighted residual's RMS."""

    touch_down_s: float
    scale_s: float
    restitution: float
    misfit: float


class Pull(NamedTuple):
    """The spring's pull away from the stop per unit of mass, and its rate, as the crank turns on."""

    at_first_m_s2: float
    rate_m_s3: float = 0.0


FREE = Striker(0.0, 0.0, 0.0)
"""A striker without spring and friction."""

dissipation = functools.lru_cache(hertz_dissipation)
"""A fit changes one unknown at a time, so that half of its curves have a restitution already used."""


@jit
def integrate(d: float, pull: Pull, striker: Striker) -> tuple[FloatArray, FloatArray]:
    """Forces of contact and spring, and speeds of the striker until it leaves the stop, a row each STEP.

    All are dimensionless, pull, spring and friction too; by Runge–Kutta 4.
    """
    stiffness, _, _, damping, dry, rise, v_s, delta, _ = striker

    def push(depth: float, speed: float) -> float:
        return depth**1.5 * (1.0 + d * speed) if depth > 0.0 else 0.0

    def change(time: float, depth: float, speed: float) -> float:
        more = rise * math.exp(-((abs(speed) / v_s) ** delta)) if rise != 0.0 else 0.0
        friction = damping * speed + math.copysign(dry + more, speed)
        return -push(depth, speed) - stiffness * depth - pull[0] - pull[1] * time - friction

    steps = round(LONGEST / STEP)
    forces, speeds = np.empty(steps + 1), np.empty(steps + 1)
    depth, speed = 0.0, 1.0
    forces[0], speeds[0] = depth, speed
    for k in range(1, steps + 1):
        time = (k - 1) * STEP
        a1 = change(time, depth, speed)
        v2 = speed + 0.5 * STEP * a1
        a2 = change(time + 0.5 * STEP, depth + 0.5 * STEP * speed, v2)
        v3 = speed + 0.5 * STEP * a2
        a3 = change(time + 0.5 * STEP, depth + 0.5 * STEP * v2, v3)
        v4 = speed + STEP * a3
        a4 = change(time + STEP, depth + STEP * v3, v4)
        depth += STEP / 6.0 * (speed + 2.0 * v2 + 2.0 * v3 + v4)
        speed += STEP / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        force = push(depth, speed)
        forces[k], speeds[k] = force + stiffness * depth, speed
        if depth <= 0.0 or force < 0.0:
            forces[k] = stiffness * depth
            return forces[: k + 1], speeds[: k + 1]
    return forces, speeds


@functools.cache
def low_pass(bandwidth_hz: float) -> tuple[FloatArray, FloatArray]:
    """Numerator and denominator of the accelerometer's low-pass, in steps of `GRID_S`."""
    b, a = butter(2, bandwidth_hz, fs=1.0 / GRID_S)
    return b, a


def filter_forces(
    rows_s: FloatArray,
    speed_m_s: float,
    pull: Pull,
    bandwidth_hz: float,
    touch_down_s: float,
    scale_s: float,
    restitution: float,
    striker: Striker = FREE,
) -> FloatArray:
    """The low-pass's output for contact, spring and friction at `rows_s`, in m/s², positive."""
    share = scale_s / speed_m_s
    scaled = striker._replace(
        stiffness_1_s2=striker.stiffness_1_s2 * scale_s**2,
        damping_1_s=striker.damping_1_s * scale_s,
        dry_m_s2=striker.dry_m_s2 * share,
        rise_m_s2=striker.rise_m_s2 * share,
        v_s_m_s=striker.v_s_m_s / speed_m_s,
    )
    at_touch_down_m_s2 = pull.at_first_m_s2 + pull.rate_m_s3 * touch_down_s
    pulls = Pull(at_touch_down_m_s2 * share, pull.rate_m_s3 * scale_s * share)
    pushes, speeds = integrate(dissipation(restitution), pulls, scaled)
    # Before the touch-down, the low-pass has settled on the friction in flight.
    before = float(friction_m_s2(striker, np.array(speed_m_s)))
    count = math.ceil(rows_s[-1] / GRID_S) + 1
    first, step = touch_down_s / GRID_S, scale_s * STEP / GRID_S
    grid, places = np.arange(count), first + step * np.arange(len(pushes))
    v = np.interp(grid, places, speeds) * speed_m_s
    raw = np.interp(grid, places, pushes / share, left=0.0, right=0.0)
    raw += friction_m_s2(striker, v) - before
    filtered = lfilter(*low_pass(bandwidth_hz), raw)
    return np.asarray(np.interp(rows_s, grid * GRID_S, filtered) + before)


def fit_impact(
    rows_s: FloatArray,
    excess_m_s2: FloatArray,
    speed_m_s: float,
    pull: Pull,
    bandwidth_hz: float,
    striker: Striker = FREE,
    near: "FittedImpact | None" = None,
) -> FittedImpact:
    """Fit the readings `excess_m_s2` at `rows_s`, both from the last row before the touch-down on.

    The excess is the deceleration that spring (at the stop) and crank do not explain; it includes friction.
    `near`: a fit to nearly the same readings, from which this fit starts.
    """
    peak = float(np.max(excess_m_s2))
    weight = 1.0 / (SPREAD_M_S2 + SPREAD_SHARE * peak)

    def residual(unknown: FloatArray) -> FloatArray:
        touch_down_s, scale_ms, restitution = unknown
        model = filter_forces(
            rows_s,
            speed_m_s,
            pull,
            bandwidth_hz,
            touch_down_s * 1e-3,
            scale_ms * 1e-3,
            restitution,
            striker,
        )
        return (model - excess_m_s2) * weight

    # The peak lies near 1.3 S, and is 0.9 v/S high.
    start_ms = 900.0 * speed_m_s / peak
    first = (0.5, start_ms, 0.5)
    if near is not None:
        first = (1e3 * near.touch_down_s, 1e3 * near.scale_s, near.restitution)
    bounds = (-2.0, 0.1 * start_ms, 0.02), (5.0, 10.0 * start_ms, 0.999)
    found = least_squares(
        residual,
        np.clip(first, *bounds),
        bounds=bounds,
        diff_step=(1e-3, 1e-3, 1e-3),
        xtol=1e-7,
    )
    touch_down_ms, scale_ms, restitution = (float(value) for value in found.x)
    misfit = float(np.sqrt(np.mean(found.fun**2)))
    return FittedImpact(touch_down_ms * 1e-3, scale_ms * 1e-3, restitution, misfit)


def contact_time_s(scale_s: float, speed_m_s: float) -> float:
    """The elastic contact time in s at the reference speed, as `stop.contact_s` defines it.

    2.9432 δ_max/x'⁻ with δ_max = (5 x'⁻²/(4 K/m))^(2/5) and K/m = (v⁻)^−0.5 S^−2.5.
    """
    stiffness = speed_m_s**-0.5 * scale_s**-2.5
    return 2.9432 * math.pow(1.25 * REFERENCE_M_S**2 / stiffness, 0.4) / REFERENCE_M_S
