import math

import pytest
from records import HEALTHY, replaced

from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.inputs import Inputs
from firmware_py.core.records import zeroed
from firmware_py.core.safety import monitors
from firmware_py.core.safety.monitors import Findings, MonitorConfig, MonitorState
from firmware_py.interface.enums import MOVING, AxisState, Fault, Mode
from firmware_py.shell.parameters import config_from

CONFIG = config_from({}).monitors
CRANK = crank.INITIAL._replace(omega_rad_s=12.0, missed_ticks=0)
ESTIMATE = estimator_state.INITIAL._replace(
    x_m=0.12, p_xx=1e-6, started=True, sensor=estimator_state.INITIAL.sensor._replace(missed_ticks=0)
)
CLOSED = replaced(HEALTHY, "drive.axis_state", AxisState.CLOSED_LOOP_CONTROL)


def watch(
    inputs: Inputs = CLOSED,
    ticks: int = 1,
    mode: Mode = Mode.RUN,
    crank_state: crank.CrankState = CRANK,
    estimate: estimator_state.EstimatorState = ESTIMATE,
    impulse: float = 0.0,
    peak: float = 0.0,
    target: float = 12.0,
    state: MonitorState = monitors.INITIAL,
    stuck: bool = False,
    config: MonitorConfig = CONFIG,
    load_known: bool = True,
) -> tuple[MonitorState, Findings]:
    findings = None
    for tick in range(ticks):
        shaken = inputs.accelerometer._replace(low_m_s2=inputs.accelerometer.low_m_s2 + 0.01 * (tick % 2))
        state, findings = monitors.step(
            config,
            state,
            mode,
            inputs if stuck else inputs._replace(accelerometer=shaken),
            crank_state,
            estimate,
            impulse,
            peak,
            target,
            monitors.is_disturbed(config.limits, crank_state) and load_known,
        )
    assert findings is not None
    return state, findings


def test_nothing_is_remembered_at_power_up() -> None:
    assert MonitorState(0, 0, 0, 0, 0, 0, 0, 0, 0, 0, False, 0.0, 0, 0.0, 0, 0, 0, 0) == monitors.INITIAL


@pytest.mark.parametrize(
    ("follow", "age_ticks", "fault"),
    [
        (1, 200, Fault.NONE),
        (1, 201, Fault.SENSOR_TIMEOUT),
        (0, 201, Fault.NONE),
    ],
)
def test_the_gaits_sensors_are_watched_where_they_are_followed(
    follow: int, age_ticks: int, fault: Fault
) -> None:
    watchdogs = config_from({"gait.follow": follow}).monitors.watchdogs
    silent = replaced(CLOSED, "gait.age_ticks", age_ticks)
    assert monitors.watchdog_fault(watchdogs, monitors.INITIAL, silent, CRANK, ESTIMATE) == fault


def test_a_tick_is_the_shortest_watch_over_the_gaits_sensors() -> None:
    watchdogs = CONFIG.watchdogs._replace(gait_ticks=1)
    silent = replaced(CLOSED, "gait.age_ticks", 2)
    assert (
        monitors.watchdog_fault(watchdogs, monitors.INITIAL, silent, CRANK, ESTIMATE) == Fault.SENSOR_TIMEOUT
    )


def test_nothing_counts_where_nothing_is_wrong() -> None:
    """A count that did not begin at 0 would shorten its deadline."""
    state, _ = watch(ticks=3)
    counts = {name: value for name, value in state._asdict().items() if name.endswith("_ticks")}
    assert len(counts) == 14
    assert set(counts.values()) == {0}


@pytest.mark.parametrize("source", ["encoder", "accelerometer"])
@pytest.mark.parametrize(
    ("silent_ticks", "samples", "gaps", "fault"),
    [
        (9, 1, 20, Fault.NONE),
        (10, 1, 2, Fault.NONE),
        (10, 1, 3, Fault.STALE_SAMPLES),
        (10, 10, 3, Fault.STALE_SAMPLES),
        (10, 11, 20, Fault.NONE),
        (29, 2, 3, Fault.STALE_SAMPLES),
    ],
)
def test_samples_in_bundles_are_named(
    source: str, silent_ticks: int, samples: int, gaps: int, fault: Fault
) -> None:
    """A gap counts when it ends, and no longer than ten ticks of samples."""
    state, found = monitors.INITIAL, set()
    for tick, age in enumerate([*range(1, silent_ticks + 1), *[0] * samples] * gaps):
        inputs = replaced(CLOSED, f"{source}.age_ticks", age)
        inputs = replaced(inputs, "accelerometer.low_m_s2", 0.01 * (tick % 2))  # not a stuck one
        state, findings = watch(inputs, state=state, stuck=True)
        found.add(findings.watchdog)
    assert found == {Fault.NONE, fault}


def test_a_gap_is_forgotten_after_steady_samples() -> None:
    state = monitors.INITIAL._replace(silent_ticks=CONFIG.gap_ticks)
    assert watch(state=state)[0].gaps == 1
    assert watch(ticks=10, state=state)[0].gaps == 1
    assert watch(ticks=11, state=state)[0].gaps == 0


def test_a_healthy_module_has_no_faults() -> None:
    _, findings = watch(ticks=5000)
    assert findings == zeroed(Findings, watchdog=Fault.NONE, limit=Fault.NONE, drive=Fault.NONE)


@pytest.mark.parametrize(
    ("path", "longest", "fault"),
    [
        ("accelerometer.age_ticks", 30, Fault.SENSOR_TIMEOUT),
        ("encoder.age_ticks", 30, Fault.ENCODER_TIMEOUT),
        ("drive.age_ticks", 350, Fault.DRIVE_TIMEOUT),
        ("power.age_ticks", 350, Fault.DRIVE_TIMEOUT),
    ],
)
def test_each_source_has_a_watchdog(path: str, longest: int, fault: Fault) -> None:
    assert watch(replaced(CLOSED, path, longest))[1].watchdog == Fault.NONE
    assert watch(replaced(CLOSED, path, longest + 1))[1].watchdog == fault


def test_the_operator_has_a_watchdog() -> None:
    assert not watch(replaced(CLOSED, "operator.age_ticks", 350))[1].operator_lost
    assert watch(replaced(CLOSED, "operator.age_ticks", 351))[1].operator_lost


def test_frames_without_numbers_count_as_silence() -> None:
    assert watch(crank_state=CRANK._replace(missed_ticks=31))[1].watchdog == Fault.ENCODER_TIMEOUT
    assert watch(crank_state=CRANK._replace(missed_ticks=30))[1].watchdog == Fault.NONE
    for ticks, fault in ((30, Fault.NONE), (31, Fault.SENSOR_TIMEOUT)):
        silent = ESTIMATE._replace(sensor=ESTIMATE.sensor._replace(missed_ticks=ticks))
        assert watch(estimate=silent)[1].watchdog == fault


@pytest.mark.parametrize(
    ("path", "good", "bad", "ticks", "fault"),
    [
        ("power.current_a", 12.0, 12.1, 21, Fault.OVERCURRENT),
        ("power.current_a", -12.0, -12.1, 21, Fault.OVERCURRENT),
        ("power.voltage_v", 18.0, 17.9, 151, Fault.UNDERVOLTAGE),
        ("power.voltage_v", 30.0, 30.1, 151, Fault.OVERVOLTAGE),
        ("power.inverter_degc", 80.0, 80.1, 1, Fault.OVERTEMPERATURE),
        ("power.motor_degc", 90.0, 90.1, 1, Fault.OVERTEMPERATURE),
        ("power.motor_degc", -30.0, -31.0, 1, Fault.OVERTEMPERATURE),
        ("power.inverter_degc", -30.0, -31.0, 1, Fault.OVERTEMPERATURE),
    ],
)
def test_each_measured_limit(path: str, good: float, bad: float, ticks: int, fault: Fault) -> None:
    assert watch(replaced(CLOSED, path, good), 1000)[1].limit == Fault.NONE
    assert watch(replaced(CLOSED, path, bad), ticks)[1].limit == fault
    if ticks > 1:
        assert watch(replaced(CLOSED, path, bad), ticks - 1)[1].limit == Fault.NONE
    assert watch(replaced(CLOSED, path, math.nan), 1000)[1].limit != Fault.NONE


def test_an_interrupted_condition_starts_anew() -> None:
    state, _ = watch(replaced(CLOSED, "power.current_a", 15.0), 20)
    state, _ = watch(state=state)
    _, findings = watch(replaced(CLOSED, "power.current_a", 15.0), 20, state=state)
    assert findings.limit == Fault.NONE


@pytest.mark.parametrize(
    ("omega", "overspeed"), [(25.0, False), (25.1, True), (-25.0, False), (-25.1, True), (math.nan, True)]
)
def test_overspeed(omega: float, overspeed: bool) -> None:
    findings = watch(crank_state=CRANK._replace(omega_rad_s=omega))[1]
    assert (findings.overspeed, findings.limit) == (overspeed, Fault.NONE)


def test_overspeed_also_by_the_drives_own_estimate() -> None:
    edge_rev_s = 37.5 / math.tau
    assert math.tau * edge_rev_s == 37.5
    for velocity_rev_s, overspeed in ((edge_rev_s, False), (6.0, True), (-6.0, True), (math.nan, True)):
        findings = watch(replaced(CLOSED, "encoder.velocity_rev_s", velocity_rev_s))[1]
        assert findings.overspeed == overspeed


@pytest.mark.parametrize("fast", [20.1, -20.1, math.nan])
def test_a_crank_is_too_fast_until_it_has_been_slow_for_its_time(fast: float) -> None:
    edge = CRANK._replace(omega_rad_s=20.0)
    assert not watch(crank_state=edge)[1].freewheel_overspeed
    state, findings = watch(crank_state=CRANK._replace(omega_rad_s=fast))
    assert (findings.freewheel_overspeed, state.freewheel_ticks) == (True, 500)
    state, findings = watch(ticks=499, crank_state=edge, state=state)
    assert (findings.freewheel_overspeed, state.freewheel_ticks) == (True, 1)
    state, findings = watch(crank_state=edge, state=state)
    assert (findings.freewheel_overspeed, state.freewheel_ticks) == (False, 0)
    # One long tick counts as long; and what is calm stays so.
    state, _ = watch(crank_state=CRANK._replace(omega_rad_s=fast))
    assert watch(replaced(CLOSED, "elapsed_ticks", 499), crank_state=edge, state=state)[1].freewheel_overspeed
    state, findings = watch(replaced(CLOSED, "elapsed_ticks", 501), crank_state=edge, state=state)
    assert (findings.freewheel_overspeed, state.freewheel_ticks) == (False, 0)


def test_without_a_time_to_calm_down_in_only_the_present_speed_counts() -> None:
    config = CONFIG._replace(takeover_ticks=0)
    for omega, freewheel_overspeed in ((20.1, True), (20.0, False)):
        crank_state = CRANK._replace(omega_rad_s=omega)
        _, findings = watch(mode=Mode.READY, crank_state=crank_state, target=0.0, config=config)
        assert findings.freewheel_overspeed == freewheel_overspeed


def test_frozen_drive_data_is_found_out() -> None:
    frozen = replaced(CLOSED, "encoder.velocity_rev_s", 1.9)
    assert watch(frozen, 20)[1].limit == Fault.NONE
    assert watch(frozen, 22)[1].limit == Fault.DRIVE_FROZEN


def test_an_accelerometer_that_repeats_itself_is_found_out() -> None:
    assert watch(CLOSED, 30, stuck=True)[1].watchdog == Fault.NONE
    state, findings = watch(CLOSED, 31, stuck=True)
    assert findings.watchdog == Fault.SENSOR_TIMEOUT
    # Silence in between says nothing about it; one other reading ends it.
    silent = replaced(CLOSED, "accelerometer.age_ticks", 1)
    assert watch(silent, 3, state=state, stuck=True)[0].stuck_ticks == state.stuck_ticks
    other = replaced(CLOSED, "accelerometer.low_m_s2", 1.25)
    assert watch(other, 1, state=state, stuck=True)[0].stuck_ticks == 0


@pytest.mark.parametrize("omega_rad_s", [5.0, -5.0])
def test_an_accelerometer_may_repeat_itself_while_the_crank_hardly_turns(omega_rad_s: float) -> None:
    slow = CRANK._replace(omega_rad_s=omega_rad_s)
    assert watch(CLOSED, 100, crank_state=slow, stuck=True)[1].watchdog == Fault.NONE
    fast = CRANK._replace(omega_rad_s=1.01 * omega_rad_s)
    assert watch(CLOSED, 100, crank_state=fast, stuck=True)[1].watchdog == Fault.SENSOR_TIMEOUT


def test_a_standing_crank_is_not_frozen() -> None:
    assert (
        watch(HEALTHY, 1000, Mode.READY, CRANK._replace(omega_rad_s=0.0), target=0.0)[1].limit == Fault.NONE
    )


@pytest.mark.parametrize(
    ("impulse", "fault"), [(1.6, Fault.NONE), (1.61, Fault.IMPULSE_LIMIT), (math.nan, Fault.IMPULSE_LIMIT)]
)
def test_the_impulse_trips_when_it_has_been_measured(impulse: float, fault: Fault) -> None:
    assert watch(impulse=impulse)[1].limit == fault


@pytest.mark.parametrize(
    ("peak", "fault"),
    [(CONFIG.limits.peak_m_s2, Fault.NONE), (1876.0, Fault.FORCE_LIMIT), (math.nan, Fault.FORCE_LIMIT)],
)
def test_the_force_trips_when_the_impact_is_over(peak: float, fault: Fault) -> None:
    assert watch(peak=peak)[1].limit == fault


@pytest.mark.parametrize(
    "changes",
    [
        {"p_xx": 0.06**2},
        {"p_xx": 0.0},
        {"x_m": 10.0},
        {"x_m": -10.5},
        {"p_xx": math.nan},
        {"x_m": math.nan},
        {"started": False},
    ],
)
def test_an_estimate_that_is_none(changes: dict[str, float]) -> None:
    bad = ESTIMATE._replace(**changes)
    assert watch(ticks=1000, estimate=bad)[1].limit == Fault.NONE
    assert watch(ticks=1001, estimate=bad)[1].limit == Fault.ESTIMATE_INVALID
    assert watch(ticks=2000, estimate=bad, mode=Mode.READY)[1].limit == Fault.NONE


@pytest.mark.parametrize("changes", [{"p_xx": 0.05 * 0.05}, {"x_m": 9.9}])
def test_an_estimate_that_is_just_good_enough(changes: dict[str, float]) -> None:
    assert watch(ticks=2000, estimate=ESTIMATE._replace(**changes))[1].limit == Fault.NONE


def test_what_is_slow_is_neither_frozen_nor_stalled() -> None:
    for rad_s, fault in ((0.5, Fault.NONE), (1.0, Fault.DRIVE_FROZEN)):
        crawling = replaced(CLOSED, "encoder.velocity_rev_s", rad_s / math.tau)
        assert math.tau * crawling.encoder.velocity_rev_s == rad_s
        assert watch(crawling, 22)[1].limit == fault
    standing = CRANK._replace(omega_rad_s=0.0)
    assert watch(ticks=2000, crank_state=standing, target=1.0)[1].limit == Fault.NONE
    assert watch(ticks=2000, crank_state=standing, target=1.5)[1].limit == Fault.STALL
    assert watch(ticks=2000, crank_state=CRANK._replace(omega_rad_s=0.3 * 12.0))[1].limit == Fault.STALL
    assert not watch(ticks=301, crank_state=CRANK._replace(omega_rad_s=0.3))[1].standstill


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
        (CONFIG.limits.disturbance_rad_s2, 1000, Fault.NONE),
        (-CONFIG.limits.disturbance_rad_s2, 1000, Fault.NONE),
        (300.1, 20, Fault.NONE),
        (300.1, 21, Fault.LOAD_IMPLAUSIBLE),
        (-300.1, 21, Fault.LOAD_IMPLAUSIBLE),
        (math.nan, 21, Fault.LOAD_IMPLAUSIBLE),
    ):
        loaded = CRANK._replace(disturbance_rad_s2=disturbance_rad_s2)
        assert watch(ticks=ticks, crank_state=loaded)[1].limit == fault
    loaded = CRANK._replace(disturbance_rad_s2=1000.0)
    assert watch(HEALTHY, 500, Mode.SOFT_START, loaded)[1].limit == Fault.NONE
    assert watch(ticks=500, crank_state=loaded, load_known=False)[1].limit == Fault.NONE
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
    config = config_from(parameters).monitors
    assert config.stop_ticks == longest_ticks
    slow = CRANK._replace(omega_rad_s=1.0)
    late = monitors.INITIAL._replace(stopping_ticks=config.stop_ticks - 1)
    state, findings = watch(crank_state=slow, mode=Mode.STOPPING, target=0.0, state=late, config=config)
    assert findings.limit == Fault.NONE
    state, findings = watch(crank_state=slow, mode=Mode.STOPPING, target=0.0, state=state, config=config)
    assert findings.limit == Fault.STOP_FAILED
    assert watch(crank_state=slow, mode=Mode.READY, state=state, config=config)[0].stopping_ticks == 0


def test_a_drive_error_and_a_drive_that_lets_go() -> None:
    assert watch(replaced(CLOSED, "drive.axis_error", 0x200))[1].drive == Fault.DRIVE_ERROR
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
    assert not watch(ticks=300, crank_state=still)[1].standstill
    assert watch(ticks=301, crank_state=still)[1].standstill
    assert not watch(ticks=1000)[1].standstill


def test_noise_at_the_limit_does_not_restart_the_standstill() -> None:
    state = monitors.INITIAL
    findings = None
    for tick in range(301):
        omega_rad_s = 0.305 if tick in (2, 5) else 0.295
        state, findings = watch(state=state, crank_state=CRANK._replace(omega_rad_s=omega_rad_s))
    assert findings is not None
    assert findings.standstill
    turning = CRANK._replace(omega_rad_s=0.46)
    assert not watch(state=state, crank_state=turning)[1].standstill
