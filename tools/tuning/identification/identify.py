"""The striker's parameters from one recorded log: stiffness by mass, friction law, crank radius, stop, k.

Only CAN frames are used: those of the accelerometer and the encoder. `flights` writes the reading in free
flight as linear in the parameters, `laws` combines all flights and chooses the friction law, and `flown` fits
the most likely values. Their bounds follow from the sensor's noise (Cramér–Rao), or from flights resampled
with replacement (bootstrap, Efron 1979) if these bounds are wider. Position and speed of the striker at a
touch-down follow from the flight before; `impacts` fits the time, the stiffness and the restitution k.

These sensors cannot identify the mass or l0 alone. Forces are given for the nominal mass, positions for the
nominal l0.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from firmware_py.core.configure import STANDARD_GRAVITY_M_S2
from firmware_py.interface.generated.records import OperatorCommand
from firmware_py.shell.parameters import with_overrides
from hil.record.bus_reconstruction import frames_of
from hil.record.run_traces import read_bus
from hil.scenario.scenario import LARGEST_RATIO
from plant_sim.arrays import BoolArray, FloatArray
from plant_sim.scene import read_scene
from plant_sim.text_input import read_toml
from tools.output import BadInputError
from tools.tuning.identification.flights import (
    CRANK,
    DAMPING,
    STIFFNESS,
    Contact,
    Flight,
    contacts_of,
    flights_of,
    integrals,
)
from tools.tuning.identification.flown import Flown, fly, spreads
from tools.tuning.identification.impacts import Friction, contact_time_s, fit_impact
from tools.tuning.identification.laws import (
    READING,
    Candidate,
    Fit,
    Law,
    Striker,
    begun,
    candidates,
    fitting,
    normals,
    prepared,
    simplest,
    solved,
    speed_m_s,
    with_signs,
)
from tools.tuning.recordings.readings import Readings, can_log_of, read
from tools.tuning.result import Merit, Tuning, Value, tuned
from tools.tuning.safety import Bench

RESAMPLES = 500
NORMAL_95 = 1.96
SIGN_PASSES = 8
"""Number of times that the sign of v is computed again from the last fit; it settles after four."""
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
SHARED = {"stop_m": 3e-5, "restitution": 1.5e-3}
"""Systematic error that all impacts of a log share, measured on sampled modules; it widens the bounds."""
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
    """The laws and impacts identified from a log, with 95 % bounds of each quantity."""

    fits: dict[Law, Fit]
    law: Law
    plain: Striker
    """The same law by ordinary least squares on the linear equations, without weights or likelihood."""
    bounds: dict[str, tuple[float, float]]
    impacts: tuple[Impact, ...]
    flights: int
    used: tuple[Flight, ...]
    """Flights with the sign of v, for pictures."""
    left_out: int
    """Number of flights in which the striker does not move, or that no law fits."""
    seconds: float

    @property
    def fit(self) -> Fit:
        """The fit of the chosen law."""
        return self.fits[self.law]


def identify(readings: Readings, bandwidth_hz: float, seed: int = 1) -> Identified:
    """Fit a log's readings; `bandwidth_hz` is that of the accelerometers' low-pass."""
    contacts = contacts_of(readings)
    flights = flights_of(readings, contacts, low_pass_delay_s(bandwidth_hz))
    if len(flights) < FEWEST_FLIGHTS:
        raise BadInputError(
            f"the log has {len(flights)} free flights of the striker, wanted {FEWEST_FLIGHTS} or more; "
            "record some seconds with the crank turning"
        )
    swing = _swing_m_s(readings)
    signed = with_signs(flights, [swing[one.begin : one.end] for one in flights])
    as_they_are = [None] * len(flights)
    matrices = normals(signed.flights, signed.chosen, as_they_are)
    for _ in range(SIGN_PASSES):
        striker = solved(matrices, Law.BOTH)
        speeds = [
            speed_m_s(flight, mask, striker)
            for flight, mask in zip(signed.flights, signed.chosen, strict=True)
        ]
        signed = with_signs(flights, speeds)
        matrices = fitting(normals(signed.flights, signed.chosen, as_they_are), signed.chosen)
    fitted = candidates(prepared(signed, matrices))
    fits = {law: shapes[0].fit for law, shapes in fitted.items()}
    law = simplest(fits)
    # The linear equations hardly distinguish Stribeck's shapes; the residual of the reading does.
    chosen, says, flown = min(
        (_flown(one, signed.chosen) for one in fitted[law]), key=lambda tried: tried[2].mean_square
    )
    fit = replace(chosen.fit, striker=flown.striker)
    impacts = tuple(
        impact
        for flight in chosen.flights
        if flight.contact is not None
        and (impact := _impact(readings, flight, flight.contact, fit, bandwidth_hz)) is not None
    )
    noise = np.random.default_rng(seed)
    return Identified(
        fits=fits | {law: fit},
        law=law,
        plain=solved(matrices, law),
        bounds=_bounds(flown, noise) | _bounds_of_impacts(impacts, noise),
        impacts=impacts,
        flights=len(flights),
        used=tuple(flight for flight, one in zip(chosen.flights, says, strict=True) if one),
        left_out=int(np.count_nonzero(~says)),
        seconds=chosen.fit.samples * readings.period_s,
    )


def _flown(candidate: Candidate, chosen: Sequence[BoolArray]) -> tuple[Candidate, BoolArray, Flown]:
    """A candidate, the mask of its informative flights, and the fit by simulation of these flights."""
    says = candidate.matrices.own[:, READING, READING] > 0.0
    masks = [mask & bool(one) for mask, one in zip(chosen, says, strict=True)]
    fit = candidate.fit
    return candidate, says, fly(candidate.flights, masks, fit.law, fit.striker, fit.rise)


# --- flights ------------------------------------------------------------------------------------------


def _swing_m_s(readings: Readings) -> FloatArray:
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
    """v in m/s, and friction per unit of mass in m/s²: the reading less spring and crank."""
    striker = found.fit.striker
    k, offset = striker.stiffness_1_s2, striker.offset_m_s2
    speeds, left = [], []
    for flight in found.used:
        x0, v0 = begun(flight, np.ones(len(flight.t_s), bool), striker)
        t = flight.t_s
        x = x0 + v0 * t + flight.regressors[:, STIFFNESS] - 0.5 * offset * t * t
        speeds.append(v0 + flight.regressors[:, DAMPING] - offset * t)
        left.append(offset - k * (x - striker.amplitude_m * flight.regressors[:, CRANK]) - flight.z_m_s2)
    return np.concatenate(speeds), np.concatenate(left)


# --- impacts --------------------------------------------------------------------------------------------


def _impact(
    readings: Readings, flight: Flight, contact: Contact, fitted_law: Fit, bandwidth_hz: float
) -> Impact | None:
    """Fit one impact to the flight before and the readings during it; None for a slow or incomplete one."""
    T = readings.period_s
    striker = fitted_law.striker
    k, amplitude, d, f, _, offset = striker
    x0, v0 = begun(flight, np.ones(len(flight.t_s), bool), striker)
    last = contact.before - flight.begin
    end = min(contact.after + AFTER_ROWS, len(readings.acceleration_m_s2))
    z = readings.acceleration_m_s2[flight.begin : end]
    velocity, way = integrals(z[: last + 1], T)
    t = last * T
    x = x0 + v0 * t + way[-1] - 0.5 * offset * t * t
    v = v0 + velocity[-1] - offset * t
    if v < GRAZING_M_S or not np.all(np.isfinite(z)):
        return None
    # Spring and crank during the impact, with the striker at a constant position (within 3 mm).
    rows = np.asarray(np.arange(end - contact.before) * T, np.float64)
    angle = readings.angle_rad[contact.before : end]
    spring = -k * (x - amplitude * np.sin(angle))
    friction = Friction(d, f)
    delay_s = low_pass_delay_s(bandwidth_hz)
    coming = float(z[last]) - offset
    at_s, speed = T, v
    for _ in range(2):
        speed = v + coming * (at_s + delay_s)
        pull = -float(np.mean(spring))
        fitted = fit_impact(rows, spring + offset - z[last:], speed, pull, bandwidth_hz, friction)
        at_s = fitted.touch_down_s
    # The low-pass delays the readings of the whole flight.
    since = at_s + delay_s
    return Impact(
        stop_m=x + v * since + 0.5 * coming * since * since,
        speed_m_s=speed,
        restitution=fitted.restitution,
        contact_s=contact_time_s(fitted.scale_s, speed),
        misfit=fitted.misfit,
        at_s=(contact.before + at_s / T) * T,
    )


def low_pass_delay_s(bandwidth_hz: float) -> float:
    """Delay in s of a Butterworth low-pass of second order, well below its corner frequency."""
    return float(np.sqrt(2.0) / (2.0 * np.pi * bandwidth_hz))


# --- bounds -------------------------------------------------------------------------------------------


def _bounds(flown: Flown, noise: np.random.Generator) -> dict[str, tuple[float, float]]:
    """95 % bounds of the striker's parameters; a parameter that the law lacks is 0 with bounds of 0."""
    spread = spreads(flown, RESAMPLES, noise)
    return {
        name: (value - NORMAL_95 * spread.get(name, 0.0), value + NORMAL_95 * spread.get(name, 0.0))
        for name, value in flown.striker._asdict().items()
    }


def _bounds_of_impacts(
    impacts: tuple[Impact, ...], noise: np.random.Generator
) -> dict[str, tuple[float, float]]:
    """95 % bounds of the medians over impacts, by resampling the impacts with replacement."""
    if len(impacts) < 2:
        return {}
    table = np.array(impacts)
    medians = np.array(
        [np.median(table[noise.integers(len(table), size=len(table))], axis=0) for _ in range(RESAMPLES)]
    )
    lows, highs = np.percentile(medians, (2.5, 97.5), axis=0).tolist()
    return {
        name: (low - SHARED.get(name, 0.0), high + SHARED.get(name, 0.0))
        for name, low, high in zip(Impact._fields, lows, highs, strict=True)
    }


# --- as a command -------------------------------------------------------------------------------------


OF_A_RUN = ("scenario of a run", "give the run's can.log alone, which goes by the default parameters")


def nominal_of(source: Path) -> dict[str, float]:
    """The firmware's parameters in the run of a run folder; the defaults for a candump log."""
    scenario = source / "scenario.toml"
    document = read_toml(scenario, *OF_A_RUN) if scenario.is_file() else {}
    return with_overrides(document.get("firmware", {}))


def bench_of(source: Path, scene: str | None) -> Bench | None:
    """The plant of the safety scenarios, named or the run's own, and the highest requested ratio.

    None if there is neither. The fit does not use this plant.
    """
    scenario = source / "scenario.toml"
    if scene is not None:
        tables = read_scene(scene)
    elif scenario.is_file():
        tables = read_toml(scenario, *OF_A_RUN).get("scene", {})
    else:
        return None
    commands = frames_of(read_bus(can_log_of(source)), OperatorCommand).signals
    ratios = commands[:, OperatorCommand._fields.index("target_ratio")] if len(commands) else np.zeros(0)
    return Bench(tables, float(np.max(ratios)) if ratios.any() else LARGEST_RATIO)


def tune_identify(source: Path, seed: int = 1) -> tuple[Tuning, Identified, Readings]:
    """The firmware's parameters of striker, friction and stop, from a run folder or a candump log."""
    nominal = nominal_of(source)
    readings = read(source, nominal["sensor.low_full_scale_m_s2"], nominal["control.tick_s"])
    found = identify(readings, nominal["sensor.bandwidth_hz"], seed)
    mass, rest = nominal["striker.mass_kg"], nominal["striker.rest_length_m"]
    striker, bounds = found.fit.striker, found.bounds
    places = {
        "striker.spring_n_m": (striker.stiffness_1_s2, "stiffness_1_s2", mass, 0.0),
        "drive.amplitude_m": (striker.amplitude_m, "amplitude_m", 1.0, 0.0),
        "friction.b_n_s_m": (abs(striker.damping_1_s), "damping_1_s", mass, 0.0),
        "friction.mu": (abs(striker.dry_m_s2), "dry_m_s2", 1.0 / STANDARD_GRAVITY_M_S2, 0.0),
    }
    if len(found.impacts) >= FEWEST_IMPACTS:
        stop_m, _, restitution, contact_s, _, _ = np.median(np.array(found.impacts), axis=0).tolist()
        places |= {
            "stop.position_m": (stop_m, "stop_m", 1.0, rest),
            "stop.restitution": (restitution, "restitution", 1.0, 0.0),
            "stop.contact_s": (contact_s, "contact_s", 1.0, 0.0),
        }
    parameters = {
        name: tuned(name, one * factor + base, *(abs(bound) * factor + base for bound in bounds[key]))
        for name, (one, key, factor, base) in places.items()
    }
    merits = {
        "residual": Merit(found.fit.residual_m_s2, "m/s^2"),
        "accelerometer_offset": Merit(striker.offset_m_s2, "m/s^2"),
        "criterion_over_the_next_law": Merit(_lead(found), "1"),
        "condition": Merit(found.fit.condition, "1"),
        "flights": Merit(float(found.flights - found.left_out), "1"),
        "flights_left_out": Merit(float(found.left_out), "1"),
        "impacts": Merit(float(len(found.impacts)), "1"),
        "fitted": Merit(found.seconds, "s"),
    }
    if found.law == Law.STRIBECK:
        merits["stribeck_mu_s"] = Merit((striker.dry_m_s2 + striker.rise_m_s2) / STANDARD_GRAVITY_M_S2, "1")
        merits["stribeck_v_s"] = Merit(found.fit.rise.v_s_m_s, "m/s")
        merits["stribeck_delta"] = Merit(found.fit.rise.delta, "1")
    if found.impacts:
        merits["impacts_misfit"] = Merit(float(np.median([impact.misfit for impact in found.impacts])), "1")
    tuning = Tuning(
        command="identify",
        source=f"{source}: {found.law.value} friction, {found.seconds:.1f} s of free flight",
        seed=seed,
        range_is="95 %: by the sensor's noise, or over resampled flights and impacts where that is wider",
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
                f"{name} = {value:.4g} {unit} is known no better than {low:.4g} … {high:.4g}: a longer log, "
                "or one with several speeds, would show it"
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
