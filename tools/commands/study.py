"""`vibrohil study`: the paper's diagrams, basins and claims, feasibility for a walk."""

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import typer

from tools.commands.options import Json, Scheduler, Workers, number, unfold
from tools.commands.places import file_option, folder_option
from tools.commands.study_branches import boundaries, branches
from tools.output import answer, console, table_of

if TYPE_CHECKING:
    from tools.study.basin import Basin
    from tools.study.branches.saddle import Portrait
    from tools.study.work import Where

Found = TypeVar("Found")

study = typer.Typer(
    name="study",
    help=(
        "The paper's diagrams, basins and claims, and feasibility for a walk.\n\n"
        "The work runs on this machine's cores, or with --scheduler on a Dask cluster. The results are "
        "the same."
    ),
    no_args_is_help=True,
)

LARGEST_MAP = 4000

Preset = Annotated[
    Literal["table1", "gait"], typer.Option(help="table1 (as printed) or gait (retuned to 4 Hz).")
]
Law = Annotated[Literal["viscous", "coulomb", "stribeck"], typer.Option(help="The friction law.")]
Value = Annotated[float | None, number("b in N s/m, or μ; by default the preset's.", low=0.0)]
Amplitude = Annotated[float | None, number("Drive amplitude A in m; by default the preset's.", low=0.0)]
Ratio = Annotated[float, number("Speed ratio r = Ω/ω.", low=1e-6)]


@dataclass(frozen=True)
class StudyOptions:
    """Options that all studies share."""

    out: Annotated[Path, folder_option("Folder of figures and results; a killed study continues there.")] = (
        Path("studies")
    )
    workers: Workers = None
    scheduler: Scheduler = None
    as_json: Json = False

    def compute(self, computed: "Callable[[Where], Found]") -> tuple[Found, float]:
        """Compute a study, and measure its wall time."""
        from tools.study import work

        where, begun_s = work.Where(self.out, self.workers, self.scheduler), time.perf_counter()
        found = computed(where)
        return found, time.perf_counter() - begun_s

    def answer(
        self, result: Mapping[str, Any], wall_s: float, show: Callable[[], None] | None = None
    ) -> None:
        """Print the result and its cost, without `show` as tables."""
        answer({**result, "wall_s": wall_s, "out": str(self.out)}, self.as_json, show)


@study.command()
@unfold
def sweep(
    preset: Annotated[Literal["table1", "gait", "both"], typer.Option(help="table1, gait or both.")] = "both",
    law: Annotated[
        Literal["viscous", "coulomb", "stribeck", "all"],
        typer.Option(help="viscous, coulomb, stribeck or all."),
    ] = "all",
    amplitude: Amplitude = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="One friction parameter per law instead of Table 1's ranges.")
    ] = False,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Amplitude–frequency diagrams, run-up and run-down; 50 s per ratio, the first 30 s discarded."""
    from dataclasses import replace

    from tools.study import cases, figures
    from tools.study.sweep import diagrams

    presets = cases.PRESETS if preset == "both" else (preset,)
    laws = cases.LAWS if law == "all" else (law,)
    chosen = [cases.case(p, one) for p in presets for one in laws]
    if not quick:
        chosen = cases.whole_range(presets, laws)
    if amplitude is not None:
        chosen = [replace(case, amplitude_m=amplitude) for case in chosen]
    found, wall_s = common.compute(lambda where: diagrams(chosen, where))
    pictures = []
    for name in presets:
        own = {law: cases.case(name, law) for law in laws}
        shown = [d for d in found if replace(d.case, amplitude_m=own[d.case.law].amplitude_m) in own.values()]
        if shown:
            only = "" if law == "all" else f"-{law}"
            at = "" if amplitude is None else f"-{1e3 * amplitude:.12g}mm"
            pictures += figures.amplitude_frequency(shown, common.out, f"sweep-{name}{only}{at}")
    result = {"regimes": [diagram.as_json() for diagram in found], "figures": pictures}
    common.answer(result, wall_s)


@study.command()
@unfold
def basin(
    preset: Preset = "table1",
    law: Law = "viscous",
    value: Value = None,
    amplitude: Amplitude = None,
    ratio: Ratio = 1.3,
    plane: Annotated[
        Literal["state", "phase", "both"],
        typer.Option(help="state: (x0, v0); phase: (x0, crank angle); both."),
    ] = "both",
    size: Annotated[int, typer.Option(help="Cells along a side.", min=2, max=LARGEST_MAP)] = 200,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Basins of attraction: which starts at full speed end in impacts, and how sharp the boundary is."""
    from tools.study import basin as basins
    from tools.study import cases, figures
    from tools.study.branches import saddle

    case = cases.case(preset, law, value, **({} if amplitude is None else {"amplitude_m": amplitude}))
    planes = basins.PLANES if plane == "both" else (plane,)

    def computed(where: "Where") -> "tuple[list[Basin], Portrait | None]":
        maps = [basins.compute(case, ratio, one, size, where) for one in planes]
        return maps, saddle.portrait(case.scene(ratio)) if "state" in planes else None

    (found, portrait), wall_s = common.compute(computed)
    pictures = [
        path
        for one in found
        for path in figures.basin(one, common.out, portrait if one.plane == "state" else None)
    ]
    common.answer({"basins": [one.as_json() for one in found], "figures": pictures}, wall_s)


@study.command()
@unfold
def portrait(preset: Preset = "table1", common: StudyOptions = StudyOptions()) -> None:
    """Time histories and phase portraits of both attractors for each friction law."""
    from tools.study import cases, figures
    from tools.study.portraits import both_motions
    from tools.study.sweep import diagrams

    chosen = [cases.case(preset, law) for law in cases.LAWS]
    pairs, wall_s = common.compute(lambda where: [*map(both_motions, diagrams(chosen, where))])
    result = {
        "portraits": [
            {
                "law": impact.case.law,
                "parameters": impact.case.parameters(),
                "impact_r": impact.ratio,
                "non_impact_r": non_impact.ratio,
            }
            for impact, non_impact in pairs
        ],
        "figures": figures.portraits(pairs, common.out, f"portrait-{preset}"),
    }
    common.answer(result, wall_s)


@study.command()
@unfold
def claims(
    page: Annotated[
        Path | None, file_option("The page to write; by default claims.md in the folder of results.")
    ] = None,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Test the paper's fourteen claims: verdict, figures and reason of each, on a page."""
    from tools.study.claims import page as pages
    from tools.study.claims.claims import judge
    from tools.study.claims.evidence import Evidence

    judged, wall_s = common.compute(lambda where: judge(Evidence(where)))
    written = page or common.out / "claims.md"
    pages.write(judged, written)
    table = table_of(
        ("claim", "the paper says", "verdict"), ((one.id, one.statement, one.verdict) for one in judged)
    )
    result = {"claims": [asdict(claim) for claim in judged], "page": str(written)}
    common.answer(result, wall_s, lambda: console.print(table))


@study.command()
@unfold
def feasibility(
    preset: Annotated[
        Literal["table1", "gait", "walking", "all"], typer.Option(help="table1, gait, walking or all.")
    ] = "all",
    common: StudyOptions = StudyOptions(),
) -> None:
    """Find the settings that suit a walk (cadence, axis, guide, contact, wearer), and the first failure."""
    from collections import Counter

    from tools.study import feasibility as table

    presets = tuple(table.MODULES) if preset == "all" else (preset,)
    rows, wall_s = common.compute(lambda where: table.compute(where, presets))
    cells = common.out / ("feasibility.csv" if preset == "all" else f"feasibility-{preset}.csv")
    table.write_cells(rows, cells)
    counts = {
        one: dict(Counter(row["verdict"] for row in rows if row["preset"] == one).most_common())
        for one in presets
    }
    result = {"feasibility": rows, "verdicts": counts, "cells": str(cells)}
    common.answer(result, wall_s)


study.command()(branches)
study.command()(boundaries)
