import numpy as np
import pytest

from firmware_py.core.estimation import kalman
from firmware_py.core.estimation.kalman import Covariance, ProcessNoise, Push, Row, StateEstimate, Transition

SHIPPED = (kalman.predict, kalman.update)
WRITTEN_OUT = (kalman.predict_written_out, kalman.update_written_out)


def matrix(p: Covariance) -> np.ndarray:
    return np.array([[p.xx, p.xv, p.xb], [p.xv, p.vv, p.vb], [p.xb, p.vb, p.bb]])


def random_estimate(rng: np.random.Generator) -> StateEstimate:
    root = rng.normal(size=(3, 3)) * [[1e-2], [1e-1], [1.0]]
    p = root @ root.T
    mean = rng.normal(size=3)
    return StateEstimate(*mean, Covariance(p[0, 0], p[0, 1], p[0, 2], p[1, 1], p[1, 2], p[2, 2]))


def test_the_shipped_algebra_is_not_the_written_out_one() -> None:
    assert kalman.predict is not kalman.predict_written_out
    assert kalman.update is not kalman.update_written_out


def test_written_out_algebra_agrees_with_filterpy_step_by_step() -> None:
    rng = np.random.default_rng(3)
    for _ in range(300):
        estimate = random_estimate(rng)
        f = Transition(*rng.normal(size=6))
        push, q = Push(*rng.normal(size=2)), ProcessNoise(*rng.uniform(1e-8, 1e-2, size=3))
        row, z, r = Row(*rng.normal(size=3)), rng.normal(), rng.uniform(1e-4, 1.0)
        one, other = (predict(estimate, f, push, q) for predict in (SHIPPED[0], WRITTEN_OUT[0]))
        np.testing.assert_allclose(one[:3], other[:3], rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(one.p, other.p, rtol=1e-12, atol=1e-14)
        one, other = (update(one, z, row, r) for update in (SHIPPED[1], WRITTEN_OUT[1]))
        np.testing.assert_allclose(one[:3], other[:3], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(one.p, other.p, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("algebra", [SHIPPED, WRITTEN_OUT])
def test_update_is_bayes_rule_in_information_form(algebra: tuple) -> None:
    rng = np.random.default_rng(5)
    estimate = random_estimate(rng)
    row, z, r = Row(-87.5, -0.2, 1.0), 0.7, 2.25
    h = np.array([row])
    information = np.linalg.inv(matrix(estimate.p)) + h.T @ h / r
    mean = np.linalg.solve(
        information, np.linalg.solve(matrix(estimate.p), np.array(estimate[:3])) + h[0] * z / r
    )
    posterior = algebra[1](estimate, z, row, r)
    np.testing.assert_allclose(posterior[:3], mean, rtol=1e-9)
    np.testing.assert_allclose(matrix(posterior.p), np.linalg.inv(information), rtol=1e-7, atol=1e-12)


def test_innovation_and_its_variance() -> None:
    estimate = random_estimate(np.random.default_rng(7))
    row = Row(2.0, -1.0, 0.5)
    h = np.array(row)
    assert kalman.innovation(estimate, 3.0, row) == pytest.approx(3.0 - h @ np.array(estimate[:3]))
    assert kalman.innovation_variance(estimate.p, row, 0.3) == pytest.approx(h @ matrix(estimate.p) @ h + 0.3)


def test_covariance_stays_positive_through_a_hundred_thousand_steps() -> None:
    estimate = StateEstimate(0.0, 0.0, 0.0, Covariance(9e-4, 0.0, 0.0, 0.09, 0.0, 0.09))
    f = Transition(1.0, 1e-3, -5e-7, 0.0, 1.0, -1e-3)
    for _ in range(100_000):
        estimate = kalman.predict_written_out(estimate, f, Push(0.0, 0.0), ProcessNoise(0.0, 1e-8, 1e-8))
        estimate = kalman.update_written_out(estimate, 0.0, Row(-87.5, -0.2, 1.0), 9.0)
    assert np.linalg.eigvalsh(matrix(estimate.p)).min() > 0.0
