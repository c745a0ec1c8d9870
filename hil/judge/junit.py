"""Verdicts as JUnit XML for CI systems: a suite per scenario, a case per check, with its value."""

import re
from collections.abc import Mapping, Sequence
from typing import Any
from xml.etree.ElementTree import Element, SubElement, indent, tostring

NO_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML 1.0 cannot hold, such as escape sequences from a process's standard error."""


def measured(check: Mapping[str, Any]) -> str:
    """The measured value and its limit as text."""
    value, unit = check["value"], check["unit"]
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    found = "not there" if value is None else f"{text} {unit}".rstrip()
    return found + f", wanted {check['limit']} {unit}".rstrip()


def suite(verdict: Mapping[str, Any]) -> Element:
    """The element of one run: a case per check, and one for the run itself."""
    checks, reasons = verdict["checks"], verdict["reasons"]
    failures = sum(not check["passed"] for check in checks)
    element = Element(
        "testsuite",
        name=verdict["scenario"],
        tests=str(len(checks) + 1),
        failures=str(failures),
        errors=str(int(bool(reasons))),
        time=f"{verdict['duration_s']:.3f}",
    )
    origin = SubElement(element, "properties")
    for key, value in verdict.get("provenance", {}).items():
        SubElement(origin, "property", name=key, value=str(value))
    run = SubElement(element, "testcase", classname=verdict["scenario"], name="runs to its end")
    if reasons:
        SubElement(run, "error", message="; ".join(reasons))
    for check in checks:
        case = SubElement(element, "testcase", classname=verdict["scenario"], name=check["name"])
        properties = SubElement(case, "properties")
        for key in ("value", "unit", "limit", "seed", "passed_seeds", "lowest", "highest", "requirement"):
            if check.get(key) is not None:
                SubElement(properties, "property", name=key, value=str(check[key]))
        if check.get("requirement") is not None:
            page = f"docs/requirements.md#{check['requirement'].lower()}"
            SubElement(properties, "property", name="requirement_page", value=page)
        if not check["passed"]:
            cause = f" ({verdict['host_stall']})" if verdict.get("host_stall") else ""
            SubElement(case, "failure", message=f"{check['name']} is {measured(check)}{cause}")
    return element


def document(verdicts: Sequence[Mapping[str, Any]]) -> str:
    """The file for one run or for a suite of runs."""
    root = Element("testsuites", name="vibrohil")
    root.extend(suite(verdict) for verdict in verdicts)
    indent(root)
    for element in root.iter():
        element.attrib = {key: NO_XML.sub("\ufffd", value) for key, value in element.attrib.items()}
    return '<?xml version="1.0" encoding="utf-8"?>\n' + tostring(root, encoding="unicode") + "\n"
