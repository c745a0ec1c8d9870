"""A filter's innovations: likelihood, size against the covariance, and effective number.

The innovations of a wrong model are correlated: a thousand in a row are not a thousand independent values.
Their mean log-likelihood is therefore weighted with their effective number (Varin, Reid & Firth 2011, 4.1),
which follows from their autocorrelation about 0; a constant series counts as one value.
"""

from typing import NamedTuple

import numpy as np

from plant_sim.arrays import FloatArray

HIGHEST_NIS = 25.0
"""Limit of a normalised square, (5 σ)², so that one unrecognised impact does not dominate the likelihood."""
LEAST_CORRELATION = 0.05


class Said(NamedTuple):
    """The mean log-likelihood of innovations, and their mean normalised square."""

    likelihood: float
    nis: float


def said(innovation: FloatArray, variance: FloatArray) -> Said:
    """The means of ln p = −½ (ln 2πS + ν²/S) and of ν²/S, over innovations ν with the variances S."""
    if len(innovation) == 0:
        return Said(0.0, float("nan"))
    squares = innovation**2 / variance
    likelihood = -0.5 * (np.log(2.0 * np.pi * variance) + np.minimum(squares, HIGHEST_NIS))
    return Said(float(np.mean(likelihood)), float(np.mean(squares)))


def correlation(series: FloatArray, lags: int) -> FloatArray:
    """The autocorrelation about 0 at lags 1 … lags.

    >>> correlation(np.array([1.0, 1.0, 1.0, 1.0]), 2).tolist()
    [0.75, 0.5]
    """
    size = 2 ** int(np.ceil(np.log2(2 * len(series))))
    spectrum = np.abs(np.fft.rfft(series, size)) ** 2
    whole = np.fft.irfft(spectrum, size)
    return np.asarray(whole[1 : lags + 1] / whole[0], np.float64)


def worth(series: FloatArray) -> float:
    """The effective number of values: n / (1 + 2 Σρ), summed up to the first ρ below LEAST_CORRELATION."""
    n = len(series)
    if n < 3 or not np.any(series):
        return float(min(n, 1))
    rho = correlation(series, n - 1)
    ends = np.flatnonzero(rho < LEAST_CORRELATION)
    last = int(ends[0]) if len(ends) else len(rho)
    return float(n / (1.0 + 2.0 * np.sum(rho[:last])))
