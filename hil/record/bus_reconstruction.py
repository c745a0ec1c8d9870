"""The firmware's trace, reconstructed from its frames on the bus: for logs of a real bench.

Truth and internal signals are never sent on CAN, so there are few columns: the heartbeat's modes and limits,
the estimate, the torque, the reported impacts and the accelerometer. Each holds its last value until the next
frame.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.interface import codec
from firmware_py.interface.generated.records import (
    Accelerometer,
    FirmwareHeartbeat,
    ImpactEvent,
    SetInputTorque,
    StrikerEstimate,
)
from hil.record.candump import Bus, BusLog
from hil.record.frame_tables import valid_frames, values_of
from plant_sim.arrays import FloatArray, IntArray


class Frames(NamedTuple):
    """Frames of one kind: seconds, shape (n,), and their signals, shape (n, signals), by name of `record`."""

    record: type[Any]
    t_s: FloatArray
    signals: FloatArray


HEARTBEAT_PERIOD_S = codec.FIRMWARE_HEARTBEAT.period_s or 0.1
LARGEST_SHARE = 1.5
"""Heartbeats over those that one firmware sends; a firmware that starts anew sends one more."""
FEWEST_HEARTBEATS = 10
LONGEST_BUNDLE = 16
"""Frames of one kind that an adapter stamps with one time at most, in its longest latency period."""
NEVER_SENT = ("state.estimator.p_xx", "state.estimator.p_vv", "wake_latency_us", "work_us")
"""Columns that figures and plots read and that no frame carries."""


def frames_of(bus: Bus, record: type[Any]) -> Frames:
    """All decodable frames of one kind; the others of a log on disk are not kept in memory."""
    one = codec.CODECS[record]
    times, signals = [np.zeros(0)], [np.zeros((0, len(record._fields)))]
    for piece in bus.pieces():
        frames = valid_frames(piece, one)
        times.append(piece.t_s[frames.rows])
        columns = [values_of(signal, frames.words) for signal in one.signals.values()]
        signals.append(np.array(columns, np.float64).reshape(len(columns), len(frames.rows)).T)
    return Frames(record, np.concatenate(times), np.concatenate(signals))


def doubt_two_firmwares(bus: Bus) -> list[str]:
    """A reason not to judge a run on whose bus one firmware cannot have sent all heartbeats; or none."""
    t_s = frames_of(bus, FirmwareHeartbeat).t_s
    lasts_s = float(np.ptp(t_s)) if len(t_s) else 0.0
    expected = round(lasts_s / HEARTBEAT_PERIOD_S) + 1
    if len(t_s) < max(LARGEST_SHARE * expected, FEWEST_HEARTBEATS):
        return []
    return [
        f"{len(t_s)} heartbeats of a firmware within {lasts_s:.1f} s, and one firmware sends {expected}; two "
        "firmwares with the same node number share the bus (give one another bus.own_node), or can.log has "
        "each frame twice"
    ]


def hold_last(frames: Frames, t_s: FloatArray) -> dict[str, FloatArray]:
    """Each signal as last received at each of `t_s`, shape (n,); NaN before the first frame."""
    last = np.searchsorted(frames.t_s, t_s, side="right") - 1
    padded = np.vstack([np.full((1, frames.signals.shape[1]), np.nan), frames.signals])
    return dict(zip(frames.record._fields, padded[last + 1].T, strict=True))


def tick_numbers(t_s: FloatArray, period_s: float) -> IntArray:
    """The tick number of each of `t_s`; ticks are centred on the mean phase of the frames."""
    phase = np.angle(np.mean(np.exp(2j * np.pi * t_s / period_s))) / (2.0 * np.pi)
    numbers: IntArray = np.floor(t_s / period_s - phase + 0.5).astype(np.int64)
    return np.maximum(numbers, 0)


def latest_sent(t_s: FloatArray, period_s: float) -> FloatArray:
    """The latest times at which frames that a node sends once in a period can have been sent, shape (n,).

    Frames that follow each other faster were late: all but the last frame of an adapter's bundle have
    waited, and so were sent before the times `t_s` with which it has stamped them.
    """
    padded = np.append(t_s, np.full(LONGEST_BUNDLE, np.inf))
    later = [padded[k : k + len(t_s)] - k * period_s for k in range(LONGEST_BUNDLE)]
    latest: FloatArray = np.min(later, axis=0)
    return latest


def reconstruct_ticks(bus: BusLog, period_s: float) -> dict[str, NDArray[Any]]:
    """The firmware's ticks from its first heartbeat on, one for each period with a frame; empty without one.

    Columns of shape (ticks,) by their names in the firmware's trace; NaN for signals not sent on the bus.
    """
    heartbeat, estimate = frames_of(bus, FirmwareHeartbeat), frames_of(bus, StrikerEstimate)
    torque, impact = frames_of(bus, SetInputTorque), frames_of(bus, ImpactEvent)
    if len(heartbeat.t_s) == 0:
        return {}
    sent_s = latest_sent(torque.t_s, period_s)
    has_waited = torque.t_s - sent_s > 0.5 * period_s
    torque = torque._replace(t_s=np.where(has_waited, sent_s, torque.t_s))
    sent_s = np.concatenate([frames.t_s for frames in (heartbeat, estimate, torque, impact)])
    sent_s = np.unique(sent_s[sent_s >= heartbeat.t_s[0]])
    numbers = tick_numbers(sent_s, period_s)
    # A tick's record has the time of its last frame, so that it includes all of its frames.
    last_of_tick = np.flatnonzero(np.diff(numbers, append=numbers[-1] + 1) > 0)
    tick, t_s = numbers[last_of_tick], sent_s[last_of_tick]
    state, reported = hold_last(estimate, t_s), hold_last(impact, t_s)
    sensed = hold_last(frames_of(bus, Accelerometer), t_s)
    decided = hold_last(heartbeat, t_s)
    touch_down = np.zeros(len(t_s), bool)
    touch_down[np.searchsorted(t_s, impact.t_s[impact.t_s >= t_s[0]])] = True
    states = {name: decided[name].astype(np.int64) for name in ("mode", "acting_limit", "fault", "regime")}
    return {
        "tick": tick,
        "t_s": t_s,
        **{f"outputs.{name}": values for name, values in states.items()},
        "outputs.target_omega_rad_s": decided["target_omega_rad_s"],
        "outputs.torque_n_m": hold_last(torque, t_s)["torque_n_m"],
        "outputs.impact": touch_down,
        "outputs.impact_age_s": reported["age_s"],
        "outputs.impact_speed_m_s": reported["approach_speed_m_s"],
        "outputs.impact_impulse_n_s": reported["impulse_n_s"],
        "state.estimator.x_m": state["position_m"],
        "state.estimator.v_m_s": state["velocity_m_s"],
        "state.crank.omega_rad_s": state["crank_omega_rad_s"],
        "inputs.accelerometer.high_m_s2": sensed["striker_high_m_s2"],
        "inputs.accelerometer.low_m_s2": sensed["striker_low_m_s2"],
        "inputs.accelerometer.housing_m_s2": sensed["housing_m_s2"],
        **dict.fromkeys(NEVER_SENT, np.full(len(t_s), np.nan)),
    }
