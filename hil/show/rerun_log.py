"""Writes the log for the user: a run's traces as `run.rrd`, in whole columns.

Each trace is one entity with one Arrow struct per tick, with the trace's field names, so that the log is
little larger than the numbers themselves; the layout selects the plotted fields. Of the frames there are only
the load of the bus and those that cannot be decoded: all frames stand in can.log. There are two timelines:
`sim_time`, and `wall_time`, the wake-up time of the process (in lockstep: its nominal time).
One writer serves the recorder, which appends once a second during a run, the live view, and the rebuild of a
whole run; its output depends on the traces alone.
"""

import json
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
import tomli_w

from firmware_py.interface.enums import ActingLimit, AxisError, Fault, Mode, OperatorRequest, Regime
from firmware_py.interface.modes import LATCHED
from hil.bus.model.fault_confinement import RECORDED, ErrorState
from hil.figures import detection
from hil.figures.estimate_error import EstimateErrors, estimate_errors
from hil.figures.gait import phase_at, push_off
from hil.judge.judge import judge
from hil.judge.verdict import RunVerdict, Verdict
from hil.record.bus_load import BusLoad, sum_loads
from hil.record.candump import BusLog
from hil.record.frame_tables import find_refused
from hil.record.rrd.log_file import written_whole
from hil.record.rrd.rates import SLOW_TICKS, Held, is_slow, signals_of_checks
from hil.record.run_faults import RunFault
from hil.record.run_traces import RunTraces, column, pieces, read_run
from hil.record.state_timeline import (
    ALARM,
    FIRMWARE_TIMELINES,
    LEG_ESTIMATED_TIMELINE,
    LEG_TIMELINE,
    NEUTRAL,
    PLANT_TIMELINES,
    TARGET,
    WARN,
    StateTimeline,
    lower_name,
    state_name,
)
from hil.record.traces.stored_trace import Records
from hil.run_files import RunFile
from hil.scenario.checks import Check, checks_of
from hil.show.drawing import Drawing
from hil.show.highlights import highlights, marks
from hil.show.injected import NONE, injected_in, timeline
from hil.show.layout import Contents, Mark, layout
from hil.show.legible.extents import Extents
from hil.show.legible.limits import FIGURES, limits_of
from hil.show.log_stream import LogStream, dynamic
from hil.show.verdict_text import verdict_text
from hil.timing.clock import IMPORTED
from hil.timing.pacemaker import Hold
from plant_sim.arrays import FloatArray

BUS_TIMELINES = tuple(
    StateTimeline(
        f"states/bus_{node}",
        f"{node}.error_state",
        ErrorState,
        {ErrorState.ERROR_ACTIVE: NEUTRAL, ErrorState.ERROR_PASSIVE: WARN},
    )
    for node in RECORDED
)
"""State timelines of a modelled bus."""

LATEST_MARK = 0.97
"""Latest mark of a failed check, as a share of the run."""
ERROR_TICKS = 10
"""Ticks per logged error of the estimate."""


def axis_errors(bits: int) -> str:
    """Names of the drive's error bits.

    >>> axis_errors(0x0100_8000)
    'velocity-limit-violation, watchdog-timer-expired'
    """
    known = [error for error in AxisError if error and bits & error]
    unknown = bits & ~sum(known)
    return ", ".join([*map(lower_name, known), *([f"0x{unknown:X}"] if unknown else [])])


def largest_of_each(ticks: int, errors: EstimateErrors) -> EstimateErrors:
    """The tick with the largest position error in each block of `ticks`, enough for a plot of a run."""
    whole = len(errors.t_s) // ticks * ticks
    blocks = np.abs(errors.x_m[:whole]).reshape(-1, ticks)
    rows = np.arange(0, whole, ticks) + np.argmax(blocks, axis=1)
    return EstimateErrors(*(values[rows] for values in errors))


class RunLog:
    """Writes a run's traces to a file, or to an open viewer by its URL; `append` adds new records.

    Raises RuntimeError if the viewer is gone or stopped.
    """

    def __init__(
        self, to: Path | str, run: Mapping[str, Any], scenario: Mapping[str, Any], is_over: bool = False
    ) -> None:
        """`is_over`: the run has ended, so the only layout is that of the conclusion."""
        self._walked = "gait" in scenario.get("scene", {})
        self._contents = Contents(
            worn="wearer" in scenario.get("scene", {}),
            walked=self._walked,
            injected=bool(run.get("faults")),
            measured=run.get("clock") == "real",
            imported=run.get("clock") == IMPORTED,
        )
        self._extents = Extents()
        self.out = LogStream(to, run, None if is_over else layout(None, self._contents))
        self.stop_m: float | None = scenario.get("scene", {}).get("stop", {}).get("position_m")
        self._pending_load = sum_loads(())
        self._end_s = 0.0
        self.out.log_document("about/run", json.dumps(dict(run), indent=2), "json")
        self.out.log_document("about/scenario", tomli_w.dumps(dict(scenario)), "toml")
        self._scenario = scenario
        named = signals_of_checks(scenario)
        self._plant_log, self._firmware_log = Held("plant", named), Held("firmware", named)
        self._refused = False
        self.drawing = Drawing(self.out, scenario)

    def close(self) -> None:
        """Write the pending bus load and the file's footer."""
        self._log_pending_load()
        self.out.recording.disconnect()

    def append(self, traces: RunTraces) -> None:
        """Log the records of `traces`, which are all new, and pass them to the operating system."""
        for records in (traces.plant, traces.firmware):
            if len(records):
                self._end_s = max(self._end_s, float(column(records, "t_s")[-1]))
        for log, records in (
            (self._log_plant, traces.plant),
            (self._log_firmware, traces.firmware),
            (self._log_impacts, traces.impacts),
            (self._log_operator, traces.operator),
            (self._log_bus_errors, traces.bus_errors),
        ):
            if len(records):
                log(records)
        self._log_frames(traces.bus.whole())
        self.out.send_events()
        self.out.flush()

    def conclude(self, traces: RunTraces, verdict: RunVerdict) -> None:
        """Log the results of the ended run: verdict, checks, errors, faults; last its outcome.

        A log that is cut behind its outcome has lost nothing.
        """
        figures = verdict.figures
        self._log_held(figures.time_held)
        for gap in figures.gaps:
            self.out.add_event(gap.from_s, f"the host {gap.in_words}", "WARN")
        if verdict.lost_frames is not None:
            self.out.add_event(figures.duration_s, verdict.lost_frames, "WARN")
        text = verdict_text(self._scenario.get("title", "run"), traces.run, verdict)
        self.out.log_markdown("about/verdict", text)
        for name, records in traces.others.items():
            if len(records):
                self.out.log_records(name, records[:])
        failed = sorted(marks(verdict.checks, traces, figures))
        for mark in failed:
            self.out.add_event(mark.t_s, mark.text, "ERROR")
        for mark in sorted(marks(verdict.checks, traces, figures, Verdict.PASSED)):
            self.out.add_event(mark.t_s, mark.text, "INFO")
        self._log_checks(failed)
        self._log_injected(injected_in(traces.run))
        self._log_estimate_error(traces)
        if self._walked:
            self._log_pulses(traces)
        limited = self._log_limits(checks_of(self._scenario))
        self.out.send_events()
        self.out.log_timelines(self._end_s)
        contents = self._contents._replace(
            impacts=len(traces.impacts) > 0 or figures.impacts_reported > 0,
            judged=True,
            failed=bool(failed),
            bus_errors=len(traces.bus_errors) > 0,
            refused=self._refused,
            held=len(figures.time_held) > 0,
            limited=limited,
        )
        blueprint = layout(highlights(traces, figures, failed), contents, self._extents)
        self.out.recording.send_blueprint(blueprint, make_active=True, make_default=True)
        self._log_pending_load()
        self.out.flush()
        self.out.log_document("about/outcome", json.dumps(dict(traces.outcome), indent=2), "json")

    def _log_held(self, holds: Sequence[Hold]) -> None:
        """Log the intervals in which time was held as a list of their own."""
        if holds:
            texts = [f"{hold.t_s:.3f} s  {hold.in_words}" for hold in holds]
            t_s = np.array([hold.t_s for hold in holds])
            self.out.send("held", t_s, rr.TextLog.columns(text=texts, level=["INFO"] * len(texts)))

    def _log_limits(self, checks: Sequence[Check]) -> tuple[str, ...]:
        """Log the limits of checks that a plot shows, and return their entities."""
        ends_s = np.array([0.0, self._end_s])
        found = {entity: limits_of(checks, figures) for entity, figures in FIGURES.items()}
        for entity, limits in found.items():
            if limits:
                self.out.log_constants(entity, ends_s, limits, ALARM)
                self._extents.add(entity, np.array([limit.value for limit in limits]))
        return tuple(entity for entity, limits in found.items() if limits)

    def _log_checks(self, failed: Sequence[Mark]) -> None:
        """Log the failed checks as a state timeline."""
        texts: dict[float, str] = {}
        for mark in failed:
            # A mark extends to the run's end, so a mark at the end itself would have no width.
            t_s = min(mark.t_s, LATEST_MARK * self._end_s)
            texts[t_s] = f"{texts[t_s]}; {mark.text}" if t_s in texts else mark.text
        self._log_states("states/checks", list(texts.items()))

    def _log_injected(self, faults: list[RunFault]) -> None:
        """Log the scenario's injected faults as a state timeline and as events."""
        if not faults:
            return
        self._log_states("states/injected", timeline(faults, self._end_s))
        for fault in faults:
            if fault.from_s <= self._end_s:
                self.out.add_event(fault.from_s, f"injected fault: {fault.text}", "WARN")
            if fault.from_s < fault.end_s <= self._end_s:
                self.out.add_event(fault.end_s, f"injected fault over: {fault.text}", "INFO")

    def _log_states(self, entity: str, changes: Sequence[tuple[float, str]]) -> None:
        """Log a state timeline with texts of this run as states; all except `none` are alarms."""
        if changes:
            rgba = {state: NEUTRAL if state == NONE else ALARM for _, state in changes}
            self.out.log_states(entity, changes, rgba)

    def _log_estimate_error(self, traces: RunTraces) -> None:
        """Log estimate minus truth; a log of a real bench has no truth."""
        plant, firmware = traces.plant, traces.firmware
        if (
            len(plant) == 0
            or len(firmware) == 0
            or "state.estimator.v_m_s" not in (firmware.dtype.names or ())
        ):
            return
        errors = largest_of_each(ERROR_TICKS, estimate_errors(plant, firmware))
        shown = {"x_m": errors.x_m, "v_m_s": errors.v_m_s}
        for name, values in shown.items():
            self._extents.add(f"/estimate_error.{name}", values)
        single = [pa.array(values, pa.float32()) for values in shown.values()]
        struct = pa.StructArray.from_arrays(single, names=list(shown))
        self.out.send("estimate_error", errors.t_s, dynamic("trace", struct))

    def _log_pulses(self, traces: RunTraces) -> None:
        """Log the push-off window, and each impact at its phase of the gait cycle; standing has no phase."""
        window = push_off(self._scenario)
        ends_s = np.array([0.0, self._end_s])
        for edge, share in (("from", window.start), ("to", window.end)):
            self.out.log_constant(f"gait/window/{edge}", ends_s, share, f"window {edge}", TARGET)
        t_s = column(traces.impacts, "t_s")
        phase = phase_at(traces.plant, t_s)
        inside = window.holds(phase)
        for entity, which in (("gait/inside", inside), ("gait/outside", ~inside & np.isfinite(phase))):
            if which.any():
                self.out.send(entity, t_s[which], rr.Scalars.columns(scalars=phase[which]))

    # --- one trace each ------------------------------------------------------------------------------

    def _log_trace(self, trace: str, records: Records, held: Held) -> None:
        """Log the records of plant or firmware, and note the ranges of their signals."""
        kept = held.hold(records)
        self.out.log_ticks(trace, kept, column(records, "wake_latency_us"))
        for name in kept.dtype.names or ():
            if kept.dtype[name].kind == "f":
                every = SLOW_TICKS if is_slow(f"{trace}.{name}") else 1
                self._extents.add(f"/{trace}.{name}", kept[name][::every])

    def _log_plant(self, records: Records) -> None:
        self._log_trace("plant", records, self._plant_log)
        self.out.log_state_timelines(records, PLANT_TIMELINES)
        self.drawing.draw_truth(records)
        if self.stop_m is not None:
            self.out.log_constant("stop", column(records, "t_s"), self.stop_m, "stop", ALARM)
            self._extents.add("/stop", np.array([self.stop_m]))
        if self._walked:
            self.out.log_state_timelines(records, (LEG_TIMELINE,))
        for at_s, value in self.out.find_changes("axis_error", records, "axis_error"):
            if value != AxisError.NONE:
                self.out.add_event(at_s, f"drive error: {axis_errors(value)}", "ERROR")

    def _log_firmware(self, records: Records) -> None:
        self._log_trace("firmware", records, self._firmware_log)
        self.out.log_state_timelines(records, FIRMWARE_TIMELINES)
        if self._walked:
            self.out.log_state_timelines(records, (LEG_ESTIMATED_TIMELINE,))
        self.drawing.draw_estimate(records)
        self._log_firmware_events(records)
        self.out.log_constant("nis_expected", column(records, "t_s"), 1.0, "1", TARGET)
        self._log_reported(records)

    def _log_reported(self, records: Records) -> None:
        """Log the reported impacts at their touch-downs, and their impulses at the ends of the contacts."""
        seen = detection.select_reported(records)
        if len(seen) == 0:
            return
        touch_down_s = column(seen, "t_s") - column(seen, "outputs.impact_age_s")
        self._log_dots("impacts/detected", touch_down_s, column(seen, "outputs.impact_speed_m_s"))
        if "outputs.separation" in (records.dtype.names or ()):
            seen = records[column(records, "outputs.separation") != 0.0]
        self._log_dots(
            "impacts/detected_impulse", column(seen, "t_s"), column(seen, "outputs.impact_impulse_n_s")
        )
        if self._contents.imported:  # there is no true position, and no scenario that says where the stop is
            x_m = np.interp(touch_down_s, column(records, "t_s"), column(records, "state.estimator.x_m"))
            self._log_dots("impacts/touch_down", touch_down_s, x_m)

    def _log_dots(self, entity: str, t_s: FloatArray, values: FloatArray) -> None:
        """Log points of a plot, and note their range."""
        if len(t_s):
            self.out.send(entity, t_s, rr.Scalars.columns(scalars=values))
            self._extents.add(f"/{entity}", values)

    def _log_firmware_events(self, records: Records) -> None:
        for t_s, value in self.out.find_changes("mode", records, "outputs.mode"):
            alarming = value in LATCHED
            self.out.add_event(t_s, f"mode {state_name(Mode, value)}", "ERROR" if alarming else "INFO")
        for t_s, value in self.out.find_changes("fault", records, "outputs.fault"):
            if value != Fault.NONE:
                self.out.add_event(t_s, f"latched fault {state_name(Fault, value)}", "ERROR")
        for t_s, value in self.out.find_changes("regime", records, "outputs.regime"):
            bad = value in (Regime.LOST, Regime.CHATTERING, Regime.STUCK)
            self.out.add_event(t_s, f"regime {state_name(Regime, value)}", "WARN" if bad else "INFO")
        for t_s, value in self.out.find_changes("limit", records, "outputs.acting_limit"):
            if value not in (ActingLimit.NONE, ActingLimit.SAFE_STATE):
                self.out.add_event(t_s, f"limit {state_name(ActingLimit, value)}", "WARN")

    def _log_impacts(self, records: Records) -> None:
        self.out.log_records("impacts/truth", records)
        for name in ("v_m_s", "impulse_n_s", "peak_force_n"):
            self._extents.add(f"/impacts/truth.{name}", column(records, name))
        self.drawing.draw_flashes(records)
        if self.stop_m is not None:
            t_s = column(records, "t_s")
            self.out.send("impacts/touch_down", t_s, rr.Scalars.columns(scalars=[self.stop_m] * len(t_s)))

    def _log_operator(self, records: Records) -> None:
        self.out.log_records("operator", records)
        targets = dict(zip(column(records, "t_s"), column(records, "target_ratio"), strict=True))
        for t_s, value in self.out.find_changes("request", records, "request"):
            ratio = f" at r = {targets[t_s]:g}" if value == OperatorRequest.RUN else ""
            request = state_name(OperatorRequest, value)
            self.out.add_event(t_s, f"operator asks for {request}{ratio}", "INFO")
        for t_s, value in self.out.find_changes("estop", records, "estop"):
            if value:
                self.out.add_event(t_s, "operator: emergency stop", "ERROR")

    def _log_frames(self, bus: BusLog) -> None:
        """Log the load of the bus, and the frames that cannot be decoded."""
        if len(bus.t_s) == 0:
            return
        if found := find_refused(bus):
            self._refused = True
            t_s = bus.t_s[[row for row, _ in found]]
            texts = [f"{at_s:.3f} s  {why}" for at_s, (_, why) in zip(t_s, found, strict=True)]
            self.out.send("can/rejected", t_s, rr.TextLog.columns(text=texts, level=["WARN"] * len(texts)))
        load = sum_loads((self._pending_load, bus.load))
        self._log_bus_load(BusLoad(load.tenth[:-1], load.bits[:-1]))
        self._pending_load = BusLoad(load.tenth[-1:], load.bits[-1:])

    def _log_bus_errors(self, records: Records) -> None:
        """Log the error counters and states of a modelled bus."""
        self.out.log_records("bus_errors", records)
        self.out.log_state_timelines(records, BUS_TIMELINES)
        for states in BUS_TIMELINES:
            node = states.column.partition(".")[0]
            for t_s, value in self.out.find_changes(f"events of {node}", records, states.column):
                if value != ErrorState.ERROR_ACTIVE:
                    self.out.add_event(t_s, f"bus: {node} is {state_name(ErrorState, value)}", "WARN")

    def _log_pending_load(self) -> None:
        self._log_bus_load(self._pending_load)
        self._pending_load = sum_loads(())

    def _log_bus_load(self, load: BusLoad) -> None:
        if len(load.tenth):
            self.out.send("can/load", load.middle_s, rr.Scalars.columns(scalars=load.shares))


def write_log(path: Path, traces: RunTraces, verdict: RunVerdict) -> Path:
    """Write the log of a whole run; the file gets its name when it is complete."""
    with (
        written_whole(path) as unfinished,
        closing(RunLog(unfinished, traces.run, traces.scenario, is_over=True)) as log,
    ):
        for piece in pieces(traces):
            log.append(piece)
        log.conclude(traces, verdict)
    return path


def rebuild(run_dir: Path, into: Path | None = None) -> Path:
    """Rebuild `run.rrd` from the traces of a run, in the run's folder or in another one."""
    traces = read_run(run_dir)
    if traces.damage and traces.outcome:  # the log has no other place for it
        reasons = [*traces.outcome.get("reasons", []), *traces.damage]
        traces = replace(traces, outcome={**traces.outcome, "reasons": reasons}, damage=())
    return write_log((into or run_dir) / RunFile.LOG, traces, judge(traces, run_dir))
