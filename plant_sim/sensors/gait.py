"""The gait of a walker: its truth, and the readings of an IMU and two switches."""

import math
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray
from plant_sim.kernels import jit, subroutine
from plant_sim.parts.walking import (
    BEGIN_S,
    FROM_HZ,
    FROM_SIZE,
    KNOCK_M_S2,
    KNOCK_S,
    LENGTH_S,
    TO_HZ,
    TO_SIZE,
    TOE_OFF,
    Walking,
    along_axis,
    ankle_n_m_kg,
    cycles_at,
    expand_blend,
    leg_at,
    row_at,
)
from plant_sim.result import LegState
from plant_sim.tables.sensor_tables import GaitSensorsTable

FULL_SHARE = 0.3
"""Share of the full motion from which on the foot is loaded as in walking."""
STANDING_LOAD = 0.5
"""Shares of heel and toe in the leg's load in standing."""


class GaitTruth(NamedTuple):
    """The gait now. `phase` is 0 at heel strike, nan in standing; loads are shares of the leg's largest.
    `tripping` is true while a stumble's knock acts.

    The specific force at the module's place: along the shank upward, across it, along the striker's axis.
    `ankle_n_m_kg` is the calf's moment about the ankle per body mass, positive in push-off, 0 in standing.
    """

    state: LegState
    tripping: bool
    phase: float
    stride_hz: float
    shank_rad: float
    shank_rad_s: float
    up_m_s2: float
    forward_m_s2: float
    axis_m_s2: float
    heel_load: float
    toe_load: float
    ankle_n_m_kg: float


class GaitReading(NamedTuple):
    """One sample of the IMU on the shank and of the switches under the foot, 1 if closed.

    All are nan in a sample that drops out.
    """

    shank_rate_rad_s: float
    along_m_s2: float
    heel_contact: float
    toe_contact: float


@jit
def _truths(walking: Walking, times_s: FloatArray, out: FloatArray) -> None:
    for index in range(times_s.size):
        truth = _truth(walking, times_s[index])
        for column in range(len(truth)):
            out[index, column] = truth[column]


def gaits_at(walking: Walking, times_s: FloatArray) -> FloatArray:
    """The truth at these times, shape (n,), as rows of `GaitTruth`, shape (n, 12)."""
    truths = np.empty((len(times_s), len(GaitTruth._fields)))
    _truths(walking, np.ascontiguousarray(times_s, dtype=np.float64), truths)
    return truths


def gait_at(walking: Walking, t_s: float) -> GaitTruth:
    """The truth at `t_s`."""
    state, tripping, *others = gaits_at(walking, np.array([t_s]))[0].tolist()
    return GaitTruth(LegState(int(state)), bool(tripping), *others)


@subroutine
def _truth(walking: Walking, t_s: float) -> tuple[float, ...]:
    leg = leg_at(walking, t_s)
    row = walking.rows[row_at(walking.rows, t_s)]
    axis_m_s2 = along_axis(walking, leg.up_m_s2, leg.forward_m_s2, leg.outward_m_s2)
    motion = leg.lean_rad, leg.lean_rad_s, leg.up_m_s2, leg.forward_m_s2, axis_m_s2
    full = max(row[FROM_SIZE], row[TO_SIZE])
    if full == 0.0:
        return float(LegState.STANDING.value), 0.0, math.nan, 0.0, *motion, STANDING_LOAD, STANDING_LOAD, 0.0
    phase = cycles_at(row, t_s) % 1.0
    in_curves = phase + walking.warp * math.sin(math.pi * phase) ** 2
    passed = expand_blend(min(t_s - row[BEGIN_S], row[LENGTH_S]), row[LENGTH_S])[0]
    size = row[FROM_SIZE] + (row[TO_SIZE] - row[FROM_SIZE]) * passed
    walks = min(size / (FULL_SHARE * full), 1.0)
    rest = (1.0 - walks) * STANDING_LOAD
    state = LegState.STANCE if in_curves < TOE_OFF else LegState.SWING
    return (
        float(state.value),
        1.0 if row[KNOCK_M_S2] > 0.0 and t_s - row[BEGIN_S] < KNOCK_S else 0.0,
        phase,
        row[FROM_HZ] + (row[TO_HZ] - row[FROM_HZ]) * passed,
        *motion,
        walks * heel_load(in_curves) + rest,
        walks * toe_load(in_curves) + rest,
        size * ankle_n_m_kg(in_curves),
    )


@jit
def _cycles(walking: Walking, times_s: FloatArray, out: FloatArray) -> None:
    for index in range(times_s.size):
        row = walking.rows[row_at(walking.rows, times_s[index])]
        out[index] = cycles_at(row, times_s[index])


def phases_at(walking: Walking, times_s: FloatArray) -> FloatArray:
    """Phase of a walking leg in its cycle, shape (n,) as the times."""
    cycles = np.empty(len(times_s))
    _cycles(walking, np.ascontiguousarray(times_s, dtype=np.float64), cycles)
    return cycles % 1.0


@subroutine
def heel_load(phase: float) -> float:
    """Load of the heel over the cycle: from heel strike on, 0 from heel-off at 42 % on."""
    return _rise(phase, 0.0, 0.06) * (1.0 - _rise(phase, 0.15, 0.42))


@subroutine
def toe_load(phase: float) -> float:
    """Load of the toe over the cycle: from foot-flat on, largest in push-off, 0 from toe-off on."""
    return _rise(phase, 0.08, 0.45) * (1.0 - _rise(phase, 0.5, TOE_OFF))


@subroutine
def _rise(phase: float, begin: float, end: float) -> float:
    s = min(max((phase - begin) / (end - begin), 0.0), 1.0)
    return s * s * (3.0 - 2.0 * s)


THRESHOLD, WAS, CHANGED_S = range(3)
"""A switch: the load above which it closes, its last contact (nan before the first), its last change."""
BEGINS, LASTS, IS_OUT = range(3)
"""Drop-outs: the chances that one begins and that one lasts in a sample, and whether there is one (1)."""


@jit
def _sample(
    dice: np.random.Generator,
    times_s: FloatArray,
    loads: FloatArray,
    switches: FloatArray,
    bounce_s: float,
    drop_outs: FloatArray,
    out: FloatArray,
) -> None:
    """Columns of `out`: noise of rate and force, both contacts under their loads, whether the sample is out.

    A switch bounces after each change.
    """
    for index in range(times_s.size):
        out[index, 0], out[index, 1] = dice.standard_normal(), dice.standard_normal()
        for which in range(2):
            switch = switches[which]
            closed = 1.0 if loads[index, which] > switch[THRESHOLD] else 0.0
            if closed == 1.0 - switch[WAS]:
                switch[CHANGED_S] = times_s[index]
            switch[WAS] = closed
            bounced = 1.0 if dice.random() < 0.5 else 0.0
            out[index, 2 + which] = bounced if times_s[index] - switch[CHANGED_S] < bounce_s else closed
        chance = drop_outs[LASTS] if drop_outs[IS_OUT] != 0.0 else drop_outs[BEGINS]
        out[index, 4] = drop_outs[IS_OUT] = 1.0 if dice.random() < chance else 0.0


class GaitSensors:
    """IMU and switches, read together each `period_s`."""

    def __init__(self, table: GaitSensorsTable, walking: Walking, seed: int, period_s: float) -> None:
        self._table = table
        self._walking = walking
        self._dice = np.random.default_rng((seed, GAIT_STREAM))
        thresholds = table.heel_threshold, table.toe_threshold
        self._switches = np.array([[threshold, math.nan, -math.inf] for threshold in thresholds])
        # Mean number of lost frames over that of received ones between two drop-outs, which is at least 1.
        odds = table.dropout_share / (1.0 - table.dropout_share)
        frames = max(table.dropout_s / period_s, 1.0, odds)
        self._drop_outs = np.array([odds / frames, 1.0 - 1.0 / frames, 0.0])

    def read(self, times_s: FloatArray) -> FloatArray:
        """A sample at each of these times, with new noise, as rows of `GaitReading`."""
        table, truth = self._table, GaitTruth(*gaits_at(self._walking, times_s).T)
        loads, sampled = np.column_stack([truth.heel_load, truth.toe_load]), np.empty((len(times_s), 5))
        _sample(self._dice, times_s, loads, self._switches, table.bounce_s, self._drop_outs, sampled)
        # An IMU that leans forward by τ within the sagittal plane, and is twisted about the shank.
        along_m_s2 = truth.up_m_s2 * math.cos(table.tilt_rad) + truth.forward_m_s2 * math.sin(table.tilt_rad)
        rate_rad_s = truth.shank_rad_s * math.cos(table.twist_rad)
        readings = np.column_stack(
            [
                rate_rad_s + table.rate_bias_rad_s + table.rate_noise_rad_s * sampled[:, 0],
                along_m_s2 + table.along_bias_m_s2 + table.along_noise_m_s2 * sampled[:, 1],
                sampled[:, 2:4],
            ]
        )
        readings[sampled[:, 4] != 0.0] = math.nan
        return readings


GAIT_STREAM = 10
"""Random stream of the gait sensors, separate so that the noise of the others does not depend on them."""
