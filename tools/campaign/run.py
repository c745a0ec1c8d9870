"""One closed loop from Python: a scene, parameters and a script in; impacts, detections and modes out."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_py.core.step import INITIAL, Config
from firmware_py.interface.enums import Fault, Mode
from hil.drive import power_up
from hil.operator import ON_THE_BUS, Command
from hil.plant_node import drive_config
from hil.reports import first_reports, report_ticks
from plant_sim.parts.parts import Parts
from plant_sim.scene import Scene
from plant_sim.sensing import allocate_sensing
from plant_sim.sensors import readers
from plant_sim.simulation import initial_state
from plant_sim.solvers.memory import IMPACTS
from tools.campaign import columns, loop
from tools.campaign.gait_frames import gait_frames
from tools.campaign.loop import Plan, Record, Scales, Script, record
from tools.campaign.plant import filters, is_supported, module
from tools.campaign.quantise import signal_counts
from tools.campaign.shell import FIRST_HEARD
from tools.output import BadInputError

FloatArray = NDArray[np.float64]

UNDISTURBED = Plan(kick_tick=-1, kick_m_s=0.0, judged_tick=0, endless=False, coarse_ticks=0)
IMPACTS_A_SECOND = 40
"""Room for impacts; a run that needs more chatters and is cut short, which it says."""


class ModeChange(NamedTuple):
    """When the firmware went into a mode, s, and the fault it gave then."""

    t_s: float
    mode: Mode
    fault: Fault


class Run(NamedTuple):
    """What happened. Impacts: columns (t_s, v, v after, impulse, peak force, crank angle), shape (n, 6)."""

    parts: Parts
    tick_s: float
    impacts: FloatArray
    detected_s: FloatArray
    detections: FloatArray
    periods: FloatArray
    modes: list[ModeChange]
    turns_s: FloatArray
    kicked_s: float | None
    kicked: FloatArray
    sums: FloatArray
    trace: FloatArray
    cut_short: bool


def supported(scene: Scene, seed: int = 1) -> Parts:
    """The parts of a scene that campaigns know; of a walk the strides are sampled from `seed`."""
    parts = scene.parts(seed)
    if scene.sensors is None or not is_supported(parts):
        raise BadInputError(
            f"campaigns run a motor, sensors and a Hunt–Crossley stop; "
            f"the scene has drive.model = {scene.drive.model!r}, stop.law = {scene.stop.law!r}"
        )
    return parts


def run(
    scene: Scene,
    config: Config,
    commands: Sequence[Command],
    duration_s: float,
    noise: np.random.Generator,
    plan: Plan = UNDISTURBED,
    traced: bool = False,
    room_s: float | None = None,
    walk_seed: int = 1,
) -> Run:
    """Run a closed loop from power-up on; `room_s` of an endless one: for how long there is room.

    `walk_seed`: of the strides and the gait sensors' noise, where somebody walks.
    """
    room_s = duration_s if room_s is None else room_s
    parts = supported(scene, walk_seed)
    assert scene.sensors is not None
    models, initial = scene.sensors.models(), initial_state(scene)
    tick_s = config.tick_s
    sensing = allocate_sensing(models, initial.omega_rad_s, parts.housing)
    moving = module(parts, initial, 64 + round(IMPACTS_A_SECOND * room_s))
    scales = Scales(
        striker_low=signal_counts("Accelerometer", "striker_low_m_s2"),
        striker_high=signal_counts("Accelerometer", "striker_high_m_s2"),
        housing=signal_counts("Accelerometer", "housing_m_s2"),
        coarse=signal_counts("CoarsePosition", "striker_position_m"),
        ratio=signal_counts("OperatorCommand", "target_ratio"),
        impulse=signal_counts("OperatorCommand", "target_impulse_n_s"),
    )
    script = Script(
        at_tick=np.array([round(command.at_s / tick_s) for command in commands], dtype=np.int64),
        request=np.array([ON_THE_BUS[command.request].value for command in commands], dtype=np.int64),
        target_ratio=np.array([command.target_ratio for command in commands]),
        target_impulse_n_s=np.array([command.target_impulse_n_s for command in commands]),
    )
    books = record(room_s, tick_s, traced)
    drive = drive_config(scene)
    loop.run(
        parts,
        filters(sensing, tick_s),
        moving,
        readers(models),
        scales,
        drive,
        power_up(drive),
        report_ticks(tick_s, None if scene.axis is None else scene.axis.heartbeat_s),
        first_reports(0),
        FIRST_HEARD,
        config,
        INITIAL,
        script,
        gait_frames(scene, parts, walk_seed, duration_s, tick_s),
        plan,
        noise,
        books,
        round(duration_s / tick_s),
    )
    return _of(parts, tick_s, books, moving.memory.impacts[: moving.memory.mode[IMPACTS]])


def _of(parts: Parts, tick_s: float, books: Record, impacts: FloatArray) -> Run:
    counts = books.counts
    detections = books.detections[: counts[columns.DETECTIONS]]
    return Run(
        parts=parts,
        tick_s=tick_s,
        impacts=impacts[np.argsort(impacts[:, 0], kind="stable")],
        detected_s=(detections[:, 0] + 0.5) * tick_s,
        detections=detections,
        periods=books.periods[: counts[columns.PERIODS]],
        modes=[
            ModeChange(float(tick) * tick_s, Mode(int(mode)), Fault(int(fault)))
            for tick, mode, fault in books.modes[: counts[columns.MODES]]
        ],
        turns_s=books.turns[: counts[columns.TURNS_SEEN]] * tick_s,
        kicked_s=float(counts[columns.KICKED]) * tick_s if counts[columns.KICKED] else None,
        kicked=books.kicked,
        sums=books.sums,
        trace=books.trace,
        cut_short=bool(counts[columns.FULL]),
    )


def first_in(modes: Sequence[ModeChange], mode: Mode) -> ModeChange | None:
    """The first change into a mode."""
    return next((change for change in modes if change.mode == mode), None)


def rms(run_: Run, place: int) -> float:
    """Root of the mean of one of the run's sums of squares."""
    ticks: Any = run_.sums[columns.SUM_TICKS]
    return float(np.sqrt(run_.sums[place] / ticks)) if ticks > 0 else float("nan")
