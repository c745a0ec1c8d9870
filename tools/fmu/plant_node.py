"""The plant's node as an FMU: the module, its sensors and its drive; frames in and out, one tick a step."""

from typing import Any, NamedTuple

import numba
import numpy as np
from numba.core import types
from numpy.typing import NDArray

from firmware_py.builds.numba_subset import loader, register, store
from hil.drive import axis
from hil.drive.axis import DriveConfig
from hil.drive.reports import Ticks, first_reports
from hil.nodes.plant.node import drive_config, frame_ticks
from hil.nodes.plant.steps import (
    MOST_FRAMES,
    NOTHING_DUE,
    Due,
    PlantState,
    Setup,
    encoder_sample,
    move_on,
    obey_frames,
    publish,
)
from plant_sim.references import by_reference
from plant_sim.scene import Scene
from plant_sim.sensors.readings import SensorReading
from plant_sim.sensors.sampled import SAMPLED
from plant_sim.solvers.adaptive.state_layout import OBSERVED
from tools.fmu.machine_code import Functions, flat
from tools.fmu.plant import NUMBERS, PlantModel, write_impacts, write_motion
from tools.fmu.variables import MOST_RECEIVED, FmuError, Variable, frame_places, frame_variables

register()

NO_SENSORS = tuple(kind(*[0.0] * len(kind._fields)) for kind in SAMPLED)
"""Sensors with sampling periods of their own, of which no sample is ever due."""


class NodeConfig(NamedTuple):
    """The drive's configuration, the periods of the drive's reports and of the encoder's frame, the tick."""

    drive: DriveConfig
    report_ticks: Ticks
    encoder_ticks: int
    period_s: float


class Mail(NamedTuple):
    """What C hands to a tick and takes from it: readings and frames in, frames, torque and impacts out.

    Frames are rows of identifier, length and word; `counts`: frames received and sent. `readings`: as of
    `SensorReading`. `due`: empty.
    """

    readings: NDArray[np.float64]
    received: NDArray[np.int64]
    sent: NDArray[np.int64]
    counts: NDArray[np.int64]
    torque_n_m: NDArray[np.float64]
    due: Due


load_config: Any = loader(NodeConfig)
load_state: Any = loader(PlantState)
store_record: Any = store


def tick(
    config_at: Any,
    state_at: Any,
    mail: Any,
    run: Any,
    out: Any,
) -> int:
    """Publish, obey and advance by a tick. Returns the solver's status."""
    config, observed, readings = load_config(config_at), run.memory[0].observed, mail.readings
    setup = Setup(config.drive, config.report_ticks, config.encoder_ticks, NO_SENSORS)
    reading = SensorReading(readings[0], readings[1], readings[2], readings[3], readings[4])
    state = load_state(state_at)
    sample = encoder_sample(state.drive, reading)
    state, mail.counts[1] = publish(setup, mail.due, observed, state, reading, sample, mail.sent)
    omega_rad_s = observed[OBSERVED.omega_rad_s]
    state = obey_frames(config.drive, state, reading, omega_rad_s, mail.received, mail.counts[0])
    mail.torque_n_m[0] = state.torque_n_m
    drive, status = move_on(run, config.drive, state.drive, state.torque_n_m, config.period_s)
    write_impacts(run, out)
    write_motion(run, out)
    store_record(state._replace(tick=state.tick + 1, drive=drive), state_at)
    return status


class PlantNodeModel(PlantModel):
    """A scene's module with its drive and its sensors as a node of the bus."""

    kind = "plant-node"
    most_impacts = 4096
    """A tick with more is refused."""

    def __init__(self, scene: Scene, seed: int, period_s: float) -> None:
        """`period_s`: the tick. Raises FmuError for a scene whose frames an FMU cannot make."""
        if scene.sensors is None:
            raise FmuError("the scene has no sensors, whose frames the node sends; add the table [sensors]")
        if scene.gait is not None:
            raise FmuError("the node's FMU has no gait sensors; choose a scene without [gait]")
        if scene.sensors.sampled():
            raise FmuError("the node's FMU has no coarse position sensor; remove [sensors.coarse]")
        super().__init__(scene, seed)
        self.fixed_step_s = period_s
        self._objects |= {("node-shared",): ("node_tick",)}
        config = drive_config(scene)
        state = PlantState(0, -1, first_reports(0), axis.power_up(config), 0.0, 0)
        self.records |= {
            "config": flat(NodeConfig(config, *frame_ticks(scene, period_s), period_s)),
            "state": flat(state),
            "mail": by_reference(mailbox()),
        }

    def its_variables(self) -> list[Variable]:
        """As of the plant; the drive commands the torque, and the motor's parameters are the drive's too."""
        return [
            *(one for one in super().its_variables() if not one.name.startswith("motor.")),
            *frame_variables("received", "input", MOST_RECEIVED),
            *frame_variables("sent", "output", MOST_FRAMES),
        ]

    def header(self) -> str:
        """The part of `model.h` that only the plant's node has."""
        mail = self.records["mail"]
        places = (
            f"#define {name.upper()}_AT {mail.words.index(getattr(mail.record, name).ctypes.data)}"
            for name in ("readings", "received", "sent", "counts", "torque_n_m")
        )
        size = f"#define READINGS_BYTES {mail.record.readings.nbytes}"
        return "\n".join([super().header(), "#define NODE", frame_places(self.variables), *places, size])


def mailbox() -> Mail:
    """Empty mail."""
    return Mail(
        np.zeros(len(SensorReading._fields)),
        np.zeros((MOST_RECEIVED, 3), np.int64),
        np.zeros((MOST_FRAMES, 3), np.int64),
        np.zeros(2, np.int64),
        np.zeros(1),
        NOTHING_DUE,
    )


def shared_functions(run_type: Any) -> Functions:
    """The function of every node; `run_type`: numba's type of the run."""
    mail = numba.typeof(by_reference(mailbox()))
    arguments = (types.voidptr, types.voidptr, mail, run_type, NUMBERS)
    return {"node_tick": (tick, arguments)}
