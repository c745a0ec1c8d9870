"""Somebody who walks, as the gait sensors see it: a made-up shank rate, and switches that may fail."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

PERIOD_S = 0.005
SHANK_DEG = (
    (0.0, -18.0), (0.05, -13.0), (0.1, -6.0), (0.2, 3.0), (0.3, 9.0), (0.4, 16.0), (0.5, 28.0), (0.6, 47.0),
    (0.65, 54.0), (0.7, 55.0), (0.75, 48.0), (0.8, 33.0), (0.9, -2.0), (0.95, -15.0), (1.0, -18.0),
)  # fmt: skip
"""The shank's lean over the cycle, its top forward."""
HEEL_DOWN, TOE_DOWN, HEEL_OFF, TOE_OFF = 0.012, 0.15, 0.38, 0.60


class Walk(NamedTuple):
    """One row a frame. `strikes_s` are the true heel strikes, and the end of the last stride."""

    t_s: NDArray[np.float64]
    phase: NDArray[np.float64]
    rate_rad_s: NDArray[np.float64]
    heel: NDArray[np.bool_]
    toe: NDArray[np.bool_]
    strikes_s: NDArray[np.float64]


def rate_shape(phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """d lean/d phase, rad: a smooth curve through the slopes between the landmarks."""
    at, lean = np.array(SHANK_DEG).T
    grid = np.arange(400) / 400.0
    harmonics = np.fft.rfft(np.radians(np.interp(grid, at, lean)))[1:7] / 400.0
    orders = np.arange(1, 7)
    return 2.0 * np.real((2j * math.pi * orders * harmonics) @ np.exp(2j * math.pi * np.outer(orders, phase)))


def strides(
    rng: np.random.Generator, stride_s: float, spread: float, count: int, changes: bool
) -> NDArray[np.float64]:
    """Stride times; with `changes` the cadence goes up or down by 20 % in 5 strides, every 15 strides."""
    means: list[float] = []
    now_s = stride_s
    while len(means) < count:
        if changes and len(means) >= 8 and len(means) % 15 == 0:
            goal = 1.0 / now_s * (1.2 if now_s > stride_s or rng.random() < 0.5 else 1.0 / 1.2)
            means += [1.0 / hz for hz in np.linspace(1.0 / now_s, goal, 6)[1:]]
            now_s = 1.0 / goal
        else:
            means.append(now_s)
    return np.array(means) * (1.0 + spread * rng.standard_normal(len(means)))


def walk(
    rng: np.random.Generator,
    stride_s: float = 1.15,
    spread: float = 0.02,
    count: int = 60,
    changes: bool = False,
    missed: float = 0.0,
    noise_rad_s: float = 0.05,
    timing: float = 0.01,
) -> Walk:
    """`missed`: share of strides in which a switch does not close. `timing`: spread of its edges."""
    times_s = strides(rng, stride_s, spread, count, changes)
    strikes_s = 0.3 + np.concatenate(([0.0], np.cumsum(times_s)))
    t_s = np.arange(strikes_s[0], strikes_s[-1] - 1e-9, PERIOD_S)
    which = np.searchsorted(strikes_s, t_s, side="right") - 1
    phase = (t_s - strikes_s[which]) / times_s[which]
    swing = 1.0 + 0.03 * rng.standard_normal(len(times_s))
    rate_rad_s = rate_shape(phase) / times_s[which] * swing[which]
    edges = np.array([TOE_DOWN, HEEL_OFF, TOE_OFF]) + timing * rng.standard_normal((len(times_s), 3))
    down, off, toe_off = edges[which].T
    no_heel, no_toe = (rng.random(len(times_s)) < missed for _ in range(2))
    return Walk(
        t_s,
        phase,
        rate_rad_s + noise_rad_s * rng.standard_normal(len(t_s)),
        (phase > HEEL_DOWN) & (phase < off) & ~no_heel[which],
        (phase > down) & (phase < toe_off) & ~no_toe[which],
        strikes_s,
    )
