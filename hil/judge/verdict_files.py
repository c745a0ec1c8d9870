"""The files of a verdict: verdict.json, and JUnit XML for CI systems with a case per check."""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from hil.figures.records import Figures
from hil.judge.verdict import NO_CHECKS, CheckResult, FaultEffect, RunVerdict, Verdict
from hil.record import formats
from hil.record.new_file import write_anew
from hil.record.run_folder import write_json
from hil.run_files import RunFile

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, such as escape sequences from a process's standard error."""
PROPERTIES = ("value", "unit", "limit", "seed", "passed_seeds", "lowest", "highest", "requirement")
"""What a case says of its check; some only of a scenario in several seeds."""


def suite(verdict: RunVerdict) -> Element:
    """The element of one run: a case per check, and one for the run itself.

    A check or a run that was not judged is an error, never a skipped case.
    """
    reasons = [*verdict.reasons, *(f"not judged: {reason}" for reason in verdict.not_judged)]
    failures, doubted = (
        sum(check.verdict is one for check in verdict.checks) for one in (Verdict.FAILED, Verdict.NOT_JUDGED)
    )
    element = Element(
        "testsuite",
        name=verdict.scenario,
        tests=str(len(verdict.checks) + 1),
        failures=str(failures),
        errors=str(doubted + bool(reasons)),
        time=f"{verdict.figures.duration_s:.3f}",
    )
    origin = SubElement(element, "properties")
    for key, value in verdict.provenance.items():
        SubElement(origin, "property", name=key, value=str(value))
    run = SubElement(element, "testcase", classname=verdict.scenario, name="runs to its end")
    if reasons:
        SubElement(run, "error", message="; ".join(reasons))
    for check in verdict.checks:
        case = SubElement(element, "testcase", classname=verdict.scenario, name=check.name)
        properties = SubElement(case, "properties")
        for key in PROPERTIES:
            if (value := getattr(check, key, None)) is not None:
                SubElement(properties, "property", name=key, value=str(value))
        if check.requirement is not None:
            page = f"docs/requirements.md#{check.requirement.lower()}"
            SubElement(properties, "property", name="requirement_page", value=page)
        if check.verdict is Verdict.NOT_JUDGED:
            SubElement(case, "error", message=f"{check.name} is not judged: {check.reason}")
        elif check.verdict is Verdict.FAILED:
            SubElement(case, "failure", message=check.sentence)
    return element


def junit_document(verdicts: Sequence[RunVerdict]) -> str:
    """The file for one run or for a suite of runs."""
    root = Element("testsuites", name="vibrohil")
    root.extend([suite(verdict) for verdict in verdicts])
    indent(root)
    for element in root.iter():
        element.attrib = {key: NO_XML.sub("\ufffd", value) for key, value in element.attrib.items()}
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"


def document_of(verdict: RunVerdict) -> dict[str, Any]:
    """The content of verdict.json, which names the run's folder without its place on this machine."""
    return {**verdict.as_json(), "out": verdict.folder.name}


def write_verdict(verdict: RunVerdict) -> None:
    """Write verdict.json and junit.xml into the run's folder."""
    write_json(verdict.folder / RunFile.VERDICT, document_of(verdict))
    write_anew(verdict.folder / RunFile.JUNIT, junit_document([verdict]))


def read_verdict(path: Path) -> RunVerdict:
    """The verdict in a verdict.json that `RunVerdict.as_json` of the same version has made."""
    from pydantic import TypeAdapter  # noqa: PLC0415 - only an interrupted suite reads verdicts

    content = json.loads(path.read_text(encoding="utf-8"))
    formats.refuse_other_format(str(path), content, formats.VERDICT, "judge the run again")

    def part(kind: type[Any], values: Mapping[str, Any]) -> Any:
        return TypeAdapter(kind).validate_python({one.name: values[one.name] for one in fields(kind)})

    return RunVerdict(
        figures=part(Figures, content),
        checks=tuple(part(CheckResult, check) for check in content["checks"]),
        reasons=tuple(content["reasons"]),
        doubts=tuple(reason for reason in content["not_judged"] if reason != NO_CHECKS),
        faults=tuple(FaultEffect(**effect) for effect in content["faults"]),
        first_failure_s=content["first_failure_s"],
        provenance=content["provenance"],
        folder=path.parent,
    )
