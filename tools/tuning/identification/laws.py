"""The striker's parameters and friction law from all free flights together.

A flight's reading is linear in the parameters (`flights`), but its regressors are integrals of the reading
itself, so ordinary least squares are not enough. The sensor's noise in ∫∫z dt² has two effects. First, it
correlates the residuals, more and more along a flight; generalised least squares take this into account
(without them the error of b doubles, to 6 % if friction is dry as well). Second, noise in a regressor pulls
its coefficient towards 0. So the equations are solved with instrumental variables (Söderström & Stoica 1983):
each flight is simulated with the fitted model, which has no noise, and the residual is made orthogonal to the
regressors of the simulated flight.

Friction laws, per unit of mass: d v, f sign v, and in addition h exp(−(|v|/v_s)^δ) sign v for Stribeck's
rise. v_s is not a linear parameter and is found by a search. Of the laws that the Bayesian information
criterion (Schwarz 1978) does not clearly distinguish from the best, the simplest is chosen.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from scipy.linalg import cholesky, lstsq, solve_triangular, toeplitz
from scipy.optimize import minimize_scalar

from firmware_py.core.estimation.striker_model import free_flight
from plant_sim.arrays import BoolArray, FloatArray
from tools.tuning.identification.flights import (
    CRANK,
    CURVE,
    DAMPING,
    DRY,
    RISE,
    SLOW_M_S,
    STIFFNESS,
    Flight,
    integrals,
)

REGRESSORS = 6
READING = REGRESSORS
FEWEST_SAMPLES = 50
"""Fewest samples of a usable flight; fewer determine only its own offset and slope."""
OUTLYING = 4.0
"""Flights whose mean squared residual is above this multiple of the median are left out."""
AVERAGED = 5
"""Number of consecutive readings that are averaged; the motion is slower than this."""
HARDLY = 10.0
"""Difference of criteria above which the evidence is very strong (Kass & Raftery 1995)."""
INSTRUMENT_PASSES = 2
RISES = ((0.05, 1.0), (0.05, 2.0))
"""Stribeck's first shapes (v_s, δ); v_s is then searched, δ is 1 or 2 (Armstrong-Hélouvry et al. 1994)."""
RISE_PASSES = 4


class Law(StrEnum):
    """Friction laws that are distinguished."""

    VISCOUS = "viscous"
    COULOMB = "coulomb"
    BOTH = "coulomb and viscous"
    STRIBECK = "stribeck"


USED = {
    Law.VISCOUS: (STIFFNESS, CRANK, DAMPING, CURVE),
    Law.COULOMB: (STIFFNESS, CRANK, DRY, CURVE),
    Law.BOTH: (STIFFNESS, CRANK, DAMPING, DRY, CURVE),
    Law.STRIBECK: (STIFFNESS, CRANK, DRY, RISE, CURVE),
}


class Rise(NamedTuple):
    """The shape of Stribeck's rise towards rest: exp(−(|v|/v_s)^δ)."""

    v_s_m_s: float
    delta: float


NO_RISE = Rise(math.inf, 1.0)


class Striker(NamedTuple):
    """Per unit of mass: κ = c/m, d = b/m, f = μ g, h = (μ_s − μ) g; A and the accelerometer's offset β."""

    stiffness_1_s2: float
    amplitude_m: float
    damping_1_s: float
    dry_m_s2: float
    rise_m_s2: float
    offset_m_s2: float


@dataclass(frozen=True)
class Fit:
    """A fitted law: the striker, the RMS of the residual, the number of samples, and the criterion."""

    law: Law
    striker: Striker
    rise: Rise
    residual_m_s2: float
    samples: int
    criterion: float
    condition: float


class Normals(NamedTuple):
    """Normal matrices of each flight, its own line projected out: products of regressors and reading among
    themselves, shape (n, 7, 7), and with the instruments, (n, 7, 7), whose row of the reading is 0."""

    own: FloatArray
    crossed: FloatArray


@dataclass(frozen=True)
class Signed:
    """The flights with the sign of v as a regressor, and the masks of the samples with motion."""

    flights: list[Flight]
    chosen: list[BoolArray]
    speeds_m_s: list[FloatArray]


def with_signs(flights: Sequence[Flight], speeds_m_s: Sequence[FloatArray]) -> Signed:
    """Set the regressor sign v of the flights, and choose the samples with motion."""
    signed, chosen = [], []
    for flight, v in zip(flights, speeds_m_s, strict=True):
        columns = flight.regressors.copy()
        columns[:, DRY] = np.sign(v)
        signed.append(replace(flight, regressors=columns))
        chosen.append(~flight.still & (np.abs(v) > SLOW_M_S))
    return Signed(signed, chosen, list(speeds_m_s))


def with_rise(flights: Sequence[Flight], speeds_m_s: Sequence[FloatArray], rise: Rise) -> list[Flight]:
    """The flights with a column for Stribeck's rise."""
    risen = []
    for flight, v in zip(flights, speeds_m_s, strict=True):
        columns = flight.regressors.copy()
        columns[:, RISE] = columns[:, DRY] * np.exp(-((np.abs(v) / rise.v_s_m_s) ** rise.delta))
        risen.append(replace(flight, regressors=columns))
    return risen


def normals(
    flights: Sequence[Flight],
    chosen: Sequence[BoolArray],
    whiteners: Sequence[FloatArray | None],
    models: Sequence[Flight] | None = None,
) -> Normals:
    """The normal matrices of flights; without models each flight is its own instrument (least squares)."""
    own = np.zeros((len(flights), REGRESSORS + 1, REGRESSORS + 1))
    crossed = np.zeros_like(own)
    for number, (flight, mask, whitener) in enumerate(zip(flights, chosen, whiteners, strict=True)):
        if mask.sum() < FEWEST_SAMPLES:
            continue
        columns = [flight.regressors, flight.z_m_s2, np.ones(len(mask)), flight.t_s]
        if models is not None:
            columns.append(models[number].regressors)
        table = averaged(np.column_stack(columns), mask)
        if whitener is not None:
            table = solve_triangular(whitener, table, lower=True, check_finite=False)
        line = table[:, READING + 1 : READING + 3]
        rows = table[:, : READING + 1]
        across = np.linalg.qr(line)[0]
        rows = rows - across @ (across.T @ rows)
        own[number] = rows.T @ rows
        crossed[number, :READING] = (
            own[number, :READING] if models is None else table[:, READING + 3 :].T @ rows
        )
    return Normals(own, crossed)


def averaged(table: FloatArray, mask: BoolArray) -> FloatArray:
    """Means over blocks of `AVERAGED` consecutive rows; blocks with an unused row are left out."""
    blocks = len(mask) // AVERAGED
    used = mask[: blocks * AVERAGED].reshape(blocks, AVERAGED).all(axis=1)
    means: FloatArray = table[: blocks * AVERAGED].reshape(blocks, AVERAGED, -1).mean(axis=1)[used]
    return means


def whitener(flight: Flight, mask: BoolArray, striker: Striker) -> FloatArray | None:
    """The lower triangle W for which a flight's residuals are W times white noise; None for an unused flight.

    White noise ε of the reading adds ε + d ∫ε + κ ∫∫ε to the residual, because the reading is integrated.
    """
    if mask.sum() < FEWEST_SAMPLES:
        return None
    n = len(mask)
    T = float(flight.t_s[1] - flight.t_s[0])
    # Weight of a reading in the integrals, by its age in ticks.
    ago = np.arange(n) * T
    share = T * (striker.damping_1_s + striker.stiffness_1_s2 * ago)
    share[0] = 1.0
    made = averaged(toeplitz(share, np.zeros(n)), mask)
    return np.asarray(cholesky(made @ made.T, lower=True, check_finite=False), np.float64)


def fitting(matrices: Normals, chosen: Sequence[BoolArray]) -> Normals:
    """The normal matrices without flights that no law fits (a wrong sign of v, sticking, a shock).

    Each flight's mean squared residual, with the parameters from all flights, is compared with the median.
    """
    found = coefficients(matrices.crossed.sum(axis=0), Law.BOTH)
    with_reading = np.append(-found, 1.0)
    squares = np.einsum("i,nij,j->n", with_reading, matrices.own, with_reading)
    counts = np.array([mask.sum() for mask in chosen])
    says = matrices.own[:, READING, READING] > 0.0
    mean = squares / np.maximum(counts, 1)
    kept = (says & (mean <= OUTLYING * np.median(mean[says])))[:, None, None]
    return Normals(np.where(kept, matrices.own, 0.0), np.where(kept, matrices.crossed, 0.0))


def coefficients(total: FloatArray, law: Law) -> FloatArray:
    """Solve normal equations with columns scaled to the same size; unused coefficients are 0."""
    used = np.array(USED[law])
    normal = total[np.ix_(used, used)]
    scale = np.sqrt(np.maximum(np.abs(np.diag(normal)), 1e-300))
    found = np.zeros(REGRESSORS)
    found[used] = lstsq(normal / np.outer(scale, scale), total[used, READING] / scale)[0] / scale
    return found


def striker_of(found: FloatArray) -> Striker:
    """The parameters from the coefficients (−κ, κ A, −d, −f, κ β/2, −h)."""
    k = -found[STIFFNESS]
    return Striker(
        stiffness_1_s2=float(k),
        amplitude_m=float(found[CRANK] / k),
        damping_1_s=float(-found[DAMPING]),
        dry_m_s2=float(-found[DRY]),
        rise_m_s2=float(-found[RISE]),
        offset_m_s2=float(2.0 * found[CURVE] / k),
    )


def solved(matrices: Normals, law: Law) -> Striker:
    """The striker's parameters from all flights together."""
    return striker_of(coefficients(matrices.crossed.sum(axis=0), law))


def fit(matrices: Normals, chosen: Sequence[BoolArray], law: Law, rise: Rise) -> Fit:
    """Fit a law; in the criterion, a searched shape of Stribeck's rise counts as parameters too."""
    shapes = 0 if rise == NO_RISE else len(rise)
    own = matrices.own
    total = own.sum(axis=0)
    found = coefficients(matrices.crossed.sum(axis=0), law)
    rows = sum(
        len(averaged(np.zeros((len(mask), 1)), mask))
        for mask, one in zip(chosen, own, strict=True)
        if one[READING, READING] > 0.0
    )
    with_reading = np.append(-found, 1.0)
    squares = max(float(with_reading @ total @ with_reading), 1e-300)
    used = np.array(USED[law])
    normal = total[np.ix_(used, used)]
    scale = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    return Fit(
        law=law,
        striker=striker_of(found),
        rise=rise,
        residual_m_s2=float(np.sqrt(squares / rows)),
        samples=AVERAGED * rows,
        criterion=float(rows * np.log(squares / rows) + (len(used) + shapes) * np.log(rows)),
        condition=float(np.linalg.cond(normal / np.outer(scale, scale))),
    )


# --- a law and all flights ----------------------------------------------------------------------------


class Samples(NamedTuple):
    """The flights with their signs of v, the samples kept for all laws, and the flights' whiteners."""

    flights: list[Flight]
    speeds_m_s: list[FloatArray]
    kept: list[BoolArray]
    whiteners: list[FloatArray | None]


class Candidate(NamedTuple):
    """A fitted law with the flights, including its regressors, and their normal matrices."""

    fit: Fit
    flights: list[Flight]
    matrices: Normals


def prepared(signed: Signed, matrices: Normals) -> Samples:
    """The samples to which all laws are fitted: those of the flights that `matrices` still has."""
    says = matrices.own[:, READING, READING] > 0.0
    kept = [mask & bool(one) for mask, one in zip(signed.chosen, says, strict=True)]
    striker = solved(matrices, Law.BOTH)
    whiteners = [whitener(flight, mask, striker) for flight, mask in zip(signed.flights, kept, strict=True)]
    return Samples(signed.flights, signed.speeds_m_s, kept, whiteners)


def candidates(samples: Samples) -> dict[Law, list[Candidate]]:
    """Fit every law; Stribeck's from each of its first shapes, the best first."""
    found: dict[Law, list[Candidate]] = {
        law: [_by_instruments(samples, NO_RISE, law)] for law in Law if law != Law.STRIBECK
    }
    risen = [_by_instruments(*_with_best_rise(samples, Rise(*rise))) for rise in RISES]
    return {**found, Law.STRIBECK: sorted(risen, key=lambda one: one.fit.criterion)}


def simplest(fits: Mapping[Law, Fit]) -> Law:
    """The law with the fewest parameters of those that the criterion hardly distinguishes from the best."""
    best = min(one.criterion for one in fits.values())
    near = [law for law, one in fits.items() if one.criterion < best + HARDLY]
    return min(near, key=lambda law: (len(USED[law]) + 2 * (law == Law.STRIBECK), fits[law].criterion))


def _by_instruments(samples: Samples, rise: Rise, law: Law = Law.STRIBECK) -> Candidate:
    """Fit a law with instrumental variables, starting from least squares."""
    flights, _, kept, whiteners = samples
    matrices = normals(flights, kept, whiteners)
    for _ in range(INSTRUMENT_PASSES):
        striker = solved(matrices, law)
        models = [modelled(flight, mask, striker) for flight, mask in zip(flights, kept, strict=True)]
        matrices = normals(flights, kept, whiteners, models)
    return Candidate(fit(matrices, kept, law, rise), flights, matrices)


def _risen(samples: Samples, rise: Rise) -> Samples:
    return samples._replace(flights=with_rise(samples.flights, samples.speeds_m_s, rise))


def _rough(samples: Samples, rise: Rise) -> Fit:
    """Fit Stribeck's law with a given shape by least squares."""
    flights, _, kept, whiteners = _risen(samples, rise)
    return fit(normals(flights, kept, whiteners), kept, Law.STRIBECK, rise)


def _with_best_rise(samples: Samples, first: Rise) -> tuple[Samples, Rise]:
    """The shape with the least residual; the speeds, on which it depends, are updated before each pass."""
    best = _rough(samples, first)
    for _ in range(RISE_PASSES):
        flights = _risen(samples, best.rise).flights
        speeds = [
            speed_m_s(flight, mask, best.striker) for flight, mask in zip(flights, samples.kept, strict=True)
        ]
        samples = samples._replace(flights=with_signs(flights, speeds).flights, speeds_m_s=speeds)
        best = _best_speed(samples, best.rise)
    return _risen(samples, best.rise), best.rise


def _best_speed(samples: Samples, about: Rise) -> Fit:
    """The fit whose v_s has the least residual, between half and twice the v_s of `about`."""
    place = minimize_scalar(
        lambda log_v: _rough(samples, Rise(math.exp(log_v), about.delta)).criterion,
        bounds=(math.log(0.5 * about.v_s_m_s), math.log(2.0 * about.v_s_m_s)),
        method="bounded",
        options={"xatol": 0.01},
    )
    return _rough(samples, Rise(math.exp(float(place.x)), about.delta))


# --- one flight by the fitted striker -----------------------------------------------------------------


def begun(flight: Flight, mask: BoolArray, striker: Striker) -> tuple[float, float]:
    """The initial state of a flight, x0 − l0 and v0, from its own offset and slope."""
    k, amplitude, d, f, h, offset = striker
    shared = np.zeros(REGRESSORS)
    shared[[STIFFNESS, CRANK, DAMPING, DRY, CURVE, RISE]] = (-k, k * amplitude, -d, -f, 0.5 * k * offset, -h)
    line = np.column_stack([np.ones(mask.sum()), flight.t_s[mask]])
    p0, p1 = lstsq(line, flight.z_m_s2[mask] - flight.regressors[mask] @ shared)[0]
    v0 = (d * offset - p1) / k
    return float((offset - d * v0 - p0) / k), float(v0)


def speed_m_s(flight: Flight, mask: BoolArray, striker: Striker) -> FloatArray:
    """v over a flight in m/s; 0 for a flight without enough motion."""
    if mask.sum() < FEWEST_SAMPLES:
        return np.zeros(len(flight.t_s))
    _, v0 = begun(flight, mask, striker)
    return v0 + flight.regressors[:, DAMPING] - striker.offset_m_s2 * flight.t_s


def modelled(flight: Flight, mask: BoolArray, striker: Striker) -> Flight:
    """Simulate a flight with the fitted striker: the same crank angle and signs of v, without noise."""
    if mask.sum() < FEWEST_SAMPLES:
        return flight
    k, amplitude, d, f, h, offset = striker
    T = float(flight.t_s[1] - flight.t_s[0])
    step = free_flight(k, d, T)
    crank_m = amplitude * flight.regressors[:, CRANK]
    dry_m_s2 = f * flight.regressors[:, DRY] + h * flight.regressors[:, RISE]
    # The oscillator moves about the equilibrium of spring, crank and dry friction, constant over a tick.
    balance_m = 0.5 * (crank_m[1:] + crank_m[:-1]) - 0.5 * (dry_m_s2[1:] + dry_m_s2[:-1]) / k
    x, v = begun(flight, mask, striker)
    states = [(x, v)]
    for about in balance_m.tolist():
        x, v = step.x_x * (x - about) + step.x_v * v + about, step.v_x * (x - about) + step.v_v * v
        states.append((x, v))
    way_m, speed = np.array(states).T
    z = offset - k * (way_m - crank_m) - d * speed - dry_m_s2
    velocity, way = integrals(z, T)
    columns = flight.regressors.copy()
    columns[:, STIFFNESS], columns[:, DAMPING] = way, velocity
    return replace(flight, regressors=columns)
