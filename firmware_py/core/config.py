"""What the blocks read: the parameters, and the constants derived from them before the first tick.

A block reads `start.rise_s` of `parameters.toml` as `config.p.start.rise_s`, and a derived constant as
`config.d.natural_rad_s`. `configure.config_of` makes the whole.
"""

from typing import NamedTuple

from firmware_py.core.gate_limits import GateLimits
from firmware_py.interface.generated.parameters import Parameters


class Transition(NamedTuple):
    """The rows of F for position and velocity; the bias keeps its value."""

    x_x: float
    x_v: float
    x_b: float
    v_x: float
    v_v: float
    v_b: float


class Row(NamedTuple):
    """One row of H."""

    x: float
    v: float
    b: float


class Tracker(NamedTuple):
    """A tracker of the crank: its triple pole, g, h and k of a tick, and the largest disturbance."""

    bandwidth_rad_s: float
    gains: tuple[float, float, float]
    largest_rad_s2: float


class MonitorTicks(NamedTuple):
    """A duration of each monitor's condition, named as its fault, in the order of their reports."""

    impulse_limit: int
    estimate_invalid: int
    load_implausible: int
    runaway: int
    stall: int
    stop_failed: int


class Ticks(NamedTuple):
    """Durations in ticks: parameters, and constants of the blocks that use them."""

    still: int
    gated: int
    refractory: int
    longest_contact: int
    newton_contact: int
    sensor: int
    encoder: int
    drive: int
    enable: int
    monitors: MonitorTicks
    standstill: int
    takeover: int
    repeat: int
    arm: int
    re_zero: int
    proof_due: int
    proof_longest: int
    gait: int
    catch_up: int
    consent: int


class Derived(NamedTuple):
    """Constants derived from the parameters. Forces are per unit of the striker's mass.

    `tracker`: that of the control, by tuning parameters; `own_tracker`: that of the monitors, by none.
    `sensor_delay_s`: the accelerometers' low-pass.
    `flight`: F of a tick of the model, `strapdown`: of a tick that integrates the accelerometer; `row`: H of
    the model. `…_rate`: share of a difference that a reading adds to an average. `readings_as_one`: N.
    `contact_growth`: factor of the Hertz contact, a = growth · (x'⁻ t)^1.5, m/s² per m^1.5.
    `implausible_rad_s2`: limit on the crank's unexplained acceleration; `largest_load_n_m`: the largest load
    of the striker that explains one. `spin_down_s`: longest braking, 0: the S-curve alone.
    """

    natural_rad_s: float
    stiffness_1_s2: float
    damping_1_s: float
    dry_m_s2: float
    sensor_delay_s: float
    tracker: Tracker
    own_tracker: Tracker
    flight: Transition
    strapdown: Transition
    row: Row
    high_offset_rate: float
    housing_rate: float
    learning_rate: float
    readings_as_one: float
    contact_growth: float
    highest_phase_rad: float
    implausible_rad_s2: float
    largest_load_n_m: float
    spin_down_s: float
    spin_down_highest_rad_s: float
    ticks: Ticks
    gate: GateLimits


class Config(NamedTuple):
    """`tick_s`: the control period, `p`: the parameters, `d`: the derived constants.

    `parameters_damaged`: the parameters replace values that could not be read, and the firmware must not arm.
    """

    tick_s: float
    p: Parameters
    d: Derived
    parameters_damaged: bool
