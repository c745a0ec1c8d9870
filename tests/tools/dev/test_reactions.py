"""Reaction times by frames: what counts as torque 0, IDLE and its confirmation."""

import math
from typing import Any

import numpy as np

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.interface.generated.records import (
    DriveHeartbeat,
    FirmwareHeartbeat,
    SetAxisState,
    SetInputTorque,
)
from hil.record.candump import BusLog, bus_log
from hil.scenario.scenario import load_scenario
from tools.dev.reactions import Reaction, attributable, cells, find_latched, markdown, reaction, worst

IDLE = SetAxisState(AxisState.IDLE)
OPENED = DriveHeartbeat(0, AxisState.IDLE.value, 0, 0)
CLOSED = DriveHeartbeat(0, AxisState.CLOSED_LOOP_CONTROL.value, 0, 0)
RUN: list[tuple[float, Any]] = [
    (0.90, OPENED),
    (0.90, IDLE),
    (1.00, SetInputTorque(0.0)),  # on its way through 0: the torque comes again
    (1.00, IDLE),
    (1.01, SetInputTorque(0.1)),
    (1.02, SetInputTorque(0.0)),
    (1.02, IDLE),
    (1.03, SetInputTorque(0.0)),
    (1.05, CLOSED),
    (1.15, OPENED),
    (1.25, OPENED),
]


def bus_of(sent: list[tuple[float, Any]]) -> BusLog:
    frames = [codec.encode(record) for _, record in sent]
    times_s = np.array([t_s for t_s, _ in sent])
    return bus_log(times_s, np.array([frame.can_id for frame in frames]), [frame.data for frame in frames])


def reacted(sent: list[tuple[float, Any]]) -> list[float]:
    return [round(time_s, 6) for time_s in reaction(bus_of(sent), 0.95)]


def test_times_count_from_the_fault_to_what_holds_for_good() -> None:
    assert reacted(RUN) == [0.07, 0.07, 0.2]
    assert reacted(RUN[:-2]) == [0.07, 0.07, math.inf]
    assert reacted([*RUN, (1.3, SetInputTorque(0.1))]) == [math.inf] * 3


def test_the_first_latched_fault_counts() -> None:
    def beat(mode: Mode, fault: Fault) -> tuple[float, Any]:
        return (1.0, FirmwareHeartbeat(mode.value, 0, fault.value, 0.0, 0))

    moving = [*RUN, beat(Mode.RUN, Fault.NONE)]
    assert find_latched(bus_of(moving)) is None
    assert find_latched(bus_of([*moving, beat(Mode.E_STOP, Fault.NONE)])) is None
    faults = (Fault.STALL, Fault.OVERSPEED)
    assert find_latched(bus_of([*moving, *(beat(Mode.FAULT, fault) for fault in faults)])) == Fault.STALL


def test_the_table_has_the_worst_of_each_time() -> None:
    reactions = [Reaction(0.001, 0.002, 0.1), Reaction(0.003, 0.001, math.inf)]
    assert worst(reactions) == Reaction(0.003, 0.002, math.inf)
    found = {
        (Fault.OVERSPEED, "too-fast"): reactions,
        (Fault.OVERSPEED, "much-too-fast"): [Reaction(0.002, 0.004, 0.2)],
        (Fault.STALL, "too-slow"): [Reaction(math.inf, math.inf, math.inf)],
    }
    assert cells(found).splitlines()[1:] == [
        "OVERSPEED,much-too-fast,1,2,4,200",
        "OVERSPEED,too-fast,2,3,2,",
        "STALL,too-slow,1,,,",
    ]
    assert markdown(found).splitlines()[2:] == [
        "| OVERSPEED | 2 | 3 | 3 ms | 4 ms | 200 ms, never in 1 |",
        "| STALL | 1 | 1 | never in 1 | never in 1 | never in 1 |",
    ]


def test_a_flood_s_frames_are_nobody_s_reaction() -> None:
    assert attributable(load_scenario("a-jammed-crank-is-let-go-of"))
    assert not attributable(load_scenario("a-flood-of-frames-on-every-identifier-does-no-harm"))
    assert not attributable(load_scenario("operator-lost"))
