"""Effect of the control rate and of the firmware's build: the same scenario in lockstep."""

import math
import tempfile
import time
from pathlib import Path
from typing import Any

from firmware_py.shell.builds import Build
from hil.figures.figures import figures_of
from hil.judge.evaluation import evaluate
from hil.runs.job import Job
from hil.runs.recording import in_lockstep
from hil.scenario.files import read_scenario
from hil.scenario.scenario import Scenario, check_scenario
from tools.trade.costs import Progress

SCENARIO = "soft-start-multistable"
RATES_HZ = (250, 500, 1000, 2000, 4000)
QUICK_RATES_HZ = (500, 1000)
RATE_HZ = 1000
BUILDS: tuple[Build, ...] = ("python", "compiled")

REPEATS = 2
HOLD_UNTIL_S, UNTIL_S = 14.0, 16.0
"""End of the hold and of the run, s; a start of 5 s and a hold of 8 s are enough for the figures."""

UNIT = "m (RMS of the estimated position); µs of processor per simulated second"


def measure(quick: bool, progress: Progress) -> list[dict[str, Any]]:
    """Run the scenario at each control rate, and on each build of the firmware; return a row for each."""
    rows = []
    for rate_hz in QUICK_RATES_HZ if quick else RATES_HZ:
        progress(f"control at {rate_hz} Hz")
        rows.append(
            {"what": f"control rate: {rate_hz} Hz", "kind": "control rate", **row(rate_hz, "compiled")}
        )
    for build in BUILDS:
        progress(f"firmware build: {build}")
        rows.append({"what": f"firmware build: {build}", "kind": "firmware build", **row(RATE_HZ, build)})
    return rows


def short_start(rate_hz: int = RATE_HZ) -> Scenario:
    """Return the scenario with a start and a short hold at this control rate."""
    document = read_scenario(SCENARIO)
    document["firmware"] = {**document["firmware"], "control.tick_s": 1.0 / rate_hz}
    document["script"]["duration_s"] = UNTIL_S
    document["script"]["commands"][-1]["at_s"] = HOLD_UNTIL_S
    return check_scenario(document, SCENARIO)


def row(rate_hz: int, build: Build) -> dict[str, Any]:
    """Run the scenario in lockstep; return its figures and its least processor time of some repeats.

    The first run in a process compiles or loads what runs the loop.
    """
    scenario = short_start(rate_hz)
    times_us = []
    for _ in range(REPEATS):
        with tempfile.TemporaryDirectory() as folder:
            begun = time.thread_time_ns()
            run_dir = in_lockstep(Job(scenario, 1, build, Path(folder) / "run"))
            times_us.append((time.thread_time_ns() - begun) * 1e-3)
            figures = figures_of(run_dir)
    error_m, v_error_m_s = figures.estimate.x_rmse_m, figures.estimate.v_rmse_m_s
    return {
        "rate_hz": rate_hz,
        "build": build,
        "error": math.nan if error_m is None else error_m,
        "v_rmse_m_s": math.nan if v_error_m_s is None else v_error_m_s,
        "cost": min(times_us) / UNTIL_S,
        "unit": UNIT,
        "latency_p95_ms": figures.detector.latency_ms.p95,
        "speed_error": figures.speed.error,
        "ripple": figures.speed.ripple,
        "approach_m_s": figures.impact_v_m_s,
        "regime": figures.regime,
        "failed_checks": [one.name for one in evaluate(scenario.checks, figures) if not one.passed],
    }
