"""The module's parameters from the frames of steps: `tune identify`'s fit, with an unknown zero."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from firmware_py.core.estimation.striker_model import STANDARD_GRAVITY_M_S2
from firmware_py.interface.generated.records import SetInputTorque
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import StoredBus
from plant_sim.arrays import FloatArray
from tools.bring_up.step import Largest, StepFailedError
from tools.output import BadInputError
from tools.tuning.identification.first_values import StillStrikerError, fit_signed
from tools.tuning.identification.flights import USUAL, Division, contacts_of, flights_of
from tools.tuning.identification.friction_laws import Law
from tools.tuning.identification.identify import (
    FEWEST_IMPACTS,
    NORMAL_95,
    Identified,
    flight_spread,
    identify,
    low_pass_delay_s,
    swing_m_s,
)
from tools.tuning.recordings.readings import Readings, Ticks, merge_ticks, read_ticks
from tools.tuning.result import Value, make_value

TURNING_RAD_S = 0.8
"""Slower parts of a recording are left out."""
SMOOTHED = 100
"""Periods over which the speed is averaged for it."""
STUCK = (
    "the striker hardly moves although the crank turns: it is stuck, or dry friction exceeds what the spring "
    "gives at this crank radius; free the striker, then repeat the step"
)
LEAST_REV = 1.0
"""A recording without a part of this length, in turns of the crank, shows no striker, stuck or free."""
SLOW_PERIODS, SLOW = 5, Division(longest_s=2.0, still_m_s2=0.03)
"""Below the impacts: periods of which the mean is taken, and how the motion is divided."""


def wire(ticks: Ticks, values: Mapping[str, float]) -> Ticks:
    """The readings with their channels in order and positive towards the stop, as the firmware takes them."""
    low, housing = ticks.low_m_s2, ticks.housing_m_s2
    if values["wiring.low_exchanged"]:
        low, housing = housing, low
    sign = 1.0 - 2.0 * values["wiring.striker_reversed"]
    return ticks._replace(low_m_s2=sign * low, high_m_s2=sign * ticks.high_m_s2, housing_m_s2=housing)


def read_turning(logs: Sequence[Path], values: Mapping[str, float]) -> Readings:
    """The motion of logs one after another, without parts in which the crank hardly turns.

    A part that is shorter than the speed's average, as between lost samples, is left out too.
    """
    parts, ends, begins, rows = [], [], [], 0
    for log in logs:
        one = merge_ticks(wire(read_ticks(log), values), values["sensor.low_full_scale_m_s2"])
        for begin, end in one.pieces:
            if end - begin < SMOOTHED:
                continue
            speed = np.gradient(one.angle_rad[begin:end], one.period_s)
            kernel = np.ones(SMOOTHED) / SMOOTHED
            turns = np.convolve(speed, kernel, "same") > TURNING_RAD_S
            edges = np.flatnonzero(np.diff(np.concatenate([[False], turns, [False]]).astype(np.int8)))
            for first, last in edges.reshape(-1, 2).tolist():
                if last - first >= SMOOTHED:
                    begins.append(rows + first + begin)
                    ends.append(rows + last + begin)
        parts.append(one)
        rows += len(one.angle_rad)

    def joined(name: str) -> FloatArray:
        return np.concatenate([getattr(one, name) for one in parts])

    return Readings(
        parts[0].period_s,
        joined("acceleration_m_s2"),
        joined("housing_m_s2"),
        joined("angle_rad"),
        tuple(zip(begins, ends, strict=True)),
    )


def refuse_pieces(readings: Readings) -> None:
    """Raise StepFailedError if the crank has not turned, or lost samples have left no part with a turn."""
    lost = np.count_nonzero(np.isnan(readings.acceleration_m_s2) | np.isnan(readings.angle_rad))
    ends_rad = readings.angle_rad[np.array(readings.pieces, int).reshape(-1, 2) - [0, 1]]
    turns_rev = float(np.max(np.abs(np.diff(ends_rad)), initial=0.0)) / (2.0 * math.pi)
    known_rad = np.unwrap(readings.angle_rad[np.isfinite(readings.angle_rad)])
    whole_rev = float(np.ptp(known_rad)) / (2.0 * math.pi) if len(known_rad) else 0.0
    if lost and turns_rev < LEAST_REV <= whole_rev:
        raise StepFailedError(
            f"{lost} samples were lost, and between them the crank turns by {turns_rev:.2g} turns at most, "
            f"wanted {LEAST_REV:g} or more: find what loses frames on the bus (see the step listen), then "
            "repeat the step"
        )
    if not readings.pieces:
        raise StepFailedError("the crank has not turned: see the torque and speed in the report")


def largest_in(log: Path, mass_kg: float) -> Largest:
    """The largest torque commanded, speed and, by the striker's acceleration, force in a log."""
    bus, ticks = StoredBus(log), read_ticks(log)
    torques_n_m = frames_of(bus, SetInputTorque).signals
    low, high = (
        float(np.nanmax(np.abs(one - np.nanmedian(one)))) for one in (ticks.low_m_s2, ticks.high_m_s2)
    )
    return Largest(
        force_n=mass_kg * max(low, high),
        torque_n_m=float(np.max(np.abs(torques_n_m), initial=0.0)),
        speed_rad_s=2.0 * math.pi * float(np.nanmax(np.abs(ticks.velocity_rev_s))),
    )


def decimate(readings: Readings, by: int) -> Readings:
    """The means over `by` periods: slow motion needs no more, and a fit of it takes a share of the time."""
    counts = [(end - begin) // by for begin, end in readings.pieces]
    ends = np.cumsum(counts).tolist()

    def means(one: FloatArray) -> FloatArray:
        return np.concatenate(
            [
                one[begin : begin + count * by].reshape(count, by).mean(axis=1)
                for (begin, _), count in zip(readings.pieces, counts, strict=True)
            ]
        )

    return Readings(
        readings.period_s * by,
        means(readings.acceleration_m_s2),
        means(readings.housing_m_s2),
        means(readings.angle_rad),
        tuple(zip([0, *ends[:-1]], ends, strict=True)),
    )


def find_zero(readings: Readings, bandwidth_hz: float, division: Division) -> float:
    """A first value of the encoder's angle at which the piston passes its middle forward, in rad.

    The sign of the accelerometer is not seen below the impacts: with the other sign it is half a turn on.
    """
    flights = flights_of(readings, contacts_of(readings), low_pass_delay_s(bandwidth_hz), division)
    swing = swing_m_s(readings)
    striker = fit_signed(flights, [swing[one.begin : one.end] for one in flights], True).striker
    return math.atan2(-striker.quadrature_m, striker.amplitude_m)


def fit_module(
    logs: Sequence[Path], values: Mapping[str, float], is_slow: bool = False
) -> tuple[dict[str, Value], Identified, Readings]:
    """Spring, crank radius and zero, friction and, with impacts, the stop, from the frames of steps.

    `values`: all parameters, with the wiring found so far. `is_slow`: there are no impacts.
    Raises StepFailedError.
    """
    bandwidth_hz = values["sensor.bandwidth_hz"]
    by, division = (SLOW_PERIODS, SLOW) if is_slow else (1, USUAL)
    try:
        recorded = read_turning(logs, values)
        refuse_pieces(recorded)
        readings = decimate(recorded, by)
        zero_rad = find_zero(readings, bandwidth_hz, division)
        readings = readings._replace(angle_rad=readings.angle_rad - zero_rad)
        found = identify(readings, bandwidth_hz, True, division)
    except StillStrikerError as error:
        raise StepFailedError(STUCK) from error
    except BadInputError as error:
        raise StepFailedError(str(error)) from error
    mass, rest = values["striker.mass_kg"], values["striker.rest_length_m"]
    places = {
        "striker.spring_n_m": ("stiffness_1_s2", mass, 0.0),
        "drive.amplitude_m": ("amplitude_m", 1.0, 0.0),
        "friction.b_n_s_m": ("damping_1_s", mass, 0.0),
        "friction.mu": ("dry_m_s2", 1.0 / STANDARD_GRAVITY_M_S2, 0.0),
        "crank.zero_rad": ("zero_rad", 1.0, zero_rad),
    }
    if len(found.impacts) >= FEWEST_IMPACTS:
        places |= {
            "stop.position_m": ("stop_m", 1.0, rest),
            "stop.restitution": ("restitution", 1.0, 0.0),
            "stop.contact_s": ("contact_s", 1.0, 0.0),
        }
    parameters = {}
    for name, (key, factor, base) in places.items():
        least = 0.0 if name.startswith("friction.") else -math.inf
        bounds = (max(one * factor + base, least) for one in value_with_bounds(found, key))
        value, one, other = bounds
        parameters[name] = make_value(name, value, min(one, other), max(one, other))
    reachable = reachable_ratio({**values} | {name: one.value for name, one in parameters.items()})
    if reachable < values["start.highest_ratio"]:
        parameters["start.highest_ratio"] = make_value("start.highest_ratio", reachable)
    return parameters, found, readings


def value_with_bounds(found: Identified, key: str) -> tuple[float, float, float]:
    """A value of the fit with 95 % bounds.

    A part of the friction that the chosen law lacks is 0. The law with both parts says how large it may be,
    unless the chosen law is Stribeck's, which it does not contain.
    """
    value, wide = found.values[key], NORMAL_95 * found.spread[key]
    both = found.fits[Law.BOTH]
    if found.law != Law.STRIBECK and key in both.spread and key not in found.fit.spread:
        middle, wide = getattr(both.striker, key), NORMAL_95 * flight_spread(both)[key]
        return value, min(value, middle - wide), max(value, middle + wide)
    return value, value - wide, value + wide


def natural_rad_s(values: Mapping[str, float]) -> float:
    """The natural frequency by the parameters."""
    return math.sqrt(values["striker.spring_n_m"] / values["striker.mass_kg"])


def reachable_ratio(values: Mapping[str, float]) -> float:
    """The highest ratio within the limit of the speed."""
    return 0.99 * values["limit.speed_rad_s"] / natural_rad_s(values)
