"""Long runs are judged and looked into in little memory: its peak grows by some columns of numbers alone."""

import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import numpy as np
from run_folder import END_S, T_S, make_run, write_run

from hil.record.traces import trace
from hil.record.traces.trace import TraceWriter

MINUTES = 4, 8
"""Up to some three minutes the peak grows until the readers' blocks are full; from then on it should stay."""
JUDGE = "assert finish(run_dir).figures.ticks == ticks"
INSPECT = "assert Run(log, run_dir).verdict['ticks'] == ticks"
COMPARE = "run = Run(log, run_dir); assert first_difference(run, run) is None"
EXPORT = "assert export(Run(log, run_dir), 'parquet', run_dir / 'frames')"
LARGEST_GROWTH_MB_A_MINUTE = {JUDGE: 8.0, INSPECT: 8.0, COMPARE: 16.0, EXPORT: 16.0}
"""Sixteen columns of 60,000 numbers each: what one figure works on at a time. Twice that for two runs, and
for the decoded frames of one name."""
IN_WORK_MB = 24.0
"""What two peaks of the same program on the same folder differ by, whatever the run's length: up to 22 MB, as
the reader's threads decode one block more or less ahead of their reader."""
EACH_IN_A_FORK = """
import os, sys
from pathlib import Path
from hil.runs.recorded_run import Run
from hil.runs.verdict import finish
from tools.runs.comparison import first_difference
from tools.exchange.exporting import export
run_dir, ticks = Path(sys.argv[1]), int(sys.argv[2])
log = run_dir / "run.rrd"
for program in sys.argv[3:]:
    child = os.fork()
    if child == 0:
        exec(program)
        print(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0], flush=True)
        os._exit(0)
    assert os.waitpid(child, 0)[1] == 0
"""
KINDS = {"f": float, "i": int, "b": bool}


def prolonged_folder(run_dir: Path, times: int) -> Path:
    """The made-up run over and over, its ticks and times going on."""
    made_up = make_run()
    write_run(made_up, run_dir)
    for name in ("plant", "firmware", "impacts", "operator"):
        path = run_dir / f"{name}.trace"
        records = trace.read(path).copy()
        fields = [(column, KINDS[records.dtype[column].kind]) for column in records.dtype.names]
        with TraceWriter(path, fields) as writer:
            for _ in range(times):
                writer.append_all(records)
                records["t_s"] += END_S
                if "tick" in records.dtype.names:
                    records["tick"] += round(END_S / T_S)
    frames = [line.partition(")")[::2] for line in made_up.can_log.splitlines(keepends=True)]
    with (run_dir / "can.log").open("w") as file:
        for repeat in range(times):
            file.writelines(f"({float(at[1:]) + repeat * END_S:.6f}){frame}" for at, frame in frames)
    return run_dir


def peaks_mb_of(programs: Iterable[str], run_dir: Path, ticks: int) -> list[float]:
    """The largest memory of each process that runs a program on a folder; all import their modules once."""
    command = [sys.executable, "-c", EACH_IN_A_FORK, str(run_dir), str(ticks), *programs]
    peaks_kb = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout.split()
    return [int(peak_kb) / 1024.0 for peak_kb in peaks_kb]


def test_memory_hardly_grows_with_the_length_of_the_run(tmp_path: Path) -> None:
    peaks_mb = []
    for minutes in MINUTES:
        times = round(60.0 * minutes / END_S)
        run_dir = prolonged_folder(tmp_path / f"{minutes}", times)
        ticks = times * round(END_S / T_S)
        peaks_mb.append(peaks_mb_of(LARGEST_GROWTH_MB_A_MINUTE, run_dir, ticks))
    growth_mb = np.diff(peaks_mb, axis=0)[0]
    largest_mb = IN_WORK_MB + (MINUTES[1] - MINUTES[0]) * np.array(list(LARGEST_GROWTH_MB_A_MINUTE.values()))
    assert np.all(growth_mb < largest_mb), peaks_mb
