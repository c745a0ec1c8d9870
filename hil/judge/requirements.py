"""The requirements in requirements.toml, and their traceability to the checks that prove them."""

import tomllib
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict


class Requirement(BaseModel):
    """A requirement in one sentence; `tests`: test files that prove it where no scenario can."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    text: str
    source: str
    """The page under docs that states the requirement, with its section."""
    tests: tuple[str, ...] = ()


@cache
def requirements() -> Mapping[str, Requirement]:
    """Every requirement by its id."""
    document = tomllib.loads((Path(__file__).parent / "requirements.toml").read_text(encoding="utf-8"))
    return {name: Requirement.model_validate(table) for name, table in document.items()}


def trace(verdicts: Iterable[Mapping[str, Any]]) -> dict[str, Any]:
    """For each requirement the checks that prove it, and whether all passed (None if none has run).

    A run that fails regardless of its checks proves no requirement.
    """
    proofs: dict[str, list[dict[str, Any]]] = {name: [] for name in requirements()}
    for verdict in verdicts:
        for check in verdict["checks"]:
            if check.get("requirement") is not None:
                proof = {"name": check["name"], "limit": check["limit"]}
                passed = check["passed"] and not verdict["reasons"]
                proofs[check["requirement"]].append(
                    {"scenario": verdict["scenario"], **proof, "passed": passed}
                )
    return {
        name: {
            "text": requirements()[name].text,
            "passed": all(proof["passed"] for proof in found) if found else None,
            "checks": found,
        }
        for name, found in proofs.items()
    }
