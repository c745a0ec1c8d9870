"""Runs that leave a run folder: its beginning, and in lockstep the traces and can.log of a job's segments."""

import os
import time
from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path

import tomli_w

from hil.bus.log.candump_lines import lines_of
from hil.processes.signals import delayed_signals
from hil.record import provenance, run_folder
from hil.record.new_file import open_anew, write_anew
from hil.record.traces.trace import TraceWriter, fields_in
from hil.run_files import RunFile, trace_file
from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.scenario import Scenario
from hil.timing.memory import SETTLING_SHARE, MemoryWatch
from hil.timing.realtime import is_user_mode_linux
from plant_sim.scene import Scene

WARM_TICKS = 50
WARM: list[tuple[Scene, bool, object]] = []
"""Compiled or loaded combinations in this process: scene, whether the bus is ideal, and build."""


def key_of(scenario: Scenario, clock: str, seed: int) -> str:
    """A digest of all inputs of a run's verdict: scenario, clock, seed, sources, packages, kernel."""
    return provenance.key(tomli_w.dumps(scenario.document), clock, seed, provenance.versions()["kernel"])


def begin(run_dir: Path, scenario: Scenario, clock: str, seed: int) -> None:
    """Clear a claimed folder, and write the scenario as run and `run.json` without bus and start."""
    run_folder.clear(run_dir)
    run_folder.note(
        run_dir,
        scenario=scenario.name,
        title=scenario.title,
        clock=clock,
        seed=seed,
        period_s=scenario.period_s,
        user_mode_linux=is_user_mode_linux(),
        begun_s=time.time(),
        created=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        key=key_of(scenario, clock, seed),
        changes=list(scenario.changes),
        faults=[fault.as_record()._asdict() for fault in scenario.faults],
        **provenance.commit(),
        versions=provenance.versions(),
    )
    write_anew(run_dir / RunFile.SCENARIO, tomli_w.dumps(scenario.document))


def record(job: Job) -> int:
    """Run a job, and write traces and can.log, with simulated times, to its folder.

    Returns the number of records for which the disk had no room.
    """
    assert job.folder is not None
    ticks_in_all = job.scenario.ticks
    writers: dict[str, TraceWriter] = {}
    with ExitStack() as stack:
        can_log = stack.enter_context(open_anew(job.folder / RunFile.CAN_LOG))
        job.progress(0.0, "running in lockstep")
        for segment in stack.enter_context(closing(segments(job))):
            with delayed_signals():
                for name, rows in segment.rows.items():
                    if name not in writers:
                        expected = ticks_in_all if "work_us" in (rows.dtype.names or ()) else 0
                        path = job.folder / trace_file(name)
                        writer = TraceWriter(path, fields_in(rows.dtype), expected, in_memory=False)
                        writers[name] = stack.enter_context(writer)
                    writers[name].append_all(rows)
                can_log.write(lines_of(segment.frames))
            job.progress((segment.tick + segment.ticks) / ticks_in_all, "running in lockstep")
    return sum(writer.lost for writer in writers.values())


def simulate(job: Job) -> None:
    """Run a job in its folder, in simulated time from 0, so that two runs with one seed are identical."""
    assert job.folder is not None
    bus = {"bus": "in-process", "bus_reason": "lockstep", "kernel_can": False}
    run_folder.note(job.folder, **bus, t0_ns=0, wall_start_s=0.0)
    run_folder.write_json(job.folder / RunFile.PROCESSES, {"lockstep": os.getpid()})
    job.progress(0.0, "compiling kernels")
    warm_lockstep(job)
    started = time.perf_counter()
    outcome, memory = job.outcome, None
    if any(check.name.startswith("memory.") for check in job.scenario.checks):
        memory = MemoryWatch({"lockstep": os.getpid()})

    def watched(done: float, doing: str) -> None:
        if memory is not None:
            memory.sample()
        job.progress(done, doing)

    try:
        if lost := record(replace(job, progress=watched)):
            outcome.reasons.append(f"no room on the disk for the last {lost} records")
    finally:
        outcome.wall_s = time.perf_counter() - started
    if memory is not None:
        outcome.memory_growth_mb = memory.growth_mb()
        outcome.memory_watched_s = (1.0 - SETTLING_SHARE) * job.scenario.duration_s


def in_lockstep(job: Job) -> Path:
    """Run a job without a judgement; return the run folder, a new one if the job names none."""
    with run_folder.claimed(job.scenario.name, job.folder) as run_dir:
        begin(run_dir, job.scenario, "lockstep", job.seed)
        simulate(replace(job, folder=run_dir))
        run_folder.write_json(run_dir / RunFile.OUTCOME, vars(job.outcome))
    return run_dir


def warm_lockstep(job: Job) -> None:
    """Compile or load all code that a job needs, by a short run of which nothing is kept.

    This takes place once per process for each scene, kind of bus and build.
    """
    scenario = job.scenario
    kind = scenario.scene, scenario.bitrate is None, job.firmware
    if kind in WARM:
        return
    moment = replace(scenario, duration_s=WARM_TICKS * scenario.period_s, commands=(), faults=())
    for segment in segments(Job(moment, 0, job.firmware)):
        lines_of(segment.frames)
    WARM.append(kind)
