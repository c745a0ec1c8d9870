"""`vibrohil study`: the paper's diagrams, basins and claims."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.table import Table

from tools.output import BadInputError, console, figure_table, print_json

if TYPE_CHECKING:
    from tools.study.cases import Case
    from tools.study.sweep import Diagram

study = typer.Typer(
    name="study",
    help="The paper's diagrams, basins and claims; whole ranges of parameters in seconds.",
    no_args_is_help=True,
)

Out = Annotated[Path, typer.Option(help="Folder of figures and results; a killed study goes on there.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object.")]
Cores = Annotated[int | None, typer.Option(help="Threads on this machine; all cores by default.")]
Scheduler = Annotated[
    str | None, typer.Option(help="Address of a Dask scheduler whose workers compute, e.g. tcp://host:8786.")
]
Preset = Annotated[str, typer.Option(help="table1 (as printed) or gait (retuned to 4 Hz).")]
Law = Annotated[str, typer.Option(help="viscous, coulomb or stribeck.")]
Value = Annotated[float | None, typer.Option(help="b in N s/m, or μ; the preset's own by default.")]
Amplitude = Annotated[float | None, typer.Option(help="Drive amplitude A in m; the preset's own by default.")]
Ratio = Annotated[float, typer.Option(help="Ω/ω.")]

DEFAULT_OUT = Path("studies")


def register(app: typer.Typer) -> None:
    """Add the commands to the program."""
    app.add_typer(study)


class Stopwatch:
    """Wall and processor time of this process since it was made."""

    def __init__(self) -> None:
        self.wall_s, self.cpu_s = time.perf_counter(), time.process_time()

    def read(self) -> dict[str, float]:
        """Keys of the commands' JSON."""
        return {"wall_s": time.perf_counter() - self.wall_s, "cpu_s": time.process_time() - self.cpu_s}


@study.command()
def sweep(
    preset: Annotated[str, typer.Option(help="table1, gait or both.")] = "both",
    law: Annotated[str, typer.Option(help="viscous, coulomb, stribeck or all.")] = "all",
    amplitude: Amplitude = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="One friction parameter per law instead of Table 1's ranges.")
    ] = False,
    out: Out = DEFAULT_OUT,
    cores: Cores = None,
    scheduler: Scheduler = None,
    as_json: Json = False,
) -> None:
    """Amplitude–frequency diagrams, run-up and run-down, 50 s a ratio with 30 s discarded."""
    from dataclasses import replace

    from tools.study import cases, figures, work
    from tools.study.orbits import warm
    from tools.study.sweep import diagrams

    presets = cases.PRESETS if preset == "both" else (one_of("--preset", preset, cases.PRESETS),)
    laws = cases.LAWS if law == "all" else (one_of("--law", law, cases.LAWS),)
    chosen = [cases.case(p, one) for p in presets for one in laws]
    if not quick:
        chosen = cases.whole_range(presets, laws)
    if amplitude is not None:
        chosen = [replace(case, amplitude_m=amplitude_m(amplitude)) for case in chosen]
    where = work.here(out, cores, scheduler)
    compile_s = 0.0 if scheduler else warm(chosen)
    clock = Stopwatch()
    found = diagrams(chosen, where)
    cost = clock.read()
    pictures = []
    for name in presets:
        shown = [d for d in found if d.case.preset == name and is_nominal(d.case)]
        if shown:
            pictures += figures.amplitude_frequency(shown, out, f"sweep-{name}")
    pictures += figures.regime_bars(found, out, "regimes")
    payload = {
        "regimes": [diagram.as_json() for diagram in found],
        **cost,
        "compile_s": compile_s,
        "cores": where.cores,
        "figures": pictures,
        "out": str(out),
    }
    if as_json:
        print_json(payload)
    else:
        show_sweep(found, payload)


def is_nominal(case: "Case") -> bool:
    """Whether the friction parameter is the preset's own."""
    from tools.study import cases

    own = cases.case(case.preset, case.law)
    return (case.b_n_s_m, case.mu) == (own.b_n_s_m, own.mu)


def show_sweep(found: "list[Diagram]", payload: dict[str, Any]) -> None:
    """Print a row per case."""
    table = Table(title="where the striker strikes, in Ω/ω", title_justify="left", box=None)
    for name in ("preset", "friction", "run-up", "run-down", "multistable", "ends by"):
        table.add_column(name)
    for diagram in found:
        kinds = sorted({edge.kind for edge in (*diagram.up.edges, *diagram.down.edges)})
        table.add_row(
            diagram.case.preset,
            diagram.case.label,
            intervals(diagram.up.striking()),
            intervals(diagram.down.striking()),
            intervals(diagram.multistable()),
            ", ".join(kinds) or "—",
        )
    console.print(table)
    show_cost(payload)


def intervals(union: list[tuple[float, float]]) -> str:
    """For people."""
    return ", ".join(f"{low:.3f}–{high:.3f}" for low, high in union) or "nowhere"


def show_cost(payload: dict[str, Any]) -> None:
    """Print what it took and where it is."""
    rows = [
        ("computing", payload["wall_s"], "s"),
        ("of processor time", payload["cpu_s"], "s"),
        ("compiling or loading kernels", payload["compile_s"], "s"),
        ("figures and results in", payload["out"], ""),
    ]
    console.print(figure_table("", rows))


def one_of(option: str, given: str, known: tuple[str, ...]) -> str:
    """A known word."""
    if given not in known:
        raise BadInputError(f"{option} is {given!r}: wanted one of {', '.join(known)}")
    return given


def amplitude_m(given: float) -> float:
    """A usable drive amplitude."""
    if not 0.0 <= given < float("inf"):
        raise BadInputError(f"--amplitude is {given}: wanted metres, 0 or more, e.g. 0.02")
    return given
