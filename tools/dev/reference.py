"""Writes docs/reference and docs/requirements.md from the code and the DBC.

    python -m tools.dev.reference

A test fails if the pages are out of date.
"""

import argparse
import ast
import inspect
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from enum import IntEnum
from itertools import groupby
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo

from firmware_py.interface import codec, enums
from firmware_py.interface.arrivals import LONGEST_DELAY_S, NEW_SEQUENCE
from firmware_py.interface.dbc import Signal, SignalKind, database
from firmware_py.interface.parameter_table import TABLE, Parameter
from hil.drive.axis_table import BenchScene
from hil.faults.every import KINDS, PLACES
from hil.figures.records import CATALOGUE
from hil.scenario.checks import Bounds, Check, Limit, requirements
from hil.scenario.commands import CommandTable
from hil.scenario.files import FileTable, check_sets, scenario_names
from hil.scenario.limits import SCALES
from hil.scenario.scenario import Scenario, ScenarioTable, ScriptTable, load_scenario
from hil.scenario.search import SearchTable
from plant_sim.tables.quantities import quantity_of
from plant_sim.tables.table import tables_in
from tools.dev.command_page import command_page, find_repeated, page, row, table

ROOT = Path(__file__).parents[2]
PLACE = ROOT / "docs/reference"


def first_sentences(thing: Any) -> str:
    """A docstring as one paragraph."""
    return " ".join((inspect.getdoc(thing) or "").split())


def values_of(signal: Signal) -> str:
    """The values of a signal: its range, or the number of listed values."""
    if signal.kind is SignalKind.FLAGS:
        return "bits"
    if signal.values:
        return f"one of {len(signal.values)} states"
    return "float32" if signal.is_float else f"{signal.low:g} … {signal.high:g}"


def frames() -> str:
    """Every frame of the bus, from vibro.dbc."""
    late = f"{1e3 * LONGEST_DELAY_S:g} ms"
    parts = [
        "Classic CAN, 1 Mbit/s, 11-bit identifiers, little-endian. The only source is "
        "`firmware_py/interface/vibro.dbc`. A protected frame ends in a rolling counter and a CRC-8 "
        "(SAE J1850 over the identifier's low byte and the data).",
        "The firmware uses a protected frame if it continues the sequence of its source: its counter "
        "has advanced, and by no more than the frames that its source can have sent in the time since "
        f"the newest one and {late}: a lost frame costs only itself. After a restart of the source, or "
        f"a silence of half a turn of the counter less {late}, the first {NEW_SEQUENCE - 1} frames are "
        "lost too. A frame that repeats the newest one, or is out of sequence, is dropped, counted "
        "(`counters.rejected_repeated`, `counters.rejected_sequence`; `counters.new_sequences` begun) and "
        "no sign of life.",
        "## Nodes",
        table(["node", "meaning"], (row(node.name, node.comment) for node in database().nodes)),
    ]
    for one in sorted(codec.CODECS.values(), key=lambda one: one.can_id):
        sent = "on an event" if one.period_s is None else f"every {1e3 * one.period_s:g} ms"
        protection = ", protected" if one.protected else ""
        parts.append(f"## 0x{one.can_id:03X} {one.record.__name__}")
        comment = database().get_message_by_name(one.record.__name__).comment
        parts.append(
            f"{comment}\n\nSender: {one.sender or 'any client of the drive'}; {sent}; "
            f"{one.length} bytes{protection}."
        )
        if one.signals:
            meaning = database().get_message_by_name(one.record.__name__).get_signal_by_name
            rows = (
                row(
                    f"`{name}`",
                    signal.unit or "—",
                    values_of(signal),
                    f"{signal.scale:g}",
                    meaning(name).comment,
                )
                for name, signal in one.signals.items()
            )
            parts.append(table(["signal", "unit", "values", "resolution", "meaning"], rows))
    parts.append("## States")
    for name in enums.__dict__:
        kind = getattr(enums, name)
        if isinstance(kind, type) and issubclass(kind, IntEnum) and kind is not IntEnum:
            values = ", ".join(f"{value.value} `{value.name}`" for value in kind)
            parts.append(f"### {name}\n\n{first_sentences(kind)}\n\n{values}.")
    return page("Frames", *parts)


def changeable_by(parameter: Parameter) -> str:
    """The tier of a parameter, and when a master of XCP may change it."""
    tier = parameter.tier.name.lower()
    if not parameter.is_calibrated:
        return tier
    return f"{tier}, in motion" if parameter.while_running else f"{tier}, at rest"


def parameters() -> str:
    """Every parameter of the firmware."""
    rows = (
        row(
            f"`{one.name}`",
            changeable_by(one),
            one.unit,
            f"{one.default:g}",
            f"{one.low:g} … " + (f"`{one.at_most}`" if one.at_most else f"{one.high:g}"),
            one.meaning,
        )
        for one in TABLE
    )
    return page(
        "Firmware parameters",
        "A scenario sets these under `[firmware]`, the command line with `--set firmware.NAME=VALUE`, XCP by "
        "the name in the A2L file.",
        "The **tier** says who may change a parameter. **build**: a parameter file that contains one is "
        "rejected; a scenario, which also describes the bench's build, may set it. **module**: the nominal "
        "parameters of the module. **tuning**: the behaviour; *at rest* or *in motion* says when "
        "[a master of XCP](../how-to/measure-and-calibrate.md) may change it, within its bounds. "
        "A bound given as a name is the value of that parameter.",
        table(["name", "tier", "unit", "default", "bounds", "meaning"], rows),
    )


PROCESS = re.compile(r"(?<=\.)(plant|firmware)(?=\.)")
"""The process in the name of a figure that both processes have."""


def figures() -> str:
    """Every figure that a check may name; a figure of both processes has one row."""
    named: dict[tuple[str, str, str], list[str]] = {}
    for spec in CATALOGUE.values():
        named.setdefault((PROCESS.sub("…", spec.name), spec.unit, spec.meaning), []).append(f"`{spec.name}`")
    rows = (row("<br>".join(names), unit or "—", meaning) for (_, unit, meaning), names in named.items())
    return page(
        "Figures",
        "The figures of a finished run. A check names one of these, with `low` and/or `high`, or `equals`. "
        "A figure that does not exist for a run is null, and a check on it fails.",
        table(["name", "unit", "meaning"], rows),
    )


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


def requirement_rows() -> Iterator[str]:
    """A row for each requirement: its source, the numbers of checks that prove it, and its tests."""
    of_tests = proving_tests()
    scenarios = [load_scenario(name) for name in scenario_names()]
    for name, one in requirements().items():
        proofs = [(scenario.name, check) for scenario in scenarios for check in scenario.checks]
        proving = [scenario for scenario, check in proofs if check.requirement == name]
        where = f"[{one.source.partition('#')[0]}]({one.source})"
        in_scenarios = str(len(proving)) if proving else "—"
        tests = "<br>".join(f"`{test}`" for test in of_tests[name]) or "—"
        limits = "<br>".join(limits_in_words(one.limits)) or "—"
        yield row(f'<a id="{name.lower()}"></a>{name}', one.text, limits, where, in_scenarios, tests)


def limits_in_words(limits: Iterable[Limit]) -> Iterator[str]:
    """A line for each figure: its limits, the quantities that they are multiples of, and their conditions."""
    for figure, group in groupby(limits, lambda limit: limit.figure):
        alternatives = []
        for limit in group:
            unit = f"× `{limit.of}`" if limit.of else CATALOGUE[figure].unit
            unit += f" + {limit.ticks} ticks" if limit.ticks else ""
            conditions = " and ".join(f"`{key}` = {value}" for key, value in limit.when.items())
            alternatives.append(f"{limit.text} {unit}".rstrip() + (f" if {conditions}" if conditions else ""))
        yield f"`{figure}` {'; '.join(alternatives)}"


def quantity_rows() -> Iterator[str]:
    """A row for each quantity of which a limit may be a multiple."""
    for name, function in SCALES.items():
        yield row(f"`{name}`", first_sentences(function))


def requirement_page() -> str:
    """Every requirement with the checks and tests that prove it."""
    return page(
        "Requirements",
        "The requirements on the module, and the checks and tests that prove them. A scenario's check names "
        "its requirement with the key `requirement`; `vibrohil suite` lists the results by requirement. "
        'A test names its requirement with `@pytest.mark.requirement("S-01")`; `pytest -k NAME` runs it.',
        "A check takes the limits of its requirement: of several limits of a figure the last one whose "
        "conditions hold. A scenario may only demand more. A condition names a `kind` of fault in the "
        "script, a figure of which a check demands this value, or a key of the scene or the firmware. "
        "Where a fault takes time to show on the bus, the check states it as `shows_after_s`, which "
        "extends the limit.",
        table(["id", "requirement", "limits", "stated in", "checks", "tests"], requirement_rows()),
        table(["quantity", "meaning"], quantity_rows()),
        "## Scenarios",
        "The scenarios by the requirements that their checks prove.",
        table(
            ["proved", "scenarios"],
            (row(" ".join(proved), "<br>".join(names)) for proved, names in proving_scenarios().items()),
        ),
    )


def bounds_of(field: FieldInfo) -> str:
    """The bounds of a key as text."""
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    found = [
        f"{sign} {getattr(one, name):g}"
        for one in field.metadata
        for name, sign in signs.items()
        if getattr(one, name, None) is not None
    ]
    return ", ".join(found)


def default_of(field: FieldInfo) -> str:
    """The default of a key."""
    if field.is_required():
        return "required"
    if field.default is None or isinstance(field.default, BaseModel):
        return "—"
    return f"`{field.default}`" if field.default_factory is None else "—"


def choices_of(annotation: Any) -> list[str]:
    """The texts that a key accepts; empty if it accepts any."""
    return [value for value in get_args(annotation) if isinstance(value, str)]


def table_name(model: type[BaseModel] | Any) -> str:
    """The name by which the page of scenes heads a table."""
    return str(model.__name__).removesuffix("Table")


def meaning_of(field: FieldInfo) -> str:
    """The description of a key or the name of its table; then the accepted texts that are not in it."""
    is_table = inspect.isclass(field.annotation) and issubclass(field.annotation, BaseModel)
    described = field.description or (f"the table {table_name(field.annotation)}" if is_table else "")
    others = [
        f"`{choice}`"
        for choice in choices_of(field.annotation)
        if not re.search(rf"(?<![\w-]){re.escape(choice)}(?![\w-])", described)
    ]
    return " ".join(filter(None, [described, ", ".join(others)]))


def cell(texts: Sequence[str]) -> str:
    """The texts of a key in several tables: once if they agree, otherwise one after the other."""
    return texts[0] if len(set(texts)) == 1 else "; ".join(texts)


KEYS = ("key", "default", "bounds", "meaning")
"""Titles of a table of keys."""


def key_rows(*tables: Mapping[str, FieldInfo]) -> dict[str, str]:
    """A row for each key, by its name, of one table of a file, or of several tables with the same keys."""
    rows = {}
    for name in tables[0]:
        fields = [one[name] for one in tables]
        default = cell([default_of(field) for field in fields])
        bounds = cell([bounds_of(field) or "—" for field in fields])
        rows[name] = row(f"`{name}`", default, bounds, cell([meaning_of(field) for field in fields]))
    return rows


def table_sections(models: Iterable[type[BaseModel]]) -> Iterator[str]:
    """The sections of a file's tables; successive tables with the same keys share one."""
    for _, group in groupby(models, lambda model: sorted(model.model_fields)):
        alike = list(group)
        yield f"### {', '.join(map(table_name, alike))}"
        yield "<br>\n".join(first_sentences(model) for model in alike)
        yield table(KEYS, iter(key_rows(*(model.model_fields for model in alike)).values()))


def check_set_rows() -> Iterator[str]:
    """A row for each set of checks that a scenario may name."""
    for name, one in check_sets().items():
        limits = (f"`{check['name']}` {limit_of(check)}".rstrip() for check in one["checks"])
        yield row(f"`{name}`", one["title"], "<br>".join(limits))


def limit_of(check: Mapping[str, Any]) -> str:
    """The limit of a check in a set as text: its own, its requirement's, or none if the scenario gives it."""
    one = Check.model_construct(**check)
    if one.own != Bounds():
        return f"{one.own.text} {one.unit or ''}"
    requirement = requirements().get(one.requirement or "")
    return f"({one.requirement})" if requirement and requirement.limits_of(one.name) else ""


def scenes() -> str:
    """Every key of a scene's and a scenario's file."""
    parts = [
        "A part without a table is absent. Unknown keys are rejected. Tables with the same keys share a "
        "section; where they differ, their texts follow each other in the order of the heading."
    ]
    of_scenario: list[type[BaseModel]] = [ScenarioTable, FileTable, SearchTable, ScriptTable, CommandTable]
    for heading, found in (("A scenario", of_scenario), ("A scene", [*tables_in(BenchScene)][1:])):
        parts += [f"## {heading}", *table_sections(found)]
    parts += [
        "## Sets of checks",
        table(["name", "title", "checks: limit or (requirement)"], check_set_rows()),
    ]
    parts.append(
        "## Sizes\n\nThe smallest size of a number above 0, and the largest size. "
        "A number that may be 0 is 0 or at least 1e-15."
    )
    fields = (field for one in [*of_scenario, *tables_in(BenchScene)] for field in one.model_fields.values())
    rows = (
        row(" in ".join(filter(None, (one.name, one.unit))), f"{one.smallest:g} … {one.largest:g}")
        for one in sorted(set(map(quantity_of, fields)), key=lambda one: one.name)
    )
    parts.append(table(["quantity", "size"], rows))
    return page("Scenarios and scenes", *parts)


DEADLINES = {
    "after_fault.torque_zero_after_s": "torque 0 within",
    "safe_state.command_zero_after_s": "command 0 within",
    "after_fault.impacts_again_after_s": "impacts within",
}
"""Figures with the deadline of a reaction, and how the tables of faults name it."""


def reaction_of(scenario: Scenario) -> str:
    """The required reaction to a scenario's fault and its deadline; other checks are omitted."""
    for name, what in DEADLINES.items():
        for check in scenario.checks:
            if check.name == name:
                bounds = check.bounds
                within_s = bounds.equals if bounds.high is None else bounds.high
                return f"{what} {within_s:g} s"
    return "bounds"


def own_keys(kind: type[BaseModel]) -> dict[str, str]:
    """A row for each key of a fault but those that every fault has."""
    fields = kind.model_fields
    every = {"kind", "at_s"} if fields["duration_s"].is_required() else {"kind", "at_s", "duration_s"}
    return key_rows({key: field for key, field in fields.items() if key not in every})


def faults() -> str:
    """Every fault, its keys, and the scenarios that hold the firmware to a reaction."""
    scenarios = [load_scenario(name) for name in scenario_names()]
    shared = find_repeated(map(own_keys, KINDS))
    parts = [
        "A fault is a table `[[script.faults]]` of a scenario. It acts on the bus, at a sensor, in the drive "
        "or the module, on a process or on its clock, but never inside the firmware. Each fault has `at_s`, "
        "its beginning in s from the start, and `duration_s`, by default to the end of the run. For example:",
        '    [[script.faults]]\n    kind = "sensor-stuck"\n    at_s = 15.0\n    sensor = "encoder"',
        "Below each fault stands what its scenarios require of the truth. *Torque 0 within*: from the "
        "fault's beginning. *Command 0 within*: from the time at which the drive must be off until the "
        "commanded torque is 0. *Impacts within*: from a fault's end until each drive period has an impact"
        ". *Bounds*: torque, speed and force stay within the scenario's bounds.",
        "Keys of several faults, each of which names those that it has:",
        table(KEYS, iter(shared.values())),
    ]
    for place in PLACES:
        parts.append(f"## {place}")
        for kind in (one for one in KINDS if one.place == place):
            parts.append(f"### {get_args(kind.model_fields['kind'].annotation)[0]}")
            parts.append(first_sentences(kind))
            keys = own_keys(kind)
            if own := [text for key, text in keys.items() if shared.get(key) != text]:
                parts.append(table(KEYS, iter(own)))
            if also := [f"`{key}`" for key, text in keys.items() if shared.get(key) == text]:
                parts.append(f"[Keys](#faults){' also' if own else ''}: {', '.join(also)}.")
            required: dict[str, list[str]] = {}
            for one in scenarios:
                if any(isinstance(fault, kind) for fault in one.faults):
                    required.setdefault(reaction_of(one), []).append(f"`{one.name}`")
            parts.append("\n".join(f"- {what}: {', '.join(names)}" for what, names in required.items()))
    return page("Faults", *parts)


PAGES = {
    "frames.md": frames,
    "parameters.md": parameters,
    "figures.md": figures,
    "scenes.md": scenes,
    "faults.md": faults,
    "command-line.md": command_page,
    "../requirements.md": requirement_page,
}


def main() -> None:
    """Write all pages."""
    argparse.ArgumentParser(prog="python -m tools.dev.reference", description=__doc__).parse_args()
    PLACE.mkdir(parents=True, exist_ok=True)
    for name, make in PAGES.items():
        (PLACE / name).write_text(make(), encoding="utf-8")


if __name__ == "__main__":
    main()
