"""The striker's parameters from one recorded log: stiffness by mass, friction law, crank radius, stop, k.

Only CAN frames are used: those of the accelerometer and the encoder. `flights` divides the log, `striker`
fits all flights by output error and chooses the friction law. Position and speed of the striker at a
touch-down follow from the flight before; `impacts` fits the time, the stiffness and the restitution k.

A bound is 1.96 standard errors from a value. `tests/tools/tuning/test_tuning_trials.py` measures, on sampled
modules, how often the bounds contain the truth.

These sensors cannot identify the mass or l0 alone. Forces are given for the nominal mass, positions for the
nominal l0.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from firmware_py.core.estimation.striker_model import STANDARD_GRAVITY_M_S2
from firmware_py.interface.generated.records import OperatorCommand
from firmware_py.shell.parameters import with_overrides
from hil.record.bus_reconstruction import frames_of
from hil.record.candump import StoredBus
from hil.run_files import RunFile
from plant_sim.arrays import FloatArray
from plant_sim.scene import read_scene
from text_input import read_toml
from tools.output import BadInputError, figure
from tools.tuning.identification.first_values import fit_signed
from tools.tuning.identification.flights import (
    USUAL,
    Contact,
    Division,
    Flight,
    contacts_of,
    flights_of,
    integrals,
)
from tools.tuning.identification.friction_laws import QUADRATURE, Law, friction_m_s2
from tools.tuning.identification.impacts import Pull, contact_time_s, fit_impact
from tools.tuning.identification.striker import Fit, Samples, end_errors_m, fits, simplest
from tools.tuning.recordings.readings import Readings, can_log_of, read
from tools.tuning.result import Merit, Tuning, Value, make_value
from tools.tuning.safety import Bench

NORMAL_95 = 1.96
MEDIAN, QUARTILES = 1.2533, 1.349
"""A median's standard error over that of the mean; the range between a normal law's quartiles, in σ."""
FEWEST_FLIGHTS = 8
WIDE_SHARE = 0.1
"""If the bounds are wider than this share of the value, the log cannot identify the parameter."""
CONDITION_LIMIT = 1e5
"""Largest condition number of the normalised normal matrix; above it regressors are nearly collinear."""
AFTER_ROWS = 3
"""Number of rows after a contact that still belong to the impact."""
FEWEST_IMPACTS = 5
CLEAR_LEAD = 6.0
UNEXPLAINED = 3.0
"""Largest residual that noise explains, in multiples of the sensor's noise."""
SHARED = {"stop_m": 2e-6, "restitution": 4e-4, "contact_s": 7.5e-6}
"""Standard error that all impacts of a log share, beside the striker's: from 108 modules (seed 40000)."""
SHORT_S = 0.01
"""Beyond this contact time the shared errors of restitution and contact time grow in proportion to it: from
50 modules of up to 25 ms (seeds 83078 to 83242)."""
DRY_M_S2 = 1.5e-4
"""Standard error of dry friction that all flights of a log share: from 64 modules (seeds 83277 to 83396)."""
OF_FLIGHTS = ("stiffness_1_s2", "damping_1_s", "dry_m_s2")
"""The striker's parameters that have a value and bounds; a parameter that the law lacks is 0."""
GRAZING_M_S = 0.1
"""Impacts with a lower approach speed determine the stop's position poorly and are not used."""


class Impact(NamedTuple):
    """A touch-down: stop position past l0, approach speed, values fitted by `impacts`, and its time."""

    stop_m: float
    speed_m_s: float
    restitution: float
    contact_s: float
    misfit: float
    at_s: float


@dataclass(frozen=True)
class Identified:
    """The laws and impacts identified from a log. `left_out`: flights without motion, or that no law fits."""

    fits: dict[Law, Fit]
    law: Law
    values: dict[str, float]
    spread: dict[str, float]
    """Standard error of each value."""
    impacts: tuple[Impact, ...]
    flights: int
    left_out: int
    samples: Samples
    seconds: float

    @property
    def fit(self) -> Fit:
        """The fit of the chosen law."""
        return self.fits[self.law]

    @property
    def bounds(self) -> dict[str, tuple[float, float]]:
        """95 % bounds of each quantity; a parameter that the law lacks is 0 with bounds of 0."""
        return {
            name: (value - NORMAL_95 * self.spread[name], value + NORMAL_95 * self.spread[name])
            for name, value in self.values.items()
        }


def identify(
    readings: Readings, bandwidth_hz: float, finds_zero: bool = False, division: Division = USUAL
) -> Identified:
    """Fit a log's readings; `bandwidth_hz` is that of the accelerometers' low-pass.

    `finds_zero`: the encoder's angle may have an offset, and the piston's position a part by its cosine.
    """
    contacts = contacts_of(readings)
    flights = flights_of(readings, contacts, low_pass_delay_s(bandwidth_hz), division)
    if len(flights) < FEWEST_FLIGHTS:
        raise BadInputError(
            f"the log has {len(flights)} free flights of the striker, wanted {FEWEST_FLIGHTS} or more; "
            "record some seconds with the crank turning"
        )
    swing = swing_m_s(readings)
    first = fit_signed(flights, [swing[one.begin : one.end] for one in flights], finds_zero)
    samples, found = fits(flights, first, finds_zero)
    law = simplest(found)
    fit = found[law]
    impacts, numbers = [], []
    for number, flight in enumerate(flights):
        rows = slice(samples.starts[number], samples.starts[number + 1])
        if flight.contact is not None and samples.used[rows].any():
            last = fit.motion[rows][-1]
            impact = fit_contact(readings, flight, flight.contact, fit, last, bandwidth_hz)
            if impact is not None:
                impacts.append(impact)
                numbers.append(number)
    of_impacts, their_spread = medians(impacts)
    if their_spread:
        by_striker_m = np.median(end_errors_m(samples, fit)[:, numbers], axis=1)
        their_spread["stop_m"] = math.hypot(their_spread["stop_m"], *by_striker_m)
    of_crank, crank_spread = crank_of(fit)
    striker = fit.striker._asdict()
    used = np.count_nonzero(samples.sums(samples.used.astype(float)))
    return Identified(
        fits=found,
        law=law,
        values={name: striker[name] if name in fit.spread else 0.0 for name in OF_FLIGHTS}
        | of_crank
        | of_impacts,
        spread=flight_spread(fit) | crank_spread | their_spread,
        impacts=tuple(impacts),
        flights=len(flights),
        left_out=len(flights) - int(used),
        samples=samples,
        seconds=fit.samples * readings.period_s,
    )


def flight_spread(fit: Fit) -> dict[str, float]:
    """Standard errors of the flights' parameters; 0 of one that the law lacks."""
    spread = {name: fit.spread.get(name, 0.0) for name in OF_FLIGHTS}
    dry = "dry_m_s2"
    return spread | ({dry: math.hypot(spread[dry], DRY_M_S2)} if dry in fit.spread else {})


def crank_of(fit: Fit) -> tuple[dict[str, float], dict[str, float]]:
    """The crank's radius and the encoder's zero for a piston at A sin θ + B cos θ; their standard errors."""
    one, other = fit.striker.amplitude_m, fit.striker.quadrature_m
    along, across = fit.spread["amplitude_m"], fit.spread.get(QUADRATURE, 0.0)
    radius_m = math.hypot(one, other)
    values = {"amplitude_m": radius_m, "zero_rad": -math.atan2(other, one)}
    return values, {
        "amplitude_m": math.hypot(one * along, other * across) / radius_m,
        "zero_rad": math.hypot(one * across, other * along) / radius_m**2,
    }


# --- flights ------------------------------------------------------------------------------------------


def swing_m_s(readings: Readings) -> FloatArray:
    """A first estimate of v in m/s, without a model: ∫z dt less its mean over one turn of the crank."""
    v = np.zeros(len(readings.acceleration_m_s2))
    for begin, end in readings.pieces:
        z = readings.acceleration_m_s2[begin:end]
        turns = abs(readings.angle_rad[end - 1] - readings.angle_rad[begin]) / (2.0 * np.pi)
        width = round((end - begin) / turns) if turns > 1.0 else end - begin
        whole = integrals(z - np.mean(z), readings.period_s)[0]
        v[begin:end] = whole - uniform_filter1d(whole, max(width, 1), mode="nearest")
    return v


def friction_points(found: Identified) -> tuple[FloatArray, FloatArray]:
    """v in m/s, and friction per unit of mass in m/s²: that of the fitted law less the residual."""
    used = found.samples.used
    speeds = found.fit.motion[used, 1]
    return speeds, friction_m_s2(found.fit.striker, speeds) - found.fit.left[used]


# --- impacts --------------------------------------------------------------------------------------------


def fit_contact(
    readings: Readings, flight: Flight, contact: Contact, fit: Fit, state: FloatArray, bandwidth_hz: float
) -> Impact | None:
    """Fit one impact to the readings during it; None for a slow or incomplete one.

    `state`: x − l0 and v at the flight's last sample.
    """
    T = readings.period_s
    k, amplitude, offset, *_ = fit.striker
    since = flight.end - 1
    piece_end = next(end for begin, end in readings.pieces if begin <= contact.before < end)
    end = min(contact.after + AFTER_ROWS, piece_end)
    z = readings.acceleration_m_s2[since:end]
    last = contact.before - since
    velocity, way = integrals(z[: last + 1] - offset, T)
    x, v = float(state[0] + state[1] * last * T + way[-1]), float(state[1] + velocity[-1])
    if v < GRAZING_M_S or not np.all(np.isfinite(z)):
        return None
    rows = np.asarray(np.arange(end - contact.before) * T, np.float64)
    angle_rad = readings.angle_rad[contact.before : end]
    crank = np.sin(angle_rad) + fit.striker.quadrature_m / amplitude * np.cos(angle_rad)
    delay_s = low_pass_delay_s(bandwidth_hz)
    coming = float(z[last]) - offset
    at_s, near = T, None
    for _ in range(2):
        later_s = at_s + delay_s  # the low-pass delays the readings of the whole flight
        speed = v + coming * later_s
        spring = -k * (x + v * later_s + 0.5 * coming * later_s**2 - amplitude * crank)
        rate_m_s3, at_first_m_s2 = np.polyfit(rows, -spring, 1).tolist()
        pull = Pull(at_first_m_s2, rate_m_s3)
        fitted = fit_impact(rows, spring + offset - z[last:], speed, pull, bandwidth_hz, fit.striker, near)
        at_s, near = fitted.touch_down_s, fitted
    later_s = at_s + delay_s
    return Impact(
        stop_m=x + v * later_s + 0.5 * coming * later_s * later_s,
        speed_m_s=speed,
        restitution=fitted.restitution,
        contact_s=contact_time_s(fitted.scale_s, speed),
        misfit=fitted.misfit,
        at_s=(contact.before + at_s / T) * T,
    )


def low_pass_delay_s(bandwidth_hz: float) -> float:
    """Delay in s of a Butterworth low-pass of second order, well below its corner frequency."""
    return float(np.sqrt(2.0) / (2.0 * np.pi * bandwidth_hz))


def medians(impacts: Sequence[Impact]) -> tuple[dict[str, float], dict[str, float]]:
    """The medians over impacts and their standard errors; both empty for fewer than two impacts."""
    if len(impacts) < 2:
        return {}, {}
    low, middle, high = np.percentile(np.array(impacts), (25.0, 50.0, 75.0), axis=0)
    scatter = MEDIAN * (high - low) / QUARTILES / np.sqrt(len(impacts))
    values, errors = Impact(*middle.tolist())._asdict(), Impact(*scatter.tolist())._asdict()
    factor = max(1.0, values["contact_s"] / SHORT_S)
    shared = SHARED | {name: factor * SHARED[name] for name in ("restitution", "contact_s")}
    return {name: values[name] for name in SHARED}, {
        name: float(np.hypot(errors[name], one)) for name, one in shared.items()
    }


# --- as a command -------------------------------------------------------------------------------------


OF_A_RUN = ("scenario of a run", "give the run's can.log alone, which goes by the default parameters")


def nominal_of(source: Path) -> dict[str, float]:
    """The firmware's parameters in the run of a run folder; the defaults for a candump log."""
    scenario = source / RunFile.SCENARIO
    document = read_toml(scenario, *OF_A_RUN) if scenario.is_file() else {}
    return with_overrides(document.get("firmware", {}))


def bench_of(source: Path, scene: str | None) -> Bench | None:
    """The plant of the safety scenarios, named or the run's own, and the highest requested ratio.

    None if there is neither. The fit does not use this plant.
    """
    scenario = source / RunFile.SCENARIO
    if scene is not None:
        tables = read_scene(scene)
    elif scenario.is_file():
        tables = read_toml(scenario, *OF_A_RUN).get("scene", {})
    else:
        return None
    commands = frames_of(StoredBus(can_log_of(source)), OperatorCommand).signals
    ratios = commands[:, OperatorCommand._fields.index("target_ratio")] if len(commands) else np.zeros(0)
    return Bench(tables, ratio=float(np.max(ratios)) if ratios.any() else math.inf)


def tune_identify(source: Path) -> tuple[Tuning, Identified, Readings]:
    """The firmware's parameters of striker, friction and stop, from a run folder or a candump log."""
    nominal = nominal_of(source)
    readings = read(source, nominal["sensor.low_full_scale_m_s2"], nominal["control.tick_s"])
    found = identify(readings, nominal["sensor.bandwidth_hz"])
    mass, rest = nominal["striker.mass_kg"], nominal["striker.rest_length_m"]
    striker, bounds = found.fit.striker, found.bounds
    places = {
        "striker.spring_n_m": ("stiffness_1_s2", mass, 0.0),
        "drive.amplitude_m": ("amplitude_m", 1.0, 0.0),
        "friction.b_n_s_m": ("damping_1_s", mass, 0.0),
        "friction.mu": ("dry_m_s2", 1.0 / STANDARD_GRAVITY_M_S2, 0.0),
    }
    if len(found.impacts) >= FEWEST_IMPACTS:
        places |= {
            "stop.position_m": ("stop_m", 1.0, rest),
            "stop.restitution": ("restitution", 1.0, 0.0),
            "stop.contact_s": ("contact_s", 1.0, 0.0),
        }
    parameters = {
        name: make_value(name, *(one * factor + base for one in (found.values[key], *bounds[key])))
        for name, (key, factor, base) in places.items()
    }
    merits = {
        "residual": Merit(found.fit.residual_m_s2, "m/s^2"),
        "accelerometer_offset": Merit(striker.offset_m_s2, "m/s^2"),
        "criterion_over_the_next_law": Merit(
            _lead(found), "1", "lead of the chosen friction law; above 6 it is strong evidence"
        ),
        "condition": Merit(
            found.fit.condition, "1", "of the fit's equations; large: the log hardly separates the parameters"
        ),
        "flights": Merit(float(found.flights - found.left_out), "1"),
        "flights_left_out": Merit(float(found.left_out), "1"),
        "impacts": Merit(float(len(found.impacts)), "1"),
        "fitted": Merit(found.seconds, "s"),
    }
    if found.law == Law.STRIBECK:
        merits["stribeck_mu_s"] = Merit((striker.dry_m_s2 + striker.rise_m_s2) / STANDARD_GRAVITY_M_S2, "1")
        merits["stribeck_v_s"] = Merit(striker.v_s_m_s, "m/s")
        merits["stribeck_delta"] = Merit(striker.delta, "1")
    if found.impacts:
        merits["impacts_misfit"] = Merit(float(np.median([impact.misfit for impact in found.impacts])), "1")
    tuning = Tuning(
        command="identify",
        source=f"{source}: {found.law.value} friction, {found.seconds:.1f} s of free flight",
        seed=None,
        range_is="95 % bounds: 1.96 standard errors",
        parameters=parameters,
        figures_of_merit=merits,
        warnings=tuple(_warnings(found, parameters, readings, nominal)),
    )
    return tuning, found, readings


def _lead(found: Identified) -> float:
    """The next law's criterion less the chosen law's; above 6 is strong evidence (Kass & Raftery 1995)."""
    others = [fit.criterion for law, fit in found.fits.items() if law != found.law]
    return min(others) - found.fit.criterion


def _warnings(
    found: Identified, parameters: Mapping[str, Value], readings: Readings, nominal: Mapping[str, float]
) -> Iterator[str]:
    """The parameters that the log cannot identify."""
    yield (
        f"mass and rest length cannot be identified from accelerometer and encoder: forces are for "
        f"{nominal['striker.mass_kg']:g} kg, the stop for l0 = {nominal['striker.rest_length_m']:g} m"
    )
    for name, (value, unit, low, high) in parameters.items():
        size = value - nominal["striker.rest_length_m"] if name == "stop.position_m" else value
        if high - low > WIDE_SHARE * abs(size) and value != 0.0:
            yield (
                f"{name} = {figure(value, unit)} is known no better than {low:.4g} … {high:.4g}: a longer "
                "log, or one with several speeds, would show it"
            )
    if found.fit.condition > CONDITION_LIMIT:
        yield f"the regressors are nearly collinear (condition {found.fit.condition:.2g})"
    if _lead(found) < CLEAR_LEAD:
        yield f"the friction laws are hardly distinguished (criterion {_lead(found):.1f} above the next)"
    if len(found.impacts) < FEWEST_IMPACTS:
        yield f"{len(found.impacts)} usable impacts: nothing is said of the stop, wanted {FEWEST_IMPACTS}"
    noise_m_s2 = nominal["estimator.model_std_m_s2"]
    if found.fit.residual_m_s2 > UNEXPLAINED * noise_m_s2:
        yield (
            f"the residual is {found.fit.residual_m_s2:.3g} m/s², the sensor's noise {noise_m_s2:.3g}: "
            "another friction law, or something else moves the striker"
        )
    if float(np.nanstd(readings.housing_m_s2)) > UNEXPLAINED * noise_m_s2:
        yield "the housing moved, which the fit takes for the striker: record with the module held still"
