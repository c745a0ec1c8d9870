"""`modelDescription.xml` of FMI 2 and FMI 3."""

import math
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as Xml

from tools.fmu.variables import UNITS, Variable

if TYPE_CHECKING:
    from tools.fmu.build import Model, Version

CAPABILITIES = {
    2: ("canGetAndSetFMUstate", "canSerializeFMUstate", "canNotUseMemoryManagementFunctions"),
    3: ("canGetAndSetFMUState", "canSerializeFMUState"),
}


def description(model: "Model", version: "Version", token: str) -> bytes:
    """The text of the file."""
    about = {"fmiVersion": f"{version}.0", "modelName": model.name, "generationTool": "vibrohil"}
    about["guid" if version == 2 else "instantiationToken"] = token
    root = Xml.Element("fmiModelDescription", about, variableNamingConvention="structured")
    flags = dict.fromkeys(CAPABILITIES[version], "true")
    flags["canHandleVariableCommunicationStepSize"] = "true" if model.fixed_step_s is None else "false"
    Xml.SubElement(root, "CoSimulation", flags | {"modelIdentifier": model.name})
    used = {one.unit for one in model.variables} | ({"s"} if version == 3 else set())
    shown = sorted((name, base) for name, base in set(UNITS.values()) if name in used)
    if shown:
        units = Xml.SubElement(root, "UnitDefinitions")
        for name, base in shown:
            unit = Xml.SubElement(units, "Unit", name=name)
            if base:
                unit.append(Xml.fromstring(f"<BaseUnit {base}/>"))
    Xml.SubElement(
        root, "DefaultExperiment", startTime="0", stopTime="10", stepSize=repr(model.fixed_step_s or 0.001)
    )
    variables = Xml.SubElement(root, "ModelVariables")
    for place, one in enumerate(model.variables):
        add(variables, one, place, version)
    if version == 3:
        time = {"name": "time", "valueReference": str(len(model.variables)), "unit": "s"}
        Xml.SubElement(variables, "Float64", time, causality="independent", variability="continuous")
    structure = Xml.SubElement(root, "ModelStructure")
    outputs = [place for place, one in enumerate(model.variables) if one.role == "output"]
    for name in ("Output", "InitialUnknown"):
        group = Xml.SubElement(structure, f"{name}s") if version == 2 else structure
        for place in outputs:
            if version == 2:
                Xml.SubElement(group, "Unknown", index=str(place + 1))
            else:
                Xml.SubElement(group, name, valueReference=str(place))
    Xml.indent(root)
    text: bytes = Xml.tostring(root, encoding="utf-8", xml_declaration=True)
    return text


def add(variables: Xml.Element, one: Variable, place: int, version: "Version") -> None:
    """Add a variable."""
    about = {"name": one.name, "valueReference": str(place), "description": one.description}
    if one.role in ("fixed", "tunable"):
        about |= {"causality": "parameter", "variability": one.role, "initial": "exact"}
    else:
        about |= {"causality": one.role, "variability": "discrete" if one.is_integer else "continuous"}
    bounds = {"min": one.low, "max": one.high}
    if one.role != "output":
        bounds["start"] = one.start
    kind: Any = int if one.is_integer else float
    numbers = {name: repr(kind(value)) for name, value in bounds.items() if math.isfinite(value)}
    if one.unit is not None:
        numbers["unit"] = one.unit
    if version == 2:
        variable = Xml.SubElement(variables, "ScalarVariable", about)
        Xml.SubElement(variable, "Integer" if one.is_integer else "Real", numbers)
    else:
        Xml.SubElement(variables, "Int32" if one.is_integer else "Float64", about | numbers)
