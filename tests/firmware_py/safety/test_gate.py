"""The gate alone: each limit from both sides, its time, and what a stale, clipped or missing number does."""

import math

import pytest
from records import HEALTHY, replaced

from firmware_py.core.config import Config
from firmware_py.core.inputs import Inputs
from firmware_py.core.safety import gate, liveness
from firmware_py.core.safety.gate import Findings, GateState
from firmware_py.interface.enums import ActingLimit, AxisState, Fault
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
CLOSED = replaced(HEALTHY, "drive.axis_state", AxisState.CLOSED_LOOP_CONTROL)
NOTHING = zeroed(Findings, watchdog=Fault.NONE, limit=Fault.NONE, drive=Fault.NONE)
MASS_KG = 0.8


def guard(
    inputs: Inputs = CLOSED,
    ticks: int = 1,
    state: GateState = gate.INITIAL,
    config: Config = CONFIG,
) -> tuple[GateState, Findings]:
    """Some ticks with a reading in each in which the accelerometer's frame is fresh."""
    findings = NOTHING
    for tick in range(ticks):
        if inputs.accelerometer.age_ticks == 0:
            noise_m_s2 = 0.01 * (tick % 2)
            low_m_s2, high_m_s2, housing_m_s2, _ = inputs.accelerometer
            sample = Accelerometer(low_m_s2 + noise_m_s2, high_m_s2 + noise_m_s2, housing_m_s2 + noise_m_s2)
            state = gate.take(config.gate, state, sample, (state.counter + 1) % 256)
        state, findings = gate.judge(config.gate, state, inputs)
    return state, findings


def settled(flight_m_s2: float) -> GateState:
    """A gate that knows the flight, before the reading with counter 0."""
    state = gate.INITIAL
    for place in range(-gate.SETTLING_READINGS, 0):
        state = gate.take(CONFIG.gate, state, Accelerometer(0.01 * place, flight_m_s2, 0.0), place % 256)
    return state


def felt(
    readings: list[float], counters: list[int] | None = None, config: Config = CONFIG
) -> tuple[GateState, list[Fault]]:
    """The faults after each reading, the first of which is in flight; a missing counter is a lost frame."""
    state, faults = settled(readings[0]), []
    for place, high_m_s2 in enumerate(readings):
        if counters is None or place in counters:
            state = gate.take(config.gate, state, Accelerometer(0.01 * place, high_m_s2, 0.0), place % 256)
        state, findings = gate.judge(config.gate, state, CLOSED)
        faults.append(findings.limit)
    return state, faults


def pulse(peak_m_s2: float, ticks: int, flight_m_s2: float = 0.0) -> list[float]:
    """Ten readings in flight, a half-sine down to −peak, ten readings in flight."""
    flight = [flight_m_s2] * 10
    shape = [math.sin(math.pi * (k + 0.5) / ticks) for k in range(ticks)]
    return [*flight, *(flight_m_s2 - peak_m_s2 * one for one in shape), *flight]


def impulse_n_s(readings: list[float], flight_m_s2: float = 0.0) -> float:
    return MASS_KG * 1e-3 * sum(flight_m_s2 - one for one in readings)


def test_the_block_of_limits_is_that_of_the_parameters() -> None:
    assert pytest.approx(1500.0) == CONFIG.gate.peak_m_s2 * MASS_KG
    assert pytest.approx(1.6) == CONFIG.gate.change_m_s * MASS_KG
    assert pytest.approx(0.98 * 1961.33) == CONFIG.gate.clipped_m_s2
    own = CONFIG.gate
    assert (own.longest_contact_ticks, own.window_ticks, own.gap_ticks) == (100, 20, 10)
    assert (CONFIG.gate.sensor_ticks, CONFIG.gate.encoder_ticks, CONFIG.gate.frozen_ticks) == (30, 30, 20)
    assert (CONFIG.gate.drive_ticks, CONFIG.gate.operator_ticks) == (350, 350)
    assert (CONFIG.gate.overcurrent_ticks, CONFIG.gate.voltage_ticks) == (20, 150)
    assert (CONFIG.gate.gait_ticks, CONFIG.gate.reads_gait) == (200, False)
    assert CONFIG.gate.flight_m_s3 == 300.0
    stiff = config_from(
        {
            "striker.spring_n_m": 720.0,
            "start.highest_ratio": 1.2,
            "limit.speed_rad_s": 38.0,
            "limit.overspeed_rad_s": 39.0,
        }
    )
    assert stiff.gate.flight_m_s3 == pytest.approx(1800.0)
    slow = config_from({"control.tick_s": 0.004, "gait.follow": 1}).gate
    assert (slow.gait_ticks, slow.gap_ticks, slow.window_ticks, slow.longest_contact_ticks) == (50, 2, 5, 25)


def test_nothing_is_found_on_a_healthy_module() -> None:
    state, findings = guard(ticks=1000)
    assert findings == NOTHING
    assert state == gate.INITIAL._replace(
        contact=gate.IN_FLIGHT._replace(
            readings=gate.SETTLING_READINGS,
            flight_m_s2=state.contact.flight_m_s2,
            deviation_m_s2=state.contact.deviation_m_s2,
        ),
        counter=999 % 256,
        reading_ticks=1,
        encoder_ticks=0,
        life=liveness.INITIAL._replace(low_m_s2=0.01, high_m_s2=0.01, housing_m_s2=0.01),
        window_ticks=state.window_ticks,
    )
    assert 0 <= state.window_ticks < CONFIG.gate.window_ticks


# Force


@pytest.mark.parametrize("side", [-1.0, 2.0])
@pytest.mark.requirement("S-04")
def test_the_force_trips_at_the_first_reading_beyond_its_limit(side: float) -> None:
    flight = 5.0
    for beyond, fault in ((-0.001, Fault.NONE), (0.001, Fault.FORCE_LIMIT)):
        readings = [flight, flight, flight + side * (900.0 + beyond) / 1.4]
        wide = replaced(replaced(CONFIG, "gate.change_m_s", 1e9), "gate.peak_m_s2", 900.0)
        assert felt(readings, config=wide)[1] == [Fault.NONE, Fault.NONE, fault]


@pytest.mark.parametrize("side", [-1.0, 2.0])
def test_a_rising_force_is_extrapolated(side: float) -> None:
    """By 0.4 ms: the low-pass lowers a short peak, and the peak lies between two samples."""
    config = replaced(replaced(CONFIG, "gate.peak_m_s2", 200.0), "gate.change_m_s", 1e9)
    for rise, fault in ((0.999, Fault.NONE), (1.001, Fault.FORCE_LIMIT)):
        first = 60.0
        second = first + rise * (200.0 - first) / 1.4
        assert felt([0.0, side * first, side * second], config=config)[1][-1] == fault
        # Over three lost samples the slope is a quarter.
        second = first + rise * (200.0 - first) / 1.1
        readings = [0.0, side * first, 0.0, 0.0, 0.0, side * second]
        assert felt(readings, counters=[0, 1, 5], config=config)[1][-1] == fault
    # A falling one is taken as it is.
    assert felt([0.0, side * 140.0, side * 20.0, side * 199.0], config=config)[1][1] == Fault.NONE
    assert felt([0.0, side * 140.0, side * 139.0], config=config)[1][-1] == Fault.NONE
    late = gate.integrate_reading(config.gate, felt([0.0, side * 60.0])[0].contact, side * 199.0, 0)
    assert late.fault == Fault.NONE


@pytest.mark.parametrize("reading", [CONFIG.gate.clipped_m_s2 * 1.0001, -CONFIG.gate.clipped_m_s2 * 1.0001])
def test_a_clipped_reading_violates_the_force_limit(reading: float) -> None:
    """Whatever the limit: what it hides is not known."""
    config = replaced(replaced(CONFIG, "gate.peak_m_s2", 1e9), "gate.change_m_s", 1e9)
    assert felt([0.0, reading], config=config)[1] == [Fault.NONE, Fault.FORCE_LIMIT]
    edge = math.copysign(config.gate.clipped_m_s2, reading)
    assert felt([0.0, edge], config=config)[1] == [Fault.NONE, Fault.NONE]


@pytest.mark.parametrize("before", [0, 1, 5])
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_reading_that_is_no_number_violates_the_force_limit(bad: float, before: int) -> None:
    state, faults = felt([0.0] * before + [bad])
    assert faults == [Fault.NONE] * before + [Fault.FORCE_LIMIT]
    assert felt([0.0] * before + [bad, 0.0, 0.0])[1][-1] == Fault.NONE
    assert all(math.isfinite(value) for value in state.contact)


def test_there_is_no_blind_time_after_an_impact() -> None:
    first = pulse(300.0, 10)[:-10]
    config = replaced(CONFIG, "gate.peak_m_s2", 500.0)
    for rest in range(4):
        readings = [*first, *[0.0] * rest, -501.0]
        assert felt(readings, config=config)[1] == [Fault.NONE] * (len(readings) - 1) + [Fault.FORCE_LIMIT]


# Impulse


@pytest.mark.parametrize("side", [1.0, -2.0])
@pytest.mark.parametrize("flight_m_s2", [0.0, -8.0, 15.0])
@pytest.mark.parametrize("ticks", [2, 5, 10, 30])
def test_the_impulse_is_the_integral_of_the_stops_force(ticks: int, flight_m_s2: float, side: float) -> None:
    readings = pulse(side * 1000.0 / ticks * 1.5, ticks, flight_m_s2)
    true_n_s = impulse_n_s(readings, flight_m_s2) / side
    for share, fault in ((0.96, Fault.IMPULSE_LIMIT), (1.04, Fault.NONE)):
        config = replaced(CONFIG, "gate.change_m_s", share * true_n_s / MASS_KG)
        assert set(felt(readings, config=config)[1]) == {Fault.NONE, fault}


def test_a_limit_that_is_no_number_trips() -> None:
    readings = pulse(300.0, 10)
    assert Fault.IMPULSE_LIMIT in felt(readings, config=replaced(CONFIG, "gate.change_m_s", math.nan))[1]
    assert Fault.FORCE_LIMIT in felt(readings, config=replaced(CONFIG, "gate.peak_m_s2", math.nan))[1]


def test_each_contact_has_its_own_impulse() -> None:
    one = pulse(300.0, 10)
    config = replaced(CONFIG, "gate.change_m_s", 1.5 * impulse_n_s(one) / MASS_KG)
    assert set(felt(one * 5, config=config)[1]) == {Fault.NONE}


def test_a_contact_begins_beyond_the_noise_and_its_beginning_counts() -> None:
    state, _ = felt([0.0, gate.TOUCH_M_S2, 0.0])
    assert not state.contact.touching
    state, _ = felt([0.0, -12.5])
    assert (state.contact.touching, state.contact.ticks, state.contact.peak_m_s2) == (True, 1, 12.5)
    assert state.contact.change_m_s == pytest.approx(0.5 * 12.5e-3)
    state, _ = felt([0.0, -12.5, -30.0])
    assert (state.contact.ticks, state.contact.peak_m_s2) == (2, 30.0)
    assert state.contact.change_m_s == pytest.approx((0.5 * 12.5 + 0.5 * 42.5) * 1e-3)
    state, _ = felt([0.0, -30.0, -20.0])
    assert state.contact.peak_m_s2 == 30.0


def test_a_contact_ends_below_its_share_of_the_peak() -> None:
    for peak, last, touching in ((100.0, 5.9, False), (100.0, 6.0, True), (1000.0, 19.9, False)):
        state, _ = felt([0.0, -peak, -last])
        assert state.contact.touching == touching
    state, _ = felt([0.0, -1000.0, -20.1])
    assert state.contact.touching
    state, _ = felt([0.0, -100.0, -5.0])
    ended = gate.IN_FLIGHT._replace(readings=gate.SETTLING_READINGS, deviation_m_s2=5.0)
    assert state.contact == ended


def test_the_flight_is_followed_slowly_and_not_in_contact() -> None:
    state, _ = felt([0.0, 10.0])
    assert state.contact.flight_m_s2 == pytest.approx(0.3)
    state, _ = felt([0.0, 0.1])
    assert state.contact.flight_m_s2 == pytest.approx(0.1)
    state, _ = felt([0.0, -10.0])
    assert state.contact.flight_m_s2 == pytest.approx(-0.3)
    state, _ = felt([0.0, -50.0, -50.0])
    assert state.contact.flight_m_s2 == 0.0
    state, _ = felt([0.0, -10.0, -10.0, -10.0], counters=[0, 3])
    assert state.contact.flight_m_s2 == pytest.approx(-0.9)


def test_each_limit_is_still_allowed() -> None:
    """The sides of a contact's limits, the threshold of a contact, and the limits of the crank's speed."""
    assert gate.is_within(1.0, 1.0)
    assert gate.is_within(-2.0, 1.0)
    assert not gate.is_within(math.nextafter(1.0, 2.0), 1.0)
    assert not gate.is_within(math.nextafter(-2.0, -3.0), 1.0)
    assert not felt([0.0, -gate.TOUCH_M_S2])[0].contact.touching
    assert felt([0.0, math.nextafter(-gate.TOUCH_M_S2, -99.0)])[0].contact.touching
    limit_rad_s = CONFIG.p.limit.overspeed_rad_s
    assert not gate.is_overspeed(CONFIG.gate, limit_rad_s, 0.0)
    assert gate.is_overspeed(CONFIG.gate, math.nextafter(limit_rad_s, 99.0), 0.0)


def test_a_push_that_turns_begins_a_new_contact_and_one_that_cancels_does_not() -> None:
    """Control periods and readings are powers of 2, so that the first part's impulse cancels exactly."""
    config = config_from({"control.tick_s": 2.0**-10})
    state, _ = felt([0.0, -20.0, 12.0, 12.0, -8.0], config=config)
    assert (state.contact.touching, state.contact.change_m_s, state.contact.ticks) == (True, 0.0, 4)
    state, _ = felt([0.0, -20.0, 12.0, 12.0, -8.0, -20.0], config=config)
    assert (state.contact.change_m_s, state.contact.ticks) == (0.5 * 28.0 * 2.0**-10, 5)
    state, _ = felt([0.0, -80.0, 20.0], config=config)
    assert (state.contact.change_m_s, state.contact.ticks) == (-0.5 * 20.0 * 2.0**-10, 1)
    assert state.contact.peak_m_s2 == 20.0


@pytest.mark.parametrize("lost", [1, 2, 3])
def test_lost_readings_are_bridged(lost: int) -> None:
    readings = pulse(300.0, 20)
    counters = [place for place in range(len(readings)) if not 18 <= place < 18 + lost]
    for share, fault in ((0.9, Fault.IMPULSE_LIMIT), (1.05, Fault.NONE)):
        config = replaced(CONFIG, "gate.change_m_s", share * impulse_n_s(readings) / MASS_KG)
        assert set(felt(readings, counters, config)[1]) == {Fault.NONE, fault}


def test_a_long_gap_invents_no_impulse() -> None:
    readings = [0.0] * 25 + [-200.0, 0.0, 0.0]
    state, _ = felt(readings[:26], counters=[0, 1, 2, 25])
    assert state.contact.change_m_s == pytest.approx(0.5 * 200.0 * 4e-3)


@pytest.mark.parametrize(
    ("before", "missing", "counter", "ticks", "missing_after"),
    [
        (-1, 0, 77, 1, 0),
        (3, 0, 4, 1, 0),
        (3, 0b1, 4, 1, 0b10),
        (3, 0, 7, 4, 0b111),
        (3, 0b1, 5, 2, 0b101),
        (255, 0, 0, 1, 0),
        (3, 0, 18, 15, 0b11_1111_1111_1111),
        (3, 0, 19, 16, 0x7FFF),
        (3, 0, 20, 17, 0xFFFF),
        (3, 0, 67, 64, 0xFFFF),
        (3, 0xFFFF, 68, 1, 0),
        (3, 0b1, 2, 0, 0),
        (3, 0xFFFF, 243, 0, 0x7FFF),
        (3, 0xFFFF, 242, 1, 0),
        # No frame is missing there: the sensor has restarted.
        (3, 0b10, 2, 1, 0),
        (3, 0, 243, 1, 0),
        (3, 0, 3, 1, 0),
    ],
)
def test_the_counter_gives_the_samples_between_two_frames(
    before: int, missing: int, counter: int, ticks: int, missing_after: int
) -> None:
    assert gate.count_ticks(before, missing, counter) == ticks
    assert gate.find_missing(before, missing, counter, ticks) == missing_after


@pytest.mark.parametrize("bit", range(8))
@pytest.mark.requirement("S-04")
def test_no_stuck_bit_of_the_counter_hides_an_impulse(bit: int) -> None:
    """Each counter is the true one with one bit at 0; wherever the contact is, it trips as with all bits."""
    contact = pulse(250.0, 20)
    assert Fault.IMPULSE_LIMIT in felt(contact)[1]
    for begin in range(0, 256, 4):
        state = gate.INITIAL
        found = []
        for place, high_m_s2 in enumerate([0.0] * begin + contact):
            state = gate.take(
                CONFIG.gate, state, Accelerometer(0.01 * place, high_m_s2, 0.0), place % 256 & ~(1 << bit)
            )
            state, findings = gate.judge(CONFIG.gate, state, CLOSED)
            found.append(findings.limit)
        assert Fault.IMPULSE_LIMIT in found


def test_a_late_reading_counts_for_the_force_and_ends_no_silence_of_another() -> None:
    state, _ = felt([0.0, 0.0, 0.0], [0, 2])
    late = gate.take(CONFIG.gate, state, Accelerometer(9.0, -1900.0, 0.0), 1)
    contact = state.contact._replace(fault=Fault.FORCE_LIMIT)
    assert late == state._replace(contact=contact, missing=0, reading_ticks=0)
    silent = state._replace(reading_ticks=CONFIG.gate.sensor_ticks + 2)
    anew = gate.take(CONFIG.gate, silent, Accelerometer(9.0, -19.0, 0.0), 1)
    assert (anew.counter, anew.contact.flight_m_s2) == (1, -19.0)


def test_all_readings_of_a_bundle_count_and_of_several_faults_one_is_named() -> None:
    """Readings that come in one tick are judged in that tick."""
    config = replaced(CONFIG, "gate.change_m_s", 0.01)
    state = gate.INITIAL
    for place, high_m_s2 in enumerate([0.0, -1900.0, -100.0, -100.0]):
        state = gate.take(config.gate, state, Accelerometer(0.0, high_m_s2, 0.0), place)
    state, findings = gate.judge(config.gate, state, CLOSED)
    assert findings.limit == Fault.FORCE_LIMIT
    assert gate.judge(config.gate, state, CLOSED)[1].limit == Fault.NONE


def test_a_deviation_that_stays_is_no_impact_and_trips() -> None:
    """An offset that has jumped: it trips, and the gate then knows the new one."""
    state, faults = felt([0.0] * 5 + [-14.0] * 110)
    assert faults[:105] == [Fault.NONE] * 105
    assert faults[105] == Fault.IMPULSE_LIMIT
    assert set(faults[106:]) == {Fault.NONE}
    assert state.contact == gate.IN_FLIGHT._replace(readings=gate.SETTLING_READINGS, flight_m_s2=-14.0)
    state, _ = felt([0.0] * 5 + [-14.0] * 101 + [-314.0])
    assert state.contact.change_m_s == pytest.approx(0.5 * 300.0 * 1e-3)
    force = replaced(CONFIG, "gate.peak_m_s2", 13.0)
    assert felt([0.0] * 5 + [-14.0] * 101, config=force)[1][-1] == Fault.FORCE_LIMIT


def test_a_sensor_that_starts_while_the_striker_swings_trips_nothing() -> None:
    """Its low-pass begins at 0: no contact begins before the flight is known. The force counts at once."""
    swing = [18.0 * math.cos(0.009 * k) * (1.0 - math.exp(-k / 2.0)) for k in range(400)]
    state, faults = gate.INITIAL, []
    for place, high_m_s2 in enumerate(swing):
        state = gate.take(CONFIG.gate, state, Accelerometer(0.01 * place, high_m_s2, 0.0), place % 256)
        state, findings = gate.judge(CONFIG.gate, state, CLOSED)
        faults.append(findings.limit)
        assert not state.contact.touching
    assert set(faults) == {Fault.NONE}
    hard = gate.take(CONFIG.gate, gate.INITIAL, Accelerometer(0.0, -1.8e3, 0.0), 0)
    assert gate.judge(CONFIG.gate, hard, CLOSED)[1].limit == Fault.FORCE_LIMIT


@pytest.mark.parametrize("begun_ticks", range(0, 10, 3))
def test_a_sensor_that_starts_within_a_contact_trips_nothing(begun_ticks: int) -> None:
    contact = [-200.0 * math.sin(math.pi * (k + 0.5) / 10) for k in range(begun_ticks, 10)]
    state, faults = gate.INITIAL, []
    for place, high_m_s2 in enumerate([*contact, *[0.0] * 150]):
        state = gate.take(CONFIG.gate, state, Accelerometer(0.01 * place, high_m_s2, 0.0), place % 256)
        state, findings = gate.judge(CONFIG.gate, state, CLOSED)
        faults.append(findings.limit)
    assert set(faults) == {Fault.NONE}
    assert state.contact == gate.IN_FLIGHT._replace(readings=gate.SETTLING_READINGS)


def test_a_sensor_that_never_is_steady_is_watched_all_the_same() -> None:
    state, steady = gate.INITIAL, []
    for place in range(300):
        state = gate.take(
            CONFIG.gate, state, Accelerometer(0.01 * place, 20.0 * (-1.0) ** place, 0.0), place % 256
        )
        steady.append(state.contact.readings)
    assert steady[98] < gate.SETTLING_READINGS == steady[102]


def test_after_a_silence_that_is_a_fault_nothing_is_known_of_the_flight() -> None:
    """After any shorter one the motor has a torque, and an impulse counts at once."""
    state, _ = felt([0.0, 0.0, -300.0])
    silent = replaced(CLOSED, "accelerometer.age_ticks", 1)
    for ticks, fault, touching in ((30, Fault.NONE, True), (31, Fault.SENSOR_TIMEOUT, False)):
        later, findings = guard(silent, ticks, state)
        assert findings.watchdog == fault
        later = gate.take(CONFIG.gate, later, Accelerometer(0.0, -40.0, 0.0), 200)
        assert later.contact.touching == touching
    assert later.contact.flight_m_s2 == -40.0
    clipped = state._replace(contact=state.contact._replace(fault=Fault.FORCE_LIMIT), reading_ticks=100)
    later = gate.take(CONFIG.gate, clipped, Accelerometer(0.0, -40.0, 0.0), 200)
    assert later.contact.fault == Fault.FORCE_LIMIT
    again = gate.take(CONFIG.gate, later._replace(reading_ticks=100), Accelerometer(0.0, -40.0, 0.0), 90)
    assert again.life.same_high == later.life.same_high + 1


# Watchdogs


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
    known, _ = guard()
    assert guard(replaced(CLOSED, path, longest), state=known)[1].watchdog == Fault.NONE
    assert guard(replaced(CLOSED, path, longest + 1), state=known)[1].watchdog == fault


def test_the_gates_own_clock_of_a_source_counts_too() -> None:
    """A source whose age stands still is stale nevertheless."""
    known, _ = guard()
    silent = replaced(CLOSED, "accelerometer.age_ticks", 1)
    assert guard(silent, 30, known)[1].watchdog == Fault.NONE
    assert guard(silent, 31, known)[1].watchdog == Fault.SENSOR_TIMEOUT
    silent = replaced(CLOSED, "encoder.age_ticks", 1)
    assert guard(silent, 30, known)[1].watchdog == Fault.NONE
    assert guard(silent, 31, known)[1].watchdog == Fault.ENCODER_TIMEOUT
    assert guard(replaced(CLOSED, "accelerometer.age_ticks", 1))[1].watchdog == Fault.SENSOR_TIMEOUT
    assert guard(replaced(CLOSED, "encoder.age_ticks", 1))[1].watchdog == Fault.ENCODER_TIMEOUT


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1e6, -1e6])
def test_a_position_that_is_no_number_is_silence(bad: float) -> None:
    known, _ = guard()
    broken = replaced(CLOSED, "encoder.position_rev", bad)
    assert guard(broken, 30, known)[1].watchdog == Fault.NONE
    assert guard(broken, 31, known)[1].watchdog == Fault.ENCODER_TIMEOUT
    assert not guard(broken, 31, known)[1].overspeed


@pytest.mark.parametrize(
    ("follow", "age_ticks", "fault"),
    [(1, 200, Fault.NONE), (1, 201, Fault.SENSOR_TIMEOUT), (0, 201, Fault.NONE)],
)
def test_the_gaits_sensors_are_watched_where_they_are_followed(
    follow: int, age_ticks: int, fault: Fault
) -> None:
    config = config_from({"gait.follow": follow})
    assert guard(replaced(CLOSED, "gait.age_ticks", age_ticks), config=config)[1].watchdog == fault


def test_a_tick_is_the_shortest_watch_over_the_gaits_sensors() -> None:
    silent = replaced(CLOSED, "gait.age_ticks", 2)
    short = replaced(config_from({"gait.follow": 1}), "gate.gait_ticks", 1)
    assert guard(silent, config=short)[1].watchdog == Fault.SENSOR_TIMEOUT


@pytest.mark.requirement("S-08")
def test_the_operator_has_a_watchdog() -> None:
    assert not guard(replaced(CLOSED, "operator.age_ticks", 350))[1].operator_lost
    assert guard(replaced(CLOSED, "operator.age_ticks", 351))[1].operator_lost


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
    state, found = guard()[0], set()
    for tick, age in enumerate([*range(1, silent_ticks + 1), *[0] * samples] * gaps):
        inputs = replaced(CLOSED, f"{source}.age_ticks", age)
        inputs = replaced(inputs, "accelerometer.low_m_s2", 0.01 * (tick % 2))  # not a stuck one
        inputs = replaced(inputs, "accelerometer.high_m_s2", 0.01 * (tick % 2))
        inputs = replaced(inputs, "accelerometer.housing_m_s2", 0.01 * (tick % 2))
        state, findings = guard(inputs, state=state)
        found.add(findings.watchdog)
    assert found == {Fault.NONE, fault}


# Measured limits


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
    assert guard(replaced(CLOSED, path, good), 1000)[1].limit == Fault.NONE
    assert guard(replaced(CLOSED, path, bad), ticks)[1].limit == fault
    if ticks > 1:
        assert guard(replaced(CLOSED, path, bad), ticks - 1)[1].limit == Fault.NONE
    assert guard(replaced(CLOSED, path, math.nan), 1000)[1].limit != Fault.NONE


def test_an_interrupted_condition_starts_anew() -> None:
    for path, bad, ticks in (("power.current_a", 15.0, 20), ("power.voltage_v", 10.0, 150)):
        state, _ = guard(replaced(CLOSED, path, bad), ticks)
        state, _ = guard(state=state)
        _, findings = guard(replaced(CLOSED, path, bad), ticks, state)
        assert findings.limit == Fault.NONE


def test_frozen_drive_data_is_found_out() -> None:
    frozen = replaced(CLOSED, "encoder.velocity_rev_s", 1.9)
    assert guard(frozen, 20)[1].limit == Fault.NONE
    assert guard(frozen, 21)[1].limit == Fault.DRIVE_FROZEN
    state, _ = guard(frozen, 20)
    # Silence says nothing about it; another position ends it.
    assert guard(replaced(frozen, "encoder.age_ticks", 1), 1, state)[0].frozen_ticks == 20
    assert guard(replaced(frozen, "encoder.position_rev", 0.01), 1, state)[0].frozen_ticks == 0
    for rad_s, fault in ((0.5, Fault.NONE), (1.0, Fault.DRIVE_FROZEN), (-1.0, Fault.DRIVE_FROZEN)):
        crawling = replaced(CLOSED, "encoder.velocity_rev_s", rad_s / math.tau)
        assert math.tau * crawling.encoder.velocity_rev_s == rad_s
        assert guard(crawling, 22)[1].limit == fault


def test_overspeed_by_the_drives_own_estimate() -> None:
    edge_rev_s = 37.5 / math.tau
    assert math.tau * edge_rev_s == 37.5
    for velocity_rev_s, overspeed in (
        (edge_rev_s, False),
        (-edge_rev_s, False),
        (6.0, True),
        (-6.0, True),
        (math.nan, True),
        (math.inf, True),
    ):
        assert guard(replaced(CLOSED, "encoder.velocity_rev_s", velocity_rev_s))[1].overspeed == overspeed


def turned(rad_s: float, ticks: int, late: dict[int, int] | None = None) -> tuple[GateState, list[Findings]]:
    """Positions of a crank that turns, with a speed estimate that reads 0."""
    state, found = gate.INITIAL, []
    for tick in range(ticks):
        seen = tick - (late or {}).get(tick, 0)
        inputs = replaced(CLOSED, "encoder.position_rev", 0.95 + rad_s * 1e-3 * seen / math.tau)
        state, findings = guard(inputs, state=state)
        found.append(findings)
    return state, found


@pytest.mark.parametrize(("rad_s", "overspeed"), [(24.9, False), (25.1, True), (-24.9, False), (-25.1, True)])
@pytest.mark.requirement("S-06")
def test_overspeed_by_the_positions_alone(rad_s: float, overspeed: bool) -> None:
    state, found = turned(rad_s, 60)
    assert state.own_rad_s == pytest.approx(rad_s)
    assert [findings.overspeed for findings in found[:20]] == [False] * 20
    assert found[20].overspeed == overspeed
    assert found[-1].overspeed == overspeed


def test_positions_on_both_sides_of_a_silence_give_no_speed() -> None:
    state, _ = turned(14.0, 30)
    silent = replaced(CLOSED, "encoder.age_ticks", 1)
    for ticks, own_rad_s in ((30, 14.0), (31, 0.0)):
        later, _ = guard(silent, ticks, state)
        assert later.own_rad_s == pytest.approx(14.0)
        later, _ = guard(
            replaced(CLOSED, "encoder.position_rev", 0.95 + 14e-3 * (29 + 31) / math.tau), 1, later
        )
        assert later.own_rad_s == pytest.approx(own_rad_s, rel=0.2)
        assert later.window_ticks == 0


# The torque


def permitted(
    torque_n_m: float,
    inputs: Inputs = CLOSED,
    findings: Findings = NOTHING,
    state: GateState = gate.INITIAL,
    config: Config = CONFIG,
) -> tuple[float, ActingLimit, bool]:
    state, torque, limit = gate.permit(config.gate, state, findings, inputs, torque_n_m)
    return torque, limit, state.shut


@pytest.mark.parametrize(
    ("proposed", "torque", "limit"),
    [
        (0.6, 0.6, ActingLimit.NONE),
        (-0.6, -0.6, ActingLimit.NONE),
        (0.61, 0.6, ActingLimit.TORQUE),
        (-5.0, -0.6, ActingLimit.TORQUE),
        (math.inf, 0.6, ActingLimit.TORQUE),
        (math.nan, 0.0, ActingLimit.TORQUE),
        (0.0, 0.0, ActingLimit.NONE),
    ],
)
@pytest.mark.requirement("S-05")
def test_the_torque_is_clamped(proposed: float, torque: float, limit: ActingLimit) -> None:
    assert permitted(proposed) == (torque, limit, False)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("by_positions", "limit_rad_s"), [(False, 20.0), (True, 22.5)])
def test_beyond_the_speed_limit_nothing_pushes_on(
    side: float, by_positions: bool, limit_rad_s: float
) -> None:
    """By the positions, whose speed is old, the limit lies halfway to OVERSPEED."""
    edge_rev_s = limit_rad_s / math.tau
    assert math.tau * edge_rev_s == limit_rad_s

    def at(rad_s: float, torque_n_m: float) -> tuple[float, ActingLimit, bool]:
        if by_positions:
            return permitted(torque_n_m, state=gate.INITIAL._replace(own_rad_s=rad_s))
        return permitted(torque_n_m, replaced(CLOSED, "encoder.velocity_rev_s", rad_s / math.tau))

    beyond_rad_s = limit_rad_s + 0.1
    assert at(side * limit_rad_s, side * 0.5) == (side * 0.5, ActingLimit.NONE, False)
    assert at(side * beyond_rad_s, side * 0.5) == (0.0, ActingLimit.SPEED, False)
    assert at(side * beyond_rad_s, -side * 0.5) == (-side * 0.5, ActingLimit.NONE, False)
    assert at(math.nan, side * 0.5) == (0.0, ActingLimit.SPEED, False)
    assert at(side * beyond_rad_s, 0.0) == (0.0, ActingLimit.NONE, False)


FOUND = [
    NOTHING._replace(watchdog=Fault.SENSOR_TIMEOUT),
    NOTHING._replace(limit=Fault.FORCE_LIMIT),
    NOTHING._replace(drive=Fault.DRIVE_ERROR),
    NOTHING._replace(operator_lost=True),
    NOTHING._replace(overspeed=True),
]


@pytest.mark.parametrize("findings", FOUND)
def test_every_finding_shuts_the_gate(findings: Findings) -> None:
    assert permitted(0.3, findings=findings) == (0.0, ActingLimit.SAFE_STATE, True)
    assert permitted(math.nan, findings=findings) == (0.0, ActingLimit.SAFE_STATE, True)
    assert permitted(0.0, findings=findings) == (0.0, ActingLimit.NONE, False)


def test_an_estop_shuts_the_gate() -> None:
    assert permitted(0.3, CLOSED._replace(estop=True)) == (0.0, ActingLimit.SAFE_STATE, True)


def test_a_shut_gate_opens_where_nothing_is_proposed_and_the_axis_is_idle() -> None:
    shut = gate.INITIAL._replace(shut=True)
    idle, old = HEALTHY, replaced(HEALTHY, "drive.age_ticks", 1)
    for torque, inputs, stays in (
        (0.3, CLOSED, True),
        (0.3, idle, True),
        (math.nan, idle, True),
        (0.0, CLOSED, True),
        (0.0, old, True),
        (0.0, idle, False),
    ):
        limit = ActingLimit.SAFE_STATE if stays else ActingLimit.NONE
        assert permitted(torque, inputs, state=shut) == (0.0, limit, stays)
