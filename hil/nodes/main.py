"""Nodes as processes: join a bus, warm up, start together, run to the end."""

import json
import signal
import sys
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict
from enum import IntEnum
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, cast

from firmware_py.interface.addresses import Addresses, bus_id
from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import Build, is_build
from firmware_py.shell.parameters import addresses_from, config_from, require_proof
from hil.bus import Bus, BusFailedError, is_own_bus, join_in_turns, open_bus
from hil.bus.addressed import addressed
from hil.bus.hub_socket import TurnSocket
from hil.bus.wire import MAX_STANDARD_ID, REMOTE_FLAG
from hil.faults.fault import FAULTS_ACTED, Fault, effects_of, of_a_node
from hil.faults.line import FaultyBus
from hil.faults.processes import ClockFaults, Runner, Turns, in_turns
from hil.nodes.firmware.runner import FirmwareRunner, ParameterMemory, controller_of, warm_firmware
from hil.nodes.operator.node import RECEIVED_IDS, OperatorNode, reported_state
from hil.nodes.runner import Making, Pace, traces_in
from hil.processes.child import READY, Start, read_start, report_to_parent
from hil.record.run_folder import RunFolderError
from hil.record.state_timeline import lower_name
from hil.record.traces.trace import bring_home
from hil.roster import FIRMWARE, Node, again_name, node_named
from hil.run_files import RunFile
from hil.scenario.scenario import load_scenario, refuse_other_periods
from hil.scenario.settings import apply_settings
from hil.timing.clock import NS_PER_S, MonotonicClock
from hil.timing.loop import UNTIMED, FixedRateLoop, run_turns
from hil.timing.realtime import NODE, become_realtime, die_with_parent, leave_realtime

START_DELAY_S = 0.2
"""Time from readiness to the start of a node that runs alone."""
ESTOP_PATIENCE_S = 2.0
"""Longest wait for the confirmation of an E-stop after the operator's script: twenty heartbeats."""
SAY = partial(print, file=sys.stderr)
UNCONFIRMED = (
    "error: no firmware has confirmed the E-stop; cut the drive's supply, then check the bus, the firmware "
    "and the node numbers bus.drive_node and bus.own_node"
)


class NodeProcess(NamedTuple):
    """Settings of a node's process: bus, output folder, seed, start and end.

    `sync`: another process starts the node and sends the start time. `again`: the node replaces a node that
    ended, and continues its trace. `turns`: the socket of the pacemaker that gives the node its turns;
    without it the node's time is strict.
    """

    bus: str
    out_dir: Path | None
    seed: int
    until_s: float | None
    sync: bool = False
    again: bool = False
    turns: Path | None = None

    def run(
        self,
        node: Node,
        make: Callable[[Pace, FaultyBus], Any],
        period_s: float,
        places: Addresses,
        faults: Sequence[Fault],
    ) -> None:
        """Join the bus, start and run the node whose runner `make` returns for pace and bus.

        `faults`: those of this node.
        """
        name, accept = node.name, node.makes.accepted_ids
        start = await_start(self.sync, again=True) if self.again else Start(0)
        if self.out_dir is not None:
            if not self.sync and (self.out_dir / RunFile.VERDICT).exists():
                raise RunFolderError(f"--out: {self.out_dir} holds a run that has ended; name another folder")
            self.out_dir.mkdir(parents=True, exist_ok=True)
        clock_faults = ClockFaults(faults, name, self.seed)
        own_tick = start.first_tick + round(clock_faults.offset_s(start.first_tick * period_s) / period_s)
        pace = Pace(period_s, self.until_s, first_tick=own_tick)
        if self.turns is None:
            joining = joined(self.bus, accept, places)
        else:
            member = again_name(name) if self.again else name
            joining = joined_in_turns(self.bus, self.turns, member, accept, places)
        summary: dict[str, Any] = {}
        try:
            with joining as (node_bus, giver):
                line = FaultyBus(node_bus, name, faults, self.seed, period_s)
                runner = make(pace, line)
                line.restart()
                begin = start if self.again else await_start(self.sync)
                stepped = in_turns(runner, name, faults, period_s, self.seed, start.first_tick)
                loop = loop_of(begin, pace, node.phase)
                try:
                    run_node(giver, stepped, line, loop, begin.first_tick, pace, self)
                finally:
                    if not self.sync:
                        node_bus.send_all(runner.last_frames())
                    leave_realtime()
                    runner.close()
                    acted = {FAULTS_ACTED: effects_of([faults])}
                    summary = {"overruns": loop.overruns, "lost_records": runner.lost_records, **acted}
        finally:
            if summary:  # after the end of the adapter's bridge, which counts frames too
                self.report({**summary, **asdict(node_bus.counters)})
        if self.out_dir is not None and not self.sync:
            bring_home(self.out_dir)

    def report(self, summary: Mapping[str, Any]) -> None:
        """Report the node's counts to the process that started it, or on standard error."""
        if self.sync:
            report_to_parent(json.dumps(summary))
        else:
            print(json.dumps(summary), file=sys.stderr)


def firmware_main(scenario: str | None, settings: Sequence[str], process: NodeProcess, build: str) -> None:
    """`vibrohil firmware`: the controller on a bus, with a scenario's parameters or its defaults.

    On a bus that the bench has not made, no start comes before the test of the drive's watchdog, unless the
    parameters say otherwise.
    """
    faults: list[Fault] = []
    walks = True
    if scenario is None:
        parameters = apply_settings({"firmware": {}}, settings)["firmware"]
    else:
        loaded = load_scenario(scenario, settings)
        parameters, faults = loaded.parameters, of_a_node(loaded.faults)
        walks = loaded.scene.gait is not None
    if not is_own_bus(process.bus):
        parameters = require_proof(parameters)
    period_s = config_from(parameters).tick_s
    refuse_other_periods(period_s)
    if is_build(build):
        warm_firmware(parameters, cast(Build, build))
    controller = controller_of(build)

    def make(pace: Pace, bus: FaultyBus) -> FirmwareRunner:
        memory = ParameterMemory(parameters, faults, process.seed)
        return FirmwareRunner(memory, pace, bus, traces_in(process.out_dir, pace), walks, controller, SAY)

    process.run(node_named(FIRMWARE), make, period_s, addresses_from(parameters), faults)


def node_main(
    name: str, scenario: str, settings: Sequence[str], process: NodeProcess, firmware: str = "compiled"
) -> None:
    """A node of the roster in a scenario, as a process of the bench or by itself (`vibrohil plant`)."""
    if process.sync:
        belong_to_parent()
    node, loaded = node_named(name), load_scenario(scenario, settings)
    refuse_other_periods(loaded.period_s)
    node.makes.warm(loaded, firmware)
    faults = of_a_node(loaded.faults)

    def make(pace: Pace, bus: FaultyBus) -> Any:
        traces = traces_in(process.out_dir, pace)
        return node.makes.make(Making(loaded, process.seed, pace, bus, faults, traces, firmware, SAY))

    process.run(node, make, loaded.period_s, addresses_from(loaded.parameters), faults)


def operator_main(scenario: str, settings: Sequence[str], bus: str) -> bool:
    """`vibrohil operator`: a scenario's script on `bus`; sends an E-stop if it is ended early.

    An E-stop is repeated until the firmware confirms it, for at most `ESTOP_PATIENCE_S` beyond the end.
    Returns whether every E-stop was confirmed. Raises BusFailedError, after an E-stop that may not leave.
    """
    loaded = load_scenario(scenario, settings)
    node = OperatorNode(loaded.commands, loaded.period_s)
    clock = MonotonicClock()
    is_stopped = False
    firmware: tuple[IntEnum, IntEnum] | None = None
    last_tick = loaded.ticks - 1
    patience_ticks = round(ESTOP_PATIENCE_S / loaded.period_s)
    with joined(bus, RECEIVED_IDS, addresses_from(loaded.parameters)) as (node_bus, _):
        t0_ns = clock.now_ns() + round(START_DELAY_S * NS_PER_S)
        loop = FixedRateLoop(clock, t0_ns, round(loaded.period_s * NS_PER_S))

        def stop(*_: object) -> None:
            nonlocal is_stopped
            is_stopped = True

        def say_changes(received: Sequence[Frame]) -> None:
            nonlocal firmware
            for mode, fault in filter(None, map(reported_state, received)):
                if (mode, fault) != firmware:
                    latched = f", latched fault {lower_name(fault)}" if fault else ""
                    SAY(f"the firmware's mode: {lower_name(mode)}{latched}")
                firmware = mode, fault

        def step(tick: int) -> int:
            nonlocal last_tick
            if is_stopped and last_tick > tick:
                node.emergency_stop(tick)
                last_tick = tick
            if tick >= node.due_tick:
                received = node_bus.receive()
                node_bus.send_all(node.publish(tick, received))
                say_changes(received)
            if tick >= last_tick + (patience_ticks if node.estop_is_unconfirmed else 0):
                loop.stop()
            return tick + 1

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        print(f"playing the script for {loaded.duration_s:g} s; Ctrl-C is an E-stop", file=sys.stderr)
        try:
            loop.run(None, step, None)
        except BusFailedError:
            node.emergency_stop(node.due_tick)
            node_bus.send_all(node.publish(node.due_tick))
            print(UNCONFIRMED, file=sys.stderr)
            raise
    if node.estop_is_unconfirmed:
        print(UNCONFIRMED, file=sys.stderr)
    return not node.estop_is_unconfirmed


def belong_to_parent() -> None:
    """Let this process end with its parent, and leave Ctrl-C to the parent."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def on_bus(accept: Collection[int], places: Addresses) -> list[int]:
    """The identifiers of the module at `places` for those of `vibro.dbc`, remote frames with their flag."""
    return [bus_id(places, can_id & MAX_STANDARD_ID) | (can_id & REMOTE_FLAG) for can_id in accept]


@contextmanager
def joined_in_turns(
    address: str, turns: Path, member: str, accept: Collection[int], places: Addresses
) -> Iterator[tuple[Bus, TurnSocket | None]]:
    """Join a run's own bus and its pacemaker."""
    bus, giver = join_in_turns(address, turns, member, on_bus(accept, places))
    with closing(giver), closing(bus):
        yield addressed(bus, places), giver


@contextmanager
def joined(spec: str, accept: Collection[int], places: Addresses) -> Iterator[tuple[Bus, TurnSocket | None]]:
    """Make or find the bus that `spec` names, and join it with the identifiers of the module at `places`.

    Prints on standard error how other programs join the bus.
    """
    with open_bus(spec, on_bus(accept, places)) as (provided, bus):
        if provided.address != spec:
            print(
                f"bus {provided.name} ({provided.reason}); join it with --bus {provided.address}",
                file=sys.stderr,
            )
        yield addressed(bus, places), None


def await_start(sync: bool, again: bool = False) -> Start:
    """Acquire real-time scheduling as far as permitted, report it, and wait for the start time.

    `again`: wait at ordinary priority, since the other nodes' loops are running.
    """
    report = become_realtime(NODE)
    if again:
        leave_realtime()
    if sync or again:
        report_to_parent(f"{READY} {json.dumps(report._asdict())}")
        return read_start()
    return Start(MonotonicClock().now_ns() + round(START_DELAY_S * NS_PER_S))


def loop_of(start: Start, pace: Pace, offset: float) -> FixedRateLoop:
    """The loop of strict time, which begins `offset` periods after the start."""
    period_ns = round(pace.period_s * NS_PER_S)
    return FixedRateLoop(MonotonicClock(), start.t0_ns, period_ns, round(offset * period_ns))


def run_node(
    giver: TurnSocket | None,
    runner: Runner | Turns,
    line: FaultyBus,
    loop: FixedRateLoop,
    first_tick: int,
    pace: Pace,
    process: NodeProcess,
) -> None:
    """Run in the turns of the pacemaker, or in strict time by `loop`, which does not wait for a late node.

    The node ends with its script, by SIGTERM or, if it is alone, by Ctrl-C. Raises BusFailedError in strict
    time.
    """
    if first_tick > 0:
        become_realtime(NODE)
    stop = loop.stop if giver is None else giver.leave
    for number in (signal.SIGTERM,) if process.sync else (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop())

    is_timed = giver is not None or process.out_dir is not None  # without a trace nothing reads the times

    def step(tick: int) -> int:
        if tick == first_tick > 0:
            line.restart()
        line.move_to(tick * pace.period_s)
        runner.step(tick)
        if not is_timed:
            runner.record(tick, UNTIMED)
        return tick + 1

    if giver is not None:
        run_turns(giver, step, runner.record)
        return
    if not process.sync:
        print(f"running at {1.0 / pace.period_s:g} Hz; Ctrl-C ends it", file=sys.stderr)
    line.restart()
    loop.run(pace.ticks, step, runner.record if is_timed else None, first_tick)
