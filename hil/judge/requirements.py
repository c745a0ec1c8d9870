"""The requirements in requirements.toml, and their traceability to the checks that prove them."""

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict

from hil.judge.verdict import RunVerdict, Verdict, worst


class Requirement(BaseModel):
    """A requirement in one sentence."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    text: str
    source: str
    """The page under docs that states the requirement, with its section."""


@cache
def requirements() -> Mapping[str, Requirement]:
    """Every requirement by its id."""
    document = tomllib.loads((Path(__file__).parent / "requirements.toml").read_text(encoding="utf-8"))
    return {name: Requirement.model_validate(table) for name, table in document.items()}


def trace(verdicts: Iterable[RunVerdict]) -> dict[str, Any]:
    """For each requirement the checks that prove it, and the verdict on it (None if none has run).

    A run that fails or is not judged regardless of its checks proves no requirement.
    """
    proofs: dict[str, list[tuple[Verdict, dict[str, Any]]]] = {name: [] for name in requirements()}
    for run in verdicts:
        of_run = Verdict.FAILED if run.reasons else Verdict.NOT_JUDGED if run.not_judged else None
        for check in run.checks:
            if check.requirement is not None:
                verdict = of_run or check.verdict
                proof: dict[str, Any] = {"scenario": run.scenario, "name": check.name, "limit": check.limit}
                proof |= {"passed": verdict.passed, "verdict": verdict.value}
                proofs[check.requirement].append((verdict, proof))
    return {
        name: {
            "text": requirements()[name].text,
            "passed": worst(verdict for verdict, _ in found).passed,
            "verdict": worst(verdict for verdict, _ in found).value if found else None,
            "checks": [proof for _, proof in found],
        }
        for name, found in proofs.items()
    }
