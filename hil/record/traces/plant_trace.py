"""The plant's trace: a record per tick; the trace of the impacts holds `plant_sim.result.Impact`."""

from typing import NamedTuple

from plant_sim.result import Phase


class PlantRecord(NamedTuple):
    """The truth at t_k (`Observation`), the torque requested from t_k on, the drive, published readings."""

    tick: int
    t_s: float
    x_m: float
    v_m_s: float
    accel_m_s2: float
    crank_rad: float
    omega_rad_s: float
    motor_torque_n_m: float
    current_a: float
    stop_force_n: float
    felt_force_n: float
    drive_work_j: float
    stored_j: float
    friction_j: float
    impact_loss_j: float
    housing_work_j: float
    ankle_j: float
    phase: Phase
    torque_command_n_m: float
    axis_state: int
    axis_error: int
    striker_low_m_s2: float
    striker_high_m_s2: float
    housing_m_s2: float
    encoder_position_rev: float
    encoder_velocity_rev_s: float
