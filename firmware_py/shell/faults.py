"""Every fault in one table: what causes it, what the firmware does, and how soon.

The deadline runs from the cause on the bus to torque 0 N m on the bus, with the default parameters; it is a
bound, not what is usual. `python -m firmware_py.shell.faults` prints the table that docs/safety.md carries.
"""

from enum import Enum
from typing import NamedTuple

from firmware_py.interface.enums import Fault


class Reaction(Enum):
    """What a fault does."""

    TORQUE_OFF = "torque 0 in the tick that finds it, drive to IDLE, latched"
    GOES_ON = "an event frame; the nearest that can be done goes on; not latched"


class FaultLine(NamedTuple):
    """One fault. `counts` says in which modes."""

    fault: Fault
    cause: str
    counts: str
    reaction: Reaction
    deadline_s: float


MOVING = "in motion"
ALWAYS = "from READY on"

FAULTS: tuple[FaultLine, ...] = (
    FaultLine(
        Fault.SENSOR_TIMEOUT,
        "no valid accelerometer frame, or none but one and the same reading, for watchdog.sensor_s; "
        "where the gait is followed, no valid frame of its sensors for watchdog.gait_s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.ENCODER_TIMEOUT,
        "no valid encoder frame for watchdog.encoder_s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.DRIVE_TIMEOUT,
        "no heartbeat, current, temperature or supply frame for watchdog.drive_s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.5,
    ),
    FaultLine(
        Fault.OPERATOR_TIMEOUT,
        "no operator command for watchdog.operator_s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.5,
    ),
    FaultLine(
        Fault.DRIVE_ERROR,
        "the drive reports an error, leaves closed loop by itself, or neither closes nor opens it in "
        "watchdog.enable_s",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.15,
    ),
    FaultLine(
        Fault.DRIVE_FROZEN,
        "the crank's position stands still for watchdog.frozen_s while the drive reports a speed",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.OVERSPEED,
        "the crank turns faster than limit.overspeed_rad_s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.OVERCURRENT,
        "the motor's current beyond limit.current_a for limit.overcurrent_s",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.OVERTEMPERATURE,
        "inverter or motor outside limit.lowest_degc … limit.inverter_degc, limit.motor_degc",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.15,
    ),
    FaultLine(
        Fault.UNDERVOLTAGE,
        "the supply below limit.lowest_v for limit.voltage_s",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.35,
    ),
    FaultLine(
        Fault.OVERVOLTAGE,
        "the supply above limit.highest_v for limit.voltage_s",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.35,
    ),
    FaultLine(
        Fault.IMPULSE_LIMIT,
        "an impact of more than limit.impulse_n_s",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.ESTIMATE_INVALID,
        "the striker's estimate is no number, lies 10 m away, or spreads over limit.position_std_m, for "
        "limit.estimate_s",
        MOVING,
        Reaction.TORQUE_OFF,
        1.5,
    ),
    FaultLine(
        Fault.START_FAILED,
        "no capture after start.attempts dips, or in 29 s",
        "in SOFT_START",
        Reaction.TORQUE_OFF,
        30.0,
    ),
    FaultLine(
        Fault.ATTRACTOR_LOST,
        "impacts lost in RUN and not recaptured after start.attempts dips, or in 29 s",
        "in RUN",
        Reaction.TORQUE_OFF,
        30.0,
    ),
    FaultLine(
        Fault.STALL,
        "the crank slower than limit.stall_share of its target for limit.stall_s",
        MOVING,
        Reaction.TORQUE_OFF,
        1.5,
    ),
    FaultLine(
        Fault.FORCE_LIMIT,
        "an impact that peaks above limit.force_n on the stop",
        ALWAYS,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.REQUEST_REFUSED,
        "a ratio or an impulse that no setting can meet; the event frame names the refusal",
        "on a RUN request, and in RUN",
        Reaction.GOES_ON,
        30.0,
    ),
    FaultLine(
        Fault.PARAMETERS_DAMAGED,
        "the parameter file fails its checksum, lacks a value or has one out of bounds; only a start with a "
        "good one ends it",
        "from power-up on",
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.RUNAWAY,
        "the crank faster than its target by 5 rad/s for 0.1 s",
        MOVING,
        Reaction.TORQUE_OFF,
        0.3,
    ),
    FaultLine(
        Fault.LOAD_IMPLAUSIBLE,
        "the torque and the striker's load leave a quarter of the greatest torque unexplained in the crank's "
        "acceleration for 20 ms: encoder, drive or load are not what they should be",
        MOVING,
        Reaction.TORQUE_OFF,
        0.1,
    ),
    FaultLine(
        Fault.STOP_FAILED,
        "no standstill 1 s after the time that a stop takes (start.stop_s, or calm.longest_s where the gait "
        "is followed)",
        "in STOPPING",
        Reaction.TORQUE_OFF,
        3.05,
    ),
    FaultLine(
        Fault.STALE_SAMPLES,
        "the sensors' or the encoder's frames come in bundles: three gaps of more than 10 ms, without 10 ms "
        "of samples in between; up to one bundle in 10 ms is ridden through",
        MOVING,
        Reaction.TORQUE_OFF,
        0.1,
    ),
)
"""All faults, in the order of their codes."""


def markdown() -> str:
    """The table as docs/safety.md carries it."""
    lines = ["| code | fault | cause | counts | reaction | deadline |", "|---|---|---|---|---|---|"]
    lines += [
        f"| {line.fault.value} | {line.fault.name} | {line.cause} | {line.counts} | {line.reaction.value} | "
        f"{line.deadline_s:g} s |"
        for line in FAULTS
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    print(markdown())
