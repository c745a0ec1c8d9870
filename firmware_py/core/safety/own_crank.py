"""The crank as the monitors see it: from the encoder's positions, the torque sent and the raw accelerometer.

The monitors share the algorithm of `estimation.crank`, but neither its state nor its tuning: bandwidth and
largest disturbance are fixed in the build, and the striker's load comes from no estimate. The accelerometer
reads the forces of spring and friction alone, m z = c (A sin θ + l0 − x) − b x' + F_stop, so in flight

    T_crank = m z A cos θ

without the small friction. During a contact the last reading before it counts. A soft contact is seen some
readings after it has begun, so the flight follows a reading no faster than the spring can change it. The load
explains no more than a share of the largest torque: a jam under the largest torque is found whatever the
accelerometer reads.
"""

from typing import NamedTuple

from firmware_py.core.elementary import sine_cosine
from firmware_py.core.estimation import crank
from firmware_py.core.estimation.crank import CrankState, Turned
from firmware_py.core.inputs import AccelerometerInput
from firmware_py.core.numbers import clamp
from firmware_py.core.safety.gate_limits import GateLimits
from firmware_py.interface.generated.parameters import Parameters

BANDWIDTH_RAD_S = 200.0
"""Triple pole of the tracker: a lost torque is found within 20 ms, and the speed has 0.1 % noise."""
LARGEST_SHARE = 4.0 / 3.0
"""Largest disturbance, as a share of the largest torque: five times the monitor's limit."""
LOAD_SHARE = 0.7
"""Largest load that explains an acceleration, as a share of the largest torque; the monitor's own share and
this one together are less than the whole."""


class Constants(NamedTuple):
    """`crank`: with the monitors' own tracker. `change_m_s2`: the most by which the flight follows a reading.

    `largest_load_n_m`: the largest load of the striker that explains an acceleration.
    """

    crank: crank.Constants
    mass_kg: float
    amplitude_m: float
    change_m_s2: float
    largest_load_n_m: float


class OwnCrank(NamedTuple):
    """`pull_m_s2`: the striker's acceleration in flight by the low range."""

    tracked: CrankState
    pull_m_s2: float


INITIAL = OwnCrank(crank.INITIAL, 0.0)


def derive(p: Parameters, limits: GateLimits) -> Constants:
    """The constants of these parameters."""
    torque_n_m = p.speed.torque_limit_n_m
    tracker = crank.tracker_of(
        BANDWIDTH_RAD_S, LARGEST_SHARE * torque_n_m / p.motor.inertia_kg_m2, limits.tick_s
    )
    spring_load_n_m = p.striker.spring_n_m * p.limit.stretch_m * p.drive.amplitude_m
    return Constants(
        crank=crank.derive(p)._replace(tracker=tracker),
        mass_kg=p.striker.mass_kg,
        amplitude_m=p.drive.amplitude_m,
        change_m_s2=limits.flight_m_s3 * limits.tick_s,
        largest_load_n_m=min(spring_load_n_m, LOAD_SHARE * torque_n_m),
    )


def step(
    own: Constants,
    state: OwnCrank,
    felt: AccelerometerInput,
    turned: Turned,
    acting_n_m: float,
    touching: bool,
) -> OwnCrank:
    """One tick. `acting_n_m`: the torque that acted in it; `touching`: the gate sees a contact."""
    pull_m_s2 = state.pull_m_s2
    if felt.age_ticks == 0 and not touching:
        change_m_s2 = felt.low_m_s2 - pull_m_s2
        pull_m_s2 += clamp(change_m_s2, own.change_m_s2)
    tracked = state.tracked
    _, cosine = sine_cosine(tracked.angle_rad + 0.5 * own.crank.tick_s * tracked.omega_rad_s)
    load_n_m = own.mass_kg * pull_m_s2 * own.amplitude_m * cosine
    known_rad_s2 = crank.known_acceleration(
        own.crank, acting_n_m, tracked, clamp(load_n_m, own.largest_load_n_m)
    )
    return OwnCrank(crank.step(own.crank, tracked, turned, known_rad_s2), pull_m_s2)
