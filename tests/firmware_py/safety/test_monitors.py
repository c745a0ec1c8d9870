import math

import pytest
from records import HEALTHY, replaced

from firmware_py.core.config import Config
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.inputs import Inputs
from firmware_py.core.safety import monitors
from firmware_py.core.safety.gate import Findings
from firmware_py.core.safety.monitors import MonitorState, Watched
from firmware_py.interface.enums import AxisState, Fault, Mode
from firmware_py.interface.modes import MOVING
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
CRANK = crank.INITIAL._replace(omega_rad_s=12.0, missed_ticks=0)
ESTIMATE = estimator_state.StrikerMotion(0.12, 0.0, 1e-6, 0, started=True)
NOTHING = zeroed(Findings, watchdog=Fault.NONE, limit=Fault.NONE, drive=Fault.NONE)
CLOSED = replaced(HEALTHY, "drive.axis_state", AxisState.CLOSED_LOOP_CONTROL)


def watch(
    inputs: Inputs = CLOSED,
    ticks: int = 1,
    mode: Mode = Mode.RUN,
    crank_state: crank.CrankState = CRANK,
    estimate: estimator_state.StrikerMotion = ESTIMATE,
    impulse: float = 0.0,
    target: float = 12.0,
    state: MonitorState = monitors.INITIAL,
    found: Findings = NOTHING,
    config: Config = CONFIG,
) -> tuple[MonitorState, Findings]:
    findings = None
    for _ in range(ticks):
        now = Watched(mode, inputs.drive.axis_state, crank_state, estimate, impulse, target)
        state, findings = monitors.step(config.monitors, config.p.limit, state, found, now)
    assert findings is not None
    return state, findings


def stands_still(watched: tuple[MonitorState, Findings]) -> bool:
    return monitors.stands_still(CONFIG.monitors, watched[0])


def test_nothing_counts_where_nothing_is_wrong() -> None:
    """A count that did not begin at 0 would shorten its deadline."""
    state, _ = watch(ticks=3)
    assert state == monitors.INITIAL._replace(enabled=True)


def test_a_healthy_module_has_no_faults() -> None:
    _, findings = watch(ticks=5000)
    assert findings == NOTHING


def test_frames_without_numbers_count_as_silence() -> None:
    assert watch(crank_state=CRANK._replace(missed_ticks=31))[1].watchdog == Fault.ENCODER_TIMEOUT
    assert watch(crank_state=CRANK._replace(missed_ticks=30))[1].watchdog == Fault.NONE
    for ticks, fault in ((30, Fault.NONE), (31, Fault.SENSOR_TIMEOUT)):
        silent = ESTIMATE._replace(silent_ticks=ticks)
        assert watch(estimate=silent)[1].watchdog == fault


@pytest.mark.parametrize(
    ("omega", "overspeed"), [(25.0, False), (25.1, True), (-25.0, False), (-25.1, True), (math.nan, True)]
)
def test_overspeed(omega: float, overspeed: bool) -> None:
    findings = watch(crank_state=CRANK._replace(omega_rad_s=omega))[1]
    assert (findings.overspeed, findings.limit) == (overspeed, Fault.NONE)


@pytest.mark.parametrize("fast", [15.1, -15.1, math.nan])
def test_a_crank_is_too_fast_until_it_has_been_slow_for_its_time(fast: float) -> None:
    edge = CRANK._replace(omega_rad_s=15.0)
    assert watch(crank_state=edge)[0].freewheel_ticks == 0
    state, _ = watch(crank_state=CRANK._replace(omega_rad_s=fast))
    assert state.freewheel_ticks == 500
    state, _ = watch(ticks=499, crank_state=edge, state=state)
    assert state.freewheel_ticks == 1
    state, _ = watch(crank_state=edge, state=state)
    assert state.freewheel_ticks == 0


@pytest.mark.parametrize(
    ("impulse", "fault"), [(1.6, Fault.NONE), (1.61, Fault.IMPULSE_LIMIT), (math.nan, Fault.IMPULSE_LIMIT)]
)
def test_the_impulse_trips_when_it_has_been_measured(impulse: float, fault: Fault) -> None:
    assert watch(impulse=impulse)[1].limit == fault


@pytest.mark.parametrize(
    "changes",
    [
        {"variance_m2": 0.06**2},
        {"variance_m2": 0.0},
        {"x_m": 10.0},
        {"x_m": -10.5},
        {"variance_m2": math.nan},
        {"x_m": math.nan},
        {"started": False},
    ],
)
def test_an_estimate_that_is_none(changes: dict[str, float]) -> None:
    bad = ESTIMATE._replace(**changes)
    assert watch(ticks=1000, estimate=bad)[1].limit == Fault.NONE
    assert watch(ticks=1001, estimate=bad)[1].limit == Fault.ESTIMATE_INVALID
    assert watch(ticks=2000, estimate=bad, mode=Mode.READY)[1].limit == Fault.NONE


@pytest.mark.parametrize("changes", [{"variance_m2": 0.05 * 0.05}, {"x_m": 9.9}])
def test_an_estimate_that_is_just_good_enough(changes: dict[str, float]) -> None:
    assert watch(ticks=2000, estimate=ESTIMATE._replace(**changes))[1].limit == Fault.NONE


def test_what_is_slow_is_not_stalled() -> None:
    standing = CRANK._replace(omega_rad_s=0.0)
    assert watch(ticks=2000, crank_state=standing, target=1.0)[1].limit == Fault.NONE
    assert watch(ticks=2000, crank_state=standing, target=1.5)[1].limit == Fault.STALL
    assert watch(ticks=2000, crank_state=CRANK._replace(omega_rad_s=0.3 * 12.0))[1].limit == Fault.STALL
    assert not stands_still(watch(ticks=301, crank_state=CRANK._replace(omega_rad_s=0.3)))


def test_stall() -> None:
    slow = CRANK._replace(omega_rad_s=3.0)
    assert watch(ticks=800, crank_state=slow)[1].limit == Fault.NONE
    assert watch(ticks=801, crank_state=slow)[1].limit == Fault.STALL
    assert watch(ticks=2000, crank_state=CRANK._replace(omega_rad_s=-12.0))[1].limit == Fault.STALL


def test_a_crank_that_runs_away_from_its_target() -> None:
    for omega_rad_s, ticks, fault in (
        (17.0, 1000, Fault.NONE),
        (17.1, 100, Fault.NONE),
        (17.1, 101, Fault.RUNAWAY),
        (math.nan, 101, Fault.RUNAWAY),
    ):
        fast = CRANK._replace(omega_rad_s=omega_rad_s)
        assert watch(ticks=ticks, crank_state=fast)[1].limit == fault
    fast = CRANK._replace(omega_rad_s=20.0)
    assert watch(HEALTHY, 500, Mode.SOFT_START, fast)[1].limit == Fault.NONE
    assert watch(CLOSED, 500, Mode.READY, fast)[1].limit == Fault.NONE


def test_an_acceleration_that_no_torque_explains() -> None:
    for disturbance_rad_s2, ticks, fault in (
        (CONFIG.monitors.implausible_rad_s2, 1000, Fault.NONE),
        (-CONFIG.monitors.implausible_rad_s2, 1000, Fault.NONE),
        (300.1, 20, Fault.NONE),
        (300.1, 21, Fault.LOAD_IMPLAUSIBLE),
        (-300.1, 21, Fault.LOAD_IMPLAUSIBLE),
        (math.nan, 21, Fault.LOAD_IMPLAUSIBLE),
    ):
        loaded = CRANK._replace(disturbance_rad_s2=disturbance_rad_s2)
        assert watch(ticks=ticks, crank_state=loaded)[1].limit == fault
    loaded = CRANK._replace(disturbance_rad_s2=1000.0)
    assert watch(HEALTHY, 500, Mode.SOFT_START, loaded)[1].limit == Fault.NONE
    assert watch(CLOSED, 500, Mode.READY, loaded)[1].limit == Fault.NONE


@pytest.mark.parametrize(
    ("parameters", "longest_ticks"),
    [
        ({}, 2000),
        ({"start.stop_s": 2.5}, 3500),
        ({"gait.follow": 1}, 3000),
        ({"spin_down.longest_s": 5.0}, 2000),
    ],
)
def test_a_stop_has_its_time(parameters: dict[str, float], longest_ticks: int) -> None:
    config = config_from(parameters)
    assert config.monitors.longest.stop_failed == longest_ticks
    slow = CRANK._replace(omega_rad_s=1.0)
    late = replaced(monitors.INITIAL, "held.stop_failed", longest_ticks - 1)
    state, findings = watch(crank_state=slow, mode=Mode.STOPPING, target=0.0, state=late, config=config)
    assert findings.limit == Fault.NONE
    state, findings = watch(crank_state=slow, mode=Mode.STOPPING, target=0.0, state=state, config=config)
    assert findings.limit == Fault.STOP_FAILED
    assert watch(crank_state=slow, mode=Mode.READY, state=state, config=config)[0].held.stop_failed == 0


def test_a_drive_that_lets_go() -> None:
    state, findings = watch()
    assert findings.drive == Fault.NONE
    assert watch(HEALTHY, state=state)[1].drive == Fault.DRIVE_ERROR


def test_a_drive_that_does_not_enable() -> None:
    assert watch(HEALTHY, 1000, Mode.SOFT_START)[1].drive == Fault.NONE
    assert watch(HEALTHY, 1001, Mode.SOFT_START)[1].drive == Fault.DRIVE_ERROR


def test_a_drive_that_does_not_let_go() -> None:
    for mode in Mode:
        refused = Fault.NONE if mode in MOVING else Fault.DRIVE_ERROR
        assert watch(CLOSED, 1000, mode)[1].drive == Fault.NONE
        assert watch(CLOSED, 1001, mode)[1].drive == refused


def test_standstill_takes_its_time() -> None:
    still = CRANK._replace(omega_rad_s=0.1)
    assert not stands_still(watch(ticks=300, crank_state=still))
    assert stands_still(watch(ticks=301, crank_state=still))
    assert not stands_still(watch(ticks=1000))


def test_noise_at_the_limit_does_not_restart_the_standstill() -> None:
    state = monitors.INITIAL
    for tick in range(301):
        omega_rad_s = 0.305 if tick in (1, 2, 5) else 0.295
        state, _ = watch(state=state, crank_state=CRANK._replace(omega_rad_s=omega_rad_s))
    assert monitors.stands_still(CONFIG.monitors, state)
    turning = CRANK._replace(omega_rad_s=0.46)
    assert not stands_still(watch(state=state, crank_state=turning))


def test_the_gates_findings_come_first() -> None:
    found = Findings(
        Fault.STALE_SAMPLES, Fault.FORCE_LIMIT, Fault.DRIVE_ERROR, True, overspeed=True, touching=False
    )
    lost = CRANK._replace(missed_ticks=31)
    _, findings = watch(HEALTHY, crank_state=lost, impulse=9.0, found=found)
    assert (findings.watchdog, findings.limit, findings.drive) == found[:3]
    assert (findings.operator_lost, findings.overspeed) == (True, True)
    assert watch(found=NOTHING)[1] == NOTHING
