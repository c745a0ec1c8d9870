"""The plant as an FMU: its variables, the functions that C calls, and the memory of an instance."""

import json
import math
from collections import namedtuple
from typing import Any

import numba
import numpy as np
from numba.core import types
from numba.np.random._constants import fi_double, ki_double, wi_double

from plant_sim.kernels import subroutine
from plant_sim.kinds import kernel_parts
from plant_sim.parts.drive import IdealDrive, MotorTable, constant_speed_rad_s
from plant_sim.parts.housing import NO_SHOCK, NO_SWING, Moving, Tilted, moving, tilt_m_s2
from plant_sim.parts.linkage import SliderCrank
from plant_sim.parts.stop import is_rigid, origin_m, stop_position_m
from plant_sim.parts.striker import Striker
from plant_sim.parts.walking import Walking
from plant_sim.parts.wearer import NoWearer
from plant_sim.parts.winding import WindingTable
from plant_sim.plant import depth_after_m
from plant_sim.references import word_count
from plant_sim.result import EnergyLedger, Impact, Observation
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading, read_sensors, readers
from plant_sim.sensors.sensing import NO_SENSING, allocate_sensing, sense_jump, settle_filters
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive.adaptive import BUFFER_FULL, advance, call_advance
from plant_sim.solvers.adaptive.state_layout import (
    MEMORY,
    OBSERVED,
    UNSETTLED,
    allocate,
    restart,
    set_accuracy,
)
from plant_sim.tables.quantities import LARGEST_SPEED_RAD_S
from plant_sim.tables.scene_tables import InitialTable
from plant_sim.tables.table import Table
from tools.fmu.machine_code import Flat, Functions, object_code
from tools.fmu.variables import NO_KEYS, Variable, parameters

NUMBERS = types.CPointer(types.float64)
TORQUE, KICKS, ACCELERATION = "motor.torque_n_m", "kicks.v_m_s", "housing.acceleration_m_s2"
INPUTS = (
    Variable(TORQUE, "input", "torque command of the motor; an ideal drive ignores it"),
    Variable(KICKS, "input", "sum of the kicks so far: a change of it changes the striker's velocity"),
    Variable(ACCELERATION, "input", "acceleration of the housing towards the stop, beside [housing]'s"),
)
OUTPUTS = (
    *(Variable(f"now.{name}", "output", is_integer=name == "phase") for name in Observation._fields),
    Variable(
        "now.energy_residual", "output", "energy that does not balance, as a share of what was exchanged"
    ),
    Variable("impact.count", "output", "number of impacts so far", is_integer=True),
    *(Variable(f"impact.{name}", "output", f"{name} of the last impact") for name in Impact._fields),
)
READINGS = tuple(Variable(f"reading.{name}", "output") for name in SensorReading._fields)
RESIDUAL, COUNT = len(Observation._fields), len(Observation._fields) + 1

_make_record: Any = namedtuple  # a class cannot list fields that are found at run time
Gravity = _make_record("Gravity", ("gravity_m_s2",))
"""The only number of a walking leg that is no stride's."""
_Ledger = _make_record("_Ledger", (*EnergyLedger.__dataclass_fields__, "exchanged_j"))
_exchanged_j: Any = subroutine(EnergyLedger.exchanged_j.fget)  # type: ignore[attr-defined]  # a property's function
_residual: Any = subroutine(EnergyLedger.residual.fget)  # type: ignore[attr-defined]  # likewise
_advance: Any = advance
_advance = getattr(_advance, "py_func", _advance)


@subroutine
def natural_rad_s(striker: Striker) -> float:
    """ω, rad/s."""
    return math.sqrt(striker.spring_n_per_m / striker.mass_kg)


def change(run: Any, after: Any, kick_m_s: float) -> int:
    """Replace the parts, or kick the striker, as `Plant` does; 1 if a rigid stop forbids the parts."""
    memory = run.memory[0]
    depth_m = depth_after_m(run.parts, after, memory.y.depth_m)
    if kick_m_s == 0.0 and is_rigid(after.stop) and depth_m > 0.0:
        return 1
    memory.y.depth_m = depth_m
    memory.y.v_m_s += kick_m_s
    sense_jump(run.probe, -kick_m_s)
    memory.progress.stored_before_j = math.nan
    memory.mode.phase = UNSETTLED
    return 0


def step(run: Any, torque_n_m: float, t_s: float, h_s: float, out: Any) -> int:
    """Advance by `h_s` and write the outputs; returns the solver's status."""
    progress = run.memory[0].progress
    progress.torque_n_m, progress.start_s, progress.duration_s = torque_n_m, t_s, h_s
    progress.elapsed_s = progress.elapsed_low_s = 0.0
    status = BUFFER_FULL
    while status == BUFFER_FULL:
        status = call_advance(run)
        write_impacts(run, out)
    write_motion(run, out)
    return status


@subroutine
def write_impacts(run: Any, out: Any) -> None:
    """Write the number of impacts and the last one's data; the run then has room for others."""
    mode = run.memory[0].mode
    for row in range(mode.impacts):
        impact = run.impacts[row]
        out[COUNT] += 1.0
        out[COUNT + 1], out[COUNT + 2], out[COUNT + 3] = impact.t_s, impact.v_m_s, impact.v_after_m_s
        out[COUNT + 4], out[COUNT + 6] = impact.impulse_n_s, impact.crank_rad
        out[COUNT + 5] = 0.0 if math.isnan(impact.peak_force_n) else impact.peak_force_n
    mode.impacts = 0


@subroutine
def write_motion(run: Any, out: Any) -> None:
    """Write the present observation and the energy residual."""
    progress, observed = run.memory[0].progress, run.memory[0].observed
    for place in range(observed.size):
        out[place] = observed[place]
    ledger = _Ledger(
        observed[OBSERVED.drive_work_j],
        observed[OBSERVED.stored_j],
        observed[OBSERVED.friction_j],
        observed[OBSERVED.impact_loss_j],
        observed[OBSERVED.housing_work_j],
        observed[OBSERVED.ankle_j],
        observed[OBSERVED.stored_j] + progress.stored_before_j,
        0.0,
    )
    exchanged_j = _exchanged_j(ledger)
    out[RESIDUAL] = _residual(_Ledger(*ledger[:7], exchanged_j))


VOCABULARY: dict[str, Any] = {
    "natural_rad_s": natural_rad_s,
    "tilt_m_s2": tilt_m_s2,
    "moving": moving,
    "constant_speed_rad_s": constant_speed_rad_s,
    "origin_m": origin_m,
    "stop_position_m": stop_position_m,
    "is_rigid": is_rigid,
    "set_accuracy": set_accuracy,
    "restart": restart,
    "settle_filters": settle_filters,
    "read_sensors": read_sensors,
    "readers": readers,
    "SliderCrank": SliderCrank,
    "Tilted": Tilted,
    "NoWearer": NoWearer,
    "Gravity": Gravity,
}
"""The functions and records in generated texts."""


def offset(record: np.dtype[Any], field: str) -> int:
    """The offset of a field in bytes."""
    assert record.fields is not None
    return int(record.fields[field][1])


def noise(seed: int) -> Flat:
    """PCG64's state and increment for this seed, low words first, as `normal.h` uses them."""
    numbers = np.random.default_rng(seed).bit_generator.state["state"]
    both = numbers["state"], numbers["inc"]
    return Flat([number >> shift & 2**64 - 1 for number in both for shift in (0, 64)])


class PlantModel:
    """A scene with its seed: everything that its FMU is made of."""

    kind = "plant"
    """The kind of functions in `models.functions_of`."""
    most_impacts = 64
    """Rows of the impacts' buffer; a step with more empties it several times."""

    def __init__(self, scene: Scene, seed: int) -> None:
        self.scene = scene.model_copy(
            update={"initial": InitialTable(x_m=scene.initial_x_m, v_m_s=scene.initial.v_m_s)}
        )
        text = scene.model_dump_json(exclude_unset=True, exclude={"axis"})
        self.name = "plant"
        self.fixed_step_s: float | None = None
        self._objects = {
            (self.kind, text, str(seed)): ("plant_parts", "plant_begin", "plant_read")[
                : 3 if scene.sensors else 2
            ],
            ("plant-shared",): ("plant_advance", "plant_change", "plant_step"),
        }
        parts = self.scene.parts(seed)
        self._is_carried = isinstance(parts.housing, Tilted | Moving)
        self.variables = self.its_variables()
        self._place = {one.name: place for place, one in enumerate(self.variables)}
        initial = initial_state(self.scene, parts)
        sensors = scene.sensors
        omega_rad_s = initial.omega_rad_s
        probe = NO_SENSING if sensors is None else allocate_sensing(sensors, omega_rad_s, parts.housing)
        self._parts = parts
        self._scope = dict(VOCABULARY)
        self.records: dict[str, Any] = {
            "run": allocate(parts, initial, scene.solver.accuracy, self.most_impacts, probe),
            "noise": noise(seed),
        }

    def its_variables(self) -> list[Variable]:
        """Inputs, outputs and parameters."""
        return [
            *(one for one in INPUTS if one.name != ACCELERATION or self._is_carried),
            *OUTPUTS,
            *(READINGS if self.scene.sensors else ()),
            *parameters(self.scene),
        ]

    def code(self) -> list[bytes]:
        """The object files of the scene's own functions and of those that all scenes share."""
        return [object_code(arguments, names) for arguments, names in self._objects.items()]

    def header(self) -> str:
        """The part of `model.h` that only the plant has."""
        rules = "".join(f"{json.dumps(message)}, " for _, message in self.rules)
        tables = {"uint64_t K": ki_double, "double W": wi_double, "double F": fi_double}
        acts = f" || (i) == {self._place[ACCELERATION]}" if self._is_carried else ""
        run = self.records["run"]
        advance_at = offset(MEMORY, "progress") + offset(MEMORY["progress"], "advance_at")
        return "\n".join(
            [
                f"#define OUT {self._place[OUTPUTS[0].name]}",
                f"#define READINGS {self._place.get(READINGS[0].name, 0)}",
                f"#define KICKS_IN {self._place[KICKS]}",
                f"#define TORQUE_IN {self._place.get(TORQUE, 0)}",
                f"#define PARTS_WORDS {word_count(run.fields.parts)}",
                f"#define MEMORY_AT {run.words.index(run.memory.ctypes.data)}",
                f"#define ADVANCE_AT {advance_at // 8}",
                f"#define ACTS_ON_PARTS(i) (TABLE[i].role == 't'{acts})",
                f"static const char *const RULES[] = {{NULL, {rules}}};",
                *(
                    f"static const {name}[] = {{{', '.join(map(str, table))}}};"
                    for name, table in tables.items()
                ),
            ]
        )

    def functions(self) -> Functions:
        """The functions of this scene."""
        run = self.run_type()
        found: Functions = {
            "plant_parts": (self._function("parts", self._parts_lines()), (NUMBERS, NUMBERS)),
            "plant_begin": (self._function("begin", self._begin_lines()), (NUMBERS, run)),
        }
        if self.scene.sensors is not None:
            read = self._function("read", self._read_lines())
            found["plant_read"] = read, (NUMBERS, run, NUMBERS, NUMBERS)
        return found

    def shared_functions(self) -> Functions:
        """The functions of every scene: the kernel is the same for all."""
        run, parts, number = self.run_type(), numba.typeof(kernel_parts(self._parts)), types.float64
        return {
            "plant_advance": (_advance, (run,)),
            "plant_change": (change, (run, parts, number)),
            "plant_step": (step, (run, number, number, number, NUMBERS)),
        }

    def run_type(self) -> Any:
        """numba's type of the run that kernels take."""
        return numba.typeof(self.records["run"])

    def _function(self, name: str, lines: list[str]) -> Any:
        """A function of `v`, the values of the variables, from generated lines: calls of the plant's own."""
        arguments = {
            "parts": "v, words",
            "begin": "v, run",
            "read": "v, run, noise, out",
        }
        body = "".join(f"    {line}\n" for line in [*lines, "return 0"])
        exec(f"def plant_{name}({arguments[name]}):\n{body}", self._scope)
        return self._scope[f"plant_{name}"]

    def _of(self, key: str, default: float = 0.0) -> str:
        """The text of a parameter's value; `default` if the scene does not have it."""
        return f"v[{self._place[key]}]" if key in self._place else repr(default)

    def _record(self, table: Table, prefix: str) -> str:
        """The text of a record with the numbers of a table and of those within it, 0 where one is absent."""
        values: dict[str, str] = {}
        for key in type(table).model_fields:
            value = getattr(table, key)
            if isinstance(value, Table) and f"{prefix}{key}" not in NO_KEYS:
                values[key] = self._record(value, f"{prefix}{key}.")
            elif value is None or type(value) in (int, float):
                values[key] = self._of(f"{prefix}{key}", value or 0.0)
        name = type(table).__name__
        self._scope[name] = _make_record(name, values)
        return f"{name}({', '.join(values.values())})"

    def _part(self, table: Table, prefix: str, *others: str) -> str:
        """The text of a call of a table's `part`."""
        name = f"{prefix.replace('.', '_')}part"
        its_part: Any = type(table).part  # type: ignore[attr-defined]  # tables of parts have it
        self._scope[name] = subroutine(its_part)
        return f"{name}({', '.join([self._record(table, prefix), *others])})"

    def _part_texts(self) -> dict[str, str]:
        """The texts of the parts that have numbers, by slot, in terms of the parts before them."""
        scene, parts = self.scene, self._parts
        its_motor = scene.motor or MotorTable()
        motor = self._record(its_motor, "motor.")
        inductance = self._of("motor.inductance_h", its_motor.inductance_h)
        tilt_rad, gravity = self._of("housing.tilt_rad"), self._of("striker.gravity_m_s2")
        texts = {
            "striker": self._part(scene.striker, "striker.", tilt_rad),
            "drive": self._part(scene.drive, "drive.", "natural_rad_s(striker)", motor),
            "friction": self._part(scene.friction, "friction."),
            "wearer": self._part(scene.wearer, "wearer.") if scene.wearer else "NoWearer()",
            "stop": self._part(scene.stop, "stop.", "striker.mass_kg", "wearer"),
            "linkage": f"SliderCrank({self._of('drive.rod_m')})",
            "winding": self._part(scene.winding or WindingTable(), "winding.", inductance),
        }
        along = f"tilt_m_s2({gravity}, {tilt_rad}) + {self._of(ACCELERATION)}"
        if isinstance(parts.housing, Tilted):
            texts["housing"] = f"Tilted({along})"
        elif isinstance(parts.housing, Moving) and scene.housing is not None:
            swing = self._record(scene.housing.harmonic or NO_SWING, "housing.harmonic.")
            shock = self._record(scene.housing.shock or NO_SHOCK, "housing.shock.")
            texts["housing"] = f"moving({along}, {swing}, {shock})"
        elif isinstance(parts.housing, Walking):
            texts["housing"] = f"Gravity({gravity})"
        kept = {slot for slot, part in parts._asdict().items() if getattr(part, "_fields", ())}
        return {slot: text for slot, text in texts.items() if slot in kept or slot == "wearer"}

    def _parts_lines(self) -> list[str]:
        """The parts from the parameters, written into the words of the kernels' record; then the rules."""
        texts, word, lines = self._part_texts(), 0, []
        for slot, text in texts.items():
            lines.append(f"{slot} = {text}")
        records = self.records["run"].fields.parts
        for slot, record in records._asdict().items():
            part = getattr(self._parts, slot)
            computed = ("gravity_m_s2",) if isinstance(part, Walking) else part._fields
            for field, value in record._asdict().items():
                if slot in texts and field in computed and isinstance(value, float):
                    lines.append(f"words[{word}] = {slot}.{field}")
                word += 5 + 2 * value.ndim if isinstance(value, np.ndarray) else 1
        for number, (condition, _) in enumerate(self.rules, 1):
            lines += [f"if {condition}:", f"    return {number}"]
        return lines

    @property
    def rules(self) -> list[tuple[str, str]]:
        """Conditions on several parameters that must not hold, and their messages."""
        limit = f"{LARGEST_SPEED_RAD_S:g} rad/s"
        speed = f"natural_rad_s(striker) > {LARGEST_SPEED_RAD_S}"
        found = [(speed, f"sqrt(striker.spring_n_m / striker.mass_kg) is above {limit}; make it slower")]
        if isinstance(self._parts.drive, IdealDrive):
            crank = f"drive.omega_rad_s > {LARGEST_SPEED_RAD_S}"
            found.append((crank, f"the drive's speed is above {limit}; make it slower"))
        for low, high, may_equal in (
            ("friction.mu", "friction.mu_s", True),
            ("drive.amplitude_m", "drive.rod_m", False),
        ):
            if low in self._place and high in self._place:
                found.append(
                    (
                        f"{self._of(high)} {'<' if may_equal else '<='} {self._of(low)}",
                        f"{high} is {'below' if may_equal else 'not above'} {low}; raise it",
                    )
                )
        return found

    def _begin_lines(self) -> list[str]:
        """The start: tolerances, state, and steady filters; 1 if it is beyond a rigid stop."""
        x_m = self._of("initial.x_m")
        lines = [
            "parts = run.parts",
            f"if is_rigid(parts.stop) and {x_m} > stop_position_m(parts.stop):",
            "    return 1",
            "omega_rad_s = constant_speed_rad_s(parts.drive)",
            f"depth_m = {x_m} - origin_m(parts.stop, parts.striker)",
            f"phase_rad = {self._of('drive.phase_rad')}",
            f"restart(run, depth_m, {self._of('initial.v_m_s')}, phase_rad, omega_rad_s)",
            f"set_accuracy(run, {self._of('solver.accuracy')})",
        ]
        if self.scene.sensors is not None:
            sensors = self._record(self.scene.sensors, "sensors.")
            lines.append(f"settle_filters(run.probe, {sensors}, omega_rad_s, parts.housing)")
        return lines

    def _read_lines(self) -> list[str]:
        """The sensors' readings of this instant, from four standard normals."""
        assert self.scene.sensors is not None
        sensors = self._record(self.scene.sensors, "sensors.")
        crank_rad = f"run.memory[0].observed[{OBSERVED.crank_rad}]"
        names = ", ".join(f"out[{place}]" for place in range(len(READINGS)))
        return [f"{names} = read_sensors(readers({sensors}), run.probe.readings, {crank_rad}, noise)"]
