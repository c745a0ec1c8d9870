"""State lanes of the log: which columns of the traces are states, their names and their colours."""

from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from firmware_py.interface.enums import ActingLimit, AxisState, Fault, GaitState, Mode, Regime
from plant_sim.gait_sensors import LegState
from plant_sim.result import Phase

TRUTH, ESTIMATE, TARGET, OTHER, ALARM = 0x4C9BE8FF, 0xF2A33AFF, 0x9A9AA2FF, 0x7BC67EFF, 0xE5484DFF
"""One colour (RGBA) a meaning throughout the log: truth, the firmware's estimate, the request."""
CALM, BUSY, GOOD, WARN = 0x5B6470FF, 0x4C9BE8FF, 0x3FA66BFF, 0xF2A33AFF


class Lane(NamedTuple):
    """One column of a trace as a state lane; states without a colour of their own are alarms."""

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
"""Where somebody walks."""


def lower_name(value: IntEnum) -> str:
    """A state as lanes, events and results print it.

    >>> lower_name(Mode.SOFT_START)
    'soft-start'
    """
    return value.name.lower().replace("_", "-")


def state_name(states: type[IntEnum], value: int) -> str:
    """The name of a value that came off a trace or the bus, which may hold none of the known ones."""
    known = {state.value: lower_name(state) for state in states}
    return known.get(value, f"unknown {value}")
