"""Does the estimate's covariance stay positive for a day? The whole loop, compiled, and its eigenvalues."""

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from firmware_py.interface.enums import Mode
from firmware_py.shell.parameters import config_from
from hil.operator import Command, Request
from plant_sim.scene import load_scene
from tools.campaign import columns
from tools.campaign.cells import cells_of
from tools.campaign.run import UNDISTURBED, run

CONDITIONS = ((("viscous",), (1.1,), (0.0,)),)
ROOM_S = 600.0
"""What the record has room for; older entries are forgotten."""


def endurance(ticks: int, settings: Sequence[str] = (), seed: int = 1) -> dict[str, Any]:
    """Run the nominal module for `ticks` ticks; the smallest eigenvalue of P in any of them, and where."""
    cell = cells_of({"conditions": CONDITIONS}, settings)[0][0]
    config = config_from(cell.firmware)
    started_s = time.process_time()
    done = run(
        load_scene(cell.scene),
        config,
        [Command(0.0, Request.IDLE, 0.0), Command(0.5, Request.RUN, cell.ratio, cell.impulse_n_s)],
        ticks * config.tick_s,
        np.random.default_rng(seed),
        UNDISTURBED._replace(endless=True),
        room_s=min(ticks * config.tick_s, ROOM_S),
    )
    compute_s = time.process_time() - started_s
    sums = done.sums
    judged = sums[columns.SUM_TICKS]
    return {
        "ticks": ticks,
        "smallest_eigenvalue": float(sums[columns.LEAST_EIGENVALUE]),
        "at_tick": int(sums[columns.LEAST_AT]),
        "x_rmse_mm": 1e3 * float(np.sqrt(sums[columns.SUM_X] / judged)) if judged else None,
        "mode": done.modes[-1].mode.name.lower() if done.modes else Mode.INIT.name.lower(),
        "faults": [change.fault.name.lower() for change in done.modes if change.fault.value],
        "compute_s": compute_s,
        "realtime_factor": ticks * config.tick_s / compute_s,
        "passed": bool(sums[columns.LEAST_EIGENVALUE] > 0.0),
    }
