"""The gate's first readings, to the reading, and what its limits and the monitors' tracker are made of."""

import pytest

from firmware_py.core.safety import gate, own_crank
from firmware_py.core.safety.gate import ContactState
from firmware_py.interface.enums import Fault
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.shell.parameters import config_from

LIMITS = config_from({}).gate


def after(readings: list[float]) -> ContactState:
    """The contact after these readings, the first of a gate that has just started."""
    contact = gate.INITIAL.contact
    for high_m_s2 in readings:
        contact = gate.integrate_reading(LIMITS, contact, high_m_s2, 1)
    return contact


def test_a_contact_may_begin_after_eight_steady_readings() -> None:
    assert not after([5.0] * 7 + [-50.0]).touching
    assert after([5.0] * 8 + [-50.0]).touching


def test_a_jump_is_itself_the_first_steady_reading() -> None:
    assert not after([5.0] * 3 + [50.0] * 7 + [0.0]).touching
    assert after([5.0] * 3 + [50.0] * 8 + [0.0]).touching


def test_readings_that_differ_by_the_limit_are_steady() -> None:
    assert after([0.0, 12.0] * 4).readings == gate.SETTLING_READINGS


def test_settling_ends_after_the_longest_contact() -> None:
    """Readings that are never steady: a tenth of a second of them, 100 ticks, is no end yet."""
    restless = [20.0, -20.0] * 51
    assert after(restless[:100]).readings == 1
    assert after(restless[:101]).readings == gate.SETTLING_READINGS


@pytest.mark.parametrize("readings", [[5.0] * 3, [5.0] * 8])
def test_no_deviation_is_left_of_the_settling(readings: list[float]) -> None:
    assert after(readings).deviation_m_s2 == 0.0


@pytest.mark.parametrize(("side", "limits"), [(-1.0, 1.0), (1.0, 2.0)])
def test_the_force_of_the_first_reading_counts_from_zero(side: float, limits: float) -> None:
    """The stop pushes with negative readings; a pull has twice the limit. A late frame has its force only."""
    config = config_from({"limit.force_n": 400.0})
    for beyond_m_s2, fault in ((-0.5, Fault.NONE), (0.5, Fault.FORCE_LIMIT)):
        high_m_s2 = side * (limits * 400.0 / config.p.striker.mass_kg + beyond_m_s2)
        contact = gate.integrate_reading(config.gate, gate.INITIAL.contact, high_m_s2, 0)
        assert contact.fault == fault


def test_the_channels_own_limits() -> None:
    """The share of a full scale that counts as clipped is the same for both ranges."""
    scales = {"sensor.low_full_scale_m_s2": 80.0, "sensor.high_full_scale_m_s2": 1600.0}
    limits = config_from({**scales, "sensor.high_offset_m_s2": 7.0, "limit.force_n": 800.0}).gate
    assert limits.low_clipped_m_s2 == pytest.approx(80.0 / 1600.0 * limits.clipped_m_s2)
    assert limits.differ_m_s2 == pytest.approx(7.0 + 3.0)


@pytest.mark.parametrize(("weight", "reads"), [(0.0, False), (0.5, True), (1.0, True)])
def test_the_housings_channel_is_watched_where_it_counts(weight: float, reads: bool) -> None:
    assert config_from({"sensor.housing_weight": weight}).gate.reads_housing is reads


@pytest.mark.parametrize(("torque_n_m", "inertia_kg_m2"), [(0.6, 5e-4), (0.3, 1e-4)])
def test_the_monitors_tracker_follows_four_thirds_of_the_largest_torque(
    torque_n_m: float, inertia_kg_m2: float
) -> None:
    values = {"speed.torque_limit_n_m": torque_n_m, "motor.inertia_kg_m2": inertia_kg_m2}
    tracker = config_from(values).own_crank.crank.tracker
    assert tracker.largest_rad_s2 == pytest.approx(4.0 / 3.0 * torque_n_m / inertia_kg_m2)


def test_the_monitors_know_no_pull_before_the_first_reading() -> None:
    assert own_crank.INITIAL.pull_m_s2 == 0.0


def test_the_first_reading_after_a_silence_is_a_tick_of_settling() -> None:
    silent = gate.INITIAL._replace(counter=7, reading_ticks=LIMITS.sensor_ticks + 2)
    for counter in (8, 60):
        state = gate.take(LIMITS, silent, Accelerometer(0.0, 5.0, 0.0), counter)
        assert (state.contact.readings, state.contact.ticks) == (1, 1)
