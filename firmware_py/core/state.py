"""The core's config, state and outputs, composed of the records of its blocks."""

from typing import NamedTuple

from firmware_py.core.control import gait, gait_lock, hold, speed, spin_down, start, stride_harmonic
from firmware_py.core.estimation import crank, detector, estimator_state, identify, regime
from firmware_py.core.records import zeroed
from firmware_py.core.safety import drive_link, monitors, supervisor
from firmware_py.interface.enums import (
    INIT,
    NO_FAULT,
    NO_REFUSAL,
    ActingLimit,
    Fault,
    Mode,
    Refusal,
    Regime,
)


class Config(NamedTuple):
    """The core's configuration; it changes only when parameters are written, between two ticks."""

    tick_s: float
    drive_link: drive_link.DriveLinkConfig
    crank: crank.CrankConfig
    estimator: estimator_state.EstimatorConfig
    detector: detector.DetectorConfig
    start: start.StartConfig
    hold: hold.HoldConfig
    speed: speed.SpeedConfig
    monitors: monitors.MonitorConfig
    gait: gait.GaitConfig
    gait_lock: gait_lock.LockConfig
    stride_harmonic: stride_harmonic.StrideHarmonicConfig
    identify: identify.IdentifyConfig
    spin_down: spin_down.SpinDownConfig


class State(NamedTuple):
    """The core's state, from one tick to the next."""

    crank: crank.CrankState
    estimator: estimator_state.EstimatorState
    detector: detector.DetectorState
    regime: regime.RegimeState
    start: start.StartState
    hold: hold.HoldState
    speed: speed.SpeedState
    monitors: monitors.MonitorState
    supervisor: supervisor.SupervisorState
    drive_link: drive_link.DriveLinkState
    gait: gait.CycleState
    gait_lock: gait_lock.LockState
    stride_harmonic: stride_harmonic.StrideHarmonicState
    identify: identify.IdentifyState
    spin_down: spin_down.SpinDownState


class Outputs(NamedTuple):
    """The core's outputs.

    `impact` marks the tick in which a touch-down is detected. The touch-down lies `impact_age_s` before the
    sensors' time, at the speed `impact_speed_m_s`; `impact_impulse_n_s` is the expected impulse until
    `separation`, the tick in which the striker leaves the stop, and the measured impulse from then on. The
    age grows until the separation.
    """

    mode: Mode
    fault: Fault
    disarm_reason: int
    refusal: Refusal
    regime: Regime
    acting_limit: ActingLimit
    torque_n_m: float
    target_omega_rad_s: float
    drive_frame: drive_link.DriveFrame
    impact: bool
    separation: bool
    impact_age_s: float
    impact_speed_m_s: float
    impact_impulse_n_s: float
    period_ended: bool
    period_impacts: int
    impact_phase_rad: float
    peak_acceleration_m_s2: float


INITIAL = State(
    crank=crank.INITIAL,
    estimator=estimator_state.INITIAL,
    detector=detector.INITIAL,
    regime=regime.INITIAL,
    start=start.INITIAL,
    hold=hold.INITIAL,
    speed=speed.INITIAL,
    monitors=monitors.INITIAL,
    supervisor=supervisor.INITIAL,
    drive_link=drive_link.INITIAL,
    gait=gait.INITIAL,
    gait_lock=gait_lock.INITIAL,
    stride_harmonic=stride_harmonic.INITIAL,
    identify=identify.INITIAL,
    spin_down=spin_down.INITIAL,
)


INITIAL_OUTPUTS = zeroed(
    Outputs,
    mode=INIT,
    fault=NO_FAULT,
    refusal=NO_REFUSAL,
    regime=Regime.UNCERTAIN,
    acting_limit=ActingLimit.SAFE_STATE,
    drive_frame=drive_link.NO_DRIVE_FRAME,
)
