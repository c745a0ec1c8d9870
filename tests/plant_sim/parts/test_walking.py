"""A module on a walking leg: the motion against finite differences, the strides, the sensors."""

import math
import time
from itertools import pairwise
from typing import Any

import mpmath
import numpy as np
import pytest
from changed_scenes import changed

from plant_sim.kernels import jit
from plant_sim.parts import walking as w
from plant_sim.parts.housing import expand_housing, housing_m_s2, shock_m_s, smooth_for_s
from plant_sim.parts.walking import KNOCK_M_S2, Walking, leg_at, row_at
from plant_sim.plant import Plant
from plant_sim.result import LegState
from plant_sim.scene import Scene, load_scene
from plant_sim.sensors.gait import GaitReading, GaitSensors, GaitTruth, gait_at
from plant_sim.solvers.bernstein import scratch_arrays
from plant_sim.tables.sensor_tables import GaitSensorsTable

G = 9.80665
PACES = [
    {"at_s": 0.0, "stride_hz": 0.9},
    {"at_s": 5.0, "stride_hz": 1.08},
    {"at_s": 12.0, "stride_hz": 0.0},
    {"at_s": 15.0, "stride_hz": 0.45},
]
UNEVEN = {"axis": "forward", "pace": PACES, "stumble": [{"at_s": 7.0}], "stance_share": 0.56}
STEADY = {"axis": "outward", "pace": [{"at_s": 0.0, "stride_hz": 0.9}], "variability": 0.0}


def scene(gait: dict[str, Any] | None, name: str = "table1-viscous", **changes: Any) -> Scene:
    dotted = {key.replace("__", "."): value for key, value in changes.items()}
    return load_scene(changed(name, dotted | ({} if gait is None else {"gait": gait})))


def walking_of(gait: dict[str, Any], seed: int = 1) -> Walking:
    housing = scene(gait).parts(seed).housing
    assert isinstance(housing, Walking)
    return housing


def cycle(gait: dict[str, Any], shares: list[float]) -> list[GaitTruth]:
    """The truth at these shares of the third stride."""
    walking = walking_of(gait)
    begin, length = walking.rows[2, w.BEGIN_S], walking.rows[2, w.LENGTH_S]
    return [gait_at(walking, begin + share * length) for share in shares]


# --- the leg ------------------------------------------------------------------------------------------


def test_the_shank_does_what_the_normative_curves_do() -> None:
    """Winter's landmarks in degrees: back at heel strike, over the foot in mid-stance, far in front."""
    degrees = [math.degrees(at.shank_rad) for at in cycle(STEADY, [0.0, 0.2, 0.4, 0.6, 0.7, 0.9])]
    assert degrees == pytest.approx([-20.0, 2.0, 15.0, 43.0, 52.0, -6.0], abs=2.0)
    rates = [math.degrees(at.shank_rad_s) for at in cycle(STEADY, list(np.linspace(0.0, 1.0, 200)))]
    assert min(rates) == pytest.approx(-373.0, abs=5.0)
    assert max(rates) == pytest.approx(172.0, abs=5.0)


def test_the_calf_pushes_off_in_late_stance_alone() -> None:
    """Rounded landmarks of a natural cadence: toes let down, push-off of 1.6 N m/kg, an idle swing."""
    shares = np.linspace(0.0, 1.0, 501)[:-1]
    moment = np.array([at.ankle_n_m_kg for at in cycle(STEADY, list(shares))])
    assert np.max(moment) == pytest.approx(1.6, abs=0.05)
    assert shares[np.argmax(moment)] == pytest.approx(0.47, abs=0.01)
    assert np.min(moment) == pytest.approx(-0.1, abs=0.02)
    assert shares[np.argmin(moment)] == pytest.approx(0.05, abs=0.02)
    assert np.max(np.abs(moment[(shares > 0.65) & (shares < 0.97)])) < 0.05
    assert moment[shares < 0.6].mean() > 10.0 * np.abs(moment[shares > 0.65]).mean()


@pytest.mark.parametrize(("hertz", "peak"), [(0.45, 0.85), (0.9, 1.0), (1.2, 1.1)])
def test_push_off_grows_with_the_cadence_and_follows_the_warp(hertz: float, peak: float) -> None:
    shares = np.linspace(0.0, 1.0, 501)[:-1]
    gait = STEADY | {"pace": [{"at_s": 0.0, "stride_hz": hertz}], "stance_share": 0.56}
    moment = np.array([at.ankle_n_m_kg for at in cycle(gait, list(shares))])
    assert np.max(moment) == pytest.approx(1.61 * peak, abs=0.02)
    assert shares[np.argmax(moment)] < 0.43
    standing = gait_at(walking_of(STEADY | {"pace": [{"at_s": 0.0, "stride_hz": 0.0}]}), 1.0)
    assert standing.ankle_n_m_kg == 0.0


def test_the_ankle_stands_still_in_stance_and_travels_a_stride_in_swing() -> None:
    walking = walking_of(STEADY)
    stride_m, hertz = walking.rows[2, w.FROM_STRIDE_M], walking.rows[2, w.FROM_HZ]
    assert (stride_m, hertz) == pytest.approx((1.56 * 0.9, 0.9))
    phase = np.linspace(0.0, 1.0, 401)
    k = 2.0 * np.pi * np.arange(w.ORDER + 1)
    cosines, sines = map(np.array, w.ADVANCE)
    angle = phase[:, None] * k
    speed = 1.0 + (k * (sines * np.cos(angle) - cosines * np.sin(angle))).sum(axis=1)  # of walking speed
    assert np.max(np.abs(speed[(phase > 0.1) & (phase < 0.4)])) < 0.2
    assert 3.0 < np.max(speed) < 3.5
    assert 0.75 < phase[np.argmax(speed)] < 0.85


def test_the_warp_moves_toe_off_and_nothing_else() -> None:
    shares = [0.3, 0.55, 0.57, 0.9]
    states = [at.state for at in cycle(STEADY | {"stance_share": 0.56}, shares)]
    assert states == [LegState.STANCE, LegState.STANCE, LegState.SWING, LegState.SWING]
    assert [at.phase for at in cycle(STEADY | {"stance_share": 0.56}, shares)] == pytest.approx(shares)


@jit
def _expand(walking, t_s, series, work):
    expand_housing(walking, t_s, series, work)


def expanded(walking: Walking, t_s: float, order: int) -> np.ndarray:
    """Taylor coefficients of a_b."""
    series, work = np.full(order + 1, np.nan), scratch_arrays().stack
    work[:] = np.nan
    _expand(walking, t_s, series, work)
    return series


@pytest.mark.parametrize(
    ("kind", "strides", "later_s", "is_in_bump", "warp"),
    [
        ("even", 3.2, 0.0, False, 0.0),
        ("even", 3.0, 0.01, True, 0.09),
        ("start", 0.3, 0.0, False, 0.0),
        ("stride", 0.0, 0.0, True, 0.09),
        ("stride", 0.0, -1e-13, True, 0.0),
        ("stride", 0.0, w.STRIKE_S - 1e-13, False, 0.09),
        ("knock", 0.0, 0.05, True, 0.0),
        ("knock", 0.0, w.KNOCK_S - 1e-13, False, 0.09),
        ("stop", 0.9, 0.0, False, 0.09),
    ],
)
def test_the_series_is_that_of_the_motion_of_the_module(
    kind: str, strides: float, later_s: float, is_in_bump: bool, warp: float
) -> None:
    """At these times in a row: within a heel strike or a knock, and at its ends within rounding."""
    paces = PACES[:3] if kind == "stop" else PACES
    axis = {"axis_up": 0.36, "axis_forward": 0.48, "axis_outward": -0.8}
    walking = walking_of(UNEVEN | {"pace": paces})._replace(warp=warp, **axis)
    sizes, knocks = walking.rows[:, [w.FROM_SIZE, w.TO_SIZE]], walking.rows[:, KNOCK_M_S2]
    row = {
        "even": walking.rows[-1],
        "start": walking.rows[(sizes[:, 0] == 0.0) & (sizes[:, 1] > 0.0)],
        "stride": walking.rows[2:],
        "knock": walking.rows[knocks > 0.0],
        "stop": walking.rows[(sizes[:, 0] > 0.0) & (sizes[:, 1] == 0.0)],
    }[kind].reshape(-1, w.COLUMNS)[0]
    strike_s = mpmath.mpf(row[w.BEGIN_S]) + strides / mpmath.mpf(
        row[w.TO_HZ if kind == "start" else w.FROM_HZ]
    )
    t_s = float(strike_s + later_s)
    circle_s = 5e-3 * np.exp(2j * np.pi * np.arange(32) / 32)
    with mpmath.workdps(20):
        bump_s = strike_s if is_in_bump else None
        felt = [complex(_felt(walking, row, mpmath.mpf(t_s) + complex(after), bump_s)) for after in circle_s]
    wanted = np.fft.fft(felt).real / 32  # Cauchy's formula: c_k (5 ms)^k
    for order in (1, 7, 16):
        got = expanded(walking, t_s, order) * 5e-3 ** np.arange(order + 1)
        assert got == pytest.approx(wanted[: order + 1], abs=1e-10)
    assert housing_m_s2(walking, t_s) == pytest.approx(wanted[0], abs=1e-10)


def _felt(walking: Walking, row: np.ndarray, t: Any, bump_s: Any) -> Any:
    """a_b from the module's place, h over the ankle, with the bump that begins at `bump_s`."""
    h, sin, cos = walking.mount_m, mpmath.sin, mpmath.cos

    begin_s, length_s = mpmath.mpf(row[w.BEGIN_S]), mpmath.mpf(row[w.LENGTH_S])

    def between(first: int, t: Any) -> Any:
        s, change = (t - begin_s) / length_s, mpmath.mpf(row[first + 1]) - mpmath.mpf(row[first])
        return row[first] + change * s**3 * (10 - 15 * s + 6 * s**2)

    def phase(t: Any) -> Any:
        s, change = (t - begin_s) / length_s, mpmath.mpf(row[w.TO_HZ]) - mpmath.mpf(row[w.FROM_HZ])
        grown = change * length_s * s**4 * (2.5 - 3 * s + s**2) if change else 0
        return row[w.PHASE] + row[w.FROM_HZ] * (t - begin_s) + grown

    def curve(pair: tuple[tuple[float, ...], tuple[float, ...]], t: Any, size: int = w.FROM_SIZE) -> Any:
        angle = 2 * mpmath.pi * (phase(t) + walking.warp * sin(mpmath.pi * phase(t)) ** 2)
        waves = [a * cos(k * angle) + b * sin(k * angle) for k, (a, b) in enumerate(zip(*pair, strict=True))]
        return between(size, t) * sum(waves)

    def forward_m(t: Any) -> Any:
        return curve(w.ADVANCE, t, w.FROM_STRIDE_M) + h * sin(curve(w.SHANK_RAD, t))

    speed = mpmath.diff(lambda t: between(w.FROM_STRIDE_M, t) * between(w.FROM_HZ, t), t)
    forward = speed + mpmath.diff(forward_m, t, 2)
    fall = G + mpmath.diff(lambda t: curve(w.RISE_M, t), t, 2)
    upward = fall + mpmath.diff(lambda t: h * cos(curve(w.SHANK_RAD, t)), t, 2)
    outward = mpmath.diff(lambda t: curve(w.SWAY_M, t) + h * curve(w.TILT_RAD, t), t, 2)
    lean, tilt = curve(w.SHANK_RAD, t), curve(w.TILT_RAD, t)
    strike, knock = (
        0 if bump_s is None else row[peak] * sin(mpmath.pi * (t - bump_s) / lasts_s) ** 2
        for peak, lasts_s in ((w.STRIKE_M_S2, w.STRIKE_S), (KNOCK_M_S2, w.KNOCK_S))
    )
    return (
        walking.axis_up * (forward * sin(lean) + upward * cos(lean) + strike)
        + walking.axis_forward
        * (forward * cos(lean) - upward * sin(lean) - w.STRIKE_BACKWARD * strike - knock)
        + walking.axis_outward * (outward - fall * sin(tilt))
    )


@pytest.mark.parametrize("axis", ["up", "forward", "outward", "inward"])
def test_the_series_goes_on_as_what_is_felt_does(axis: str) -> None:
    walking = walking_of(UNEVEN | {"axis": axis})
    for t in np.arange(0.0003, 20.0, 0.0237):
        series, longest_s = expanded(walking, t, 16), min(smooth_for_s(walking, t), 5e-3)
        for after_s in (0.0, 0.6 * longest_s, longest_s):
            after = np.polynomial.polynomial.polyval(after_s, series)
            assert housing_m_s2(walking, t + after_s) == pytest.approx(after, abs=1e-9)


def test_nothing_jumps_from_stride_to_stride_nor_on_starting_and_stopping() -> None:
    walking = walking_of(UNEVEN)
    for begin in walking.rows[1:20, w.BEGIN_S]:
        before, after = leg_at(walking, np.nextafter(begin, 0.0)), leg_at(walking, begin)
        assert np.allclose(before, after, rtol=0.0, atol=1e-9)


def test_a_step_ends_where_a_heel_strike_a_knock_or_a_stride_does() -> None:
    walking = walking_of(UNEVEN)
    knocks = walking.rows[:, w.KNOCK_M_S2] > 0.0
    assert np.sum(knocks) == 1
    corners = sorted(
        {
            *walking.rows[1:25, w.BEGIN_S],
            *(walking.rows[1:25, w.BEGIN_S] + w.STRIKE_S)[walking.rows[1:25, w.STRIKE_M_S2] > 0.0],
            *(walking.rows[knocks, w.BEGIN_S] + w.KNOCK_S),
        }
    )
    t, met = 0.04, 0
    while t < 17.0:
        t_next = t + min(smooth_for_s(walking, t), 0.02)
        inside = [corner for corner in corners if t + 1e-9 < corner < t_next - 1e-9]
        assert not inside
        met += any(abs(corner - t_next) < 1e-9 for corner in corners)
        t = t_next
    assert met == sum(0.04 < corner < 17.0 for corner in corners)


# --- the strides --------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", ["up", "forward"])
def test_a_heel_strike_and_a_knock_bring_the_velocity_of_their_bumps(axis: str) -> None:
    walking = walking_of(UNEVEN | {"axis": axis})
    smooth = walking._replace(rows=walking.rows.copy())
    smooth.rows[:, [w.STRIKE_M_S2, w.KNOCK_M_S2]] = 0.0
    # Bumps are squares of sines over 30 and 80 ms, whose mean over midpoints of milliseconds is exact.
    steps_s = np.arange(0.5e-3, w.KNOCK_S, 1e-3)
    bumps = 0
    for begin_s in walking.rows[:, w.BEGIN_S]:
        times_s = begin_s + steps_s
        change = sum(housing_m_s2(walking, t) - housing_m_s2(smooth, t) for t in times_s) * 1e-3
        assert shock_m_s(walking, begin_s) == pytest.approx(change, abs=1e-9)
        assert shock_m_s(walking, begin_s + 1e-3) == 0.0
        bumps += abs(change) > 1e-3
    assert bumps > 3


def test_strides_are_the_seeds_own() -> None:
    first, again, other = (walking_of(UNEVEN, seed).rows for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first[:5], other[:5])
    plants = [Plant(scene(UNEVEN), seed).parts.housing for seed in (1, 2)]
    assert isinstance(plants[1], Walking)
    assert np.array_equal(plants[1].rows, other)


def test_stride_times_vary_as_much_as_asked() -> None:
    rows = walking_of(STEADY | {"variability": 0.03}).rows[:-1]
    hertz = rows[:, w.FROM_HZ]
    assert np.std(hertz) == pytest.approx(0.03 * 0.9, rel=0.1)
    assert np.mean(hertz) == pytest.approx(0.9, rel=0.01)
    assert np.array_equal(rows[:, w.TO_HZ][:-1], hertz[1:])
    assert np.all(np.diff(rows[:, w.PHASE]) == 1.0)


def test_a_walk_changes_pace_stops_and_starts_by_its_script() -> None:
    walking = walking_of(UNEVEN | {"stumble": [], "variability": 0.0})
    hertz = [gait_at(walking, t).stride_hz for t in (0.5, 9.0)]
    assert hertz == pytest.approx([0.9, 1.08], abs=0.02)
    standing = np.array([gait_at(walking, t).state == LegState.STANDING for t in np.arange(0.0, 20.0, 0.01)])
    first, last = np.flatnonzero(standing)[[0, -1]] * 0.01
    assert 12.0 - 1.3 < first < 12.0 + 1.3
    assert last == pytest.approx(15.0, abs=0.02)
    assert gait_at(walking, 25.0).stride_hz == pytest.approx(0.45, abs=1e-6)
    assert math.isnan(gait_at(walking, 14.0).phase)


def test_the_phase_grows_by_the_frequency() -> None:
    walking = walking_of(UNEVEN)
    t = np.arange(0.0, 11.0, 1e-3)
    truths = [gait_at(walking, at) for at in t]
    phase = np.unwrap([at.phase for at in truths], period=1.0)
    middle = np.array([at.stride_hz for at in truths])
    assert np.max(np.abs(np.gradient(phase, 1e-3)[1:-1] - middle[1:-1])) < 1e-4


def test_a_stumble_is_a_knock_in_mid_swing_and_uneven_strides_after_it() -> None:
    steady, trips = STEADY | {"axis": "backward"}, {"stumble": [{"at_s": 5.0, "knock_m_s2": 20.0}]}
    even, uneven = walking_of(steady), walking_of(steady | trips)
    row = uneven.rows[uneven.rows[:, w.KNOCK_M_S2] > 0.0][0]
    assert row[w.PHASE] % 1.0 == 0.75
    assert 5.0 <= row[w.BEGIN_S] < 5.0 + 1.2
    middle = row[w.BEGIN_S] + w.KNOCK_S / 2.0
    smooth = uneven._replace(rows=np.where(uneven.rows == 20.0, 0.0, uneven.rows))
    assert housing_m_s2(uneven, middle) - housing_m_s2(smooth, middle) == pytest.approx(20.0)
    lengths = np.diff([r[w.BEGIN_S] for r in uneven.rows[:12] if r[w.PHASE] % 1.0 == 0.0])
    assert np.ptp(lengths) > 0.3
    assert np.allclose(lengths[-2:], 1.0 / 0.9)
    assert np.ptp(np.diff(even.rows[:12, w.BEGIN_S])) < 1e-9


TIMES = [-1e-3, 0.25 * w.STRIKE_S, 0.5 * w.STRIKE_S, 0.75 * w.STRIKE_S, 1.1 * w.STRIKE_S]


def test_the_longest_script_of_a_walk_is_sampled_soon() -> None:
    """A thousand paces over the longest run, and a thousand stumbles at once."""
    paces = [{"at_s": 86.4 * number, "stride_hz": 1.4 + 0.1 * (number % 2)} for number in range(1000)]
    begun_s = time.process_time()
    rows = walking_of({"axis": "up", "pace": paces, "stumble": [{"at_s": 86_400.0}] * 1000}).rows
    assert time.process_time() - begun_s < 10.0
    assert 100_000 < len(rows) < 150_000


@pytest.mark.parametrize("after_s", [10.0, 700.0, 86_399.0])
def test_a_walk_keeps_its_heel_strikes(after_s: float) -> None:
    """However long it lasts: one in every stride, at the phase of 0, and a step of the solver ends there."""
    walking = walking_of(STEADY | {"axis": "up"})
    soft = walking_of(STEADY | {"axis": "up", "heel_strike_m_s2": 0.0})
    begin_s = float(walking.rows[row_at(walking.rows, after_s), w.BEGIN_S])
    begin_s += math.ceil((after_s - begin_s) * 0.9) / 0.9
    for stride in range(3):
        strike_s = begin_s + stride / 0.9
        at = [housing_m_s2(walking, strike_s + t_s) - housing_m_s2(soft, strike_s + t_s) for t_s in TIMES]
        assert at == pytest.approx([0.0, 5.0, 10.0, 5.0, 0.0], abs=1e-6)
        assert smooth_for_s(walking, strike_s - 1e-3) == pytest.approx(1e-3, abs=1e-10)
        assert shock_m_s(walking, strike_s) == pytest.approx(0.5 * w.STRIKE_S * 10.0)
        assert shock_m_s(walking, strike_s + 1e-3) == 0.0


# --- the module ---------------------------------------------------------------------------------------


STANDING = {"pace": [{"at_s": 0.0, "stride_hz": 0.0}]}


# --- the sensors --------------------------------------------------------------------------------------

QUIET = {
    "rate_noise_rad_s": 0.0,
    "rate_bias_rad_s": 0.0,
    "along_noise_m_s2": 0.0,
    "along_bias_m_s2": 0.0,
    "tilt_rad": 0.0,
    "twist_rad": 0.0,
    "bounce_s": 0.0,
}


def sensed(
    sensors: dict[str, Any], gait: dict[str, Any], until_s: float = 10.0, seed: int = 1
) -> list[tuple[GaitTruth, GaitReading | None]]:
    plant = Plant(scene(gait, "gait-motor-soft", sensors={"gait": QUIET | sensors}), seed)
    found = []
    for _ in range(round(until_s / 5e-3)):
        truth = plant.gait_at(plant.t_s)
        assert truth is not None
        reading = GaitReading(*plant.sense_gaits(np.array([plant.t_s]))[0].tolist())
        found.append((truth, None if math.isnan(reading.shank_rate_rad_s) else reading))
        plant.advance(0.0, 5e-3)
    return found


def test_quiet_sensors_read_the_truth() -> None:
    for truth, reading in sensed({}, UNEVEN, 3.0):
        assert reading is not None
        assert reading.shank_rate_rad_s == truth.shank_rad_s
        assert reading.along_m_s2 == truth.up_m_s2
        assert reading.heel_contact == (truth.heel_load > 0.1)
        assert reading.toe_contact == (truth.toe_load > 0.1)


def test_switches_close_and_open_in_the_order_of_a_step() -> None:
    """Heel, toe, heel off, toe off at 62 %: each within a few per cent of the cycle."""
    found = sensed({}, STEADY, 12.0)
    edges: dict[str, list[float]] = {"heel on": [], "toe on": [], "heel off": [], "toe off": []}
    for (_, before), (truth, after) in pairwise(found):
        assert before is not None
        assert after is not None
        for name, was, now in (
            ("heel", before.heel_contact, after.heel_contact),
            ("toe", before.toe_contact, after.toe_contact),
        ):
            if was != now:
                edges[f"{name} {'on' if now else 'off'}"].append(truth.phase)
    means = [float(np.mean(phases)) for phases in edges.values()]
    assert means == pytest.approx([0.015, 0.16, 0.37, 0.59], abs=0.03)
    assert {len(phases) for phases in edges.values()} <= {10, 11}


def test_noise_bias_and_mounting_are_as_large_as_asked() -> None:
    asked = {"rate_noise_rad_s": 0.05, "rate_bias_rad_s": 0.2, "along_noise_m_s2": 0.3, "tilt_rad": 0.1}
    found = sensed(asked, STEADY)
    rate = np.array([reading.shank_rate_rad_s - truth.shank_rad_s for truth, reading in found if reading])
    assert (np.mean(rate), np.std(rate)) == pytest.approx((0.2, 0.05), rel=0.1)
    along = np.array(
        [
            reading.along_m_s2 - truth.up_m_s2 * math.cos(0.1) - truth.forward_m_s2 * math.sin(0.1)
            for truth, reading in found
            if reading
        ]
    )
    assert np.std(along) == pytest.approx(0.3, rel=0.1)
    assert abs(np.mean(along)) < 0.03


def test_frames_drop_out_in_runs_of_the_length_asked() -> None:
    lost = np.array(
        [reading is None for _, reading in sensed({"dropout_share": 0.2, "dropout_s": 0.05}, STEADY, 60.0)]
    )
    assert np.mean(lost) == pytest.approx(0.2, abs=0.05)
    runs = np.diff(np.flatnonzero(np.diff(np.r_[False, lost, False]))[:], n=1)[::2]
    assert np.mean(runs) * 5e-3 == pytest.approx(0.05, rel=0.25)


@pytest.mark.parametrize("share", [0.5, 0.9, 0.99])
def test_as_many_frames_drop_out_as_the_table_says(share: float) -> None:
    """With drop-outs of four frames, and one frame between two of them, no more than 0.8 would be reached."""
    walking = walking_of(STEADY)
    table = GaitSensorsTable(dropout_share=share, dropout_s=0.02)
    read = GaitSensors(table, walking, 1, 5e-3).read(5e-3 * np.arange(100_000))
    assert np.mean(np.isnan(read[:, 0])) == pytest.approx(share, abs=0.02)


def test_a_switch_bounces_after_it_changes_and_at_no_other_time() -> None:
    clean, bouncing = sensed({}, STEADY), sensed({"bounce_s": 0.03}, STEADY)
    differs = [
        truth.phase
        for (truth, one), (_, other) in zip(clean, bouncing, strict=True)
        if one and other and one.heel_contact != other.heel_contact
    ]
    assert differs
    assert all(0.0 <= phase < 0.06 or 0.33 < phase < 0.43 for phase in differs)


def test_gait_sensors_leave_the_others_noise_alone() -> None:
    """A scene's accelerometers read the same noise whether somebody stands in it or not."""
    readings = []
    for gait in (None, STANDING | {"axis": "forward"}):
        plant = Plant(scene(gait, "gait-motor-soft"), seed=4)
        readings.append([])
        for _ in range(20):
            readings[-1].append(plant.sense().housing_m_s2)
            if gait is not None:
                plant.sense_gaits(np.array([plant.t_s]))
            plant.advance(0.0, 1e-3)
    assert readings[0] == pytest.approx(readings[1], abs=1e-12)


@pytest.mark.parametrize("first_s", [0.0, 590.0, 700.0])
def test_every_trip_of_a_script_happens_and_the_walk_finds_back(first_s: float) -> None:
    """A hundred, one a stride: the last of them two minutes after its time."""
    scripted = {**STEADY, "stumble": [{"at_s": first_s + 0.01 * i} for i in range(100)]}
    walking = walking_of(scripted)
    assert np.count_nonzero(walking.rows[:, KNOCK_M_S2]) == 100
    assert gait_at(walking, 5000.0).stride_hz == pytest.approx(0.9, rel=1e-6)


def test_a_script_stops_a_walk_after_any_time() -> None:
    """At 700 s, and a trip at 800 s of somebody who walks on."""
    scripted = {**STEADY, "pace": [{"at_s": 0.0, "stride_hz": 0.9}, {"at_s": 700.0, "stride_hz": 0.0}]}
    assert gait_at(walking_of(scripted), 699.0).stride_hz > 0.8
    assert gait_at(walking_of(scripted), 710.0).state == LegState.STANDING
    trips = {**STEADY, "stumble": [{"at_s": 800.0}]}
    assert any(gait_at(walking_of(trips), 800.0 + 0.01 * i).tripping for i in range(300))
    assert gait_at(walking_of(trips), 5000.0).stride_hz == pytest.approx(0.9, rel=1e-6)
