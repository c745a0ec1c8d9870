"""Identification from one log: the truth it never saw, within the goals; refusals and warnings."""

import json
import os
import tracemalloc
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from firmware_py.interface.codec import CODECS
from firmware_py.interface.dbc import layouts
from firmware_py.interface.generated.records import Accelerometer, EncoderEstimates
from hil.record import candump
from hil.record.candump import BusLog, bus_log
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.scenario.scenario import check_scenario
from plant_sim.scene import read_scene
from tools import cli
from tools.bring_up.module_fit import SLOW
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, BadInputError
from tools.tuning import safety
from tools.tuning.identification.first_values import StillStrikerError
from tools.tuning.identification.flights import contacts_of, flights_of, integrals
from tools.tuning.identification.friction_laws import Law, Striker
from tools.tuning.identification.identify import (
    DRY_M_S2,
    Identified,
    bench_of,
    flight_spread,
    identify,
    tune_identify,
)
from tools.tuning.identification.impacts import (
    FREE,
    STEP,
    Pull,
    contact_time_s,
    dissipation,
    filter_forces,
    fit_impact,
    integrate,
)
from tools.tuning.recordings.readings import Readings, read, read_ticks, ticks_of
from tools.tuning.result import Tuning

SPRING_N_PER_M, STOP_M, RESTITUTION = 71.1, 0.1802, 0.47
BANDWIDTH_HZ, NOISE_M_S2 = 400.0, 0.0145
ACCELEROMETER, ENCODER = CODECS[Accelerometer], CODECS[EncoderEstimates]
SENSED = [ACCELEROMETER.encode(Accelerometer(1.0, 1.0, 0.0)), ENCODER.encode(EncoderEstimates(0.5, 0.0))]


def record(
    run_dir: Path,
    friction: dict[str, Any],
    firmware: dict[str, Any],
    amplitude_m: float,
    ratio: float,
    duration_s: float,
) -> Path:
    """A run of a module that differs from the nominal one."""
    scene = read_scene("table1-motor-soft")
    scene["striker"]["spring_n_m"] = SPRING_N_PER_M
    scene["stop"] |= {"position_m": STOP_M, "restitution": RESTITUTION}
    scene["drive"]["amplitude_m"] = amplitude_m
    scene["friction"] = friction
    scene["sensors"] = {"striker_low": {"bias_m_s2": -0.31}}
    commands = [
        {"at_s": 0.5, "request": "run", "target_ratio": ratio},
        {"at_s": duration_s - 3.0, "request": "idle"},
    ]
    document = {
        "title": "to identify",
        "scene": scene,
        "firmware": firmware,
        "script": {"duration_s": duration_s, "commands": commands},
    }
    in_lockstep(Job(check_scenario(document, "to-identify"), 7, folder=run_dir))
    for trace in run_dir.glob("*.trace"):
        trace.unlink()  # the truth among them: nothing but the CAN log is left
    return run_dir


@pytest.fixture(scope="module")
def viscous(tmp_path_factory: pytest.TempPathFactory) -> Path:
    law = {"law": "viscous", "b_n_s_m": 0.26}
    return record(tmp_path_factory.mktemp("viscous"), law, {}, 0.0201, 1.3, 60.0)


@pytest.fixture(scope="module")
def identified(viscous: Path) -> tuple[Tuning, Identified, Readings]:
    return tune_identify(viscous)


@pytest.fixture(scope="module")
def tuned(identified: tuple[Tuning, Identified, Readings]) -> Tuning:
    return identified[0]


@pytest.fixture(scope="module")
def recorded(identified: tuple[Tuning, Identified, Readings]) -> Readings:
    return identified[2]


def test_a_minute_is_identified_better_than_the_goals_ask(tuned: Tuning) -> None:
    """Spring, friction, stop and restitution far better: a change that costs accuracy is seen here first."""
    values = tuned.values
    assert values["striker.spring_n_m"] == pytest.approx(SPRING_N_PER_M, rel=0.0005)
    assert values["friction.b_n_s_m"] == pytest.approx(0.26, rel=0.01)
    assert values["friction.mu"] == 0.0
    assert values["stop.position_m"] == pytest.approx(STOP_M, abs=3e-5)
    assert values["stop.restitution"] == pytest.approx(RESTITUTION, abs=0.003)
    assert values["stop.contact_s"] == pytest.approx(0.01, rel=0.03)
    assert values["drive.amplitude_m"] == pytest.approx(0.0201, rel=0.005)
    assert tuned.figures_of_merit["accelerometer_offset"].value == pytest.approx(-0.31, abs=0.005)


def test_the_bounds_hold_spring_and_friction(tuned: Tuning) -> None:
    for name, truth in (
        ("striker.spring_n_m", SPRING_N_PER_M),
        ("friction.b_n_s_m", 0.26),
        ("drive.amplitude_m", 0.0201),
    ):
        value = tuned.parameters[name]
        width = value.high - value.low
        assert value.low - 0.5 * width < truth < value.high + 0.5 * width
        assert 0.0 < width < 0.05 * truth


def test_a_dry_guide_with_a_rise_towards_rest_is_recognised_and_measured(tmp_path: Path) -> None:
    run = record(
        tmp_path / "stribeck",
        {"law": "stribeck", "mu": 0.12, "mu_s": 0.18, "v_s_m_s": 0.07, "delta": 1.0},
        {"friction": {"b_n_s_m": 0.0, "mu": 0.12}, "drive": {"amplitude_m": 0.03}},
        0.0305,
        1.1,
        30.0,
    )
    tuning, found, _ = tune_identify(run)
    assert found.law == Law.STRIBECK
    assert tuning.values["friction.mu"] == pytest.approx(0.12, rel=0.02)
    assert tuning.values["friction.b_n_s_m"] == 0.0
    assert tuning.figures_of_merit["stribeck_mu_s"].value == pytest.approx(0.18, rel=0.02)
    assert tuning.figures_of_merit["stribeck_v_s"].value == pytest.approx(0.07, rel=0.1)
    assert tuning.figures_of_merit["stribeck_delta"].value == 1.0
    assert tuning.values["striker.spring_n_m"] == pytest.approx(SPRING_N_PER_M, rel=0.005)
    assert tuning.values["stop.position_m"] == pytest.approx(STOP_M, abs=1e-4)
    assert tuning.values["stop.restitution"] == pytest.approx(RESTITUTION, abs=0.01)


def cut(readings: Readings, begin_s: float, end_s: float) -> Readings:
    begin, end = round(begin_s / readings.period_s), round(end_s / readings.period_s)
    return Readings(
        readings.period_s,
        readings.acceleration_m_s2[begin:end],
        readings.housing_m_s2[begin:end],
        readings.angle_rad[begin:end],
        ((0, end - begin),),
    )


def test_a_short_log_says_less(identified: tuple[Tuning, Identified, Readings]) -> None:
    _, whole, readings = identified
    short = identify(cut(readings, 30.0, 36.0), BANDWIDTH_HZ)
    for name in ("stiffness_1_s2", "damping_1_s", "amplitude_m"):
        widths = [one.bounds[name][1] - one.bounds[name][0] for one in (short, whole)]
        assert widths[0] > 1.5 * widths[1]


def test_a_log_in_which_nothing_moves_is_refused(recorded: Readings) -> None:
    with pytest.raises(BadInputError, match="free flights"):
        identify(cut(recorded, 0.0, 0.5), BANDWIDTH_HZ)


def test_a_long_log_in_which_nothing_moves_is_refused(recorded: Readings) -> None:
    still = cut(recorded, 0.0, 0.4)
    readings = still.acceleration_m_s2, still.housing_m_s2, still.angle_rad
    long = [np.tile(reading, 15) for reading in readings]
    with pytest.raises(BadInputError, match="never moves faster"):
        identify(Readings(still.period_s, *long, ((0, len(long[0])),)), BANDWIDTH_HZ)


def test_a_striker_whose_best_fit_sticks_is_refused_as_one_that_stands_still() -> None:
    """The housing shakes it a little: the first fit takes that for motion, which friction then holds."""
    noise, period_s, rows = np.random.default_rng(24), 5e-3, 4000
    t_s = np.arange(rows) * period_s
    z_m_s2 = 0.06 * np.sin(2.0 * np.pi * 0.7 * t_s) + 0.05 * noise.standard_normal(rows)
    readings = Readings(period_s, z_m_s2, np.zeros(rows), 2.0 * t_s, ((0, rows),))
    with pytest.raises(StillStrikerError, match="never moves faster"):
        identify(readings, BANDWIDTH_HZ, True, SLOW)


def test_other_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="is not there"):
        read(tmp_path / "nowhere", 156.9)
    (tmp_path / "other.log").write_text("(0.001000) can0 123#00\n")
    with pytest.raises(BadInputError, match="0 frames of the accelerometer"):
        read(tmp_path / "other.log", 156.9)


# --- parts --------------------------------------------------------------------------------------------


def test_flights_lie_between_contacts(recorded: Readings) -> None:
    contacts = contacts_of(recorded)
    assert len(contacts) > 90
    flights = flights_of(recorded, contacts, 0.00056)
    spans = sorted([(one.begin, one.end) for one in flights] + [(one.before, one.after) for one in contacts])
    assert all(end <= begin for (_, end), (begin, _) in pairwise(spans))


def test_a_log_that_begins_with_a_single_tick_has_no_contact_there(recorded: Readings) -> None:
    apart = recorded._replace(pieces=((0, 1), (2, len(recorded.acceleration_m_s2))))
    assert contacts_of(apart) == contacts_of(recorded)


@pytest.mark.parametrize("contact_s", [0.003, 0.01, 0.025])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.3, 1.2])
@pytest.mark.parametrize("touch_down_s", 0.04 + 0.0001 * np.arange(10))
def test_a_contact_begins_within_a_period_of_its_touch_down(
    touch_down_s: float, contact_s: float, speed_m_s: float
) -> None:
    """A soft stop lets a slow striker's reading fall by a few m/s² only, in ten periods."""
    scale_s = 0.003 * contact_s / contact_time_s(0.003, speed_m_s)
    rows = np.arange(200) * 1e-3
    pushes = filter_forces(rows, speed_m_s, Pull(4.0), BANDWIDTH_HZ, touch_down_s, scale_s, 0.5)
    noise = NOISE_M_S2 * np.random.default_rng(3).standard_normal((2, 200))
    back_m_s2 = np.linspace(12.0 + np.sum(pushes) / 100, -4.0, 200)  # the mean acceleration is 0
    z = np.concatenate([back_m_s2 + noise[0], -4.0 - pushes + noise[1]])
    (found,) = contacts_of(Readings(1e-3, z, np.zeros(400), np.zeros(400), ((0, 400),)))
    assert found.before == pytest.approx(200 + touch_down_s / 1e-3, abs=1.5 + 0.1 * contact_s / 1e-3)
    assert z[found.after + 8] == pytest.approx(-4.0, abs=0.1)


def test_dry_friction_at_a_turn_is_no_contact() -> None:
    """It lets the reading fall where the striker turns round at the back, and rise at the front."""
    t_s = np.arange(2000) * 1e-3
    z = 8.0 * np.sin(9.0 * t_s) + 2.0 * np.sign(np.cos(9.0 * t_s))
    assert contacts_of(Readings(1e-3, z, np.zeros(2000), np.zeros(2000), ((0, 2000),))) == []


@pytest.mark.parametrize("at_touch_down_m_s2", [-0.5, 0.5, 1.5])
def test_a_stop_within_the_cranks_radius_may_be_met_while_the_spring_still_pushes(
    at_touch_down_m_s2: float,
) -> None:
    rows = np.arange(1000) * 1e-3
    scale_s = 0.003 * 0.01 / contact_time_s(0.003, 0.3)
    pushes = filter_forces(rows, 0.3, Pull(0.0), BANDWIDTH_HZ, 0.5, scale_s, 0.5)
    noise = NOISE_M_S2 * np.random.default_rng(3).standard_normal(1000)
    z = at_touch_down_m_s2 * np.cos(8.0 * (rows - 0.5)) - pushes + noise
    z += np.sum(pushes + noise) / 1000 - np.mean(at_touch_down_m_s2 * np.cos(8.0 * (rows - 0.5)))
    (found,) = contacts_of(Readings(1e-3, z, np.zeros(1000), np.zeros(1000), ((0, 1000),)))
    assert found.before == pytest.approx(500, abs=2)


def test_a_striker_that_sticks_and_slips_at_4_hz_meets_no_stop() -> None:
    """Of the means over 5 ms, thirty milliseconds are a part of the slip."""
    k, f, small_s = 631.0, 0.3 * 9.81, 1e-3
    x, v, felt = 0.0, 0.0, []
    for tick in range(8000):
        pull = -k * (x - 0.012 * np.sin(14.0 * tick * small_s))
        push = 0.0 if v == 0.0 and abs(pull) <= f else pull - f * np.sign(v if v != 0.0 else pull)
        faster = v + small_s * push
        x, v = x + small_s * faster, faster if faster * v >= 0.0 else 0.0
        felt.append(push)
    z = np.reshape(felt, (-1, 5)).mean(axis=1)
    rows = len(z)
    assert contacts_of(Readings(5e-3, z, np.zeros(rows), np.zeros(rows), ((0, rows),))) == []


def test_an_impact_at_the_end_of_a_piece_has_no_reading_of_the_next(recorded: Readings) -> None:
    """The rows after it are of another recording, or come after lost samples."""
    one = contacts_of(recorded)[5]
    disturbed = recorded.acceleration_m_s2.copy()
    disturbed[one.after + 1 : one.after + 4] += 50.0
    pieces = ((0, one.after + 1), (one.after + 1, len(disturbed)))
    first, other = (
        identify(recorded._replace(pieces=pieces[:1], acceleration_m_s2=z), BANDWIDTH_HZ).impacts[-1]
        for z in (recorded.acceleration_m_s2, disturbed)
    )
    assert first == pytest.approx(other, rel=1e-6)


def test_integrals_are_those_of_a_polynomial() -> None:
    t = np.arange(1001) * 1e-3
    velocity, way = integrals(2.0 - 3.0 * t, 1e-3)
    assert velocity == pytest.approx(2.0 * t - 1.5 * t**2, abs=1e-12)
    assert way == pytest.approx(t**2 - 0.5 * t**3, abs=1e-12)


def test_an_unknown_zero_of_the_encoder_leaves_the_radius_as_it_is(recorded: Readings, tuned: Tuning) -> None:
    """A tenth of a radian: the part by the cosine has a tenth of the radius, which counts in the square."""
    found = identify(recorded._replace(angle_rad=recorded.angle_rad - 0.1), BANDWIDTH_HZ, finds_zero=True)
    assert found.values["zero_rad"] == pytest.approx(-0.1, abs=2e-3)
    assert found.values["amplitude_m"] == pytest.approx(tuned.values["drive.amplitude_m"], rel=5e-4)


def test_dry_friction_is_known_no_better_than_all_flights_share() -> None:
    """Its own standard error is beside it; a law without dry friction has none."""

    def fit_with(**spread: float) -> Any:
        return SimpleNamespace(spread=spread)

    assert flight_spread(fit_with(damping_1_s=0.1))["dry_m_s2"] == 0.0
    assert flight_spread(fit_with(dry_m_s2=0.0))["dry_m_s2"] == DRY_M_S2
    assert flight_spread(fit_with(dry_m_s2=1.0))["dry_m_s2"] == pytest.approx(1.0)


def test_friction_and_pull_act_during_a_contact_as_an_independent_integration_says() -> None:
    d, pull, rates = dissipation(0.5), Pull(0.03, 0.01), Striker(0.02, 0.0, 0.0, 0.01, 0.02, 0.05, 0.1, 1.0)

    def change(time: float, state: np.ndarray) -> list[float]:
        depth, speed = state
        push = max(depth, 0.0) ** 1.5 * (1.0 + d * speed)
        dry = 0.02 + 0.05 * np.exp(-abs(speed) / 0.1)
        spring = 0.02 * depth + pull.at_first_m_s2 + pull.rate_m_s3 * time
        return [speed, -push - spring - 0.01 * speed - np.sign(speed) * dry]

    _, speeds = integrate(d, pull, rates)
    times = STEP * np.arange(len(speeds))
    known = solve_ivp(change, (0.0, times[-1]), [0.0, 1.0], t_eval=times, max_step=1e-3)
    assert speeds == pytest.approx(known.y[1], abs=1e-3)


@pytest.mark.parametrize("restitution", [0.2, 0.5, 0.8, 0.99])
def test_a_contact_without_pull_gives_back_its_restitution(restitution: float) -> None:
    """∫ push dt = (1 + k) v⁻ in a Hunt–Crossley contact whose damping is that of k."""
    pushes, _ = integrate(dissipation(restitution), Pull(0.0), FREE)
    times = STEP * np.arange(len(pushes))
    assert np.trapezoid(pushes, times) == pytest.approx(1.0 + restitution, abs=2e-3)


def test_a_impact_is_fitted_back() -> None:
    rows = np.arange(16) * 1e-3
    readings = filter_forces(rows, 0.9, Pull(4.0), BANDWIDTH_HZ, 0.00123, 0.0031, 0.45)
    fitted = fit_impact(rows, readings, 0.9, Pull(4.0), BANDWIDTH_HZ)
    assert fitted.touch_down_s == pytest.approx(0.00123, abs=2e-6)
    assert fitted.scale_s == pytest.approx(0.0031, rel=2e-3)
    assert fitted.restitution == pytest.approx(0.45, abs=2e-3)


def test_a_disturbed_sample_that_looks_like_an_impact_is_no_error() -> None:
    """Its fit ends at a bound, which is narrower for the lower speed with which it is fitted again."""
    rows_s, excess_m_s2 = np.arange(6) * 1e-3, np.array([0.0, 0.0, 20.0, 0.0, 0.0, 0.0])
    near = fit_impact(rows_s, excess_m_s2, 0.12, Pull(0.0), BANDWIDTH_HZ)
    again = fit_impact(rows_s, excess_m_s2, 0.11, Pull(0.0), BANDWIDTH_HZ, near=near)
    assert near.misfit > 3.0
    assert again.scale_s < near.scale_s


def test_the_contact_time_scales_as_hertz_says() -> None:
    """T ∝ v^−0.2: S is its share at any speed, so that the time at the reference speed is one number."""
    scale_s = 0.003
    at_other_speed = scale_s * (0.9 / 0.45) ** 0.2
    assert contact_time_s(at_other_speed, 0.45) == pytest.approx(contact_time_s(scale_s, 0.9), rel=1e-9)


# --- the command --------------------------------------------------------------------------------------


def test_the_command_needs_nothing_but_a_can_log_with_gaps(
    viscous: Path, tuned: Tuning, tmp_path: Path, monkeypatch, capsys
) -> None:
    """Each 3 s a hundredth of a second of frames is missing."""
    monkeypatch.setattr(safety, "SCENARIOS", ())
    log, out, plot = tmp_path / "bare.log", tmp_path / "mine.toml", tmp_path / "mine.svg"
    lines = (viscous / "can.log").read_text().splitlines(keepends=True)
    log.write_text("".join(line for line in lines if float(line[1:].partition(")")[0]) % 3.0 > 0.01))
    assert len(read(log, 156.9).pieces) >= 19
    assert bench_of(log, None) is None
    bench = bench_of(log, "table1-motor-soft")
    assert bench is not None
    assert bench.ratio == pytest.approx(1.3, abs=1e-3)
    command = ["tune", "identify", str(log), "--out", str(out), "--plot", str(plot)]
    assert cli.run([*command, "--json"]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert payload["law"] == "viscous"
    assert payload["parameters"].keys() == tuned.parameters.keys()
    spring = payload["parameters"]["striker.spring_n_m"]
    assert spring["value"] == pytest.approx(SPRING_N_PER_M, rel=0.005)
    assert spring["unit"] == "N/m"
    assert any("mass and rest length" in warning for warning in payload["warnings"])
    assert out.exists()
    assert plot.stat().st_size > 10_000
    assert cli.run(["tune", "identify", str(tmp_path / "nowhere")]) == EXIT_BAD_INPUT


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "fifo.log")
    with pytest.raises(BadInputError, match="is no file"):
        read_ticks(tmp_path / "fifo.log")


def test_a_log_that_is_too_large_is_refused_unread(tmp_path: Path) -> None:
    log = tmp_path / "long.log"
    log.touch()
    os.truncate(log, 601_000_000)
    with pytest.raises(BadInputError, match="has 601 MB; wanted at most 600 MB, an hour"):
        read_ticks(log)
    sparse = [0.05 * number for number in range(150_000)]
    with pytest.raises(BadInputError, match="spans 7500 s; wanted at most 7200 s"):
        ticks_of(bus_at(sparse), 1e-3)


def test_frames_of_others_are_not_kept_in_memory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "BLOCK_BYTES", 1 << 16)
    log = tmp_path / "can.log"
    own = [(1e-3 * tick, *frame) for tick in range(3) for frame in SENSED]
    foreign = [(1e-4 * number, 0x7FF, bytes(8)) for number in range(60_000)]
    with log.open("w") as file:
        for t_s, can_id, data in sorted([*own, *foreign]):
            file.write(f"({t_s:.6f}) can0 {can_id:03X}#{data.hex()}\n")
    layouts()  # is loaded once, for any number of frames
    tracemalloc.start()
    ticks = read_ticks(log)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(ticks.low_m_s2) == 3
    assert peak < 1 << 20 < log.stat().st_size


def bus_at(times_s: list[float]) -> BusLog:
    return bus_log(
        np.repeat(times_s, 2),
        np.array([frame.can_id for frame in SENSED] * len(times_s)),
        [frame.data for frame in SENSED] * len(times_s),
    )


def test_wrong_times_take_no_memory_and_their_order_does_not_matter() -> None:
    with pytest.raises(BadInputError, match="wrong times"):
        ticks_of(bus_at([0.001, 0.002, 9e9]), 1e-3)
    assert len(ticks_of(bus_at([0.001, 0.005, 0.003]), 1e-3).low_m_s2) == 5


def test_frames_whose_times_are_those_of_bundles_are_no_recordings_mixed() -> None:
    felt = [ACCELEROMETER.encode(Accelerometer(0.1 * k, 0.1 * k, 0.0)) for k in range(100)]
    frames = [(8e-3 * (k // 8), frame) for k, one in enumerate(felt) for frame in (one, SENSED[1])]
    bus = bus_log(
        np.array([t_s for t_s, _ in frames]),
        np.array([frame.can_id for _, frame in frames]),
        [frame.data for _, frame in frames],
    )
    with pytest.raises(
        BadInputError, match=r"in 87 ticks, .* 0 s; wanted one: the adapter .* bundles; set its latency"
    ) as error:
        ticks_of(bus, 1e-3)
    assert "clock" not in str(error.value)


def test_two_recordings_of_the_same_times_are_not_mixed() -> None:
    """As in logs with times from their start, one after the other; repeated frames are no other recording."""
    assert len(ticks_of(bus_at([0.001, 0.002, 0.001, 0.002]), 1e-3).low_m_s2) == 2
    ticks, other = range(100), ACCELEROMETER.encode(Accelerometer(2.0, 2.0, 0.0))
    for others, is_mixed in ((range(50, 60), False), (range(50, 70), True)):
        frames = [(1e-3 * tick, frame) for tick in ticks for frame in SENSED]
        frames += [(1e-3 * tick, other) for tick in others]
        bus = bus_log(
            np.array([t_s for t_s, _ in frames]),
            np.array([frame.can_id for _, frame in frames]),
            [frame.data for _, frame in frames],
        )
        if is_mixed:
            with pytest.raises(BadInputError, match=r"two samples of the accelerometer in .* at 0.05 s"):
                ticks_of(bus, 1e-3)
        else:
            assert len(ticks_of(bus, 1e-3).low_m_s2) == 100
