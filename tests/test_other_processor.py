"""The other processor of --other-processor rounds as a real one could."""

import numpy as np
import pytest
import scipy.linalg
from other_processor import on_another_processor


@pytest.mark.parametrize("seed", range(8))
def test_norms_and_singular_values_are_never_negative(seed: int) -> None:
    """A norm of zero became −2e-19 once, and its power complex: an integrator of scipy failed."""
    random = np.random.default_rng(seed)
    zeros = np.zeros((3, 2))
    assert on_another_processor(np.linalg.norm, random)(zeros) >= 0.0
    for svd in (np.linalg.svd, scipy.linalg.svd):
        other = on_another_processor(svd, random)
        assert np.all(other(zeros)[1] >= 0.0)
        assert np.all(other(zeros, compute_uv=False) >= 0.0)


def test_a_result_keeps_its_type() -> None:
    """A numpy float has other powers and divisions than a Python float."""
    norm = on_another_processor(np.linalg.norm, np.random.default_rng(0))
    assert isinstance(norm(np.ones(3)), np.float64)
