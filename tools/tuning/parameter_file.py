"""Writes a tuned parameter file after the safety scenarios have passed."""

from collections.abc import Sequence
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import tomli_w

from hil.record.formats import PARAMETERS
from tools.tuning.result import Tuning
from tools.tuning.safety import SafetyResult


def document_of(tuning: Tuning, safety: Sequence[SafetyResult]) -> dict[str, Any]:
    """The tables of the parameter file; `forced`: written although a safety scenario failed."""
    tables = tuning.as_json()
    safe = all(result.passed for result in safety)
    about: dict[str, Any] = {
        **{key: tables[key] for key in ("command", "source", "range_is")},
        "vibrohil": version("vibrohil"),
        "safe": safe,
        "forced": not safe,
        "warnings": tables["warnings"],
    }
    if tuning.seed is not None:
        about["seed"] = tuning.seed
    return {
        "format": PARAMETERS,
        "tuning": about,
        "parameters": tables["parameters"],
        "figures_of_merit": tables["figures_of_merit"],
        "safety": [asdict(result) for result in safety],
    }


def write(path: Path, tuning: Tuning, safety: Sequence[SafetyResult]) -> None:
    """Write the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(tomli_w.dumps(document_of(tuning, safety)), encoding="utf-8")
