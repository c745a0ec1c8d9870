"""Makes docs/worst-cases.md: the smallest margin found for each requirement, its scenario, and a picture.

    python -m tools.dev.worst_cases [--runs N]

Sobol points of each scenario, as many as it takes for N runs of each safety and performance requirement with
limits, and a fifth of N at least; then N / 10 runs of CMA-ES for each of them, in the scenario with the
smallest margin. An interrupted search continues, and so does one with a larger N.
"""

import argparse
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from hil.scenario.checks import requirements
from hil.scenario.scenario import load_scenario
from tools import jobs
from tools.dev.command_page import row, table
from tools.falsify.counterexample import shrink
from tools.falsify.evaluations import Evaluations, folder_of, runner
from tools.falsify.pictures import draw_instant
from tools.falsify.search import Best, EndedError, Hunt, Start, Target, adapt, score, sobol
from tools.falsify.space import Space
from tools.falsify.space_of_scenario import STEADY, space_of
from tools.plots import drawn
from tools.progress import shown_progress

DOCS = Path(__file__).parents[2] / "docs"
PAGE, PICTURE = DOCS / "worst-cases.md", DOCS / "pictures/worst-cases.png"
SCENARIOS = (
    "a-kick-towards-the-stop-does-not-lose-the-impacts",
    "twenty-lost-samples-do-not-stop-it",
    "a-bus-off-of-ten-ticks-is-ridden-through",
    "a-controller-whose-clock-jitters-goes-on",
    "a-violent-kick-stops-the-motor",
    "a-violent-kick-into-a-weak-stop-stops-the-motor",
    "a-silent-encoder-stops-the-motor",
    "a-jammed-crank-is-let-go-of",
    "lost-operator-commands-stop-the-motor",
    "damaged-parameters-arm-nothing",
    "e-stop-in-the-hold",
    "an-e-stop-in-the-start-ends-the-torque",
    "an-impact-beyond-its-limit-on-a-soft-stop-ends-the-torque",
    "an-impact-beyond-the-limit-of-the-force-ends-the-torque",
    "an-idle-in-the-start-ends-in-a-stop",
    "quick-start-below-the-band",
    "soft-start-multistable",
    "at-r-0.6-it-never-reaches-the-stop",
    "a-crank-that-the-striker-drives-is-waited-for",
    "a-swing-that-grows-is-waited-for",
    "an-impulse-asked-for-is-held",
    "a-walker-who-stops-gets-no-more-pulses",
    "a-fifth-more-strides-keep-the-impacts",
    "a-start-against-friction-ends-in-a-refusal",
)
"""Together they have every requirement with limits."""
ONLY = {"a-swing-that-grows-is-waited-for": ("S-14",)}
"""The requirements that count in a scenario whose module is at the edge of what the others allow."""
SEED, COLUMNS = 1, 3
LEAST_SHARE, ADAPTED_SHARE = 0.2, 0.1
"""Shares of the runs of a requirement: the fewest Sobol points of a scenario, and those of CMA-ES."""


class Worst(NamedTuple):
    """The run with a requirement's smallest margin, and the number of judged runs that have a check of it."""

    best: Best
    runs: int


def searched() -> list[Space]:
    """The spaces of all scenarios."""
    return [space_of(name, ONLY.get(name, ())) for name in SCENARIOS]


def worst_of(requirement: str, evaluations: Evaluations, starts: Mapping[str, Start]) -> Worst | None:
    """The smallest margin of a requirement's checks in all judged runs; 1 where none gives a direction."""
    found = [
        Best(score(result, check), starts[name].space, values, check)
        for (name, values), result in evaluations.known.items()
        if not result.why
        for check, one in enumerate(starts[name].space.checks)
        if one.requirement == requirement
    ]
    runs = {(one.space.name, one.values) for one in found}
    return Worst(min(found, key=lambda one: one.margin), len(runs)) if found else None


def shares(spaces: Sequence[Space], wanted: Sequence[str], runs: int) -> list[int]:
    """The runs of each space with which every wanted requirement has `runs`, in the least simulated time."""
    proved = [{check.requirement for check in space.checks} for space in spaces]
    if missing := [key for key in wanted if not any(key in some for some in proved)]:
        raise ValueError(f"no scenario has a check of {', '.join(missing)}; add one to SCENARIOS")
    has = np.array([[requirement in some for some in proved] for requirement in wanted], float)
    durations_s = [load_scenario(space.name).duration_s for space in spaces]
    bounds = LEAST_SHARE * runs, None
    found = linprog(durations_s, A_ub=-has, b_ub=np.full(len(wanted), -runs), bounds=bounds)
    assert found.x is not None
    return [math.ceil(round(share, 6)) for share in found.x]


def search_all(spaces: Sequence[Space], runs: int, evaluations: Evaluations) -> dict[str, Worst | None]:
    """The worst run for each requirement with limits, by Sobol points and then CMA-ES."""
    wanted = [key for key, one in requirements().items() if key.startswith(STEADY) and one.limits]
    starts: dict[str, Start] = {}
    for space, share in zip(spaces, shares(spaces, wanted, runs), strict=True):
        places = sobol(space, share, SEED)
        values = [space.values(place.tolist()) for place in places]
        results = evaluations.results(space, values, space.name)
        starts[space.name] = Start(space, places, results)
    adapted = math.ceil(ADAPTED_SHARE * runs)
    for requirement in wanted:
        worst = worst_of(requirement, evaluations, starts)
        if worst is None or not 0.0 <= worst.best.margin < 1.0:
            continue
        space, check = worst.best.space, worst.best.check
        _, places, results = starts[space.name]
        order = sorted(range(len(results)), key=lambda k: score(results[k], check))
        try:
            adapt(Hunt(requirement, evaluations, adapted), Target(space, check, places[order]), SEED)
        except EndedError:
            continue
    return {requirement: worst_of(requirement, evaluations, starts) for requirement in wanted}


def rows_of(found: Mapping[str, Worst | None]) -> Iterator[str]:
    """A row for each requirement."""
    shown = ""
    for requirement, worst in found.items():
        if worst is None:
            yield row(requirement, "—", "0", "", "", "")
            continue
        best, runs = worst
        changed = best.space.changed(best.values).items() if best.margin < 0.0 else ()
        values = ", ".join(f"`{key}` {value:.3g}" for key, value in changed)
        values, shown = ("as above" if values and values == shown else values), values or shown
        margin = f"**{best.margin:.1%}**" if best.margin < 0.0 else f"{best.margin:.0%}"
        yield row(requirement, margin, f"{runs:,}", f"`{best.name}`", f"`{best.space.name}`", values)


def text_of(found: Mapping[str, Worst | None], runs: int, judged: int) -> str:
    """The page; `runs`: the number of searched runs, of which `judged` were judged."""
    parts = (
        "# Worst cases",
        "<!-- made by `python -m tools.dev.worst_cases` -->",
        f"The smallest margin that {judged:,} judged runs of a search have shown for each requirement, as a "
        "share of its limit; below 0 % it is broken. A text shows 100 %, or −100 % once it is broken. "
        f"Runs that were not judged: {runs - judged:,}. "
        "[Campaigns](campaigns.md#search-for-the-worst-run) says what varies. *Runs*: the judged ones with a "
        "check of the requirement.",
        table(["requirement", "smallest margin", "runs", "figure", "scenario", "values"], rows_of(found)),
        "Lost or corrupted samples hide up to 1,300 N where the impulse has no limit (S-01 to S-03, S-11); "
        "the default one ends it 9 ms after the touch-down. A guide that rubs eight times as much, and 27 % "
        "more before, holds the crank 3 % below its target (P-07). Two walks of 3,000, both with seed 566, "
        "end as a quicker stride passes for a stumble (P-01, P-09 to P-11).",
        "![The worst run of each requirement around its instant](pictures/worst-cases.png)",
    )
    return "\n\n".join(parts) + "\n"


def draw(found: Mapping[str, Worst | None]) -> None:
    """Draw the worst run of each requirement with a margin."""
    shown = [(name, one.best) for name, one in found.items() if one is not None and one.best.margin < 1.0]
    rows = math.ceil(len(shown) / COLUMNS)
    with drawn(PICTURE, 4.6 * COLUMNS, 2.6 * rows) as figure:
        axes = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
        for place, (name, best) in zip(axes, shown, strict=False):
            draw_instant(best, place)
            place.set_title(f"{name}: {place.get_title()}", fontsize=7)
        for place in axes[len(shown) :]:
            place.set_visible(False)


def main() -> None:
    """Search, and write page and picture."""
    parser = argparse.ArgumentParser(prog="python -m tools.dev.worst_cases", description=__doc__)
    parser.add_argument("--runs", type=int, default=64, help="runs for each requirement")
    runs = parser.parse_args().runs
    spaces = searched()
    with jobs.pool(runner(spaces)) as run, shown_progress() as progress:
        evaluations = Evaluations(folder_of(spaces), run, progress)
        found = search_all(spaces, runs, evaluations)
        judged = sum(not one.why for one in evaluations.known.values())
        page_of = partial(text_of, runs=len(evaluations.known), judged=judged)
        for requirement, worst in found.items():
            if worst is not None and worst.best.margin < 0.0:
                found[requirement] = Worst(shrink(worst.best, evaluations), worst.runs)
    PAGE.write_text(page_of(found), encoding="utf-8")
    draw(found)


if __name__ == "__main__":
    main()
