"""The sensors' numbers, as plain records."""

from typing import NamedTuple


class AccelerometerModel(NamedTuple):
    """One accelerometer's numbers; noise is a one-sided density."""

    range_m_s2: float
    count_m_s2: float
    noise_m_s2_rthz: float
    bias_m_s2: float
    bandwidth_hz: float


class EncoderModel(NamedTuple):
    """The drive's encoder: counts per revolution, and its speed estimate's bandwidth and noise (rms)."""

    counts: int
    bandwidth_rad_s: float
    noise_rad_s: float


class GaitSensorModel(NamedTuple):
    """IMU on the shank and switches under the foot; noise is each sample's deviation."""

    rate_noise_rad_s: float
    rate_bias_rad_s: float
    along_noise_m_s2: float
    along_bias_m_s2: float
    tilt_rad: float
    twist_rad: float
    heel_threshold: float
    toe_threshold: float
    bounce_s: float
    dropout_share: float
    dropout_s: float


class SensorModels(NamedTuple):
    """All sensors of a scene."""

    striker_low: AccelerometerModel
    striker_high: AccelerometerModel
    housing: AccelerometerModel
    encoder: EncoderModel
    rigid_contact_s: float
