"""No division of the firmware is by zero: compiled builds would go on as IEEE 754 says, Python raises.

The intervals of the divisors follow from the syntax trees, the bounds of the parameters and the conditions
(`intervals`). Members of the state have invariants, which every assignment keeps. Where a divisor differs
from 0 for a reason that intervals do not show, the reason stands here.
"""

import math

from intervals import Interval, Prover

from firmware_py.builds.c99.emitter import emit
from firmware_py.node.tick import INITIAL

COUNT = Interval(0.0, math.inf)
INVARIANTS = {
    ("Now", "tick_s"): Interval(1e-4, 1.0),
    ("CrankState", "missed_ticks"): COUNT,
    ("SensorState", "housing_readings"): COUNT,
    ("Period", "impacts"): COUNT,
    ("Stride", "missed"): COUNT,
    ("GateState", "window_ticks"): COUNT,
    ("StartState", "duration_s"): Interval(0.01, math.inf),
}
A_STRIDE = "a stride is between SHORTEST_STRIDE_S and LONGEST_STRIDE_S, or an average of such strides"
A_VARIANCE = "it contains a positive variance of noise; P stays positive semidefinite (Joseph form)"
REDUCED = "the argument is reduced to an interval around or above 1"
REASONS = {
    "gate.exceeds_force": "the condition requires a positive number of ticks, which dt_s is in seconds",
    "gate.watch_encoder": "at least limits.window_ticks, which is a positive number of ticks",
    "crank.step": "one or more control periods; late ticks are counted from 0",
    "elementary.exp": REDUCED,
    "elementary.cube_root": REDUCED,
    "estimator.propagate": A_VARIANCE,
    "kalman.update_written_out": A_VARIANCE,
    "stop_model.contact_age_s": "a product and quotient of positive parameters",
    "gait.step": A_STRIDE,
    "gait.count_strides": A_STRIDE,
    "gait.strike_heel": A_STRIDE,
    "gait.learn_event": A_STRIDE,
    "gait.correct_stride": "the phase of an event begins above 0 and is averaged with phases above 0",
    "gait_lock.step": A_STRIDE,
    "gait_lock.choose_turns": A_STRIDE,
    "gait_lock.turning_share": A_STRIDE,
    "gait_lock.follow_phase": A_STRIDE,
    "transmitter.gait_report_of": A_STRIDE,
    "xcp.exchange": "the control period",
    "xcp.find_starting_error": "a list is allocated with prescaler 1, and SET_DAQ_LIST_MODE refuses 0",
}
"""Why the divisors of a function that intervals leave open differ from 0."""


def test_no_divisor_is_zero() -> None:
    prover = Prover(list(emit("double").functions), INVARIANTS)
    sites = list(prover.divisors())
    left = [function for function, divisor in sites if not prover.is_never_zero(function, divisor)]
    assert {f"{one.__module__.rpartition('.')[2]}.{one.__name__}" for one in left} == set(REASONS)
    assert len(left) < len(sites) / 3
    assert list(prover.broken_invariants(INITIAL)) == []
