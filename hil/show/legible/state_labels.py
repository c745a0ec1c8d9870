"""Names in the state timelines of a finished log: as long as their interval is wide, so that none is cut.

Rerun cuts a name at the end of its interval. The entities below `/states` keep the states' own names; those
below `/timeline`, which the layout shows, have a shorter name or a dot where the interval is too narrow.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

WIDTH_PX = {"mode": 1240.0, "regime": 1240.0, "injected": 1240.0, "checks": 1240.0, "leg": 1240.0}
"""Widths of timelines that take the whole width of the layout, at 1280 × 800; others take half of it."""
HALF_PX = 600.0
CHARACTER_PX, PADDING_PX = 6.4, 10.0
CHECK = "check failed: "
UNNAMED = "·"
"""Label of an interval that is too narrow for a name; Rerun would replace an empty one by the state."""


class Shown(NamedTuple):
    """A state at the time when it begins, its label, and its colour."""

    t_s: float
    state: str
    label: str
    rgba: int


def shorter(state: str) -> list[str]:
    """Names of a state that may be shown, the longest first.

    >>> shorter("sensor-stuck (sensor striker)")
    ['sensor-stuck (sensor striker)', 'sensor-stuck']
    >>> shorter("check failed: regime is lost")
    ['check failed: regime is lost', 'regime']
    """
    short = state.removeprefix(CHECK).partition(" ")[0]
    return [state] if short == state else [state, short]


def fit(
    entity: str, changes: Sequence[tuple[float, str]], rgba: Mapping[str, int], end_s: float
) -> list[Shown]:
    """The changes of a state timeline, each with the longest label that fits until the next one."""
    width_px = WIDTH_PX.get(entity.rpartition("/")[2], HALF_PX)
    shown = []
    for (t_s, state), until_s in zip(changes, [*(t_s for t_s, _ in changes[1:]), end_s], strict=True):
        room_px = (until_s - t_s) / max(end_s, 1e-9) * width_px - PADDING_PX
        label = next((one for one in shorter(state) if len(one) * CHARACTER_PX <= room_px), UNNAMED)
        shown.append(Shown(t_s, state, label, rgba[state]))
    return shown
