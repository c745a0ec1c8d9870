"""Effect of the control rate: the same scenario in lockstep at 250 Hz to 4 kHz."""

import math
import tempfile
import time
from pathlib import Path
from typing import Any

from firmware_py.shell.builds import Build
from hil.bench.lockstep import in_lockstep, silent
from hil.judge.checks import evaluate
from hil.judge.figures.figures import figures_of
from hil.judge.figures.records import Figures
from hil.nodes.warm import warm_firmware, warm_plant
from hil.scenario.files import read_scenario
from hil.scenario.scenario import Scenario, check_scenario
from tools.trade.costs import Progress

SCENARIO = "soft-start-multistable"
RATES_HZ = (250, 500, 1000, 2000, 4000)
QUICK_RATES_HZ = (500, 1000)

HOLD_UNTIL_S, UNTIL_S = 14.0, 16.0
"""End of the hold and of the run, s; a start of 5 s and a hold of 8 s are enough for the figures."""

UNIT = "m (RMS of the estimated position); µs of processor per simulated second"


def measure(quick: bool, progress: Progress) -> list[dict[str, Any]]:
    """Run the scenario at each control rate and return a row for each."""
    rows = []
    for rate_hz in QUICK_RATES_HZ if quick else RATES_HZ:
        progress(f"control at {rate_hz} Hz")
        rows.append(_row(rate_hz))
    return rows


def short_start(rate_hz: int = 1000) -> Scenario:
    """Return the scenario with a start and a short hold at this control rate."""
    document = read_scenario(SCENARIO)
    document["firmware"] = {**document["firmware"], "control.tick_s": 1.0 / rate_hz}
    document["script"]["duration_s"] = UNTIL_S
    document["script"]["commands"][-1]["at_s"] = HOLD_UNTIL_S
    return check_scenario(document, SCENARIO)


def errors_of(figures: Figures) -> dict[str, float]:
    """RMS errors of the estimated position and velocity for a row; nan if there is no estimate."""
    found = {"error": figures.estimate.x_rmse_m, "v_rmse_m_s": figures.estimate.v_rmse_m_s}
    return {name: math.nan if value is None else value for name, value in found.items()}


def hold(scenario: Scenario, build: Build = "compiled") -> tuple[Figures, float]:
    """Run the scenario in lockstep; return its figures, and the processor time in µs without compiling."""
    warm_plant(scenario.scene)
    warm_firmware(scenario.parameters, build)
    with tempfile.TemporaryDirectory() as folder:
        begun = time.thread_time_ns()
        run_dir, _ = in_lockstep(scenario, Path(folder) / "run", 1, silent, build)
        spent_us = (time.thread_time_ns() - begun) * 1e-3
        return figures_of(run_dir), spent_us


def _row(rate_hz: int) -> dict[str, Any]:
    scenario = short_start(rate_hz)
    figures, spent_us = hold(scenario)
    failed = [result.name for result in evaluate(scenario.checks, figures) if not result.passed]
    return {
        "what": f"control rate: {rate_hz} Hz",
        "kind": "control rate",
        "rate_hz": rate_hz,
        **errors_of(figures),
        "cost": spent_us / UNTIL_S,
        "unit": UNIT,
        "latency_p95_ms": figures.detector.latency_ms.p95,
        "speed_error": figures.speed.error,
        "ripple": figures.speed.ripple,
        "approach_m_s": figures.impact_v_m_s,
        "regime": figures.regime,
        "failed_checks": failed,
    }
