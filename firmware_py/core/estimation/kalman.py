"""The Kalman algebra of the estimator: filterpy's in the interpreted build, written out in the others.

State x = (position, velocity, accelerometer bias). `builds.numba_subset` replaces `predict` and `update` by
`predict_written_out` and `update_written_out`.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Transition(NamedTuple):
    """The rows of F for position and velocity; the bias keeps its value."""

    x_x: float
    x_v: float
    x_b: float
    v_x: float
    v_v: float
    v_b: float


class Row(NamedTuple):
    """One row of H."""

    x: float
    v: float
    b: float


class Covariance(NamedTuple):
    """The upper triangle of P; x in m, v in m/s, b in m/s²."""

    xx: float
    xv: float
    xb: float
    vv: float
    vb: float
    bb: float


class StateEstimate(NamedTuple):
    """Mean and covariance."""

    x_m: float
    v_m_s: float
    bias_m_s2: float
    p: Covariance


class Push(NamedTuple):
    """The increment of the state by the known input: u."""

    x_m: float
    v_m_s: float


class ProcessNoise(NamedTuple):
    """The diagonal of Q, in squares of m, m/s and m/s²."""

    xx: float
    vv: float
    bb: float


def innovation(estimate: StateEstimate, z: float, row: Row) -> float:
    """y = z − H x."""
    return z - (row.x * estimate.x_m + row.v * estimate.v_m_s + row.b * estimate.bias_m_s2)


def innovation_variance(p: Covariance, row: Row, variance: float) -> float:
    """S = H P Hᵀ + R."""
    column_x = p.xx * row.x + p.xv * row.v + p.xb * row.b
    column_v = p.xv * row.x + p.vv * row.v + p.vb * row.b
    column_b = p.xb * row.x + p.vb * row.v + p.bb * row.b
    return row.x * column_x + row.v * column_v + row.b * column_b + variance


def predict_written_out(estimate: StateEstimate, f: Transition, push: Push, q: ProcessNoise) -> StateEstimate:
    """x = F x + u, P = F P Fᵀ + Q."""
    p = estimate.p
    x_m = f.x_x * estimate.x_m + f.x_v * estimate.v_m_s + f.x_b * estimate.bias_m_s2 + push.x_m
    v_m_s = f.v_x * estimate.x_m + f.v_v * estimate.v_m_s + f.v_b * estimate.bias_m_s2 + push.v_m_s
    # F P
    xx = f.x_x * p.xx + f.x_v * p.xv + f.x_b * p.xb
    xv = f.x_x * p.xv + f.x_v * p.vv + f.x_b * p.vb
    xb = f.x_x * p.xb + f.x_v * p.vb + f.x_b * p.bb
    vx = f.v_x * p.xx + f.v_v * p.xv + f.v_b * p.xb
    vv = f.v_x * p.xv + f.v_v * p.vv + f.v_b * p.vb
    vb = f.v_x * p.xb + f.v_v * p.vb + f.v_b * p.bb
    return StateEstimate(
        x_m=x_m,
        v_m_s=v_m_s,
        bias_m_s2=estimate.bias_m_s2,
        p=Covariance(
            xx=xx * f.x_x + xv * f.x_v + xb * f.x_b + q.xx,
            xv=xx * f.v_x + xv * f.v_v + xb * f.v_b,
            xb=xb,
            vv=vx * f.v_x + vv * f.v_v + vb * f.v_b + q.vv,
            vb=vb,
            bb=p.bb + q.bb,
        ),
    )


def update_written_out(estimate: StateEstimate, z: float, row: Row, variance: float) -> StateEstimate:
    """K = P Hᵀ / S, x = x + K y, P = (I − KH) P (I − KH)ᵀ + K R Kᵀ   (Joseph)."""
    p = estimate.p
    y = z - (row.x * estimate.x_m + row.v * estimate.v_m_s + row.b * estimate.bias_m_s2)
    column_x = p.xx * row.x + p.xv * row.v + p.xb * row.b
    column_v = p.xv * row.x + p.vv * row.v + p.vb * row.b
    column_b = p.xb * row.x + p.vb * row.v + p.bb * row.b
    s = row.x * column_x + row.v * column_v + row.b * column_b + variance
    kx = column_x / s
    kv = column_v / s
    kb = column_b / s
    # A = I − K H
    axx, axv, axb = 1.0 - kx * row.x, -kx * row.v, -kx * row.b
    avx, avv, avb = -kv * row.x, 1.0 - kv * row.v, -kv * row.b
    abx, abv, abb = -kb * row.x, -kb * row.v, 1.0 - kb * row.b
    # A P
    xx = axx * p.xx + axv * p.xv + axb * p.xb
    xv = axx * p.xv + axv * p.vv + axb * p.vb
    xb = axx * p.xb + axv * p.vb + axb * p.bb
    vx = avx * p.xx + avv * p.xv + avb * p.xb
    vv = avx * p.xv + avv * p.vv + avb * p.vb
    vb = avx * p.xb + avv * p.vb + avb * p.bb
    bx = abx * p.xx + abv * p.xv + abb * p.xb
    bv = abx * p.xv + abv * p.vv + abb * p.vb
    bb = abx * p.xb + abv * p.vb + abb * p.bb
    return StateEstimate(
        x_m=estimate.x_m + kx * y,
        v_m_s=estimate.v_m_s + kv * y,
        bias_m_s2=estimate.bias_m_s2 + kb * y,
        p=Covariance(
            xx=xx * axx + xv * axv + xb * axb + kx * variance * kx,
            xv=xx * avx + xv * avv + xb * avb + kx * variance * kv,
            xb=xx * abx + xv * abv + xb * abb + kx * variance * kb,
            vv=vx * avx + vv * avv + vb * avb + kv * variance * kv,
            vb=vx * abx + vv * abv + vb * abb + kv * variance * kb,
            bb=bx * abx + bv * abv + bb * abb + kb * variance * kb,
        ),
    )


# The interpreted build. The first call imports filterpy, which takes a second; no other build needs it.


def matrix(p: Covariance) -> NDArray[np.float64]:
    """P, shape (3, 3)."""
    return np.array(((p.xx, p.xv, p.xb), (p.xv, p.vv, p.vb), (p.xb, p.vb, p.bb)))


def estimate_of(x: NDArray[np.float64], p: NDArray[np.float64]) -> StateEstimate:
    """The estimate of the mean x, shape (3,), and the covariance P, shape (3, 3)."""
    (xx, xv, xb), (_, vv, vb), (_, _, bb) = p.tolist()
    x_m, v_m_s, bias_m_s2 = x.tolist()
    return StateEstimate(x_m, v_m_s, bias_m_s2, Covariance(xx, xv, xb, vv, vb, bb))


def predict(estimate: StateEstimate, f: Transition, push: Push, q: ProcessNoise) -> StateEstimate:
    """x = F x + u, P = F P Fᵀ + Q, by `filterpy.kalman.predict` with u through B = I."""
    from filterpy import kalman  # noqa: PLC0415 - see above

    x, p = kalman.predict(
        np.array(estimate[:3]),
        matrix(estimate.p),
        F=np.array(((f.x_x, f.x_v, f.x_b), (f.v_x, f.v_v, f.v_b), (0.0, 0.0, 1.0))),
        Q=np.diag(q),
        u=np.array((push.x_m, push.v_m_s, 0.0)),
        B=np.eye(3),
    )
    return estimate_of(x, p)


def update(estimate: StateEstimate, z: float, row: Row, variance: float) -> StateEstimate:
    """x = x + K y, P in Joseph form, by `filterpy.kalman.update`."""
    from filterpy import kalman  # noqa: PLC0415 - see above

    x, p = kalman.update(
        np.array(estimate[:3]), matrix(estimate.p), z, np.array(((variance,),)), H=np.array((row,))
    )
    return estimate_of(x, p)
