"""Endurance: the eigenvalues of the estimate's covariance over a day of the compiled closed loop."""

import math
import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_py.interface.enums import Fault, Mode
from firmware_py.shell.builds import Build
from firmware_py.shell.parameters import config_from
from hil.bench.lockstep import Progress
from hil.bench.stretches import records_of
from hil.record.traces.firmware_trace import columns_of
from hil.record.traces.plant_trace import PlantRecord
from hil.scenario.operator import Command, Request
from tools.campaign.trial.cells import cells_of
from tools.campaign.trial.scenarios import scenario_of

CONDITIONS = ((("viscous",), (1.1,), (0.0,)),)
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
TRUE_X = PlantRecord._fields.index("x_m")


def endurance(
    ticks: int,
    settings: Sequence[str] = (),
    seed: int = 1,
    build: Build = "compiled",
    progress: Progress = lambda *_: None,
) -> dict[str, Any]:
    """Run the nominal module for `ticks` ticks and return the smallest eigenvalue of P with its tick.

    The result also has the RMS error of the position in mode RUN, in mm, the last mode, the faults, and the
    compute time in s. `passed` means that P stayed positive definite.
    """
    cell = cells_of(CONDITIONS, {}, settings)[0][0]
    commands = [Command(0.0, Request.IDLE, 0.0), Command(0.5, Request.RUN, cell.ratio, cell.impulse_n_s)]
    duration_s = ticks * config_from(cell.firmware).tick_s
    scenario = scenario_of("endurance", cell.scene, cell.firmware, commands, duration_s, seed)
    started_s = time.process_time()
    least: list[tuple[float, int]] = []
    faults: set[int] = set()
    squares, judged, tick, mode = 0.0, 0, 0, Mode.INIT.value
    for records in records_of(scenario, seed, columns_of(SIGNALS), build):
        progress(tick / ticks, "running")
        known = records.firmware
        p = np.stack([known[name] for name in COVARIANCE], axis=-1).reshape(-1, 3, 3)
        eigenvalues = np.where(known["state.estimator.started"], np.linalg.eigvalsh(p)[:, 0], math.inf)
        place = int(np.argmin(eigenvalues))
        least.append((float(eigenvalues[place]), tick + place))
        runs = known["outputs.mode"] == Mode.RUN
        squares += float(np.sum((known["state.estimator.x_m"] - records.plant[:, TRUE_X])[runs] ** 2))
        judged += int(np.count_nonzero(runs))
        mode = int(known["outputs.mode"][-1])
        faults |= set(known["outputs.fault"].tolist())
        tick += len(known)
    smallest, at_tick = least[int(np.argmin([value for value, _ in least]))]
    compute_s = time.process_time() - started_s
    return {
        "ticks": ticks,
        "smallest_eigenvalue": smallest,
        "at_tick": at_tick,
        "x_rmse_mm": 1e3 * math.sqrt(squares / judged) if judged else None,
        "mode": Mode(mode).name.lower(),
        "faults": [Fault(fault).name.lower() for fault in sorted(faults) if fault],
        "compute_s": compute_s,
        "realtime_factor": scenario.duration_s / compute_s,
        "passed": smallest > 0.0,
    }
