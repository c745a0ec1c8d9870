"""A made-up run with known answers: the striker touches the stop once a turn, at a crank angle of 0.

Ramp from 0.5 s to 2 s, hold to 6 s, stop to 6.5 s, then ready. During the hold x = stop − D |sin(θ/2)|, so
v⁻ = D Ω / 2, and the firmware sees each touch-down `LATENCY_S` later. Its estimate is off by 1 mm throughout.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from firmware_py.interface import codec
from firmware_py.interface.enums import ActingLimit, AxisState, Fault, Mode, Regime
from firmware_py.interface.generated.records import Accelerometer, SetInputTorque
from hil.record.run_traces import RunTraces
from hil.record.traces.trace import TraceWriter

STOP_M = 0.18
TRAVEL_M = 0.16
OMEGA_RAD_S = 12.16
LATENCY_S = 0.0055
START_S, HOLD_S, STOP_S, READY_S, END_S = 0.5, 2.0, 6.0, 6.5, 7.0
T_S = 1e-3
V_M_S = TRAVEL_M * OMEGA_RAD_S / 2.0

ACCELEROMETER = codec.encode(Accelerometer(1.5, 1.5, 0.0), 3).data.hex().upper()
TORQUE = codec.encode(SetInputTorque(0.1)).data.hex().upper()

Columns = dict[str, np.ndarray[Any, Any]]


def records(**columns: Any) -> np.ndarray[Any, Any]:
    """A structured array of the columns; dots in names are written as two underscores."""
    names = {name: name.replace("__", ".") for name in columns}
    arrays = {names[name]: np.asarray(values, dtype=float) for name, values in columns.items()}
    found = np.zeros(len(next(iter(arrays.values()))), [(name, float) for name in arrays])
    for name, values in arrays.items():
        found[name] = values
    return found


@dataclass
class MadeUpRun:
    """Columns of each trace by name; change them before `write`."""

    plant: Columns
    firmware: Columns
    impacts: Columns
    operator: Columns
    can_log: str
    run: dict[str, Any]
    outcome: dict[str, Any]
    scenario: dict[str, Any]


def motion(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Crank angle and speed, striker position and velocity at `t_s`."""
    ramp = np.clip((t_s - START_S) / (HOLD_S - START_S), 0.0, 1.0)
    fall = np.clip((READY_S - t_s) / (READY_S - STOP_S), 0.0, 1.0)
    omega = OMEGA_RAD_S * np.minimum(ramp, fall)
    theta = np.concatenate([[0.0], np.cumsum(0.5 * (omega[1:] + omega[:-1]) * np.diff(t_s))])
    holding = (t_s >= HOLD_S) & (t_s < STOP_S)
    half = np.sin(theta / 2.0)
    x = np.where(holding, STOP_M - TRAVEL_M * np.abs(half), 0.12 + 0.03 * np.sin(theta))
    v = np.where(
        holding,
        -TRAVEL_M * np.sign(half) * np.cos(theta / 2.0) * omega / 2.0,
        0.03 * np.cos(theta) * omega,
    )
    return theta, omega, x, v


def make_run() -> MadeUpRun:
    """The run as described above, in arrays."""
    ticks = np.arange(round(END_S / T_S))
    t_s = ticks * T_S
    theta, omega, x, v = motion(t_s)
    n = len(ticks)
    zeros = np.zeros(n)
    driving = (t_s >= START_S) & (t_s < READY_S)
    torque = np.where(driving, 0.1 * np.sin(theta) + 0.02, 0.0)

    turns = theta / (2.0 * np.pi)
    whole = np.arange(np.ceil(turns[0]), np.floor(turns[-1]) + 1)
    touch_s = np.interp(whole, turns[driving], t_s[driving])
    touch_s = touch_s[(touch_s >= HOLD_S) & (touch_s < STOP_S)]
    m = len(touch_s)

    mode = np.full(n, Mode.READY)
    mode[t_s >= START_S] = Mode.SOFT_START
    mode[t_s >= HOLD_S] = Mode.RUN
    mode[t_s >= STOP_S] = Mode.STOPPING
    mode[t_s >= READY_S] = Mode.READY
    regime = np.full(n, Regime.NON_IMPACT)
    regime[(t_s >= touch_s[2]) & (t_s < STOP_S)] = Regime.IMPACT
    firmware_t_s = t_s + T_S / 2
    detected = np.zeros(n, bool)
    detected[np.searchsorted(firmware_t_s, touch_s + LATENCY_S)] = True
    noise = np.random.default_rng(1)
    work = noise.gamma(20.0, 4.0, n)
    wake = noise.gamma(4.0, 10.0, n)
    timing = {"deadline_ns": (ticks * 1_000_000), "wake_latency_us": wake, "work_us": work}

    plant = {
        "tick": ticks,
        "t_s": t_s,
        "x_m": x,
        "v_m_s": v,
        "accel_m_s2": np.gradient(v, T_S),
        "crank_rad": np.mod(theta, 2 * np.pi),
        "omega_rad_s": omega,
        "phase": np.zeros(n, int),
        "torque_command_n_m": torque,
        "motor_torque_n_m": torque,
        "current_a": torque / 0.08,
        "stop_force_n": zeros,
        "drive_work_j": np.cumsum(torque * omega) * T_S,
        "stored_j": zeros,
        "friction_j": np.cumsum(torque * omega) * T_S * 0.6,
        "impact_loss_j": np.cumsum(torque * omega) * T_S * 0.4,
        "housing_work_j": zeros,
        "ankle_j": zeros,
        "axis_state": np.where(driving, AxisState.CLOSED_LOOP_CONTROL, AxisState.IDLE),
        "axis_error": np.zeros(n, int),
        "striker_low_m_s2": np.clip(np.gradient(v, T_S), -156.9, 156.9),
        "striker_high_m_s2": np.gradient(v, T_S),
        "housing_m_s2": zeros,
        "encoder_position_rev": np.mod(turns, 1.0),
        "encoder_velocity_rev_s": omega / (2 * np.pi),
        **{name: values.copy() for name, values in timing.items()},
        "overruns": np.zeros(n, int),
    }
    firmware = {
        "tick": ticks,
        "t_s": firmware_t_s,
        "inputs.accelerometer.striker_low_m_s2": plant["striker_low_m_s2"],
        "inputs.accelerometer.age_s": zeros,
        "state.estimator.x_m": x + 1e-3,
        "state.estimator.v_m_s": v - 0.01,
        "state.estimator.bias_m_s2": zeros + 0.05,
        "state.estimator.p_xx": zeros + 1e-6,
        "state.estimator.p_xv": zeros,
        "state.estimator.p_xb": zeros,
        "state.estimator.p_vv": zeros + 1e-4,
        "state.estimator.p_vb": zeros,
        "state.estimator.p_bb": zeros + 1e-4,
        "state.estimator.innovation_m_s2": noise.normal(0.0, 0.1, n),
        "state.estimator.innovation_std_m_s2": np.full(n, 0.1),
        "state.estimator.nis": noise.chisquare(1.0, n),
        "state.crank.angle_rad": np.mod(theta, 2 * np.pi),
        "state.crank.omega_rad_s": omega + noise.normal(0.0, 0.01, n),
        "outputs.mode": mode,
        "outputs.fault": np.full(n, Fault.NONE),
        "outputs.regime": regime,
        "outputs.torque_n_m": torque,
        "outputs.acting_limit": np.full(n, ActingLimit.NONE),
        "outputs.impact": detected,
        "outputs.impact_age_s": np.where(detected, LATENCY_S, 0.0),
        "outputs.impact_speed_m_s": np.where(detected, V_M_S + 0.02, 0.0),
        "outputs.impact_impulse_n_s": np.where(detected, 1.2 * V_M_S, 0.0),
        "outputs.target_omega_rad_s": np.where(driving, omega, 0.0),
        "counters.rejected_crc": np.zeros(n, int),
        **{name: values.copy() for name, values in timing.items()},
        "overruns": np.zeros(n, int),
    }
    impacts = {
        "t_s": touch_s,
        "v_m_s": np.full(m, V_M_S),
        "v_after_m_s": np.full(m, -V_M_S),
        "impulse_n_s": np.full(m, 2 * 0.8 * V_M_S),
        "peak_force_n": np.full(m, 250.0),
        "crank_rad": np.zeros(m),
    }
    operator = {
        "tick": ticks[::10],
        "t_s": t_s[::10],
        "request": np.where((t_s[::10] >= START_S) & (t_s[::10] < STOP_S), 1, 0),
        "target_ratio": np.full(n // 10, 1.3),
        "estop": np.zeros(n // 10, bool),
    }
    lines = [f"({t:.6f}) vcan0 028#{ACCELEROMETER}\n({t + 5e-4:.6f}) vcan0 00E#{TORQUE}\n" for t in t_s]
    return MadeUpRun(
        plant=plant,
        firmware=firmware,
        impacts=impacts,
        operator=operator,
        can_log="".join(lines),
        run={
            "scenario": "made-up",
            "clock": "real",
            "bus": "local",
            "kernel_can": False,
            "counts_losses": True,
            "seed": 1,
            "wall_start_s": 1000.0,
            "period_s": T_S,
            "versions": {"vibrohil": "0.1.0"},
        },
        outcome={"baseline_overruns": 2, "wall_s": 7.0, "reasons": []},
        scenario={
            "title": "A made-up run",
            "scene": {"stop": {"law": "hunt-crossley", "position_m": STOP_M}, "drive": {"amplitude_m": 0.02}},
            "checks": [
                {"name": "regime", "equals": "impact"},
                {"name": "detector.recall", "low": 0.9, "unit": ""},
            ],
        },
    )


def write_trace(path: Path, columns: Mapping[str, np.ndarray]) -> None:
    kinds = {"f": float, "i": int, "u": int, "b": bool}
    values = {name: np.asarray(column) for name, column in columns.items()}
    fields = [(name, kinds[column.dtype.kind]) for name, column in values.items()]
    with TraceWriter(path, fields) as writer:
        for row in zip(*(column.tolist() for column in values.values()), strict=True):
            writer.append(*row)


def traces_of(made_up: MadeUpRun) -> RunTraces:
    """`made_up` as the judge reads it, without frames."""
    tables = {
        name: records(**getattr(made_up, name)) for name in ("plant", "firmware", "impacts", "operator")
    }
    return RunTraces(**tables, run=made_up.run, outcome=made_up.outcome, scenario=made_up.scenario)


def write_run(made_up: MadeUpRun, run_dir: Path) -> Path:
    """`made_up` as a run folder."""
    run_dir.mkdir(parents=True, exist_ok=True)
    for name in ("plant", "firmware", "impacts", "operator"):
        write_trace(run_dir / f"{name}.trace", getattr(made_up, name))
    (run_dir / "can.log").write_text(made_up.can_log)
    (run_dir / "run.json").write_text(json.dumps(made_up.run))
    (run_dir / "outcome.json").write_text(json.dumps(made_up.outcome))
    (run_dir / "scenario.toml").write_text(tomli_w.dumps(made_up.scenario))
    return run_dir
