"""Writes a tuned parameter file after the safety scenarios have passed."""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from hil.scenario.parameter_file import FORMAT
from tools.tuning.result import Tuning
from tools.tuning.safety import SafetyResult


class UnsafeError(ValueError):
    """A safety scenario fails with the parameters, and --force is not given."""


def document_of(tuning: Tuning, safety: Sequence[SafetyResult], forced: bool) -> dict[str, Any]:
    """The tables of the parameter file."""
    tables = tuning.as_json()
    about: dict[str, Any] = {
        **{key: tables[key] for key in ("command", "source", "range_is")},
        "vibrohil": version("vibrohil"),
        "safe": all(result.passed for result in safety),
        "forced": forced,
        "warnings": tables["warnings"],
    }
    if tuning.seed is not None:
        about["seed"] = tuning.seed
    return {
        "format": FORMAT,
        "tuning": about,
        "parameters": tables["parameters"],
        "figures_of_merit": tables["figures_of_merit"],
        "safety": [asdict(result) for result in safety],
    }


def write(path: Path, tuning: Tuning, safety: Sequence[SafetyResult], force: bool) -> None:
    """Write the file; UnsafeError for unsafe parameters without `force`. A forced file is marked as such."""
    failed = [result for result in safety if not result.passed]
    if failed and not force:
        why = "; ".join(f"{result.scenario}: {result.why}" for result in failed)
        raise UnsafeError(
            f"{path} is not written: with these parameters the safety scenarios fail ({why}); tune anew, or "
            "write it all the same with --force"
        )
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(document_of(tuning, safety, forced=bool(failed))), encoding="utf-8")
