"""Firmware and plant as processes: join a bus, warm up, start together, run to the end."""

import json
import signal
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import NamedTuple

from firmware_py.interface import codec
from firmware_py.interface.addresses import Addresses, bus_id
from firmware_py.interface.generated.records import DriveEstop
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.parameters import addresses_from, config_from
from hil.bus import Bus, open_bus
from hil.bus.addressed import addressed
from hil.bus.base import NodeBus
from hil.bus.wire import MAX_STANDARD_ID, REMOTE_FLAG
from hil.faults.clocks import ClockFaults, FaultyClock
from hil.faults.line import with_faults
from hil.faults.processes import FIRMWARE, PLANT
from hil.nodes.plant import ACCEPTED_IDS
from hil.nodes.runners import FirmwareRunner, Pace, PlantRunner, empty
from hil.nodes.warm import warm_firmware, warm_plant
from hil.record.traces.trace import bring_home
from hil.scenario.fault_tables import Fault
from hil.scenario.operator import OPERATOR_PERIOD_S, OperatorNode
from hil.scenario.scenario import load_scenario, refuse_other_periods
from hil.scenario.settings import apply_settings
from hil.timing.clock import NS_PER_S, Clock, MonotonicClock
from hil.timing.loop import FixedRateLoop
from hil.timing.processes import READY, Start, read_start, report_to_parent
from hil.timing.realtime import NODE, become_realtime, die_with_parent, leave_realtime

START_DELAY_S = 0.2
"""Time from readiness to the start of a node that runs alone."""

FIRMWARE_IDS = [frame.can_id for frame in codec.CODECS.values() if frame.sender != "Firmware"]
"""Identifiers that the firmware receives."""


class NodeProcess(NamedTuple):
    """Settings of a node's process: bus, output folder, seed, start and end.

    `sync`: another process starts the node and sends the start time. `again`: the node replaces a node that
    ended, and continues its trace.
    """

    bus: str
    out_dir: Path | None
    seed: int
    sync: bool
    again: bool
    until_s: float | None

    def run(
        self,
        name: str,
        make: Callable[[Pace, NodeBus, int], FirmwareRunner | PlantRunner],
        period_s: float,
        offset: float,
        accept: Collection[int],
        places: Addresses,
        faults: Sequence[Fault],
    ) -> None:
        """Join the bus, start and run the node that `make` returns for pace, bus and first tick.

        `offset`: delay of its ticks in periods. `accept`: the identifiers that it receives.
        """
        pace = Pace(period_s, self.until_s)
        start = await_start(self.sync, again=True) if self.again else Start(0)
        if self.out_dir is not None:
            self.out_dir.mkdir(parents=True, exist_ok=True)
        with joined(self.bus, accept, places) as node_bus:
            faulty_bus, set_time = with_faults(node_bus, name, faults, self.seed)
            runner = make(pace, faulty_bus, start.first_tick)
            clock_faults = ClockFaults(faults, name, self.seed)
            begin = start if self.again else await_start(self.sync)
            run_loop(runner, pace, offset, node_bus, begin, set_time, clock_faults, self.sync)
        if self.out_dir is not None and not self.sync:
            bring_home(self.out_dir)


def firmware_main(scenario: str | None, settings: Sequence[str], process: NodeProcess, build: Build) -> None:
    """`vibrohil firmware`: the controller on a bus, with a scenario's parameters or its defaults."""
    if process.sync:
        belong_to_parent()
    faults: Sequence[Fault] = ()
    walks = True
    if scenario is None:
        parameters = apply_settings({"firmware": {}}, settings)["firmware"]
    else:
        loaded = load_scenario(scenario, settings)
        parameters, faults = loaded.parameters, loaded.faults
        walks = loaded.scene.gait is not None
    period_s = config_from(parameters).tick_s
    refuse_other_periods(period_s)
    warm_firmware(parameters, build)

    def make(pace: Pace, bus: NodeBus, first_tick: int) -> FirmwareRunner:
        out_dir, seed, say = process.out_dir, process.seed, partial(print, file=sys.stderr)
        node = node_of(build)
        return FirmwareRunner(parameters, pace, bus, out_dir, faults, seed, first_tick, walks, node, say)

    process.run(FIRMWARE, make, period_s, 0.5, FIRMWARE_IDS, addresses_from(parameters), faults)


def plant_main(scenario: str, settings: Sequence[str], process: NodeProcess) -> None:
    """`vibrohil plant`: the module of a scenario's scene on a bus, with its drive and its sensors."""
    if process.sync:
        belong_to_parent()
    loaded = load_scenario(scenario, settings)
    places = addresses_from(loaded.parameters)
    refuse_other_periods(loaded.period_s)
    warm_plant(loaded.scene)

    def make(pace: Pace, bus: NodeBus, first_tick: int) -> PlantRunner:
        out_dir, faults = process.out_dir, loaded.faults
        runner = PlantRunner(loaded.scene, process.seed, pace, bus, out_dir, faults, first_tick)
        runner.node.node_id = places.drive_node
        return runner

    process.run(PLANT, make, loaded.period_s, 0.0, ACCEPTED_IDS, places, loaded.faults)


def operator_main(scenario: str, settings: Sequence[str], bus: str) -> None:
    """`vibrohil operator`: a scenario's script on `bus`; sends an E-stop if it is ended early."""
    loaded = load_scenario(scenario, settings)
    node = OperatorNode(loaded.commands, loaded.period_s)
    clock = MonotonicClock()
    stopped = False
    with joined(bus, (), addresses_from(loaded.parameters)) as node_bus:
        t0_ns = clock.now_ns() + round(START_DELAY_S * NS_PER_S)
        loop = FixedRateLoop(clock, t0_ns, round(OPERATOR_PERIOD_S * NS_PER_S))

        def stop(*_: object) -> None:
            nonlocal stopped
            stopped = True
            loop.stop()

        def say(period: int, _: int) -> None:
            node_bus.send_all(node.publish(period))

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, stop)
        print(f"playing the script for {loaded.duration_s:g} s; Ctrl-C is an E-stop", file=sys.stderr)
        loop.run(round(loaded.duration_s / OPERATOR_PERIOD_S), say, None)
        if stopped:
            node_bus.send_all([codec.DRIVE_ESTOP.encode(DriveEstop())])


def belong_to_parent() -> None:
    """Let this process end with its parent, and leave Ctrl-C to the parent."""
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@contextmanager
def joined(spec: str, accept: Collection[int], places: Addresses) -> Iterator[Bus]:
    """Make or find the bus that `spec` names, and join it with the identifiers of the module at `places`.

    Prints on standard error how other programs join the bus.
    """
    on_bus = [bus_id(places, can_id & MAX_STANDARD_ID) | (can_id & REMOTE_FLAG) for can_id in accept]
    with open_bus(spec, on_bus) as (provided, bus):
        if provided.address != spec:
            print(
                f"bus {provided.name} ({provided.reason}); join it with --bus {provided.address}",
                file=sys.stderr,
            )
        yield addressed(bus, places)


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


def run_loop(
    runner: FirmwareRunner | PlantRunner,
    pace: Pace,
    offset: float,
    node_bus: Bus,
    start: Start,
    set_time: Callable[[float], None],
    clock_faults: ClockFaults,
    sync: bool,
) -> None:
    """Run from the start, delayed by `offset` periods, to the end or to SIGTERM or Ctrl-C."""
    if start.shared >= 0:
        leave_realtime()  # no process can be late, and the recorder needs the CPU as well
    elif start.first_tick > 0:
        become_realtime(NODE)
    own_clock = start.clock()
    clock: Clock = own_clock
    ticks = pace.ticks
    if clock_faults.any:
        clock = FaultyClock(clock, clock_faults, start.t0_ns)
        if ticks is not None:
            ticks += round(clock_faults.offset_s(ticks * pace.period_s) / pace.period_s)
    period_ns = round(pace.period_s * NS_PER_S)
    if not sync:
        print(f"running at {1.0 / pace.period_s:g} Hz; Ctrl-C ends it", file=sys.stderr)
    loop = FixedRateLoop(clock, start.t0_ns, period_ns, round(offset * period_ns))
    for number in (signal.SIGTERM,) if sync else (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: loop.stop())
    empty(node_bus)

    def step(tick: int, elapsed_ticks: int) -> None:
        set_time(tick * pace.period_s)
        runner.step(tick, elapsed_ticks)

    try:
        loop.run(ticks, step, runner.record, start.first_tick)
    finally:
        own_clock.leave()
        leave_realtime()
        runner.close()
    summary = {"overruns": loop.overruns, "lost_records": runner.lost_records, **asdict(node_bus.counters)}
    if sync:
        report_to_parent(json.dumps(summary))
    else:
        print(json.dumps(summary), file=sys.stderr)
