"""Writes a log to a file or to an open viewer: columns over two timelines, states, changes, events."""

import hashlib
import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from hil.record.rrd.log_file import ROOM_BYTES, refuse_full_disk, written_whole
from hil.record.run_traces import column
from hil.record.state_timeline import ALARM, StateTimeline, lower_name, state_name
from hil.record.traces.precision import TIME, whole_ns
from hil.record.traces.stored_trace import Records
from hil.show.legible.limits import Limit
from hil.show.legible.state_labels import fit
from plant_sim.arrays import FloatArray

APPLICATION_ID = "vibrohil"
VIEWER_TIMEOUT_S = 8.0
"""Time after which a viewer that accepts no data is given up."""


def recording_id(run: Mapping[str, Any]) -> str:
    """Identifier of a run's recording, the same each time its log is written."""
    parts = (str(run.get(key)) for key in ("scenario", "clock", "bus", "seed", "wall_start_s"))
    return hashlib.sha256("|".join(parts).encode()).hexdigest()[:32]


@contextmanager
def recorded(
    path: Path, name: str, blueprint: rrb.Blueprint, needed_bytes: int = ROOM_BYTES
) -> Iterator[rr.RecordingStream]:
    """Give an empty recording; after the block it stands in the file `path`. Raises as `written_whole`."""
    with written_whole(path, needed_bytes) as unfinished:
        recording = rr.RecordingStream(APPLICATION_ID, send_properties=False)
        recording.save(unfinished, default_blueprint=blueprint)
        recording.send_recording_name(name)
        yield recording
        recording.disconnect()


def colors(rgba: Iterable[int]) -> NDArray[np.uint32]:
    """Colours in the SDK's own format."""
    return np.fromiter(rgba, np.uint32)


def struct_of(records: Records, but: str | None = None) -> pa.StructArray:
    """Records as one Arrow struct each, without the column `but`; dotted names become structs in structs.

    >>> records = np.zeros(1, dtype=[("tick", "i8"), ("state.x_m", "f8")])
    >>> str(struct_of(records).type)
    'struct<tick: int64, state: struct<x_m: double>>'
    """
    tree: dict[str, Any] = {}
    for name in records.dtype.names or ():
        if name == but:
            continue
        *path, leaf = name.split(".")
        branch = tree
        for part in path:
            branch = branch.setdefault(part, {})
        branch[leaf] = np.ascontiguousarray(records[name])

    def build(branch: dict[str, Any]) -> pa.StructArray:
        arrays = [build(item) if isinstance(item, dict) else pa.array(item) for item in branch.values()]
        return pa.StructArray.from_arrays(arrays, names=list(branch))

    return build(tree)


def dynamic(archetype: str, struct: pa.StructArray) -> rr.ComponentColumnList:
    """One struct per row as the component `archetype:record`."""
    return rr.DynamicArchetype.columns(archetype=archetype, components={"record": struct})


class LogStream:
    """Writes to a file, or to a viewer by its URL, with an initial layout."""

    def __init__(self, to: Path | str, run: Mapping[str, Any], blueprint: rrb.Blueprint | None) -> None:
        # A viewer merges recordings with the same identifier, so the live view has another one than the file.
        identity = recording_id(run) if isinstance(to, Path) else f"{recording_id(run)}-live"
        self.recording = rr.RecordingStream(APPLICATION_ID, recording_id=identity, send_properties=False)
        if isinstance(to, Path):
            self.recording.save(to, default_blueprint=blueprint)
        else:
            self.recording.connect_grpc(to, default_blueprint=blueprint)
        self._file = to if isinstance(to, Path) else None
        self._wall_start_ns = round(float(run.get("wall_start_s", 0.0)) * 1e9)
        self._declared: set[str] = set()
        self._last: dict[str, int] = {}
        self._new_events: list[tuple[float, str, str]] = []
        self._timelines: dict[str, tuple[list[tuple[float, str]], dict[str, int]]] = {}
        name = " ".join([run.get("scenario", "run"), *run.get("changes", [])])
        self.recording.send_recording_name(f"{name} ({run.get('clock', '?')})")
        self.recording.send_recording_start_time_nanos(self._wall_start_ns)

    def flush(self) -> None:
        """Pass all data to the file or the viewer.

        Raises RuntimeError if the viewer is gone or stopped, OSError if the disk has little room for more.
        """
        if self._file is not None:
            refuse_full_disk(self._file)
        self.recording.flush(timeout_sec=math.inf if self._file else VIEWER_TIMEOUT_S)

    def declare(self, entity: str, *what: Any) -> None:
        """Log the static style of an entity, once."""
        if entity not in self._declared:
            self._declared.add(entity)
            self.recording.log(entity, *what, static=True)

    def log_document(self, entity: str, text: str, language: str) -> None:
        """Log a static text in this language; it has no fence as long as that around it."""
        fence = max(["``", *re.findall("`+", text)], key=len) + "`"
        self.log_markdown(entity, f"{fence}{language}\n{text}\n{fence}")

    def log_markdown(self, entity: str, text: str) -> None:
        """Log a static page in Markdown."""
        self.recording.log(entity, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN), static=True)

    def send(
        self, entity: str, t_s: FloatArray, columns: Iterable[Any], late_us: FloatArray | float = 0.0
    ) -> None:
        """Log columns with a row at each of `t_s`; `late_us`: the process's wake-up latency, if known."""
        sim_ns = whole_ns(t_s)
        late_ns = np.round(np.nan_to_num(np.multiply(late_us, 1e3))).astype(np.int64)
        wall_ns = self._wall_start_ns + sim_ns + late_ns
        times = [
            rr.TimeColumn("sim_time", duration=sim_ns.astype("timedelta64[ns]")),
            rr.TimeColumn("wall_time", timestamp=wall_ns.astype("datetime64[ns]")),
        ]
        self.recording.send_columns(entity, times, [*columns])

    def log_constant(self, entity: str, t_s: FloatArray, value: float, name: str, rgba: int) -> None:
        """Log a line at a constant value over the times `t_s`."""
        self.declare(entity, rr.SeriesLines.from_fields(names=[name], colors=colors([rgba]), widths=[1.0]))
        self.send(entity, t_s[[0, -1]], rr.Scalars.columns(scalars=[value] * 2))

    def log_constants(self, entity: str, t_s: FloatArray, lines: Sequence[Limit], rgba: int) -> None:
        """Log several lines at constant values over the times `t_s` as one entity."""
        names, shades = [line.name for line in lines], colors([rgba] * len(lines))
        self.declare(
            entity, rr.SeriesLines.from_fields(names=names, colors=shades, widths=[1.0] * len(lines))
        )
        values = np.tile([line.value for line in lines], (2, 1))
        self.send(entity, t_s[[0, -1]], rr.Scalars.columns(scalars=values))

    def log_states(self, entity: str, changes: Sequence[tuple[float, str]], rgba: Mapping[str, int]) -> None:
        """Log the changes of a state timeline; `rgba`: the colours of its states."""
        self.declare(entity, rr.StateConfiguration(values=list(rgba), colors=colors(rgba.values())))
        all_changes, all_rgba = self._timelines.setdefault(entity, ([], {}))
        all_changes += changes
        all_rgba |= rgba
        if changes:
            t_s, states = zip(*changes, strict=True)
            self.send(entity, np.array(t_s), rr.StateChange.columns(state=states))

    def log_timelines(self, end_s: float) -> None:
        """Log the state timelines of a finished run for its layout, with names that fit their intervals."""
        for entity, (changes, rgba) in self._timelines.items():
            shown = fit(entity, changes, rgba, end_s)
            # A label belongs to a value, so a state that is shown without its name is a value of its own.
            values = [one.state if one.label == one.state else f"{one.state} → {one.label}" for one in shown]
            styles = {value: (one.label, one.rgba) for value, one in zip(values, shown, strict=True)}
            labels, rgbas = zip(*styles.values(), strict=True) if styles else ((), ())
            place = f"timeline/{entity.partition('/')[2]}"
            self.declare(
                place, rr.StateConfiguration(values=list(styles), labels=labels, colors=colors(rgbas))
            )
            if values:
                self.send(place, np.array([one.t_s for one in shown]), rr.StateChange.columns(state=values))

    def log_records(self, entity: str, records: Records) -> None:
        """Log records with all their columns."""
        self.send(entity, column(records, "t_s"), dynamic("trace", struct_of(records)))

    def log_ticks(self, entity: str, records: Records, late_us: FloatArray | float) -> None:
        """Log records without their time column, which the timeline already has."""
        self.send(entity, column(records, "t_s"), dynamic("trace", struct_of(records, but=TIME)), late_us)

    def log_state_timelines(self, records: Records, timelines: Iterable[StateTimeline]) -> None:
        """Log the changes of state timelines."""
        for timeline in timelines:
            rgba = {lower_name(state): timeline.colors.get(state, ALARM) for state in timeline.states}
            changes = self.find_changes(timeline.entity, records, timeline.column)
            named = [(t_s, state_name(timeline.states, value)) for t_s, value in changes]
            self.log_states(timeline.entity, named, rgba)

    def find_changes(self, key: str, records: Records, name: str) -> list[tuple[float, int]]:
        """Times and new values at which a column of integers changes; `key` identifies it between calls."""
        values = column(records, name).astype(np.int64)
        if len(values) == 0:
            return []
        before = np.concatenate([[self._last.get(key, ~values[0])], values[:-1]])
        self._last[key] = int(values[-1])
        at = np.flatnonzero(values != before)
        return [(float(t), int(v)) for t, v in zip(column(records, "t_s")[at], values[at], strict=True)]

    def add_event(self, at_s: float, text: str, level: str) -> None:
        """Add a line to the log's events; `send_events` writes it."""
        self._new_events.append((at_s, text, level))

    def send_events(self) -> None:
        """Log all events since the last call together, since each call has an overhead."""
        if self._new_events:
            t_s, texts, levels = zip(*sorted(self._new_events, key=itemgetter(0)), strict=True)
            timed = [f"{at_s:.3f} s  {text}" for at_s, text in zip(t_s, texts, strict=True)]
            self.send("events", np.array(t_s), rr.TextLog.columns(text=timed, level=levels))
            self._new_events.clear()
