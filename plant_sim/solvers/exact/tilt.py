"""Removal of a constant tilt from a scene, so that level solvers are exact, and its restoration in a result.

m (x'' + g sin α) + c (x − l0 − x_A) = F is the level module's equation with l0' = l0 − m g sin α / c. Only
the energies differ: with F0 = m g sin α the drive's work is larger by F0 Δx_A, the housing's is −F0 Δx, and
the stored energy is larger by F0 s − F0² / 2c at the stretch s = l0 + x_A − x; its change is smaller by
F0 (Δx − Δx_A).
"""

import math
from dataclasses import replace

from plant_sim.parts.housing import Level, Tilted
from plant_sim.parts.parts import Parts
from plant_sim.result import MotionState, SimulationResult


def remove_tilt(parts: Parts) -> Parts:
    """The level module with the same motion; parts without a tilt are returned unchanged."""
    if not isinstance(parts.housing, Tilted):
        return parts
    striker = parts.striker
    sag_m = striker.mass_kg * parts.housing.along_m_s2 / striker.spring_n_per_m
    return parts._replace(
        striker=striker._replace(rest_length_m=striker.rest_length_m - sag_m), housing=Level()
    )


def restore_tilt(result: SimulationResult, parts: Parts, start: MotionState) -> SimulationResult:
    """The result of `remove_tilt(parts)` with the energies of `parts`."""
    if not isinstance(parts.housing, Tilted):
        return result
    striker, energy, final = parts.striker, result.energy, result.final
    weight_n = striker.mass_kg * parts.housing.along_m_s2
    before_m, after_m = (parts.drive.amplitude_m * math.sin(one.crank_rad) for one in (start, final))
    piston_m, rise_m = after_m - before_m, final.x_m - start.x_m
    stretch_m, sag_m = striker.rest_length_m + after_m - final.x_m, weight_n / striker.spring_n_per_m
    return replace(
        result,
        energy=replace(
            energy,
            drive_work_j=energy.drive_work_j + weight_n * piston_m,
            stored_change_j=energy.stored_change_j - weight_n * (rise_m - piston_m),
            housing_work_j=-weight_n * rise_m,
            stored_j=energy.stored_j + weight_n * (stretch_m - 0.5 * sag_m),
        ),
    )
