"""Step 4, below the impacts: spring, crank radius and zero, and friction, from a slow sweep of the speed.

The firmware drives from here on, with lowered limits and without the load that it would expect of a module
that is not known yet. The speeds stay below 0.6 of the lowest natural frequency of a module that is within
`SPRING_SPREAD` of its data sheet, where the striker does not reach the stop.
"""

import math
from collections.abc import Mapping

import numpy as np

from hil.scenario.commands import Command, Request
from tools.bring_up.at_rest import find_exchanged
from tools.bring_up.module_fit import STUCK, fit_module, largest_in, natural_rad_s, reachable_ratio
from tools.bring_up.operated import Operated, operate
from tools.bring_up.step import Context, Curve, Findings, Largest, Step, StepFailedError
from tools.tuning.identification.identify import Identified
from tools.tuning.recordings.readings import Readings

SPRING_SPREAD = 0.4
"""Largest deviation of the spring from the data sheet's, as a share."""
HIGHEST_RATIO = 0.6
SHARES = (0.6, 0.8, 1.0)
"""The speeds of the sweep, as shares of the highest."""
HOLD_S, RAMP_S = 5.0, 6.0
FORCE_SHARE = 0.25
"""Share of the module's force limit that the steps with unknown parameters may use."""
TORQUE_N_M = 0.4
"""A quarter of it is what the firmware lets a load be: a heavy striker on a dry guide needs 0.07 N m."""
MARGIN_RAD_S = 4.0
"""Speed above the target by which a crank may run ahead of a control without a known load."""
UNKNOWN_MODULE = {
    "speed.load_share": 0.0,
    "limit.position_std_m": 0.2,
    "limit.estimate_s": 3.0,
    "limit.stretch_m": 0.5,
    "start.capture_ratio": 10.0,
}
"""Parameters of the firmware for a module that is not known: no load fed forward, no impacts required."""
SHOWN_S = 2.0


def highest_ratio() -> float:
    """The highest ratio to the data sheet's natural frequency."""
    return HIGHEST_RATIO * math.sqrt(1.0 - SPRING_SPREAD)


def bound(context: Context) -> Largest:
    """The bounds: no impact, and a speed not far above the sweep's."""
    speed_rad_s = highest_ratio() * natural_rad_s(context.values)
    return Largest(torque_n_m=TORQUE_N_M, speed_rad_s=speed_rad_s + MARGIN_RAD_S)


def within(values: Mapping[str, float], largest: Largest, force_n: float) -> dict[str, float]:
    """The parameters with limits that keep a motion within `largest`, and this limit of the force.

    The drive's own limit of the speed stays: far below it the drive already takes torque away, which the load
    of impacts needs.
    """
    speeds_rad_s = {
        "limit.speed_rad_s": 0.9 * largest.speed_rad_s,
        "limit.overspeed_rad_s": largest.speed_rad_s,
    }
    limits = {"speed.torque_limit_n_m": largest.torque_n_m, "limit.force_n": force_n, **speeds_rad_s}
    lowered = {**values, **{name: min(limit, values[name]) for name, limit in limits.items()}}
    ratio = min(lowered["start.highest_ratio"], reachable_ratio(lowered))
    return lowered | {"start.highest_ratio": ratio}


def cautious(context: Context, largest: Largest, force_n: float) -> dict[str, float]:
    """All parameters for a motion of a module that is not known, within `largest`."""
    return within(context.values | UNKNOWN_MODULE, largest, force_n)


def sweep(context: Context, found: Findings) -> None:
    """Sweep the speed, and fit the striker's motion."""
    highest = highest_ratio()
    commands = [
        Command(number * (HOLD_S + RAMP_S), Request.RUN, round(share * highest, 4))
        for number, share in enumerate(SHARES)
    ]
    played = Operated(commands, len(SHARES) * (HOLD_S + RAMP_S))
    largest = bound(context)
    log = context.log("below-impacts")
    force_n = FORCE_SHARE * context.values["limit.force_n"]
    drive_rad_s = min(largest.speed_rad_s, context.values["limit.drive_speed_rad_s"])
    values = cautious(context, largest, force_n) | {"limit.drive_speed_rad_s": drive_rad_s}
    operate(context, played, log, values)
    found.notes += played.notes
    found.largest = largest_in(log, 0.0)
    find_exchanged(context, found, log)
    wired = context.values | {name: one.value for name, one in found.parameters.items()}
    new, identified, readings = fit_module([log], wired, is_slow=True)
    note_motion(identified, readings, found)
    if float(np.max(np.abs(identified.fit.motion[:, 1]))) < 0.02:
        raise StepFailedError(STUCK)
    found.parameters |= new
    found.notes.append(
        "mass and rest length are the data sheet's: no sensor shows them. Spring, viscous friction, impulses "
        "and forces are proportional to the mass, and the stop's position is counted from the rest length"
    )
    ratio = math.sqrt(new["striker.spring_n_m"].value / context.values["striker.mass_kg"])
    found.add("natural frequency", ratio / (2.0 * math.pi), "Hz")


def note_motion(identified: Identified, readings: Readings, found: Findings) -> None:
    """The picture, and the residual."""
    begin, end = readings.pieces[-1]
    shown = slice(max(begin, end - round(SHOWN_S / readings.period_s)), end)
    t_s = np.arange(len(readings.angle_rad))[shown] * readings.period_s
    found.curves = [Curve("acceleration measured", t_s, readings.acceleration_m_s2[shown])]
    found.axes = ("time in s", "acceleration in m/s²")
    found.add("residual of the fit", identified.fit.residual_m_s2, "m/s^2")
    found.add("largest speed of the striker", float(np.max(np.abs(identified.fit.motion[:, 1]))), "m/s")
    found.notes.append(f"friction law: {identified.law.value}")


BELOW_IMPACTS = Step(
    "below-impacts",
    "It finds spring, crank radius, the encoder's zero and friction from a slow sweep of the crank's speed.",
    "The firmware turns the crank at three speeds for half a minute; the striker swings and does not reach "
    "the stop.",
    40.0,
    bound,
    sweep,
)
