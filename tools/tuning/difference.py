"""The differences of two parameter files, and their effect on scenarios of the suite."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_py.shell.parameters import BY_NAME, DEFAULTS
from hil.judge.figures.records import CATALOGUE, value_of
from hil.scenario.parameter_file import read_document, values_of
from hil.scenario.scenario import load_scenario
from tools.progress import Progress
from tools.tuning.safety import SEED, verdict_on

SCENARIOS = ("soft-start-multistable", "quick-start-below-the-band", "e-stop-in-the-hold")
"""A start into the multistable band and its hold, a quick start, and an emergency stop."""
OF_THE_MACHINE = (
    *("realtime_factor", "tick_us", "wake_us", "work_us", "loops.", "overruns", "baseline", "memory"),
    *("ticks", "late_wakeups", "long_work", "energy_residual", "real_time"),
)
"""Beginnings of the names of figures that describe the bench; no parameter of the firmware affects them."""
LEAST_CHANGE = 0.005
"""Smallest relative change of a figure that is listed."""


@dataclass(frozen=True)
class Change:
    """A parameter's values in both files; if a file does not name the parameter, its value is the default."""

    name: str
    unit: str
    a: float
    b: float
    named_in_a: bool
    named_in_b: bool

    @property
    def relative(self) -> float | None:
        """(b − a)/a; None where a is 0."""
        return None if self.a == 0.0 else self.b / self.a - 1.0


def difference(a: Path, b: Path) -> dict[str, Any]:
    """The JSON object of `tune diff`: differing parameters, equal parameters, figures of merit of both."""
    documents = [read_document(path) for path in (a, b)]
    values_a, values_b = map(values_of, documents, (a, b))
    changed, same = [], []
    for name in sorted({*values_a, *values_b}):
        change = Change(
            name=name,
            unit=BY_NAME[name].unit,
            a=values_a.get(name, DEFAULTS[name]),
            b=values_b.get(name, DEFAULTS[name]),
            named_in_a=name in values_a,
            named_in_b=name in values_b,
        )
        if change.a == change.b:
            same.append(name)
        else:
            changed.append({**vars(change), "relative": change.relative})
    merits_a, merits_b = (document.get("figures_of_merit", {}) for document in documents)
    return {
        "a": str(a),
        "b": str(b),
        "equal": not changed,
        "changed": changed,
        "same": same,
        "figures_of_merit": {
            name: {
                "unit": (merits_a.get(name) or merits_b[name])["unit"],
                "a": merits_a.get(name, {}).get("value"),
                "b": merits_b.get(name, {}).get("value"),
            }
            for name in sorted({*merits_a, *merits_b})
        },
        "safe": {
            side: document.get("tuning", {}).get("safe")
            for side, document in zip("ab", documents, strict=True)
        },
    }


# --- on the suite -------------------------------------------------------------------------------------


def effects(
    a: Path, b: Path, scenarios: Sequence[str] = SCENARIOS, progress: Progress = lambda *_: None
) -> list[dict[str, Any]]:
    """Run each scenario in lockstep with either file: verdicts, failed checks and differing figures."""
    found = []
    for number, name in enumerate(scenarios):
        sides = {}
        for place, (side, path) in enumerate({"a": a, "b": b}.items()):
            before = (number + 0.5 * place) / len(scenarios)

            def reported(share: float, _: str, name: str = name, before: float = before) -> None:
                progress(before + 0.5 * share / len(scenarios), name)

            sides[side] = verdict_on(load_scenario(name, (), [path]), SEED, reported)
        found.append(
            {
                "scenario": name,
                "passed": {side: bool(one["passed"]) for side, one in sides.items()},
                "failed": {
                    side: [check["name"] for check in one["checks"] if not check["passed"]]
                    for side, one in sides.items()
                },
                "figures": _differing(sides["a"], sides["b"]),
            }
        )
    return found


def _differing(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The figures that are numbers in both verdicts and differ by more than `LEAST_CHANGE`."""
    found = {}
    for name in CATALOGUE:
        if name.startswith(OF_THE_MACHINE):
            continue
        one, other = value_of(a, name), value_of(b, name)
        numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in (one, other))
        if numbers and abs(other - one) > LEAST_CHANGE * max(abs(one), abs(other)):
            found[name] = {"unit": CATALOGUE[name].unit, "a": one, "b": other}
    return found
