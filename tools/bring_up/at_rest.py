"""Step 2, at rest: noise, offset and resolution of the sensors, supply and temperatures. It sends nothing."""

import math
from pathlib import Path

import numpy as np

from firmware_py.interface.generated.records import DriveSupply, DriveTemperature
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import StoredBus
from hil.timing.clock import TICK_S
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2
from tools.bring_up.listen import Listener, judge_frames
from tools.bring_up.step import NOTHING, Context, Curve, Findings, Largest, Step, StepFailedError
from tools.tuning.recordings.readings import Ticks, read_ticks
from tools.tuning.result import make_value

REST_S = 3.0
STILL_REV = 0.01
"""Largest range of the crank's angle at rest."""
MOVING_M_S2 = 1.0
"""Standard deviation of a low-range channel at rest, above which the striker moves."""
HIGH_RANGE_M_S2 = 0.3
"""Standard deviation above which a channel is a high range: 5 mg/√Hz over 400 Hz is 1 m/s², a low range's
0.014 m/s²."""
TILT_M_S2 = 0.5
"""Twice the offset of a low range: a larger reading at rest is gravity."""
CHANNELS = ("low_m_s2", "high_m_s2", "housing_m_s2")
NAMES = ("striker's low range", "striker's high range", "housing")
EXCHANGED = "wiring.low_exchanged"
SHAKEN = 1.5
"""A channel that varies this many times more than at rest has felt the striker."""


def find_channels(ticks: Ticks, found: Findings) -> None:
    """Noise and offset of each channel; raises StepFailedError for one that is dead or in a wrong place."""
    spread = {}
    for channel, name in zip(CHANNELS, NAMES, strict=True):
        readings = getattr(ticks, channel)
        spread[channel] = float(np.nanstd(readings))
        found.add(f"noise, {name}", spread[channel], "m/s^2")
        found.add(f"offset, {name}", float(np.nanmean(readings)), "m/s^2")
        if np.nanmax(readings) == np.nanmin(readings):
            raise StepFailedError(f"the {name} repeats one reading: check the accelerometer and its plug")
    noisiest = max(spread, key=lambda channel: spread[channel])
    if noisiest != "high_m_s2" and spread[noisiest] > HIGH_RANGE_M_S2 > spread["high_m_s2"]:
        other = NAMES[CHANNELS.index(noisiest)]
        raise StepFailedError(
            f"the channel of the {other} has the noise of a high range, and that of the high range has not: "
            "the two are exchanged. Exchange their plugs; no parameter can, because the frame of a low range "
            "would clip the impacts"
        )
    if max(spread["low_m_s2"], spread["housing_m_s2"]) > MOVING_M_S2:
        raise StepFailedError("the striker or the housing moves: wait until the module is at rest")


def find_tilt(ticks: Ticks, found: Findings) -> None:
    """The direction of gravity; a housing whose reading contradicts the striker's is the wrong way round."""
    low, housing = float(np.nanmean(ticks.low_m_s2)), float(np.nanmean(ticks.housing_m_s2))
    if min(abs(low), abs(housing)) < TILT_M_S2:
        found.notes.append("the striker's axis is level; the sign of the housing's reading is not visible")
        return
    if low * housing < 0.0:
        raise StepFailedError(
            f"at rest the housing's accelerometer reads {housing:+.2f} m/s^2 and the striker's {low:+.2f}: "
            "one of them is the wrong way round. Turn the housing's; the impacts show the striker's sign"
        )
    tilt_deg = math.degrees(math.asin(np.clip(low / STANDARD_GRAVITY_M_S2, -1.0, 1.0)))
    found.add("tilt of the striker's axis", tilt_deg, "deg")


def rest(context: Context, found: Findings) -> None:
    """Record the module at rest, and judge its sensors."""
    log = context.log("at-rest")
    context.bench.play(player := Listener(), REST_S, log)
    judge_frames([frame for _, frame in player.frames], REST_S, Findings())
    ticks = read_ticks(log)
    angle_rev = np.unwrap(ticks.position_rev[np.isfinite(ticks.position_rev)], period=1.0)
    found.largest = Largest(
        angle_rad=2.0 * math.pi * float(np.ptp(angle_rev)),
        speed_rad_s=2.0 * math.pi * float(np.nanmax(np.abs(ticks.velocity_rev_s))),
    )
    if np.ptp(angle_rev) > STILL_REV:
        raise StepFailedError("the crank turns: wait until the module is at rest")
    find_channels(ticks, found)
    find_tilt(ticks, found)
    found.add("noise of the speed", 2.0 * math.pi * float(np.nanstd(ticks.velocity_rev_s)), "rad/s")
    if not 0.0 <= float(np.nanmin(ticks.position_rev)) <= float(np.nanmax(ticks.position_rev)) < 1.0:
        found.notes.append(
            "the encoder's position is not circular: it loses resolution with every turn; set the drive's "
            "circular_setpoints"
        )
    bus = StoredBus(log)
    voltage_v = float(np.mean(frames_of(bus, DriveSupply).signals[:, 0]))
    degc = np.max(frames_of(bus, DriveTemperature).signals, axis=0)
    found.add("supply", voltage_v, "V")
    found.add("inverter", degc[0], "degC")
    found.add("winding", degc[1], "degC")
    low_v, high_v = context.values["limit.lowest_v"], context.values["limit.highest_v"]
    if not low_v <= voltage_v <= high_v:
        raise StepFailedError(
            f"the supply has {voltage_v:.1f} V, wanted {low_v:g} to {high_v:g} V: check it, or set "
            "limit.lowest_v and limit.highest_v"
        )
    shown = slice(0, round(0.3 / TICK_S))
    t_s = np.arange(len(ticks.low_m_s2))[shown] * TICK_S
    found.curves = [
        Curve(name, t_s, getattr(ticks, one)[shown]) for one, name in zip(CHANNELS, NAMES, strict=True)
    ]
    found.axes = ("time in s", "acceleration in m/s²")


def find_exchanged(context: Context, found: Findings, log: Path) -> None:
    """Find exchanged low ranges in the log of a step with motion; raises StepFailedError without a yes.

    Dry friction may hold the striker in the drive's step, so the sweep below the impacts looks again.
    """
    moving, rest = read_ticks(log), read_ticks(context.last_log("at-rest"))
    low, housing = (
        float(np.nanstd(getattr(moving, one)) / np.nanstd(getattr(rest, one)))
        for one in ("low_m_s2", "housing_m_s2")
    )
    found.add("striker's low range, motion over noise", low, "1")
    found.add("housing, motion over noise", housing, "1")
    if context.values[EXCHANGED] == 1.0 or housing < SHAKEN or low > SHAKEN:
        return
    if not context.asks(
        "The housing's channel feels the striker, and the striker's low range does not: the two are "
        f"exchanged. Set {EXCHANGED} = 1?"
    ):
        raise StepFailedError("the striker's low range and the housing are exchanged; exchange their plugs")
    found.parameters[EXCHANGED] = make_value(EXCHANGED, 1.0)


AT_REST = Step("at-rest", "It sends nothing and reads the sensors at rest.", "", 3.0, lambda _: NOTHING, rest)
