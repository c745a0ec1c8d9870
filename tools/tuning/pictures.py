"""A picture of each tuning's result, in a figure of 14 x 4.4 inches."""

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import control
import numpy as np
from cycler import cycler

from firmware_py.shell.parameters import DEFAULTS
from tools.tuning import detector, start
from tools.tuning.estimator import MEMORY, NEAR, NOISE, STOP, Combination, profile, select_consistent
from tools.tuning.identification.friction_laws import Law, friction_m_s2
from tools.tuning.identification.identify import Identified, friction_points
from tools.tuning.recordings.readings import Readings
from tools.tuning.result import Tuning, Value
from tools.tuning.speed import NominalDrive, SpeedDesign, closed_loops, respond

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHOWN_S = 0.25
LOAD_N_M = 0.1
"""About the crank's peak load at r = 1.3."""
COLOURS = {Law.VISCOUS: "tab:blue", Law.COULOMB: "tab:orange", Law.BOTH: "tab:green", Law.STRIBECK: "tab:red"}


def draw_speed(figure: "Figure", nominal: NominalDrive, design: SpeedDesign) -> None:
    """Draw the speed loop: Bode, Nyquist, steps of target and load."""
    figure.set_size_inches(14.0, 7.0)
    grid = figure.subplot_mosaic([["gain", "nyquist", "step"], ["phase", "nyquist", "load"]])
    figure.suptitle(
        f"speed loop: K_p = {design.gain_p_n_m_s:g} N m s, K_i = {design.gain_i_n_m:g} N m; phase margin "
        f"{design.phase_margin_deg:.1f}°, gain margin {design.gain_margin_db:.1f} dB, disk margin "
        f"{design.disk_margin:.2f}, bandwidth {design.bandwidth_rad_s / (2.0 * np.pi):.1f} Hz"
    )
    _bode(grid["gain"], grid["phase"], nominal, design)
    _nyquist(grid["nyquist"], nominal, design)
    _steps(grid["step"], grid["load"], nominal, design)


def _bode(gain: Any, phase: Any, nominal: NominalDrive, design: SpeedDesign) -> None:
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
    gain.set(ylim=(1e-3, 1e2), ylabel="gain", title="Bode")
    gain.legend(loc="upper right", fontsize=8)
    phase.set(xlabel="frequency [Hz]", ylabel="phase [°]", ylim=(-360, -90))


def _nyquist(axes: Any, nominal: NominalDrive, design: SpeedDesign) -> None:
    loop = respond(nominal, design.gain_p_n_m_s, design.gain_i_n_m).loop
    axes.plot(loop.real, loop.imag, color="tab:blue")
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
        width = 2.5 if law == found.law else 1.0
        axes.plot(grid, friction_m_s2(fit.striker, grid), color=COLOURS[law], lw=width, label=law.value)
    axes.set(xlabel="v [m/s]", ylabel="friction by mass [m/s²]", title="what slows the striker")
    axes.legend(fontsize=8)


def _laws(axes: Any, found: Identified) -> None:
    names = [law.value.replace(" and ", "\nand ") for law in found.fits]
    residuals = [fit.residual_m_s2 for fit in found.fits.values()]
    axes.bar(names, residuals, color=[COLOURS[law] for law in found.fits])
    axes.set(ylabel="residual [m/s²]", title=f"residual by law; chosen: {found.law.value}")


def _impacts(axes: Any, found: Identified) -> None:
    if not found.impacts:
        axes.set_title("no impacts")
        return
    table = np.array(found.impacts)
    axes.plot(table[:, 1], 1e3 * table[:, 0], ".", color="tab:red", label="stop past l0 [mm]")
    axes.set(xlabel="approach speed v⁻ [m/s]", ylabel="stop past l0 [mm]", title="impacts")
    other = axes.twinx()
    other.grid(visible=False)
    other.plot(table[:, 1], table[:, 2], "x", color="tab:purple", ms=4)
    other.set_ylabel("restitution (×)", color="tab:purple")


LINES = cycler(linestyle=("-", "--", ":")) * cycler(color=("tab:blue", "tab:orange", "tab:purple", "tab:red"))
"""Colours of a panel's lines, dashed from the fifth on; green marks the chosen value."""


class Panel(NamedTuple):
    """Lines over a parameter by their labels, with the parameter's chosen value, if any, and its default."""

    parameter: str
    figure: str
    lines: Mapping[str, tuple[Sequence[float], Sequence[float]]]
    value: Value | None
    default: float
    scale: str = "log"


def draw_panels(figure: "Figure", panels: Sequence[Panel]) -> None:
    """Draw panels side by side; shaded: the values without a significant difference from the chosen one."""
    grid = figure.subplots(1, len(panels))
    marks: dict[str, Any] = {}
    alike = all(panel.lines.keys() == panels[0].lines.keys() for panel in panels)
    for axes, panel in zip(grid, panels, strict=True):
        axes.set_prop_cycle(LINES)
        lines = {label: axes.plot(x, y, marker="o", ms=4)[0] for label, (x, y) in panel.lines.items()}
        if not any(np.any(line.get_ydata()) for line in lines.values()):
            axes.set_ylim(-0.05, 1.0)  # all are 0
        if panel.value is not None:
            low, high = panel.value.low, panel.value.high
            marks["no significant difference"] = axes.axvspan(low, high, color="tab:green", alpha=0.15)
            marks["chosen"] = axes.axvline(panel.value.value, color="tab:green")
        marks["default"] = axes.axvline(panel.default, color="black", lw=0.8)
        axes.set(xscale=panel.scale, xlabel=panel.parameter, ylabel=panel.figure)
        if len(lines) > 1 and alike:
            marks = {**lines, **marks}
        elif len(lines) > 1:
            axes.legend(lines.values(), lines.keys(), fontsize=8)
    figure.legend(marks.values(), marks.keys(), loc="outside lower center", ncols=len(marks), fontsize=8)


def draw_detector(figure: "Figure", tuning: Tuning, points: Sequence[detector.Operating]) -> None:
    """Draw misses, false alarms, latencies and cost against the floor."""
    floors = [one.floor_m_s2 for one in points]
    of_figures: dict[str, dict[str, list[float]]] = {
        "impacts missed [%]": {
            "share": [100.0 * (1.0 - one.recall) for one in points],
            "upper bound of 95 %": [100.0 * (1.0 - one.recall_low) for one in points],
        },
        "false alarms [1/h]": {"rate": [one.false_alarms_1_h for one in points]},
        "latency [ms]": {
            "median": [one.latency_p50_ms for one in points],
            "95 %": [one.latency_p95_ms for one in points],
        },
        "cost [1/h]": {"cost": [one.cost_1_h for one in points]},
    }
    value, default = tuning.parameters[detector.PARAMETER], DEFAULTS[detector.PARAMETER]
    draw_panels(
        figure,
        [
            Panel("floor [m/s²]", name, {label: (floors, y) for label, y in lines.items()}, value, default)
            for name, lines in of_figures.items()
        ],
    )


def draw_estimator(figure: "Figure", tuning: Tuning, points: Sequence[Combination]) -> None:
    """Draw the profile likelihood of each parameter."""
    sound = select_consistent(points)
    best = max(one.likelihood for one in sound)
    labels = {
        NOISE: "Q: noise of v by tick [m/s]",
        MEMORY: "R: memory of the model's error [s]",
        STOP: "R at the stop: deviation [m]",
    }
    panels = []
    for name, label in labels.items():
        values, likelihoods = zip(*sorted(profile(sound, name).items()), strict=True)
        lines = {
            "profile": (values, [one - best for one in likelihoods]),
            "limit of significance": (values, [-NEAR for _ in values]),
        }
        value, default = tuning.parameters.get(name), DEFAULTS[name]
        panels.append(Panel(label, "log-likelihood below the best", lines, value, default))
    draw_panels(figure, panels)


def draw_start(figure: "Figure", tuning: Tuning, tried: Sequence[start.Ramp]) -> None:
    """Draw each criterion over the rise, a line for each approach."""
    criteria: tuple[tuple[str, Callable[[start.Ramp], float]], ...] = (
        ("starts that fail [%]", lambda one: 100.0 * one.failures / max(one.eligible, 1)),
        ("hardest twentieth of impacts, of the steady one", lambda one: one.overshoot),
        ("95 % are captured within [s]", lambda one: one.capture_p95_s),
        ("energy until captured, median [J]", lambda one: one.energy_p50_j),
    )
    panels = []
    for name, of in criteria:
        lines = {}
        for approach in sorted({one.parameters[start.APPROACH] for one in tried}):
            line = [one for one in tried if one.parameters[start.APPROACH] == approach]
            lines[f"approach to r = {approach:g}"] = (
                [one.parameters[start.RISE] for one in line],
                [of(one) for one in line],
            )
        value, default = tuning.parameters[start.RISE], start.DEFAULT[start.RISE]
        panels.append(Panel("rise [s]", name, lines, value, default, "linear"))
    draw_panels(figure, panels)
