"""Wiring: the module's channels and directions, translated where frames enter and leave the firmware.

The other blocks know only the directions of the model: positive towards the stop, and a positive torque that
turns the encoder forward. An encoder that counts backward needs no parameter of its own: a crank that turns
the other way obeys the same equations, with `crank.zero_rad` half a turn on and the torque reversed. Nor has
an exchanged high range one: in the frame of a low range its impacts would be clipped, so its plug is moved.
"""

from firmware_py.core.config import Config
from firmware_py.interface.generated.records import Accelerometer


def wired_sample(config: Config, sample: Accelerometer) -> Accelerometer:
    """The accelerometers' sample with its channels in order, the striker's positive towards the stop."""
    wiring = config.p.wiring
    is_exchanged = wiring.low_exchanged == 1
    low = sample.housing_m_s2 if is_exchanged else sample.striker_low_m_s2
    high = sample.striker_high_m_s2
    housing = sample.striker_low_m_s2 if is_exchanged else sample.housing_m_s2
    return (
        Accelerometer(-low, -high, housing)
        if wiring.striker_reversed == 1
        else Accelerometer(low, high, housing)
    )


def wired_torque_n_m(config: Config, torque_n_m: float) -> float:
    """The torque for the drive's direction."""
    return -torque_n_m if config.p.wiring.torque_reversed == 1 else torque_n_m
