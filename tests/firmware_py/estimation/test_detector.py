import numpy as np
import pytest

from firmware_py.core.estimation import detector
from firmware_py.core.estimation.estimator_state import Contact, Prediction
from firmware_py.core.estimation.kalman import Covariance, StateEstimate
from firmware_py.interface.enums import ContactPhase
from firmware_py.interface.zeroed import zeroed
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
COMING = zeroed(
    Prediction,
    estimate=zeroed(StateEstimate, x_m=0.179, v_m_s=0.9, p=zeroed(Covariance, xx=1e-8, vv=1e-6)),
    started=True,
    carried=True,
)


def coming(excess_m_s2: float, base: Prediction = COMING, **place: float) -> Prediction:
    """The striker near the stop, pushed back by `excess_m_s2`; `place` says what of its estimate differs."""
    return base._replace(innovation_m_s2=-excess_m_s2, estimate=base.estimate._replace(**place))


def run(excesses: list[float], base: Prediction = COMING, **place: float) -> list[Contact]:
    state, found = detector.INITIAL, []
    for excess in excesses:
        state, contact = detector.step(CONFIG.detector, CONFIG.nominal, state, coming(excess, base, **place))
        found.append(contact)
    return found


def phase_after(excesses: list[float]) -> ContactPhase:
    state = detector.INITIAL
    for excess in excesses:
        state, _ = detector.step(CONFIG.detector, CONFIG.nominal, state, coming(excess))
    return state.phase


def test_a_touch_down_is_found_at_the_first_tick_beyond_the_floor() -> None:
    found = run([0.5, 1.4, 1.6, 60.0])
    assert [c.touch_down for c in found] == [False, False, True, False]
    assert phase_after([0.5, 1.4, 1.6, 60.0]) == ContactPhase.CONTACT


def test_a_pull_is_no_touch_down() -> None:
    assert not any(c.touch_down for c in run([-100.0] * 20))


def test_the_threshold_follows_the_spread_of_the_innovation() -> None:
    unsure = COMING._replace(spread_m_s2=10.0)
    assert not any(c.touch_down for c in run([40.0], unsure))
    assert run([100.0], unsure)[0].touch_down


@pytest.mark.parametrize("changes", [{"x_m": 0.10}, {"v_m_s": -0.5}])
def test_far_from_the_stop_or_leaving_one_reading_is_no_impact(changes: dict[str, float]) -> None:
    assert not run([7.0], **changes)[0].touch_down


def test_noise_far_from_the_stop_is_no_impact_once_it_is_known() -> None:
    """Noise of 0.3 g: two seconds of it had a dozen touch-downs, which misled the estimate."""
    rng = np.random.default_rng(3)
    readings_m_s2 = 3.0 * rng.standard_normal(2200)
    state, found = detector.INITIAL, []
    for k in range(2, len(readings_m_s2)):
        z, before, second = readings_m_s2[[k, k - 1, k - 2]]
        sensor = COMING.sensor._replace(acceleration_m_s2=z, before_m_s2=before, second_m_s2=second)
        noisy = coming(float(-z), COMING._replace(sensor=sensor), x_m=0.10)
        state, contact = detector.step(CONFIG.detector, CONFIG.nominal, state, noisy)
        found.append(contact.touch_down)
    assert sum(found[200:]) == 0
    assert state.roughness_m_s2 == pytest.approx(np.sqrt(12.0 / np.pi) * 3.0, rel=0.2)
    missing = COMING._replace(sensor=sensor._replace(missed_ticks=1))
    assert detector.follow_roughness(CONFIG.detector, state, missing) == state.roughness_m_s2


def test_a_lost_estimate_does_not_hide_a_impact() -> None:
    assert [c.touch_down for c in run([30.0, 200.0], x_m=0.10)] == [False, True]


@pytest.mark.parametrize("speed", [0.1, 0.4, 0.9])
def test_the_age_of_a_hertz_contact_is_found_between_ticks(speed: float) -> None:
    errors = []
    for age in np.linspace(0.3e-3, 1.2e-3, 10):
        excess = CONFIG.nominal.contact_growth * (speed * age) ** 1.5
        if excess > CONFIG.p.detector.floor_m_s2:
            slowed = speed - excess * (0.5 * CONFIG.tick_s + CONFIG.nominal.sensor_delay_s)
            contact = run([excess], v_m_s=slowed)[0]
            errors.append(contact.age_s - CONFIG.nominal.sensor_delay_s - age)
            assert contact.approach_speed_m_s == pytest.approx(speed, abs=0.03)
    assert errors
    assert np.abs(errors).max() < 1e-4


def contact_run(
    excesses: list[float], speeds: list[float], clipped: bool = False
) -> tuple[list[Contact], detector.DetectorState]:
    state, found = detector.INITIAL, []
    for excess, speed in zip(excesses, speeds, strict=True):
        sensor = COMING.sensor._replace(clipped=clipped and excess > 100.0)
        predicted = coming(excess, COMING._replace(sensor=sensor), v_m_s=speed)
        state, contact = detector.step(CONFIG.detector, CONFIG.nominal, state, predicted)
        found.append(contact)
    return found, state


def test_a_contact_ends_below_its_share_of_the_peak_and_gives_the_impulse() -> None:
    excesses = [10.0, 150.0, 300.0, 150.0, 20.0, 5.0, 0.5]
    speeds = [0.9, 0.8, 0.4, -0.1, -0.4, -0.45, -0.45]
    found, state = contact_run(excesses, speeds)
    assert [c.separation for c in found] == [False] * 5 + [True, False]
    assert found[5].measured
    assert state.impulse_n_s == pytest.approx(0.8 * 1e-3 * sum(excesses[:6]))
    assert state.since_touch_down_s == pytest.approx(found[0].age_s + 5e-3)
    assert state.impacts == 1


def test_a_clipped_contact_is_not_measured() -> None:
    found, state = contact_run([10.0, 300.0, 300.0, 0.0], [0.9, 0.5, -0.1, -0.2], clipped=True)
    assert found[3].separation
    assert not found[3].measured
    assert state.impulse_n_s == pytest.approx(1.5 * 0.8 * found[0].approach_speed_m_s)


@pytest.mark.parametrize("leaving", [0.6, -1.6])
def test_a_rebound_that_no_stop_can_give_is_not_measured(leaving: float) -> None:
    found, _ = contact_run([10.0, 300.0, 0.0], [0.9, 0.2, leaving])
    assert found[2].separation
    assert not found[2].measured


@pytest.mark.parametrize(("largest", "from_readings"), [(1400.0, True), (50.0, False)])
def test_where_estimate_and_readings_contradict_each_other_the_harder_impact_counts(
    largest: float, from_readings: bool
) -> None:
    excesses = [10.0, largest, 0.7 * largest, 0.4 * largest, 0.5]
    found, state = contact_run(excesses, [1.1, 0.5, -0.5, -1.5, -2.1])
    assert found[4].separation
    assert not found[4].measured
    expected = 1.5 * 0.8 * found[0].approach_speed_m_s
    assert state.impulse_n_s == pytest.approx(0.8e-3 * sum(excesses) if from_readings else expected)


def test_after_a_separation_the_detector_is_blind_for_its_refractory_time() -> None:
    excesses = [10.0, 300.0, 0.0] + [50.0] * 10
    found, state = contact_run(excesses, [0.9, 0.2, -0.45] + [0.3] * 10)
    again = [k for k, c in enumerate(found) if c.touch_down]
    assert again == [0, 3 + CONFIG.detector.refractory_ticks - 1]
    assert state.impacts == 2


def test_a_contact_without_readings_ends_after_its_nominal_time() -> None:
    state, contact = detector.step(CONFIG.detector, CONFIG.nominal, detector.INITIAL, coming(50.0))
    silent = COMING._replace(sensor=COMING.sensor._replace(missed_ticks=1))
    ticks = 0
    while not contact.separation:
        state, contact = detector.step(CONFIG.detector, CONFIG.nominal, state, silent)
        ticks += 1
        assert ticks < 100
    assert ticks == CONFIG.nominal.contact_ticks
    assert not contact.measured


def test_no_contact_lasts_for_ever() -> None:
    longest_ticks = CONFIG.detector.longest_contact_ticks
    found, state = contact_run(
        [50.0] * (longest_ticks + 1),
        [0.5] * (longest_ticks + 1),
    )
    assert found[-1].separation
    assert state.phase == ContactPhase.FREE


def test_nothing_is_found_before_the_estimate_has_started() -> None:
    assert not run([100.0], COMING._replace(started=False))[0].touch_down


@pytest.mark.parametrize("lost", [6, 7, 8])
def test_a_lost_reading_does_not_hide_an_impact_that_the_estimate_missed(lost: int) -> None:
    """A kick just before the touch-down: the readings give four times the impulse that the speed implies."""
    excesses = [4.0 * 60.0 * np.sin(np.pi * k / 12) for k in range(1, 12)]
    speeds = list(np.linspace(0.9, -0.45, 11))
    state = detector.INITIAL
    for place, (excess, speed) in enumerate(zip([*excesses, 0.0], [*speeds, -0.45], strict=True)):
        sensor = COMING.sensor._replace(missed_ticks=1 if place == lost else 0)
        state, contact = detector.step(
            CONFIG.detector,
            CONFIG.nominal,
            state,
            coming(float(excess), COMING._replace(sensor=sensor), v_m_s=float(speed)),
        )
    assert (contact.separation, contact.measured) == (True, False)
    integral_n_s = CONFIG.p.striker.mass_kg * CONFIG.tick_s * (sum(excesses) - excesses[lost])
    assert state.impulse_n_s == pytest.approx(integral_n_s)
    assert state.impulse_n_s > (1.0 + CONFIG.p.stop.restitution) * CONFIG.p.striker.mass_kg * 0.9
