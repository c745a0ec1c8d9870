"""The tables of a scene's sensors, as users write them."""

from pydantic import Field

from plant_sim.sensors.sampled import SampledTables
from plant_sim.tables.quantities import (
    Acceleration,
    Angle,
    AngularSpeed,
    Duration,
    Frequency,
    NoiseDensity,
    Number,
)
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2, Table


class AccelerometerTable(Table):
    """One accelerometer: low-pass, then noise and bias, then clip, then quantise."""

    range_m_s2: Acceleration = Field(gt=0.0, description="the reading in m/s² beyond which it clips")
    count_m_s2: Acceleration = Field(gt=0.0, description="one count of the reading in m/s²")
    noise_m_s2_rthz: NoiseDensity = Field(ge=0.0, description="the noise density in m/s²/√Hz")
    bias_m_s2: Acceleration = Field(description="the reading at rest in m/s²")
    # Below half the 1 kHz sample rate; 0.56 ms of delay.
    bandwidth_hz: Frequency = Field(
        default=400.0, gt=0.0, description="the low-pass's corner frequency in Hz"
    )


class LowRangeTable(AccelerometerTable):
    """±16 g, low noise (ICM-42688-P class)."""

    range_m_s2: Acceleration = Field(
        default=16.0 * STANDARD_GRAVITY_M_S2, gt=0.0, description="the range in m/s²"
    )
    # 16 bits over ±16 g: 2048 counts per g.
    count_m_s2: Acceleration = Field(
        default=STANDARD_GRAVITY_M_S2 / 2048.0, gt=0.0, description="one count in m/s²"
    )
    # 70 µg/√Hz.
    noise_m_s2_rthz: NoiseDensity = Field(
        default=70e-6 * STANDARD_GRAVITY_M_S2, ge=0.0, description="the noise density in m/s²/√Hz"
    )
    # The ±20 mg of its data sheet.
    bias_m_s2: Acceleration = Field(
        default=0.02 * STANDARD_GRAVITY_M_S2, description="the reading at rest in m/s²"
    )


class HighRangeTable(AccelerometerTable):
    """±200 g (ADXL375 class): the impacts at a default stop (32 g) do not clip."""

    range_m_s2: Acceleration = Field(
        default=200.0 * STANDARD_GRAVITY_M_S2, gt=0.0, description="the range in m/s²"
    )
    # 49 mg per count.
    count_m_s2: Acceleration = Field(
        default=0.049 * STANDARD_GRAVITY_M_S2, gt=0.0, description="one count in m/s²"
    )
    # 5 mg/√Hz.
    noise_m_s2_rthz: NoiseDensity = Field(
        default=5e-3 * STANDARD_GRAVITY_M_S2, ge=0.0, description="the noise density in m/s²/√Hz"
    )
    # Half of the ±400 mg of its data sheet.
    bias_m_s2: Acceleration = Field(
        default=-0.2 * STANDARD_GRAVITY_M_S2, description="the reading at rest in m/s²"
    )


class HousingTable(LowRangeTable):
    """±16 g on the housing."""

    # Another specimen of the same type: half its data sheet's ±20 mg, of the other sign.
    bias_m_s2: Acceleration = Field(
        default=-0.01 * STANDARD_GRAVITY_M_S2, description="the reading at rest in m/s²"
    )


class EncoderTable(Table):
    """The drive's encoder and its speed estimate."""

    # 14 bits: a magnetic absolute encoder on the shaft.
    counts: int = Field(default=16384, ge=1, description="the number of counts per revolution")
    # The drive's default tracking bandwidth.
    bandwidth_rad_s: AngularSpeed = Field(
        default=1000.0, gt=0.0, description="the bandwidth of the speed estimate in rad/s"
    )
    # One count is 0.38 mrad; a tracking loop of 1000 rad/s at 8 kHz leaves about this much of its rounding.
    noise_rad_s: AngularSpeed = Field(
        default=0.02, ge=0.0, description="the speed estimate's noise in rad/s, rms"
    )


class GaitSensorsTable(Table):
    """[sensors.gait]: an IMU on the shank and switches under heel and toe, where the scene has a [gait]."""

    # 0.004 °/s/√Hz over 100 Hz is 0.7 mrad/s; soft tissue under the strap adds several times that.
    rate_noise_rad_s: AngularSpeed = Field(default=0.01, ge=0.0, description="the rate's noise in rad/s, rms")
    # ±0.5 °/s of a gyroscope that has been zeroed once.
    rate_bias_rad_s: AngularSpeed = Field(default=0.01, description="the rate's reading at rest in rad/s")
    along_noise_m_s2: Acceleration = Field(
        default=0.1, ge=0.0, description="the specific force's noise in m/s², rms"
    )
    # The ±20 mg of the module's own accelerometers.
    along_bias_m_s2: Acceleration = Field(
        default=0.02 * STANDARD_GRAVITY_M_S2, description="the specific force's bias in m/s²"
    )
    # 3° and 6°: straps on a calf.
    tilt_rad: Angle = Field(default=0.05, description="the forward tilt of the IMU on the shank in rad")
    twist_rad: Angle = Field(default=0.1, description="the rotation of the IMU about the shank in rad")
    # Force-sensing resistors close at some 5 to 10 % of body weight.
    heel_threshold: Number = Field(
        default=0.1,
        gt=0.0,
        lt=0.5,
        description="the load that closes the heel switch, as a share of the largest load",
    )
    toe_threshold: Number = Field(
        default=0.1,
        gt=0.0,
        lt=0.5,
        description="the load that closes the toe switch, as a share of the largest load",
    )
    bounce_s: Duration = Field(default=0.008, ge=0.0, description="the duration of a switch's bounce in s")
    dropout_share: Number = Field(
        default=0.0, ge=0.0, lt=1.0, description="the share of frames that drop out"
    )
    # With one frame between two drop-outs, a share of 0.9 takes drop-outs of nine frames.
    dropout_s: Duration = Field(
        default=0.02,
        ge=0.0,
        description="the mean duration of a drop-out in s; longer where dropout_share needs it",
    )


class SensorsTable(SampledTables):
    """The sensors that the firmware reads."""

    striker_low: LowRangeTable = LowRangeTable()
    striker_high: HighRangeTable = HighRangeTable()
    housing: HousingTable = HousingTable()
    encoder: EncoderTable = EncoderTable()
    gait: GaitSensorsTable = GaitSensorsTable()
    # A Newton jump is no acceleration; the striker's accelerometers see a half-sine of this length instead,
    # as long as the default soft stop's elastic contact.
    rigid_contact_s: Duration = Field(
        default=0.01, gt=0.0, description="the duration in s of the half-sine read at a rigid stop"
    )
