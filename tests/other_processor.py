"""Linear algebra and fits as another processor would round them.

OpenBLAS chooses its kernels by the processor, and each rounds differently: where one gives 0.0, another
gives −1.4e-21. `pytest --other-processor SEED` changes every float that numpy.linalg, scipy.linalg and
scipy.optimize return by up to one unit in its last place, and every zero by less than the rounding error of
the result's largest number. A test that compares such a float with `==` fails then, on every machine.
"""

import functools
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
import scipy.optimize
from threadpoolctl import threadpool_info

SOURCES = {
    np.linalg: "cholesky det eig eigh eigvals eigvalsh inv lstsq norm pinv qr solve svd",
    scipy.linalg: "cholesky eig eigh eigvals expm inv lstsq null_space pinv qr solve svd solve_discrete_are",
    scipy.optimize: "brentq curve_fit least_squares minimize minimize_scalar root",
    np: "polyfit roots",
}
"""The modules and functions whose results are rounded anew."""
PROJECT = ("compilation", "firmware_py", "plant_sim", "hil", "tools", "test_", "control")
"""Beginnings of the names of the modules that call them."""


def rounded_anew(value: Any, random: np.random.Generator) -> Any:
    """A result with each of its floats changed in the last place; what is no float stays."""
    if isinstance(value, scipy.optimize.OptimizeResult):
        return type(value)({key: rounded_anew(one, random) for key, one in value.items()})
    if isinstance(value, tuple):
        parts = [rounded_anew(one, random) for one in value]
        return type(value)(*parts) if hasattr(value, "_fields") else tuple(parts)
    if isinstance(value, float | complex | np.inexact | np.ndarray):
        found = np.asarray(value)
        if not np.issubdtype(found.dtype, np.inexact):
            return value
        unit = np.finfo(found.dtype).eps
        changed = found * (1.0 + unit * random.integers(-1, 2, found.shape))
        finite = np.abs(found[np.isfinite(found)])
        least = 1e-3 * unit * (finite.max(initial=0.0) or 1.0)
        changed = np.where(found == 0.0, least * random.uniform(-1.0, 1.0, found.shape), changed)
        changed = changed.astype(found.dtype)
        if isinstance(value, np.ndarray):
            return changed
        return changed[()] if isinstance(value, np.inexact) else changed.item()
    return value


def without_sign(name: str, result: Any) -> Any:
    """A norm and singular values are zero or positive on every processor; other results stay."""
    if name == "svd" and isinstance(result, tuple):
        left, singular, right = result
        return left, abs(singular), right
    return abs(result) if name in ("norm", "svd") else result


def on_another_processor(function: Callable[..., Any], random: np.random.Generator) -> Callable[..., Any]:
    """The function, with a result that is rounded anew."""

    @functools.wraps(function)
    def rounding(*arguments: Any, **named: Any) -> Any:
        return without_sign(function.__name__, rounded_anew(function(*arguments, **named), random))

    return rounding


def pytest_addoption(parser: pytest.Parser) -> None:
    """The seed of the roundings."""
    parser.addoption("--other-processor", type=int, metavar="SEED", help="round linear algebra anew")


def pytest_report_header(config: pytest.Config) -> list[str]:
    """The kernels of linear algebra that really run: an unknown name of OPENBLAS_CORETYPE is ignored."""
    if config.getoption("--other-processor") is None:
        return []
    found = [one for one in threadpool_info() if one["internal_api"] == "openblas"]
    return [f"linear algebra: {one['architecture']} ({one['version']})" for one in found]


@pytest.fixture(autouse=True)
def other_processor(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the functions wherever a module of the project has them."""
    seed = request.config.getoption("--other-processor")
    if seed is not None:
        random = np.random.default_rng(seed)
        originals = {
            getattr(source, name): on_another_processor(getattr(source, name), random)
            for source, names in SOURCES.items()
            for name in names.split()
        }
        users = [module for name, module in list(sys.modules.items()) if name.startswith(PROJECT)]
        for module in (*SOURCES, *users):
            for name, value in list(vars(module).items()):
                if callable(value) and getattr(value, "__hash__", None) and value in originals:
                    monkeypatch.setattr(module, name, originals[value])
