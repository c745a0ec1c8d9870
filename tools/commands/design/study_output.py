"""Shared by the study commands: checked options, progress, output and storage."""

import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tools.output import console, figure, figure_table, print_json, table_of

if TYPE_CHECKING:
    from tools.study.basin import Basin
    from tools.study.cases import Case
    from tools.study.sweep import Diagram


class StudyJob:
    """One study from its options to its result: place of computation, cost and report."""

    def __init__(self, out: Path, cores: int | None, scheduler: str | None, as_json: bool) -> None:
        from tools.study import work

        self.where = work.here(out, cores, scheduler)
        self._as_json = as_json
        self._compile_s = 0.0
        self._cost: dict[str, float] = {}

    def warm(self, cases: "Sequence[Case]") -> None:
        """Compile or load the kernels of these modules before any clock starts, unless others compute."""
        from tools.study.orbits import warm

        if self.where.scheduler is None:
            self._compile_s = warm(cases)

    @contextmanager
    def computing(self) -> Iterator[None]:
        """Measure wall and processor time within the context, with that of ended child processes, in s."""
        wall_s, cpu_s = time.perf_counter(), sum(os.times()[:4])
        yield
        self._cost = {"wall_s": time.perf_counter() - wall_s, "cpu_s": sum(os.times()[:4]) - cpu_s}

    def answer(self, result: Mapping[str, Any], show: Callable[[], None]) -> None:
        """Print the result and its cost: one JSON object, or the output of `show` and a table."""
        where = self.where
        payload = {
            **result,
            **self._cost,
            "compile_s": self._compile_s,
            "cores": where.cores,
            "out": str(where.out),
        }
        rows = [
            ("computing", payload["wall_s"], "s"),
            ("of processor time", payload["cpu_s"], "s"),
            ("compiling or loading kernels", payload["compile_s"], "s"),
            ("figures and results in", payload["out"], ""),
            *([("page to read", payload["page"], "")] if "page" in payload else []),
        ]
        if self._as_json:
            print_json(payload)
            return
        show()
        console.print(figure_table("", rows))


def caption_of(found: "Basin") -> str:
    """The summary of a map of starts in one line."""
    numbers = found.statistics
    share, bounds = numbers["impact_fraction"], numbers["impact_fraction_wilson"]
    if found.start == "soft":
        return (
            f"soft start: {100 * share:.1f} % end in impacts "
            f"({100 * bounds[0]:.1f} to {100 * bounds[1]:.1f} %); at once "
            f"it would be {100 * numbers['instant_fraction']:.1f} %"
        )
    bounds = numbers["impact_fraction_bootstrap"]
    return (
        f"{100 * share:.1f} % end in impacts ({100 * bounds[0]:.1f} to {100 * bounds[1]:.1f} %), "
        f"uncertainty exponent {numbers['uncertainty_exponent']:.3f}"
    )


def chosen_case(preset: str, law: str, value: float | None, amplitude: float | None) -> "Case":
    """The module that the options describe."""
    from tools.study.cases import case

    return case(preset, law, value, **({} if amplitude is None else {"amplitude_m": amplitude}))


def figure_of(value: Any) -> Any:
    """A statistic for a table: bounds and counts by name become text, other values stay."""
    if isinstance(value, dict):
        return ", ".join(f"{name}: {count}" for name, count in value.items()) or "none"
    return " to ".join(figure(one) for one in value) if isinstance(value, list | tuple) else value


def is_nominal(case: "Case") -> bool:
    """Whether the friction parameter is the preset's own."""
    from tools.study import cases

    own = cases.case(case.preset, case.law)
    return (case.b_n_s_m, case.mu) == (own.b_n_s_m, own.mu)


def show_sweep(found: "list[Diagram]") -> None:
    """Print a row per case."""
    rows = (
        (
            diagram.case.preset,
            diagram.case.label,
            intervals(diagram.up.with_impacts()),
            intervals(diagram.down.with_impacts()),
            intervals(diagram.multistable()),
            ", ".join(sorted({edge.kind for edge in (*diagram.up.edges, *diagram.down.edges)})) or "—",
        )
        for diagram in found
    )
    titles = ("preset", "friction", "run-up", "run-down", "multistable", "ends by")
    console.print(table_of(titles, rows, title="where there are impacts, in Ω/ω"))


def intervals(union: list[tuple[float, float]]) -> str:
    """Intervals of Ω/ω as text."""
    return ", ".join(f"{low:.3f}–{high:.3f}" for low, high in union) or "nowhere"
