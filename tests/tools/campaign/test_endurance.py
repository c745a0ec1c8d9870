"""Endurance: the eigenvalues of the estimate's covariance over a day of the compiled closed loop."""

import math

import numpy as np
import pytest
from compilers import require_compiler

from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.builds import Build
from firmware_py.shell.parameters import config_from
from hil.runs.job import Job
from hil.runs.segments import segments
from tools.campaign.campaign import scenario_of, script_of
from tools.campaign.modules import module_cell

COVARIANCE = tuple(
    f"state.estimator.p_{name}" for name in ("xx", "xv", "xb", "xv", "vv", "vb", "xb", "vb", "bb")
)
"""Signals of the nine elements of the estimate's covariance P, shape (3, 3), row by row."""
SIGNALS = (
    *sorted(set(COVARIANCE)),
    "state.estimator.started",
    "state.estimator.x_m",
    "outputs.mode",
    "outputs.fault",
)
KEPT = {"plant": ("x_m",), "firmware": SIGNALS}


@pytest.mark.parametrize("build", ["compiled", "host-single"])
def test_the_covariance_stays_positive_definite(build: Build, pytestconfig: pytest.Config) -> None:
    """The nominal module in RUN; 86,400,000 ticks (`--endurance-ticks`) are a day."""
    if build == "host-single":
        require_compiler("gcc")
    ticks = pytestconfig.getoption("endurance_ticks")
    cell = module_cell("viscous", 1.1)
    script = script_of(cell, 0.5, ticks * config_from(cell.firmware).tick_s)
    scenario = scenario_of("endurance", cell.scene, cell.firmware, script, 1)
    smallest, squares, judged, mode = math.inf, 0.0, 0, Mode.INIT.value
    for segment in segments(Job(scenario, 1, build, kept=KEPT)):
        known = segment.rows["firmware"]
        p = np.stack([known[name] for name in COVARIANCE], axis=-1).reshape(-1, 3, 3)
        eigenvalues = np.where(known["state.estimator.started"], np.linalg.eigvalsh(p)[:, 0], math.inf)
        smallest = min(smallest, float(np.min(eigenvalues)))
        runs = known["outputs.mode"] == Mode.RUN
        squares += float(np.sum((known["state.estimator.x_m"] - segment.rows["plant"]["x_m"])[runs] ** 2))
        judged += int(np.count_nonzero(runs))
        mode = int(known["outputs.mode"][-1])
        assert not np.any(known["outputs.fault"] != Fault.NONE)
    assert 0.0 < smallest < 1e-5
    assert mode == Mode.RUN
    assert math.sqrt(squares / judged) < 1e-3
