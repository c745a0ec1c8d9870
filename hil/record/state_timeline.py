"""State timelines of the log: the traces' state columns, the names of the states and their colours.

The colours are those of Okabe and Ito, "Color Universal Design", 2008, which people with a colour vision
deficiency can distinguish. A normal state never has the colour of an alarm.
"""

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from firmware_py.interface.enums import ActingLimit, AxisState, Fault, GaitState, Mode, Regime
from plant_sim.result import Phase
from plant_sim.sensors.gait import LegState

TRUTH, ESTIMATE, TARGET, OTHER, ALARM = 0x56B4E9FF, 0xE69F00FF, 0x9A9AA2FF, 0xCC79A7FF, 0xD55E00FF
"""Colours (RGBA) by meaning in all plots: truth, the firmware's estimate, target, other signals, alarms."""
CALM, BUSY, GOOD, WARN = 0x5B6470FF, 0x56B4E9FF, 0x009E73FF, 0xE69F00FF
PALETTE = (TRUTH, ESTIMATE, TARGET, OTHER, ALARM, GOOD)


class Lane(NamedTuple):
    """One column of a trace as a state timeline; states without an entry in `colors` are alarms."""

    entity: str
    column: str
    states: type[IntEnum]
    colors: Mapping[IntEnum, int]


PLANT_LANES = (
    Lane(
        "states/axis",
        "axis_state",
        AxisState,
        {AxisState.UNDEFINED: CALM, AxisState.IDLE: CALM, AxisState.CLOSED_LOOP_CONTROL: BUSY},
    ),
    Lane(
        "states/motion",
        "phase",
        Phase,
        {Phase.FLIGHT: CALM, Phase.STICK: WARN, Phase.REST_ON_STOP: WARN},
    ),
)

FIRMWARE_LANES = (
    Lane(
        "states/mode",
        "outputs.mode",
        Mode,
        {Mode.INIT: CALM, Mode.READY: CALM, Mode.SOFT_START: WARN, Mode.RUN: GOOD, Mode.STOPPING: BUSY},
    ),
    Lane(
        "states/regime",
        "outputs.regime",
        Regime,
        {Regime.UNCERTAIN: CALM, Regime.NON_IMPACT: BUSY, Regime.IMPACT: GOOD, Regime.PERIOD_N: WARN},
    ),
    Lane(
        "states/limit",
        "outputs.acting_limit",
        ActingLimit,
        {
            ActingLimit.NONE: CALM,
            ActingLimit.TORQUE: WARN,
            ActingLimit.TORQUE_RATE: WARN,
            ActingLimit.SPEED: WARN,
            ActingLimit.SAFE_STATE: BUSY,
            ActingLimit.IMPACT_PHASE: WARN,
            ActingLimit.RETREAT: WARN,
        },
    ),
    Lane("states/fault", "outputs.fault", Fault, {Fault.NONE: CALM}),
)

LEG_LANE = Lane(
    "states/leg",
    "gait.state",
    LegState,
    {LegState.STANDING: CALM, LegState.STANCE: BUSY, LegState.SWING: GOOD},
)
LEG_ESTIMATED_LANE = Lane(
    "states/leg_estimated",
    "state.gait.doing",
    GaitState,
    {
        GaitState.STANDING: CALM,
        GaitState.STANCE: BUSY,
        GaitState.SWING: GOOD,
        GaitState.UNCERTAIN: WARN,
    },
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
