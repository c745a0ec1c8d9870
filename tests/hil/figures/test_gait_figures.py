"""A walk with known answers: figures of the phase, of pulses in and out of the window, and of its end."""

from typing import Any

import numpy as np
import pytest
from run_folder import HOLD_S, STOP_S, T_S, MadeUpRun, make_run, records, traces_of, write_run

from firmware_py.interface.enums import Fault, GaitState, Mode
from hil.figures.figures import figures_from
from hil.figures.gait import (
    count_undriven,
    gait_end,
    heel_strikes,
    is_following,
    next_start_s,
    phase_at,
    push_off,
)
from hil.figures.records import CATALOGUE, GaitFigures, Origin, value_of
from hil.record.log_reader import tables
from hil.record.run_faults import RunFault
from hil.runs.verdict import finish
from hil.show.rerun_log import rebuild
from plant_sim.result import LegState

STRIDE_S = 0.4
ERROR = 0.012


def walk(until_s: float = 100.0, tripping_s: float = -1.0) -> MadeUpRun:
    """The made-up run, walked with: strides of 0.4 s until `until_s`, and an estimate 1.2 % ahead."""
    run = make_run()
    run.scenario["scene"]["gait"] = {"axis": "outward"}
    t_s = run.plant["t_s"]
    walking = t_s < until_s
    phase = np.where(walking, t_s / STRIDE_S % 1.0, np.nan)
    swing = np.where(np.nan_to_num(phase) < 0.62, LegState.STANCE, LegState.SWING)
    run.plant |= {
        "gait.state": np.where(walking, swing, LegState.STANDING),
        "gait.tripping": np.abs(t_s - tripping_s) < 0.04,
        "gait.phase": phase,
        "gait.stride_hz": np.where(walking, 1.0 / STRIDE_S, 0.0),
        "gait.ankle_n_m_kg": np.where(walking, np.nan_to_num(phase), 0.0),
        "felt_force_n": np.zeros(len(t_s)),
    }
    run.firmware |= {
        "state.gait.phase": (np.nan_to_num(phase) + ERROR) % 1.0,
        "state.gait.confidence": np.ones(len(t_s)),
        "state.gait.doing": np.full(len(t_s), GaitState.STANCE),
        "state.gait_lock.harmonic": np.full(len(t_s), 2),
    }
    return run


def place_impacts(
    run: MadeUpRun, phases: list[float], t_s: tuple[float, float] = (HOLD_S, STOP_S), v: float = 1.0
) -> None:
    """Replace the impacts by one at each of `phases` in every stride that begins within `t_s`."""
    starts = np.arange(np.ceil(t_s[0] / STRIDE_S - 1e-9), t_s[1] / STRIDE_S) * STRIDE_S
    times = np.sort((starts[:, None] + STRIDE_S * np.array(phases)).ravel())
    times = times[times < t_s[1]]
    run.impacts = {
        name: np.full(len(times), value)
        for name, value in (
            ("v_m_s", v),
            ("v_after_m_s", -0.5 * v),
            ("impulse_n_s", 1.2),
            ("peak_force_n", 20.0),
            ("crank_rad", 0.0),
        )
    }
    run.impacts["t_s"] = times + T_S / 2
    run.firmware["outputs.impact"] = np.zeros(len(run.firmware["t_s"]), bool)


def figures(run: MadeUpRun) -> GaitFigures:
    return figures_from(traces_of(run)).gait


def test_a_run_without_a_walk_has_no_figures_of_one() -> None:
    without_a_plant = walk()
    without_a_plant.plant = {name: values[:0] for name, values in without_a_plant.plant.items()}
    for run in (make_run(), without_a_plant):
        assert figures(run) == GaitFigures(*[None] * 11)


def test_the_phase_error_is_taken_on_the_circle() -> None:
    found = figures(walk())
    assert found.phase_rmse_percent == pytest.approx(100.0 * ERROR, rel=1e-6)
    assert found.phase_worst_percent == pytest.approx(100.0 * ERROR, abs=1e-5)  # single precision of a turn


def test_pulses_are_counted_by_the_true_phase_of_their_touch_down() -> None:
    """One at 50 % and one at 5 % of each stride; the first four strides of the hold are the start's."""
    run = walk()
    place_impacts(run, [0.05, 0.5])
    found = figures(run)
    assert found.strides == 4
    assert (found.in_window, found.pulses_per_stride, found.outside_per_stride) == (1.0, 2.0, 1.0)
    assert found.end is None
    assert found.last_pulse_after_s is None


def test_a_stride_without_a_pulse_in_the_window_counts_against_it() -> None:
    run = walk()
    place_impacts(run, [0.5])
    first = np.flatnonzero(run.impacts["t_s"] > 4.0)[0]
    run.impacts["t_s"][first] += 0.15 * STRIDE_S
    found = figures(run)
    assert found.in_window == pytest.approx(3.0 / 4.0)
    assert found.outside_per_stride == pytest.approx(1.0 / 4.0)


def test_the_window_is_the_firmwares_own() -> None:
    run = walk()
    run.scenario["firmware"] = {"gait": {"window_start": 0.0, "window_end": 0.1}}
    place_impacts(run, [0.05, 0.5])
    assert push_off(run.scenario) == (0.0, 0.1)
    assert push_off(run.scenario).holds(np.array([0.0, 0.1, 0.11])).tolist() == [True, True, False]
    assert figures(run).in_window == 1.0


def test_a_stop_is_when_the_leg_stands_still() -> None:
    """Strides of 0.4 s count from the fifth of the hold, at 4.0 s, to 5.0 s; the last pulse is at 5.4 s.

    It is compared with those from the middle of the steady walk on.
    """
    run = walk(until_s=5.0)
    place_impacts(run, [0.5], (HOLD_S, 5.5))
    t_s, v_m_s = run.impacts["t_s"], run.impacts["v_m_s"]
    middle_s = 0.5 * (HOLD_S + T_S / 2 + 5.0)
    t_s[np.searchsorted(t_s, middle_s)] = middle_s
    v_m_s[:] = np.select([t_s < middle_s, t_s == middle_s, t_s > 5.0], [9.0, 1.0, 0.8], 0.9)
    found = figures(run)
    assert (found.end, found.end_s) == ("stop", pytest.approx(5.0))
    assert found.strides == 2
    assert found.last_pulse_after_s == pytest.approx(0.4, abs=2e-3)
    assert found.hardest_after == pytest.approx(0.8)
    t_s[np.searchsorted(t_s, 5.0)] = 5.0
    v_m_s[t_s == 5.0] = 1.6
    assert figures(run).hardest_after == pytest.approx(0.5)
    run.impacts = {name: values[t_s <= 5.0] for name, values in run.impacts.items()}
    quiet = figures(run)
    assert (quiet.last_pulse_after_s, quiet.hardest_after) == (0.0, 0.0)


def test_a_new_start_after_a_stumble_is_not_its_last_pulse() -> None:
    run = walk(tripping_s=4.5)
    place_impacts(run, [0.5], (HOLD_S, 6.0))
    mode, t_s = run.firmware["outputs.mode"], run.firmware["t_s"]
    mode[(t_s > 4.9) & (t_s < 5.3)] = Mode.READY
    mode[t_s >= 5.3] = Mode.SOFT_START
    found = figures(run)
    assert (found.end, found.end_s) == ("stumble", pytest.approx(4.461))
    assert found.last_pulse_after_s == pytest.approx(5.0 - 4.461, abs=2e-3)


def test_pulses_of_the_leg_alone_are_counted_apart() -> None:
    """Ready from 4.0 s on: the last pulse that follows is at 4.2 s, those from 6.0 s on are the leg's."""
    run = walk(tripping_s=3.9)
    place_impacts(run, [0.5], (HOLD_S, 7.0))
    run.impacts = {
        name: values[(run.impacts["t_s"] < 4.3) | (run.impacts["t_s"] > 6.4)]
        for name, values in run.impacts.items()
    }
    run.firmware["outputs.mode"][run.firmware["t_s"] > 4.0] = Mode.READY
    found = figures(run)
    assert found.last_pulse_after_s == pytest.approx(4.2 - 3.861, abs=2e-3)
    assert found.undriven == 1


TICKS_S = [1.0, 2.0, 3.0, 4.0]


def test_the_phase_of_a_pulse_is_that_of_the_last_tick_before_it() -> None:
    plant = records(t_s=TICKS_S, gait__phase=[0.1, 0.2, 0.3, 0.4])
    assert phase_at(plant, np.array([0.5, 1.9, 2.0, 9.0])).tolist() == [0.1, 0.1, 0.2, 0.4]
    assert phase_at(plant[:1], np.array([9.0])).tolist() == [0.1]


def test_a_walk_may_end_in_the_tick_in_which_its_hold_begins() -> None:
    plant = records(t_s=TICKS_S, gait__tripping=[0, 1, 0, 0], gait__state=[LegState.STANCE] * 4)
    assert gait_end(plant, 2.0) == ("stumble", 2.0)
    assert gait_end(plant, 2.1) is None


@pytest.mark.parametrize(("after_s", "start_s"), [(1.0, 2.0), (2.0, 5.0), (5.0, np.inf)])
def test_the_next_start_of_the_crank_is_its_first_tick(after_s: float, start_s: float) -> None:
    modes = [Mode.READY, Mode.SOFT_START, Mode.SOFT_START, Mode.RUN, Mode.SOFT_START]
    assert next_start_s(records(t_s=[*TICKS_S, 5.0], outputs__mode=modes), after_s) == start_s


def test_a_walk_that_begins_within_a_stride_has_its_first_heel_strike_at_the_next() -> None:
    plant = records(t_s=range(7), gait__phase=[np.nan, 0.7, 0.9, 0.1, np.nan, np.nan, 0.0])
    assert heel_strikes(plant).tolist() == [3.0, 6.0]


def test_a_pause_of_two_seconds_ends_the_pulses_that_follow() -> None:
    pulses_s = np.array([0.9, 1.0, 1.5, 3.0, 5.0, 5.5])
    assert np.flatnonzero(is_following(pulses_s, 1.0, 9.0)).tolist() == [2, 3]
    assert np.flatnonzero(is_following(pulses_s, 1.0, 3.0)).tolist() == [2]


def test_a_pulse_is_undriven_two_seconds_after_the_crank_or_after_the_beginning_of_the_run() -> None:
    firmware = records(t_s=TICKS_S, outputs__mode=[Mode.READY, Mode.READY, Mode.RUN, Mode.READY])
    assert count_undriven(firmware, np.array([1.9, 2.0, 4.9, 5.0])) == 2


def whole_walk() -> MadeUpRun:
    """A walk with an injected fault and a latched one: it has every figure of the hold and of the timing."""
    run = walk(until_s=5.0)
    run.scenario["scene"]["wearer"] = {}
    run.run["faults"] = [RunFault("kick", "plant", False, 3.0, 3.2, "kick", 1)._asdict()]
    run.firmware["outputs.fault"][6800:] = Fault.STALL
    return run


def all_figures(run: MadeUpRun) -> dict[str, Any]:
    found = figures_from(traces_of(run))
    return {name: value_of(found, name) for name in CATALOGUE}


def names_of(origin: Origin) -> set[str]:
    return {spec.name for spec in CATALOGUE.values() if spec.origin is origin}


def test_a_run_without_a_hold_lacks_the_figures_of_the_hold_and_those_of_its_end() -> None:
    run = whole_walk()
    before = all_figures(run)
    run.firmware["outputs.mode"][:] = Mode.READY
    missing = {name for name, value in all_figures(run).items() if value in (None, "uncertain")}
    missing -= {name for name, value in before.items() if value in (None, "uncertain")}
    of_its_end = ("gait.end", "gait.last_", "gait.hardest_", "gait.undriven", "safe_state.", "motor_torque_")
    assert {name for name in missing if not name.startswith(of_its_end)} == names_of(Origin.HOLD)


def test_a_loaded_machine_changes_the_figures_of_the_timing_alone_beside_the_ticks() -> None:
    run = whole_walk()
    before = all_figures(run)
    for node, skipped in ((run.plant, [6700, 6701]), (run.firmware, [6710, 6711, 6712])):
        node |= {"work_us": 9.0 * node["work_us"], "wake_latency_us": 90.0 * node["wake_latency_us"]}
        node |= {name: np.delete(values, skipped) for name, values in node.items()}
    run.outcome = {
        **{"baseline_overruns": 7, "wall_s": 8.0, "held_s": 0.1, "own_late_s": 0.2},
        **{"memory_growth_mb": {"plant": 1.0, "recorder": 2.0}, "memory_watched_s": 60.0},
    }
    changed = {name for name, value in all_figures(run).items() if value != before[name]}
    assert changed == names_of(Origin.TIMING) | {"ticks"}


def test_the_report_has_the_figures_of_a_walk_and_its_log_is_written(tmp_path) -> None:
    run = walk(until_s=5.0)
    place_impacts(run, [0.05, 0.5], (HOLD_S, 5.0))
    folder = write_run(run, tmp_path / "run")
    finish(folder)
    assert "strides with a pulse in the window" in (folder / "report.html").read_text()
    assert rebuild(folder).stat().st_size > 0


def test_pulses_are_drawn_at_their_phase(tmp_path) -> None:
    run = walk()
    place_impacts(run, [0.05, 0.5])
    log = tables(rebuild(write_run(run, tmp_path / "run")))
    inside, outside = (
        [value for (value,) in log[f"/gait/{where}"]["Scalars:scalars"].to_pylist()]
        for where in ("inside", "outside")
    )
    assert len(inside) == len(outside) >= 9
    assert inside == pytest.approx([0.5] * len(inside), abs=0.005)
    assert outside == pytest.approx([0.05] * len(outside), abs=0.005)
