"""The linkage of crank and piston: x_A(θ), and the crank's torque for a force on the piston.

Both follow from one function: a force F on the piston requires the torque F dx_A/dθ, so that F x_A' = T θ'
and energy is conserved between crank and piston.
"""

import math
from typing import NamedTuple, TypeAlias

from plant_sim.kernels import one_of, subroutine


class Sine(NamedTuple):
    """x_A = A sin θ: the paper's piston, moved by a Scotch yoke or an infinitely long rod."""


class SliderCrank(NamedTuple):
    """x_A = A sin θ + √(L² − A² cos² θ) − L: a rod of length L > A on a crank of radius A.

    The in-line slider–crank (Uicker, Pennock & Shigley, Theory of Machines and Mechanisms), by Pythagoras in
    the triangle of crank and rod. θ counts from mid-stroke, and the dead centres are ±A as the sine's.
    """

    rod_m: float


Linkage: TypeAlias = Sine | SliderCrank


is_endless = one_of(Sine)
"""Whether the rod has no length of its own: the piston follows a sine."""


@subroutine(inline=True)
def piston_m(linkage: Linkage, amplitude_m: float, theta_rad: float) -> float:
    """x_A, m."""
    if is_endless(linkage):
        return amplitude_m * math.sin(theta_rad)
    across = amplitude_m * math.cos(theta_rad)
    along = math.sqrt(linkage.rod_m * linkage.rod_m - across * across)
    # √(L² − a²) − L = −a² / (L + √(L² − a²)), without the difference of two near numbers
    return amplitude_m * math.sin(theta_rad) - across * across / (linkage.rod_m + along)


@subroutine(inline=True)
def crank_torque_n_m(linkage: Linkage, force_n: float, amplitude_m: float, theta_rad: float) -> float:
    """F dx_A/dθ, N m: the crank's torque for a force F on the piston along +x."""
    if is_endless(linkage):
        return force_n * amplitude_m * math.cos(theta_rad)
    across = amplitude_m * math.cos(theta_rad)
    along = math.sqrt(linkage.rod_m * linkage.rod_m - across * across)
    return force_n * across * (1.0 + amplitude_m * math.sin(theta_rad) / along)


@subroutine
def sine_at(linkage: Linkage, amplitude_m: float, level_m: float) -> float:
    """sin θ of the crank angles at which x_A = `level_m`; beyond ±1 if the piston never reaches it."""
    if is_endless(linkage):
        return level_m / amplitude_m
    # (s − A sin θ)² = L² − A² cos² θ with s = x_A + L: sin θ = (s² − L² + A²) / (2 A s)
    reach = level_m + linkage.rod_m
    if reach <= 0.0:
        return -math.inf
    raised = level_m * (level_m + 2.0 * linkage.rod_m) + amplitude_m * amplitude_m
    return raised / (2.0 * amplitude_m * reach)
