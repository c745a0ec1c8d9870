"""The curves of each tuning command, for its Rerun recording: timeline and views."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tools.tuning.detector import Operating
from tools.tuning.estimator import GRID, Combination, profile
from tools.tuning.identification.identify import Identified, friction_points
from tools.tuning.recordings.readings import Readings
from tools.tuning.recordings.recording import Curve, Views, curve
from tools.tuning.speed import NominalDrive, SpeedDesign, respond
from tools.tuning.speed_measurement import MeasuredLoop
from tools.tuning.start import Ramp


class Shown(NamedTuple):
    """A timeline, named after the quantity that it counts, and the views over it."""

    timeline: str
    views: Views


def of_speed(nominal: NominalDrive, design: SpeedDesign, measured: MeasuredLoop | None) -> Shown:
    """Bode: gain and phase of the loop over the logarithm of frequency, and of the closed loop."""
    response = respond(nominal, design.gain_p_n_m_s, design.gain_i_n_m)
    hertz = response.omega_rad_s / (2.0 * np.pi)
    decades: list[float] = np.log10(hertz).tolist()

    def gain_db(values: NDArray[np.complex128]) -> list[float]:
        decibels: list[float] = (20.0 * np.log10(np.abs(values))).tolist()
        return decibels

    gain = {
        "L, designed": curve(decades, gain_db(response.loop), 1e-3),
        "target to speed": curve(decades, gain_db(response.closed), 1e-3),
        "sensitivity": curve(decades, gain_db(1.0 / (1.0 + response.loop)), 1e-3),
    }
    angle = np.degrees(np.unwrap(np.angle(response.loop)))
    phase = {"L, designed": curve(decades, angle.tolist(), 1e-3)}
    if measured is not None:
        at_hz = measured.omega_rad_s / (2.0 * np.pi)
        near = np.radians(np.interp(at_hz, hertz, angle))
        found = np.degrees(near + np.angle(measured.loop * np.exp(-1j * near)))
        gain["L, measured"] = curve(np.log10(at_hz).tolist(), gain_db(measured.loop), 1e-3, dots=True)
        phase["L, measured"] = curve(np.log10(at_hz).tolist(), found.tolist(), 1e-3, dots=True)
    over = "over 1000 log10(f / 1 Hz)"
    return Shown("frequency_1000_log10_hz", {f"gain [dB] {over}": gain, f"phase [deg] {over}": phase})


def of_identify(found: Identified, readings: Readings) -> Shown:
    """Over the log's ticks: the reading, the friction that follows from it, and the impacts."""
    speeds, left = friction_points(found)
    ticks = np.concatenate([np.arange(one.begin, one.end) for one in found.used])
    striker, rise = found.fit.striker, found.fit.rise
    dry = striker.dry_m_s2 + striker.rise_m_s2 * np.exp(-((np.abs(speeds) / rise.v_s_m_s) ** rise.delta))
    fitted = striker.damping_1_s * speeds + dry * np.sign(speeds)
    numbers = list(range(len(readings.acceleration_m_s2)))
    at = [one.at_s / readings.period_s for one in found.impacts]
    return Shown(
        "tick",
        {
            "reading [m/s²]": {"z": curve(numbers, readings.acceleration_m_s2.tolist())},
            "friction by mass [m/s²]": {
                "left of the reading": curve(ticks.tolist(), left.tolist()),
                "fitted": curve(ticks.tolist(), fitted.tolist()),
            },
            "stop past l0 [mm]": {"stop": curve(at, [1e3 * one.stop_m for one in found.impacts], dots=True)},
            "restitution [×]": {"k": curve(at, [one.restitution for one in found.impacts], dots=True)},
        },
    )


def of_detector(points: Sequence[Operating]) -> Shown:
    """The characteristic over the floor."""
    floors = [one.floor_m_s2 for one in points]

    def over(values: Sequence[float]) -> Curve:
        return curve(floors, values, 0.1)

    return Shown(
        "floor_tenths_of_m_s2",
        {
            "missed [%], false alarms [1/h]": {
                "missed": over([100.0 * (1.0 - one.recall) for one in points]),
                "false alarms": over([one.false_alarms_1_h for one in points]),
            },
            "latency [ms]": {
                "median": over([one.latency_p50_ms for one in points]),
                "95 %": over([one.latency_p95_ms for one in points]),
            },
            "cost [1/h]": {"cost": over([one.cost_1_h for one in points])},
        },
    )


def of_start(tried: Sequence[Ramp]) -> Shown:
    """The objectives of the candidates in the order of the search, and again for the Pareto front alone."""
    numbers = list(range(len(tried)))
    front = [number for number, one in enumerate(tried) if one.on_front]
    names = (
        "starts that fail [%]",
        "hardest twentieth of impacts [of steady]",
        "95 % captured within [s]",
        "energy [J]",
    )
    objectives = np.array([one.objectives for one in tried]) * np.array([100.0, 1.0, 1.0, 1.0])
    return Shown(
        "candidate",
        {
            name: {
                "tried": curve(numbers, objectives[:, place].tolist()),
                "Pareto front": curve(front, objectives[front, place].tolist(), dots=True),
            }
            for place, name in enumerate(names)
        },
    )


def of_estimator(points: Sequence[Combination]) -> Shown:
    """Likelihood, NIS and errors from the likeliest combination to the least likely one."""
    ranked = sorted(points, key=lambda one: -one.likelihood)
    numbers = list(range(len(ranked)))
    views = {
        "log-likelihood": {"at the stop": curve(numbers, [one.likelihood for one in ranked])},
        "NIS": {
            "flight": curve(numbers, [one.nis_flight for one in ranked]),
            "stop": curve(numbers, [one.nis_stop for one in ranked]),
        },
        "error of x [mm]": {
            "to the smoother": curve(numbers, [one.x_to_smoother_mm for one in ranked]),
            "to the truth": curve(numbers, [one.x_to_truth_mm for one in ranked]),
        },
        "best likelihood by parameter, in steps of its values": {
            name.partition(".")[2]: curve(
                list(range(len(values))), [best for _, best in sorted(values.items())], dots=True
            )
            for name in GRID
            if (values := profile(points, name))
        },
    }
    return Shown("rank", views)
