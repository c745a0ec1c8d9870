"""Every sentence of docs/safety.md with a figure is tied: to the code, a parameter, a data file or a test."""

import csv
import math
import re
from pathlib import Path

import pytest

from firmware_py.core.control.start import LONGEST_SEARCH_S
from firmware_py.core.safety import (
    consent,
    drive_link,
    gate,
    gate_limits,
    liveness,
    monitors,
    own_crank,
    watchdog_proof,
)
from firmware_py.shell.parameters import DEFAULTS
from hil.drive.axis import DriveConfig
from hil.nodes.operator.node import COMMAND_PERIOD_S
from hil.scenario.checks import requirements
from tools.campaign import limits
from tools.dev import parameter_sweep, reactions, walkthrough

PAGE = Path("docs/safety.md").read_text(encoding="utf-8")
CAUSES = re.findall(r"^\| \d+ \| [A-Z_]+ \| (.*) \| [\d.]+ s \|$", PAGE, re.MULTILINE)
LIMITS = [
    " | ".join(cells[:4] + cells[5:])  # `test_limit_table` checks the ceilings
    for cells in (line.split(" | ") for line in PAGE.splitlines())
    if len(cells) == 8 and cells[1] in ("gate", "monitor")
]
PROSE = [
    " ".join(re.sub(r"^\d\. ", "", part, flags=re.MULTILINE).split())
    for part in re.split(r"\n\s*\n", PAGE)
    if not part.startswith(("|", "    ", "\n"))
]
STATED = [*PROSE, *CAUSES, *LIMITS]
"""All sentences, the causes in the table of faults, and the table of limits."""
WORDS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten")
IS_FIGURE = re.compile(rf"\d|\b(?:{'|'.join(WORDS[2:])}|twice|half|halfway|third|quarter)\b", re.IGNORECASE)
NO_FIGURES = ("between two heartbeats", "two ranges", "between two readings", "the two forces")
DRIVE_MS, WINDOW = (
    1e3 * DriveConfig._field_defaults["watchdog_s"],
    round(1e3 * DEFAULTS["watchdog.sensor_s"]) + 1,
)
MOST_AFTER_A_KICK = next(
    int(limit.high or 0) for limit in requirements()["S-03"].limits_of("after_fault.impacts_after_zero")
)
HARDER_AFTER_A_STUMBLE = max(
    limit.high or 0.0 for limit in requirements()["S-12"].limits_of("gait.hardest_after")
)
GAIT_SILENT_S = next(
    limit.high or 0.0
    for limit in requirements()["S-01"].limits_of("after_fault.torque_zero_after_s")
    if limit.when == {"frames": "GaitSensors"}
)
REACTIONS = list(csv.DictReader(Path("docs/data/reactions.csv").read_text("utf-8").splitlines()))
CONTACTS = list(csv.DictReader(Path("docs/data/limits.csv").read_text("utf-8").splitlines()))
BELOW_PERCENT = {
    count: 300.0
    / sum(
        int(row[count])
        for row in CONTACTS
        if row["lost"] == "0" and row["contact"][0] in "51" and row["contact"] != "1.5 to 3 ms"
    )
    for count in ("above", "below")
}
"""The rule of three on the contacts from 5 ms up without a lost sample, none of which was judged wrong."""
PARAMETER = re.compile(r"`([a-z_]+\.[a-z_0-9]+)` (?:\(([\d.]+) [^)]*\)|= (-?[\d.]+))")

BY_CODE = [
    f"due {1e3 * watchdog_proof.WATCHDOG_S:g} ms and two ticks after the last frame",
    f"takes more than {watchdog_proof.LONGEST_S:g} s, or if the crank turns faster than "
    f"{watchdog_proof.STILL_RAD_S:g} rad/s",
    f"repeated every {1e3 * drive_link.REPEAT_S:g} ms until a later heartbeat",
    f"has been slower than {monitors.TAKEOVER_SHARE * DEFAULTS['limit.speed_rad_s']:g} rad/s, "
    f"{100 * monitors.TAKEOVER_SHARE:g} % of",
    f"less the {1e3 * consent.ARMING_S:g} ms in which no drive can be armed",
    f"command watchdog ends all torque {DRIVE_MS:g} ms after the firmware's last frame",
    f"watchdog has ended the torque {DRIVE_MS:g} ms after the last torque command",
    f"end it {WINDOW} ms after the last accelerometer or encoder frame",
    f"extrapolates a rising drop by {1e3 * gate.LEAD_S:g} ms",
    f"low-pass of {DEFAULTS['sensor.bandwidth_hz']:g} Hz",
    f"at most {gate_limits.LONGEST_CONTACT_S:g} s, because its low-pass",
    f"repeats a reading {liveness.READINGS} times",
    f"ranges differ for {liveness.READINGS} readings in a row",
    f"at most {100.0 * own_crank.LOAD_SHARE:g} % of the largest torque",
    f"in a quarter of the trials, 1 to {limits.LOST} lost",
    f"beyond {limits.FORCE_BEYOND} × the force limit or {limits.IMPULSE_BEYOND} × the impulse limit",
    f"within {limits.IN_TICKS} ticks",
    f"below {limits.BELOW} of both limits",
    f"From {limits.CLEAN_MS:g} ms up no contact",
    f"below {BELOW_PERCENT['above']:.2f} % and {BELOW_PERCENT['below']:.2f} % (95 %)",
    f"The {LONGEST_SEARCH_S:g} s of START_FAILED",
    f"may be up to {HARDER_AFTER_A_STUMBLE:g} × as hard",
    f"{GAIT_SILENT_S:g} s if only the gait's sensors",
    f"STALL judges targets above {monitors.SLOWEST_RAD_S:g} rad/s",
    f"{WORDS[int(DEFAULTS['watchdog.operator_s'] / COMMAND_PERIOD_S) - 1]} of whose commands in a row may be",
    f"its own energy: up to {WORDS[MOST_AFTER_A_KICK]}",
    f"before {WORDS[gate.SETTLING_READINGS]} steady readings",
    f"Up to {WORDS[gate.LONGEST_BRIDGE_TICKS - 1]} lost readings",
    f"has {({2.0: 'twice'})[gate.AWAY_FACTOR]} the limits",
    f"−{gate.AWAY_FACTOR:g} × the limit",
    f"over {1e3 * gate_limits.SPEED_WINDOW_S:g} ms",
    f"−{gate.DRIVES_OWN:g} × the limit | {gate.DRIVES_OWN:g} ×",
    f"{WORDS[gate.GAPS]} gaps of more than {1e3 * gate_limits.LONGEST_GAP_S:g} ms, without "
    f"{1e3 * gate_limits.LONGEST_GAP_S:g} ms of samples",
    f"without a [sign of life](#the-gate) in {liveness.READINGS} readings",
    f"{liveness.READINGS} equal, or with ranges apart",
    f"and {gate_limits.DIFFER_M_S2:g} m/s² |",
    f"dips or within {LONGEST_SEARCH_S:g} s",
    f"by {monitors.RUNAWAY_RAD_S:g} rad/s for {monitors.RUNAWAY_S:g} s",
    f"see STALL | {monitors.RUNAWAY_RAD_S:g} rad/s | {monitors.RUNAWAY_S:g} s",
    f"acceleration for {1e3 * monitors.IMPLAUSIBLE_S:g} ms",
    f"{({0.25: 'a quarter'})[monitors.IMPLAUSIBLE_SHARE]} of N m | {monitors.IMPLAUSIBLE_S:g} s",
    f"no standstill {monitors.STOP_MARGIN_S:g} s after the nominal duration",
    f"at r = {walkthrough.RATIOS[0]:g}, {walkthrough.RATIOS[1]:g}, {walkthrough.RATIOS[2]:g} and "
    f"{walkthrough.RATIOS[3]:g}",
]
"""Fragments whose figures are constants."""
BY_TEST = {
    "of 0.25 m/s², half a count of the high range, hides its swap": (
        "test_an_offset_of_half_a_count_hides_a_swap_with_the_housing"
    ),
    "a watchdog of up to 51 ms passes, and one of 54 ms + min(⌈51 ms/H⌉ ms, H) or more fails: "
    "55 ms for H = 100 ms, 56 ms for 50 ms, 60 ms for 10 ms, 59 ms for 5 ms": "test_which_watchdogs_pass",
    "up to 1 ms late change neither bound up to H = 10 ms": "test_which_watchdogs_pass",
    "where H is 50 ms or more they lower the first to 49 ms": "test_which_watchdogs_pass",
    "every 20 ms until a heartbeat received at least 20 ms after": "test_an_e_stop_leaves_in_its_tick",
    "repeats the E-stop for up to 2 s": "test_a_heartbeat_from_before_the_e_stop_confirms_nothing",
    "the torque is 0 within 100 ms": "test_each_row",
    "any of 42 phases of the turn (11 at the slowest)": "test_the_impacts_after_an_e_stop_are_those",
    "at most 4 more impacts, the last within 2 s, none more than 3 % harder": "test_a_stop_ends_with_few",
    "every start waits 0.3 s": "test_which_request_counts",
    "noise of 2 counts or more": "test_noise_of_2_counts_is_a_sign_of_life",
    "noise is below a third of a count": "test_noise_of_2_counts_is_a_sign_of_life",
    "beyond 10 m": "test_an_estimate_that_is_none",
    "halfway from": "test_beyond_the_speed_limit_nothing_pushes_on",
    "only afterwards (1,001 ms)": "test_the_table_of_reactions_is_that_of_the_data",
}
"""Fragments whose figures a test asserts, or a campaign has measured: the beginning of the test's name."""
BY_CAMPAIGN = [
    "every mutant (a small change of the code) but four equivalent ones",
    "On the judged seed 20260 23,731 of 24,000 trials were eligible",
    "; 3,320 contacts lay between",
    "Of these contacts 347 of 8,694 were missed and 8 of 389 tripped",
    "a kick of 3 m/s 2 to 4 ms before the touch-down makes an impact of 890 N read as 470 N, and lost or "
    "[corrupted samples](worst-cases.md) hid up to 1,300 N",
    "in 47 scenarios with a latched fault. Of 6,392 runs 1,081 are",
    "refused at power-up, 4 stay at rest, 5,307 end in time, none late",
    "Of the 760 pairs of parameters that conflicts or the safety code read (`--monitors`)",
    "616 are refused and 144 end in time, none late",
]
"""Counts of `vibrohil campaign limits` beside those of docs/data/limits.csv, of a search for the worst run,
and of the parameter sweep."""


def without_parameters(text: str) -> str:
    """A text without the figures of parameters, which are checked here, and of the limits' longest times."""
    text = text.replace("`gait.follow` = 1", "")  # a condition
    for name, bracketed, equal in PARAMETER.findall(text):
        assert float(bracketed or equal) == DEFAULTS[name], f"{name} on the page of safety"
    return " ".join(re.sub(r", at most [\d.]+ s \|", " |", PARAMETER.sub("", text)).split())


@pytest.mark.parametrize("text", STATED, ids=range(len(STATED)))
def test_every_figure_is_tied(text: str) -> None:
    left = without_parameters(text)
    for fragment in (*BY_CODE, *BY_TEST, *BY_CAMPAIGN, *NO_FIGURES):
        left = left.replace(fragment, "")
    left = re.sub(r"`[^`]*`|\]\([^)]*\)", " ", left)
    left = re.sub(
        r"torque (is |to )?0\b|0 is proposed|(than|above|stays) 0|status 1|\| 0\b|NaN, 0 or", "", left
    )
    untied = [sentence for sentence in left.split(". ") if IS_FIGURE.search(sentence)]
    assert not untied, "tie each figure to the code (BY_CODE) or to its test (BY_TEST)"


@pytest.mark.parametrize("fragment", [*BY_CODE, *BY_TEST, *BY_CAMPAIGN, *NO_FIGURES])
def test_every_tied_fragment_is_on_the_page(fragment: str) -> None:
    assert fragment in without_parameters(" ".join(STATED))


def test_the_runs_of_the_sweep_are_both_bounds_of_each_parameter_in_each_scenario() -> None:
    found = re.search(
        r"in (\d+) scenarios .* Of ([\d,]+) runs ([\d,]+) are .* (\d+) stay at rest, ([\d,]+) end in time",
        " ".join(PROSE),
    )
    assert found is not None
    scenarios, runs, *verdicts = (int(one.replace(",", "")) for one in found.groups())
    assert sum(verdicts) == runs == scenarios * len(parameter_sweep.singles())


def test_the_pairs_are_all_of_the_parameters_that_the_safety_code_reads() -> None:
    found = re.search(r"Of the (\d+) pairs .* (\d+) are refused and (\d+) end in time", " ".join(PROSE))
    assert found is not None
    pairs, *verdicts = map(int, found.groups())
    assert sum(verdicts) == pairs == len(parameter_sweep.pairs_of_safety())


def test_every_named_test_exists() -> None:
    tests = "".join(path.read_text("utf-8") for path in Path("tests").rglob("test_*.py"))
    assert [name for name in BY_TEST.values() if f"def {name}" not in tests] == []


def test_the_table_of_reactions_is_that_of_the_data() -> None:
    """Per fault: scenarios, runs, and the longest finite times in ms."""
    rows = {
        line.split(" | ")[0][2:]: line
        for line in PAGE.splitlines()
        if re.match(r"\| [A-Z_]+ \| \d+ \| \d+ \|", line)
    }
    assert set(rows) == {row["fault"] for row in REACTIONS}
    for fault, line in rows.items():
        own = [row for row in REACTIONS if row["fault"] == fault]
        cells = [str(len(own)), str(sum(int(row["runs"]) for row in own))]
        for column in ("torque_zero_ms", "idle_sent_ms", "idle_confirmed_ms"):
            times_s = [1e-3 * int(row[column]) if row[column] else math.inf for row in own]
            cells.append(reactions.longest_of(times_s))
        assert line == f"| {fault} | " + " | ".join(cells) + " |"


def test_the_table_of_the_sensors_faults_is_that_of_the_data() -> None:
    rows = walkthrough.read_rows(Path("docs/data/sensor-faults.csv"))
    assert {row[:4] for row in rows} == {
        (t.channel, t.kind, f"{t.ratio:g}", t.phase) for t in walkthrough.TRIALS
    }
    by_trial = {row[:4]: row for row in rows}
    ordered = [by_trial[t.channel, t.kind, f"{t.ratio:g}", t.phase] for t in walkthrough.TRIALS]
    assert walkthrough.markdown(ordered) in PAGE
