"""State timelines of the log: the traces' state columns, the names of the states and their colours.

The colours are those of Okabe and Ito, "Color Universal Design", 2008, which people with a colour vision
deficiency can distinguish. A normal state never has the colour of an alarm.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from firmware_py.interface.enums import ActingLimit, AxisState, Fault, GaitState, Mode, Regime
from plant_sim.result import LegState, Phase

TRUTH, ESTIMATE, TARGET, OTHER, ALARM = 0x56B4E9FF, 0xE69F00FF, 0x9A9AA2FF, 0xCC79A7FF, 0xD55E00FF
"""Colours (RGBA) by meaning in all plots: truth, the firmware's estimate, target, other signals, alarms."""
NEUTRAL, BUSY, GOOD, WARN = 0x5B6470FF, 0x56B4E9FF, 0x009E73FF, 0xE69F00FF


class StateTimeline(NamedTuple):
    """One column of a trace as a state timeline; states without an entry in `colors` are alarms."""

    entity: str
    column: str
    states: type[IntEnum]
    colors: Mapping[IntEnum, int]


PLANT_TIMELINES = (
    StateTimeline(
        "states/axis",
        "axis_state",
        AxisState,
        {AxisState.UNDEFINED: NEUTRAL, AxisState.IDLE: NEUTRAL, AxisState.CLOSED_LOOP_CONTROL: BUSY},
    ),
    StateTimeline(
        "states/motion", "phase", Phase, {Phase.FLIGHT: NEUTRAL, Phase.STICK: WARN, Phase.REST_ON_STOP: WARN}
    ),
)

FIRMWARE_TIMELINES = (
    StateTimeline(
        "states/mode",
        "outputs.mode",
        Mode,
        {Mode.INIT: NEUTRAL, Mode.READY: NEUTRAL, Mode.SOFT_START: WARN, Mode.RUN: GOOD, Mode.STOPPING: BUSY},
    ),
    StateTimeline(
        "states/regime",
        "outputs.regime",
        Regime,
        {Regime.UNCERTAIN: NEUTRAL, Regime.NON_IMPACT: BUSY, Regime.IMPACT: GOOD, Regime.PERIOD_N: WARN},
    ),
    StateTimeline(
        "states/limit",
        "outputs.acting_limit",
        ActingLimit,
        {
            ActingLimit.NONE: NEUTRAL,
            ActingLimit.TORQUE: WARN,
            ActingLimit.TORQUE_RATE: WARN,
            ActingLimit.SPEED: WARN,
            ActingLimit.SAFE_STATE: BUSY,
            ActingLimit.IMPACT_PHASE: WARN,
            ActingLimit.RETREAT: WARN,
        },
    ),
    StateTimeline("states/fault", "outputs.fault", Fault, {Fault.NONE: NEUTRAL}),
)

LEG_TIMELINE = StateTimeline(
    "states/leg",
    "gait.state",
    LegState,
    {LegState.STANDING: NEUTRAL, LegState.STANCE: BUSY, LegState.SWING: GOOD},
)
LEG_ESTIMATED_TIMELINE = StateTimeline(
    "states/leg_estimated",
    "state.gait.doing",
    GaitState,
    {GaitState.STANDING: NEUTRAL, GaitState.STANCE: BUSY, GaitState.SWING: GOOD, GaitState.UNCERTAIN: WARN},
)
"""The state timelines of runs with a walk."""


def lower_name(value: IntEnum) -> str:
    """Name of a state in timelines, events and results.

    >>> lower_name(Mode.SOFT_START)
    'soft-start'
    """
    return value.name.lower().replace("_", "-")


def state_name(states: type[IntEnum], value: int) -> str:
    """Name of a state value from a trace or the bus, which may be unknown."""
    known = {state.value: lower_name(state) for state in states}
    return known.get(value, f"unknown {value}")
