"""The striker's friction law and parameters by output error: simulated flights are compared with readings.

First values come from `first_values`; the noise in its integrals makes d too small. Therefore
`scipy.optimize.least_squares` then minimises the output error (Ljung 1999, System Identification, ch. 7): the
reading less that of a simulated flight. Its residual is the sensor's white noise, so that this is maximum
likelihood. Each flight's initial state (x0, v0) is determined by this flight alone and is eliminated from the
residual and its derivative (variable projection: Golub & Pereyra 1973, derivative by Kaufman 1975). Every
friction law is fitted to the same samples; Schwarz's criterion chooses one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import median_abs_deviation

from firmware_py.core.estimation.striker_model import free_flight
from plant_sim.arrays import BoolArray, FloatArray, IntArray
from tools.tuning.identification.first_values import (
    FEWEST_SAMPLES,
    SLOW_M_S,
    Linear,
    StillStrikerError,
    linear,
)
from tools.tuning.identification.flights import Flight
from tools.tuning.identification.friction_laws import (
    FITTED,
    QUADRATURE,
    RANGES,
    V0,
    X0,
    Law,
    Striker,
)
from tools.tuning.identification.simulated import FlightReadings, Flown, fly

HARDLY = 10.0
"""Difference of criteria above which the evidence is very strong (Kass & Raftery 1995)."""
MOST_PASSES = 15
"""Most evaluations of a law's residual; the right law needs four to ten, others need not converge."""
STATE_PASSES = 3
"""Gauss–Newton passes for the initial states, on which the residual depends almost linearly."""
SINGULAR = 1e-9
"""Smallest ratio of the eigenvalues of BᵀB that counts as above 0; in a moving flight it is about 0.01."""
ROUNDS = 2
"""Number of times that all laws are fitted again from the states that the others have found."""
WORSE = 5.0
"""Flights whose mean squared residual is above the median by more than this, in standard deviations that
follow from the median deviation, are left out."""
FIRST_RISE, LEAST_RISE_M_S2 = 0.3, 0.01
"""First value of Stribeck's rise: a share of f, and at least."""
EXPONENTS = (1.0, 2.0)
"""Values of Stribeck's δ that are tried (Armstrong-Hélouvry et al. 1994)."""


@dataclass(frozen=True)
class Fit:
    """A fitted law. `spread`: each parameter's standard error, the larger of two estimates.

    One is the Cramér–Rao bound for white noise, the other follows from the scatter of the flights' gradients
    (sandwich estimate: White 1982). `correlation`: that of the parameters' errors, in the order of `FITTED`.
    `states`: x0 − l0 and v0 of each flight; `motion`: x − l0 and v at each sample; `left`: the residual, in
    m/s².
    """

    law: Law
    striker: Striker
    spread: dict[str, float]
    correlation: FloatArray
    residual_m_s2: float
    samples: int
    criterion: float
    condition: float
    states: FloatArray
    motion: FloatArray
    left: FloatArray


class Samples:
    """The flights one after another, with the mask of the samples that are compared."""

    def __init__(
        self,
        flights: Sequence[Flight],
        used: Sequence[BoolArray],
        states: FloatArray,
        finds_zero: bool = False,
    ) -> None:
        """`states`: a first value of each flight's initial state; `states` of the object may have several.
        `finds_zero`: B is fitted too.
        """
        self.more = (QUADRATURE,) if finds_zero else ()
        self.period_s = float(flights[0].t_s[1])
        self.z_m_s2 = np.concatenate([one.z_m_s2 for one in flights])
        self.crank = np.concatenate([one.crank for one in flights])
        self.cosine = np.concatenate([one.cosine for one in flights])
        self.used = np.concatenate(list(used))
        self.lengths = np.array([len(one.z_m_s2) for one in flights])
        self.states = [states]

    @cached_property
    def starts(self) -> IntArray:
        """The first row of each flight and, at the end, the number of rows."""
        return np.concatenate([[0], np.cumsum(self.lengths)])

    def sums(self, rows: FloatArray) -> FloatArray:
        """Sums of rows over each flight."""
        return np.asarray(np.add.reduceat(rows, self.starts[:-1], axis=0))

    def fly(
        self, striker: Striker, states: FloatArray, wanted: Sequence[int]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Simulate all flights; return motion, residual and the wanted columns of derivatives.

        Samples that are not compared have a residual and derivatives of 0.
        """
        count = len(self.z_m_s2)
        flown = Flown(np.empty((count, 2)), np.empty(count), np.empty((count, len(wanted))))
        step = free_flight(striker.stiffness_1_s2, striker.damping_1_s, self.period_s)
        piston_m = striker.amplitude_m * self.crank + striker.quadrature_m * self.cosine
        readings = FlightReadings(self.starts, self.period_s, self.z_m_s2, self.crank, self.cosine, piston_m)
        fly(readings, step, striker, states, np.array(wanted, np.int64), flown)
        return flown.motion, flown.left * self.used, flown.rows * self.used[:, None]


# --- output error -------------------------------------------------------------------------------------


class Residual:
    """The residual of one law over all flights, and its derivative, both without the initial states' part."""

    def __init__(self, samples: Samples, law: Law, first: Striker) -> None:
        self._samples, self._first = samples, first
        self.fitted = (*FITTED[law], *samples.more)
        self.columns = [Striker._fields.index(name) for name in self.fitted]
        self.states = samples.states[0]
        self._at: bytes = b""
        self.motion = self.left = self.rows = np.empty(0)

    def striker(self, values: FloatArray) -> Striker:
        """The striker with these values of the fitted parameters."""
        return self._first._replace(**dict(zip(self.fitted, values.tolist(), strict=True)))

    def solve(self, values: FloatArray) -> None:
        """Simulate the flights with the initial states that fit best."""
        if self._at == values.tobytes():
            return
        self._at = values.tobytes()
        samples, striker = self._samples, self.striker(values)
        tried = [self.states, *samples.states]
        misfits = [samples.sums(samples.fly(striker, one, ())[1] ** 2) for one in tried]
        states = np.choose(np.argmin(misfits, axis=0)[:, None], tried)
        best, least, step = states, np.full(len(states), np.inf), np.zeros_like(states)
        for _ in range(STATE_PASSES):
            _, left, rows = samples.fly(striker, states, (X0, V0))
            now = samples.sums(left * left)
            better = (now < least)[:, None]
            best, least = np.where(better, states, best), np.minimum(now, least)
            squares = samples.sums(rows[:, :, None] * rows[:, None, :])
            slopes = samples.sums(rows * left[:, None])
            inverse = np.linalg.pinv(squares, SINGULAR, hermitian=True)
            # A step that makes the residual larger is halved: near a turn of v the model is not smooth.
            step = np.where(better, np.einsum("nab,nb->na", inverse, slopes), 0.5 * step)
            states = best + step
        _, left, _ = samples.fly(striker, states, ())
        self.states = np.where((samples.sums(left * left) < least)[:, None], states, best)
        self.motion, self.left, rows = samples.fly(striker, self.states, [*self.columns, X0, V0])
        shared, own = rows[:, : len(self.columns)], rows[:, len(self.columns) :]
        squares = samples.sums(own[:, :, None] * own[:, None, :])
        crossed = samples.sums(own[:, :, None] * shared[:, None, :])
        taken = np.linalg.pinv(squares, SINGULAR, hermitian=True) @ crossed
        self.rows = shared - np.einsum("na,nap->np", own, np.repeat(taken, samples.lengths, axis=0))

    def value(self, values: FloatArray) -> FloatArray:
        """The residual, shape (samples,)."""
        self.solve(values)
        return self.left

    def derivative(self, values: FloatArray) -> FloatArray:
        """The derivative of the residual, shape (samples, parameters)."""
        self.solve(values)
        return -self.rows


def fit(samples: Samples, law: Law, first: Striker) -> Fit:
    """Fit a law to the samples; `first` has its first values."""
    residual = Residual(samples, law, first)
    low, high = np.array([RANGES.get(name, (-np.inf, np.inf)) for name in residual.fitted]).T
    start = np.clip([getattr(first, name) for name in residual.fitted], low, high)
    found = least_squares(
        residual.value,
        start,
        residual.derivative,
        bounds=(low, high),
        x_scale="jac",
        max_nfev=MOST_PASSES,
    )
    residual.solve(found.x)
    p = len(found.x)
    moving = int(np.count_nonzero(samples.sums(samples.used.astype(float))))
    count = int(np.count_nonzero(samples.used))
    squares = float(residual.left @ residual.left)
    scale = 1.0 / np.maximum(np.linalg.norm(residual.rows, axis=0), 1e-300)
    rows = residual.rows * scale
    normal = rows.T @ rows
    inverse = np.linalg.pinv(normal, 1e-14, hermitian=True)
    deviation = np.sqrt(np.maximum(np.diag(inverse), 1e-300))  # a parameter that has no effect has 0
    gradients = samples.sums(rows * residual.left[:, None])
    variance = squares / (count - 2 * moving - p)
    noise = variance * np.diag(inverse)
    scatter = np.diag(inverse @ (gradients.T @ gradients) @ inverse)
    spread = scale * np.sqrt(np.maximum(noise, scatter))
    return Fit(
        law=law,
        striker=residual.striker(found.x),
        spread=dict(zip(residual.fitted, spread.tolist(), strict=True)),
        correlation=inverse / np.outer(deviation, deviation),
        residual_m_s2=math.sqrt(squares / count),
        samples=count,
        criterion=count * math.log(squares / count) + (p + (law == Law.STRIBECK)) * math.log(count),
        condition=float(np.linalg.cond(normal)),
        states=residual.states,
        motion=residual.motion,
        left=residual.left,
    )


def end_errors_m(samples: Samples, found: Fit) -> FloatArray:
    """What the parameters' errors make of each flight's last position, shape (parameters, flights).

    Each row is the change by one of the independent parts of the parameters' errors, of one standard error.
    """
    residual = Residual(samples, found.law, found.striker)
    residual.states = found.states
    values = np.array([getattr(found.striker, name) for name in residual.fitted])
    spread = np.array([found.spread[name] for name in residual.fitted])
    squares, directions = np.linalg.eigh(found.correlation)
    ends = samples.starts[1:] - 1
    errors = []
    for part in (directions * np.sqrt(np.maximum(squares, 0.0))).T:
        residual.solve(values + part * spread)
        errors.append(residual.motion[ends, 0] - found.motion[ends, 0])
    return np.array(errors)


def fits(
    flights: Sequence[Flight], first: Linear, finds_zero: bool = False
) -> tuple[Samples, dict[Law, Fit]]:
    """Fit every law to the same samples, without the flights that the chosen law does not fit.

    `finds_zero`: the piston's part by the cosine of the crank is fitted too.

    Raises StillStrikerError if the striker moves in hardly any sample.
    """
    plain = {law: linear(flights, first.speeds_m_s, law, finds_zero).striker for law in Law}
    rise = max(FIRST_RISE * abs(plain[Law.STRIBECK].dry_m_s2), LEAST_RISE_M_S2)
    starts: list[tuple[Law, Striker]] = [(law, plain[law]) for law in Law if law != Law.STRIBECK]
    starts += [
        (Law.STRIBECK, plain[Law.STRIBECK]._replace(rise_m_s2=rise, delta=delta)) for delta in EXPONENTS
    ]
    samples = Samples(flights, first.used, first.states, finds_zero)

    found = best_fits(samples, starts)
    # Near a turn of v the residual of a flight has several minima: a law may begin at the states of another.
    for _ in range(ROUNDS):
        leave_out(samples, found[simplest(found)])
        samples.states = [one.states for one in found.values()]
        rising = found[Law.STRIBECK].striker
        starts = [(law, one.striker) for law, one in found.items() if law != Law.STRIBECK]
        starts += [(Law.STRIBECK, rising._replace(delta=delta)) for delta in EXPONENTS]
        found = best_fits(samples, starts)
    return samples, found


def leave_out(samples: Samples, nearest: Fit) -> None:
    """Compare no sample without a clear sign of v, nor a flight that the law fits worse than all others.

    The linear fit's turns of v may be some ticks off, where a wrong sign of v outweighs all other samples. A
    flight that grazed the stop, or whose turns are not found, has a residual beyond the others' scatter.
    """
    counts = samples.sums(samples.used.astype(float))
    mean = samples.sums(nearest.left**2) / np.maximum(counts, 1.0)
    compared = mean[counts > 0.0]
    most = np.median(compared) + WORSE * median_abs_deviation(compared, scale="normal")
    good = (counts > 0.0) & (mean <= most)
    has_sign = np.abs(nearest.motion[:, 1]) > SLOW_M_S
    samples.used = samples.used & has_sign & np.repeat(good, samples.lengths)
    counts = samples.sums(samples.used.astype(float))
    if np.sum(counts) < FEWEST_SAMPLES + 2 * np.count_nonzero(counts):
        raise StillStrikerError  # friction holds what the linear fit has taken for motion


def best_fits(samples: Samples, starts: Sequence[tuple[Law, Striker]]) -> dict[Law, Fit]:
    """The best fit of each law from these first values."""
    found: dict[Law, Fit] = {}
    for law, start in starts:
        one = fit(samples, law, start)
        if law not in found or one.criterion < found[law].criterion:
            found[law] = one
    return found


def simplest(found: dict[Law, Fit]) -> Law:
    """The law with the fewest parameters of those that the criterion hardly distinguishes from the best."""
    best = min(one.criterion for one in found.values())
    near = [law for law, one in found.items() if one.criterion < best + HARDLY]
    return min(near, key=lambda law: (len(FITTED[law]), found[law].criterion))
