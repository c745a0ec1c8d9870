"""The sensor frames on CAN, tick by tick: the accelerometers and the crank's angle, without truth."""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from firmware_py.interface.generated.records import Accelerometer, EncoderEstimates
from hil.record.bus_reconstruction import frames_of, tick_numbers
from hil.record.candump import Bus, StoredBus
from hil.run_files import RunFile
from hil.timing.clock import TICK_S
from plant_sim.arrays import FloatArray
from tools.output import BadInputError

CLIPPED_SHARE = 0.95
QUIET_SHARE = 0.2
"""Share of the low range within which both ranges are compared for the offset of the high one."""
MOST_BYTES = 600_000_000
"""Size of the largest log, an hour of the bench's bus; its sensors' readings take as much memory."""
LONGEST_S = 7200.0
MOST_TICKS_A_FRAME = 100
"""A log with more ticks per frame has wrong times; each tick takes memory."""
MOST_MIXED = 0.1
"""Share of samples in ticks of other samples, above which a log mixes recordings; below, frames are late."""


class Readings(NamedTuple):
    """One row per tick, shape (n,); `pieces` are the ranges (first, last + 1) without missing ticks.

    `acceleration_m_s2` is the low range, or the high one without its offset where the low one clips.
    """

    period_s: float
    acceleration_m_s2: FloatArray
    housing_m_s2: FloatArray
    angle_rad: FloatArray
    pieces: tuple[tuple[int, int], ...]


class Ticks(NamedTuple):
    """The sensors' frames, one row per tick, shape (n,); NaN where a frame is missing."""

    period_s: float
    low_m_s2: FloatArray
    high_m_s2: FloatArray
    housing_m_s2: FloatArray
    position_rev: FloatArray
    velocity_rev_s: FloatArray


def can_log_of(source: Path) -> Path:
    """The CAN log of a run folder, or the log itself."""
    path = source / RunFile.CAN_LOG if source.is_dir() else source
    if not path.exists():
        raise BadInputError(f"{path} is not there; give a run folder or a candump log")
    if not path.is_file():  # a FIFO may block for ever, and a device may have no end
        raise BadInputError(f"{path} is no file; give a run folder or a candump log")
    if path.stat().st_size > MOST_BYTES:
        raise BadInputError(
            f"{path} has {path.stat().st_size / 1e6:.0f} MB; wanted at most {MOST_BYTES / 1e6:.0f} MB, an "
            "hour of the bench's bus, since all readings are fitted together: give a part of the log"
        )
    return path


def read(source: Path, low_full_scale_m_s2: float, period_s: float = TICK_S) -> Readings:
    """The readings of a run folder or of a candump log."""
    return merge_ticks(read_ticks(source, period_s), low_full_scale_m_s2)


def read_ticks(source: Path, period_s: float = TICK_S) -> Ticks:
    """The sensors' frames of a run folder or of a candump log."""
    path = can_log_of(source)
    return ticks_of(StoredBus(path), period_s, str(path))


def ticks_of(bus: Bus, period_s: float, name: str = "the log") -> Ticks:
    """The frames of both sensors on common ticks; BadInputError for a log without them."""
    felt, turned = frames_of(bus, Accelerometer), frames_of(bus, EncoderEstimates)
    if len(felt.t_s) < 2 or len(turned.t_s) < 2:
        raise BadInputError(
            f"{name} has {len(felt.t_s)} frames of the accelerometer and {len(turned.t_s)} of the encoder; "
            "wanted a log of the bench's bus with both"
        )
    of_felt, of_turned = tick_numbers(felt.t_s, period_s), tick_numbers(turned.t_s, period_s)
    first = min(int(of_felt.min()), int(of_turned.min()))
    count = max(int(of_felt.max()), int(of_turned.max())) - first + 1
    frames = len(felt.t_s) + len(turned.t_s)
    if count > MOST_TICKS_A_FRAME * frames:
        raise BadInputError(
            f"{name} has {frames} frames of the sensors in {count * period_s:.0f} s; wanted some in each "
            "tick: leave out those with wrong times"
        )
    if count * period_s > LONGEST_S:
        raise BadInputError(
            f"{name} spans {count * period_s:.0f} s; wanted at most {LONGEST_S:g} s: give a part"
        )
    columns = np.full((5, count), np.nan)
    columns[:3, of_felt - first] = felt.signals[:, :3].T
    columns[3:, of_turned - first] = turned.signals[:, :2].T
    others = np.any(felt.signals[:, :3] != columns[:3, of_felt - first].T, axis=1)
    if np.mean(others) > MOST_MIXED:
        remedy = (
            "give a log of one recording whose clock never falls back"
            if np.any(np.diff(felt.t_s) < 0.0)
            else "the adapter has stamped frames in bundles; set its latency timer to 1 ms, and record anew"
        )
        raise BadInputError(
            f"{name} has two samples of the accelerometer in {np.count_nonzero(others)} ticks, the first at "
            f"{felt.t_s[others][0]:g} s; wanted one: {remedy}"
        )
    return Ticks(period_s, *columns)


def count_rev(position_rev: FloatArray) -> float:
    """The encoder's count in rev, the smallest step between readings; a reading is a count's lower edge."""
    places = np.unique(position_rev[np.isfinite(position_rev)])
    return float(np.min(np.diff(places))) if len(places) > 1 else 0.0


def merge_ticks(ticks: Ticks, low_full_scale_m_s2: float) -> Readings:
    """Merge both ranges and unwrap the angle; a tick without one of the sensors ends a piece."""
    period_s, low, high, housing, position_rev, _ = ticks
    angle = 2.0 * np.pi * (position_rev + 0.5 * count_rev(position_rev))
    quiet = np.abs(low) < QUIET_SHARE * low_full_scale_m_s2
    offset_m_s2 = float(np.median((high - low)[quiet])) if quiet.any() else 0.0
    clipped = np.abs(low) >= CLIPPED_SHARE * low_full_scale_m_s2
    acceleration = np.where(clipped, high - offset_m_s2, low)
    whole = np.isfinite(acceleration) & np.isfinite(angle)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], whole, [False]]).astype(np.int8)))
    pieces = tuple((int(begin), int(end)) for begin, end in zip(edges[::2], edges[1::2], strict=True))
    for begin, end in pieces:
        angle[begin:end] = np.unwrap(angle[begin:end])
    return Readings(period_s, acceleration, housing, angle, pieces)
