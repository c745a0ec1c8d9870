"""A scenario in which the module rests: the quickest there is."""

from pathlib import Path

RESTS = """
title = "It rests"
scene = "table1-motor-soft"
[script]
duration_s = {duration_s}
[[checks]]
name = "impact_count"
low = {fewest}
high = 9.0
"""


def resting(folder: Path, name: str = "rests", duration_s: float = 0.3, fewest: float = 0.0) -> Path:
    """The scenario's file; it fails where `fewest` impacts are more than none."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.toml"
    path.write_text(RESTS.format(duration_s=duration_s, fewest=fewest))
    return path
