"""The feasibility table: combinations of module, axis, stop, wearer and cadence that suit a walk.

Each cell is simulated by the plant alone, with an ideal crank and a walk of 2 % variability. A cell is
feasible if all of these conditions hold:

- There is a whole number n of crank turns a stride for which r = n f 2π/ω lies in the impact region. The
  region is measured for each module, stop and wearer on a standing leg: the ratios with one impact a turn in
  a slow run-up, from LOWEST_RATIO to TOP_SHARE of the upper end.
- The leg alone, with the crank at rest, causes no impacts.
- Impacts last: at most MISSED_SHARE of the judged turns have no impact.
- The peaks of all felt pulses lie within FELT_N.

The verdict names the first condition that fails. A felt pulse is the ankle's force above its value at
touch-down, so that the foot's weight and inertia do not count. With dry friction the plant has no compliant
wearer: there the felt pulse is the force on the bare stop, and the compliant wearer is omitted.
"""

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hil.figures.true_regime import Periods, impacts_by_period, period_edges
from hil.record.new_file import open_anew
from plant_sim.parts.drive import IdealDrive
from plant_sim.plant import Plant
from plant_sim.result import Impact
from plant_sim.scene import Scene, load_scene
from tools.study import work
from tools.study.cases import LAWS, Case, case

Vector = NDArray[np.float64]


MODULES = ("table1", "gait", "walking")
AXES = ("up", "forward", "outward")
CONTACTS_S = (0.01, 0.03, 0.05)
WEARERS = {"stiff": (1e4, 100.0), "compliant": (2e3, 40.0)}
"""Stiffness in N/m and damping in N s/m of the ankle under a foot plate of 1 kg."""
STRIDES_HZ = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0, 1.1)

FELT_N = (10.0, 40.0)
LOWEST_RATIO, TOP_SHARE, CENTRE_RATIO = 0.97, 0.97, 1.12
MISSED_SHARE = 0.01
SOFTEST_M_S = 0.05
IDLE_IMPACTS_HZ = 0.1

STEP_S = 0.002
SWEEP_S, LOW_RATIO, HIGH_RATIO = 160.0, 0.7, 1.6
RISE_S, SETTLE_S, JUDGED_S = 6.0, 6.0, 24.0
IDLE_S = 20.0
PULSE_S = 0.15
ACCURACY = 1e-6

FEASIBLE = "feasible"
NO_TURNS = "no whole number of turns"
NO_REGION = "no impact region"
LEG_IMPACTS = "impacts by the leg"
LOST = "impacts lost"
TOO_HARD = "too hard"
TOO_SOFT = "too soft"

CELL = (
    *("preset", "axis", "law", "wearer", "verdict", "contact_s", "region_low", "region_high", "stride_hz"),
    *("ratio", "idle_impacts_hz", "felt_low_n", "felt_high_n", "harmonic"),
)
"""Columns of the CSV file of cells; a value that was not measured is empty."""


class Stop(NamedTuple):
    """A module with a friction law, a stop and a wearer, without its axis and the cadence."""

    preset: str
    law: str
    contact_s: float
    wearer: str


class Driven(NamedTuple):
    """A run with an ideal crank: its impacts, and the crank angle and the felt force at each step."""

    impacts: list[Impact]
    t_s: Vector
    crank_rad: Vector
    felt_n: Vector


class Judged(NamedTuple):
    """Result of a cell for one n."""

    verdict: str
    missed_share: float = math.nan
    felt_low_n: float = math.nan
    felt_high_n: float = math.nan


def stops() -> list[Stop]:
    """Return all combinations that are studied."""
    return [
        Stop(preset, law, contact_s, wearer)
        for preset in MODULES
        for law in LAWS
        for contact_s in CONTACTS_S
        for wearer in WEARERS
        if law == "viscous" or wearer == "stiff"
    ]


def module(preset: str, law: str) -> Case:
    """Return a preset's module; `walking` is that of the scene walking.toml.

    At its 4.8 Hz every cadence has a suitable whole number of turns, and its short stroke keeps v⁻ below
    1 m/s.
    """
    if preset != "walking":
        return case(preset, law)
    return case("table1", law, spring_n_m=720.0, amplitude_m=0.0065, stop_m=0.142)


def scene(stop: Stop, axis: str, stride_hz: float) -> Scene:
    """Return the scene of the module on a leg."""
    tables: dict[str, Any] = {
        **replace(module(stop.preset, stop.law), contact_s=stop.contact_s).tables(CENTRE_RATIO),
        "gait": {"axis": axis, "pace": [{"at_s": 0.0, "stride_hz": stride_hz}]},
        "solver": {"accuracy": ACCURACY},
    }
    if stop.law == "viscous":
        stiffness_n_per_m, damping_n_s_m = WEARERS[stop.wearer]
        tables["wearer"] = {"plate_kg": 1.0, "ankle_n_m": stiffness_n_per_m, "ankle_n_s_m": damping_n_s_m}
    return load_scene(tables)


def drive(which: Scene, ratios: tuple[float, float], rise_s: float, then_s: float) -> Driven:
    """Run the plant while the crank's speed rises from one ratio to another in `rise_s` and is then held."""
    plant = Plant(which, seed=1)
    drive = plant.parts.drive
    assert isinstance(drive, IdealDrive)
    steps, rising = round((rise_s + then_s) / STEP_S), round(rise_s / STEP_S)
    t_s, crank_rad, felt_n = (np.empty(steps) for _ in range(3))
    angle_rad, omega_rad_s = 0.0, ratios[0] * which.natural_rad_s
    for k in range(steps):
        if k <= rising and k % 5 == 0:
            share = k / rising if rising else 1.0
            omega_rad_s = (ratios[0] + (ratios[1] - ratios[0]) * share) * which.natural_rad_s
            moved = drive._replace(omega_rad_s=omega_rad_s)
            plant.replace_parts(plant.parts._replace(drive=moved))
        plant.advance(0.0, STEP_S)
        angle_rad += omega_rad_s * STEP_S
        now = plant.now
        t_s[k], crank_rad[k] = (k + 1) * STEP_S, angle_rad
        felt_n[k] = now.felt_force_n if which.wearer is not None else now.stop_force_n
    return Driven(plant.take_impacts(), t_s, crank_rad, felt_n)


def turns_of(run: Driven, from_s: float) -> Periods:
    """Return the whole turns since a time, and the number of impacts in each.

    A turn begins at the backward dead centre, far from impacts.
    """
    edges_s = period_edges(run.crank_rad, run.t_s, -0.5 * math.pi)
    edges_s = edges_s[edges_s >= from_s]
    hits_s = np.array([impact.t_s for impact in run.impacts if impact.v_m_s >= SOFTEST_M_S])
    return Periods(edges_s, impacts_by_period(hits_s, edges_s))


def region(stop: Stop) -> tuple[float, float]:
    """Return the longest range of r with one impact a turn in a slow run-up on a standing leg, or nan."""
    run = drive(scene(stop, "outward", 0.0), (LOW_RATIO, HIGH_RATIO), SWEEP_S, 0.0)
    turns = turns_of(run, 0.0)
    one = turns.counts == 1
    # A single turn with another number of impacts does not end the range.
    one[1:-1] |= one[:-2] & one[2:]
    edges = np.flatnonzero(np.diff(np.concatenate(([0], one.astype(int), [0]))))
    begins, ends = edges[::2], edges[1::2]
    if len(begins) == 0:
        return math.nan, math.nan
    longest = int(np.argmax(ends - begins))
    low, high = (
        LOW_RATIO + (HIGH_RATIO - LOW_RATIO) * turns.edges_s[at] / SWEEP_S
        for at in (begins[longest], ends[longest])
    )
    return max(float(low), LOWEST_RATIO), TOP_SHARE * float(high)


def harmonics(stop: Stop, stride_hz: float, low: float, high: float) -> list[tuple[int, float]]:
    """Return (n, r) within the region: the pair nearest to the centre, and the one with softest impacts."""
    one = stride_hz * 2.0 * math.pi / module(stop.preset, stop.law).natural_rad_s
    fitting = [(n, n * one) for n in range(1, 16) if low <= n * one <= high]
    if not fitting:
        return []
    nearest = min(fitting, key=lambda pair: abs(pair[1] - CENTRE_RATIO))
    return [nearest] if nearest == fitting[0] else [nearest, fitting[0]]


def pulses_n(run: Driven, from_s: float) -> Vector:
    """Return the peak of each felt pulse above the felt force at its touch-down, N."""
    found = []
    for impact in run.impacts:
        if impact.t_s < from_s or impact.v_m_s < SOFTEST_M_S:
            continue
        begin = int(impact.t_s / STEP_S)
        after = run.felt_n[begin : begin + round(PULSE_S / STEP_S)]
        if len(after):
            found.append(float(after.max() - run.felt_n[max(begin - 1, 0)]))
    return np.array(found)


def judge_cell(stop: Stop, axis: str, stride_hz: float, ratio: float) -> Judged:
    """Run a cell with one n and return its verdict."""
    run = drive(scene(stop, axis, stride_hz), (0.75 * ratio, ratio), RISE_S, SETTLE_S + JUDGED_S)
    counts = turns_of(run, RISE_S + SETTLE_S).counts
    missed = float(np.mean(counts == 0)) if len(counts) else 1.0
    felt = pulses_n(run, RISE_S + SETTLE_S)
    if len(felt) == 0:
        return Judged(LOST, missed, math.nan, math.nan)
    low, high = float(felt.min()), float(felt.max())
    verdict = FEASIBLE
    if missed > MISSED_SHARE:
        verdict = LOST
    elif high > FELT_N[1]:
        verdict = TOO_HARD
    elif low < FELT_N[0]:
        verdict = TOO_SOFT
    return Judged(verdict, missed, low, high)


def idle_impacts_hz(stop: Stop, axis: str, stride_hz: float) -> float:
    """Return the impacts per second that the leg causes with the crank at rest."""
    run = drive(scene(stop, axis, stride_hz), (0.0, 0.0), 0.0, IDLE_S)
    return sum(impact.v_m_s >= SOFTEST_M_S for impact in run.impacts) / IDLE_S


def cell(stop: Stop, axis: str, stride_hz: float, low: float, high: float) -> dict[str, Any]:
    """Return one row of the table."""
    row: dict[str, Any] = {
        **stop._asdict(),
        "axis": axis,
        "stride_hz": stride_hz,
        "harmonic": 0,
        "ratio": math.nan,
        "region_low": low,
        "region_high": high,
        "idle_impacts_hz": math.nan,
    }
    if not low <= high:
        return row | Judged(NO_REGION)._asdict()
    candidates = harmonics(stop, stride_hz, low, high)
    if not candidates:
        return row | Judged(NO_TURNS)._asdict()
    row["harmonic"], row["ratio"] = candidates[0]
    row["idle_impacts_hz"] = idle_impacts_hz(stop, axis, stride_hz)
    if row["idle_impacts_hz"] > IDLE_IMPACTS_HZ:
        return row | Judged(LEG_IMPACTS)._asdict()
    first = judge_cell(stop, axis, stride_hz, row["ratio"])
    for harmonic, ratio in candidates[1:]:
        if (
            first.verdict != FEASIBLE
            and (other := judge_cell(stop, axis, stride_hz, ratio)).verdict == FEASIBLE
        ):
            return row | {"harmonic": harmonic, "ratio": ratio} | other._asdict()
    return row | first._asdict()


def piece(task: tuple[Stop, Sequence[float]]) -> list[dict[str, Any]]:
    """Compute the rows of one stop for all axes and these cadences."""
    stop, strides_hz = task
    low, high = region(stop)
    return [cell(stop, axis, hz, low, high) for axis in AXES for hz in strides_hz]


def compute(
    where: work.Where, presets: Sequence[str], strides_hz: Sequence[float] = STRIDES_HZ
) -> list[dict[str, Any]]:
    """Compute the whole table for the presets, a row for each cell."""
    tasks = [(stop, strides_hz) for stop in stops() if stop.preset in presets]
    return [row for rows in work.run("feasibility", piece, tasks, where) for row in rows]


def write_cells(rows: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Write every cell as a line of a CSV file, with the columns of CELL and four digits."""

    def text(value: Any) -> str:
        if isinstance(value, float):
            return f"{value:.4g}" if math.isfinite(value) else ""
        return str(value)

    with io.TextIOWrapper(open_anew(path), encoding="utf-8", newline="") as file:
        lines = csv.DictWriter(file, CELL, extrasaction="ignore", lineterminator="\n")
        lines.writeheader()
        lines.writerows({name: text(row[name]) for name in CELL} for row in rows)
