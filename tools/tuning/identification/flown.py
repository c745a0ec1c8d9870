"""The striker's parameters by output error: each flight is simulated and compared with the readings.

`laws` finds the friction law and first values from equations that are linear in the reading's own integrals;
the noise in these integrals makes b about 1 % too small. Here each flight is simulated from its initial state
(x0, v0), and parameters and initial states minimise the sum of the squared residuals of the reading (output
error, Ljung 1999, System Identification, ch. 7; Gauss–Newton). The residual is the sensor's white noise, so
that this is maximum likelihood, and

    σ² (Σ_i S_i)⁻¹,   S_i = JᵀJ − JᵀB (BᵀB)⁻¹ BᵀJ

with a flight's derivatives J by the parameters and B by its initial state, is the Cramér–Rao bound. S_i is
the information of a flight on the parameters, less the part that its unknown initial state uses up.

All flights are simulated in parallel, shape (ticks, flights). If v changes its sign within a tick, dry
friction acts with its mean over the tick, and derivatives of v jump by the ratio of the accelerations
(saltation). Stribeck's v_s and δ keep their values from `laws`; the bounds of the other parameters do not
include the uncertainty of these two.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from firmware_py.core.estimation.kalman import Transition
from firmware_py.core.estimation.striker_model import free_flight
from plant_sim.arrays import BoolArray, FloatArray
from tools.tuning.identification.flights import CRANK, Flight
from tools.tuning.identification.laws import FEWEST_SAMPLES, OUTLYING, Law, Rise, Striker, begun

PASSES = 6
"""Passes of Gauss–Newton; from the linear equations' values on, the third changes nothing that matters."""
SINGULAR = 1e-9
"""Smallest ratio of the eigenvalues of BᵀB that counts as above 0; in a moving flight it is about 0.01."""
FITTED: dict[Law, tuple[str, ...]] = {
    Law.VISCOUS: ("stiffness_1_s2", "amplitude_m", "offset_m_s2", "damping_1_s"),
    Law.COULOMB: ("stiffness_1_s2", "amplitude_m", "offset_m_s2", "dry_m_s2"),
    Law.BOTH: ("stiffness_1_s2", "amplitude_m", "offset_m_s2", "damping_1_s", "dry_m_s2"),
    Law.STRIBECK: ("stiffness_1_s2", "amplitude_m", "offset_m_s2", "dry_m_s2", "rise_m_s2"),
}


class Flown(NamedTuple):
    """The striker, the names of the fitted parameters, and their covariance due to the sensor's noise.

    `says`: the information S_i of each flight, shape (flights, p, p). `slopes`: the gradient of each flight's
    log-likelihood, shape (flights, p), in units of the noise's variance; the gradients sum to 0.
    `mean_square`: the mean squared residual of the reading, (m/s²)².
    """

    striker: Striker
    fitted: tuple[str, ...]
    covariance: FloatArray
    says: FloatArray
    slopes: FloatArray
    mean_square: float


class Table(NamedTuple):
    """The flights in columns: readings, sine of the crank's angle, and the mask of the used samples."""

    period_s: float
    z_m_s2: FloatArray
    crank: FloatArray
    used: BoolArray


class Motion(NamedTuple):
    """x − l0, v, and sign and rise of dry friction at the ticks; means of the last two over each tick."""

    x_m: FloatArray
    v_m_s: FloatArray
    sign: FloatArray
    risen: FloatArray
    mean_sign: FloatArray
    mean_risen: FloatArray


def fly(
    flights: Sequence[Flight], chosen: Sequence[BoolArray], law: Law, striker: Striker, rise: Rise
) -> Flown:
    """Fit the most likely parameters of a law; `striker` has the first values."""
    informative = [
        (one, mask) for one, mask in zip(flights, chosen, strict=True) if mask.sum() >= FEWEST_SAMPLES
    ]
    table = side_by_side(informative)
    x0, v0 = np.array([begun(flight, mask, striker) for flight, mask in informative]).T
    fitted = FITTED[law]
    p = len(fitted)
    for _ in range(PASSES):
        motion = moved(table, striker, rise, x0, v0)
        rows = derivatives(table, striker, motion, fitted) * table.used
        left = np.where(table.used, table.z_m_s2 - reading(table, striker, motion), 0.0)
        kept = as_good_as_most(left, table.used)
        squares = np.einsum("atn,btn->nab", rows, rows)
        slopes = np.einsum("atn,tn->na", rows, left)
        # Each initial state is determined by its own flight alone, so it is eliminated.
        # If friction holds the striker from the first tick on, v0 is not observable.
        own = np.linalg.pinv(squares[:, p:, p:], SINGULAR, hermitian=True) @ np.dstack(
            [squares[:, p:, :p], slopes[:, p:, None]]
        )
        says = (squares[:, :p, :p] - squares[:, :p, p:] @ own[:, :, :p]) * kept[:, None, None]
        pulls = (slopes[:, :p] - (squares[:, :p, p:] @ own[:, :, p:])[:, :, 0]) * kept[:, None]
        step = np.linalg.solve(says.sum(axis=0), pulls.sum(axis=0))
        by = dict(zip(fitted, step.tolist(), strict=True))
        striker = Striker(*(value + by.get(name, 0.0) for name, value in striker._asdict().items()))
        x0, v0 = np.array([x0, v0]) + (own[:, :, p] - own[:, :, :p] @ step).T
    samples = float(table.used[:, kept].sum() - 2 * kept.sum() - p)
    variance = float(np.sum(left[:, kept] ** 2)) / samples
    covariance = variance * np.linalg.inv(says.sum(axis=0))
    return Flown(striker, fitted, covariance, says, pulls - says @ step, variance)


def spreads(flown: Flown, resamples: int, noise: np.random.Generator) -> dict[str, float]:
    """Standard deviations from the sensor's noise, or over resampled flights if the latter are larger."""
    n = len(flown.says)
    sampled = np.array(
        [
            np.linalg.solve(flown.says[rows].sum(axis=0), flown.slopes[rows].sum(axis=0))
            for rows in (noise.integers(n, size=n) for _ in range(resamples))
        ]
    )
    most = np.maximum(np.sqrt(np.diag(flown.covariance)), sampled.std(axis=0))
    return dict(zip(flown.fitted, most.tolist(), strict=True))


def side_by_side(informative: Sequence[tuple[Flight, BoolArray]]) -> Table:
    """Put flights of different lengths into one table; rows after the end of a flight are not used."""
    ticks = max(len(mask) for _, mask in informative)
    z, crank = np.zeros((ticks, len(informative))), np.zeros((ticks, len(informative)))
    used = np.zeros((ticks, len(informative)), bool)
    for place, (flight, mask) in enumerate(informative):
        n = len(mask)
        z[:n, place], crank[:n, place], used[:n, place] = flight.z_m_s2, flight.regressors[:, CRANK], mask
        crank[n:, place] = crank[n - 1, place]
    first = informative[0][0]
    return Table(float(first.t_s[1] - first.t_s[0]), z, crank, used)


def as_good_as_most(left: FloatArray, used: BoolArray) -> BoolArray:
    """Mask of the flights that the law fits: no sticking or shock makes their mean square far larger."""
    mean = np.sum(left**2, axis=0) / used.sum(axis=0)
    good: BoolArray = mean <= OUTLYING * np.median(mean)
    return good


def stepped(
    step: Transition, rest: FloatArray, x: FloatArray, v: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Advance the oscillator by a tick about `rest`, the equilibrium of spring, crank and dry friction."""
    return step.x_x * (x - rest) + step.x_v * v + rest, step.v_x * (x - rest) + step.v_v * v


def moved(table: Table, striker: Striker, rise: Rise, x0: FloatArray, v0: FloatArray) -> Motion:
    """Simulate all flights from their initial states, tick by tick, with the crank's mean over each tick."""
    k, amplitude, d, f, h, _ = striker
    step = free_flight(k, d, table.period_s)
    balance = 0.5 * amplitude * (table.crank[1:] + table.crank[:-1])

    def risen(v: FloatArray) -> FloatArray:
        return np.sign(v) * np.exp(-((np.abs(v) / rise.v_s_m_s) ** rise.delta)) if h else np.zeros_like(v)

    x, v = x0, v0
    ways, speeds, signs, rises = [x], [v], [], []
    for about in balance:
        sign, up = np.sign(v), risen(v)
        _, guess = stepped(step, about - (f * sign + h * up) / k, x, v)
        # Share of the tick before v changes its sign.
        share = np.where(guess * v < 0.0, v / np.where(guess == v, 1.0, v - guess), 1.0)
        sign, up = sign * (2.0 * share - 1.0), 0.5 * (up + risen(guess))
        x, v = stepped(step, about - (f * sign + h * up) / k, x, v)
        ways.append(x)
        speeds.append(v)
        signs.append(sign)
        rises.append(up)
    all_v = np.array(speeds)
    return Motion(np.array(ways), all_v, np.sign(all_v), risen(all_v), np.array(signs), np.array(rises))


def reading(table: Table, striker: Striker, motion: Motion) -> FloatArray:
    """z = β − κ (x − l0 − A sin θ) − d v − (f + h e^…) sign v."""
    k, amplitude, d, f, h, offset = striker
    spring = -k * (motion.x_m - amplitude * table.crank)
    return offset + spring - d * motion.v_m_s - f * motion.sign - h * motion.risen


def derivatives(table: Table, striker: Striker, motion: Motion, fitted: Sequence[str]) -> FloatArray:
    """Derivatives of the reading by the parameters, then by x0 and v0, shape (p + 2, ticks, flights).

    If u is the derivative of the acceleration by a parameter, the derivative ξ of the motion follows from
    ξ'' + d ξ' + κ ξ = u, from rest; the derivative of the reading is u − κ ξ − d ξ'.
    """
    k, amplitude, d, f, h, _ = striker
    step = free_flight(k, d, table.period_s)
    spring_m = motion.x_m - amplitude * table.crank

    def middle(values: FloatArray) -> FloatArray:
        return 0.5 * (values[1:] + values[:-1])

    nothing = np.zeros_like(spring_m)
    pushes: dict[str, tuple[FloatArray, FloatArray]] = {
        "stiffness_1_s2": (-spring_m, middle(-spring_m)),
        "amplitude_m": (k * table.crank, middle(k * table.crank)),
        "damping_1_s": (-motion.v_m_s, middle(-motion.v_m_s)),
        "dry_m_s2": (-motion.sign, -motion.mean_sign),
        "rise_m_s2": (-motion.risen, -motion.mean_risen),
        "offset_m_s2": (nothing, nothing[1:]),
    }
    at_ticks = np.array([pushes[name][0] for name in fitted] + [nothing, nothing])
    over_ticks = np.array([pushes[name][1] for name in fitted] + [nothing[1:], nothing[1:]])
    # Factor at a change of v's sign: a₊/a₋, or 0 if friction holds the striker.
    turns = motion.sign[1:] * motion.sign[:-1] < 0.0
    free = -k * spring_m[:-1]
    before, behind = free - (f + h) * motion.sign[:-1], free - (f + h) * motion.sign[1:]
    jumps = np.where(turns, np.maximum(behind / np.where(before == 0.0, np.inf, before), 0.0), 1.0)
    way = np.zeros((len(fitted) + 2, table.z_m_s2.shape[1]))
    speed = np.zeros_like(way)
    way[-2], speed[-1] = 1.0, 1.0
    rows = np.empty((*way.shape[:1], *table.z_m_s2.shape))
    rows[:, 0] = at_ticks[:, 0] - k * way - d * speed
    for tick, jump in enumerate(jumps):
        way, speed = stepped(step, over_ticks[:, tick] / k, way, speed)
        speed = speed * jump
        rows[:, tick + 1] = at_ticks[:, tick + 1] - k * way - d * speed
    if "offset_m_s2" in fitted:
        rows[list(fitted).index("offset_m_s2")] = 1.0
    return rows
