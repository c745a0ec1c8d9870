"""The table of faults: the cause and the deadline of each, and whether it is latched.

The deadline is the largest time from the cause on the bus to torque 0 N m on the bus, with the default
parameters. `python -m firmware_py.shell.faults` prints the table of docs/safety.md, which states the reaction
in its text.
"""

from typing import NamedTuple

from firmware_py.interface.enums import Fault


class FaultLine(NamedTuple):
    """One fault; `counts` names the modes in which it counts.

    `is_latched`: it stops the motor; otherwise the nearest possible setting is used.
    """

    fault: Fault
    cause: str
    counts: str
    deadline_s: float
    is_latched: bool = True


MOVING = "in motion"
ALWAYS = "from READY on"

FAULTS: tuple[FaultLine, ...] = (
    FaultLine(
        Fault.SENSOR_TIMEOUT,
        "no valid accelerometer frame, or only repetitions of the same reading, for watchdog.sensor_s; "
        "following the gait: no valid frame of its sensors for watchdog.gait_s",
        MOVING,
        0.1,
    ),
    FaultLine(Fault.ENCODER_TIMEOUT, "no valid encoder frame for watchdog.encoder_s", MOVING, 0.1),
    FaultLine(
        Fault.DRIVE_TIMEOUT,
        "no heartbeat, current, temperature or supply frame for watchdog.drive_s",
        MOVING,
        0.5,
    ),
    FaultLine(Fault.OPERATOR_TIMEOUT, "no operator command for watchdog.operator_s", MOVING, 0.5),
    FaultLine(
        Fault.DRIVE_ERROR,
        "the drive reports an error, leaves closed loop by itself, or neither closes nor opens it in "
        "watchdog.enable_s",
        ALWAYS,
        0.15,
    ),
    FaultLine(
        Fault.DRIVE_FROZEN,
        "the crank's position is constant for watchdog.frozen_s while the drive reports a speed",
        ALWAYS,
        0.1,
    ),
    FaultLine(Fault.OVERSPEED, "the crank turns faster than limit.overspeed_rad_s", MOVING, 0.1),
    FaultLine(
        Fault.OVERCURRENT, "the motor's current is above limit.current_a for limit.overcurrent_s", ALWAYS, 0.1
    ),
    FaultLine(
        Fault.OVERTEMPERATURE,
        "inverter or motor is colder than limit.lowest_degc, or hotter than limit.inverter_degc or "
        "limit.motor_degc",
        ALWAYS,
        0.15,
    ),
    FaultLine(Fault.UNDERVOLTAGE, "the supply is below limit.lowest_v for limit.voltage_s", ALWAYS, 0.35),
    FaultLine(Fault.OVERVOLTAGE, "the supply is above limit.highest_v for limit.voltage_s", ALWAYS, 0.35),
    FaultLine(Fault.IMPULSE_LIMIT, "an impact of more than limit.impulse_n_s", ALWAYS, 0.1),
    FaultLine(
        Fault.ESTIMATE_INVALID,
        "the striker's estimate is NaN, beyond 10 m, or has a deviation above limit.position_std_m, for "
        "limit.estimate_s",
        MOVING,
        1.5,
    ),
    FaultLine(
        Fault.START_FAILED, "no capture after start.attempts dips or within 29 s", "in SOFT_START", 30.0
    ),
    FaultLine(
        Fault.ATTRACTOR_LOST,
        "impacts lost in RUN and not recaptured after start.attempts dips or within 29 s",
        "in RUN",
        30.0,
    ),
    FaultLine(
        Fault.STALL, "the crank is slower than limit.stall_share of its target for limit.stall_s", MOVING, 1.5
    ),
    FaultLine(Fault.FORCE_LIMIT, "an impact with a peak force above limit.force_n on the stop", ALWAYS, 0.1),
    FaultLine(
        Fault.REQUEST_REFUSED,
        "a ratio or an impulse that no setting can meet; the event frame names the refusal",
        "on a RUN request, and in RUN",
        30.0,
        is_latched=False,
    ),
    FaultLine(
        Fault.PARAMETERS_DAMAGED,
        "the parameter file fails its checksum, lacks a value or has a value out of bounds; only a start "
        "with a valid file ends it",
        "from power-up on",
        0.1,
    ),
    FaultLine(Fault.RUNAWAY, "the crank is faster than its target by 5 rad/s for 0.1 s", MOVING, 0.3),
    FaultLine(
        Fault.LOAD_IMPLAUSIBLE,
        "the crank's acceleration differs from torque and striker load by a quarter of the largest torque "
        "for 20 ms: encoder, drive or load is implausible",
        MOVING,
        0.1,
    ),
    FaultLine(
        Fault.STOP_FAILED,
        "no standstill 1 s after the nominal duration of a stop (start.stop_s, or spin_down.longest_s if the "
        "crank follows the gait)",
        "in STOPPING",
        3.05,
    ),
    FaultLine(
        Fault.STALE_SAMPLES,
        "the sensors' or the encoder's frames arrive in bundles: three gaps of more than 10 ms, without "
        "10 ms of samples in between; one bundle in 10 ms is tolerated",
        MOVING,
        0.1,
    ),
)
"""All faults, in the order of their codes."""


def markdown() -> str:
    """The table of docs/safety.md."""
    lines = ["| code | fault | cause | counts | deadline |", "|---|---|---|---|---|"]
    lines += [
        f"| {line.fault.value} | {line.fault.name} | {line.cause} | {line.counts} | {line.deadline_s:g} s |"
        for line in FAULTS
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown())
