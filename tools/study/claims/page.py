"""The page of the claims: verdict, reason and measured figures of each claim."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from hil.record.new_file import write_anew
from tools.output import NO_VALUE, figure
from tools.study import work
from tools.study.claims.claims import CONTRADICTED, REPRODUCED, UNDER_PARAMETERS, JudgedClaim

MEANING = {
    REPRODUCED: "all parts of the reason hold",
    UNDER_PARAMETERS: "some hold, each for values or readings that the paper leaves open",
    CONTRADICTED: "none holds, or the claim needs all of them",
}

INTRODUCTION = """\
# The paper's claims, measured

The claims of Jelačić & Jelačić (2026), doi 10.47001/IRJIET/2026.103016, tested by
`vibrohil study claims --page docs/claims.md`.

Two modules are tested. `table1` is Table 1 as printed: c = 70 N/m. The paper gives no amplitude; `table1`
has A = 20 mm with viscous friction and 30 mm with dry friction, which at 20 mm can hold the striker. `gait`
has c = 505 N/m and A = 12 mm, so that text and table agree on the frequency.

Both modules have m_B = 0.8 kg, l0 = 0.12 m, x_stop = 0.18 m, k = 0.5, and b = 0.2 N s/m or μ = 0.15.
Coulomb–Stribeck friction has μ_s = 4/3 μ, v_s = 0.05 m/s and δ = 1; the paper does not give these values
either. A sweep has 111 ratios r = Ω/ω from 0.7 to 1.8, upwards (run-up) and downwards (run-down). Each
ratio is held for 50 s, of which the first 30 s are discarded.
"""

FIGURES = """
## The paper's figures

| in the paper | here | command |
|---|---|---|
| Figure 1, the module | [mechanism](explanation/mechanism.svg) | |
| Figure 2, amplitude–frequency diagram | below | `vibrohil study sweep --preset table1` |
| Figure 3, phase portraits | below | `vibrohil study portrait` |
| 4.3, basins of attraction | [basin](explanation/basin.svg) | `vibrohil study basin --plane state` |

![Stroke over the speed ratio in run-up and run-down, for each friction law](pictures/sweep-table1.svg)

![Motion over time and phase portrait of both attractors, for each friction law](pictures/portraits.svg)
"""
MOST_IN_CELL = 8
"""Most figures in one cell of the page; `--json` has all."""
NUMBERS = """
| the paper's number | ours, by `vibrohil study claims` | claim |
|---|---|---|"""


def write(claims: Sequence[JudgedClaim], path: Path) -> None:
    """Write the page as Markdown."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_anew(path, "\n".join(lines(claims)) + "\n")


def lines(claims: Sequence[JudgedClaim]) -> Iterator[str]:
    """Yield the lines of the page."""
    yield INTRODUCTION
    yield "| claim | the paper says | verdict |"
    yield "|---|---|---|"
    for claim in claims:
        yield f"| [{claim.id}](#{claim.id.lower()}) | {claim.statement} | {claim.verdict} |"
    yield ""
    for verdict, meaning in MEANING.items():
        count = sum(claim.verdict == verdict for claim in claims)
        yield f"- **{verdict}**: {meaning}; {count} of {len(claims)}."
    yield FIGURES
    yield NUMBERS.lstrip()
    yield from _numbers({claim.id: claim.value for claim in claims})
    for claim in claims:
        yield from _section(claim)
    versions = ", ".join(f"{name} {number}" for name, number in work.versions().items())
    yield f"\nComputed with {versions}."


def _numbers(values: Mapping[str, Mapping[str, Any]]) -> Iterator[str]:
    """Yield the rows of the paper's numbers beside the measured ones, of the claims that are there."""

    def span(found: Iterable[float | None]) -> str:
        known = [one for one in found if one is not None and math.isfinite(one)]
        return f"{figure(min(known))} to {figure(max(known))}" if known else NO_VALUE

    def percent(share: float | None) -> str:
        return figure(None if share is None else 100.0 * share, "%")

    rows: dict[str, tuple[str, Callable[[Mapping[str, Any]], str]]] = {
        "C2": ("impacts begin at Ω/ω = 0.9 to 1.1", lambda value: span(value["onset_r"].values())),
        "C3": ("this is 3 to 5 Hz", lambda value: f"{span(value['r_0.9_to_1.1_hz'])} Hz"),
        "C7": (
            "peak forces of 10 to 40 N",
            lambda value: f"{span(one for peaks in value['peak_n'].values() for one in peaks.values())} N",
        ),
        "C8": ("impulses vary by less than 5 %", lambda value: percent(value["greatest_variation"])),
    }
    for name, (number, ours) in rows.items():
        if name in values:
            yield f"| {number} | {ours(values[name])} | [{name}](#{name.lower()}) |"


def _section(claim: JudgedClaim) -> Iterator[str]:
    yield f"\n## {claim.id}\n\n**{claim.verdict.capitalize()}.**\n\n{claim.reason}\n"
    if claim.judgement:
        yield f"Judgement: {claim.judgement}\n"
    yield "| measured | |"
    yield "|---|---|"
    for names, value in _flat(claim.value):
        if isinstance(value, Mapping) and len(value) > MOST_IN_CELL:
            continue
        yield f"| `{', '.join(names)}` | {_text(value)} |"


def _flat(value: Mapping[str, Any], above: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Yield figures with the names that lead to them; a mapping of plain figures is yielded as one value."""
    for key, item in value.items():
        names = (*above, key)
        if isinstance(item, Mapping) and any(isinstance(one, Mapping) for one in item.values()):
            yield from _flat(item, names)
        else:
            yield names, item


def _text(value: Any) -> str:
    if isinstance(value, Mapping):
        return "; ".join(f"{key}: {_text(item)}" for key, item in value.items())
    if isinstance(value, str):
        return value
    if isinstance(value, Iterable):
        return ", ".join(_text(item) for item in value) or "none"
    return figure(value)
