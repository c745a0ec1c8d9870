"""The tables of docs/safety.md name every limit and watchdog, and the figures of every shipped module."""

import re
from pathlib import Path

import pytest

from firmware_py.core.safety import monitors
from firmware_py.interface.parameter_table import INDEX, TABLE, Parameter
from hil.scenario.files import scenario_names
from hil.scenario.scenario import load_scenario

PAGE = Path("docs/safety.md").read_text(encoding="utf-8")
ROWS = [line for line in PAGE.splitlines() if re.match(r"\| [^|]+ \| (gate|monitor) \|", line)]
NO_LIMITS = {
    "limit.drive_speed_rad_s",  # the drive's own limit
    "limit.standstill_rad_s",
    "limit.standstill_s",  # end of a stop
    "limit.stretch_m",  # plausibility of the estimate
    "limit.takeover_s",
    "watchdog.proof_required",  # conditions of a start
}
LIMITS = [p for p in TABLE if p.table in ("limit", "watchdog") and p.name not in NO_LIMITS]
LIMITS.append(TABLE[INDEX["speed.torque_limit_n_m"]])


def highest_of(parameter: Parameter) -> float:
    """The largest value that a file or the bus can set: the smallest of its bound and those above it."""
    highest = parameter.high
    while parameter.at_most:
        parameter = TABLE[INDEX[parameter.at_most]]
        highest = min(highest, parameter.default if parameter.table == "ceiling" else parameter.high)
    return highest


@pytest.mark.parametrize("parameter", LIMITS, ids=lambda parameter: parameter.name)
def test_every_limit_is_on_the_page_with_its_default_and_its_ceiling(parameter: Parameter) -> None:
    rows = [row for row in ROWS if f"`{parameter.name}` = {parameter.default:g}" in row]
    assert rows, f"docs/safety.md lacks {parameter.name} = {parameter.default:g}"
    if parameter.name.startswith("limit.lowest_") or parameter.name == "limit.stall_share":
        return  # a lower limit has no ceiling
    for _, _, _, upper, ceiling, time, *_ in (row.strip("| ").split(" | ") for row in rows):
        if f"`{parameter.name}`" in time:
            assert f"at most {highest_of(parameter):g} s" in time
        elif f"`{parameter.name}`" in upper and ceiling != "fixed in the build":
            assert ceiling.split(" ")[0] == f"{highest_of(parameter):g}"
    assert highest_of(parameter) <= 10.0 * parameter.default


def test_every_limit_has_two_sides_a_time_and_a_reaction_to_bad_input() -> None:
    assert len(ROWS) == 25
    for row in ROWS:
        assert all(cell.strip() for cell in row.strip("|").split("|")), row


def test_the_page_has_the_figures_of_the_jam_for_every_shipped_module() -> None:
    rows = set()
    for name in scenario_names():
        config = load_scenario(name).config
        p, limit_n_m = config.p, monitors.IMPLAUSIBLE_SHARE * config.p.speed.torque_limit_n_m
        rows.add(
            f"| {p.striker.spring_n_m:g} N/m, crank of {1e3 * p.drive.amplitude_m:g} mm | "
            f"{limit_n_m:.2f} N m | "
            f"{config.monitors.implausible_rad_s2:.0f} rad/s² | "
            f"{limit_n_m + config.own_crank.largest_load_n_m:.2f} N m |"
        )
    assert rows == {line for line in PAGE.splitlines() if re.match(r"\| \d+ N/m, crank", line)}
