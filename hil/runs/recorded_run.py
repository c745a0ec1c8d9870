"""A run read from its log alone: figures, impacts, verdict, and every signal as an array or a table.

>>> from pathlib import Path
>>> open_run(Path("runs/nowhere.rrd"))
Traceback (most recent call last):
hil.runs.recorded_run.RunError: runs/nowhere.rrd is not there; name a run folder or an .rrd file
"""

import atexit
import difflib
import os
import shlex
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from hil.figures.records import Figures, TrueImpact
from hil.judge.judge import judge
from hil.judge.verdict import RunVerdict, Verdict
from hil.record import log_reader
from hil.record.candump import NO_BUS, Bus, StoredBus
from hil.record.damage import CAUSE_UNKNOWN, DamagedFileError, reading
from hil.record.frame_tables import RAW, names_of, raw_table, table_of
from hil.record.log_reader import TIMELINES, contiguous, read_traces
from hil.record.new_file import is_foreign, open_anew
from hil.record.provenance import build_of, this_build
from hil.record.rrd.log_file import is_whole, repair
from hil.record.rrd.rerun_program import RerunError
from hil.record.run_folder import RUNS, begun_s, is_in_use, is_own, refuse_irregular
from hil.record.run_traces import RunTraces, part, read_json
from hil.run_files import RunFile, trace_file
from hil.show.rerun_log import rebuild
from text_input import RefusalError, without_waiting

if TYPE_CHECKING:
    import pandas


TABLES_ARE_LEFT = "its tables may still be read: vibrohil inspect RUN --table NAME"


class RunError(RefusalError, ValueError):
    """A run, table or signal does not exist; the message names those that do."""


def newest_run() -> Path:
    """The run folder of the run that began last."""
    runs = [note.parent for note in RUNS.glob(f"*/{RunFile.NOTE}")]
    if not runs:
        raise RunError(f"no run in {RUNS}/; make one with `vibrohil run soft-start-multistable`, or name one")
    return max(runs, key=begun_s)


def log_of(run: Path | None) -> Path:
    """Path of a run's log, by its folder, its file, or the newest run; an incomplete log is repaired.

    For a run that has not ended, and for an incomplete log of another user, this is a copy, which is removed
    at the end of this process. Raises RunFolderError for a folder with links, pipes or devices.
    """
    place = newest_run() if run is None else run
    if not place.exists():
        raise RunError(f"{place} is not there; name a run folder or an .rrd file")
    if place.suffix == ".rrd":
        log = copied(place) if is_foreign(place) and not is_whole(place) else place
        repair(log)
        return log
    refuse_irregular(place)
    if not (place / trace_file("plant")).exists() and not (place / RunFile.LOG).exists():
        if is_own(place):
            raise RunError(why_without_log(place))
        raise RunError(
            f"{place} is no run folder: it holds neither {RunFile.LOG} nor plant.trace{runs_in(place)}"
        )
    log = place / RunFile.LOG
    if not log.exists():
        return rebuilt(place)
    is_running = not (place / RunFile.OUTCOME).exists() and is_in_use(place)
    if not is_running and (place / trace_file("plant")).exists() and not is_whole(log):
        with suppress(DamagedFileError):  # the log itself may hold more than damaged traces
            return rebuilt(place)
    if is_running or (is_foreign(place) and not is_whole(log)):
        log = copied(log)
    try:
        repair(log)
    except RerunError:
        if is_running:
            raise RunError(f"{place} has only begun: its log holds nothing yet; look again") from None
        if not (place / trace_file("plant")).exists():
            raise RunError(f"{log} is damaged, and no traces are beside it; {how_to_repeat(place)}") from None
        return rebuilt(place)
    return log


def why_without_log(run_dir: Path) -> str:
    """Why a run folder has neither log nor traces, and what to do."""
    with reading(run_dir, f"its {RunFile.VERDICT} is damaged; run it again"):
        verdict = read_json(run_dir / RunFile.VERDICT)
    if verdict.get("passed") is True:
        return f"{run_dir} passed as one of several seeds and keeps no log; {how_to_repeat(run_dir)}"
    return f"{run_dir} has no log: its run has not begun, or was ended before; see {RunFile.VERDICT}"


def how_to_repeat(run_dir: Path) -> str:
    """The command that repeats a run."""
    with reading(run_dir, f"its {RunFile.NOTE} is damaged; run it again"):
        note = read_json(run_dir / RunFile.NOTE)
    scenario = shlex.quote(str(run_dir / RunFile.SCENARIO))
    return (
        f"repeat it with `vibrohil run {scenario} --seed {note.get('seed')} --clock {note.get('clock')} "
        "--out FOLDER`"
    )


def runs_in(place: Path) -> str:
    """What to name instead of a folder of runs, as a suite leaves it; empty if there are none."""
    runs = [str(note.parent) for note in sorted(place.glob(f"*/{RunFile.NOTE}"))]
    return f"; name one of the runs in it, e.g. {', '.join(runs[:2])}" if runs else ""


def with_losses(found: RunTraces, log: Path, run_dir: Path) -> RunTraces:
    """A log's traces, with a sentence if it has lost ticks or its end since the verdict beside it."""
    if log.name != RunFile.LOG:
        return found
    nothing: dict[str, Any] = {}
    verdict, outcome = (
        part([], run_dir / name, read_json, nothing) for name in (RunFile.VERDICT, RunFile.OUTCOME)
    )
    count, judged_count = len(found.firmware), verdict.get("ticks", 0)
    if count >= judged_count and bool(found.outcome) >= bool(outcome):
        return found
    sentence = f"{log} is damaged, with {count} of the {judged_count} ticks that {RunFile.VERDICT} judges"
    return replace(found, outcome=found.outcome or outcome, damage=[sentence])


def rebuilt(run_dir: Path) -> Path:
    """Rebuild a run's log from its traces, elsewhere if the folder is another user's, and return its path."""
    remedy = "its traces make no run; import its can.log to see the frames"
    with reading(run_dir, remedy, lambda: cause(lambda: read_json(run_dir / RunFile.NOTE))):
        return rebuild(run_dir, temporary_folder() if is_foreign(run_dir) else None)


def cause(note: Callable[[], Mapping[str, Any]]) -> str:
    """Why a run cannot be read, as far as `note`, which reads its run.json, names the build that made it."""
    try:
        made_by = build_of(note())
    except (OSError, RuntimeError, ValueError, LookupError, TypeError, AttributeError):
        return CAUSE_UNKNOWN
    if made_by == this_build():
        return "is damaged"
    return f"was made by vibrohil {made_by}, which may differ from this {this_build()}, or is damaged"


def copied(log: Path) -> Path:
    """A copy of a log, which is removed at the end of this process. Raises RunError for a pipe or device.

    What is opened is looked at, because its owner may exchange the file at any time.
    """
    with open(log, "rb", opener=without_waiting) as source:
        if not stat.S_ISREG(os.fstat(source.fileno()).st_mode):
            raise RunError(
                f"{log} is no file but a folder, pipe or device, of which no copy would end; name a log"
            )
        copy = temporary_folder() / log.name
        with open_anew(copy) as target:
            shutil.copyfileobj(source, target)
    return copy


def temporary_folder() -> Path:
    """A folder that is removed at the end of this process."""
    folder = Path(tempfile.mkdtemp(prefix="vibrohil-view-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def named(name: str, among: list[str], what: str) -> str:
    """Return `name` if it exists; otherwise raise RunError with similar names."""
    if name in among:
        return name
    near = difflib.get_close_matches(name, among, n=3, cutoff=0.4)
    wanted = f"similar: {', '.join(near)}" if near else f"it has {', '.join(among)}"
    raise RunError(f"no {what} {name!r} in this log; {wanted}")


def single(values: pa.Array) -> pa.Array:
    """A component's column, flattened if all its lists have one element."""
    if not pa.types.is_list(values.type) or values.null_count:
        return values
    lengths = np.diff(values.offsets.to_numpy())
    return values.flatten() if bool(np.all(lengths == 1)) else values


def flat(table: pa.Table) -> pa.Table:
    """One entity's rows with one plain column per signal; `t_s` is simulated time in seconds."""
    seconds = log_reader.sim_ns_of(table) / 1e9
    columns: dict[str, pa.Array] = {"t_s": pa.array(seconds), "wall_time": contiguous(table["wall_time"])}
    for component in table.column_names:
        if component not in TIMELINES:
            short = component.rpartition(":")[2]
            name = "" if short == "record" else short
            columns |= log_reader.leaves(name, single(contiguous(table[component])))
    return pa.table(columns)


@dataclass(frozen=True)
class Run:
    """One recorded run; tables and figures are read from its log at first use, and frames from can.log."""

    log: Path
    folder: Path
    """The run folder, which has can.log beside the log; the log may be a copy elsewhere."""

    def _reading(self, still_readable: str) -> AbstractContextManager[None]:
        """Convert any error while the log is read to DamagedFileError, as `hil.record.damage.reading`."""
        return reading(self.log, still_readable, lambda: cause(self._note))

    def _note(self) -> dict[str, Any]:
        """The content of run.json at the start of the run."""
        return log_reader.json_object(log_reader.documents(self.log).get("run", "{}"))

    @cached_property
    def frames(self) -> Bus:
        """The frames of can.log; none if there is no such file beside the log."""
        path = self.folder / RunFile.CAN_LOG
        if not path.exists():
            return NO_BUS
        refuse_irregular(self.folder)
        return StoredBus(path)

    @cached_property
    def _logged(self) -> list[str]:
        """Names of the tables that the log has."""
        with self._reading("make it again from the traces, by deleting it and naming the run folder"):
            return [name.removeprefix("/") for name in log_reader.names(self.log)]

    @cached_property
    def names(self) -> list[str]:
        """Names of the tables: `plant`, `firmware`, `impacts/truth`, `can/Accelerometer`, …"""
        return sorted([*self._logged, *names_of(self.frames)])

    @cached_property
    def wall_start_s(self) -> float:
        """The run's start on the wall clock."""
        with self._reading(TABLES_ARE_LEFT):
            return float(self._note().get("wall_start_s", 0.0))

    def table(self, name: str) -> pa.Table:
        """One table with a row per tick (impact, frame, event) and a column per signal."""
        if name not in self._logged:
            if name.startswith("can/") and self.frames is NO_BUS:
                raise RunError(
                    f"no table {name!r}: frames are in {RunFile.CAN_LOG}; put it beside {self.log}"
                )
            return table_of(self.frames.whole(), named(name, self.names, "table"), self.wall_start_s)
        entity = f"/{name}"
        with self._reading(f"other tables may still be read; {name} may not"):
            return flat(log_reader.table(self.log, entity))

    def blocks(self, name: str) -> Iterator[pa.Table]:
        """Yield the rows of a table in order of time, in blocks."""
        if name == RAW:
            yield from (raw_table(piece, self.wall_start_s) for piece in self.frames.pieces())
            return
        entity = f"/{named(name, self._logged, 'table')}"
        with self._reading(f"other tables may still be read; {name} may not"):
            yield from map(flat, log_reader.ordered_blocks(self.log, entity))

    def frame(self, name: str) -> "pandas.DataFrame":
        """One table as a pandas frame with the simulated time in seconds as index; needs pandas."""
        table: pandas.DataFrame = self.table(name).to_pandas()
        return table.set_index("t_s")

    def signal(self, name: str) -> tuple[Any, Any]:
        """Simulated seconds and values of `TABLE.COLUMN`, both of shape (n,)."""
        prefixes = [entity for entity in self.names if name.startswith(f"{entity}.")]
        if not prefixes:
            raise RunError(
                f"signal {name!r} names no table; wanted TABLE.COLUMN with one of {', '.join(self.names)}"
            )
        entity = max(prefixes, key=len)
        table = self.table(entity)
        column = named(name.removeprefix(f"{entity}."), table.column_names, f"column of {entity}")
        return table["t_s"].to_numpy(), table[column].to_numpy()

    @property
    def regime(self) -> str:
        """The striker's true regime during the hold."""
        return self.figures.regime

    @property
    def impacts(self) -> tuple[TrueImpact, ...]:
        """The true touch-downs: time in s and approach speed in m/s of each."""
        return self.figures.impacts

    @property
    def passed(self) -> bool:
        """Whether every check passed and the run has no other reason to fail; a run not judged has not."""
        return bool(self.judged.passed)

    @property
    def why_not_judged(self) -> list[str]:
        """The reasons why the run is not judged, one sentence each; empty if it has passed or failed."""
        if self.judged.verdict is not Verdict.NOT_JUDGED:
            return []
        doubted = [check for check in self.judged.checks if check.verdict is Verdict.NOT_JUDGED]
        return [*self.judged.not_judged, *(f"{check.name}: {check.reason}" for check in doubted)]

    @cached_property
    def traces(self) -> RunTraces:
        """The run's traces, read from its log."""
        with self._reading(TABLES_ARE_LEFT):
            found = with_losses(read_traces(self.log), self.log, self.folder)
        if len(found.firmware) and "tick" not in (found.firmware.dtype.names or ()):
            raise RunError(
                f"{self.log} holds signals of `vibrohil measure`, no run; `vibrohil view` shows them, and "
                "`vibrohil inspect --table firmware` lists them"
            )
        return found

    @property
    def figures(self) -> Figures:
        """All figures, computed from the log."""
        return self.judged.figures

    @cached_property
    def judged(self) -> RunVerdict:
        """The verdict, computed from the log."""
        traces = self.traces
        with self._reading(TABLES_ARE_LEFT):
            return judge(traces, self.folder)

    @cached_property
    def verdict(self) -> dict[str, Any]:
        """The verdict with the keys of `verdict.json`."""
        return self.judged.as_json()


def open_run(run: str | Path | None = None) -> Run:
    """Open a run by its folder or .rrd file, by default the newest run; an incomplete log is repaired."""
    place = newest_run() if run is None else Path(run)
    log = log_of(place)
    return Run(log, place if place.is_dir() else place.parent)
