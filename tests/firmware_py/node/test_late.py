"""Samples that come late: those that wait in an overrun, each of its own time, and those of a slow sender."""

import math
from functools import cache

import numpy as np
import pytest
from closed_loop import Bench, Change

from firmware_py.interface import codec
from firmware_py.interface.enums import Fault, Mode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import ImpactEvent, SetInputTorque
from firmware_py.shell.parameters import config_from

PARAMETERS = {"start.rise_s": 1.0, "start.confirm_periods": 2}
STEADY_S = 4.6
MASS_KG = 0.8


@cache
def touch_down_tick() -> int:
    """The tick before an impact of the steady motion, the same in every run until then."""
    bench = Bench(PARAMETERS).started()
    bench.run(STEADY_S + 1.0, keep=False)
    assert bench.node.outputs.mode == Mode.RUN
    return next(int(1000.0 * t_s) for t_s, _ in bench.touch_downs if t_s > STEADY_S)


def accelerometer_first(_: int, frames: list[Frame]) -> list[Frame]:
    return [frames[1], frames[0], *frames[2:]]


def as_they_are(_: int, frames: list[Frame]) -> list[Frame]:
    return frames


def overrun(first: int, ticks: int, change: Change = as_they_are) -> Bench:
    """A run that misses ticks from `first` on, up to the tick after them."""
    bench = Bench(PARAMETERS, change=change, overrun=lambda tick: first <= tick < first + ticks).started()
    bench.run((first + ticks - bench.tick) * 1e-3, keep=False)
    bench.run(1e-3)
    return bench


@pytest.mark.parametrize("change", [as_they_are, accelerometer_first])
@pytest.mark.parametrize(
    ("before", "ticks", "x_m", "v_m_s"),
    [
        *((before, ticks, 3e-4, 0.02) for before, ticks in ((2, 15), (8, 19), (-5, 12), (30, 19), (4, 8))),
        *((before, ticks, 1e-3, 0.05) for before, ticks in ((2, 25), (5, 32), (8, 32), (16, 40), (66, 90))),
    ],
)
def test_samples_that_wait_after_an_overrun_are_used_each_at_its_own_time(
    change: Change, before: int, ticks: int, x_m: float, v_m_s: float
) -> None:
    """However long the overrun; an impact within it is measured."""
    bench = overrun(touch_down_tick() - before, ticks, change)
    state, truth = bench.node.state, bench.motions[-1]
    assert bench.node.counters.skipped_ticks == ticks
    assert state.estimator.x_m == pytest.approx(truth.x_m, abs=x_m)
    assert state.estimator.v_m_s == pytest.approx(truth.v_m_s, abs=v_m_s)
    assert state.crank.omega_rad_s == pytest.approx(truth.omega_rad_s, abs=0.15)
    assert math.isclose(math.remainder(state.crank.angle_rad - truth.crank_rad, math.tau), 0.0, abs_tol=4e-3)
    speed_m_s = bench.touch_downs[-1][1]
    bench.run(0.02)
    assert bench.node.outputs.impact_impulse_n_s == pytest.approx(1.5 * MASS_KG * speed_m_s, rel=0.1)
    assert bench.node.outputs.fault == Fault.NONE


def test_an_impact_within_an_overrun_is_measured_and_reported() -> None:
    bench = overrun(touch_down_tick() - 3, 18)
    touch_down_s, speed_m_s = bench.touch_downs[-1]
    impulse_n_s = MASS_KG * (speed_m_s - bench.motions[-1].v_m_s)
    events: list[tuple[float, ImpactEvent]] = []
    for _ in range(5):
        now_s = (bench.tick - 0.5) * 1e-3
        reports = [codec.decode(frame) for frame in bench.sent]
        events += [(now_s, record) for record in reports if isinstance(record, ImpactEvent)]
        bench.run(1e-3)
    ((sent_s, event),) = events
    assert sent_s - event.age_s == pytest.approx(touch_down_s, abs=5e-4)
    assert event.approach_speed_m_s == pytest.approx(speed_m_s, rel=0.02)
    assert event.impulse_n_s == pytest.approx(impulse_n_s, rel=0.05)


def test_the_limits_on_an_impact_hold_within_an_overrun() -> None:
    first, ticks = touch_down_tick() - 3, 18
    bench = Bench(PARAMETERS, overrun=lambda tick: first <= tick < first + ticks).started()
    bench.run((first - bench.tick) * 1e-3, keep=False)
    bench.configure(config_from({**PARAMETERS, "limit.impulse_n_s": 0.5}))
    bench.run((ticks + 1) * 1e-3)
    assert bench.node.outputs.fault == Fault.IMPULSE_LIMIT
    assert [one for one in bench.records() if isinstance(one, SetInputTorque)] == [SetInputTorque(0.0)]


def test_nothing_is_caught_up_beyond_every_watchdog() -> None:
    bench = overrun(touch_down_tick() - 100, 1000)
    assert (bench.node.elapsed_ticks, bench.node.outputs.mode) == (1001, Mode.FAULT)
    assert [one for one in bench.records() if isinstance(one, SetInputTorque)] == [SetInputTorque(0.0)]


class HeldUp:
    """The sensors' and the drive's frames through a sender that now and then is held up."""

    def __init__(self, longest_ticks: int, skips: bool) -> None:
        self.longest_ticks, self.skips = longest_ticks, skips
        self.rng = np.random.default_rng(5)
        self.due: list[tuple[int, list[Frame]]] = []
        self.free_tick = 0

    def __call__(self, tick: int, frames: list[Frame]) -> list[Frame]:
        """What arrives in a tick; all of it on time during the start."""
        sample, others = frames[:2], frames[2:]
        held_up = tick > 1000 * STEADY_S and self.rng.random() < 0.03
        if not (self.skips and tick < self.free_tick):  # it skips what it should have sent meanwhile
            delay = int(self.rng.integers(2, self.longest_ticks + 1)) if held_up else 0
            self.free_tick = max(tick + delay, self.free_tick)
            self.due.append((self.free_tick, sample))
        arrived = [frame for due, sample in self.due if due <= tick for frame in sample]
        self.due = [(due, sample) for due, sample in self.due if due > tick]
        return arrived + others


@pytest.mark.parametrize("skips", [True, False])
def test_a_late_reading_of_the_encoder_is_not_taken_for_a_slower_crank(skips: bool) -> None:
    """Held up by 8 ms, skipping what was due meanwhile, or sending all of it at once."""
    bench = Bench(PARAMETERS, change=HeldUp(8, skips)).started()
    bench.run(STEADY_S + 3.0)
    estimated = np.array([state.crank.omega_rad_s for state in bench.states])
    turning = np.array([truth.omega_rad_s for truth in bench.motions])
    assert np.abs(estimated - turning).max() < 0.15
    assert bench.node.outputs.fault == Fault.NONE


@pytest.mark.parametrize("first", [-4, -3, -2, -1, 0])
@pytest.mark.parametrize("lost", [3, 5])
def test_an_impact_whose_beginning_nobody_saw_is_not_taken_for_a_harder_one(first: int, lost: int) -> None:
    hole = range(touch_down_tick() + first, touch_down_tick() + first + lost)
    bench = Bench(PARAMETERS, change=lambda tick, frames: frames[2:] if tick in hole else frames).started()
    bench.run((hole.stop - bench.tick + 20) * 1e-3)
    speed_m_s = bench.touch_downs[-1][1]
    impulses_n_s = [o.impact_impulse_n_s for o in bench.outputs if o.separation]
    expected_n_s = 1.5 * MASS_KG * speed_m_s
    assert bench.outputs[-1].impact_speed_m_s == pytest.approx(speed_m_s, rel=0.1)
    assert impulses_n_s[-1] == pytest.approx(expected_n_s, rel=0.2)
