"""Ramps that were tried: failures and capture time against the rise, a line for each second try."""

from collections.abc import Sequence
from pathlib import Path

from tools.tuning.result import Tuning
from tools.tuning.start import AGAIN, OVERSHOOT, RISE, Ramp


def draw_start(tuning: Tuning, tried: Sequence[Ramp], path: Path) -> None:
    """Draw into an SVG or PNG."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, (failures, blows, capture) = plt.subplots(1, 3, figsize=(14.0, 4.4), layout="constrained")
    for again_s in sorted({one.parameters[AGAIN] for one in tried}):
        mine = [one for one in tried if one.parameters[AGAIN] == again_s]
        rises = [one.parameters[RISE] for one in mine]
        label = f"second try {again_s:g} s"
        failures.plot(rises, [100.0 * one.failures / max(one.eligible, 1) for one in mine], "o-", label=label)
        blows.plot(rises, [one.overshoot for one in mine], "o-", label=label)
        capture.plot(rises, [one.capture_p95_s for one in mine], "o-", label=label)
    blows.axhline(OVERSHOOT, color="black", lw=0.8, ls="--")
    failures.set(ylabel="starts that fail [%]", title="reliability")
    blows.set(ylabel="largest blow on the way, of the steady one", title="overshoot")
    capture.set(ylabel="95 % are captured within [s]", title="time")
    for axes in (failures, blows, capture):
        axes.axvline(tuning.parameters[RISE].value, color="tab:green", alpha=0.5)
        axes.set_xlabel("rise [s]")
        axes.grid(alpha=0.3)
    failures.legend(fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)
