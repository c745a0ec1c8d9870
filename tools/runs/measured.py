"""Signals and parameters of a running firmware, over XCP."""

import os
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from firmware_py.builds.a2l import unit_of
from firmware_py.interface.enums import XcpError
from firmware_py.interface.parameter_table import INDEX, TABLE
from firmware_py.shell.parameters import addresses_from, check_value
from hil.bus import open_bus
from hil.bus.addressed import addressed
from hil.processes.signals import Interrupted, is_ctrl_c
from hil.record.formats import PARAMETERS
from hil.record.new_file import make_anew, write_anew
from hil.scenario.settings import apply_settings
from hil.show.log_stream import LogStream
from hil.timing.clock import TICK_S
from tools.output import BadInputError
from tools.progress import shown_progress
from tools.runs.view import live_viewer
from tools.xcp_master import RefusedError, Sampled, XcpMaster

LOG_NAME = "measured.rrd"
SHOWN_S = 0.25
"""Interval at which samples go to log and viewer."""


@contextmanager
def session(bus: str, settings: Sequence[str]) -> Iterator[XcpMaster]:
    """A session with the firmware on a bus, of the module whose numbers `settings` may change."""
    places = addresses_from(apply_settings({"firmware": {}}, settings)["firmware"])
    with open_bus(bus) as (_, joined):
        master = XcpMaster(addressed(joined, places))
        master.connect()
        try:
            yield master
        finally:
            master.disconnect()


def measure_signals(
    wanted: Sampled, bus: str, settings: Sequence[str], until_s: float, live: bool, out: Path | None
) -> dict[str, dict[str, Any]]:
    """Measure the signals; by name: unit, samples received and lost, last, lowest and highest value.

    `live` and `out` also show them in a viewer and write them to a log.
    """
    twice = next((name for name, count in Counter(wanted.names).items() if count > 1), None)
    if twice is not None:
        raise BadInputError(f"{twice} is named twice; name each signal once")
    viewers = [live_viewer(may_open=False)] if live else []
    rows: list[tuple[float, ...]] = []
    ticks: list[int] = []
    sent = 0
    with session(bus, settings) as master, shown_progress() as progress:
        start(master, wanted)
        streams = log_streams(bus, viewers, out)
        start_s = shown_s = time.monotonic()
        try:
            for sample in master.samples([wanted]):
                now_s = time.monotonic()
                if sample is not None:
                    ticks.append(sample.tick)
                    rows.append((sample.tick * TICK_S, *sample.values))
                if now_s - shown_s > SHOWN_S:
                    progress(min((now_s - start_s) / until_s, 1.0), f"{len(rows)} samples")
                    send(streams, wanted.names, rows[sent:])
                    shown_s, sent = now_s, len(rows)
                if now_s - start_s >= until_s:
                    break
        except (Interrupted, KeyboardInterrupt) as error:
            if not is_ctrl_c(error):
                raise
    send(streams, wanted.names, rows[sent:])
    lost = lost_samples(ticks, wanted.prescaler)
    return {name: summary(name, [row[1 + k] for row in rows], lost) for k, name in enumerate(wanted.names)}


def start(master: XcpMaster, wanted: Sampled) -> None:
    """Start the measurement; BadInputError if it needs more frames than the firmware can send."""
    try:
        master.start([wanted])
    except RefusedError as refused:
        if refused.error != XcpError.MEMORY_OVERFLOW.name:
            raise
        rate_hz = 1.0 / (TICK_S * wanted.prescaler)
        raise BadInputError(
            f"the firmware has no room for {len(wanted.names)} signals at {rate_hz:g} Hz; lower --rate, or "
            "name fewer signals"
        ) from refused


def lost_samples(ticks: Sequence[int], prescaler: int) -> int:
    """How many samples are missing between the first and the last, whose ticks are `prescaler` apart."""
    return (ticks[-1] - ticks[0]) // prescaler + 1 - len(ticks) if ticks else 0


def summary(name: str, values: Sequence[float], lost: int) -> dict[str, Any]:
    """The figures of one signal; `lost`: of all signals together."""
    some = bool(values)
    return {
        "unit": unit_of(name),
        "samples": len(values),
        "lost": lost,
        "last": values[-1] if some else None,
        "low": min(values) if some else None,
        "high": max(values) if some else None,
    }


def log_streams(bus: str, viewers: Sequence[str], out: Path | None) -> list[LogStream]:
    """A log file in the folder `out`, and the open viewers."""
    run = {"scenario": "measurement", "clock": "real", "bus": bus, "wall_start_s": time.time()}
    targets: list[Path | str] = [*viewers]
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        log = out / LOG_NAME
        if os.path.lexists(log):
            raise BadInputError(f"{log} exists and is kept; name another folder")
        targets.append(make_anew(log))
    return [LogStream(target, run, None) for target in targets]


def send(streams: Sequence[LogStream], names: Sequence[str], rows: Sequence[tuple[float, ...]]) -> None:
    """Log samples in the places of a run's log: the entity `firmware`."""
    if not rows or not streams:
        return
    records: NDArray[np.void] = np.zeros(len(rows), [("t_s", float), *((name, float) for name in names)])
    records[:] = list(rows)
    for stream in streams:
        stream.log_ticks("firmware", records, 0.0)
        stream.flush()


def pairs_of(texts: Sequence[str]) -> dict[str, float]:
    """The parameters of `KEY=VALUE`. Raises BadInputError, or ParameterError for a bad key or value."""
    wanted: dict[str, float] = {}
    for text in texts:
        key, _, value = text.partition("=")
        try:
            number = float(value)
        except ValueError:
            raise BadInputError(f"{text!r}: wanted KEY=NUMBER, e.g. speed.gain_p_n_m_s=0.06") from None
        if key in wanted:
            raise BadInputError(f"{key} is given twice; wanted one value for each parameter")
        wanted[key] = check_value(key, number)
    return wanted


def change_parameters(
    wanted: Mapping[str, float], bus: str, settings: Sequence[str], save: Path | None
) -> list[dict[str, str]]:
    """Change parameters together; returns those refused, `{key, why}`, in which case none has changed.

    The changed parameters are written to the file `save`.
    """
    refused: list[dict[str, str]] = []
    with session(bus, settings) as master:
        for key, value in wanted.items():
            try:
                master.write(key, value)
            except RefusedError as error:
                refused.append({"key": key, "why": reason(key, error.error)})
        if not refused:
            try:
                master.commit()
            except RefusedError as error:
                why = f"they do not fit together with the other parameters ({error.error})"
                refused += [{"key": key, "why": why} for key in wanted]
    if save is not None and not refused:
        table = {key: TABLE[INDEX[key]] for key in wanted}
        parameters = {
            key: {"value": wanted[key], "unit": one.unit, "low": one.low, "high": one.high}
            for key, one in table.items()
        }
        document = {"format": PARAMETERS, "tuning": {"command": "calibrate"}, "parameters": parameters}
        write_anew(save, tomli_w.dumps(document))
    return refused


def reason(key: str, error: str) -> str:
    """Why the firmware has refused a parameter."""
    parameter = TABLE[INDEX[key]]
    if error != XcpError.WRITE_PROTECTED.name:
        return error
    if not parameter.is_calibrated:
        return "never changes over the bus: it is no tuning parameter, or safety rests on it"
    return "changes only at rest; stop the module first"
