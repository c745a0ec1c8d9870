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
def piston_and_lever_m(
    linkage: Linkage, amplitude_m: float, sine: float, cosine: float
) -> tuple[float, float]:
    """x_A and dx_A/dθ, m, from sin θ and cos θ. The endless rod, linear in them, has a series."""
    if is_endless(linkage):
        return amplitude_m * sine, amplitude_m * cosine
    across = amplitude_m * cosine
    along = math.sqrt(linkage.rod_m * linkage.rod_m - across * across)
    # √(L² − a²) − L = −a² / (L + √(L² − a²)), without the difference of two near numbers
    piston_m = amplitude_m * sine - across * across / (linkage.rod_m + along)
    return piston_m, across * (1.0 + amplitude_m * sine / along)


@subroutine(inline=True)
def piston_m(linkage: Linkage, amplitude_m: float, theta_rad: float) -> float:
    """x_A, m."""
    return piston_and_lever_m(linkage, amplitude_m, math.sin(theta_rad), math.cos(theta_rad))[0]


@subroutine(inline=True)
def crank_torque_n_m(linkage: Linkage, force_n: float, amplitude_m: float, theta_rad: float) -> float:
    """F dx_A/dθ, N m: the crank's torque for a force F on the piston along +x."""
    return force_n * piston_and_lever_m(linkage, amplitude_m, math.sin(theta_rad), math.cos(theta_rad))[1]


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
