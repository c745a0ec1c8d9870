"""Scenes with values changed by dotted keys; DELETE deletes one. Parts that many tests put in."""

from typing import Any

from plant_sim.scene import read_scene, with_values

DELETE = None
HERTZ = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
KELVIN_VOIGT = {"law": "kelvin-voigt", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
TILT = {"housing.tilt_rad": 0.2}
SWING = {"housing.harmonic": {"amplitude_m_s2": 3.4, "frequency_hz": 1.0, "phase_rad": 0.3}}
KNOCK = {"housing.shock": {"peak_m_s2": 30.0, "start_s": 0.7, "duration_s": 0.05}}


def changed(name: str, changes: dict[str, Any]) -> dict[str, Any]:
    return with_values(read_scene(name), changes)
