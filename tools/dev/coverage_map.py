"""The coverage map: which tests and which scenarios prove a requirement.

A scenario's check names its requirement with the key `requirement`, a test with the marker of the same name.
"""

import ast
from pathlib import Path

from hil.judge.requirements import requirements
from hil.scenario.files import scenario_names
from hil.scenario.scenario import load_scenario

ROOT = Path(__file__).parents[2]


def requirements_of(test: ast.FunctionDef) -> list[str]:
    """The requirements that a test's marker names."""
    return [
        ast.literal_eval(argument)
        for decorator in test.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.requirement"
        for argument in decorator.args
    ]


def proving_tests() -> dict[str, list[str]]:
    """The tests that prove each requirement; raises ValueError if a test names one that does not exist."""
    found: dict[str, list[str]] = {name: [] for name in requirements()}
    for path in sorted((ROOT / "tests").rglob("test_*.py")):
        functions = (
            node for node in ast.parse(path.read_text("utf-8")).body if isinstance(node, ast.FunctionDef)
        )
        for test in functions:
            for name in requirements_of(test):
                if name not in found:
                    raise ValueError(f"{path}: the marker of {test.name} names {name}, no requirement")
                found[name].append(test.name)
    return found


def proving_scenarios() -> dict[tuple[str, ...], list[str]]:
    """The scenarios whose checks prove the same requirements, by these requirements."""
    order = list(requirements())
    found: dict[tuple[str, ...], list[str]] = {}
    for name in scenario_names():
        proved = {check.requirement for check in load_scenario(name).checks if check.requirement is not None}
        found.setdefault(tuple(sorted(proved, key=order.index)), []).append(name)
    return dict(sorted(found.items()))
