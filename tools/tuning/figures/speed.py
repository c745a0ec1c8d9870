"""The speed loop in one picture: Bode, Nyquist, steps of target and load; measured points on top."""

from pathlib import Path
from typing import Any

import control
import numpy as np

from tools.tuning.speed import NominalDrive, SpeedDesign, closed_loops, respond
from tools.tuning.speed_measurement import MeasuredLoop

SHOWN_S = 0.25
LOAD_N_M = 0.1
"""About the crank's peak load at r = 1.3."""


def draw_speed(nominal: NominalDrive, design: SpeedDesign, measured: MeasuredLoop | None, path: Path) -> None:
    """Draw the loop into an SVG, PNG or PDF file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 7.0), layout="constrained")
    grid = figure.subplot_mosaic([["gain", "nyquist", "step"], ["phase", "nyquist", "load"]])
    figure.suptitle(
        f"speed loop: K_p = {design.gain_p_n_m_s:g} N m s, K_i = {design.gain_i_n_m:g} N m; phase margin "
        f"{design.phase_margin_deg:.1f}°, gain margin {design.gain_margin_db:.1f} dB, disk margin "
        f"{design.disk_margin:.2f}, bandwidth {design.bandwidth_rad_s / (2.0 * np.pi):.1f} Hz"
    )
    _bode(grid["gain"], grid["phase"], nominal, design, measured)
    _nyquist(grid["nyquist"], nominal, design, measured)
    _steps(grid["step"], grid["load"], nominal, design)
    figure.savefig(path, dpi=110)


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
