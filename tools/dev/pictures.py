"""The pictures of docs/explanation, made from runs of their own: `python -m tools.dev.pictures`."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.shell.parameters import DEFAULTS
from hil import Run, run
from hil.record import state_timeline
from tools.study import cases, figures, work
from tools.study.sweep import Diagram, diagrams

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PLACE = Path("docs/explanation")
TRUTH, ESTIMATE, TARGET, ALARM = (
    f"#{rgba >> 8:06x}"
    for rgba in (state_timeline.TRUTH, state_timeline.ESTIMATE, state_timeline.TARGET, state_timeline.ALARM)
)
"""The log's colours in CSS notation."""
ESTIMATOR = "firmware.state.estimator"
SOFT, INSTANT = "soft-start-multistable", "instant-start-multistable"
STIFFER = "scene.striker.spring_n_m=71.4"
"""2 % more than nominal."""

PATIENT = "firmware.start.missing_periods=100"
"""Permits 100 periods without an impact, so that the firmware does not give up the failed start."""

CLOSE_UP_S = (15.0, 16.3)
START_S = (0.0, 12.0)
AVERAGED_TICKS = 1000
SHOWN_OF = 20
"""Plots of a whole run show one point per this number of ticks."""
CONTACT_S = 0.01
"""Elastic contact time of the bench's soft stop."""


class Series(NamedTuple):
    """Values over simulated time, shape (n,)."""

    t_s: NDArray[np.float64]
    values: NDArray[np.float64]


def made(folder: Path, scenario: str, *settings: str) -> Run:
    """Run a scenario in lockstep, in a folder below `folder`."""
    return run(scenario, seed=1, set=settings, out=folder / f"run{len(list(folder.iterdir()))}")


def series(of: Run, name: str) -> Series:
    """A signal of a run."""
    return Series(*of.signal(name))


def within(series: Series, span_s: tuple[float, float]) -> Series:
    """The part of a series within an interval of time."""
    kept = (series.t_s >= span_s[0]) & (series.t_s <= span_s[1])
    return Series(series.t_s[kept], series.values[kept])


def thinned(series: Series) -> Series:
    """Every `SHOWN_OF`-th value, for plots of a whole run."""
    return Series(series.t_s[::SHOWN_OF], series.values[::SHOWN_OF])


def error(of: Run, name: str) -> Series:
    """The estimate less the truth, in every tick; the log's own error is of every tenth."""
    (t_s, true), (_, estimated) = of.signal(f"plant.{name}"), of.signal(f"{ESTIMATOR}.{name}")
    return Series(t_s, estimated - true)


def averaged(series: Series) -> Series:
    """The moving average over the last second, at the times at which it is complete."""
    sums = np.cumsum(np.concatenate([[0.0], series.values]))
    means = (sums[AVERAGED_TICKS:] - sums[:-AVERAGED_TICKS]) / AVERAGED_TICKS
    return Series(series.t_s[AVERAGED_TICKS - 1 :], means)


def with_band(axes: "Axes", values: Series, variance: Series, unit: str) -> None:
    """Plot a thousand times an error and the filter's ±σ of it in the close-up's interval."""
    shown, spread = within(values, CLOSE_UP_S), within(variance, CLOSE_UP_S)
    sigma = 1e3 * np.sqrt(spread.values)
    axes.fill_between(spread.t_s, -sigma, sigma, color=ESTIMATE, alpha=0.3, lw=0, label="±σ of the filter")
    axes.plot(shown.t_s, 1e3 * shown.values, color=TRUTH, lw=0.9, label="estimate less truth")
    axes.set_ylabel(unit)


def estimator(path: Path, folder: Path) -> None:
    """Draw the errors of the estimate and the filter's own standard deviations, close up and over the run."""
    nominal, stiffer = made(folder, SOFT), made(folder, SOFT, STIFFER)
    figure, grid = figures.new_figure(3, 2, 11.0, 6.8)
    left, right = grid[:, 0], grid[:, 1]
    with_band(left[0], error(nominal, "x_m"), series(nominal, f"{ESTIMATOR}.p_xx"), "x [mm]")
    with_band(left[1], error(nominal, "v_m_s"), series(nominal, f"{ESTIMATOR}.p_vv"), "v [mm/s]")
    innovation = within(series(nominal, f"{ESTIMATOR}.innovation_m_s2"), CLOSE_UP_S)
    deviation = within(series(nominal, f"{ESTIMATOR}.innovation_std_m_s2"), CLOSE_UP_S)
    left[2].fill_between(
        deviation.t_s, -deviation.values, deviation.values, color=TARGET, alpha=0.3, lw=0, label="±σ of it"
    )
    left[2].plot(innovation.t_s, innovation.values, color=ESTIMATE, lw=0.7, label="innovation")
    left[2].set(ylabel="y [m/s²]", ylim=(-0.15, 0.15), xlabel="simulated time [s]")
    for axes in left:
        for impact in nominal.impacts:
            if CLOSE_UP_S[0] <= impact.t_s <= CLOSE_UP_S[1]:
                axes.axvline(impact.t_s, color=ALARM, lw=0.8)
        axes.set_xlim(*CLOSE_UP_S)
        axes.legend(loc="lower left", fontsize=8, ncols=2)
    left[0].set_title("three drive periods close up; red: touch-down", fontsize=10)

    for of, colour, name in ((nominal, TRUTH, "nominal"), (stiffer, ESTIMATE, "spring 2 % stiffer")):
        variance = thinned(series(of, f"{ESTIMATOR}.model_variance"))
        right[0].semilogy(variance.t_s, np.sqrt(variance.values), color=colour, lw=1.0, label=name)
        nis = thinned(averaged(series(of, f"{ESTIMATOR}.nis")))
        right[1].semilogy(nis.t_s, nis.values, color=colour, lw=1.0, label=name)
    right[0].set_ylabel("learnt σ of the model [m/s²]")
    right[1].set_ylabel("NIS, mean of a second")
    right[1].axhline(1.0, color="k", lw=0.8, ls="--")
    bias = thinned(series(nominal, f"{ESTIMATOR}.bias_m_s2"))
    spread = thinned(series(nominal, f"{ESTIMATOR}.p_bb"))
    sigma = np.sqrt(spread.values)
    right[2].fill_between(bias.t_s, bias.values - sigma, bias.values + sigma, color=ESTIMATE, alpha=0.3, lw=0)
    right[2].plot(bias.t_s, bias.values, color=ESTIMATE, lw=1.0, label="estimate ± σ")
    right[2].set(ylabel="bias [m/s²]", xlabel="simulated time [s]", ylim=(0.0, 0.35))
    for axes in (right[0], right[2]):
        axes.legend(loc="upper right", fontsize=8)
    right[0].set_title("the whole run", fontsize=10)
    figure.savefig(path, metadata={"Date": None})


def branches(out: Path) -> Diagram:
    """Both motions of the bench's module over r, with the soft stop and an ideal drive."""
    module = replace(cases.case("table1", "viscous"), contact_s=CONTACT_S)
    return diagrams([module], work.here(out))[0]


def start_up(path: Path, folder: Path) -> None:
    """Draw two attractors at the same speed, and a slow and an instant start, each towards one of them."""
    diagram = branches(folder / "study")
    soft, instant = made(folder, SOFT), made(folder, INSTANT, PATIENT)
    figure, grid = figures.new_figure(2, 2, 11.0, 6.4)
    map_, speed, slow, fast = grid.flat
    figures.shade(map_, diagram.multistable())
    for sweep, colour, marker, name in (
        (diagram.up, TARGET, "^", "steady, r rising"),
        (diagram.down, TARGET, "v", "steady, r falling"),
    ):
        map_.plot(
            sweep.column("ratio"), sweep.column("v_max_m_s"), marker, color=colour, ms=3, mew=0, label=name
        )
    natural_rad_s = diagram.case.natural_rad_s
    rising = np.array([(one.t_s, one.v_m_s) for one in soft.impacts if one.t_s < START_S[1]])
    turning = series(soft, "plant.omega_rad_s")
    ratios = np.interp(rising[:, 0], turning.t_s, turning.values) / natural_rad_s
    map_.plot(ratios, rising[:, 1], "o-", color=TRUTH, ms=4, lw=0.8, label="impacts of the soft start")
    map_.set(xlabel="Ω/ω", ylabel="v⁻ at the stop [m/s]", xlim=(0.7, 1.6))
    map_.set_title("two motions at one speed where shaded", fontsize=10)
    map_.legend(loc="lower right", fontsize=8)

    for of, axes, colour, name in (
        (soft, slow, TRUTH, f"soft: S-curve of {DEFAULTS['start.rise_s']:g} s"),
        (instant, fast, ESTIMATE, "instant: S-curve of 0.1 s"),
    ):
        shown = within(series(of, "plant.omega_rad_s"), START_S)
        speed.plot(shown.t_s, shown.values / natural_rad_s, color=colour, lw=1.1, label=name)
        position = within(series(of, "plant.x_m"), START_S)
        axes.plot(position.t_s, 1e3 * position.values, color=colour, lw=0.8)
        axes.axhline(1e3 * diagram.case.stop_m, color=ALARM, lw=1.0)
        axes.set(xlabel="simulated time [s]", ylabel="x [mm]", xlim=START_S, ylim=(0.0, 200.0))
        axes.set_title(f"striker, {name}; red: the stop", fontsize=10)
    speed.set(xlabel="simulated time [s]", ylabel="Ω/ω", xlim=START_S)
    speed.set_title("the crank", fontsize=10)
    speed.legend(loc="lower right", fontsize=8)
    figure.savefig(path, metadata={"Date": None})


PICTURES = {"estimator": estimator, "start-up": start_up}


def main() -> None:
    """Draw all pictures."""
    for name, draw in PICTURES.items():
        with tempfile.TemporaryDirectory() as folder:
            draw(PLACE / f"{name}.svg", Path(folder))


if __name__ == "__main__":
    main()
