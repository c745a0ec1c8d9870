"""A tuned parameter file: some of the firmware's parameters, each with its unit, and their origin.

    format = 1
    [tuning]                              # the command, its subject, and whether the safety scenarios passed
    [parameters."speed.gain_p_n_m_s"]     # value, unit, low, high
    [figures_of_merit.phase_margin]       # value, unit
    [[safety]]                            # scenario, seed, passed, why

`vibrohil tune` writes it, a scenario (`firmware = "speed.toml"`) and `vibrohil run --parameters` load it.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_py.shell.parameters import BY_NAME, ParameterError, check_in_file
from hil.record.formats import PARAMETERS, FormatError, refuse_other_format
from text_input import read_toml

TUNE = "write it with `vibrohil tune`"


def read_document(path: Path) -> dict[str, Any]:
    """Return the file's tables; raises TextInputError or ParameterError if it has another format."""
    document = read_toml(path, "parameter file", "give one that `vibrohil tune` has written")
    try:
        refuse_other_format(f"parameter file {str(path)!r}", document, PARAMETERS, TUNE)
    except FormatError as error:
        raise ParameterError(str(error)) from error
    if not isinstance(document.get("parameters"), dict):
        raise ParameterError(f"parameter file {str(path)!r} has no table [parameters]; {TUNE}")
    return document


def values_of(document: Mapping[str, Any], path: Path) -> dict[str, float]:
    """The parameters by their dotted names, checked against the firmware's table: names, units and bounds."""
    values = {}
    for name, entry in document["parameters"].items():
        if not isinstance(entry, dict) or "value" not in entry:
            raise ParameterError(f'{path}: [parameters."{name}"] wants value and unit')
        values[name] = check_in_file(name, entry["value"])
        if entry.get("unit") != BY_NAME[name].unit:
            raise ParameterError(
                f"{path}: {name} is given in {entry.get('unit')!r}; wanted {BY_NAME[name].unit!r}"
            )
    return values


def nest(values: Mapping[str, float]) -> dict[str, Any]:
    """Convert dotted names to the nested tables of a scenario's `[firmware]`.

    >>> nest({"stop.restitution": 0.4, "stop.position_m": 0.18})
    {'stop': {'restitution': 0.4, 'position_m': 0.18}}
    """
    tables: dict[str, Any] = {}
    for name, value in values.items():
        block, _, key = name.partition(".")
        tables.setdefault(block, {})[key] = value
    return tables


def read_parameters(path: Path) -> dict[str, Any]:
    """Read the file as a scenario's table `[firmware]`."""
    return nest(values_of(read_document(path), path))


def merge_files(firmware: Mapping[str, Any], paths: Sequence[Path]) -> dict[str, Any]:
    """A scenario's table `[firmware]` updated by parameter files in order; the last file takes precedence."""
    tables = {block: dict(table) if isinstance(table, dict) else table for block, table in firmware.items()}
    for path in paths:
        for block, table in read_parameters(path).items():
            known = tables.setdefault(block, {})
            if not isinstance(known, dict):
                raise ParameterError(
                    f"firmware.{block} is a value, not a table, and {path} has parameters in it; "
                    "delete the value"
                )
            known.update(table)
    return tables
