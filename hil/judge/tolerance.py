"""Tolerances within which a figure of two runs counts as equal."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from hil.scenario.checks import size_of


class Tolerance(NamedTuple):
    """Largest change that counts as none: `absolute` in the figure's unit, or `relative` to the value."""

    absolute: float
    relative: float

    def holds(self, before: Any, after: Any) -> bool:
        """Whether two values count as equal; words, truth values and missing values must be the same.

        >>> Tolerance(0.0, 0.01).holds(100.0, 100.5), Tolerance(0.1, 0.0).holds(100.0, 100.5)
        (True, False)
        """
        if before == after:
            return True
        if not all(isinstance(one, int | float) and not isinstance(one, bool) for one in (before, after)):
            return False
        if math.isnan(before) and math.isnan(after):
            return True
        return math.isclose(before, after, rel_tol=self.relative, abs_tol=self.absolute)


ROUNDING = Tolerance(1e-12, 1e-9)
"""What rounding leaves, far below what any figure resolves."""
SHARE_OF_REQUIRED = 1e-3
"""A change by this share of the limit that a requirement sets means nothing."""


def tolerance_of(tolerances: Mapping[str, Tolerance], figure: str) -> Tolerance:
    """The figure's own tolerance, or that of all figures under the name `*`, or the default.

    The default is ROUNDING, or a thousandth of the limit that a requirement sets for the figure.

    >>> [tolerance_of({}, name).holds(1e-10, 1e-11) for name in ("energy_residual", "held_s")]
    [True, False]
    """
    default = ROUNDING._replace(absolute=max(ROUNDING.absolute, SHARE_OF_REQUIRED * size_of(figure)))
    return tolerances.get(figure, tolerances.get("*", default))


def tolerances_from(settings: Iterable[str], figures: Iterable[str]) -> dict[str, Tolerance]:
    """Read settings of the form FIGURE=ABSOLUTE[,RELATIVE]; raises ValueError.

    >>> tolerances_from(["largest_v_m_s=0.001,0.01"], ["largest_v_m_s"])
    {'largest_v_m_s': Tolerance(absolute=0.001, relative=0.01)}
    """
    known = {*figures, "*"}
    found: dict[str, Tolerance] = {}
    for setting in settings:
        figure, _, numbers = setting.partition("=")
        try:
            absolute, relative = map(float, f"{numbers},0".split(",")[:2])
        except ValueError:
            absolute = relative = math.nan
        if not (0.0 <= absolute < math.inf and 0.0 <= relative < math.inf and numbers.count(",") < 2):
            raise ValueError(f"{setting}: wanted FIGURE=ABSOLUTE[,RELATIVE], two numbers from 0 on")
        if figure not in known:
            raise ValueError(
                f"{setting}: there is no figure {figure}; docs/reference/figures.md lists them, * is all"
            )
        found[figure] = Tolerance(absolute, relative)
    return found
