"""The test of the drive's watchdog, tick by tick, on a drive that reports its axis every 100 ms."""

import itertools
from pathlib import Path

import pytest

from firmware_py.core.inputs import DriveInput
from firmware_py.core.safety import watchdog_proof
from firmware_py.core.safety.watchdog_proof import CLEAR, CLOSE, REST, WITHHOLD, ProofState
from firmware_py.interface.enums import AxisError, AxisState, Mode
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
EXPIRED = AxisError.WATCHDOG_TIMER_EXPIRED.value


class Drive:
    """A drive whose axis closes 42 ms after the test has begun, and is disarmed `watchdog_ms` after the last
    frame; it reports its state every `beat_ms`, for the first time after `first_ms`, and where it is `uneven`
    every second time a tick later.
    """

    def __init__(
        self, watchdog_ms: int, beat_ms: int, first_ms: int, error: int = EXPIRED, uneven: bool = False
    ) -> None:
        self.uneven = uneven
        self.watchdog_ms, self.beat_ms, self.first_ms, self.error = watchdog_ms, beat_ms, first_ms, error
        self.state, self.errors, self.age_ms, self.clear_ms = AxisState.IDLE, 0, 0, 0
        self.seen = DriveInput(AxisState.IDLE, 0, 0, 50)

    def tick(self, ms: int, stage: int) -> DriveInput:
        """What the firmware knows of the drive in this tick; `stage`: in the previous tick."""
        if stage == CLOSE and ms == 42:
            self.state = AxisState.CLOSED_LOOP_CONTROL
        self.age_ms = self.age_ms + 1 if stage == WITHHOLD else 0
        # The last frame has fed it in the tick after it left; from the tick after its end it reports the end.
        if self.age_ms >= self.watchdog_ms and self.state != AxisState.IDLE:
            self.state, self.errors = AxisState.IDLE, self.error
        if stage == CLEAR:
            self.errors = 0
        self.seen = self.seen._replace(age_ticks=self.seen.age_ticks + 1)
        number, phase_ms = divmod(ms - self.first_ms % self.beat_ms, self.beat_ms)
        if phase_ms == (number % 2 if self.uneven else 0):
            self.seen = DriveInput(self.state, self.errors, 0, 0)
        return self.seen


def run(drive: Drive, omega_rad_s: float = 0.0, longest_ms: int = 2100) -> tuple[ProofState, list[int]]:
    """The state in which the test ends, and the stage in each tick."""
    state, stages = watchdog_proof.INITIAL, []
    for ms in range(longest_ms):
        seen = drive.tick(ms, state.stage)
        closed, idle = (
            seen.axis_state == wanted for wanted in (AxisState.CLOSED_LOOP_CONTROL, AxisState.IDLE)
        )
        state = watchdog_proof.step(CONFIG.proof, state, Mode.PROOF, seen, closed, idle, omega_rad_s)
        stages.append(state.stage)
        if state.passed or state.failed:
            break
    return state, stages


HEARTBEATS = list(itertools.product((100, 20, 50, 7, 1), (0, 1, 37, 41, 42, 99)))
"""Their period and the first of them, in ms."""


@pytest.mark.parametrize("watchdog_ms", [30, 50, 51])
def test_a_drive_that_disarms_in_time_passes(watchdog_ms: int) -> None:
    for beat_ms, first_ms in HEARTBEATS:
        state, stages = run(Drive(watchdog_ms, beat_ms, first_ms))
        assert (state.passed, state.failed, state.stage) == (True, False, CLEAR), (beat_ms, first_ms)
        assert stages.count(WITHHOLD) <= 53
        assert len(stages) < 600


@pytest.mark.parametrize("watchdog_ms", [54, 60, 100, 10**9])
@pytest.mark.requirement("S-16")
def test_a_drive_that_disarms_too_late_or_never_fails(watchdog_ms: int) -> None:
    for beat_ms, first_ms in HEARTBEATS:
        state, stages = run(Drive(watchdog_ms, beat_ms, first_ms))
        assert (state.passed, state.failed) == (False, True), (beat_ms, first_ms)
        assert stages.count(WITHHOLD) <= 54


@pytest.mark.requirement("S-16")
@pytest.mark.parametrize(
    ("beat_ms", "least_failing_ms", "uneven"),
    [
        (beat_ms, failing_ms, uneven)
        for beat_ms, failing_ms in ((5, 59), (10, 60), (50, 56), (100, 55))
        for uneven in (False, True)
    ],
)
def test_which_watchdogs_pass_follows_from_the_heartbeats_period(
    beat_ms: int, least_failing_ms: int, uneven: bool
) -> None:
    """Up to 51 ms with any; from 54 ms + min(⌈51/H⌉, H) none: docs/safety.md."""
    assert least_failing_ms == 54 + min(-(-51 // beat_ms), beat_ms)
    page = (Path(__file__).parents[3] / "docs/safety.md").read_text("utf-8")
    assert "up to 51 ms passes, and one of 54 ms + min(⌈51 ms/H⌉ ms, H) or more fails" in " ".join(
        page.split()
    )
    for first_ms in range(beat_ms):
        for watchdog_ms in (30, 49) if uneven and beat_ms >= 50 else (30, 49, 50, 51):
            assert run(Drive(watchdog_ms, beat_ms, first_ms, uneven=uneven))[0].passed, (
                watchdog_ms,
                first_ms,
            )
        for watchdog_ms in (least_failing_ms, least_failing_ms + 1, 100, 10**9):
            assert run(Drive(watchdog_ms, beat_ms, first_ms, uneven=uneven))[0].failed, (
                watchdog_ms,
                first_ms,
            )


@pytest.mark.parametrize("error", [0, AxisError.VELOCITY_LIMIT_VIOLATION.value, EXPIRED | 1])
def test_a_drive_that_disarms_for_another_reason_fails(error: int) -> None:
    assert run(Drive(50, 100, 37, error))[0].failed


def test_a_drive_that_never_closes_its_axis_fails_after_two_seconds() -> None:
    drive = Drive(50, 100, 37)
    drive.tick = lambda ms, stage: DriveInput(AxisState.IDLE, 0, 0, ms % 100)  # type: ignore[method-assign]
    state, stages = run(drive)
    assert state.failed
    assert set(stages) == {CLOSE}
    assert len(stages) == 2002


def test_a_drive_that_falls_silent_fails() -> None:
    drive = Drive(50, 100, 37)
    tick = drive.tick

    def silent(ms: int, stage: int) -> DriveInput:
        seen = tick(ms, stage)
        return seen._replace(age_ticks=seen.age_ticks + 1) if stage == WITHHOLD else seen

    drive.tick = silent  # type: ignore[method-assign]
    state, stages = run(drive)
    assert state.failed
    assert stages.count(WITHHOLD) == 55


@pytest.mark.parametrize("omega_rad_s", [1.01, -1.01, float("nan")])
def test_a_crank_that_turns_ends_the_test(omega_rad_s: float) -> None:
    state, stages = run(Drive(50, 100, 37), omega_rad_s)
    assert state.failed
    assert len(stages) == 2


def test_a_crank_at_the_limit_of_its_speed_ends_nothing() -> None:
    assert run(Drive(50, 100, 37), watchdog_proof.STILL_RAD_S)[0].passed


def test_the_heartbeat_decides_by_the_time_since_the_last_frame() -> None:
    due = CONFIG.proof.due_ticks
    for ticks in (due - 1, due, due + 1, due + 2):
        state = watchdog_proof.INITIAL._replace(stage=WITHHOLD, withheld_ticks=ticks)
        disarmed, closed = (
            DriveInput(AxisState.IDLE, EXPIRED, 0, 0),
            DriveInput(AxisState.CLOSED_LOOP_CONTROL, 0, 0, 0),
        )
        is_late = ticks > due + 1
        cleared = state._replace(failed=True) if is_late else state._replace(stage=CLEAR)
        assert watchdog_proof.judge_heartbeat(CONFIG.proof, state, disarmed) == cleared
        assert watchdog_proof.judge_heartbeat(CONFIG.proof, state, closed).failed == (ticks >= due)
        assert (
            watchdog_proof.judge_heartbeat(CONFIG.proof, state, closed._replace(age_ticks=1)).failed
            == is_late
        )


@pytest.mark.parametrize("interval_ticks", [50, 51])
def test_a_heartbeat_is_late_after_its_longest_delay(interval_ticks: int) -> None:
    """After a wait of 51 ticks: three ticks with heartbeats every 50 ticks, two with those every 51."""
    due, delay_ticks = CONFIG.proof.due_ticks, {50: 3, 51: 2}[interval_ticks]
    assert due == 52
    silent = DriveInput(AxisState.IDLE, EXPIRED, 0, 1)
    for ticks in (due + delay_ticks, due + delay_ticks + 1):
        state = watchdog_proof.INITIAL._replace(
            stage=WITHHOLD, withheld_ticks=ticks, interval_ticks=interval_ticks
        )
        assert watchdog_proof.judge_heartbeat(CONFIG.proof, state, silent).failed == (
            ticks > due + delay_ticks
        )


def test_heartbeats_are_counted_from_the_beginning_of_the_test() -> None:
    """No axis that is closed without two heartbeats begins to be tested."""
    assert [*watchdog_proof.ProofStage] == [0, 1, 2, 3]
    silent, beat = DriveInput(AxisState.IDLE, 0, 0, 9), DriveInput(AxisState.IDLE, 0, 0, 0)
    state = watchdog_proof.INITIAL
    seen = []
    for drive in (silent, silent, beat, silent, beat):
        state = watchdog_proof.step(CONFIG.proof, state, Mode.PROOF, drive, True, False, 0.0)
        seen.append((state.stage, state.beat_ticks, state.interval_ticks))
        assert state.withheld_ticks == 0
    assert seen == [(CLOSE, -1, 0), (CLOSE, -1, 0), (CLOSE, 0, 0), (CLOSE, 1, 0), (CLOSE, 0, 2)]


def test_an_axis_that_cannot_be_cleared_fails() -> None:
    drive = Drive(50, 100, 37)
    tick = drive.tick
    drive.tick = lambda ms, stage: tick(ms, WITHHOLD if stage == CLEAR else stage)  # type: ignore[method-assign]
    state, stages = run(drive)
    assert state.failed
    assert state.stage == CLEAR
    assert len(stages) == 2002


def test_a_passed_test_counts_until_a_heartbeat_is_missing_or_the_next_test() -> None:
    passed = run(Drive(50, 100, 37))[0]
    for mode in set(Mode) - {Mode.PROOF}:
        fresh = DriveInput(AxisState.IDLE, 0, 0, CONFIG.gate.drive_ticks)
        after = watchdog_proof.step(CONFIG.proof, passed, mode, fresh, False, True, 30.0)
        assert after == watchdog_proof.INITIAL._replace(passed=True)
        stale = fresh._replace(age_ticks=CONFIG.gate.drive_ticks + 1)
        assert (
            watchdog_proof.step(CONFIG.proof, after, mode, stale, False, True, 0.0) == watchdog_proof.INITIAL
        )
    again = watchdog_proof.step(CONFIG.proof, after, Mode.PROOF, fresh, False, True, 0.0)
    assert (again.passed, again.stage) == (False, CLOSE)


@pytest.mark.requirement("S-16")
def test_only_a_passed_test_allows_a_start_where_it_is_required() -> None:
    required = CONFIG.proof._replace(is_required=True)
    for state in (watchdog_proof.INITIAL, watchdog_proof.INITIAL._replace(failed=True)):
        assert watchdog_proof.may_start(CONFIG.proof, state)
        assert not watchdog_proof.may_start(required, state)
    assert watchdog_proof.may_start(required, watchdog_proof.INITIAL._replace(passed=True))
    assert config_from({"watchdog.proof_required": 1}).proof == required


def test_only_the_error_that_the_test_provokes_is_tolerated() -> None:
    for stage in (REST, CLOSE, WITHHOLD, CLEAR):
        state = watchdog_proof.INITIAL._replace(stage=stage)
        for error in (0, EXPIRED, EXPIRED | 1, 0x200):
            drive = DriveInput(AxisState.IDLE, error, 0, 0)
            tolerated = stage in (WITHHOLD, CLEAR) and error == EXPIRED
            assert watchdog_proof.tolerates(state, drive) == tolerated
