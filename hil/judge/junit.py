"""Verdicts as JUnit XML for CI systems: a suite per scenario, a case per check, with its value."""

import re
from collections.abc import Sequence
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from hil.judge.verdict import RunVerdict, Verdict

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


def document(verdicts: Sequence[RunVerdict]) -> str:
    """The file for one run or for a suite of runs."""
    root = Element("testsuites", name="vibrohil")
    root.extend([suite(verdict) for verdict in verdicts])
    indent(root)
    for element in root.iter():
        element.attrib = {key: NO_XML.sub("\ufffd", value) for key, value in element.attrib.items()}
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"
