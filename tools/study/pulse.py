"""Three ways to one pulse a stride, each walked: a crank that turns once a stride, subharmonics, gating.

- *turn*: n = 1. The crank turns once a stride, its spring chosen so that r = 1.1 at that cadence.
- *subharmonic*: the crank turns n times a stride and the striker strikes once in n turns. Where there are
  such orbits is looked for first, on a standing leg behind a rigid stop, from many starts (`orbits_found`).
- *gated*: the crank rests but for one blow a stride (`tools.study.pulse_gate`).

The first two are given what no firmware has: an ideal crank at the true phase of the walk, a module made for
that very cadence, and the time of RUN_IN strides to bring the blow into the window. The third has a motor
with its limits, the firmware's own phase estimate from noisy sensors, and modules off by what campaigns draw.
The gate's numbers were chosen on other walks (seeds 1 to 6) than those of DEFAULT_SEED, which are judged.

A stride counts that has exactly one blow, in the push-off window. Walks vary by 2 % from stride to stride.
"""

import math
from collections.abc import Mapping, Sequence
from copy import deepcopy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from firmware_py.core import gait
from firmware_py.core.compiled import source_hash
from firmware_py.core.inputs import GaitInput
from firmware_py.shell.parameters import config_from
from hil.scenario import read_scenario
from plant_sim.parts.drive import IdealDrive, MotorDrive
from plant_sim.parts.walking import BEGIN_S, Walking, cycles_at, row_at
from plant_sim.plant import Impact, Plant
from plant_sim.scene import Scene, load_scene, read_scene
from plant_sim.solvers.orbits import CLASSIFY, Outcome
from tools.campaign.draws import DEFAULT_SEED, Mismatch, draw
from tools.study import pulse_gate, store, work
from tools.study.cases import Case, case
from tools.study.feasibility import SOFTEST_M_S, STEP_S, Driven, pulses_n
from tools.study.orbits import State, follow
from tools.study.pulse_gate import WINDOW_MIDDLE

Vector = NDArray[np.float64]

WINDOW = (0.45, 0.60)
STRIDES_HZ = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1)
WALKERS = {"turn": 2, "subharmonic": 2, "gated": 6}
JUDGED = 40
"""Strides of each walk that are judged."""

TURN, SUBHARMONIC, GATED = "turn", "subharmonic", "gated"
WAYS = (TURN, SUBHARMONIC, GATED)

COLUMNS = (
    ("way", pa.string()),
    ("module", pa.string()),
    ("ground", pa.string()),
    ("axis", pa.string()),
    ("stride_hz", pa.float64()),
    ("turns", pa.int64()),
    ("spring_n_m", pa.float64()),
    ("amplitude_m", pa.float64()),
    ("gap_m", pa.float64()),
    ("strides", pa.int64()),
    ("right", pa.float64()),
    ("without", pa.float64()),
    ("several", pa.float64()),
    ("phase_std", pa.float64()),
    ("impulse_n_s", pa.float64()),
    ("felt_low_n", pa.float64()),
    ("felt_median_n", pa.float64()),
    ("felt_high_n", pa.float64()),
    ("leg_alone_hz", pa.float64()),
    ("torque_n_m", pa.float64()),
    ("drive_w", pa.float64()),
    ("copper_w", pa.float64()),
)


class Walked(NamedTuple):
    """A walk's end: its motion, the strides' beginnings, and what the motor gave."""

    run: Driven
    walking: Walking
    torque_n_m: float = math.nan
    drive_w: float = math.nan
    copper_w: float = math.nan


# --- judging -----------------------------------------------------------------------------------------------


def cycles(walking: Walking, t_s: float) -> float:
    """Cycles since the walk's first heel strike."""
    return cycles_at(walking.rows[row_at(walking.rows, t_s)], t_s)


def hits(impacts: Sequence[Impact]) -> list[Impact]:
    """Those that are none of a graze."""
    return [blow for blow in impacts if blow.v_m_s >= SOFTEST_M_S]


def judged(walks: Sequence[Walked], first: int) -> dict[str, Any]:
    """Strides of all walks from the `first` on: how many have one blow in the window, and what it is like."""
    counts, right, phases, impulses, felt = [], 0, [], [], []
    for walked in walks:
        blows = hits(walked.run.impacts)
        at = np.array([cycles(walked.walking, blow.t_s) for blow in blows])
        last = math.floor(cycles(walked.walking, walked.run.t_s[-1]))
        for stride in range(first, min(first + JUDGED, last)):
            own = np.flatnonzero(np.floor(at) == stride)
            counts.append(len(own))
            phases += (at[own] - stride).tolist()
            impulses += [blows[k].impulse_n_s for k in own]
            right += len(own) == 1 and WINDOW[0] <= at[own[0]] - stride <= WINDOW[1]
        begins_s = walked.walking.rows[first, BEGIN_S]
        felt.append(pulses_n(walked.run, float(begins_s)))
    number, forces = np.array(counts), np.concatenate(felt)
    off = (np.array(phases) - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5
    low, middle, high = np.quantile(forces, (0.0, 0.5, 1.0)).tolist() if len(forces) else (math.nan,) * 3
    return {
        "strides": len(number),
        "right": float(right) / len(number),
        "without": float(np.mean(number == 0)),
        "several": float(np.mean(number > 1)),
        "phase_std": float(np.std(off)) if len(off) else math.nan,
        "impulse_n_s": float(np.median(impulses)) if impulses else math.nan,
        "felt_low_n": low,
        "felt_median_n": middle,
        "felt_high_n": high,
        "torque_n_m": float(max(walked.torque_n_m for walked in walks)),
        "drive_w": float(np.mean([walked.drive_w for walked in walks])),
        "copper_w": float(np.mean([walked.copper_w for walked in walks])),
    }


# --- turns locked to the walk ------------------------------------------------------------------------------

RUN_IN = 60
"""Strides before anything is judged."""
SHIFT = 0.2
"""Share of a blow's lateness by which the next one is led on, in turns of the crank."""
LARGEST_SHIFT_RAD = 0.3
IDLE_S = 30.0


class Ground(NamedTuple):
    """What a module walks on: contact of its stop, whether a wearer gives way behind it, and the walk."""

    name: str
    contact_s: float
    worn: bool
    range_share: float
    variability: float


WALK = Ground("walk", 0.03, True, 1.0, 0.02)
"""Stop and wearer of the scene `walking`."""
GROUNDS = (
    Ground("hard, still, even", 0.005, False, 0.0, 0.0),
    Ground("soft stop, wearer", 0.03, True, 0.0, 0.0),
    Ground("2 % variability", 0.005, False, 0.0, 0.02),
    Ground("moving leg", 0.005, False, 1.0, 0.0),
)
"""The orbit as it was found, then with one thing more each time."""
LADDER_HZ = 0.8
WEARER = {"plate_kg": 1.0, "ankle_n_m": 2000.0, "ankle_n_s_m": 40.0}


def scene(module: Case, axis: str, stride_hz: float, start: State, ground: Ground = WALK) -> Scene:
    """A module on a leg, its ideal crank where `start` has it."""
    tables: dict[str, Any] = {
        "striker": {
            "mass_kg": module.mass_kg,
            "spring_n_m": module.spring_n_m,
            "rest_length_m": module.rest_length_m,
        },
        "drive": {
            "model": "ideal",
            "amplitude_m": module.amplitude_m,
            "speed_rad_s": 0.0,
            "phase_rad": start.crank_rad,
        },
        "friction": {"law": "viscous", "b_n_s_m": module.b_n_s_m},
        "stop": {
            "law": "hunt-crossley",
            "position_m": module.stop_m,
            "restitution": module.restitution,
            "contact_s": ground.contact_s,
        },
        "initial": {"x_m": module.rest_length_m + start.y_m, "v_m_s": start.v_m_s},
        "gait": {
            "axis": axis,
            "range_share": ground.range_share,
            "variability": ground.variability,
            "pace": [{"at_s": 0.0, "stride_hz": stride_hz}],
        },
        "solver": {"accuracy": 1e-6},
    }
    if ground.worn:
        tables["wearer"] = WEARER
    return load_scene(tables)


def locked(which: Scene, turns: int, seed: int, duration_s: float) -> Walked:
    """The crank at `turns` a stride, shifted slowly until the blow comes in the window's middle."""
    plant = Plant(which, seed)
    drive, walking = plant.parts.drive, plant.parts.housing
    assert isinstance(drive, IdealDrive)
    assert isinstance(walking, Walking)
    whole = 2.0 * math.pi * turns
    angle_rad = drive.phase_rad
    offset_rad = angle_rad - whole * cycles(walking, 0.0)
    steps = round(duration_s / STEP_S)
    t_s, crank_rad, felt_n = (np.empty(steps) for _ in range(3))
    impacts: list[Impact] = []
    for k in range(steps):
        if k % 5 == 0 and turns > 0:
            goal_rad = whole * cycles(walking, (k + 5) * STEP_S) + offset_rad
            omega_rad_s = (goal_rad - angle_rad) / (5.0 * STEP_S)
            plant.replace_parts(plant.parts._replace(drive=drive._replace(omega_rad_s=omega_rad_s)))
            angle_rad = goal_rad
        plant.advance(0.0, STEP_S)
        now = plant.now
        t_s[k], crank_rad[k] = (k + 1) * STEP_S, angle_rad
        felt_n[k] = now.stop_force_n if which.wearer is None else now.felt_force_n
        new = plant.take_impacts()
        impacts += new
        for blow in hits(new):
            late = (cycles(walking, blow.t_s) - WINDOW_MIDDLE + 0.5) % 1.0 - 0.5
            shift_rad = SHIFT * whole * late
            offset_rad += min(max(shift_rad, -LARGEST_SHIFT_RAD), LARGEST_SHIFT_RAD)
    return Walked(Driven(impacts, t_s, crank_rad, felt_n), walking)


class Made(NamedTuple):
    """A kind of module whose spring puts `turns` a stride at `ratio`, at each cadence or at one for all."""

    name: str
    way: str
    axis: str
    turns: int
    ratio: float
    gap_over_amplitude: float
    gap_m: float | None
    """None: so that the steady blow has V_M_S."""
    made_hz: float | None = None
    """None: for each cadence its own."""


V_M_S = 0.8
"""A blow that stop and wearer of the scene `walking` make 16 N of."""

MADE = (
    Made("60 mm", TURN, "outward", 1, 1.1, 3.0, 0.06),
    Made("60 mm, for 0.8 Hz", TURN, "outward", 1, 1.1, 3.0, 0.06, 0.8),
    Made("120 mm", TURN, "outward", 1, 1.1, 3.0, 0.12),
    Made("60 mm", TURN, "forward", 1, 1.1, 3.0, 0.06),
    Made("60 mm", TURN, "up", 1, 1.1, 3.0, 0.06),
    Made("r 0.82", SUBHARMONIC, "outward", 2, 0.82, 2.5, None),
    Made("r 0.87", SUBHARMONIC, "outward", 2, 0.87, 2.5, None),
    Made("r 2.2", SUBHARMONIC, "outward", 2, 2.2, 0.75, None),
    Made("r 0.89", SUBHARMONIC, "outward", 3, 0.89, 3.75, None),
    Made("r 0.91", SUBHARMONIC, "outward", 4, 0.91, 5.0, None),
    Made("r 0.92", SUBHARMONIC, "outward", 5, 0.92, 6.0, None),
)


def made_for(kind: Made, stride_hz: float) -> tuple[Case, State] | None:
    """The module for a cadence, and a start on its orbit (from rest with one turn); None: no such orbit."""
    natural_rad_s = 2.0 * math.pi * (kind.made_hz or stride_hz) * kind.turns / kind.ratio
    unit = case(
        "table1",
        "viscous",
        spring_n_m=0.8 * natural_rad_s**2,
        amplitude_m=0.06 / kind.gap_over_amplitude,
    )
    start, gap_m = State(0.0, 0.0, 0.0), unit.gap_m
    if kind.way == SUBHARMONIC:
        orbit = found_orbit(unit, kind)
        if orbit is None:
            return None
        start = State(orbit.end_y_m, orbit.end_v_m_s, orbit.end_crank_rad)
        gap_m *= V_M_S / orbit.v_mean_m_s
    if kind.gap_m is not None:
        gap_m = kind.gap_m
    scale = gap_m / unit.gap_m  # nothing else has a length: orbits keep their shape
    module = replace(unit, amplitude_m=unit.amplitude_m * scale, stop_m=unit.rest_length_m + gap_m)
    return module, State(start.y_m * scale, start.v_m_s * scale, start.crank_rad)


def found_orbit(unit: Case, kind: Made) -> Outcome | None:
    """The first of 200 starts that strikes once in so many turns."""
    dice = np.random.default_rng(1)
    for _ in range(200):
        orbit = follow(unit, kind.ratio, drawn_start(unit, dice), LONG)
        if orbit.certain and once_in(orbit.cycle, orbit.blows) == kind.turns:
            return orbit
    return None


def made_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """One kind of module at one cadence, on one ground."""
    kind, hz, ground = Made(**spec["kind"]), spec["stride_hz"], Ground(**spec["ground"])
    row: dict[str, Any] = {
        "way": kind.way,
        "module": kind.name,
        "ground": ground.name,
        "axis": kind.axis,
        "stride_hz": hz,
        "turns": kind.turns,
        "strides": 0,
    }
    made = made_for(kind, hz)
    if made is not None:
        module, start = made
        seconds = (RUN_IN + JUDGED + 2) / hz
        which = scene(module, kind.axis, hz, start, ground)
        walks = [locked(which, kind.turns, DEFAULT_SEED + k, seconds) for k in range(WALKERS[kind.way])]
        parked = State(-module.amplitude_m, 0.0, -0.5 * math.pi)
        resting = scene(module, kind.axis, hz, parked, ground)
        alone = hits(locked(resting, 0, DEFAULT_SEED, IDLE_S).run.impacts)
        row |= {
            "spring_n_m": module.spring_n_m,
            "amplitude_m": module.amplitude_m,
            "gap_m": module.gap_m,
            "leg_alone_hz": len(alone) / IDLE_S,
            **judged(walks, RUN_IN),
        }
    return pa.Table.from_pylist([row], schema=pa.schema(COLUMNS)), {}


# --- where there are subharmonics --------------------------------------------------------------------------

GAPS_OVER_AMPLITUDE = (0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 10.0)
RATIOS = tuple(np.round(np.arange(0.5, 8.001, 0.02), 3).tolist())
STARTS = 24
LONG = CLASSIFY._replace(settle_s=150.0)
ORBIT_COLUMNS = (
    ("gap_over_amplitude", pa.float64()),
    ("ratio", pa.float64()),
    ("turns", pa.int64()),
    ("share", pa.float64()),
    ("v_share", pa.float64()),
)


def once_in(cycle: int, blows: float) -> int:
    """After how many turns an orbit strikes again, 2 at least and once only; else 0."""
    return cycle if cycle > 1 and abs(blows * cycle - 1.0) < 1e-6 else 0


def drawn_start(unit: Case, dice: np.random.Generator) -> State:
    """Anywhere that a striker of this gap may be."""
    y_m = dice.uniform(-1.5, 1.0) * unit.gap_m
    v_m_s = dice.uniform(-1.2, 1.2) * unit.gap_m * unit.natural_rad_s
    return State(float(y_m), float(v_m_s), float(dice.uniform(0.0, 2.0 * math.pi)))


def orbit_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """One gap, all ratios: which starts end in one blow every n turns."""
    over = spec["gap_over_amplitude"]
    unit = case("table1", "viscous", amplitude_m=0.06 / over)
    dice = np.random.default_rng([1, round(100 * over)])
    rows = []
    for ratio in spec["ratios"]:
        found: dict[int, list[float]] = {}
        for _ in range(STARTS):
            orbit = follow(unit, ratio, drawn_start(unit, dice), LONG)
            turns = once_in(orbit.cycle, orbit.blows) if orbit.certain else 0
            if turns:
                found.setdefault(turns, []).append(orbit.v_mean_m_s / (unit.natural_rad_s * unit.gap_m))
        rows += [
            {
                "gap_over_amplitude": over,
                "ratio": ratio,
                "turns": turns,
                "share": len(speeds) / STARTS,
                "v_share": float(np.mean(speeds)),
            }
            for turns, speeds in sorted(found.items())
        ]
    return pa.Table.from_pylist(rows, schema=pa.schema(ORBIT_COLUMNS)), {}


def orbits_found(where: work.Where) -> pa.Table:
    """Subharmonic orbits of a viscous guide (ζ = 0.013) over gap and ratio."""
    specs = [{"gap_over_amplitude": over, "ratios": list(RATIOS)} for over in GAPS_OVER_AMPLITUDE]
    paths = work.run("pulse-orbits", orbit_piece, specs, where)
    return pa.concat_tables([store.read(path)[0] for path in paths])


class Band(NamedTuple):
    """A stretch of ratios in which orbits strike once in `turns`."""

    turns: int
    gap_over_amplitude: float
    low: float
    high: float
    share: float
    v_share: float

    @property
    def width(self) -> float:
        """Half of it, over its middle: by so much a cadence may be off."""
        return (self.high - self.low) / (self.high + self.low)


def bands(orbits: Sequence[Mapping[str, Any]]) -> list[Band]:
    """Neighbouring ratios with the same number of turns, as one; single ones are none."""
    step = 1.5 * (RATIOS[1] - RATIOS[0])
    found: list[list[Mapping[str, Any]]] = []
    for row in sorted(orbits, key=lambda one: (one["turns"], one["gap_over_amplitude"], one["ratio"])):
        before = found[-1][-1] if found else None
        if (
            before is not None
            and (before["turns"], before["gap_over_amplitude"]) == (row["turns"], row["gap_over_amplitude"])
            and row["ratio"] - before["ratio"] < step
        ):
            found[-1].append(row)
        else:
            found.append([row])
    return [
        Band(
            rows[0]["turns"],
            rows[0]["gap_over_amplitude"],
            rows[0]["ratio"],
            rows[-1]["ratio"],
            float(np.mean([row["share"] for row in rows])),
            float(np.mean([row["v_share"] for row in rows])),
        )
        for rows in found
        if len(rows) > 1
    ]


# --- gated -------------------------------------------------------------------------------------------------

TICK_S = 1e-3
GAIT_TICKS = 5
SETTLING = 8
"""Strides before anything is judged: the phase estimate takes three, the crank is parked meanwhile."""
SPEED_GAIN_N_M_S = 0.1
TORQUE_N_M, TORQUE_A_TICK_N_M = 0.6, 0.06
"""The firmware's own limits on torque and its growth."""
POSITION_ERROR_M = 1e-3
"""Deviation of what is believed of the striker's place, over and above the drawn module."""
SCENES = {
    "walking": ("walking", "a-fifth-more-strides-keep-the-impacts"),
    "table1": ("table1-walking", "a-steady-walk-has-a-pulse-in-every-push-off"),
}


def drawn_scene(module: str, stride_hz: float, walker: int) -> Scene:
    """A module off its beliefs as in the campaigns, on a leg."""
    given = deepcopy(read_scene(SCENES[module][0]))
    given["gait"]["pace"] = [{"at_s": 0.0, "stride_hz": stride_hz}]
    return draw(given, Mismatch(), DEFAULT_SEED, walker, at_rest=True).scene


def gated(module: str, stride_hz: float, walker: int, strides: int = SETTLING + JUDGED + 2) -> Walked:
    """A walk under the gate, a tick at a time."""
    config = config_from(read_scenario(SCENES[module][1])["firmware"])
    gate = pulse_gate.Gate(config.calm, config.lock.lowest_confidence)
    plant = Plant(drawn_scene(module, stride_hz, walker), DEFAULT_SEED + walker)
    walking = plant.parts.housing
    assert isinstance(walking, Walking)
    believed = config.calm
    spring_n_m = 0.8 * believed.natural_rad_s**2
    off_m = POSITION_ERROR_M * float(np.random.default_rng([DEFAULT_SEED, walker, 4]).standard_normal())
    cycle, state = gait.INITIAL, pulse_gate.initial(gate)
    heard = GaitInput(0.0, 0.0, False, False, GAIT_TICKS)
    drive = plant.parts.drive
    assert isinstance(drive, MotorDrive)
    every = round(STEP_S / TICK_S)
    ticks = round(strides / stride_hz / TICK_S)
    felt_n, crank_rad = np.empty(ticks // every), np.empty(ticks // every)
    touching, torque_n_m, largest_n_m, copper_j = False, 0.0, 0.0, 0.0
    for k in range(ticks):
        reading = plant.sense_gait() if k % GAIT_TICKS == 0 else None
        heard = heard._replace(age_ticks=heard.age_ticks + 1) if reading is None else GaitInput(*reading, 0)
        cycle = gait.step(config.gait, cycle, heard, 1)
        now = plant.now
        place_m = now.x_m + off_m
        touches = now.stop_force_n > 0.0
        state = pulse_gate.step(
            gate,
            state,
            (cycle.phase, cycle.confidence, cycle.stride.expected_s),
            now.crank_rad,
            (place_m, now.v_m_s),
            touches and not touching,
        )
        touching = touches
        piston_m = believed.amplitude_m * math.sin(now.crank_rad)
        lever_m = believed.amplitude_m * math.cos(now.crank_rad)
        wanted_n_m = spring_n_m * (piston_m + believed.rest_length_m - place_m) * lever_m
        wanted_n_m += SPEED_GAIN_N_M_S * (state.target_rad_s - now.omega_rad_s)
        wanted_n_m = min(max(wanted_n_m, -TORQUE_N_M), TORQUE_N_M)
        torque_n_m += min(max(wanted_n_m - torque_n_m, -TORQUE_A_TICK_N_M), TORQUE_A_TICK_N_M)
        plant.advance(torque_n_m, TICK_S)
        largest_n_m = max(largest_n_m, abs(torque_n_m))
        copper_j += drive.resistance_ohm * plant.now.current_a**2 * TICK_S
        if k % every == every - 1:
            felt_n[k // every], crank_rad[k // every] = plant.now.felt_force_n, plant.now.crank_rad
    t_s: Vector = STEP_S * np.arange(1, len(felt_n) + 1, dtype=np.float64)
    seconds = ticks * TICK_S
    return Walked(
        Driven(plant.take_impacts(), t_s, crank_rad, felt_n),
        walking,
        largest_n_m,
        plant.energy.drive_work_j / seconds,
        copper_j / seconds,
    )


def gated_piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """One module at one cadence, all walkers."""
    module, hz = spec["module"], spec["stride_hz"]
    walks = [gated(module, hz, walker) for walker in range(spec["walkers"])]
    given = read_scene(SCENES[module][0])
    row = {
        "way": GATED,
        "module": module,
        "ground": WALK.name,
        "axis": given["gait"]["axis"],
        "stride_hz": hz,
        "turns": 0,
        "spring_n_m": given["striker"]["spring_n_m"],
        "amplitude_m": given["drive"]["amplitude_m"],
        "gap_m": given["stop"]["position_m"] - given["striker"]["rest_length_m"],
        "leg_alone_hz": math.nan,
        **judged(walks, SETTLING),
    }
    return pa.Table.from_pylist([row], schema=pa.schema(COLUMNS)), {}


# --- all ---------------------------------------------------------------------------------------------------


def compute(where: work.Where, ways: Sequence[str], strides_hz: Sequence[float] = STRIDES_HZ) -> pa.Table:
    """The rows of some ways, in their order."""
    made = [
        {"kind": kind._asdict(), "stride_hz": hz, "ground": ground._asdict()}
        for kind in MADE
        if kind.way in ways
        for hz in strides_hz
        for ground in (*(GROUNDS if kind.way == SUBHARMONIC and hz == LADDER_HZ else ()), WALK)
    ]
    paths = work.run("pulse-made", made_piece, made, where) if made else []
    if GATED in ways:
        specs = [
            {"module": module, "stride_hz": hz, "walkers": WALKERS[GATED], "sources": source_hash()}
            for module in SCENES
            for hz in strides_hz
        ]
        paths += work.run("pulse-gated", gated_piece, specs, where)
    return pa.concat_tables([store.read(path)[0] for path in paths])
