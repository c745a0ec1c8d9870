"""Figures of faults and of the way to the safe state, on made-up records with known answers."""

import numpy as np
import pytest
from run_folder import records

from firmware_py.interface.enums import Fault, Mode
from hil.figures.faults import (
    BEFORE_FAULT_S,
    NO_TORQUE_N_M,
    SETTLE_S,
    SILENT_S,
    DriveEnd,
    drive_end,
    fault_figures,
    first_fault,
    held_ms,
    latched_figures,
    safe_state_figures,
    torque_after,
    undisturbed,
    zero_after,
)
from hil.figures.hold import Window
from hil.record.run_faults import RunFault
from hil.record.run_traces import RunTraces

T_S = 0.01
OMEGA_RAD_S = 4.0 * np.pi  # two turns a second


def firmware(modes, end_s=None, t_s=None, faults=None, torque_n_m=0.0):
    """The firmware's records: one mode a tick of 10 ms."""
    t_s = T_S * np.arange(len(modes)) if t_s is None else t_s
    kept = np.ones(len(t_s), bool) if end_s is None else t_s <= end_s + 1e-9
    n = len(t_s)
    found = records(
        t_s=t_s,
        tick=np.arange(n),
        outputs__mode=modes,
        outputs__fault=np.full(n, Fault.NONE) if faults is None else faults,
        outputs__torque_n_m=np.full(n, torque_n_m),
    )
    return found[kept]


def plant(n, end_s=None, torque_n_m=0.0, omega_rad_s=OMEGA_RAD_S):
    t_s = T_S * np.arange(n)
    kept = np.ones(n, bool) if end_s is None else t_s <= end_s + 1e-9
    columns = {"motor_torque_n_m": torque_n_m, "omega_rad_s": omega_rad_s}
    found = records(
        t_s=t_s, tick=np.arange(n), **{name: np.broadcast_to(one, n) for name, one in columns.items()}
    )
    return found[kept]


def impacts(*t_s, v_m_s=1.0, force_n=100.0):
    n = len(t_s)
    return records(t_s=t_s, v_m_s=np.full(n, v_m_s), peak_force_n=np.broadcast_to(force_n, n))


@pytest.mark.parametrize(
    ("torque_n_m", "since_s", "zero_s"),
    [
        ([0.2, 0.2, 0.0, 0.0], 0.0, 0.02),
        ([0.2, 0.2, 0.0, 0.0], 0.01, 0.01),
        ([0.2, 0.2, 0.0, 0.0], 0.02, 0.0),
        ([0.0, 0.0, -0.2, 0.0], 0.0, 0.03),
        ([0.0, 0.0, 0.0, 0.2], 0.0, None),
        ([np.nan, 0.0, 0.0, 0.0], 0.0, 0.01),
        ([0.0, 0.0, 0.0, 0.0], 0.05, None),
        ([5e-4, 5e-4, 0.0, 0.0], 0.0, 0.02),  # held by the drive near a change of sign
        ([NO_TORQUE_N_M, 0.0, 0.0, 0.0], 0.0, 0.01),
        ([0.999 * NO_TORQUE_N_M, 0.0, 0.0, 0.0], 0.0, 0.0),
    ],
)
def test_the_torque_is_zero_from_its_last_tick_on(torque_n_m, since_s, zero_s):
    found = zero_after(T_S * np.arange(4), np.array(torque_n_m), since_s)
    assert found == (None if zero_s is None else pytest.approx(zero_s))


def test_a_torque_that_ends_at_its_limit_is_within_it():
    """Of sums of milliseconds in binary, some differences are longer than what they stand for."""
    t_s = 0.001 * np.arange(8000)
    late = [at for at in range(6000, 7000) if zero_after(t_s, 1.0 * (t_s < t_s[at + 352]), t_s[at]) > 0.352]
    assert late == []


RUN, READY, FAULT, E_STOP = Mode.RUN, Mode.READY, Mode.FAULT, Mode.E_STOP


@pytest.mark.parametrize(
    ("modes", "firmware_end_s", "plant_end_s", "end"),
    [
        ([READY] * 100, None, None, None),
        ([RUN] * 100, None, None, None),
        ([RUN] * 50 + [FAULT] * 50, None, None, DriveEnd("fault", 0.5)),
        ([RUN] * 50 + [E_STOP] * 50, None, None, DriveEnd("e-stop", 0.5)),
        ([Mode.STOPPING] * 50 + [READY] * 50, None, None, DriveEnd("stop", 0.5)),
        ([RUN] * 20 + [FAULT] * 30 + [RUN] * 20 + [READY] * 30, None, None, DriveEnd("stop", 0.7)),
        ([RUN] * 99 + [FAULT], None, None, DriveEnd("fault", 0.99)),
        # A node whose trace ends SILENT_S before the other's is silent.
        ([RUN] * 100, 0.5, None, DriveEnd("firmware-silent", 0.5)),
        ([RUN] * 100, 0.99 - SILENT_S - T_S, None, DriveEnd("firmware-silent", 0.99 - SILENT_S - T_S)),
        ([RUN] * 100, 0.99 - SILENT_S + T_S, None, None),
        ([RUN] * 100, None, 0.5, DriveEnd("plant-silent", 0.5)),
        ([RUN] * 100, None, 0.99 - SILENT_S + T_S, None),
        ([RUN] * 53 + [FAULT] * 47, None, 0.5, DriveEnd("plant-silent", 0.5)),
        ([RUN] * 51 + [FAULT] * 49, None, 0.5, DriveEnd("plant-silent", 0.5)),
        # A plant that ended after the stop did not cause it.
        ([RUN] * 30 + [READY] * 70, None, 0.5, DriveEnd("stop", 0.3)),
    ],
)
def test_the_drive_ends_with_its_last_tick_or_with_a_silent_node(modes, firmware_end_s, plant_end_s, end):
    found = drive_end(plant(100, plant_end_s), firmware(modes, firmware_end_s))
    assert found == (None if end is None else (end.cause, pytest.approx(end.at_s)))


def test_without_a_plant_the_firmware_alone_says_how_it_ended():
    no_plant = plant(100)[:0]
    assert drive_end(no_plant, firmware([RUN] * 50 + [FAULT] * 50)) == ("fault", pytest.approx(0.5))
    end = DriveEnd("fault", 0.5)
    after = safe_state_figures(no_plant, firmware([RUN] * 100), impacts(0.7), end)
    assert (after.torque_zero_after_s, after.impacts_after) == (None, None)
    assert torque_after(no_plant, end) is None


def test_a_node_that_ends_just_so_long_before_the_other_is_not_silent():
    late, early = np.array([0.5, 1.0]), np.array([0.5, 1.0 - SILENT_S])
    still = records(t_s=early, motor_torque_n_m=[0, 0], omega_rad_s=[0, 0])
    assert drive_end(still, firmware([RUN] * 2, t_s=late)) is None
    still["t_s"] = [0.5, 0.7]
    assert drive_end(still, firmware([RUN] * 2, t_s=late)) == ("plant-silent", 0.7)
    still["t_s"] = late
    assert drive_end(still, firmware([RUN] * 2, t_s=early)) is None
    assert drive_end(still[:0], firmware([RUN] * 2, t_s=np.array([0.1, 0.5]))) is None


def test_the_safe_state_has_the_torque_and_the_impacts_after_its_beginning():
    end = DriveEnd("fault", 0.5)
    on_s = T_S * np.arange(100)
    motor_n_m = np.where(on_s < 0.55, -0.2, 0.0)
    found = safe_state_figures(
        plant(100, torque_n_m=motor_n_m),
        firmware([RUN] * 100, torque_n_m=np.where(on_s < 0.52, 0.1, 0.0)),
        impacts(0.4, 0.5, 0.6, 0.7, 0.8),
        end,
    )
    assert (found.cause, found.at_s, found.impacts_after) == ("fault", 0.5, 3)
    assert (found.torque_zero_after_s, found.command_zero_after_s) == pytest.approx((0.05, 0.02))
    settled_n_m = np.where(on_s < 0.5 + SETTLE_S, -0.3, -0.2)
    assert torque_after(plant(100, torque_n_m=settled_n_m), end) == pytest.approx(0.2)
    settled_n_m[on_s == 0.5 + SETTLE_S] = -0.25
    assert torque_after(plant(100, torque_n_m=settled_n_m), end) == pytest.approx(0.25)
    assert torque_after(plant(100), None) is None
    assert safe_state_figures(plant(9), firmware([RUN] * 9), impacts(), None).at_s is None


@pytest.mark.parametrize(
    ("faults", "windows"),
    [
        ([], []),
        ([(3.0, None)], [(3.0, 9.0)]),
        ([(3.0, 3.5), (2.0, 2.25)], [(2.25, 3.0), (3.5, 9.0)]),
        ([(2.0, 6.0), (3.0, None)], [(6.0, 9.0)]),
        ([(2.0, 3.0), (2.5, 4.0), (3.5, 3.6)], [(4.0, 9.0)]),
        ([(2.0, 2.25), (9.0, 9.5)], [(2.25, 9.0)]),
        ([(2.0, 9.5)], []),
    ],
)
def test_impacts_count_between_the_faults_of_the_hold(faults, windows):
    assert undisturbed(run_with(*faults), Window(0.5, 9.0)) == windows


@pytest.mark.parametrize(
    ("faults", "missing", "again_s"),
    [
        # Two kicks, each with its own outage, and one whose outage a short fault does not hide.
        ([(4.0, 4.1), (4.6, 5.5)], (4.0, 6.0), 0.75),
        ([(3.0, 3.1), (6.0, 6.0)], (6.0, 7.0), 1.25),
        ([(4.0, 4.0), (7.4, 7.401)], (4.0, 7.5), 3.4),
        ([(4.0, 4.0), (8.99, 9.2)], (4.0, 7.5), 3.75),
        ([(4.0, 4.0), (5.0, 5.1)], (4.0, 10.0), None),
        # The last one lasts beyond the hold: nothing shows that impacts came back.
        ([(2.0, 2.1), (3.0, 10.5)], (3.0, 10.0), None),
    ],
)
def test_impacts_are_back_after_each_of_several_faults(faults, missing, again_s):
    from_s, to_s = missing
    times_s = REGULAR[(from_s > REGULAR) | (to_s < REGULAR)]
    found = fault_figures(
        RunTraces(run=run_with(*faults), plant=plant(1000), impacts=impacts(*times_s)), HOLD
    )
    assert found.impacts_again_after_s == (None if again_s is None else pytest.approx(again_s))


def run_with(*intervals_s):
    """The note of a run with faults from … to …."""
    faults = [RunFault("kick", "plant", False, *interval_s, "kick") for interval_s in intervals_s]
    return {"faults": [fault._asdict() for fault in faults]}


HOLD = Window(0.0, 9.99)


def faulty(n=1000, hold=HOLD, at_s=4.0, duration_s=1.0, impacts_t_s=None, force_n=100.0, **of_plant):
    """Figures of a run of 10 s with a fault, at two turns and, by default, two impacts a second."""
    t_s = np.arange(0.25, 10.0, 0.5) if impacts_t_s is None else impacts_t_s
    run = run_with((at_s, at_s + duration_s))
    traces = RunTraces(run=run, plant=plant(n, **of_plant), impacts=impacts(*t_s, force_n=force_n))
    return fault_figures(traces, hold)


REGULAR = np.arange(0.25, 10.0, 0.5)


@pytest.mark.parametrize(
    ("hold", "impacts_t_s", "omega_rad_s", "again_s"),
    [
        # The end of the fault is at 5 s. A gap may have 1.5 drive periods, 0.75 s.
        (HOLD, REGULAR, OMEGA_RAD_S, 0.25),
        (HOLD, REGULAR, -OMEGA_RAD_S, 0.25),
        (HOLD, REGULAR[(REGULAR < 6.0) | (REGULAR > 7.0)], OMEGA_RAD_S, 2.25),
        (HOLD, REGULAR[REGULAR < 9.0], OMEGA_RAD_S, None),
        (Window(0.0, 8.9), REGULAR[REGULAR < 9.0], OMEGA_RAD_S, 0.25),
        (HOLD, REGULAR[REGULAR < 5.0], OMEGA_RAD_S, None),
        (HOLD, REGULAR[(REGULAR < 6.0) | (REGULAR > 6.5)], OMEGA_RAD_S, 1.75),
        # At half the speed a gap may have 1.5 s: this one has 1 s.
        (HOLD, REGULAR[(REGULAR < 6.0) | (REGULAR > 6.5)], 0.5 * OMEGA_RAD_S, 0.25),
        (HOLD, REGULAR, 0.0, 0.25),
        (Window(0.0, 5.0), REGULAR, OMEGA_RAD_S, None),
        (Window(0.0, 4.5), REGULAR, OMEGA_RAD_S, None),
        (Window(0.0, 5.0), [*REGULAR, 5.0], OMEGA_RAD_S, None),
        (None, REGULAR, OMEGA_RAD_S, None),
        # The impacts at the very ends of the interval count.
        (HOLD, [5.0, *REGULAR[REGULAR > 5.0]], OMEGA_RAD_S, 0.0),
        (Window(0.0, 5.25), REGULAR, OMEGA_RAD_S, 0.25),
    ],
)
def test_impacts_are_back_from_where_every_drive_period_of_the_hold_has_one(
    hold, impacts_t_s, omega_rad_s, again_s
):
    found = faulty(hold=hold, impacts_t_s=impacts_t_s, omega_rad_s=omega_rad_s).impacts_again_after_s
    assert found == (None if again_s is None else pytest.approx(again_s))


def test_a_slow_crank_has_long_periods():
    """At 0.9 rad/s a gap may have 10.5 s: the first has 14.8 s."""
    found = faulty(n=3000, hold=Window(0.0, 29.99), impacts_t_s=[5.25, 20.0], omega_rad_s=0.9)
    assert found.impacts_again_after_s == pytest.approx(15.0)


def test_figures_after_a_fault_begin_with_it():
    t_s = T_S * np.arange(1000)
    torque_n_m = np.select([t_s < 3.995, t_s < 4.495], [0.9, -0.5], 0.0)
    omega_rad_s = np.select([t_s < 3.995, t_s < 5.0, t_s < 9.495], [30.0, -20.0, 8.0], 2.0)
    force_n = np.where(REGULAR < 4.0, 900.0, 100.0 + REGULAR)
    found = faulty(torque_n_m=torque_n_m, omega_rad_s=omega_rad_s, force_n=force_n)
    assert found.torque_zero_after_s == pytest.approx(0.5)
    assert found.impacts_after_zero == np.count_nonzero(REGULAR > 4.5)
    assert (found.largest_torque_n_m, found.largest_speed_rad_s) == (0.5, 20.0)
    assert found.peak_force_n == 109.75
    assert found.turning_at_end_rad_s == 2.0


@pytest.mark.parametrize(
    ("impacts_t_s", "force_n", "peak_n"),
    [([1.0], 100.0, 0.0), ([6.0], np.nan, None), ([4.0], 100.0, 100.0), ([6.0, 7.0], [np.nan, 50.0], 50.0)],
)
def test_the_force_after_a_fault_is_0_without_impacts_and_unknown_at_a_rigid_stop(
    impacts_t_s, force_n, peak_n
):
    assert faulty(impacts_t_s=impacts_t_s, force_n=force_n).peak_force_n == peak_n


def test_an_impact_in_the_tick_of_zero_torque_is_not_after_it():
    torque_n_m = np.where(T_S * np.arange(1000) < 4.245, 0.5, 0.0)
    found = faulty(torque_n_m=torque_n_m, impacts_t_s=[4.0, 4.25, 4.26])
    assert found.impacts_after_zero == 1
    assert faulty(torque_n_m=0.5).impacts_after_zero is None


def test_a_run_that_ends_before_the_fault_has_no_figures_of_it():
    assert faulty(n=399).largest_torque_n_m is None
    assert faulty(n=401).largest_torque_n_m == 0.0
    assert faulty(n=0).largest_torque_n_m is None


def test_the_first_fault_stays_the_first():
    latched = [Fault.NONE, Fault.STALL, Fault.OVERSPEED]
    assert first_fault(firmware([RUN] * 3, faults=latched)) is Fault.STALL
    assert first_fault(firmware([RUN] * 3)) is Fault.NONE
    quiet = latched_figures(plant(3), firmware([RUN] * 3), T_S)
    assert (quiet.at_s, quiet.firmware_held_ms, quiet.plant_held_ms) == (None, None, None)
    found = latched_figures(plant(3), firmware([RUN] * 3, faults=latched), T_S)
    assert (found.at_s, found.firmware_held_ms, found.plant_held_ms) == pytest.approx((T_S, 0.0, 0.0))


@pytest.mark.parametrize(
    ("first", "end", "held"),
    [  # Between 0.505 s and 0.715 s there are the ticks 51 to 71.
        (60, 65, 50.0),
        (45, 51, 0.0),
        (51, 53, 0.0),
        (52, 55, 30.0),
        (70, 71, 10.0),
        (71, 80, 0.0),
        (52, 71, 190.0),
        (52, 72, None),
        (40, 100, None),
    ],
)
def test_the_longest_stall_before_a_fault_is_looked_for_in_its_last_fifth_of_a_second(first, end, held):
    ticks = np.array([tick for tick in range(100) if not first <= tick < end])
    found = held_ms(records(t_s=T_S * ticks, tick=ticks), 0.705, T_S)
    assert BEFORE_FAULT_S == 0.2
    assert found == (None if held is None else pytest.approx(held))


@pytest.mark.parametrize(
    ("first", "end", "held"), [(31, 34, 0.0), (30, 34, 0.0), (48, 51, 30.0), (49, 52, 0.0)]
)
def test_a_tick_at_the_very_edge_of_that_time(first, end, held):
    """The tick 30 is just too early, 51 the last that counts."""
    ticks = np.array([tick for tick in range(100) if not first <= tick < end])
    times_s = T_S * ticks
    assert {0.5 - BEFORE_FAULT_S, 0.5 + T_S} & set(times_s)
    assert held_ms(records(t_s=times_s, tick=ticks), 0.5, T_S) == pytest.approx(held)
