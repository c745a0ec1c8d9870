"""The firmware's parameters in one table, and the core's Config made of them.

The striker's numbers are beliefs: the nominal module of Table 1 (viscous guide, A = 20 mm, soft stop of 10
ms). A parameter is named `block.name_unit`; its index is its place in the table, by which the bus reads and
writes it. New parameters are therefore appended, never inserted.
"""

import difflib
import math
import tomllib
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import tomli_w

from firmware_py.core import (
    calm,
    crank,
    detector,
    drive_link,
    estimator,
    gait,
    hold,
    identify,
    lock,
    monitors,
    regime,
    speed,
    start,
    therapy,
)
from firmware_py.core.kalman import ProcessNoise, Row, Transition
from firmware_py.core.step import Config
from firmware_py.interface import codec

STANDARD_GRAVITY_M_S2 = 9.80665
TAU = 2.0 * math.pi
GAIT_PERIOD_S = codec.GAIT_SENSORS.period_s or 0.0


class ParameterError(ValueError):
    """A parameter that is not there, is no number or is out of bounds; or a file not to be trusted."""


class Parameter(NamedTuple):
    """One line of the table. `meaning` says what it is and why its default is what it is."""

    name: str
    unit: str
    low: float
    high: float
    default: float
    meaning: str
    whole: bool = False


TABLE: tuple[Parameter, ...] = (
    Parameter("control.tick_s", "s", 0.00025, 0.004, 0.001, "control period; classic CAN carries 1 kHz"),
    # --- beliefs about the module -------------------------------------------------------------------
    Parameter("striker.mass_kg", "kg", 1e-3, 100.0, 0.8, "impact mass (Table 1)"),
    Parameter("striker.spring_n_m", "N/m", 0.1, 1e6, 70.0, "coupling spring (Table 1)"),
    Parameter(
        "striker.rest_length_m", "m", -1.0, 1.0, 0.12, "where the spring is relaxed at x_A = 0 (Table 1)"
    ),
    Parameter("drive.amplitude_m", "m", 0.0, 0.2, 0.02, "crank radius; the paper gives none, 20 mm impacts"),
    Parameter("friction.b_n_s_m", "N s/m", 0.0, 1e3, 0.2, "viscous friction, middle of Table 1's range"),
    Parameter("friction.mu", "1", 0.0, 2.0, 0.0, "dry friction; the default guide has none"),
    Parameter("stop.position_m", "m", -1.0, 1.0, 0.18, "the stop's face (Table 1)"),
    Parameter("stop.restitution", "1", 0.0, 1.0, 0.5, "middle of Table 1's range"),
    Parameter("stop.contact_s", "s", 1e-4, 0.2, 0.010, "elastic contact time at 0.9 m/s: 32 g at r = 1.3"),
    # --- sensors ------------------------------------------------------------------------------------
    Parameter(
        "crank.zero_rad",
        "rad",
        -7.0,
        7.0,
        0.0,
        "encoder angle at which the piston is in the middle, going out",
    ),
    Parameter(
        "crank.bandwidth_rad_s",
        "rad/s",
        1.0,
        1000.0,
        200.0,
        "tracker's triple pole: 0.1 % noise on the speed",
    ),
    Parameter("crank.largest_disturbance_rad_s2", "rad/s^2", 0.0, 1e5, 1600.0, "0.8 N m on 5e-4 kg m^2"),
    Parameter("sensor.low_full_scale_m_s2", "m/s^2", 1.0, 1e4, 156.9064, "16 g"),
    Parameter("sensor.high_full_scale_m_s2", "m/s^2", 1.0, 1e5, 1961.33, "200 g"),
    Parameter(
        "sensor.bandwidth_hz",
        "Hz",
        20.0,
        1e5,
        400.0,
        "the accelerometers' low-pass, Butterworth of second order",
    ),
    Parameter(
        "sensor.high_offset_s", "s", 0.01, 1e4, 2.0, "time to learn the high range's offset; bias is slow"
    ),
    Parameter(
        "sensor.housing_weight",
        "1",
        0.0,
        1.0,
        1.0,
        "share of the housing's acceleration taken off",
    ),
    # --- estimator ----------------------------------------------------------------------------------
    Parameter(
        "estimator.initial_position_std_m", "m", 1e-6, 1.0, 0.03, "a striker left anywhere in its travel"
    ),
    Parameter("estimator.initial_velocity_std_m_s", "m/s", 1e-6, 10.0, 0.3, "may still swing at power-up"),
    Parameter(
        "estimator.initial_bias_std_m_s2", "m/s^2", 1e-6, 10.0, 0.3, "50 mg at most, taken as 1.6 sigma"
    ),
    Parameter("estimator.position_floor_m", "m", 1e-9, 0.01, 5e-5, "the stop itself is not known better"),
    Parameter(
        "estimator.velocity_floor_m_s", "m/s", 1e-9, 0.1, 5e-4, "one count of the high range over a tick"
    ),
    Parameter("estimator.bias_floor_m_s2", "m/s^2", 1e-9, 0.1, 1e-3, "keeps the bias alive as it drifts"),
    Parameter(
        "estimator.model_std_m_s2",
        "m/s^2",
        1e-4,
        100.0,
        0.016,
        "floor of what is learnt: 70 ug/sqrt(Hz) over 400 Hz, and counts",
    ),
    Parameter(
        "estimator.velocity_noise_m_s", "m/s", 0.0, 1.0, 3e-5, "by tick: noise and scale of the reading"
    ),
    Parameter(
        "estimator.bias_noise_m_s2", "m/s^2", 0.0, 1.0, 1e-4, "by tick: 0.2 g of drift an hour and more"
    ),
    Parameter(
        "estimator.contact_noise_m_s", "m/s", 0.0, 1.0, 1e-3, "by tick in contact: counts of 49 mg, aliasing"
    ),
    Parameter(
        "estimator.bend_share", "1", 0.0, 1.0, 0.05, "of a reading's second difference: the trapezoid's error"
    ),
    Parameter(
        "estimator.gap_noise_m_s", "m/s", 0.0, 1.0, 3e-3, "by tick without a reading: a blow may be missed"
    ),
    Parameter("estimator.stop_std_m", "m", 1e-6, 0.01, 3e-4, "the stop's place, +-0.3 mm"),
    Parameter(
        "estimator.touch_down_jitter_s", "s", 0.0, 0.01, 2.5e-4, "how well the age of a touch-down is known"
    ),
    Parameter(
        "estimator.separation_jitter_s", "s", 0.0, 0.01, 1e-3, "a contact ends more softly than it starts"
    ),
    Parameter(
        "estimator.restitution_std", "1", 1e-3, 1.0, 0.1, "where Newton's law has to stand in: twice +-0.05"
    ),
    # --- detector -----------------------------------------------------------------------------------
    Parameter("detector.floor_m_s2", "m/s^2", 0.1, 1e3, 1.5, "five times what 2 % of c and 1 mm of l0 do"),
    Parameter("detector.sigmas", "1", 0.5, 100.0, 4.0, "spreads of the estimate, on top of the floor"),
    Parameter("detector.near_m", "m", 0.0, 1.0, 0.006, "near the stop; the spread of the estimate is added"),
    Parameter("detector.sure_factor", "1", 1.0, 100.0, 3.0, "twice this much in a row counts anywhere"),
    Parameter("detector.end_m_s2", "m/s^2", 0.01, 1e3, 1.5, "a contact has ended below this"),
    Parameter("detector.end_fraction", "1", 0.0, 0.5, 0.02, "or below this share of its peak"),
    Parameter("detector.separation_age_s", "s", 0.0, 0.01, 5e-4, "from separation to the tick that sees it"),
    Parameter("detector.refractory_s", "s", 0.0, 0.2, 0.005, "the low-pass rings out in 2 ms"),
    Parameter("detector.longest_contact_s", "s", 0.001, 1.0, 0.080, "eight times the nominal contact"),
    # --- regime -------------------------------------------------------------------------------------
    Parameter(
        "regime.equal_speed", "1", 0.01, 1.0, 0.15, "approach speeds of like periods; a rise changes 5 %"
    ),
    Parameter("regime.grazing_m_s", "m/s", 0.0, 1.0, 0.05, "slower blows decide nothing"),
    Parameter("regime.chattering_impacts", "1", 2.0, 100.0, 4.0, "in a period", whole=True),
    Parameter("regime.still_m_s2", "m/s^2", 0.0, 10.0, 0.6, "peak of a striker that sticks: bias and noise"),
    Parameter("regime.longest_period_s", "s", 0.1, 100.0, 6.0, "slower than 1 rad/s there is no regime"),
    Parameter("regime.agreeing_periods", "1", 1.0, 20.0, 2.0, "before a new regime is reported", whole=True),
    # --- start --------------------------------------------------------------------------------------
    Parameter(
        "start.lowest_ratio", "1", 0.01, 10.0, 0.2, "below, the crank's ripple is larger than its speed"
    ),
    Parameter("start.highest_ratio", "1", 0.01, 10.0, 1.45, "beyond the fold there are no impacts"),
    Parameter("start.capture_ratio", "1", 0.0, 10.0, 0.85, "from here on impacts are what is wanted"),
    Parameter("start.dip_ratio", "1", 0.1, 10.0, 1.05, "below 1.1 motion without impacts does not exist"),
    Parameter("start.rise_s", "s", 0.1, 100.0, 4.0, "2 s capture r = 1.35 nominally; twice that"),
    Parameter("start.dip_s", "s", 0.1, 100.0, 1.0, "down to the dip"),
    Parameter("start.again_s", "s", 0.1, 100.0, 2.0, "from the dip up again: captures r = 1.35 nominally"),
    Parameter("start.stop_s", "s", 0.1, 100.0, 1.0, "to standstill: at most 4 blows, the last within 2 s"),
    Parameter("start.shortest_change_s", "s", 0.01, 100.0, 0.5, "for a small change of the target"),
    Parameter(
        "start.confirm_periods", "1", 1.0, 100.0, 5.0, "impacts in so many periods in a row", whole=True
    ),
    Parameter("start.missing_periods", "1", 1.0, 100.0, 3.0, "without an impact: not captured", whole=True),
    Parameter("start.lost_periods", "1", 1.0, 100.0, 2.0, "without an impact in the hold: lost", whole=True),
    Parameter(
        "start.dwell_periods", "1", 1.0, 100.0, 2.0, "impacts in so many in the dip: rise again", whole=True
    ),
    Parameter(
        "start.attempts",
        "1",
        0.0,
        20.0,
        3.0,
        "dips before it is given up; one without a blow is two",
        whole=True,
    ),
    # --- speed loop ---------------------------------------------------------------------------------
    Parameter("motor.inertia_kg_m2", "kg m^2", 1e-7, 1.0, 5e-4, "rotor and flywheel"),
    Parameter("motor.viscous_n_m_s", "N m s", 0.0, 1.0, 1e-4, "bearing"),
    Parameter("motor.dry_n_m", "N m", 0.0, 1.0, 5e-3, "bearing and cogging"),
    Parameter("speed.gain_p_n_m_s", "N m s", 0.0, 10.0, 0.05, "tools.tuning.speed"),
    Parameter("speed.gain_i_n_m", "N m", 0.0, 100.0, 0.8, "tools.tuning.speed"),
    Parameter(
        "speed.load_share", "1", 0.0, 1.5, 1.0, "share of the estimated crank load that is fed forward"
    ),
    Parameter("speed.torque_limit_n_m", "N m", 0.0, 10.0, 0.6, "three quarters of 10 A at 0.08 N m/A"),
    Parameter("speed.torque_rate_n_m_s", "N m/s", 0.1, 1e5, 60.0, "full torque in 10 ms"),
    Parameter("speed.current_limit_a", "A", 0.1, 100.0, 10.0, "handed to the drive (Set_Limits)"),
    # --- limits and watchdogs -----------------------------------------------------------------------
    Parameter(
        "limit.speed_rad_s", "rad/s", 0.1, 100.0, 20.0, "no torque forward beyond; r = 1.45 is 13.6 rad/s"
    ),
    Parameter("limit.overspeed_rad_s", "rad/s", 0.1, 120.0, 25.0, "fault; the motor itself ends at 40 rad/s"),
    Parameter("limit.drive_speed_rad_s", "rad/s", 0.1, 200.0, 35.0, "handed to the drive (Set_Limits)"),
    Parameter("limit.current_a", "A", 0.1, 200.0, 12.0, "fault: 20 % beyond the drive's own limit"),
    Parameter("limit.inverter_degc", "degC", 0.0, 150.0, 80.0, "fault"),
    Parameter("limit.motor_degc", "degC", 0.0, 200.0, 90.0, "fault: a winding of class A with margin"),
    Parameter("limit.lowest_degc", "degC", -100.0, 50.0, -30.0, "fault: a broken thermistor reads colder"),
    Parameter("limit.lowest_v", "V", 0.0, 100.0, 18.0, "fault: 24 V less 25 %"),
    Parameter("limit.highest_v", "V", 1.0, 100.0, 30.0, "fault: 24 V plus 25 %"),
    Parameter("limit.impulse_n_s", "N s", 0.01, 1e3, 1.6, "fault: Table 1 gives 0.2 to 1.5 N s"),
    Parameter("limit.position_std_m", "m", 1e-4, 1.0, 0.05, "an estimate wider than the gap is none"),
    Parameter("limit.stall_share", "1", 0.0, 0.9, 0.3, "turning slower than this share of the target"),
    Parameter("limit.overcurrent_s", "s", 0.0, 10.0, 0.02, "longer than a current loop's overshoot"),
    Parameter("limit.voltage_s", "s", 0.0, 10.0, 0.15, "two supply readings"),
    Parameter("limit.estimate_s", "s", 0.0, 60.0, 1.0, "two drive periods"),
    Parameter("limit.stall_s", "s", 0.0, 60.0, 0.8, "more than one drive period"),
    Parameter("limit.standstill_rad_s", "rad/s", 1e-3, 10.0, 0.3, "stands still"),
    Parameter("limit.standstill_s", "s", 0.0, 60.0, 0.3, "for so long"),
    Parameter("watchdog.sensor_s", "s", 0.002, 10.0, 0.030, "30 frames; torque is 0 well within 100 ms"),
    Parameter("watchdog.encoder_s", "s", 0.002, 10.0, 0.030, "30 frames; torque is 0 well within 100 ms"),
    Parameter("watchdog.drive_s", "s", 0.05, 10.0, 0.35, "three heartbeats and a half"),
    Parameter("watchdog.operator_s", "s", 0.05, 10.0, 0.35, "three commands and a half"),
    Parameter(
        "watchdog.frozen_s", "s", 0.002, 10.0, 0.020, "a position that stands while a speed is reported"
    ),
    Parameter("watchdog.enable_s", "s", 0.05, 60.0, 1.0, "from asking the drive to close its loop"),
    # --- added later --------------------------------------------------------------------------------
    Parameter("limit.force_n", "N", 1.0, 1e5, 1500.0, "fault: 200 g on 0.8 kg is the most that can be read"),
    Parameter("sensor.housing_offset_s", "s", 0.1, 1e5, 30.0, "gait is faster, a bias slower than this"),
    Parameter(
        "estimator.initial_model_std_m_s2", "m/s^2", 1e-4, 100.0, 0.12, "2 % of c, 30 % of b and 1 mm of l0"
    ),
    Parameter(
        "estimator.largest_model_std_m_s2", "m/s^2", 1e-4, 100.0, 0.25, "beyond, corrections would die out"
    ),
    Parameter("estimator.model_learning_s", "s", 0.01, 1e4, 2.0, "four drive periods"),
    Parameter(
        "estimator.model_memory_s", "s", 0.0, 10.0, 0.3, "errors of the model keep their sign half a period"
    ),
    Parameter(
        "estimator.still_m_s2", "m/s^2", 0.0, 10.0, 0.25, "a dry guide holds: noise, bias not yet known"
    ),
    Parameter("estimator.still_s", "s", 0.001, 10.0, 0.03, "for so long; a reversal lasts less"),
    Parameter("estimator.coarse_std_m", "m", 1e-5, 0.1, 2e-3, "a Hall or string sensor's noise"),
    Parameter("start.free_ratio", "1", 0.1, 10.0, 1.32, "the S-curve ends here; beyond, the hold creeps on"),
    Parameter("hold.lowest_ratio", "1", 0.1, 10.0, 1.0, "below, the impulse no longer falls with the speed"),
    Parameter(
        "hold.highest_phase_deg",
        "deg",
        5.0,
        80.0,
        64.5,
        "20 degrees before the fold, 0.5 within the 65 promised",
    ),
    Parameter("hold.phase_slope_rad", "rad", 0.01, 100.0, 1.4, "by unit of r at 0 deg: 0.8 deg per 0.01"),
    Parameter("hold.phase_slope_growth", "1", 0.0, 10.0, 1.6, "by rad: 2.3 deg per 0.01 at 65 deg and more"),
    Parameter("hold.gain_phase", "1", 0.01, 1.0, 0.15, "of the error a period: the slope may be twice this"),
    Parameter("hold.impulse_slope_n_s", "N s", 0.01, 100.0, 2.0, "by unit of r, between r = 1.0 and 1.3"),
    Parameter("hold.gain_impulse", "1", 0.01, 1.0, 0.2, "of the error a period; a blow settles in two"),
    Parameter("hold.largest_step", "1", 1e-4, 0.1, 0.015, "of the ratio a period: slower than it settles"),
    Parameter("hold.rate_1_s", "1/s", 1e-4, 1.0, 0.03, "of the ratio: a step is done within a period"),
    Parameter("hold.lowest_impulse_n_s", "N s", 0.0, 100.0, 0.2, "Table 1 gives 0.2 to 1.5 N s"),
    Parameter("hold.highest_impulse_n_s", "N s", 0.0, 100.0, 1.5, "Table 1 gives 0.2 to 1.5 N s"),
    Parameter("hold.impulse_tolerance", "1", 0.001, 1.0, 0.03, "further off than this it is not met"),
    Parameter(
        "hold.refusing_periods",
        "1",
        1.0,
        1000.0,
        12.0,
        "at the end of the region before it is said",
        whole=True,
    ),
    Parameter(
        "start.approach_ratio",
        "1",
        0.0,
        1.0,
        0.8,
        "quickly up to here, where the striker does not strike yet",
    ),
    Parameter("start.approach_s", "s", 0.1, 100.0, 0.6, "quickly: for a rise that is longer than this"),
    Parameter(
        "estimator.strange_sigmas",
        "1",
        2.0,
        1000.0,
        6.0,
        "beyond, something else pushes than the model knows",
    ),
    Parameter("estimator.strange_s", "s", 0.0, 1.0, 0.025, "a push; what lasts longer is a lost estimate"),
    Parameter(
        "limit.stretch_m", "m", 0.01, 10.0, 0.2, "an estimate beyond is lost: it does not feed the speed loop"
    ),
    # --- gait ---------------------------------------------------------------------------------------
    Parameter("gait.follow", "1", 0.0, 1.0, 0.0, "1: the crank follows the wearer's gait", whole=True),
    Parameter("gait.lowest_ratio", "1", 0.1, 10.0, 0.98, "below, blows come late or not with every turn"),
    Parameter("gait.centre_ratio", "1", 0.1, 10.0, 1.12, "turns a stride are chosen to come near to it"),
    Parameter(
        "gait.highest_ratio",
        "1",
        0.1,
        10.0,
        1.3,
        "with the margin below start.free_ratio, where a start ends",
    ),
    Parameter("gait.hysteresis", "1", 0.0, 1.0, 0.05, "of the ratio, before turns a stride are changed"),
    Parameter("gait.window_start", "1", 0.0, 1.0, 0.45, "of the cycle: push-off begins"),
    Parameter("gait.window_end", "1", 0.0, 1.0, 0.60, "of the cycle: the toes leave the ground soon"),
    Parameter("gait.lowest_confidence", "1", 0.01, 1.0, 0.25, "strides that vary by 11 %: below, it stops"),
    Parameter(
        "gait.gain_1_s", "1/s", 0.0, 20.0, 2.0, "of the crank's lag: made up before the next stride's window"
    ),
    Parameter("gait.largest_trim", "1", 0.0, 0.5, 0.15, "of the ratio, to make up a lag"),
    Parameter("gait.rate_1_s", "1/s", 1e-3, 1.0, 0.3, "of the ratio: slower than blows settle"),
    Parameter("gait.shortest_s", "s", 0.1, 10.0, 0.5, "a stride; a run has 0.7 s"),
    Parameter("gait.longest_s", "s", 0.2, 20.0, 3.0, "a stride; the slowest walk has 2.5 s"),
    Parameter("gait.swing_rad_s", "rad/s", 0.1, 20.0, 1.0, "the shank, backward: the leg has swung"),
    Parameter(
        "gait.still_rad_s", "rad/s", 0.0, 5.0, 0.25, "of the shank: in stance it turns by 0.5 and more"
    ),
    Parameter("gait.still_s", "s", 0.01, 10.0, 0.2, "for so long: no walking any more"),
    Parameter("gait.standing_s", "s", 0.01, 60.0, 1.0, "for so long: standing"),
    Parameter(
        "gait.gain_stride", "1", 0.01, 1.0, 0.5, "share of a stride in the mean: 20 % in 5 are followed"
    ),
    Parameter("gait.gain_learning", "1", 0.001, 1.0, 0.05, "of an event's phase: 20 strides"),
    Parameter("gait.event_std", "1", 1e-4, 0.2, 0.0045, "of the cycle: 5 ms of frames, and how feet roll"),
    Parameter(
        "gait.overdue", "1", 0.01, 1.0, 0.1, "of the cycle: a strike this late was missed by its switch"
    ),
    Parameter("gait.irregular", "1", 0.05, 0.9, 0.35, "of a stride: so different a one begins anew"),
    Parameter("gait.largest_spread", "1", 0.01, 1.0, 0.15, "of strides: nothing can be foretold"),
    Parameter("gait.strides_to_trust", "1", 1.0, 100.0, 3.0, "before anything is said", whole=True),
    Parameter("gait.margin", "1", 0.0, 0.5, 0.02, "beyond the region, for turns a stride taken already"),
    Parameter("watchdog.gait_s", "s", 0.01, 10.0, 0.2, "a sixth of a stride, over which time alone tells"),
    Parameter(
        "gait.strike_phase", "1", 0.0, 0.2, 0.012, "where the heel's switch closes: at a tenth of the load"
    ),
    Parameter("gait.surprise", "1", 0.0, 1.0, 0.03, "of the cycle: so early an event may be a stumble"),
    Parameter(
        "start.retreat_ratio",
        "1",
        0.0,
        1.0,
        0.03,
        "so far below the speed at which it was lost the next curve ends: friction moves the fold",
    ),
    Parameter(
        "identify.mode",
        "1",
        0.0,
        2.0,
        2.0,
        "0: off; 1: spring, friction and restitution are told; 2: they feed the estimator's model",
        whole=True,
    ),
    Parameter("identify.memory", "1", 2.0, 1e4, 30.0, "flights between blows: twenty seconds"),
    Parameter(
        "identify.fewest_flights",
        "1",
        2.0,
        1e4,
        5.0,
        "before anything is fed: each is good to 1 %",
        whole=True,
    ),
    Parameter("identify.largest_spring", "1", 0.0, 0.5, 0.1, "of c: 5 % of the natural frequency"),
    Parameter("identify.largest_friction", "1", 0.0, 0.9, 0.5, "of b or mu, known to +-30 % and +-10 %"),
    Parameter(
        "identify.largest_restitution", "1", 0.0, 0.5, 0.15, "a blow further off the mean is misjudged"
    ),
    Parameter("identify.spring_step", "1", 1e-5, 0.1, 0.003, "by blow: no step that the estimate would feel"),
    Parameter(
        "identify.friction_step", "1", 1e-5, 0.5, 0.03, "by blow: no step that the estimate would feel"
    ),
    Parameter(
        "identify.noise_m_s2", "m/s^2", 1e-4, 10.0, 0.03, "of a sample: the sensor's and its integral's"
    ),
    Parameter("identify.spring_std", "1", 1e-4, 1.0, 0.03, "what is known of c beforehand"),
    Parameter("identify.friction_std", "1", 1e-3, 1.0, 0.3, "what is known of b or mu beforehand"),
    Parameter(
        "identify.largest_residual_m_s2", "m/s^2", 0.01, 100.0, 0.5, "a flight with a push is left out"
    ),
    Parameter(
        "limit.takeover_s",
        "s",
        0.0,
        60.0,
        0.5,
        "below limit.speed_rad_s before it starts: a turn of a free crank",
    ),
    Parameter("gait.surprise_spread", "1", 0.0, 100.0, 4.5, "deviations early: a stumble"),
    Parameter("calm.longest_s", "s", 0.0, 100.0, 2.0, "three swings; where a gait is followed; 0: never"),
    Parameter("calm.share", "1", 0.1, 1.0, 0.7, "of the way to the stop: what a leg adds stays below"),
    Parameter("calm.gain", "1", 0.0, 20.0, 1.0, "over w: in step with the striker within a swing"),
    Parameter(
        "gait.impulse_tolerance",
        "1",
        0.001,
        1.0,
        0.15,
        "of an impulse asked for: strides vary, turns are whole",
    ),
)
"""All parameters, in the order of their indices."""

BY_NAME: dict[str, Parameter] = {parameter.name: parameter for parameter in TABLE}
INDEX: dict[str, int] = {parameter.name: index for index, parameter in enumerate(TABLE)}
DEFAULTS: dict[str, float] = {parameter.name: parameter.default for parameter in TABLE}

_ORDERED = (
    ("start.lowest_ratio", "start.highest_ratio"),
    ("limit.lowest_v", "limit.highest_v"),
    ("limit.speed_rad_s", "limit.overspeed_rad_s"),
    ("sensor.low_full_scale_m_s2", "sensor.high_full_scale_m_s2"),
    ("gait.lowest_ratio", "gait.highest_ratio"),
    ("gait.window_start", "gait.window_end"),
    ("gait.shortest_s", "gait.longest_s"),
)
"""Pairs of which the first must be below the second."""


def flattened(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested tables as dotted names: `{"stop": {"restitution": 0.4}}` gives `{"stop.restitution": 0.4}`."""
    flat: dict[str, Any] = {}
    for key, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flattened(value, f"{prefix}{key}."))
        else:
            flat[f"{prefix}{key}"] = value
    return flat


def checked(name: str, value: Any) -> float:
    """`value` as the float that parameter `name` may take."""
    parameter = BY_NAME.get(name)
    if parameter is None:
        near = difflib.get_close_matches(name, BY_NAME, n=3, cutoff=0.5)
        hint = (
            f"did you mean {' or '.join(near)}?" if near else "firmware_py/shell/parameters.py lists them all"
        )
        raise ParameterError(f"there is no firmware parameter {name!r}; {hint}")
    bounds = f"from {parameter.low:g} to {parameter.high:g} {parameter.unit}"
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ParameterError(f"{name} = {value!r} is no number; give one {bounds}")
    if not parameter.low <= value <= parameter.high:
        raise ParameterError(f"{name} = {value!r} {parameter.unit} is out of bounds; give a value {bounds}")
    if parameter.whole and value != int(value):
        raise ParameterError(f"{name} = {value!r} is a count; give a whole number {bounds}")
    return float(value)


def with_overrides(overrides: Mapping[str, Any]) -> dict[str, float]:
    """All parameters, defaults except where `overrides` (dotted names or nested tables) says otherwise."""
    values = DEFAULTS | {name: checked(name, value) for name, value in flattened(overrides).items()}
    for lower, upper in _ORDERED:
        if not values[lower] < values[upper]:
            raise ParameterError(
                f"{lower} = {values[lower]:g} is not below {upper} = {values[upper]:g}; change one of them"
            )
    return values


def config_from(overrides: Mapping[str, Any]) -> Config:
    """The core's configuration for the defaults with `overrides`."""
    return config_of(with_overrides(overrides))


def critically_damped_gains(bandwidth_rad_s: float, tick_s: float) -> tuple[float, float, float]:
    """g, h, k of the third-order fading-memory filter with a triple pole (Zarchan & Musoff, table 1.5)."""
    pole = math.exp(-bandwidth_rad_s * tick_s)
    return 1.0 - pole**3, 1.5 * (1.0 - pole) ** 2 * (1.0 + pole), 0.5 * (1.0 - pole) ** 3


def free_flight(stiffness_1_s2: float, damping_1_s: float, dt_s: float) -> Transition:
    """exp(F dt) of x'' = −(c/m) x − (b/m) x', in closed form for weak, critical and strong damping."""
    sigma = 0.5 * damping_1_s
    square = stiffness_1_s2 - sigma * sigma
    decay = math.exp(-sigma * dt_s)
    if square > 0.0:
        omega = math.sqrt(square)
        cosine, sine_over_omega = math.cos(omega * dt_s), math.sin(omega * dt_s) / omega
    elif square < 0.0:
        omega = math.sqrt(-square)
        cosine, sine_over_omega = math.cosh(omega * dt_s), math.sinh(omega * dt_s) / omega
    else:
        cosine, sine_over_omega = 1.0, dt_s
    return Transition(
        x_x=decay * (cosine + sigma * sine_over_omega),
        x_v=decay * sine_over_omega,
        x_b=0.0,
        v_x=-decay * stiffness_1_s2 * sine_over_omega,
        v_v=decay * (cosine - sigma * sine_over_omega),
        v_b=0.0,
    )


def hertz_dissipation(restitution: float) -> float:
    """d = λ x'⁻ of a Hunt–Crossley stop with this restitution k: d − ln(1 + d) = −k d − ln(1 − k d)."""
    if restitution >= 1.0:
        return 0.0
    k = max(restitution, 1e-3)

    def excess(d: float) -> float:
        return (d - math.log1p(d)) - (-k * d - math.log1p(-k * d))

    low, high = 1e-9, (1.0 - 1e-12) / k
    for _ in range(200):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)


def contact_growth(mass_kg: float, contact_s: float, restitution: float, reference_m_s: float = 0.9) -> float:
    """`growth` of a(t) = growth · (x'⁻ t)^1.5 at the start of a contact, m/s² by m^1.5.

    Hertz: the elastic contact lasts 2.9432 δ_max/x'⁻ with δ_max = (5 m x'⁻²/(4 K))^(2/5).
    """
    deepest_m = contact_s * reference_m_s / 2.9432
    stiffness = 1.25 * mass_kg * reference_m_s * reference_m_s / math.pow(deepest_m, 2.5)
    return stiffness / mass_kg * (1.0 + hertz_dissipation(restitution))


def config_of(values: Mapping[str, float], damaged: bool = False) -> Config:
    """The core's configuration for a complete set of values, as `with_overrides` gives it.

    `damaged`: these stand in for values that could not be read, and the firmware must not arm.
    """
    tick_s = values["control.tick_s"]

    def ticks(name: str) -> int:
        return round(values[name] / tick_s)

    def square(name: str) -> float:
        return values[name] * values[name]

    mass_kg = values["striker.mass_kg"]
    stiffness_1_s2 = values["striker.spring_n_m"] / mass_kg
    damping_1_s = values["friction.b_n_s_m"] / mass_kg
    natural_rad_s = math.sqrt(stiffness_1_s2)
    delay_s = math.sqrt(2.0) / (TAU * values["sensor.bandwidth_hz"])  # Butterworth, second order, at rest
    restitution = values["stop.restitution"]
    gain_angle, gain_speed, gain_acceleration = critically_damped_gains(
        values["crank.bandwidth_rad_s"], tick_s
    )
    crank_config = crank.CrankConfig(
        tick_s=tick_s,
        zero_rad=values["crank.zero_rad"],
        bandwidth_rad_s=values["crank.bandwidth_rad_s"],
        gain_angle=gain_angle,
        gain_speed=gain_speed,
        gain_acceleration=gain_acceleration,
        largest_disturbance_rad_s2=values["crank.largest_disturbance_rad_s2"],
    )
    estimator_config = estimator.EstimatorConfig(
        tick_s=tick_s,
        striker=estimator.StrikerBelief(
            stiffness_1_s2=stiffness_1_s2,
            damping_1_s=damping_1_s,
            dry_m_s2=values["friction.mu"] * STANDARD_GRAVITY_M_S2,
            rest_length_m=values["striker.rest_length_m"],
            amplitude_m=values["drive.amplitude_m"],
            stop_m=values["stop.position_m"],
            restitution=restitution,
        ),
        sensor=estimator.SensorBelief(
            low_full_scale_m_s2=values["sensor.low_full_scale_m_s2"],
            high_full_scale_m_s2=values["sensor.high_full_scale_m_s2"],
            delay_s=delay_s,
            high_offset_rate=min(tick_s / values["sensor.high_offset_s"], 1.0),
            housing_weight=values["sensor.housing_weight"],
            housing_rate=min(tick_s / values["sensor.housing_offset_s"], 1.0),
        ),
        spread=estimator.Spread(
            initial_xx=square("estimator.initial_position_std_m"),
            initial_vv=square("estimator.initial_velocity_std_m_s"),
            initial_bb=square("estimator.initial_bias_std_m_s2"),
            floor_xx=square("estimator.position_floor_m"),
            floor_vv=square("estimator.velocity_floor_m_s"),
            floor_bb=square("estimator.bias_floor_m_s2"),
        ),
        # a_d = a − τ a',  a = −(c/m) (x − …) − (b/m) x',  a' = −(c/m) (x' − x_A') − (b/m) a
        row=Row(
            x=-stiffness_1_s2 * (1.0 + delay_s * damping_1_s),
            v=-damping_1_s * (1.0 + delay_s * damping_1_s) + delay_s * stiffness_1_s2,
            b=1.0,
        ),
        model=free_flight(stiffness_1_s2, damping_1_s, tick_s),
        strapdown=estimator.strapdown(tick_s),
        strapdown_noise=ProcessNoise(
            xx=0.0, vv=square("estimator.velocity_noise_m_s"), bb=square("estimator.bias_noise_m_s2")
        ),
        model_noise=ProcessNoise(
            xx=0.0, vv=square("estimator.gap_noise_m_s"), bb=square("estimator.bias_noise_m_s2")
        ),
        contact_noise=ProcessNoise(
            xx=0.0, vv=square("estimator.contact_noise_m_s"), bb=square("estimator.bias_noise_m_s2")
        ),
        bend_share=values["estimator.bend_share"],
        trust=estimator.ModelTrust(
            floor=square("estimator.model_std_m_s2"),
            start=square("estimator.initial_model_std_m_s2"),
            ceiling=square("estimator.largest_model_std_m_s2"),
            learning_rate=min(tick_s / values["estimator.model_learning_s"], 1.0),
            readings_as_one=max(values["estimator.model_memory_s"] / tick_s, 1.0),
            still_m_s2=values["estimator.still_m_s2"],
            still_ticks=ticks("estimator.still_s"),
            strange_sigmas=values["estimator.strange_sigmas"],
            strange_ticks=ticks("estimator.strange_s"),
        ),
        stop_variance=square("estimator.stop_std_m"),
        coarse_variance=square("estimator.coarse_std_m"),
        touch_down_jitter_s=values["estimator.touch_down_jitter_s"],
        separation_jitter_s=values["estimator.separation_jitter_s"],
        restitution_variance=square("estimator.restitution_std"),
        has_flights=values["identify.mode"] > 0.0,
    )
    detector_config = detector.DetectorConfig(
        tick_s=tick_s,
        floor_m_s2=values["detector.floor_m_s2"],
        dry_m_s2=values["friction.mu"] * STANDARD_GRAVITY_M_S2,
        sigmas=values["detector.sigmas"],
        near_m=values["detector.near_m"],
        sure_factor=values["detector.sure_factor"],
        stop_m=values["stop.position_m"],
        growth=contact_growth(mass_kg, values["stop.contact_s"], restitution),
        delay_s=delay_s,
        end_m_s2=values["detector.end_m_s2"],
        end_fraction=values["detector.end_fraction"],
        separation_age_s=values["detector.separation_age_s"],
        refractory_ticks=ticks("detector.refractory_s"),
        longest_contact_ticks=ticks("detector.longest_contact_s"),
        newton_contact_ticks=max(round(values["stop.contact_s"] / tick_s), 1),
        mass_kg=mass_kg,
        restitution=restitution,
    )
    return Config(
        tick_s=tick_s,
        drive_link=drive_link.DriveLinkConfig(
            speed_limit_rad_s=values["limit.drive_speed_rad_s"],
            current_limit_a=values["speed.current_limit_a"],
            repeat_ticks=max(round(drive_link.REPEAT_S / tick_s), 1),
            answer_ticks=max(round(drive_link.REPEAT_S / tick_s), 1),
            arm_ticks=max(round(drive_link.ARM_S / tick_s), 1),
            re_zero_ticks=max(round(drive_link.RE_ZERO_S / tick_s), 1),
            fresh_ticks=ticks("watchdog.drive_s"),
        ),
        crank=crank_config,
        estimator=estimator_config,
        identify=identify.IdentifyConfig(
            enabled=values["identify.mode"] > 0.0,
            feeds=values["identify.mode"] > 1.0,
            tick_s=tick_s,
            delay_s=delay_s,
            memory=values["identify.memory"],
            fewest_flights=int(values["identify.fewest_flights"]),
            largest_spring=values["identify.largest_spring"],
            largest_friction=values["identify.largest_friction"],
            largest_restitution=values["identify.largest_restitution"],
            spring_step=values["identify.spring_step"],
            friction_step=values["identify.friction_step"],
            prior_spring=(values["identify.noise_m_s2"] / values["identify.spring_std"]) ** 2,
            prior_friction=(values["identify.noise_m_s2"] / values["identify.friction_std"]) ** 2,
            largest_residual_m_s2=values["identify.largest_residual_m_s2"],
        ),
        detector=detector_config,
        regime=regime.RegimeConfig(
            equal_speed=values["regime.equal_speed"],
            grazing_m_s=values["regime.grazing_m_s"],
            chattering_impacts=int(values["regime.chattering_impacts"]),
            still_m_s2=values["regime.still_m_s2"],
            slowest_rad_s=2.0 * math.pi / values["regime.longest_period_s"],
            agreeing_periods=int(values["regime.agreeing_periods"]),
        ),
        start=start.StartConfig(
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=values["start.lowest_ratio"],
            highest_ratio=values["start.highest_ratio"],
            free_ratio=values["start.free_ratio"],
            capture_ratio=values["start.capture_ratio"],
            dip_ratio=values["start.dip_ratio"],
            approach_ratio=values["start.approach_ratio"],
            approach_s=values["start.approach_s"],
            rise_s=values["start.rise_s"],
            dip_s=values["start.dip_s"],
            again_s=values["start.again_s"],
            stop_s=values["start.stop_s"],
            shortest_change_s=values["start.shortest_change_s"],
            confirm_periods=int(values["start.confirm_periods"]),
            missing_periods=int(values["start.missing_periods"]),
            lost_periods=int(values["start.lost_periods"]),
            dwell_periods=int(values["start.dwell_periods"]),
            attempts=int(values["start.attempts"]),
            retreat_ratio=values["start.retreat_ratio"],
        ),
        hold=hold.HoldConfig(
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=values["hold.lowest_ratio"],
            highest_ratio=values["start.highest_ratio"],
            highest_phase_rad=math.radians(values["hold.highest_phase_deg"]),
            phase_slope_rad=values["hold.phase_slope_rad"],
            phase_slope_growth=values["hold.phase_slope_growth"],
            gain_phase=values["hold.gain_phase"],
            impulse_slope_n_s=values["hold.impulse_slope_n_s"],
            gain_impulse=values["hold.gain_impulse"],
            largest_step=values["hold.largest_step"],
            rate_1_s=values["hold.rate_1_s"],
            lowest_impulse_n_s=values["hold.lowest_impulse_n_s"],
            highest_impulse_n_s=values["hold.highest_impulse_n_s"],
            impulse_tolerance=values["hold.impulse_tolerance"],
            refusing_periods=int(values["hold.refusing_periods"]),
        ),
        speed=speed.SpeedConfig(
            tick_s=tick_s,
            gain_p_n_m_s=values["speed.gain_p_n_m_s"],
            gain_i_n_m=values["speed.gain_i_n_m"],
            lead_s=1.5 * tick_s,  # sensors at t_k, torque from t_{k+1} to t_{k+2}
            load=speed.LoadBelief(
                inertia_kg_m2=values["motor.inertia_kg_m2"],
                viscous_n_m_s=values["motor.viscous_n_m_s"],
                dry_n_m=values["motor.dry_n_m"],
                spring_n_m=values["striker.spring_n_m"],
                amplitude_m=values["drive.amplitude_m"],
                rest_length_m=values["striker.rest_length_m"],
                longest_stretch_m=values["limit.stretch_m"],
            ),
            load_share=values["speed.load_share"],
            torque_limit_n_m=values["speed.torque_limit_n_m"],
            torque_rate_n_m_s=values["speed.torque_rate_n_m_s"],
            speed_limit_rad_s=values["limit.speed_rad_s"],
        ),
        monitors=monitors.MonitorConfig(
            watchdogs=monitors.Watchdogs(
                sensor_ticks=ticks("watchdog.sensor_s"),
                encoder_ticks=ticks("watchdog.encoder_s"),
                drive_ticks=ticks("watchdog.drive_s"),
                operator_ticks=ticks("watchdog.operator_s"),
                frozen_ticks=ticks("watchdog.frozen_s"),
                enable_ticks=ticks("watchdog.enable_s"),
                gait_ticks=ticks("watchdog.gait_s") if values["gait.follow"] > 0.0 else 0,
            ),
            limits=monitors.Limits(
                overspeed_rad_s=values["limit.overspeed_rad_s"],
                current_a=values["limit.current_a"],
                inverter_degc=values["limit.inverter_degc"],
                motor_degc=values["limit.motor_degc"],
                lowest_degc=values["limit.lowest_degc"],
                lowest_v=values["limit.lowest_v"],
                highest_v=values["limit.highest_v"],
                impulse_n_s=values["limit.impulse_n_s"],
                peak_m_s2=values["limit.force_n"] / mass_kg,
                position_std_m=values["limit.position_std_m"],
                stall_share=values["limit.stall_share"],
            ),
            overcurrent_ticks=ticks("limit.overcurrent_s"),
            voltage_ticks=ticks("limit.voltage_s"),
            estimate_ticks=ticks("limit.estimate_s"),
            stall_ticks=ticks("limit.stall_s"),
            standstill_rad_s=values["limit.standstill_rad_s"],
            standstill_ticks=ticks("limit.standstill_s"),
            takeover_rad_s=values["limit.speed_rad_s"],
            takeover_ticks=ticks("limit.takeover_s"),
            parameters_damaged=damaged,
        ),
        gait=gait.GaitConfig(
            tick_s=tick_s,
            stale_ticks=ticks("watchdog.gait_s"),
            edge_age_s=0.5 * GAIT_PERIOD_S,
            strike_phase=values["gait.strike_phase"],
            shortest_s=values["gait.shortest_s"],
            longest_s=values["gait.longest_s"],
            swing_rad_s=values["gait.swing_rad_s"],
            still_rad_s=values["gait.still_rad_s"],
            still_s=values["gait.still_s"],
            standing_s=values["gait.standing_s"],
            gain_stride=values["gait.gain_stride"],
            gain_learning=values["gait.gain_learning"],
            timing_variance=square("gait.event_std"),
            overdue=values["gait.overdue"],
            irregular=values["gait.irregular"],
            surprise=values["gait.surprise"],
            surprise_spread=values["gait.surprise_spread"],
            largest_spread=values["gait.largest_spread"],
            strides_to_trust=int(values["gait.strides_to_trust"]),
        ),
        lock=lock.LockConfig(
            follow=values["gait.follow"] > 0.0,
            tick_s=tick_s,
            natural_rad_s=natural_rad_s,
            lowest_ratio=values["gait.lowest_ratio"],
            centre_ratio=values["gait.centre_ratio"],
            highest_ratio=values["gait.highest_ratio"],
            hysteresis=values["gait.hysteresis"],
            margin=values["gait.margin"],
            window_start=values["gait.window_start"],
            window_end=values["gait.window_end"],
            lowest_confidence=values["gait.lowest_confidence"],
            gain_1_s=values["gait.gain_1_s"],
            largest_trim=values["gait.largest_trim"],
            rate_1_s=values["gait.rate_1_s"],
        ),
        therapy=therapy.TherapyConfig(
            lowest_ratio=values["gait.lowest_ratio"],
            highest_ratio=values["gait.highest_ratio"],
            impulse_slope_n_s=values["hold.impulse_slope_n_s"],
            impulse_tolerance=values["gait.impulse_tolerance"],
        ),
        calm=calm.CalmConfig(
            tick_s=tick_s,
            longest_s=values["calm.longest_s"] if values["gait.follow"] > 0.0 else 0.0,
            natural_rad_s=natural_rad_s,
            amplitude_m=values["drive.amplitude_m"],
            rest_length_m=values["striker.rest_length_m"],
            stop_m=values["stop.position_m"],
            share=values["calm.share"],
            gain=values["calm.gain"],
            highest_rad_s=min(1.5 * natural_rad_s, 0.97 * values["limit.speed_rad_s"]),
        ),
    )


def _checksum(values: Mapping[str, float]) -> str:
    text = "".join(f"{name}={values[name]!r}\n" for name in sorted(values))
    return f"{zlib.crc32(text.encode()):08x}"


def written(values: Mapping[str, float]) -> str:
    """A complete set of values as TOML with its checksum."""
    document: dict[str, Any] = {"checksum": _checksum(values)}
    for parameter in TABLE:
        block, _, name = parameter.name.partition(".")
        document.setdefault(block, {})[name] = values[parameter.name]
    return tomli_w.dumps(document)


def read_back(text: str, source: str = "the parameter file") -> dict[str, float]:
    """The values that `written` made `text` of; what is damaged or incomplete is refused."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ParameterError(f"{source} is no TOML ({error}); write it again with save()") from error
    checksum = document.pop("checksum", None)
    values = {name: checked(name, value) for name, value in flattened(document).items()}
    missing = sorted(set(BY_NAME) - set(values))
    if missing:
        raise ParameterError(f"{source} lacks {', '.join(missing)}; write it again with save()")
    if checksum != _checksum(values):
        raise ParameterError(
            f"{source} has checksum {checksum!r}, its values give {_checksum(values)!r}: it is damaged or "
            "was edited by hand; write it again with save()"
        )
    return with_overrides(values)


def save(path: Path, values: Mapping[str, float]) -> None:
    """Write a complete set of values as TOML with its checksum."""
    path.write_text(written(values))


def load(path: Path) -> dict[str, float]:
    """Read what `save` wrote; a damaged or incomplete file is refused."""
    try:
        return read_back(path.read_text(), str(path))
    except UnicodeDecodeError as error:
        raise ParameterError(f"{path} is no TOML ({error}); write it again with save()") from error
