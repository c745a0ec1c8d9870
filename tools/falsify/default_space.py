"""The default space of a scenario's kind.

It holds what the scenario's requirements cover: the instant of its fault as with several seeds, smaller sizes
where the checks hold for those too, the module as campaigns sample it, errors of the sensors, the strides of
a walk, and small disturbances beside the fault, which meet at one instant.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from typing import Any

from hil.scenario.scenario import Scenario
from plant_sim.tables.table import STANDARD_GRAVITY_M_S2
from tools.campaign.sampling import MISMATCH
from tools.falsify.space import DELAY, IDLE, INSTANT, SEED, Dimension, Space

IDLE_BEFORE_S = (0.0, 0.0, 0.0, 0.05, 0.15, 0.3)
"""Its values, so that half of the runs have no IDLE. A stop takes longer than the largest."""
TORQUE_ENDS = "after_fault.torque_zero_after_s"
"""The figure that has a fault's deadline as its limit."""
SOON_S = 0.5
"""Longest such limit for an IDLE: a later reaction may find the crank at rest."""
MEET_S = 0.05
"""Longest time from the first disturbance to the last one's beginning."""
MILDER = ("change_m_s", "share", "duration_s", "bias", "std", "by_m", "largest_s")
"""Keys of faults of which a smaller value disturbs less."""
MILDEST = 0.1
"""Smallest size of a fault, as a share of the scenario's own."""
RIDDEN_THROUGH = ("regime", "after_fault.impacts_again_after_s", "after_fault.turning_at_end_rad_s")
"""Figures whose checks say that the motion goes on."""
OF_ANY_SIZE = (*RIDDEN_THROUGH, "gate.passed_n")
"""Figures whose checks hold for smaller faults as well."""
IN_START_S = 0.5
"""Least time from the operator's request to a fault that ends the motion: the drive is armed by then."""
WINDOW_S, WINDOW_SHARE = 1.0, 0.4
"""When disturbances come: within this time after the scenario's fault, or without one in this share of
the time from RUN to the last command or the end, so that the second half of the hold is steady."""
RIGHT_CLOCK, JITTER = "P-15", "clock-jitter"
"""The requirement that holds only while the controller's clock is right, and the fault of that clock."""
BIAS_M_S2 = MISMATCH["mismatch_bias_g"] * STANDARD_GRAVITY_M_S2
RATIO_STEP = 0.03
"""Largest step of the target's ratio, as a share."""
WALKS = 1000
"""The highest seed of a walk."""
PHASE = "scene.drive.phase_rad"
"""The crank's first angle; with a fault, `DELAY` varies the angle at which it comes."""
BIASES = "scene.sensors.striker_low.bias_m_s2", "scene.sensors.housing.bias_m_s2"
Ends = Callable[[float], tuple[float, float]]


def by_share(mismatch: str) -> Ends:
    """The range around a value by a campaign's mismatch, a share of the value."""
    return lambda value: ((1.0 - MISMATCH[mismatch]) * value, (1.0 + MISMATCH[mismatch]) * value)


def by_width(mismatch: str) -> Ends:
    """The range around a value by a campaign's mismatch, in the value's unit."""
    return lambda value: (value - MISMATCH[mismatch], value + MISMATCH[mismatch])


def noise(value: float) -> tuple[float, float]:
    """Half of the noise to twice of it."""
    return 0.5 * value, 2.0 * value


RANGES: Mapping[str, Ends] = {
    "scene.striker.spring_n_m": by_share("mismatch_spring"),
    "scene.striker.rest_length_m": by_width("mismatch_rest_length_m"),
    "scene.stop.position_m": by_width("mismatch_stop_m"),
    "scene.stop.restitution": by_width("mismatch_restitution"),
    "scene.friction.b_n_s_m": by_share("mismatch_damping"),
    "scene.friction.mu": by_share("mismatch_dry_friction"),
    "scene.friction.mu_s": by_share("mismatch_dry_friction"),
    PHASE: lambda _: (0.0, 2.0 * math.pi),
    **dict.fromkeys(BIASES, lambda _: (-BIAS_M_S2, BIAS_M_S2)),
    "scene.sensors.striker_low.noise_m_s2_rthz": noise,
    "scene.sensors.encoder.noise_rad_s": noise,
    "scene.gait.variability": lambda value: (0.0, value),
    "scene.gait.stance_share": lambda value: (value - 0.02, value + 0.02),
    "scene.gait.heel_strike_m_s2": lambda value: (0.5 * value, 1.5 * value),
}
"""What every default space varies of module and sensors, where the scene has it."""
TICKS = (0.0, 0.001, 0.002, 0.003, 0.004, 0.005)
SAMPLES = {"frames": ["Accelerometer"]}
DISTURBANCES = (
    ({"kind": "kick"}, Dimension("change_m_s", 0.0, -0.3, 0.3)),
    ({"kind": "dropped", **SAMPLES}, Dimension("duration_s", 0.0, choices=TICKS)),
    ({"kind": "corrupted", **SAMPLES}, Dimension("duration_s", 0.0, choices=TICKS)),
    ({"kind": "frozen", **SAMPLES}, Dimension("duration_s", 0.0, choices=(0.0, *TICKS[2:]))),
    ({"kind": "delayed", "duration_s": 0.1, **SAMPLES}, Dimension("delay_s", 0.0, choices=TICKS[:3])),
    ({"kind": "dropped", "frames": ["EncoderEstimates"]}, Dimension("duration_s", 0.0, choices=TICKS)),
    ({"kind": "dropped", "frames": ["DriveHeartbeat"]}, Dimension("duration_s", 0.0, choices=(0.0, 0.1))),
    (
        {"kind": "dropped", "frames": ["OperatorCommand"]},
        Dimension("duration_s", 0.0, choices=(0.0, 0.1, 0.2)),
    ),
    ({"kind": "paused", "process": "firmware"}, Dimension("duration_s", 0.0, choices=TICKS)),
    (
        {"kind": JITTER, "process": "firmware", "duration_s": 0.1},
        Dimension("largest_s", 0.0, 0.0, 0.003),
    ),
)
"""Faults beside the scenario's own, each with its size, up to what scenarios ride through; those that silence
the samples together. A fault of size 0 is left out."""
ON_MODELLED_BUS = (
    ({"kind": "bus-off", "node": "plant"}, Dimension("duration_s", 0.0, choices=TICKS)),
    ({"kind": "disturbed", **SAMPLES}, Dimension("duration_s", 0.0, choices=TICKS[:3])),
    (
        {"kind": "babbling", "can_id": 0x7FF, "period_s": 1e-4},
        Dimension("duration_s", 0.0, choices=(0.0, 0.1)),
    ),
)
"""Further faults, of a scenario with a modelled bus."""


def default_space(
    scenario: Scenario, document: dict[str, Any], chosen: tuple[int, ...], disturbed: bool
) -> Space:
    """The default space of a scenario's kind; `disturbed`: with disturbances beside its own faults."""
    dimensions = [*instants(scenario, disturbed), *sizes(scenario), *module(scenario, document)]
    optional: dict[str, tuple[int, str]] = {}
    if disturbed:
        without = JITTER if any(scenario.checks[one].requirement == RIGHT_CLOCK for one in chosen) else None
        for size, at, place, lines in disturbances(scenario, document, without):
            if not optional:
                dimensions.append(Dimension(INSTANT, 0.0, 0.0, window_s(scenario, at.low)[1] - at.high))
            dimensions += [size, at]
            optional[size.key] = place, lines
    return Space(scenario.name, document, tuple(dimensions), chosen, since_s(scenario), optional)


def instants(scenario: Scenario, disturbed: bool) -> Iterator[Dimension]:
    """The delay of the fault, as with several seeds.

    A fault that ends the motion may also come in the start, or in a stop. It may not where the scenario
    restricts the delay, so that its fault meets no impact, in a walk, whose start comes later, and where the
    checks judge the hold.
    """
    since = since_s(scenario)
    if not (since > 0.0 and scenario.longest_delay_s > 0.0):
        return
    asked_s = [one.at_s for one in scenario.commands if one.at_s < since]
    is_ridden = not scenario.faults or any(check.name in RIDDEN_THROUGH for check in scenario.checks)
    is_bound = "longest_delay_s" in scenario.document["script"] or scenario.scene.gait is not None
    if is_ridden or is_bound or not disturbed or not asked_s:
        yield Dimension(DELAY, 0.0, 0.0, scenario.longest_delay_s)
        return
    yield Dimension(DELAY, 0.0, min(max(asked_s) + IN_START_S - since, 0.0), scenario.longest_delay_s)
    limit_s = max((one.bounds.high or 0.0 for one in scenario.checks if one.name == TORQUE_ENDS), default=0.0)
    if 0.0 < limit_s <= SOON_S and all(one.request == "run" for one in scenario.commands):
        yield Dimension(IDLE, 0.0, choices=IDLE_BEFORE_S)


def first_run_s(scenario: Scenario) -> float:
    """The time at which the operator first asks for motion."""
    return min((one.at_s for one in scenario.commands if one.target_ratio), default=0.0)


def since_s(scenario: Scenario) -> float:
    """The time of the first fault, or without one of the last command."""
    return min((one.at_s for one in scenario.faults), default=0.0) or max(
        (one.at_s for one in scenario.commands), default=0.0
    )


def sizes(scenario: Scenario) -> Iterator[Dimension]:
    """The sizes of faults, up to the scenario's own, where smaller ones keep its checks; kicks both ways."""
    if not any(check.name in OF_ANY_SIZE for check in scenario.checks):
        return
    for place, fault in enumerate(scenario.faults):
        for key in MILDER:
            value = getattr(fault, key, None)
            if value:
                ends = sorted((-value if key == "change_m_s" else MILDEST * value, value))
                yield Dimension(f"script.faults.{place}.{key}", value, *ends)


def module(scenario: Scenario, document: Mapping[str, Any]) -> Iterator[Dimension]:
    """The module and its sensors' errors as campaigns sample them, noise, and the crank's first angle."""
    for key, ends_of in RANGES.items():
        value = value_at(scenario, document, key)
        varies = not scenario.faults if key == PHASE else value or key in BIASES
        if value is not None and varies:
            yield Dimension(key, value, *ends_of(value))
    if scenario.scene.gait is not None:
        yield Dimension(SEED, scenario.seed, 0, WALKS)


def value_at(scenario: Scenario, document: Mapping[str, Any], key: str) -> Any:
    """The value at a dotted key of the scenario's tables, or its default in scene and parameters, or None."""
    first, *rest = key.split(".")
    checked: Any = {"scene": scenario.scene, "firmware": scenario.config.p}.get(first)
    found: Any = document.get(first)
    for name in rest:
        table = dict(enumerate(found)) if isinstance(found, list) else found
        place = int(name) if isinstance(found, list) and name.isdecimal() else name
        found = table.get(place) if isinstance(table, Mapping) else None
        checked = getattr(checked, name, None)
    return checked if found is None else found


def window_s(scenario: Scenario, run_s: float) -> tuple[float, float]:
    """When disturbances come: none before the operator asks for motion."""
    if scenario.faults:
        from_s = max(min(one.at_s for one in scenario.faults), first_run_s(scenario))
        return from_s, min(from_s + WINDOW_S, scenario.duration_s - WINDOW_S / 10.0)
    later_s = [one.at_s for one in scenario.commands if one.at_s > run_s]
    return run_s, run_s + WINDOW_SHARE * (max(later_s, default=scenario.duration_s) - run_s)


def disturbances(
    scenario: Scenario, document: dict[str, Any], without: str | None
) -> Iterator[tuple[Dimension, Dimension, int, str]]:
    """Add disturbances to the script: size and instant of each, its place, and the list that it is in.

    None loses frames that the scenario loses for good: it would act on nothing. `without`: a kind that
    is left out, the jitter where the detector is judged.
    """
    runs = [one for one in document["script"].get("commands", []) if one["request"] == "run"]
    if not runs:
        return
    window = window_s(scenario, runs[-1]["at_s"])
    script = document["script"] = {"faults": [], **deepcopy(dict(document["script"]))}
    ratio = runs[-1]["target_ratio"]
    step = Dimension("target_ratio", ratio, (1.0 - RATIO_STEP) * ratio, (1.0 + RATIO_STEP) * ratio)
    lost = [one["frames"] for one in script["faults"] if "frames" in one and "duration_s" not in one]
    all_of = DISTURBANCES if scenario.bitrate is None else DISTURBANCES + ON_MODELLED_BUS
    kept = [one for one in all_of if one[0]["kind"] != without and one[0].get("frames") not in lost]
    added = [("faults", *one) for one in kept]
    for name, table, size in (*added, ("commands", runs[-1], step)):
        place = len(script[name])
        script[name].append({**table, "at_s": window[0], size.key: size.default})
        key = f"script.{name}.{place}"
        at = Dimension(f"{key}.at_s", window[0], window[0], window[0] + MEET_S)
        yield replace(size, key=f"{key}.{size.key}"), at, place, name
