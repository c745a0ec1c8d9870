"""A run in lockstep as segments: the one driver of run folders, campaigns and measurements."""

from collections.abc import Generator, Mapping
from contextlib import ExitStack
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.faults.fault import effects_of
from hil.processes.signals import delayed_signals
from hil.runs.compiled import Stretches
from hil.runs.job import Job
from hil.runs.lockstep import Lockstep
from plant_sim.kernels import IS_INTERPRETED

RECORDED_S = 0.5
"""Simulated time of a segment with all records, at most twice this: the time between reports of progress."""
LONGEST_TICKS = 4096
"""Longest segment of selected columns."""


class Segment(NamedTuple):
    """Consecutive ticks of a run: views of memory that the next segment overwrites.

    `rows`: the records of each trace that is kept, with its columns. A node has none in a tick in which it
    did not run, and several where its clock has let it catch up. `frames`: rows of time in µs, identifier,
    length and word; empty if they are not kept.
    """

    tick: int
    ticks: int
    rows: Mapping[str, NDArray[np.void]]
    frames: NDArray[np.int64]


def segments(job: Job) -> Generator[Segment]:
    """Run a job and yield its segments; an error or a signal is raised after the segment that it has ended.

    A job is done when the last segment has been taken; the effects of its faults are then in its outcome.
    Raises TextInputError for a controller that cannot be loaded.
    """
    scenario = job.scenario
    longest = round(RECORDED_S / scenario.period_s) if job.kept is None else LONGEST_TICKS
    with ExitStack() as stack:
        nodes = Lockstep(job, stack)
        stretches = None if IS_INTERPRETED else Stretches(job, nodes)
        begun = tick = 0
        try:
            while tick < scenario.ticks:
                with delayed_signals():
                    ticks = 0 if stretches is None else stretches.advance(tick, longest)
                    if ticks == 0:
                        nodes.tick(tick)
                    tick += ticks or 1
                if tick - begun >= longest or tick == scenario.ticks:
                    yield taken(nodes, begun, tick)
                    begun = tick
        except GeneratorExit:
            raise
        except BaseException:
            yield taken(nodes, begun, tick)
            raise
        finally:
            job.outcome.faults_acted = list(effects_of(nodes.faults.values()))


def taken(nodes: Lockstep, tick: int, until_tick: int) -> Segment:
    """Remove and return what the nodes have recorded and sent since `tick`."""
    rows = {name: rows.taken() for name, rows in nodes.rows.items()}
    segment = Segment(tick, until_tick - tick, rows, nodes.frames.taken())
    nodes.frames.count = 0
    for trace in nodes.rows.values():
        trace.count = 0
    return segment
