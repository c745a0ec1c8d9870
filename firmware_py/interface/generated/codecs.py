"""The codec of every frame: written by `generate.py` out of `vibro.dbc`; do not edit."""

from firmware_py.interface.frame_codec import codec_of
from firmware_py.interface.generated import packing, records, unpacking

DRIVE_HEARTBEAT = codec_of(
    records.DriveHeartbeat, packing.pack_drive_heartbeat, unpacking.unpack_drive_heartbeat
)
DRIVE_ESTOP = codec_of(records.DriveEstop, packing.pack_drive_estop, unpacking.unpack_drive_estop)
DRIVE_ERRORS = codec_of(records.DriveErrors, packing.pack_drive_errors, unpacking.unpack_drive_errors)
SET_AXIS_STATE = codec_of(records.SetAxisState, packing.pack_set_axis_state, unpacking.unpack_set_axis_state)
ENCODER_ESTIMATES = codec_of(
    records.EncoderEstimates, packing.pack_encoder_estimates, unpacking.unpack_encoder_estimates
)
SET_CONTROLLER_MODE = codec_of(
    records.SetControllerMode, packing.pack_set_controller_mode, unpacking.unpack_set_controller_mode
)
SET_INPUT_VELOCITY = codec_of(
    records.SetInputVelocity, packing.pack_set_input_velocity, unpacking.unpack_set_input_velocity
)
SET_INPUT_TORQUE = codec_of(
    records.SetInputTorque, packing.pack_set_input_torque, unpacking.unpack_set_input_torque
)
SET_LIMITS = codec_of(records.SetLimits, packing.pack_set_limits, unpacking.unpack_set_limits)
DRIVE_CURRENT = codec_of(records.DriveCurrent, packing.pack_drive_current, unpacking.unpack_drive_current)
DRIVE_TEMPERATURE = codec_of(
    records.DriveTemperature, packing.pack_drive_temperature, unpacking.unpack_drive_temperature
)
DRIVE_SUPPLY = codec_of(records.DriveSupply, packing.pack_drive_supply, unpacking.unpack_drive_supply)
CLEAR_ERRORS = codec_of(records.ClearErrors, packing.pack_clear_errors, unpacking.unpack_clear_errors)
SET_ABSOLUTE_POSITION = codec_of(
    records.SetAbsolutePosition, packing.pack_set_absolute_position, unpacking.unpack_set_absolute_position
)
ACCELEROMETER = codec_of(records.Accelerometer, packing.pack_accelerometer, unpacking.unpack_accelerometer)
COARSE_POSITION = codec_of(
    records.CoarsePosition, packing.pack_coarse_position, unpacking.unpack_coarse_position
)
GAIT_SENSORS = codec_of(records.GaitSensors, packing.pack_gait_sensors, unpacking.unpack_gait_sensors)
OPERATOR_COMMAND = codec_of(
    records.OperatorCommand, packing.pack_operator_command, unpacking.unpack_operator_command
)
PARAMETER_REQUEST = codec_of(
    records.ParameterRequest, packing.pack_parameter_request, unpacking.unpack_parameter_request
)
FIRMWARE_HEARTBEAT = codec_of(
    records.FirmwareHeartbeat, packing.pack_firmware_heartbeat, unpacking.unpack_firmware_heartbeat
)
STRIKER_ESTIMATE = codec_of(
    records.StrikerEstimate, packing.pack_striker_estimate, unpacking.unpack_striker_estimate
)
REGIME_REPORT = codec_of(records.RegimeReport, packing.pack_regime_report, unpacking.unpack_regime_report)
IMPACT_EVENT = codec_of(records.ImpactEvent, packing.pack_impact_event, unpacking.unpack_impact_event)
FAULT_EVENT = codec_of(records.FaultEvent, packing.pack_fault_event, unpacking.unpack_fault_event)
PARAMETER_VALUE = codec_of(
    records.ParameterValue, packing.pack_parameter_value, unpacking.unpack_parameter_value
)
GAIT_REPORT = codec_of(records.GaitReport, packing.pack_gait_report, unpacking.unpack_gait_report)
