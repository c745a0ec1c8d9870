"""What changed between two parameter files."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from firmware_py.shell.parameters import BY_NAME, DEFAULTS
from hil.parameter_file import read_document, values_of


@dataclass(frozen=True)
class Change:
    """A parameter in both files; one that a file does not name has its default there."""

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
    """The JSON object of `tune diff`: parameters that differ, those that do not, figures of merit of both."""
    documents = [read_document(path) for path in (a, b)]
    values_a, values_b = (values_of(document, path) for document, path in zip(documents, (a, b), strict=True))
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
            "a": documents[0].get("tuning", {}).get("safe"),
            "b": documents[1].get("tuning", {}).get("safe"),
        },
    }
