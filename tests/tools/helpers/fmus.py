"""FMUs under FMPy, a foreign master, beside the plant itself."""

import random
import struct
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmpy.fmi3 import FMU3Slave

from firmware_py.interface.frame import Frame
from plant_sim.plant import Plant
from plant_sim.scene import Scene
from tools.fmu.build import Version, export
from tools.fmu.plant import PlantModel

SEED = 7
FmiError = FMICallException

HOUSED = {
    "striker": {"mass_kg": 0.8, "spring_n_m": 70.0, "rest_length_m": 0.12},
    "drive": {"model": "motor", "amplitude_m": 0.02, "rod_m": 0.09},
    "friction": {"law": "stribeck", "mu": 0.02, "mu_s": 0.03, "v_s_m_s": 0.05, "delta": 1.5, "b_n_s_m": 0.1},
    "stop": {"law": "kelvin-voigt", "position_m": 0.16, "restitution": 0.5, "contact_s": 0.01},
    "housing": {
        "tilt_rad": 0.05,
        "harmonic": {"amplitude_m_s2": 0.5, "frequency_hz": 1.0, "phase_rad": 0.3},
        "shock": {"peak_m_s2": 3.0, "start_s": 0.6, "duration_s": 0.05},
    },
    "sensors": {},
}
"""Every table that the named scenes do not have."""
SCENES: dict[str, Any] = {
    name: name
    for name in (
        *("table1-viscous", "table1-coulomb", "table1-stribeck"),
        *("table1-motor-soft", "table1-dq-motor", "table1-walking"),
    )
} | {"housed": HOUSED}


def exported(scene: Scene, folder: Path, version: Version = 2) -> Path:
    """The scene's FMU."""
    file = folder / f"module{version}.fmu"
    export(PlantModel(scene, SEED), version, file)
    return file


class Fmu:
    """An FMU that is loaded once, for any number of instances."""

    def __init__(self, file: Path) -> None:
        self.folder = extract(str(file), str(file.with_suffix("")))
        self.about = read_model_description(self.folder)
        self.variables = {one.name: one for one in self.about.modelVariables}

    def instance(self, start: bool = True, **values: float) -> "Instance":
        """A new instance with these parameters, initialised if `start`."""
        one = Instance(self)
        for name, value in values.items():
            one.set(name, value)
        if start:
            one.start()
        return one


class Instance:
    """An instance of an FMU of either version, with variables by name; `messages` are what it logged."""

    def __init__(self, fmu: Fmu) -> None:
        self.fmu, self.t_s = fmu, 0.0
        self.messages: list[str] = []
        kinds: Any = {"2.0": FMU2Slave, "3.0": FMU3Slave}
        self.slave = kinds[fmu.about.fmiVersion](
            guid=fmu.about.guid,
            unzipDirectory=fmu.folder,
            modelIdentifier=fmu.about.coSimulation.modelIdentifier,
            instanceName="one",
        )
        self.is_fmi_3 = isinstance(self.slave, FMU3Slave)
        if self.is_fmi_3:
            self.slave.instantiate(logMessage=self._note)
        else:
            self._log = fmi2CallbackLoggerTYPE(self._note)  # kept from the garbage collector
            self.slave.instantiate(callbacks=fmi2CallbackFunctions(logger=self._log))
            self.slave.setupExperiment(startTime=0.0)

    def _note(self, *logged: Any) -> None:
        self.messages.append(logged[-1].decode())

    def start(self) -> None:
        """Initialise at the present values."""
        self.slave.enterInitializationMode()
        self.slave.exitInitializationMode()

    def set(self, name: str, value: float) -> None:
        write = self.slave.setFloat64 if self.is_fmi_3 else self.slave.setReal
        write([self.fmu.variables[name].valueReference], [value])

    def get(self, name: str) -> float:
        variable = self.fmu.variables[name]
        (value,) = getattr(self.slave, f"get{variable.type}")([variable.valueReference])
        return float(value)

    def step(self, h_s: float) -> None:
        self.slave.doStep(self.t_s, h_s)
        self.t_s += h_s

    def outputs(self, prefix: str) -> dict[str, float]:
        return {name: self.get(name) for name in self.fmu.variables if name.startswith(prefix)}


def outputs_of(plant: Plant) -> dict[str, float]:
    """The plant's observation under the FMU's names."""
    now = {f"now.{name}": float(value) for name, value in plant.now._asdict().items()}
    return now | {"now.energy_residual": plant.energy.residual}


def readings_of(plant: Plant) -> dict[str, float]:
    """The next readings of the plant's sensors under the FMU's names."""
    if plant.scene.sensors is None:
        return {}
    return {f"reading.{name}": value for name, value in plant.sense()._asdict().items()}


def shifted(fmu: Fmu, roles: tuple[str, ...], seed: int) -> dict[str, float]:
    """Other values, within 2 %, of the parameters of these variabilities."""
    chance = random.Random(seed)
    return {
        one.name: float(one.start) * chance.uniform(0.98, 1.02)
        for one in fmu.about.modelVariables
        if one.causality == "parameter" and one.variability in roles and one.name != "stop.position_m"
    }


ALONE = """
import sys
class Nothing:
    def find_spec(self, name, *_):
        if name.partition(".")[0] in ("plant_sim", "firmware_py", "hil", "tools", "numba", "llvmlite"):
            raise ImportError(name)
sys.meta_path.insert(0, Nothing())
"""


def run_alone(program: str, *arguments: str, folder: Path | None = None) -> str:
    """What a program prints in a process without this project's packages."""
    command = [sys.executable, "-P", "-c", ALONE + program, *arguments]
    return subprocess.run(command, cwd=folder, stdout=subprocess.PIPE, text=True, check=True).stdout


def require_no_runtime(fmu: Fmu) -> None:
    """The binary needs only the C library and its mathematics, and keeps to x86-64-v2."""
    library = next(Path(fmu.folder).glob("binaries/*/*.so"))
    names = subprocess.run(
        ["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True
    )
    needed = {line.split()[-1].partition("@")[0] for line in names.stdout.splitlines()}
    assert needed <= {
        *("sin", "cos", "sincos", "asin", "atan2", "exp", "log", "log1p", "pow", "fmod", "hypot"),
        *("floor", "fmax", "nextafter"),
        *("calloc", "malloc", "free", "memcpy", "memmove", "memset", "strcmp", "strdup", "snprintf"),
        *("__cxa_finalize", "__gmon_start__", "__stack_chk_fail"),
        *("_ITM_deregisterTMCloneTable", "_ITM_registerTMCloneTable"),
    }
    code = subprocess.run(["objdump", "-d", library], capture_output=True, text=True, check=True).stdout
    assert "vfmadd" not in code
    assert "%ymm" not in code


class FramePort:
    """The frames of a node's FMU: those that it receives in a step, and those that it sends in it."""

    def __init__(self, instance: Instance) -> None:
        self.instance = instance
        variables, slave = instance.fmu.variables, instance.slave
        self._received, self._sent = (
            variables[f"{name}.count"].valueReference for name in ("received", "sent")
        )
        self._set, self._get = (
            (slave.setInt32, slave.getInt32) if instance.is_fmi_3 else (slave.setInteger, slave.getInteger)
        )

    def receive(self, frames: Sequence[Frame]) -> None:
        """Set the frames of the next step."""
        values = [len(frames)]
        for can_id, data in frames:
            values += [can_id, len(data), *struct.unpack("<ii", data.ljust(8, b"\0"))]
        self._set([self._received + place for place in range(len(values))], values)

    def sent(self) -> list[Frame]:
        """The frames of the last step."""
        (count,) = self._get([self._sent])
        if count == 0:
            return []
        numbers = list(self._get([self._sent + 1 + place for place in range(4 * count)]))
        rows = [numbers[4 * place : 4 * place + 4] for place in range(count)]
        return [Frame(row[0], struct.pack("<ii", *row[2:])[: row[1]]) for row in rows]
