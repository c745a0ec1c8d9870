"""Every parameter that the blocks read themselves: it alone changes, and the run shows it.

Derived constants are compared in `tests/firmware_py/node/test_parameter_effects.py`. A few decide what
no scenario reaches: those decisions are called alone.
"""

import math
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from firmware_py.core.config import Config
from firmware_py.core.control import hold, start
from firmware_py.core.gait import gait_lock, stride_harmonic
from firmware_py.core.measurements import model_sensors
from firmware_py.core.request import Request
from firmware_py.core.safety.drive_link import DriveFrame
from firmware_py.interface.enums import ParameterTier, Refusal
from firmware_py.interface.parameter_table import TABLE
from firmware_py.node import transmitter
from firmware_py.shell.parameters import config_from
from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.scenario import load_scenario

DWELLING = start.INITIAL._replace(stage=start.DWELL, hits=3)
LONG_MET = stride_harmonic.INITIAL._replace(turns=1000, harmonic=1, impulse_n_s=0.9)
STRIDE_S = 20.0 * math.pi / config_from({}).nominal.natural_rad_s
WEAKER = Request(1.1, 0.5, False, 0.0, 0.0, Refusal.NONE, Refusal.NONE)
OUTPUTS = ("torque_n_m", "mode", "fault", "refusal", "impact_speed_m_s")
HELD, JAMMED, QUICK = (
    "an-impulse-asked-for-is-held",
    "a-jammed-crank-is-let-go-of",
    "a-fifth-more-strides-keep-the-impacts",
)
SHOWN_BY: dict[str, dict[str, float]] = {
    "an-impulse-asked-for-is-held": {
        "striker.rest_length_m": 0.132,
        "stop.position_m": 0.198,
        "crank.zero_rad": 1.0,
        "sensor.housing_weight": 0.9,
        "estimator.model_std_m_s2": 0.0176,
        "estimator.velocity_noise_m_s": 3.3e-05,
        "estimator.stop_std_m": 0.00033,
        "estimator.touch_down_jitter_s": 0.000275,
        "estimator.restitution_std": 0.11,
        "estimator.initial_model_std_m_s2": 0.132,
        "wiring.torque_reversed": 1.0,
        "wiring.striker_reversed": 1.0,
        "wiring.low_exchanged": 1.0,
        "detector.floor_m_s2": 1.65,
        "start.rise_s": 1.1,
        "start.stop_s": 1.1,
        "start.confirm_periods": 6.0,
        "start.approach_ratio": 0.88,
        "start.approach_s": 0.66,
        "motor.viscous_n_m_s": 0.00011,
        "motor.dry_n_m": 0.0055,
        "speed.gain_p_n_m_s": 0.055,
        "speed.gain_i_n_m": 0.88,
        "speed.load_share": 1.1,
        "limit.standstill_rad_s": 0.33,
        "watchdog.proof_required": 1.0,
        "hold.impulse_slope_n_s": 2.2,
        "hold.largest_step": 0.0165,
        "hold.rate_1_s": 0.033,
        "start.lowest_ratio": 1.2,
        "start.highest_ratio": 1.05,
        "hold.lowest_impulse_n_s": 1.0,
        "hold.highest_impulse_n_s": 0.8,
    },
    "a-start-against-friction-ends-in-a-refusal": {
        "estimator.largest_model_std_m_s2": 0.275,
        "start.dip_ratio": 1.155,
        "start.again_s": 2.2,
        "start.missing_periods": 4.0,
        "start.retreat_ratio": 0.033,
    },
    "impacts-lost-to-friction-end-the-run": {
        "start.lost_periods": 3.0,
        "start.attempts": 0.0,
    },
    "a-stumble-ends-the-pulses": {
        "estimator.gate_sigmas": 5.4,
        "speed.torque_rate_n_m_s": 66.0,
        "gait.lowest_ratio": 1.078,
        "gait.highest_ratio": 1.17,
        "gait.window_start": 0.495,
        "gait.window_end": 0.66,
        "gait.gain_1_s": 2.2,
        "gait.largest_trim": 0.165,
        "gait.rate_1_s": 0.33,
        "gait.surprise": 0.3,
        "gait.surprise_spread": 20.0,
        "gait.overdue": 0.02,
        "spin_down.share": 0.3,
        "spin_down.gain": 0.0,
    },
    "an-impulse-asked-for-on-a-slow-walk-takes-fewer-turns": {
        "limit.drive_speed_rad_s": 36.0,
        "gait.centre_ratio": 0.981,
        "gait.gain_learning": 0.055,
    },
    "an-estimate-too-wide-stops-the-motor": {
        "limit.position_std_m": 0.00055,
    },
    "a-walker-who-stops-gets-no-more-pulses": {
        "gait.still_s": 0.22,
    },
    "a-fifth-more-strides-keep-the-impacts": {
        "gait.lowest_confidence": 1.0,
    },
    "soft-start-multistable": {
        "start.free_ratio": 1.2,
    },
    "at-r-0.6-it-never-reaches-the-stop": {
        "start.capture_ratio": 0.5,
    },
}
"""Other values of parameters, by the scenario whose run they change."""
SHOWN_WITH: list[tuple[str, tuple[str, ...], str, float]] = [
    (HELD, ("script.commands.0.target_impulse_n_s=1.45",), "hold.refusing_periods", 3.0),
    ("soft-start-multistable", ("script.commands.0.target_ratio=1.42",), "hold.gain_phase", 0.4),
    ("soft-start-multistable", ("script.commands.0.target_ratio=1.42",), "hold.highest_phase_deg", 50.0),
    (
        JAMMED,
        ("firmware.speed.gain_p_n_m_s=0.002", "firmware.speed.gain_i_n_m=0.0"),
        "limit.stall_share",
        0.9,
    ),
    (QUICK, ("firmware.gait.highest_ratio=1.1",), "gait.margin", 0.05),
]
"""The same in changed scenarios."""
RARE: list[tuple[str, float, Callable[[Config], Any]]] = [
    ("estimator.coarse_std_m", 0.004, lambda config: model_sensors(config.p.estimator)),
    ("start.dwell_periods", 5.0, lambda config: start.lead_to_rise(config.p, DWELLING, 12.0)),
    ("hold.lowest_ratio", 1.2, lambda config: hold.find_bound(config.p, 1.1, False, WEAKER, 0.6)),
    ("gait.hysteresis", 0.5, lambda config: gait_lock.choose_turns(config.gait, STRIDE_S, 13, 0.0)),
    ("gait.impulse_tolerance", 0.05, lambda config: stride_harmonic.find_unmet(config.gait, LONG_MET, 1.0)),
    (
        "speed.current_limit_a",
        9.0,
        lambda config: transmitter.pack_drive_frame(config, DriveFrame.LIMITS, 0.0),
    ),
]
"""Decisions that no scenario reaches: another value, and the function that decides."""
CASES = [
    (name, (), key, value) for name, keys in SHOWN_BY.items() for key, value in keys.items()
] + SHOWN_WITH


@cache
def outputs_of(name: str, settings: tuple[str, ...]) -> bytes:
    """What the firmware commands and reports in a run."""
    kept = {"firmware": [f"outputs.{one}" for one in OUTPUTS]}
    done = segments(Job(load_scenario(name, settings), 1, kept=kept))
    return b"".join(segment.rows["firmware"].tobytes() for segment in done)


@pytest.mark.parametrize(("parameter", "value", "decide"), RARE, ids=[case[0] for case in RARE])
def test_the_parameter_alone_changes_the_decision(
    parameter: str, value: float, decide: Callable[[Config], Any]
) -> None:
    assert decide(config_from({parameter: value})) != decide(config_from({}))


@pytest.mark.parametrize(("name", "settings", "parameter", "value"), CASES, ids=[case[2] for case in CASES])
def test_the_parameter_alone_changes_the_run(
    name: str, settings: tuple[str, ...], parameter: str, value: float
) -> None:
    assert outputs_of(name, (*settings, f"firmware.{parameter}={value!r}")) != outputs_of(name, settings)


def test_every_parameter_has_its_test() -> None:
    """A ceiling refuses, a node number moves identifiers, and the rest has derived constants, or a run."""
    derived = Path("tests/firmware_py/node/test_parameter_effects.py").read_text("utf-8")
    shown = {parameter for _, _, parameter, _ in CASES} | {parameter for parameter, _, _ in RARE}
    for one in TABLE:
        is_bound = one.table in ("ceiling", "bus") and one.tier is ParameterTier.BUILD
        assert one.name in shown or is_bound or f'"{one.name}": ' in derived or one.name == "control.tick_s"
