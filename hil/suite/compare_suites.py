"""Compares two suites: the verdicts of their scenarios, and the verdicts and figures of their checks."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.judge.tolerance import Tolerance
from hil.record import formats
from hil.record.damage import reading
from hil.record.new_file import is_regular
from hil.record.run_folder import refuse_large_note
from hil.suite.changes import changes, find_only_in, index_by_name
from hil.suite.suite import RESULT
from text_input import RefusalError


class SuiteError(RefusalError, ValueError):
    """A folder has no suite's result."""


def is_suite(folder: Path) -> bool:
    """Whether the folder has a suite's result: a file, no link."""
    return is_regular(folder / RESULT)


def read_suite(folder: Path) -> dict[str, Any]:
    """Read a suite's result; raises SuiteError, RunFolderError or DamagedFileError.

    It is compared with itself, so that one that cannot be compared is refused here.
    """
    if not is_suite(folder):
        raise SuiteError(f"{folder} has no {RESULT}; wanted the folder of a `vibrohil suite`")
    refuse_large_note(folder / RESULT)
    with reading(folder / RESULT, "run the suite again"):
        result: dict[str, Any] = json.loads((folder / RESULT).read_text(encoding="utf-8"))
        formats.refuse_other_format(str(folder / RESULT), result, formats.SUITE, "run the suite again")
        compare(result, result)
        refuse_other_types(result)
        return result


def refuse_other_types(suite: Mapping[str, Any]) -> None:
    """Raise ValueError if the name or the verdict of a scenario or a check is of another type."""
    for scenario in suite["scenarios"]:
        for one in (scenario, *scenario["checks"]):
            if not isinstance(one["name"], str) or one["passed"] not in (True, False, None):
                raise ValueError(f"{one['name']!r} is no name, or {one['passed']!r} no verdict")


def compare(
    a: Mapping[str, Any], b: Mapping[str, Any], tolerances: Mapping[str, Tolerance] | None = None
) -> dict[str, Any]:
    """The scenarios that both suites have run, those whose verdict differs, and the `changes` of the checks.

    `equal`: both have the same scenarios, seeds and checks, no verdict differs, and all figures are equal.
    """
    of_a, of_b = index_by_name(a), index_by_name(b)
    both = [name for name in of_a if name in of_b]
    only = find_only_in(a, b), find_only_in(b, a)
    passed = {name: (of_a[name]["passed"], of_b[name]["passed"]) for name in both}
    verdicts = [{"scenario": name, "a": of, "b": to} for name, (of, to) in passed.items() if of != to]
    found = changes(a, b, tolerances)
    is_same = sorted(a["seeds"]) == sorted(b["seeds"]) and not (only[0] or only[1] or verdicts)
    return {
        "clocks": [str(a["clock"]), str(b["clock"])],
        "compared": both,
        "only_in_a": only[0],
        "only_in_b": only[1],
        "seeds_only_in_a": sorted({*a["seeds"]} - {*b["seeds"]}),
        "seeds_only_in_b": sorted({*b["seeds"]} - {*a["seeds"]}),
        "verdicts": verdicts,
        "changes": found,
        "equal": is_same and all(one["equal"] for one in found),
    }
