"""`vibrohil study`: the paper's diagrams, basins and claims, feasibility for a walk, one pulse a stride."""

import shutil
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from tools.commands.design.study_output import (
    StudyJob,
    caption_of,
    chosen_case,
    figure_of,
    is_nominal,
    show_sweep,
)
from tools.commands.options import Json, number, unfolded
from tools.output import console, figure_table, table_of
from tools.outputs import RECORDINGS, file_option, folder_option

study = typer.Typer(
    name="study",
    help=(
        "The paper's diagrams, basins and claims, feasibility for a walk, and one pulse a stride.\n\n"
        "The work runs on this machine's cores, or with --scheduler on a Dask cluster. Kernels run in "
        "threads, because they release the interpreter's lock and are compiled once for all cores. Closed "
        "loops with the firmware (basin --start soft) run in processes. The results are the same."
    ),
    no_args_is_help=True,
)

Rrd = Annotated[
    Path | None, file_option("Write an animation to one .rrd file; open it with view.", RECORDINGS)
]
LARGEST_MAP = 4000
INSTANT_SIZE, SOFT_SIZE = 200, 40

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
    cores: Annotated[
        int | None, typer.Option(help="Number of cores of this machine; by default all.", min=1)
    ] = None
    scheduler: Annotated[
        str | None,
        typer.Option(help="Address of a Dask scheduler whose workers compute, e.g. tcp://host:8786."),
    ] = None
    as_json: Json = False

    def job(self) -> StudyJob:
        """The study with these options."""
        return StudyJob(self.out, self.cores, self.scheduler, self.as_json)


@study.command()
@unfolded
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
    rrd: Rrd = None,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Amplitude–frequency diagrams, run-up and run-down; 50 s per ratio, the first 30 s discarded."""
    from dataclasses import replace

    from tools.study import cases, figures, recordings
    from tools.study.sweep import diagrams

    presets = cases.PRESETS if preset == "both" else (preset,)
    laws = cases.LAWS if law == "all" else (law,)
    chosen = [cases.case(p, one) for p in presets for one in laws]
    if not quick:
        chosen = cases.whole_range(presets, laws)
    if amplitude is not None:
        chosen = [replace(case, amplitude_m=amplitude) for case in chosen]
    job = common.job()
    job.warm(chosen)
    with job.computing():
        found = diagrams(chosen, job.where)
    pictures = []
    for name in presets:
        shown = [d for d in found if d.case.preset == name and is_nominal(d.case)]
        if shown:
            pictures += figures.amplitude_frequency(shown, common.out, f"sweep-{name}")
    pictures += figures.regime_bars(found, common.out, "regimes")
    if rrd is not None:
        recordings.sweeps([d for d in found if is_nominal(d.case)], rrd)
    result = {
        "regimes": [diagram.as_json() for diagram in found],
        "figures": pictures,
        "rrd": rrd and str(rrd),
    }
    job.answer(result, lambda: show_sweep(found))


@study.command()
@unfolded
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
    start: Annotated[
        Literal["instant", "soft"],
        typer.Option(
            help="instant: the crank starts at speed; soft: the firmware starts it, in closed loop."
        ),
    ] = "instant",
    size: Annotated[
        int | None,
        typer.Option(
            help="Cells along a side; 200, or 40 with --start soft, by default.", min=2, max=LARGEST_MAP
        ),
    ] = None,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Basins of attraction: which starts end in impacts, and how sharp the boundary is.

    With --start soft a cell counts as impact if the firmware is in mode RUN with lasting impacts 30 s after
    the request. Motor, sensors and soft stop are those of the bench's default scene. The result of an
    instant start of the same module stands beside it.
    """
    from tools.study import basin as basins
    from tools.study import figures, soft_start

    case = chosen_case(preset, law, value, amplitude)
    planes = basins.PLANES if plane == "both" else (plane,)
    soft = start == "soft"
    size = size or (SOFT_SIZE if soft else INSTANT_SIZE)
    job = common.job()
    if not soft:
        job.warm([case])
    compute = soft_start.compute if soft else basins.compute
    with job.computing():
        found = [compute(case, ratio, one, size, job.where) for one in planes]
    pictures = [path for one in found for path in figures.basin(one, caption_of(one), common.out)]

    def show() -> None:
        for one in found:
            rows = [(name.replace("_", " "), figure_of(value), "") for name, value in one.statistics.items()]
            title = f"{case.label}, Ω/ω = {ratio:g}, plane {one.plane}, {one.start} start"
            console.print(figure_table(title, rows))

    job.answer({"basins": [one.as_json() for one in found], "figures": pictures}, show)


@study.command("map")
@unfolded
def chart(
    over: Annotated[
        Literal["r,A", "r,mu", "r,b", "r,k"], typer.Option(help="The axes: r and a second parameter.")
    ] = "r,A",
    preset: Preset = "table1",
    law: Law = "viscous",
    value: Value = None,
    amplitude: Amplitude = None,
    size: Annotated[int, typer.Option(help="Cells along a side.", min=2, max=LARGEST_MAP)] = 60,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Maps over two parameters: the regime, and the share of starts that end in impacts."""
    import numpy as np
    import pyarrow as pa

    from tools.study import figures, maps, store, work

    case = chosen_case(preset, law, value, amplitude)
    second = over.removeprefix("r,")
    maps.check(case, second)
    job = common.job()
    job.warm([case])
    with job.computing():
        paths = work.run("map", maps.piece, maps.specs(case, second, size), job.where)
    table = pa.concat_tables([store.read(path)[0] for path in paths])
    reliability, regimes, from_rest = (
        np.asarray(table[name].to_numpy(zero_copy_only=False)).reshape(size, size)
        for name in ("reliability", "regime", "from_rest")
    )
    ratios, values = maps.axes(second, size)
    label = maps.SECOND[second][3]
    name = f"map-{preset}-{law}-r-{second}"
    spec = {"case": case.parameters(), "second": second, "size": size}
    store.write(common.out / f"{name}.parquet", table, spec, {})
    summary: dict[str, Any] = {
        "over": ["r", second],
        "preset": preset,
        "parameters": case.parameters(),
        "r": [float(ratios[0]), float(ratios[-1])],
        "values": [float(values[0]), float(values[-1])],
        "size": size,
        "starts": maps.STARTS,
        "share_with_impact": float((reliability > 0.0).mean()),
        "share_certain_of_impacts": float((reliability == 1.0).mean()),
    }
    pictures = figures.chart(case, label, ratios, values, reliability, regimes, from_rest, common.out, name)
    rows = [
        ("cells with impact motion", 100.0 * summary["share_with_impact"], "%"),
        ("cells where every start ends in impacts", 100.0 * summary["share_certain_of_impacts"], "%"),
    ]
    job.answer(
        {"map": summary, "figures": pictures},
        lambda: console.print(figure_table(f"{case.label}, over r and {second}", rows)),
    )


@study.command()
@unfolded
def portrait(preset: Preset = "table1", rrd: Rrd = None, common: StudyOptions = StudyOptions()) -> None:
    """Time histories and phase portraits of both attractors for each friction law."""
    from tools.study import cases, figures, recordings, store
    from tools.study.portraits import as_table, pair
    from tools.study.sweep import diagrams

    chosen = [cases.case(preset, law) for law in cases.LAWS]
    job = common.job()
    job.warm(chosen)
    with job.computing():
        pairs = [pair(diagram) for diagram in diagrams(chosen, job.where)]
    samples = common.out / f"portrait-{preset}.parquet"
    store.write(samples, as_table(pairs), {"cases": [case.parameters() for case in chosen]}, {})
    if rrd is not None:
        recordings.portraits(pairs, rrd)
    result = {
        "portraits": [
            {
                "law": both.case.law,
                "parameters": both.case.parameters(),
                "impact_r": both.impact and both.impact.ratio,
                "non_impact_r": both.non_impact and both.non_impact.ratio,
            }
            for both in pairs
        ],
        "figures": figures.portraits(pairs, common.out, f"portrait-{preset}"),
        "samples": str(samples),
        "rrd": rrd and str(rrd),
    }
    job.answer(result, lambda: None)


@study.command()
@unfolded
def claims(
    page: Annotated[
        Path | None, file_option("The page to write; by default claims.md in the folder of results.")
    ] = None,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Test the paper's fourteen claims: verdict, figures and reason of each, on a page."""
    from dataclasses import replace

    from tools.study import cases, figures
    from tools.study.claims import page as pages
    from tools.study.claims.claims import judge
    from tools.study.claims.evidence import CONTACTS_S, Evidence
    from tools.study.portraits import pair

    rigid = [cases.case("table1", law) for law in cases.LAWS]
    job = common.job()
    job.warm([*rigid, replace(rigid[0], contact_s=CONTACTS_S[0])])
    with job.computing():
        evidence = Evidence(job.where)
        judged = judge(evidence)
    pictures = figures.regime_bars(evidence.diagrams, common.out, "regimes")
    for preset in cases.PRESETS:
        nominal = evidence.nominal(preset)
        pictures += figures.amplitude_frequency(nominal, common.out, f"sweep-{preset}")
        pictures += figures.portraits(
            [pair(diagram) for diagram in nominal], common.out, f"portrait-{preset}"
        )
    for law in ("viscous", "coulomb"):
        one = evidence.basin(law)
        caption = f"{100 * one.statistics['impact_fraction']:.1f} % end in impacts"
        pictures += figures.basin(one, caption, common.out)
    written = page or common.out / "claims.md"
    pages.write(judged, written)
    table = table_of(
        ("claim", "the paper says", "verdict"), ((one.id, one.statement, one.verdict) for one in judged)
    )
    result = {"claims": [asdict(claim) for claim in judged], "page": str(written), "figures": pictures}
    job.answer(result, lambda: console.print(table))


@study.command()
@unfolded
def feasibility(
    preset: Annotated[
        Literal["table1", "gait", "walking", "all"], typer.Option(help="table1, gait, walking or all.")
    ] = "all",
    page: Annotated[
        Path | None, file_option("The page to write; by default feasibility.md in the folder of results.")
    ] = None,
    common: StudyOptions = StudyOptions(),
) -> None:
    """Find the settings that suit a walk (cadence, axis, guide, contact, wearer), and the first failure."""
    from collections import Counter

    from tools.study import store
    from tools.study.feasibility import feasibility as table
    from tools.study.feasibility import page as feasibility_page

    presets = tuple(table.MODULES) if preset == "all" else (preset,)
    job = common.job()
    with job.computing():
        found = table.compute(job.where, presets)
    name = "feasibility" if preset == "all" else f"feasibility-{preset}"
    store.write(common.out / f"{name}.parquet", found, {"presets": list(presets)}, {})
    rows = found.to_pylist()
    pictures = feasibility_page.chart(rows, common.out, name)
    written = page or common.out / f"{name}.md"
    if page is not None:
        pictures.append(shutil.copy(pictures[0], str(page.with_suffix(".svg"))))
    feasibility_page.write(rows, written, written.with_suffix(".svg").name)
    counts = {
        one: dict(Counter(row["verdict"] for row in rows if row["preset"] == one).most_common())
        for one in presets
    }
    shown = table_of(
        ("preset", "cells", *table.REASONS),
        (
            (one, str(sum(of_one.values())), *(str(of_one.get(reason, 0)) for reason in table.REASONS))
            for one, of_one in counts.items()
        ),
    )
    result = {"feasibility": rows, "verdicts": counts, "page": str(written), "figures": pictures}
    job.answer(result, lambda: console.print(shown))


@study.command()
@unfolded
def pulse(
    way: Annotated[
        Literal["turn", "subharmonic", "gated", "all"], typer.Option(help="turn, subharmonic, gated or all.")
    ] = "all",
    common: StudyOptions = StudyOptions(),
) -> None:
    """Compare ways to give one pulse a stride: one turn a stride, subharmonics, or a resting crank."""
    from tools.study import store
    from tools.study.pulse import figures
    from tools.study.pulse.judging import SUBHARMONIC, WAYS
    from tools.study.pulse.orbits import bands_of, orbits_found
    from tools.study.pulse.ways import compute

    chosen = WAYS if way == "all" else (way,)
    job = common.job()
    with job.computing():
        orbits = orbits_found(job.where).to_pylist() if SUBHARMONIC in chosen else []
        found = compute(job.where, chosen)
    name = "pulse" if way == "all" else f"pulse-{way}"
    store.write(common.out / f"{name}.parquet", found, {"ways": list(chosen)}, {})
    rows, bands = found.to_pylist(), bands_of(orbits)

    def show() -> None:
        if bands:
            console.print(figures.bands_table(bands))
        console.print(figures.rows_table(rows))

    result = {
        "pulse": rows,
        "bands": [band._asdict() for band in bands],
        "figures": figures.chart(rows, bands, common.out, name),
    }
    job.answer(result, show)
