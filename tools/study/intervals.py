"""Unions of closed intervals of the ratio r, ascending and disjoint."""

from itertools import pairwise

Interval = tuple[float, float]


def contains(union: list[Interval], value: float) -> bool:
    """Return whether one of the intervals contains the value."""
    return any(low <= value <= high for low, high in union)


def symmetric_difference(one: list[Interval], other: list[Interval]) -> list[Interval]:
    """Return the intervals that belong to exactly one of the two unions.

    >>> symmetric_difference([(0.8, 1.4)], [(0.7, 1.1)])
    [(0.7, 0.8), (1.1, 1.4)]
    """
    cuts = sorted({cut for union in (one, other) for interval in union for cut in interval})
    found: list[Interval] = []
    for low, high in pairwise(cuts):
        middle = 0.5 * (low + high)
        if contains(one, middle) != contains(other, middle):
            adjoins = bool(found) and found[-1][1] == low
            found.append((found.pop()[0] if adjoins else low, high))
    return found


def width(union: list[Interval]) -> float:
    """Return the total length of the intervals."""
    return sum(high - low for low, high in union)
