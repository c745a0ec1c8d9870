"""The limits that a scenario's checks take from the requirements which they name.

A requirement's limit may be a multiple of a quantity of the scenario, so that it suits every module, and may
apply only under conditions. A scenario may demand more than the requirement, never less.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from firmware_py.core.config import Config
from firmware_py.core.conflicts import nominal_rad_s
from firmware_py.interface.generated.parameters import Drive, Friction, Stop, Striker
from hil.faults.fault import Fault
from hil.faults.kinds.clock_jitter import ClockJitter
from hil.faults.kinds.kick import Kick
from hil.faults.kinds.paused import Paused
from hil.figures.records import CATALOGUE
from hil.scenario.checks import Bounds, Check, requirements
from hil.scenario.commands import Command
from plant_sim.scene import Scene
from text_input import TextInputError


class Judged(NamedTuple):
    """What limits depend on: a scenario's module, firmware and script, and the checks as written."""

    scene: Scene
    config: Config
    commands: Sequence[Command]
    faults: Sequence[Fault]
    checks: Sequence[Check]


def target_rad_s(judged: Judged) -> float:
    """The crank speed that the script last asks for."""
    in_order = sorted(judged.commands, key=lambda command: command.at_s)
    ratios = [command.target_ratio for command in in_order if command.target_ratio]
    return nominal_rad_s(judged.config.p) * (ratios[-1] if ratios else math.nan)


def target_impulse_n_s(judged: Judged) -> float:
    """The impulse of an impact that the script last asks for."""
    asked = [command.target_impulse_n_s for command in judged.commands if command.target_impulse_n_s]
    return asked[-1] if asked else math.nan


def drive_torque_n_m(judged: Judged) -> float:
    """The largest torque of the drive at its current limit."""
    motor = judged.scene.motor
    return math.nan if motor is None else motor.torque_constant_n_m_a * motor.current_limit_a


def free_crank_rad_s(judged: Judged) -> float:
    """The speed of the crank that takes all energy of the striker, from the overspeed limit on.

    J Ω² / 2 grows by the energy of the spring with the striker at the stop, c (x_stop − l0 + A)² / 2, and by
    that of the script's kicks, m Δv² / 2.
    """
    scene, overspeed_rad_s = judged.scene, judged.config.p.limit.overspeed_rad_s
    if scene.motor is None:
        return math.nan
    stop_m = scene.striker.rest_length_m if scene.stop.law == "none" else scene.stop.position_m
    stretch_m = abs(stop_m - scene.striker.rest_length_m) + scene.drive.amplitude_m
    kicks = sum(fault.change_m_s**2 for fault in judged.faults if isinstance(fault, Kick))
    twice_j = scene.striker.spring_n_m * stretch_m**2 + scene.striker.mass_kg * kicks
    return math.sqrt(overspeed_rad_s**2 + twice_j / scene.motor.inertia_kg_m2)


def late_ticks(judged: Judged) -> int:
    """The most control periods by which the script makes the controller late: its pauses and its jitter."""
    own = [fault for fault in judged.faults if getattr(fault, "process", "") == "firmware"]
    paused_s = sum(fault.duration_s for fault in own if isinstance(fault, Paused))
    jitter_s = max((fault.largest_s for fault in own if isinstance(fault, ClockJitter)), default=0.0)
    return math.ceil(round((paused_s + jitter_s) / judged.config.tick_s, 6))


SCALES: Mapping[str, Callable[[Judged], float]] = {
    one.__name__: one for one in (target_rad_s, target_impulse_n_s, drive_torque_n_m, free_crank_rad_s)
}
"""Quantities of which a limit may be a multiple, beside the values of `firmware.` and `scene.`."""


def look_up(judged: Judged, key: str) -> Any:
    """A value of the scenario's firmware or scene by its dotted key; None where a part is not there."""
    first, *names = key.split(".")
    place: Any = {"firmware": judged.config.p, "scene": judged.scene}[first]
    for name in names:
        place = getattr(place, name, None)
    return place


DESCRIBED = tuple(
    f"{table.__name__.lower()}.{name}" for table in (Striker, Drive, Stop, Friction) for name in table._fields
)
"""The parameters that describe the module's mechanics, with the same keys in `firmware.` and `scene.`."""
TOLERATED_SHARES = {
    "striker.spring_n_m": 0.02,
    "striker.mass_kg": 0.05,
    "friction.b_n_s_m": 0.3,
    "friction.mu": 0.1,
}
"""How much of these parameters a module may differ by from the firmware's."""
TOLERATED_WIDTHS = {"striker.rest_length_m": 1e-3, "stop.position_m": 3e-4, "stop.restitution": 0.05}
"""The same in the parameter's unit; the others are to be equal. Spring and mass share one tolerance:
2 % softer and 5 % heavier at once gives a ripple of 0.56 %."""
WHOLE_COUNTS_RAD_S = 0.02
"""Distance from a speed of whole counts within which the ripple is larger: measured, 0.13 % at its end."""


def is_nearly_described(judged: Judged) -> bool:
    """Whether the firmware's parameters differ from the scene's module, and by no more than P-04 permits."""
    used = {}
    for key in DESCRIBED:
        if key == "stop.contact_s" and judged.scene.stop.law == "rigid":
            continue
        firmware, scene = (float(look_up(judged, f"{side}.{key}") or 0.0) for side in ("firmware", "scene"))
        if not math.isclose(firmware, scene, rel_tol=1e-6):
            width = TOLERATED_WIDTHS.get(key, 0.0) + TOLERATED_SHARES.get(key, 0.0) * abs(firmware)
            used[key] = abs(scene - firmware) / width if width else math.inf
    load = used.get("striker.spring_n_m", 0.0) + used.get("striker.mass_kg", 0.0)
    return bool(used) and max(load, *used.values()) <= 1.0 + 1e-6


def turns_by_whole_counts(judged: Judged) -> bool:
    """Whether the crank's target is a whole number of the encoder's counts in a control period.

    Each reading then has almost the same fraction of a count as the one before.
    """
    encoder = judged.scene.sensors and judged.scene.sensors.encoder
    if not encoder:
        return False
    count_rad_s = 2.0 * math.pi / encoder.counts / judged.config.tick_s
    return abs(math.remainder(target_rad_s(judged), count_rad_s)) <= WHOLE_COUNTS_RAD_S


def holds(key: str, wanted: Any, judged: Judged) -> bool:
    """Whether a condition of a limit holds.

    `kind`: the script has a fault of this kind. `frames`: its first fault is limited to these.
    `nearly_described`, `whole_counts`: see `is_nearly_described` and `turns_by_whole_counts`. A figure's
    name: a check of the scenario demands this value. Otherwise a dotted key of `scene.` or `firmware.` has
    this value.
    """
    if key == "kind":
        return any(fault.kind == wanted for fault in judged.faults)
    if key == "frames":
        return any(set(fault.as_record().frames) == {wanted} for fault in judged.faults[:1])
    if key == "nearly_described":
        return is_nearly_described(judged) is wanted
    if key == "whole_counts":
        return turns_by_whole_counts(judged) is wanted
    if key in CATALOGUE:
        return any(check.name == key and check.equals == wanted for check in judged.checks)
    return bool(look_up(judged, key) == wanted)


def required_bounds(check: Check, judged: Judged) -> Bounds | None:
    """The limit that the check's requirement has for its figure in this scenario; raises TextInputError."""
    if check.requirement is None:
        return None
    applying = [
        limit
        for limit in requirements()[check.requirement].limits_of(check.name)
        if all(holds(key, wanted, judged) for key, wanted in limit.when.items())
    ]
    if not applying:
        return None
    limit = applying[-1]
    scale = 1.0 if limit.of is None else quantity(limit.of, check, judged)
    low, high = (None if one is None else scale * one for one in (limit.low, limit.high))
    ticks = limit.ticks + late_ticks(judged) if limit.ticks else 0
    later_s = check.shows_after_s + ticks * judged.config.tick_s
    if high is not None and later_s > 0.0:
        high = round(high + later_s, 9)  # whole nanoseconds, as the figure
    return Bounds(low=low, high=high, equals=limit.equals)


def quantity(name: str, check: Check, judged: Judged) -> float:
    """The quantity of which a limit is a multiple; raises TextInputError if a scenario does not have it."""
    value = SCALES[name](judged) if name in SCALES else look_up(judged, name)
    if value is None or not math.isfinite(value):
        raise TextInputError(
            f"check {check.name!r}: its requirement {check.requirement} limits it to a multiple of {name}, "
            "which this scenario does not have; add that, or leave the check out"
        )
    return float(value)


def without_own_limit(check: Check) -> dict[str, Any]:
    """A check's table with the limit of its requirement, if that has one: its own suits its module alone."""
    table = check.model_dump(exclude_defaults=True, exclude_none=True, exclude={"required"})
    if check.required is None:
        return table
    return {key: value for key, value in table.items() if key not in ("low", "high", "equals")}


def permits_more(own: Bounds, required: Bounds) -> bool:
    """Whether a scenario's own limit permits a value that the requirement does not."""
    if required.equals is not None or isinstance(own.equals, str):
        return own != Bounds() and own.equals != required.equals
    low = -math.inf if required.low is None else required.low
    high = math.inf if required.high is None else required.high
    given = [one for one in (own.low, own.high, own.equals) if one is not None]
    return not all(low <= float(one) <= high for one in given)


def take_limit(check: Check, judged: Judged) -> Check:
    """The check with the limit of its requirement; raises TextInputError if its own permits more."""
    required = required_bounds(check, judged)
    if required is None and check.own == Bounds():
        raise TextInputError(
            f"check {check.name!r} has no limit, and {check.requirement} has none of this figure in such a "
            "scenario; give low, high or both, or equals"
        )
    if required is not None and permits_more(check.own, required):
        form = "g" if check.own.text != required.text else ".12g"
        raise TextInputError(
            f"check {check.name!r} permits {check.own.written(form)}, and its requirement "
            f"{check.requirement} only {required.written(form)}; leave the limit out, or give a stricter one"
        )
    taken = check.model_copy(update={"required": required})
    if cannot_fail(taken):
        raise TextInputError(
            f"check {check.name!r} permits {taken.limit}, and no value of this figure is outside of that; "
            "give a limit that a run can miss, or leave the check out"
        )
    return taken


def cannot_fail(check: Check) -> bool:
    """Whether every value that the check's figure can have is within the limit."""
    bounds = check.bounds
    if bounds.equals is not None or check.expression is not None:
        return False
    lowest, highest = CATALOGUE[check.name].range
    return (bounds.low is None or bounds.low <= lowest) and (bounds.high is None or bounds.high >= highest)


def take_limits(judged: Judged) -> tuple[Check, ...]:
    """The scenario's checks with the limits of their requirements; raises TextInputError, a line an error."""
    taken, errors = [], []
    for check in judged.checks:
        try:
            taken.append(take_limit(check, judged))
        except TextInputError as error:
            errors.append(str(error))
    if errors:
        raise TextInputError("\n".join(errors))
    return tuple(taken)
