"""First values of the striker's parameters, from equations that are linear in them.

In free flight, with the accelerometer's offset β, the reading is

    z − β = −κ (x − l0 − A sin θ) − d v − f sign v,   κ = c/m, d = b/m, f = μ g

and the integrals of the reading are the striker's motion from the beginning of the flight on:

    x = x0 + v0 t + X − β t²/2,  v = v0 + V − β t,   V = ∫ z dt, X = ∫∫ z dt²

so that z is linear in (X, sin θ, V, sign v, t²) with coefficients (−κ, κ A, −d, −f, κ β/2), which all flights
share, as that of cos θ is if the encoder's zero is unknown, and in (1, t) with coefficients that differ
between flights.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from plant_sim.arrays import BoolArray, FloatArray
from tools.output import BadInputError
from tools.tuning.identification.flights import Flight, integrals
from tools.tuning.identification.friction_laws import Law, Striker

SLOW_M_S = 0.015
"""Below this speed, the sign of v is too uncertain for dry friction."""
FEWEST_SAMPLES = 50
"""Fewest samples of a usable flight; fewer determine only its own initial state."""
SIGN_PASSES = 8
"""Number of times that the sign of v is computed again from the linear fit; it settles after four."""
OUTLYING = 4.0
"""Flights whose mean squared residual is above this multiple of the median are left out."""


class StillStrikerError(BadInputError):
    """The striker does not move."""

    def __init__(self) -> None:
        super().__init__(
            f"the striker never moves faster than {SLOW_M_S:g} m/s in its free flights; "
            "record some seconds with the crank turning"
        )


class Linear(NamedTuple):
    """The parameters, and each flight's x0 − l0 and v0 (shape (n, 2)), speeds, samples with motion."""

    striker: Striker
    states: FloatArray
    speeds_m_s: list[FloatArray]
    used: list[BoolArray]


LINEAR: dict[Law, tuple[int, ...]] = {
    Law.VISCOUS: (0, 1, 2, 4),
    Law.COULOMB: (0, 1, 3, 4),
    Law.BOTH: (0, 1, 2, 3, 4),
    Law.STRIBECK: (0, 1, 3, 4),
}
"""Columns of each law among X, sin θ, V, sign v, t²; then cos θ."""
COSINE = 5


def linear(
    flights: Sequence[Flight], speeds_m_s: Sequence[FloatArray], law: Law, finds_zero: bool = False
) -> Linear:
    """Ordinary least squares on the linear equations, without flights that no law fits.

    `finds_zero`: the coefficient of cos θ is fitted too.

    Raises StillStrikerError if the striker does not move in any flight.
    """
    period_s = float(flights[0].t_s[1])
    tables, lines, used = [], [], []
    for flight, v in zip(flights, speeds_m_s, strict=True):
        mask = ~flight.still & (np.abs(v) > SLOW_M_S)
        velocity, way = integrals(flight.z_m_s2, period_s)
        t = flight.t_s
        tables.append(
            np.column_stack([way, flight.crank, velocity, np.sign(v), t * t, flight.cosine, flight.z_m_s2])
        )
        lines.append(np.column_stack([np.ones(len(t)), t]))
        used.append(mask & (mask.sum() >= FEWEST_SAMPLES))
    projected = []
    for table, line, mask in zip(tables, lines, used, strict=True):
        across = np.linalg.qr(line[mask])[0]
        projected.append(table[mask] - across @ (across.T @ table[mask]))
    chosen = np.array([*LINEAR[law], COSINE] if finds_zero else LINEAR[law])

    def solved(some: Sequence[FloatArray]) -> FloatArray:
        rows = np.concatenate(some)
        found = np.zeros(6)
        found[chosen] = np.linalg.lstsq(rows[:, chosen], rows[:, -1])[0]
        return found

    says = np.array([len(rows) > 0 for rows in projected])
    if not says.any():
        raise StillStrikerError
    found = solved(projected)
    squares = np.array(
        [np.mean((rows[:, -1] - rows[:, :-1] @ found) ** 2) if len(rows) else 0.0 for rows in projected]
    )
    kept = says & (squares <= OUTLYING * np.median(squares[says]))
    found = solved([rows for rows, one in zip(projected, kept, strict=True) if one])
    k = float(-found[0])
    striker = Striker(k, float(found[1] / k), float(2.0 * found[4] / k), float(-found[2]), float(-found[3]))
    striker = striker._replace(quadrature_m=float(found[COSINE] / k))
    states = np.zeros((len(flights), 2))
    speeds = []
    for number, (table, line, mask) in enumerate(zip(tables, lines, used, strict=True)):
        if not says[number]:
            speeds.append(np.zeros(len(table)))
            continue
        p0, p1 = np.linalg.lstsq(line[mask], table[mask, -1] - table[mask, :-1] @ found)[0]
        v0 = (striker.damping_1_s * striker.offset_m_s2 - p1) / k
        states[number] = (striker.offset_m_s2 - striker.damping_1_s * v0 - p0) / k, v0
        speeds.append(v0 + table[:, 2] - striker.offset_m_s2 * line[:, 1])
    return Linear(striker, states, speeds, [mask & bool(one) for mask, one in zip(used, kept, strict=True)])


def fit_signed(
    flights: Sequence[Flight], speeds_m_s: Sequence[FloatArray], finds_zero: bool = False
) -> Linear:
    """The linear fit of both friction laws, after the signs of v have settled."""
    found = linear(flights, speeds_m_s, Law.BOTH, finds_zero)
    for _ in range(SIGN_PASSES - 1):
        found = linear(flights, found.speeds_m_s, Law.BOTH, finds_zero)
    return found
