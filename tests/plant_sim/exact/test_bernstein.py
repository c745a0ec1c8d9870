"""Roots that cannot be stepped over, against polynomials whose roots are known."""

import math
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from numpy.polynomial import Polynomial

from plant_sim.solvers import bernstein
from plant_sim.solvers.bernstein import DEEPEST_HALVING, DEGREE, NO_ROOT, ORDER


@njit
def _first_rise(b, degree, stack):
    return bernstein.first_rise(b, degree, stack)


@njit
def _evaluate(b, degree, s):
    return bernstein.evaluate(b, degree, s)


def coefficients(polynomial: Polynomial) -> np.ndarray:
    """Bernstein coefficients of degree 7: b_i = Σ_j C(i, j)/C(7, j) c_j."""
    c = np.zeros(DEGREE + 1)
    c[: polynomial.coef.size] = polynomial.coef
    return np.array(
        [sum(math.comb(i, j) / math.comb(DEGREE, j) * c[j] for j in range(i + 1)) for i in range(DEGREE + 1)]
    )


def first_rise(polynomial: Polynomial) -> float:
    return _first_rise(coefficients(polynomial), DEGREE, np.zeros((DEEPEST_HALVING + 2, ORDER + 3)))


def test_evaluation() -> None:
    polynomial = Polynomial([0.3, -1.0, 2.0, 0.5, -4.0, 1.0, 0.0, 3.0])
    for s in np.linspace(0.0, 1.0, 11):
        assert _evaluate(coefficients(polynomial), DEGREE, s) == pytest.approx(polynomial(s), abs=1e-14)


@given(st.floats(0.001, 0.999), st.floats(3e-7, 0.5))
@settings(max_examples=300)
def test_the_first_of_two_roots_is_found_however_close_the_second(first: float, apart: float) -> None:
    found = first_rise(-Polynomial.fromroots([first, first + apart]))
    assert found == pytest.approx(first, abs=1e-14 / apart)


@pytest.mark.parametrize("overshoot", [1e-3, 1e-6, 1e-9, 1e-12])
def test_a_graze_is_found_and_none_is_invented(overshoot: float) -> None:
    graze = -((Polynomial([-0.37, 1.0])) ** 2) * Polynomial([1.0, 0.3, 0.2])
    assert first_rise(graze + overshoot) == pytest.approx(0.37, abs=2.0 * math.sqrt(overshoot))
    assert first_rise(graze - overshoot) == NO_ROOT


@given(st.lists(st.floats(0.01, 1.0), min_size=1, max_size=7))
@settings(max_examples=300)
def test_no_root_is_earlier_than_the_one_found(roots: list[float]) -> None:
    polynomial = Polynomial.fromroots(roots)
    polynomial *= -math.copysign(1.0, polynomial(0.0))
    found = first_rise(polynomial)
    before = np.linspace(0.0, min(found, 1.0), 200)[1:-1]
    assert np.all(polynomial(before) < 1e-12)
    if found <= 1.0:
        assert abs(polynomial(found)) < 1e-12


def test_ends_of_the_step_count() -> None:
    assert first_rise(Polynomial([-1.0, 1.0])) == 1.0
    assert first_rise(Polynomial([0.0, 1.0])) == 0.0
    assert first_rise(Polynomial([-1.0, 0.999999])) == NO_ROOT


CONSTANTS = """
import hashlib, importlib, pkgutil, numpy, plant_sim
digest = hashlib.sha256()
for found in pkgutil.walk_packages(plant_sim.__path__, "plant_sim."):
    for name, value in sorted(vars(importlib.import_module(found.name)).items()):
        if isinstance(value, numpy.ndarray):
            digest.update(name.encode() + value.tobytes())
print(digest.hexdigest())
"""


def test_constants_of_kernels_do_not_depend_on_the_linear_algebra_of_the_machine() -> None:
    """Kernels and FMUs are compiled with them in different processes, and must agree to the bit."""
    found = [
        subprocess.run(
            [sys.executable, "-P", "-c", CONSTANTS],
            env=os.environ | {"OPENBLAS_CORETYPE": kind},
            check=True,
            capture_output=True,
        ).stdout
        for kind in ("Prescott", "Haswell")
    ]
    assert found[0] == found[1]
