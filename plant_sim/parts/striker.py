"""The striker: a mass on the coupling spring."""

from typing import NamedTuple


class Striker(NamedTuple):
    """m_B x'' + c (x − l0 − x_A) = F_f + F_stop.

    `gravity_m_s2` is what presses on the guide, across the axis: it enters dry friction only.
    """

    mass_kg: float
    spring_n_m: float
    rest_length_m: float
    gravity_m_s2: float
