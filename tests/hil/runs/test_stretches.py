"""Stretches of lockstep in one compiled call: to the same bits as tick by tick, and where they may be."""

import random
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from firmware_py.interface.frame import Frame
from hil.bus.frame_rows import word_frame
from hil.bus.log import candump_lines
from hil.bus.log.can_log import CanLog
from hil.faults.every import KINDS
from hil.faults.on_bus import FramesFault
from hil.nodes.closed_loop import BUS_AFTER, BUS_BEFORE
from hil.record.run_traces import read_bus
from hil.record.traces import trace
from hil.runs import compiled
from hil.runs.job import Job
from hil.runs.recording import record
from hil.scenario.files import read_scenario
from hil.scenario.scenario import Scenario, check_scenario
from hil.scenario.settings import apply_settings
from plant_sim.solvers.adaptive.adaptive import STEP_TOO_SMALL
from plant_sim.solvers.cost import SolverError

SETTINGS = [
    "script.duration_s=4.0",
    "scene.sensors.coarse.noise_m=0.002",
    'script.commands=[{at_s=0.2,request="run",target_ratio=1.1},{at_s=3.001,request="e-stop"},'
    '{at_s=3.005,request="clear-faults"}]',
    "firmware.start.rise_s=1.0",
]
STIFFER = {"kind": "stiffness-changed", "at_s": 1.0, "factor": 1.1}
KICK = {"kind": "kick", "at_s": 1.2003, "change_m_s": 0.4}
NOISY = {"kind": "sensor-noisy", "at_s": 1.6, "duration_s": 0.2, "sensor": "striker-low", "std": 1.0}
PAUSED = {"kind": "paused", "at_s": 2.2, "duration_s": 0.01, "process": "firmware"}
PLANT_AWAY = {"kind": "restarted", "at_s": 2.2, "duration_s": 0.2, "process": "plant"}
FIRMWARE_AWAY = {"kind": "restarted", "at_s": 1.2, "duration_s": 0.2, "process": "firmware"}
SHAKEN = {"kind": "clock-jitter", "at_s": 0.5, "duration_s": 0.1, "process": "firmware", "largest_s": 0.0025}
PLANT_SHAKEN = {"kind": "clock-jitter", "at_s": 0.5, "duration_s": 0.1, "process": "plant", "largest_s": 4e-4}
LEAPT = {"kind": "clock-jumped", "at_s": 3.4, "by_s": 0.5}
OPERATOR_AWAY = {"kind": "unplugged", "at_s": 0.584, "duration_s": 0.4548, "node": "operator"}
THERE_AND_BACK = {"kind": "clock-jumped", "at_s": 1.0, "by_s": 0.6, "duration_s": 0.3}
"""The firmware has no turn while its clock falls back; its frames wait longer than a stretch does."""
BETWEEN_PERIODS = tuple(
    {"kind": kind, "frames": ["SetInputTorque"], "at_s": 0.8, "period_s": 0.05, "duration_s": 0.6}
    for kind in ("thinned", "bundled")
)
"""Frames whose period begins while their sender has no turn."""
LONG_PAUSE = {**PAUSED, "at_s": 1.0, "duration_s": 0.2}
UNPLUGGED = {"kind": "unplugged", "node": "firmware", "at_s": 1.15, "duration_s": 0.2}
"""The firmware is unplugged before it takes the frames that have arrived in its pause."""
REPORTS = ["StrikerEstimate", "FirmwareHeartbeat", "SetInputTorque", "RegimeReport"]
CAUGHT_UP = (
    {**PAUSED, "at_s": 0.1, "duration_s": 0.48},
    {"kind": "duplicated", "frames": REPORTS, "copies": 100, "at_s": 0.58, "duration_s": 0.01},
    *(
        {
            "kind": "dropped",
            "frames": ["Accelerometer"],
            "at_s": round(0.04 + 0.06 * number, 3),
            "duration_s": 0.02,
        }
        for number in range(10)
    ),
    {"kind": "dropped", "frames": ["Accelerometer"], "at_s": 0.581, "share": 0.1},
)
"""Half a second is run in the one tick of a stretch, after short stretches."""


CLIENT = {
    "kind": "babbling",
    "can_id": 9,
    "data_hex": "",
    "period_s": 1e-3,
    "at_s": 0.5,
    "duration_s": 0.02,
}
"""Requests of the drive's encoder sample."""


BASE = "soft-start-multistable"


def scenario_with(*faults: dict[str, Any], base: str = BASE, **tables: Any) -> Scenario:
    document = {**apply_settings(read_scenario(base), SETTINGS), **tables}
    document["script"]["faults"] = list(faults)
    return check_scenario(document, "in-stretches")


WALK = "a-steady-walk-has-a-pulse-in-every-push-off"

ANY: list[dict[str, Any]] = [
    {"kind": "dropped", "frames": ["EncoderEstimates"], "share": 0.5},
    {"kind": "delayed", "frames": ["SetInputTorque"], "delay_s": 0.03},
    {"kind": "delayed", "frames": ["OperatorCommand"], "delay_s": 0.3},
    {"kind": "bundled", "frames": ["Accelerometer", "EncoderEstimates"], "period_s": 0.008},
    {"kind": "thinned", "frames": ["Accelerometer"], "period_s": 0.004},
    {"kind": "reordered", "frames": ["Accelerometer"]},
    *({"kind": "unplugged", "node": node} for node in ("plant", "firmware", "operator")),
    {"kind": "flood", "frames_a_tick": 2},
    {"kind": "sensor-stuck", "sensor": "striker"},
    {"kind": "sensor-slow", "sensor": "encoder", "lag_s": 0.02},
    {"kind": "encoder-wrap", "count_rev": 10},
    {"kind": "torque-stuck", "torque_n_m": 0.1},
    {"kind": "phase-loss"},
    *({"kind": "paused", "process": process} for process in ("plant", "firmware")),
    {"kind": "clock-jitter", "process": "firmware", "largest_s": 8e-4},
    {"kind": "clock-jumped", "by_s": 0.05},
]


SENT = ["Accelerometer", "EncoderEstimates", "SetInputTorque", "DriveHeartbeat", "OperatorCommand"]
NAMED: dict[str, dict[str, Any]] = {
    "bundled": {"period_s": 0.0043},
    "corrupted": {"share": 0.02},
    "delayed": {"delay_s": 0.0031},
    "dropped": {"share": 0.1},
    "duplicated": {"copies": 40},
    "frozen": {},
    "reordered": {},
    "thinned": {"period_s": 0.0027},
}
"""Kinds of faults that act on frames that they name, with their keys."""


FROM_THE_FIRST_TICK = ("thinned", "bundled")
"""Kinds that count the sender's periods."""


def frames_fault(kind: str, ends: bool) -> dict[str, Any]:
    frames = ["DriveHeartbeat", "FirmwareHeartbeat", "SetInputTorque"] if kind == "frozen" else SENT
    until = {"duration_s": 0.9313} if ends else {}
    return {"kind": kind, "frames": frames, "at_s": 0.8004, **NAMED[kind], **until}


def test_every_kind_of_fault_of_named_frames_is_compared() -> None:
    assert {
        one.model_fields["kind"].annotation.__args__[0] for one in KINDS if issubclass(one, FramesFault)
    } == set(NAMED)


def random_faults(seed: int) -> tuple[dict[str, Any], ...]:
    """Three faults of any kinds, at ticks or within them, for some ticks or some tenths of a second."""
    dice = random.Random(seed)
    return tuple(
        {
            **kind,
            "at_s": round(dice.uniform(0.3, 3.4), dice.choice((3, 4))),
            "duration_s": round(dice.uniform(0.002, dice.choice((0.05, 0.4))), 4),
        }
        for kind in dice.sample(ANY, 3)
    )


@pytest.mark.parametrize(
    ("base", "faults"),
    [
        (BASE, ()),
        (BASE, (STIFFER, KICK, NOISY, PAUSED)),
        (BASE, (SHAKEN, PLANT_SHAKEN, FIRMWARE_AWAY, PLANT_AWAY, LEAPT)),
        (BASE, (THERE_AND_BACK,)),
        (BASE, (OPERATOR_AWAY,)),
        (BASE, (FIRMWARE_AWAY, {**PAUSED, "at_s": 1.1, "duration_s": 0.15})),
        *((BASE, (one, {**LONG_PAUSE, "duration_s": 0.0603})) for one in BETWEEN_PERIODS),
        (BASE, (LONG_PAUSE, UNPLUGGED)),
        (BASE, CAUGHT_UP),
        (WALK, ()),
        (WALK, (PLANT_AWAY,)),
        *((BASE, random_faults(seed)) for seed in range(12)),
        *((BASE, (frames_fault(kind, ends),)) for kind in NAMED for ends in (False, True)),
        *((BASE, ({**frames_fault(kind, False), "at_s": 0.0},)) for kind in FROM_THE_FIRST_TICK),
        (BASE, (frames_fault("delayed", False), frames_fault("duplicated", True), STIFFER, PAUSED)),
        (WALK, ({"kind": "dropped", "frames": ["GaitSensors"], "share": 0.3, "at_s": 1.0},)),
        (BASE, (CLIENT,)),
    ],
    ids=[
        "undisturbed",
        "disturbed",
        "clocks-and-restarts",
        "there-and-back",
        "operator-away",
        "restarted-while-paused",
        "thinned-while-paused",
        "bundled-while-paused",
        "unplugged-while-paused",
        "caught-up-in-a-tick",
        "walking",
        "walking-restarted",
        *(f"random {seed}" for seed in range(12)),
        *(f"{kind} {end}" for kind in NAMED for end in ("to the end", "for a while")),
        *(f"{kind} from the first tick" for kind in FROM_THE_FIRST_TICK),
        "late-and-copied",
        "walking-without-steps",
        "asked-by-a-client",
    ],
)
def test_stretches_record_the_same_bytes_as_lockstep_tick_by_tick(
    base: str, faults: tuple[dict[str, Any], ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = scenario_with(*faults, base=base)
    lengths = stretches_like_single_ticks(scenario, tmp_path, monkeypatch)
    assert sum(lengths) > (0.5 if faults else 0.99) * scenario.ticks


BUS_OFF = {"kind": "bus-off", "node": "firmware", "at_s": 1.2003, "duration_s": 0.01}
DISTURBED = {"kind": "disturbed", "frames": ["Accelerometer"], "at_s": 1.6, "duration_s": 0.004}
BABBLING = {"kind": "babbling", "can_id": 0, "period_s": 4e-4, "at_s": 2.2, "duration_s": 0.02}


@pytest.mark.parametrize(
    ("base", "faults", "share"),
    [
        (BASE, (), 0.99),
        (BASE, (STIFFER, KICK, NOISY, PAUSED), 0.9),
        (BASE, (BUS_OFF, DISTURBED, BABBLING), 0.9),
        (BASE, (FIRMWARE_AWAY, BUS_OFF, LEAPT), 0.5),
        *((BASE, random_faults(seed), 0.5) for seed in range(12, 18)),
        (BASE, (frames_fault("delayed", True), frames_fault("duplicated", True)), 0.5),
        (BASE, ({**CLIENT, "at_s": 0.5004},), 0.9),
        (WALK, (), 0.9),
        (WALK, (DISTURBED, BUS_OFF), 0.9),
    ],
    ids=[
        "undisturbed",
        "disturbed",
        "bus-off-disturbed-babbling",
        "restarted-off-and-ahead",
        *(f"random {seed}" for seed in range(12, 18)),
        "late-and-copied",
        "asked-by-a-client",
        "walking",
        "walking-disturbed",
    ],
)
def test_so_they_do_on_a_bus_on_which_frames_take_time(
    base: str,
    faults: tuple[dict[str, Any], ...],
    share: float,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Python runs the bus in ticks in which not all frames come before the firmware's turn."""
    scenario, crowded = scenario_with(*faults, base=base, bus={"bitrate": 1_000_000}), Counter[int]()
    pass_half = compiled.pass_half

    def counted(bus: Any, joined: Any, transit: Any, edges_ns: Any, which: int, *others: Any) -> int:
        end = pass_half(bus, joined, transit, edges_ns, which, *others)
        crowded["late"] += which == BUS_BEFORE and not bus.is_at_rest
        crowded[which] += 1
        return end

    monkeypatch.setattr(compiled, "pass_half", counted)
    lengths = stretches_like_single_ticks(scenario, tmp_path, monkeypatch)
    assert sum(lengths) > share * scenario.ticks
    assert 0 < crowded["late"] <= crowded[BUS_BEFORE] == crowded[BUS_AFTER] < 0.2 * scenario.ticks


@pytest.mark.parametrize(
    ("tick_s", "bitrate"),
    [(0.002, 500_000), (0.0010005, 1_000_000), (0.0011, 781_250), (0.001000003, 1_000_000)],
)
def test_so_they_do_at_periods_that_are_no_whole_bits(
    tick_s: float, bitrate: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = [f"firmware.control.tick_s={tick_s}", "script.duration_s=1.0", "script.commands=[]"]
    document = apply_settings(read_scenario(BASE), settings) | {"bus": {"bitrate": bitrate}}
    lengths = stretches_like_single_ticks(check_scenario(document, "of-other-periods"), tmp_path, monkeypatch)
    assert sum(lengths) > 0.9 / tick_s


def test_so_they_do_at_an_odd_period_without_a_modelled_bus(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = ["firmware.control.tick_s=0.001000003", "script.duration_s=1.0", "script.commands=[]"]
    document = apply_settings(read_scenario(BASE), settings)
    stretches_like_single_ticks(check_scenario(document, "of-an-odd-period"), tmp_path, monkeypatch)


def test_a_slow_bus_has_no_stretches_of_all_nodes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 500 kbit/s, on which half a period has no time for three frames."""
    scenario = scenario_with(bus={"bitrate": 500_000})
    assert stretches_like_single_ticks(scenario, tmp_path, monkeypatch) == []


def stretches_like_single_ticks(
    scenario: Scenario, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> list[int]:
    """Run in stretches and tick by tick, and compare all bytes; the stretches' lengths."""
    lengths: list[int] = []
    run = compiled.Stretches.run

    def counted(self: compiled.Stretches, tick: int, ticks: int) -> int:
        lengths.append(ticks)
        return run(self, tick, ticks)

    monkeypatch.setattr(compiled.Stretches, "run", counted)
    folders = tmp_path / "in-stretches", tmp_path / "tick-by-tick"
    acted = []
    for folder in folders:
        folder.mkdir()
        job = Job(scenario, 1, folder=folder)
        record(job)
        pairs = zip(scenario.faults, job.outcome.faults_acted, strict=True)
        # The count of an unplugged node has frames that it does not take, of which stretches keep none.
        acted.append([count for fault, count in pairs if fault.kind != "unplugged"])
        monkeypatch.setattr(compiled.Stretches, "advance", lambda *_: 0)
    assert acted[0] == acted[1]
    ours, wanted = ((folder / "can.log").read_bytes() for folder in folders)
    assert ours == wanted
    errors = () if scenario.bitrate is None else ("bus_errors",)
    for name in ("plant", "impacts", "operator", "firmware", *errors):
        one, other = (trace.read(folder / f"{name}.trace") for folder in folders)
        assert len(one) == len(other)
        for column in one.dtype.names or ():
            if column != "work_us":
                np.testing.assert_array_equal(one[column], other[column], err_msg=f"{name}: {column}")
    return lengths


def test_memory_is_kept_for_the_copies_of_one_frame() -> None:
    """Faults of different frames do not multiply; those of one frame do."""
    frames = ("Accelerometer", "EncoderEstimates", "SetInputTorque")
    faults = [{"kind": "duplicated", "frames": [one], "at_s": 0.0, "copies": 100} for one in frames]
    scenario = scenario_with(*faults)
    assert compiled.most_copies(scenario.faults) == 100
    twice = scenario_with(*faults, {**faults[0], "copies": 2})
    assert compiled.most_copies(twice.faults) == 200 > compiled.MOST_COPIES


def test_what_was_recorded_before_a_failure_is_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    entry_point = compiled.entry_point

    def failing(*arguments: Any) -> Any:
        run = entry_point(*arguments)

        def failing_run(bench: Any, state: Any, _: int) -> tuple[Any, int]:
            return run(bench, state, 100)[0], STEP_TOO_SMALL

        return failing_run

    monkeypatch.setattr(compiled, "entry_point", failing)
    with pytest.raises(SolverError, match="no step is small enough"):
        record(Job(scenario_with(), 1, folder=tmp_path))
    for name in ("plant", "firmware"):
        assert trace.read(tmp_path / f"{name}.trace")["tick"].tolist() == list(range(100))
    assert read_bus(tmp_path / "can.log").t_s[-1] == pytest.approx(0.0995)


def test_lines_of_the_log_are_those_of_can_log(tmp_path: Path) -> None:
    dice = random.Random(1)
    frames = [
        (dice.randrange(10 ** dice.randrange(1, 11)), Frame(dice.randrange(0x800), dice.randbytes(length)))
        for length in [*range(9)] * 20
    ]
    with CanLog(tmp_path / "can.log") as log:
        for t_us, frame in frames:
            log.write(t_us, [frame])
    rows = np.array([(t_us, *word_frame(frame)) for t_us, frame in frames])
    assert candump_lines.lines_of(rows) == (tmp_path / "can.log").read_bytes()
