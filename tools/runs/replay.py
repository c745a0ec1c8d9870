"""Replays of recorded frames: what a recorded firmware received, tick by tick, into today's firmware.

A run in lockstep says when the firmware ticked: at (k + 1/2) T. Elsewhere the firmware's frame
`SetInputTorque`, which it sends first and once in each tick, divides a log into ticks. Of a run of the bench
the frames of each identifier must be equal to the bit. A log of another bench does not say when the firmware
began to count its periods, so there the decisions are compared, within stated times.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Any, Literal, NamedTuple, cast

import numpy as np

from firmware_py.interface.codec import CODEC_BY_ID
from firmware_py.interface.dbc import database
from firmware_py.interface.enums import Fault, Mode, Refusal, Regime
from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import HERE, Build, is_build
from firmware_py.shell.node import power_up
from firmware_py.shell.parameters import config_from, select_build
from hil.bus.wire import MAX_STANDARD_ID
from hil.faults.on_bus import NamedFrames
from hil.nodes.firmware.runner import ParameterMemory, controller_of
from hil.record.bus_reconstruction import latest_sent
from hil.record.candump import StoredBus
from hil.record.run_folder import read_note, refuse_irregular
from hil.run_files import RunFile
from hil.scenario.parameter_file import merge_files
from hil.scenario.scenario import Scenario, load_scenario
from plant_sim.arrays import FloatArray
from tools.exchange.foreign_logs import LoggedMessage, clock_jumps
from tools.exchange.reading import read_log
from tools.output import BadInputError

IDS = {message.name: message.frame_id for message in database().messages}
NAMES = {frame_id: name for name, frame_id in IDS.items()}
TORQUE_ID, ESTOP_ID = IDS["SetInputTorque"], IDS["DriveEstop"]
SENT_IDS = frozenset(one.frame_id for one in database().messages if "Firmware" in one.senders) - {ESTOP_ID}
"""Frames that only the firmware sends; an E-stop is the operator's, and the firmware repeats it."""
TOLERANCES_S = {"mode": 0.11, "regime": 0.11, "fault": 0.02, "refusal": 0.02, "impact": 0.005}
"""Times within which a decision of a foreign log counts as the same. A heartbeat reports mode and regime only
every 100 ms."""
STATES = ("mode", "regime")
WAIT_FOR_THE_BUS_S = 0.005
"""Longest time by which the bus of a run may deliver a frame later than the firmware sent it."""
LEAST_BITRATE = 1_000_000
"""Bits per second from which on every E-stop is on the bus within half a period of its being sent."""
BEGINNINGS = (Mode.INIT, Mode.READY)
"""Modes in which a foreign log may begin: the crank is at rest, and nothing before it matters."""
MOST_FRAMES = 3_000_000
"""Largest number of a run's frames: ten minutes of a busy bus; each takes a quarter of a kilobyte."""
MOST_TICKS = 600_000
"""Largest number of replayed ticks: ten minutes; each takes a kilobyte of memory."""
LAST_TICKS = 2
"""Frames of the last ticks may be missing in a log, which ends while they wait for the bus."""
US = 1e6
LOGS = (".log", ".asc", ".blf", ".trc", ".gz")


class RecordedTick(NamedTuple):
    """One tick of the recorded firmware: its time, and the frames that it received."""

    t_s: float
    received: list[Frame]


class StampedFrame(NamedTuple):
    """A frame on the bus, or sent by the replayed firmware, and when."""

    t_s: float
    frame: Frame


@dataclass(frozen=True)
class Decision:
    """A change of a signal, or an event: the time in s and the new value."""

    t_s: float
    value: str


@dataclass(frozen=True)
class ChangedDecision:
    """A decision that only one of the two firmwares made, or that they made differently."""

    signal: str
    recorded: Decision | None
    replayed: Decision | None


@dataclass(frozen=True)
class ChangedFrame:
    """A frame that only one of the two firmwares sent, or with other data: its time, name and bytes."""

    t_s: float
    frame: str
    recorded: str | None
    replayed: str | None


@dataclass(frozen=True)
class Replay:
    """The result of one replay, with the keys of `--json`.

    `compared`: frames of a run of the bench, or decisions of another log. `equal`: whether today's firmware
    sends, or decides, what the recorded one did; None if it does not and the log does not show all that the
    firmware received, as `reason` says, so that a difference proves nothing. `reason` also says how much of a
    run in lockstep the log shows, if it ends early.
    """

    source: str
    compared: Literal["frames", "decisions"]
    equal: bool | None
    reason: str
    ticks: int
    frames: int
    different_frames: int
    first_difference: ChangedFrame | None
    decisions: list[ChangedDecision]


def recordings(place: Path) -> list[Path]:
    """Return a recording itself, or the recordings in a folder: run folders and CAN logs, sorted by name."""
    if not place.exists():
        raise BadInputError(f"{place} is not there; wanted a run folder, a CAN log, or a folder of these")
    if not place.is_dir() or (place / RunFile.NOTE).exists() or (place / RunFile.CAN_LOG).exists():
        return [place]
    return sorted(one for one in place.iterdir() if (one / RunFile.CAN_LOG).exists() or one.suffix in LOGS)


def replay(source: Path, build: str | None = None, parameters: Sequence[Path] = ()) -> Replay:
    """Replay the folder of a run, or a log of another bench.

    `build`: by default the recorded one, on this machine; of a log `compiled`. `parameters`: parameter files
    over those of the run, or of a log over the defaults. Raises `BadInputError` where the firmware's state
    before the log's first tick cannot be known.
    """
    is_own = source.is_dir()
    if is_own:
        refuse_irregular(source)
    scenario = scenario_of(source, parameters) if is_own else None
    log = source / RunFile.CAN_LOG if is_own else source
    note = read_note(source / RunFile.NOTE) if is_own else {}
    frames = frames_of_run(log) if is_own else frames_of_log(log)
    overrides = merge_files({}, parameters) if scenario is None else scenario.parameters
    period_s = config_from(overrides).tick_s
    partly = ""
    if scenario is not None and note.get("clock") == "lockstep":
        sent, ticks = divide_on_grid(frames, period_s, scenario.ticks)
        if len(ticks) < scenario.ticks:
            partly = f"the log shows {len(ticks)} of the script's {scenario.ticks} ticks"
    else:
        sent, ticks = divide_at_torques(frames, period_s)
    if not ticks:
        raise BadInputError(
            f"{log} has no frame {NAMES[TORQUE_ID]}; wanted a log in which the firmware ticks"
        )
    recorded = decisions_of(sent)
    if scenario is None:
        refuse_unknown_beginning(log, recorded["mode"])
    faults, seed = ((), 1) if scenario is None else (scenario.faults, scenario.seed)
    hidden = "" if scenario is None else hidden_cause(scenario)
    node = power_up(
        ParameterMemory(overrides, faults, seed).read(0.0),
        select_build(overrides),
        controller_of(build or recorded_build(note)).make_node,
    )
    replayed = [StampedFrame(tick.t_s, frame) for tick in ticks for frame in node.tick(tick.received, 1)]
    changed_frames = compare_frames(sent, replayed, ticks[-min(LAST_TICKS, len(ticks))].t_s)
    changed = compare_decisions(recorded, decisions_of(replayed), is_own)
    equal = not changed and not (is_own and changed_frames)
    proves_nothing = bool(hidden) and not equal
    return Replay(
        source=str(source),
        compared="frames" if is_own else "decisions",
        equal=None if proves_nothing else equal,
        reason=hidden if proves_nothing else partly,
        ticks=len(ticks),
        frames=len(sent),
        different_frames=len(changed_frames),
        first_difference=min(changed_frames, key=lambda one: one.t_s, default=None),
        decisions=changed,
    )


def recorded_build(note: Mapping[str, Any]) -> Build:
    """The build on this machine that computes as the recorded one; `note`: the content of run.json.

    Raises BadInputError for a user's own controller: a file that a run folder names is not run unasked.
    """
    recorded = str(note.get("firmware", "compiled"))
    if not is_build(recorded):
        raise BadInputError(
            f"the run's controller was {recorded}, not the firmware; give --firmware FILE.py:FUNCTION"
        )
    build = cast(Build, recorded)
    return HERE.get(build, build)


def frames_of_run(log: Path) -> list[StampedFrame]:
    """The frames of a run's can.log; BadInputError for more than MOST_FRAMES, or for other lines."""
    bus = StoredBus(log)
    frames: list[StampedFrame] = []
    for piece in bus.pieces():
        if len(frames) + len(piece.t_s) > MOST_FRAMES:
            raise BadInputError(f"{log} holds more than {MOST_FRAMES:,} frames, which are not replayed")
        columns = zip(piece.t_s.tolist(), piece.can_id.tolist(), piece.payloads, strict=True)
        frames += (
            StampedFrame(t_s, Frame(can_id, data))
            for t_s, can_id, data in columns
            if can_id <= MAX_STANDARD_ID
        )
    if bus.lines > bus.frames:
        raise BadInputError(f"{log} has {bus.lines - bus.frames} lines that no run writes")
    return frames


def frames_of_log(log: Path) -> list[StampedFrame]:
    """The frames of another bench's log, whose clock must not jump."""
    messages = [message for message in read_log(log).messages if message.kind is None]
    refuse_jumps(log, messages)
    return [StampedFrame(message.t_s, Frame(message.can_id, message.data)) for message in messages]


def scenario_of(folder: Path, parameters: Sequence[Path]) -> Scenario:
    """Return the scenario of a run folder."""
    missing = [
        name for name in (RunFile.CAN_LOG, RunFile.SCENARIO, RunFile.NOTE) if not (folder / name).exists()
    ]
    if missing:
        log = folder / RunFile.CAN_LOG
        remedy = f"replay {log} instead" if log.exists() else "wanted the folder of a run, or a CAN log"
        raise BadInputError(f"{folder} has no {missing[0]}; {remedy}")
    return load_scenario(folder / RunFile.SCENARIO, (), parameters)


def hidden_cause(scenario: Scenario) -> str:
    """Say which fault the log does not show, or which modelled bus is too slow; empty without one."""
    if scenario.bitrate is not None and scenario.bitrate < LEAST_BITRATE:
        return f"a modelled bus of {scenario.bitrate} bit/s delays frames by more than half a period"
    for fault in scenario.faults:
        own = isinstance(fault, NamedFrames) and {IDS[name] for name in fault.frames} & {*SENT_IDS, ESTOP_ID}
        if fault.is_beyond_log or own:
            return f"the injected fault {fault.kind} at {fault.at_s:g} s acts on what the log does not show"
    return ""


def divide_on_grid(
    frames: Sequence[StampedFrame], period_s: float, count: int
) -> tuple[list[StampedFrame], list[RecordedTick]]:
    """Divide the log of a run in lockstep, whose firmware ticks at (k + 1/2) T, into its ticks.

    An E-stop in the second half of a period is the firmware's: it precedes all other frames on the bus, and
    the operator sends at the beginning of a period. A log that ends early has fewer than `count` ticks.
    """
    period_us = round(period_s * US)
    refuse_long(count)
    seen = max((math.ceil(one.t_s / period_s) for one in frames), default=0)
    count = min(count, seen)
    ticks = [RecordedTick((k + 0.5) * period_s, []) for k in range(count)]
    sent: list[StampedFrame] = []
    for one in frames:
        t_us = round(one.t_s * US)
        tick = max(math.ceil((2 * t_us - period_us) / (2 * period_us)), 0)
        is_late = 2 * (t_us % period_us) >= period_us
        if one.frame.can_id in SENT_IDS or (one.frame.can_id == ESTOP_ID and is_late):
            sent.append(one)
        elif tick < count:
            ticks[tick].received.append(one.frame)
    return sent, ticks


def divide_at_torques(
    frames: Sequence[StampedFrame], period_s: float
) -> tuple[list[StampedFrame], list[RecordedTick]]:
    """Divide a log at the firmware's torque frames; ticks that sent none are filled in at equal intervals."""
    torques_s = np.array([one.t_s for one in frames if one.frame.can_id == TORQUE_ID])
    missed = iter(periods_before(torques_s, period_s))
    ticks: list[RecordedTick] = []
    sent: list[StampedFrame] = []
    waiting: list[StampedFrame] = []
    follows = False
    for one in frames:
        can_id = one.frame.can_id
        if can_id == TORQUE_ID:
            before_s = ticks[-1].t_s if ticks else one.t_s - period_s
            ticks += fill_in(before_s, one.t_s, next(missed), waiting)
            refuse_long(len(ticks))
            waiting = []
        if can_id in SENT_IDS or (can_id == ESTOP_ID and follows):
            sent.append(one)
            follows = True
        else:
            waiting.append(one)
            follows = False
    return sent, ticks


def periods_before(t_s: FloatArray, period_s: float) -> list[int]:
    """Whole periods from the frame before to each of the frames that the firmware sends once in a period."""
    periods = np.clip(np.rint(np.diff(latest_sent(t_s, period_s)) / period_s), 1, MOST_TICKS + 1)
    return [1, *map(int, periods)]


def refuse_long(ticks: int) -> None:
    """Raise BadInputError for more ticks than are replayed."""
    if ticks > MOST_TICKS:
        raise BadInputError(f"the recording has {ticks} ticks or more; at most {MOST_TICKS} are replayed")


def fill_in(
    before_s: float, t_s: float, count: int, waiting: Sequence[StampedFrame]
) -> Iterator[RecordedTick]:
    """Yield the `count` ticks after `before_s` up to `t_s`, each with the frames that had arrived."""
    refuse_long(count)
    given = 0
    for number in range(1, count + 1):
        until_s = math.inf if number == count else before_s + number * (t_s - before_s) / count
        first = given
        while given < len(waiting) and waiting[given].t_s <= until_s:
            given += 1
        yield RecordedTick(min(until_s, t_s), [one.frame for one in waiting[first:given]])


def compare_frames(
    recorded: Sequence[StampedFrame], replayed: Sequence[StampedFrame], end_s: float
) -> list[ChangedFrame]:
    """Compare the frames of each identifier; the bus may deliver the identifiers in another order.

    From `end_s` on the record may lack frames.
    """
    changed = []
    for can_id in sorted({one.frame.can_id for one in (*recorded, *replayed)}):
        pairs = zip_longest(
            *([one for one in all_of if one.frame.can_id == can_id] for all_of in (recorded, replayed))
        )
        for one, other in pairs:
            if one is None and other.t_s >= end_s:
                continue
            if one is None or other is None or one.frame != other.frame:
                data = (None if sent is None else sent.frame.data.hex().upper() for sent in (one, other))
                changed.append(ChangedFrame((one or other).t_s, NAMES[can_id], *data))
    return changed


def decisions_of(frames: Sequence[StampedFrame]) -> dict[str, list[Decision]]:
    """Return the changes of mode and regime, and the events, in frames that a firmware sent."""
    found: dict[str, list[Decision]] = {signal: [] for signal in TOLERANCES_S}

    def note(signal: str, t_s: float, value: str, is_event: bool = False) -> None:
        if is_event or not found[signal] or found[signal][-1].value != value:
            found[signal].append(Decision(t_s, value))

    for t_s, frame in frames:
        name = NAMES[frame.can_id]
        if name not in ("FirmwareHeartbeat", "ImpactEvent", "FaultEvent"):
            continue
        try:
            record: Any = CODEC_BY_ID[frame.can_id].decode(frame.data)
        except ValueError:
            continue  # damaged on the bus; its bytes are compared with the replayed frame's
        if name == "FirmwareHeartbeat":
            note("mode", t_s, Mode(record.mode).name)
            note("regime", t_s, Regime(record.regime).name)
        elif name == "ImpactEvent":
            note("impact", t_s, "impact", is_event=True)
        elif record.fault:
            note("fault", t_s, Fault(record.fault).name, is_event=True)
        elif record.refusal:
            note("refusal", t_s, Refusal(record.refusal).name, is_event=True)
    return found


def compare_decisions(
    recorded: Mapping[str, list[Decision]], replayed: Mapping[str, list[Decision]], is_own: bool
) -> list[ChangedDecision]:
    """Return for each signal the first decision that is not the same; later ones follow from it.

    A foreign log begins at an unknown time after power-up: the firmware's first mode and regime have no time
    of their own there, and INIT may be over.
    """
    changed = []
    for signal, tolerance_s in TOLERANCES_S.items():
        allowed_s = WAIT_FOR_THE_BUS_S if is_own else tolerance_s
        is_state = signal in STATES and not is_own
        lists = [drop_init(one[signal]) if is_state else one[signal] for one in (recorded, replayed)]
        for number, (one, other) in enumerate(zip_longest(*lists)):
            within_s = math.inf if is_state and number == 0 else allowed_s
            if not (one and other and one.value == other.value and abs(one.t_s - other.t_s) <= within_s):
                changed.append(ChangedDecision(signal, one, other))
                break
    return changed


def drop_init(decisions: list[Decision]) -> list[Decision]:
    """Return the decisions without a mode INIT at their beginning."""
    return decisions[1:] if decisions and decisions[0].value == Mode.INIT.name else decisions


def refuse_jumps(log: Path, messages: Sequence[LoggedMessage]) -> None:
    """Raise BadInputError for a log whose clock jumps."""
    jumps = clock_jumps(messages)
    if jumps:
        raise BadInputError(
            f"{log}: the clock jumps from {jumps[0].from_s:.3f} to {jumps[0].to_s:.3f} s at line "
            f"{jumps[0].place}, and what the firmware received in between is not known; replay one part alone"
        )


def refuse_unknown_beginning(log: Path, modes: Sequence[Decision]) -> None:
    """Raise BadInputError for a log that begins in the middle of a motion."""
    if not modes or modes[0].value not in {mode.name for mode in BEGINNINGS}:
        first = modes[0].value if modes else "that no heartbeat reports"
        wanted = " or ".join(mode.name for mode in BEGINNINGS)
        raise BadInputError(
            f"{log} begins in mode {first}; wanted {wanted}, before the crank turns, because the state of "
            "the firmware before the log cannot be known"
        )
