"""Compares two suites by the verdicts of each scenario and each check."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hil.record import formats
from hil.record.damage import reading
from hil.record.new_file import is_regular
from hil.record.run_folder import refuse_large_note
from hil.suite.changes import changes
from hil.suite.suite import RESULT


class SuiteError(ValueError):
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
        changes(result, result)
        return result


def figures_of(scenario: Mapping[str, Any]) -> dict[str, Mapping[str, Any]]:
    """A scenario's checks by name and limit, which identify a check."""
    return {f"{check['name']} {check['limit']}": check for check in scenario["checks"]}


def compare(a: Mapping[str, Any], b: Mapping[str, Any]) -> dict[str, Any]:
    """List the verdicts that differ in scenarios that both suites have run.

    `equal`: no verdict differs, and both have the same scenarios and seeds; measured values may differ.
    """
    of_a, of_b = ({one["name"]: one for one in suite["scenarios"]} for suite in (a, b))
    both = [name for name in of_a if name in of_b]
    differences = []
    checks = 0
    for name in both:
        one, other = of_a[name], of_b[name]
        if one["passed"] != other["passed"]:
            differences.append({"scenario": name, "check": None, "a": one["passed"], "b": other["passed"]})
        checks_a, checks_b = figures_of(one), figures_of(other)
        for check in [*checks_a, *(check for check in checks_b if check not in checks_a)]:
            checks += 1
            results = [found.get(check, {"passed": None, "value": None}) for found in (checks_a, checks_b)]
            if results[0]["passed"] != results[1]["passed"]:
                differences.append(
                    {
                        "scenario": name,
                        "check": check,
                        "a": results[0]["passed"],
                        "b": results[1]["passed"],
                        "value_a": results[0]["value"],
                        "value_b": results[1]["value"],
                    }
                )
    return {
        "clocks": [str(a["clock"]), str(b["clock"])],
        "compared": both,
        "checks": checks,
        "only_in_a": [name for name in of_a if name not in of_b],
        "only_in_b": [name for name in of_b if name not in of_a],
        "differences": differences,
        "equal": of_a.keys() == of_b.keys() and sorted(a["seeds"]) == sorted(b["seeds"]) and not differences,
    }
