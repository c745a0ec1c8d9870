"""A module by the firmware's parameters: its scene, its steady impacts at a speed, and campaigns on it.

The steady impacts are those of the plant alone, whose crank is led. A campaign samples a module within the
intervals of its parameter file.
"""

import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from firmware_py.shell.parameters import BY_NAME, ParameterError, with_overrides
from hil.scenario.parameter_file import read_document, values_of
from plant_sim.scene import Scene, load_scene
from tools.campaign.reference import HELD_S, JUDGED_S, RAMP_S, SLOWEST, goes_on, simulate_alone, state_at
from tools.output import BadInputError
from tools.tuning.result import Value

PER_TURN = 0.9
"""Impacts a turn in a hold, at least."""
WIDTHS = {
    "striker.spring_n_m": ("mismatch_spring", True),
    "drive.amplitude_m": ("mismatch_amplitude", True),
    "friction.b_n_s_m": ("mismatch_damping", True),
    "friction.mu": ("mismatch_dry_friction", True),
    "stop.position_m": ("mismatch_stop_m", False),
    "stop.restitution": ("mismatch_restitution", False),
}
"""The campaign's half-width for each parameter, and whether it is a share of the value."""
NOT_OF_A_TWIN = ("wiring.", "crank.")
"""Beginnings of the parameters of the real module's wiring and encoder, which its twin has not."""


def scene_of(values: Mapping[str, float]) -> dict[str, Any]:
    """The scene of a module with these parameters; what they do not have is the default motor's."""
    friction: dict[str, Any] = {"law": "viscous", "b_n_s_m": values["friction.b_n_s_m"]}
    if values["friction.mu"] > 0.0:
        friction = {"law": "coulomb", "mu": values["friction.mu"], "b_n_s_m": values["friction.b_n_s_m"]}
    return {
        "striker": {name: values[f"striker.{name}"] for name in ("mass_kg", "spring_n_m", "rest_length_m")},
        "drive": {"model": "motor", "amplitude_m": values["drive.amplitude_m"]},
        "friction": friction,
        "stop": {
            "law": "hunt-crossley",
            **{name: values[f"stop.{name}"] for name in ("position_m", "restitution", "contact_s")},
        },
        "motor": {
            "inertia_kg_m2": values["motor.inertia_kg_m2"],
            "viscous_n_m_s": values["motor.viscous_n_m_s"],
            "dry_n_m": values["motor.dry_n_m"],
        },
        "initial": {"x_m": values["striker.rest_length_m"], "v_m_s": 0.0},
        "sensors": {},
    }


class Orbit(NamedTuple):
    """Steady impacts, one a turn: their approach speed, peak force, and the crank's angle past its forward
    dead centre."""

    approach_speed_m_s: float
    peak_force_n: float
    phase_deg: float


def steady_orbit(scene: Scene, ratio: float) -> Orbit | None:
    """The impacts at a ratio to the natural frequency after a slow rise of the speed; None if they end."""
    omega_rad_s, until_s = ratio * scene.natural_rad_s, RAMP_S + HELD_S
    start = state_at(scene.striker.rest_length_m, 0.0, 0.0)
    found = simulate_alone(scene, start, SLOWEST * omega_rad_s, omega_rad_s, RAMP_S, until_s)
    late = found[found["t_s"] > until_s - JUDGED_S]
    per_turn = len(late) / (JUDGED_S * omega_rad_s / (2.0 * math.pi))
    if not goes_on(found["t_s"], until_s, omega_rad_s) or not PER_TURN <= per_turn <= 2.0 - PER_TURN:
        return None
    speed_m_s, force_n = (float(np.median(late[name])) for name in ("v_m_s", "peak_force_n"))
    angles = np.exp(1j * (late["crank_rad"] - 0.5 * math.pi))
    return Orbit(speed_m_s, force_n, math.degrees(float(np.angle(np.mean(angles)))))


def explain_no_hold(values: Mapping[str, float], ratio: float) -> str:
    """Why a module with these parameters cannot be held at a ratio; empty if it can."""
    orbit = steady_orbit(load_scene(scene_of(values)), ratio)
    if orbit is None:
        return f"with the parameters found no impacts last at a ratio of {ratio:g}: ask for a lower --ratio"
    if orbit.phase_deg > values["hold.highest_phase_deg"]:
        return (
            f"with the parameters found the impacts at a ratio of {ratio:g} come {orbit.phase_deg:.0f}° past "
            f"the dead centre, too near to their end: hold.highest_phase_deg is "
            f"{values['hold.highest_phase_deg']:g}°; ask for a lower --ratio"
        )
    return ""


def without_wiring(values: Mapping[str, float]) -> dict[str, float]:
    """The parameters for the firmware on the twin."""
    return {name: value for name, value in values.items() if not name.startswith(NOT_OF_A_TWIN)}


def settings_on_twin(parameters: Mapping[str, Value]) -> list[str]:
    """The settings KEY=VALUE of a campaign: the twin's scene, the firmware's parameters, the half-widths.

    The scene has the middles of the intervals, as far as the parameters permit these, so that the truth is
    anywhere within them. What has no interval has no width; neither has the rest length, the scale from which
    the stop is measured.
    """
    values = without_wiring({name: float(one.value) for name, one in parameters.items()})
    settings = [f"firmware.{name}={value!r}" for name, value in values.items()]
    middles, widths = {}, {"mismatch_rest_length_m": 0.0}
    for name, (key, is_share) in WIDTHS.items():
        widths[key] = 0.0
        if one := parameters.get(name):
            low, high = max(one.low, BY_NAME[name].low), min(one.high, BY_NAME[name].high)
            middle, half = 0.5 * (low + high), 0.5 * (high - low)
            middles[name] = float(middle)
            widths[key] = float(half / middle if is_share and middle else half)
    for table, keys in scene_of(with_overrides(values) | middles).items():
        settings += [f"scene.{table}.{key}={as_toml(value)}" for key, value in keys.items()]
    settings.append('campaign.laws=["viscous"]')  # one condition, whose friction the scene replaces
    return settings + [f"campaign.{key}={wide!r}" for key, wide in widths.items()]


def as_toml(value: Any) -> str:
    """A number or a word as TOML has it."""
    return f'"{value}"' if isinstance(value, str) else repr(value)


def refuse_other_axes(campaign: str, axes: Collection[str]) -> None:
    """Raise BadInputError for a campaign without friction laws, whose modules are its own."""
    if "laws" not in axes:
        raise BadInputError(
            f"--spread: the campaign {campaign} samples modules of its own; wanted start-up, estimate, "
            "detect, hold or recover"
        )


def read_spread(path: Path) -> list[str]:
    """The settings for a parameter file. Raises TextInputError or ParameterError."""
    document = read_document(path)
    tables = document["parameters"]
    return settings_on_twin(
        {
            name: interval_of(tables[name], value, f"{path}: {name}")
            for name, value in values_of(document, path).items()
        }
    )


def interval_of(entry: Mapping[str, Any], value: float, about: str) -> Value:
    """A value with its bounds, by default the value itself; the ParameterError begins with `about`."""
    low, high = (entry.get(key, value) for key in ("low", "high"))
    for key, bound in (("low", low), ("high", high)):
        if isinstance(bound, bool) or not isinstance(bound, int | float) or not math.isfinite(bound):
            raise ParameterError(f"{about} has {key} = {bound!r}; wanted a finite number")
    if not low <= value <= high:
        raise ParameterError(
            f"{about} = {value:g} has the interval {low:g} … {high:g}; wanted one around the value"
        )
    return Value(value, "", float(low), float(high))
