"""Real time beside stalls of the host: lockstep's frames in lockstep's order, whatever process is late."""

import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can
import pytest
from fuzzing.kill import signalled
from host import stop

from hil.faults.kinds.restarted import Restarted
from hil.record.run_traces import read_json
from hil.record.traces import trace
from hil.runs.bench import run_scenario
from hil.runs.job import RunOptions, silent
from hil.scenario.scenario import Scenario, load_scenario
from hil.scenario.settings import Settings

QUICK = [
    "script.duration_s=3.0",
    'script.commands=[{at_s=0.2,request="run",target_ratio=1.1},{at_s=2.6,request="idle"}]',
    "firmware.start.rise_s=1.0",
]
STALLS = (("plant", 0.005), ("firmware", 0.2), ("hub", 0.03), ("operator", 0.09), ("plant", 0.06))


def quick(*more: str) -> Scenario:
    settings: Settings = [*QUICK, *more]
    return load_scenario("soft-start-multistable", settings)


def run(folder: Path, clock: Any = "real", scenario: Scenario | None = None) -> dict[str, Any]:
    return run_scenario(
        scenario or quick(), RunOptions(clock=clock, bus="local"), folder, 1, silent
    ).as_json()


@pytest.fixture(scope="module")
def lockstep(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    folder = tmp_path_factory.mktemp("lockstep") / "run"
    run(folder, "lockstep")
    return (folder / "can.log").read_bytes()


def joined(pids: dict[str, int]) -> can.BusABC:
    """The bus of the run, whose address its recorder has on its command line."""
    command = Path(f"/proc/{pids['recorder']}/cmdline").read_text().split("\0")
    address = command[command.index("--bus") + 1]
    return can.Bus(address.removeprefix("local:"), "vibrohil")


@contextmanager
def beside(disturb: Any, folder: Path) -> Iterator[None]:
    """Call `disturb` in a thread with the run's process numbers, as soon as a frame shows that time runs."""

    def watch() -> None:
        until_s = time.monotonic() + 120.0
        while "t0_ns" not in read_json(folder / "run.json"):
            assert time.monotonic() < until_s, "the run did not begin"
            time.sleep(0.01)
        pids = read_json(folder / "processes.json")
        with joined(pids) as bus:
            assert bus.recv(120.0) is not None
        disturb(pids)

    with ThreadPoolExecutor(1) as thread:
        disturbed = thread.submit(watch)
        yield
    disturbed.result()


@pytest.mark.realtime
def test_stalls_of_any_process_and_a_listener_change_no_frame_and_are_reported(
    tmp_path: Path, lockstep: bytes
) -> None:
    """Frames of a stranger are counted."""
    received: list[can.Message] = []

    def disturb(pids: dict[str, int]) -> None:
        with joined(pids) as bus:
            for number in range(3):
                bus.send(can.Message(arbitration_id=0x7F0 + number, is_extended_id=False))
            stop([(pids[name], lasts_s) for name, lasts_s in STALLS])
            while (message := bus.recv(0.0)) is not None:
                received.append(message)

    with beside(disturb, tmp_path):
        verdict = run(tmp_path)
    assert verdict["reasons"] == verdict["not_judged"] == []
    lines = (tmp_path / "can.log").read_bytes().splitlines()
    assert [line for line in lines if b" can0 7F" not in line] == lockstep.splitlines()
    assert verdict["log"]["frames_foreign"] == 3
    assert len(received) > 100
    # A process that waits for its turn is missed when the turn is due: the operator's within 10 ms.
    assert verdict["held_s"] > sum(duration_s for _, duration_s in STALLS) - 0.02
    assert max(hold["held_s"] for hold in verdict["time_held"]) > 0.19
    assert verdict["real_time"] is False
    assert verdict["overruns"] == 0


@pytest.mark.realtime
@pytest.mark.parametrize(
    "faults",
    [
        (
            '{kind="clock-jitter",at_s=0.5,process="firmware",largest_s=0.002}',
            '{kind="clock-jumped",at_s=1.0,by_s=0.02}',
            '{kind="paused",at_s=1.6,duration_s=0.4,process="firmware"}',
            '{kind="killed",at_s=2.4,process="firmware"}',
        ),
        (
            '{kind="clock-jitter",at_s=0.5,process="firmware",largest_s=0.002}',
            '{kind="corrupted",at_s=0.5,duration_s=2.0,frames=["FirmwareHeartbeat"],share=0.5}',
            '{kind="restarted",at_s=1.2,duration_s=0.6,process="firmware"}',
            '{kind="babbling",at_s=0.5,period_s=0.003,can_id=5,data_hex="00"}',
            '{kind="delayed",at_s=0.5,duration_s=2.4,frames=["Accelerometer"],delay_s=0.003}',
            '{kind="sensor-noisy",at_s=0.5,duration_s=2.4,sensor="striker",std=1.0}',
            '{kind="restarted",at_s=2.0,duration_s=0.3,process="plant"}',
            '{kind="paused",at_s=2.6,duration_s=9.0,process="plant"}',
            '{kind="paused",at_s=2.8,duration_s=9.0,process="firmware"}',
        ),
    ],
    ids=["clocks, paused and killed", "restarted beside random faults and paused for ever"],
)
def test_faults_of_processes_and_clocks_act_as_in_lockstep(tmp_path: Path, faults: tuple[str, ...]) -> None:
    scenario = quick(f"script.faults=[{','.join(faults)}]")
    for clock in ("lockstep", "real"):
        verdict = run(tmp_path / clock, clock, scenario)
        assert verdict["reasons"] == verdict["not_judged"] == []
    # A process that is stopped counts nothing itself.
    assert {one["acted_on"] for one in verdict["faults"] if one["kind"] == "paused"} == {None}
    lockstep, real = tmp_path / "lockstep", tmp_path / "real"
    assert (lockstep / "can.log").read_bytes() == (real / "can.log").read_bytes()
    for name in ("plant.trace", "firmware.trace"):
        assert trace.read(lockstep / name)["tick"].tolist() == trace.read(real / name)["tick"].tolist()
    restarted = {f"{fault.process}-again" for fault in scenario.faults if isinstance(fault, Restarted)}
    assert set(read_json(real / "run.json")["realtime"]) == {"firmware", "plant", *restarted}
    pids = read_json(real / "processes.json")
    assert not any(Path(f"/proc/{pid}").exists() for name, pid in pids.items() if name != "operator")


@pytest.mark.realtime
def test_a_process_that_stays_stopped_ends_the_run_without_a_judgement(tmp_path: Path) -> None:
    with beside(lambda pids: signalled(pids["firmware"], signal.SIGSTOP), tmp_path):
        verdict = run(tmp_path)
    assert verdict["verdict"] == "not-judged"
    (reason,) = verdict["not_judged"]
    assert reason.startswith("the host held up the firmware for more than 10 s at ")
    assert verdict["reasons"] == []
    assert not any(check["verdict"] == "failed" for check in verdict["checks"])
    assert not Path(f"/proc/{read_json(tmp_path / 'processes.json')['firmware']}").exists()


@pytest.mark.realtime
@pytest.mark.quiet
def test_strict_time_misses_periods_and_judges_nothing_that_a_stall_touched(tmp_path: Path) -> None:
    with beside(lambda pids: stop([(pids["plant"], 0.05)]), tmp_path):
        verdict = run_scenario(quick(), RunOptions(bus="local", time="strict"), tmp_path, 1, silent).as_json()
    assert verdict["held_s"] is None
    assert verdict["overruns"] >= 40
    long = [gap["process"] for gap in verdict["gaps"] if gap["to_s"] - gap["from_s"] > 0.04]
    assert "plant" in long  # the host itself may pause any process at another time
    by_name = {check["name"]: check["verdict"] for check in verdict["checks"]}
    assert by_name["fault"] == "not-judged"
    assert verdict["verdict"] != "passed"
