"""The core's state and outputs, composed of the records of its blocks."""

from typing import NamedTuple

from firmware_py.core.control import hold, speed, spin_down, start
from firmware_py.core.estimation import crank, detector, estimator_state, regime
from firmware_py.core.gait import gait, gait_lock, stride_harmonic
from firmware_py.core.safety import consent, drive_link, gate, monitors, own_crank, supervisor, watchdog_proof
from firmware_py.interface.enums import ActingLimit, Fault, Mode, Refusal, Regime
from firmware_py.interface.zeroed import zeroed


class State(NamedTuple):
    """The core's state, from one tick to the next; `gate` is the part of the tick around it."""

    crank: crank.CrankState
    own_crank: own_crank.OwnCrank
    estimator: estimator_state.EstimatorState
    detector: detector.DetectorState
    regime: regime.RegimeState
    start: start.StartState
    hold: hold.HoldState
    speed: speed.SpeedState
    gate: gate.GateState
    monitors: monitors.MonitorState
    consent: consent.ConsentState
    supervisor: supervisor.SupervisorState
    drive_link: drive_link.DriveLinkState
    proof: watchdog_proof.ProofState
    gait: gait.CycleState
    gait_lock: gait_lock.LockState
    stride_harmonic: stride_harmonic.StrideHarmonicState
    spin_down: spin_down.SpinDownState


class Outputs(NamedTuple):
    """The core's outputs. `withholds`: no frame may be sent to the drive, whose watchdog is tested.

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
    withholds: bool
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
    own_crank=own_crank.INITIAL,
    estimator=estimator_state.INITIAL,
    detector=detector.INITIAL,
    regime=regime.INITIAL,
    start=start.INITIAL,
    hold=hold.INITIAL,
    speed=speed.INITIAL,
    gate=gate.INITIAL,
    monitors=monitors.INITIAL,
    consent=consent.INITIAL,
    supervisor=supervisor.INITIAL,
    drive_link=drive_link.INITIAL,
    proof=watchdog_proof.INITIAL,
    gait=gait.INITIAL,
    gait_lock=gait_lock.INITIAL,
    stride_harmonic=stride_harmonic.INITIAL,
    spin_down=spin_down.INITIAL,
)


INITIAL_OUTPUTS = zeroed(
    Outputs,
    mode=Mode.INIT,
    fault=Fault.NONE,
    refusal=Refusal.NONE,
    regime=Regime.UNCERTAIN,
    acting_limit=ActingLimit.SAFE_STATE,
    drive_frame=drive_link.NO_DRIVE_FRAME,
)
