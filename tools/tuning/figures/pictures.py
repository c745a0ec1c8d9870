"""A picture of each tuning's result, in a figure of 14 x 4.4 inches."""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import control
import numpy as np

from firmware_py.shell.parameters import DEFAULTS
from tools.tuning import detector, start
from tools.tuning.estimator import LARGEST_NIS, MEMORY, NOISE, STOP, Combination
from tools.tuning.identification.identify import Identified, friction_points
from tools.tuning.identification.laws import Law
from tools.tuning.recordings.readings import Readings
from tools.tuning.result import Tuning
from tools.tuning.speed import NominalDrive, SpeedDesign, closed_loops, respond
from tools.tuning.speed_measurement import MeasuredLoop

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_S = 0.25
LOAD_N_M = 0.1
"""About the crank's peak load at r = 1.3."""
COLOURS = {Law.VISCOUS: "tab:blue", Law.COULOMB: "tab:orange", Law.BOTH: "tab:green", Law.STRIBECK: "tab:red"}


def draw_speed(
    figure: "Figure", nominal: NominalDrive, design: SpeedDesign, measured: MeasuredLoop | None
) -> None:
    """Draw the speed loop: Bode, Nyquist, steps of target and load; measured points on top."""
    figure.set_size_inches(14.0, 7.0)
    grid = figure.subplot_mosaic([["gain", "nyquist", "step"], ["phase", "nyquist", "load"]])
    figure.suptitle(
        f"speed loop: K_p = {design.gain_p_n_m_s:g} N m s, K_i = {design.gain_i_n_m:g} N m; phase margin "
        f"{design.phase_margin_deg:.1f}°, gain margin {design.gain_margin_db:.1f} dB, disk margin "
        f"{design.disk_margin:.2f}, bandwidth {design.bandwidth_rad_s / (2.0 * np.pi):.1f} Hz"
    )
    _bode(grid["gain"], grid["phase"], nominal, design, measured)
    _nyquist(grid["nyquist"], nominal, design, measured)
    _steps(grid["step"], grid["load"], nominal, design)


def _bode(
    gain: Any, phase: Any, nominal: NominalDrive, design: SpeedDesign, measured: MeasuredLoop | None
) -> None:
    response = respond(nominal, design.gain_p_n_m_s, design.gain_i_n_m)
    hertz = response.omega_rad_s / (2.0 * np.pi)
    gain.loglog(hertz, np.abs(response.loop), color="tab:blue", label="L, as designed")
    gain.loglog(hertz, np.abs(response.closed), color="tab:green", lw=1, label="target to speed")
    gain.loglog(hertz, np.abs(1.0 / (1.0 + response.loop)), color="tab:gray", lw=1, label="sensitivity")
    gain.axhline(1.0, color="black", lw=0.6)
    phase.semilogx(hertz, np.degrees(np.unwrap(np.angle(response.loop))), color="tab:blue")
    phase.axhline(-180.0, color="black", lw=0.6)
    for axes in (gain, phase):
        axes.axvline(design.crossover_rad_s / (2.0 * np.pi), color="tab:blue", lw=0.8, ls=":")
        axes.grid(alpha=0.3, which="both")
    if measured is not None:
        at_hz = measured.omega_rad_s / (2.0 * np.pi)
        gain.loglog(at_hz, np.abs(measured.loop), "o", color="tab:red", ms=5, label="L, measured in lockstep")
        # Continued from the designed phase, so that both are on one branch.
        near = np.interp(at_hz, hertz, np.unwrap(np.angle(response.loop)))
        angle = near + np.angle(measured.loop * np.exp(-1j * near))
        phase.semilogx(at_hz, np.degrees(angle), "o", color="tab:red", ms=5)
    gain.set(ylim=(1e-3, 1e2), ylabel="gain", title="Bode")
    gain.legend(loc="lower left", fontsize=8)
    phase.set(xlabel="frequency [Hz]", ylabel="phase [°]", ylim=(-360, -90))


def _nyquist(axes: Any, nominal: NominalDrive, design: SpeedDesign, measured: MeasuredLoop | None) -> None:
    loop = respond(nominal, design.gain_p_n_m_s, design.gain_i_n_m).loop
    axes.plot(loop.real, loop.imag, color="tab:blue")
    if measured is not None:
        axes.plot(measured.loop.real, measured.loop.imag, "o", color="tab:red", ms=5)
    # L stays out of the disk whose diameter ends at −(2 − α)/(2 + α) and −(2 + α)/(2 − α).
    alpha = design.disk_margin
    low, high = (2.0 - alpha) / (2.0 + alpha), (2.0 + alpha) / (2.0 - alpha)
    circle = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 200))
    disk = -0.5 * (low + high) + 0.5 * (high - low) * circle
    axes.fill(disk.real, disk.imag, color="tab:orange", alpha=0.25, label=f"disk margin {alpha:.2f}")
    axes.plot(np.cos(np.angle(circle)), np.sin(np.angle(circle)), color="gray", lw=0.6, ls="--")
    axes.plot(-1.0, 0.0, "+", color="black", ms=10)
    axes.set(
        xlim=(-3.2, 1.2), ylim=(-3.0, 1.4), aspect="equal", title="Nyquist of L", xlabel="Re", ylabel="Im"
    )
    axes.legend(loc="upper right", fontsize=8)
    axes.grid(alpha=0.3)


def _steps(step: Any, load: Any, nominal: NominalDrive, design: SpeedDesign) -> None:
    from_target, from_load = closed_loops(nominal, design.gain_p_n_m_s, design.gain_i_n_m)
    t_s = np.arange(round(SHOWN_S / nominal.tick_s)) * nominal.tick_s
    for axes, system, size, title in (
        (step, from_target, 1.0, "target steps by 1 rad/s"),
        (load, from_load, -LOAD_N_M, f"a load of {LOAD_N_M:g} N m, not fed forward"),
    ):
        speed = control.forced_response(system, t_s, np.full(len(t_s), size)).outputs
        axes.step(1e3 * t_s, speed, where="post")
        axes.set(title=title, ylabel="speed [rad/s]")
        axes.grid(alpha=0.3)
    load.set_xlabel("time [ms]")


def draw_identified(figure: "Figure", found: Identified, readings: Readings) -> None:
    """Draw an identification: residuals by law, the friction force, the impacts."""
    axes = figure.subplots(1, 3)
    striker = found.fit.striker
    figure.suptitle(
        f"{found.law.value} friction: c/m = {striker.stiffness_1_s2:.3f} 1/s², A = "
        f"{1e3 * striker.amplitude_m:.3f} mm, b/m = {abs(striker.damping_1_s):.4f} 1/s, "
        f"μg = {abs(striker.dry_m_s2):.4f} m/s²"
    )
    _friction(axes[0], found)
    _laws(axes[1], found)
    _impacts(axes[2], found)


def _friction(axes: Any, found: Identified) -> None:
    """Draw the friction (the reading less spring and crank) against v, and the fitted laws."""
    v, left = friction_points(found)
    axes.plot(v, left, ",", color="gray", alpha=0.5, rasterized=True)
    grid = np.linspace(np.min(v), np.max(v), 400)
    for law, fit in found.fits.items():
        d, f, h = fit.striker.damping_1_s, fit.striker.dry_m_s2, fit.striker.rise_m_s2
        width = 2.5 if law == found.law else 1.0
        dry = f + h * np.exp(-((np.abs(grid) / fit.rise.v_s_m_s) ** fit.rise.delta))
        axes.plot(grid, d * grid + dry * np.sign(grid), color=COLOURS[law], lw=width, label=law.value)
    axes.set(xlabel="v [m/s]", ylabel="friction by mass [m/s²]", title="what slows the striker")
    axes.legend(fontsize=8)
    axes.grid(alpha=0.3)


def _laws(axes: Any, found: Identified) -> None:
    names = [law.value.replace(" and ", "\nand ") for law in found.fits]
    residuals = [1e3 * fit.residual_m_s2 for fit in found.fits.values()]
    axes.bar(names, residuals, color=[COLOURS[law] for law in found.fits])
    axes.set(yscale="log", ylabel="residual [mm/s²]", title=f"residual by law; chosen: {found.law.value}")
    axes.grid(alpha=0.3, axis="y", which="both")


def _impacts(axes: Any, found: Identified) -> None:
    if not found.impacts:
        axes.set_title("no impacts")
        return
    table = np.array(found.impacts)
    axes.plot(table[:, 1], 1e3 * table[:, 0], ".", color="tab:red", label="stop past l0 [mm]")
    axes.set(xlabel="approach speed v⁻ [m/s]", ylabel="stop past l0 [mm]", title="impacts")
    other = axes.twinx()
    other.plot(table[:, 1], table[:, 2], "x", color="tab:purple", ms=4)
    other.set_ylabel("restitution (×)", color="tab:purple")
    axes.grid(alpha=0.3)


def draw_detector(figure: "Figure", tuning: Tuning, points: Sequence[detector.Operating]) -> None:
    """Draw the detector's characteristic: misses against false alarms, latency and cost against the floor."""
    roc, latency, cost = figure.subplots(1, 3)
    value = tuning.parameters[detector.PARAMETER]
    floors = np.array([point.floor_m_s2 for point in points])
    alarms = [point.false_alarms_1_h for point in points]
    roc.errorbar(
        alarms,
        [100.0 * (1.0 - point.recall) for point in points],
        yerr=[
            [100.0 * (point.recall_high - point.recall) for point in points],
            [100.0 * (point.recall - point.recall_low) for point in points],
        ],
        fmt="o-",
        capsize=3,
    )
    for point in points:
        roc.annotate(
            f"{point.floor_m_s2:g}",
            (point.false_alarms_1_h, 100.0 * (1.0 - point.recall)),
            textcoords="offset points",
            xytext=(5, 4),
            fontsize=8,
        )
    roc.set(xlabel="false alarms [1/h]", ylabel="impacts missed [%], 95 % bounds", title="by floor in m/s²")
    latency.semilogx(floors, [point.latency_p50_ms for point in points], "o-", label="median")
    latency.semilogx(floors, [point.latency_p95_ms for point in points], "s--", label="95 %")
    latency.set(xlabel="floor [m/s²]", ylabel="latency [ms]", title="from touch-down to its report")
    latency.legend(fontsize=8)
    cost.errorbar(
        floors,
        [point.cost_1_h for point in points],
        yerr=[point.cost_error_1_h for point in points],
        fmt="o-",
        capsize=3,
    )
    cost.set(xscale="log", xlabel="floor [m/s²]", ylabel="cost [1/h]", title="cost, as stated")
    for axes in (latency, cost):
        axes.axvspan(value.low, value.high, color="tab:green", alpha=0.15)
        axes.axvline(value.value, color="tab:green")
    for axes in (roc, latency, cost):
        axes.grid(alpha=0.3, which="both")


def draw_estimator(figure: "Figure", tuning: Tuning, points: Sequence[Combination]) -> None:
    """Draw the likelihood, the errors, and NIS over the parameters that were tried."""
    figure.set_size_inches(17.0, 4.4)
    grid = figure.subplots(1, 4)
    chosen = {**DEFAULTS, **tuning.values}
    stop_m = chosen[STOP]
    shown = [one for one in points if one.parameters[STOP] == stop_m]
    best = max(one.likelihood for one in points)
    _surface(grid[0], shown, chosen, lambda one: one.likelihood - best, "log-likelihood below the best")
    _surface(grid[1], shown, chosen, lambda one: one.x_to_smoother_mm, "x, RMSE to the smoother [mm]")
    known = bool(np.isfinite([one.x_to_truth_mm for one in shown]).all())
    if known:
        _surface(grid[2], shown, chosen, lambda one: one.x_to_truth_mm, "x, RMSE to the truth [mm]")
    else:
        _surface(grid[2], shown, chosen, lambda one: one.nis_flight, "NIS in flight")
    for memory_s in sorted({one.parameters[MEMORY] for one in points}):
        line = [
            one
            for one in points
            if one.parameters[MEMORY] == memory_s and one.parameters[NOISE] == chosen[NOISE]
        ]
        line.sort(key=lambda one: one.parameters[STOP])
        grid[3].loglog(
            [1e3 * one.parameters[STOP] for one in line],
            [one.nis_stop for one in line],
            "o-",
            label=f"{memory_s:g} s",
        )
    grid[3].axhline(1.0, color="black", lw=0.8)
    grid[3].axhline(LARGEST_NIS, color="black", lw=0.8, ls="--")
    grid[3].set(xlabel="the stop is known to [mm]", title="NIS at the stop, by memory")
    grid[3].legend(fontsize=8)
    grid[3].grid(alpha=0.3, which="both")
    figure.suptitle("square: chosen, diamond: default; the stop known to " + f"{1e3 * stop_m:g} mm")


def _surface(
    axes: Any,
    points: Sequence[Combination],
    chosen: dict[str, float],
    what: Callable[[Combination], float],
    title: str,
) -> None:
    """Draw a quantity over the model's memory and the velocity's noise, with its values as numbers."""
    memories = sorted({one.parameters[MEMORY] for one in points})
    noises = sorted({one.parameters[NOISE] for one in points})
    found = {(one.parameters[NOISE], one.parameters[MEMORY]): what(one) for one in points}
    table = np.array([[found[noise, memory] for memory in memories] for noise in noises])
    mesh = axes.imshow(table, origin="lower", aspect="auto", cmap="viridis")
    for (noise, memory), value in found.items():
        axes.text(
            memories.index(memory),
            noises.index(noise),
            f"{value:.3g}",
            ha="center",
            va="center",
            fontsize=8,
            color="white",
            weight="bold",
        )
    axes.set(xlabel="memory of the model's error [s]", ylabel="Q of v by tick [m/s]")
    axes.set_xticks(range(len(memories)), [f"{one:g}" for one in memories])
    axes.set_yticks(range(len(noises)), [f"{one:g}" for one in noises])
    for place, marker, colour in ((chosen, "s", "white"), (DEFAULTS, "D", "tab:red")):
        # A value that is not on the grid lies between its neighbours.
        x = np.interp(np.log(place[MEMORY]), np.log(memories), range(len(memories)))
        y = np.interp(np.log(place[NOISE]), np.log(noises), range(len(noises)))
        axes.plot(x, y, marker, mfc="none", mec=colour, ms=34 if marker == "s" else 26, mew=1.5)
    axes.set_title(title, fontsize=10)
    axes.figure.colorbar(mesh, ax=axes)


def draw_start(figure: "Figure", tuning: Tuning, tried: Sequence[start.Ramp]) -> None:
    """Draw a start search: each criterion against time to capture, and the Pareto front."""
    panels = figure.subplots(1, 3)
    rises = [one.parameters[start.RISE] for one in tried]
    objectives = (
        ([100.0 * one.failures / max(one.eligible, 1) for one in tried], "starts that fail [%]"),
        ([one.overshoot for one in tried], "hardest twentieth of impacts, of the steady one"),
        ([one.energy_p50_j for one in tried], "energy until captured, median [J]"),
    )
    times = [one.capture_p95_s for one in tried]
    marks = (
        ("o", 110, "tab:red", "Pareto front", [one.on_front for one in tried]),
        ("s", 220, "tab:green", "chosen", [one.parameters == tuning.values for one in tried]),
        ("D", 190, "tab:blue", "default", [one.parameters == start.DEFAULT for one in tried]),
    )
    for axes, (values, name) in zip(panels, objectives, strict=True):
        dots = axes.scatter(times, values, c=rises, cmap="viridis", s=28, zorder=2)
        for mark, size, colour, label, is_one in marks:
            rows = [row for row, one in enumerate(is_one) if one]
            axes.scatter(
                [times[row] for row in rows],
                [values[row] for row in rows],
                marker=mark,
                s=size,
                facecolors="none",
                edgecolors=colour,
                linewidths=1.4,
                label=label,
            )
        axes.set(xlabel="95 % are captured within [s]", ylabel=name)
        axes.grid(alpha=0.3)
    panels[0].legend(fontsize=8)
    figure.colorbar(dots, ax=panels, label="rise [s]")
