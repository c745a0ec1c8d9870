"""A scenario: a plant, the firmware's parameters, a script of commands, and the checks that judge the run.

The files lie in hil/scenarios, in folders by the kind of fault, and are named as sentences.
`hil.scenario.files` reads their complete tables, so that every value can be changed; `load_scenario` checks
them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

from pydantic import Field, ValidationError, field_validator, model_validator

from firmware_py.core.config import Config
from firmware_py.shell.parameters import config_from
from hil.bus.model.bits import bit_ns_of
from hil.drive.axis_table import BenchScene
from hil.faults.every import AnyFault
from hil.faults.fault import Fault
from hil.faults.on_bus import ModelledFault
from hil.faults.on_process import ClockFault, ProcessFault
from hil.scenario.checks import LONGEST_S, MOST_CHECKS, Check
from hil.scenario.commands import Command, CommandTable, Request
from hil.scenario.files import ScenarioError, read_scenario, scenario_name
from hil.scenario.limits import Judged, take_limits
from hil.scenario.parameter_file import merge_files
from hil.scenario.settings import Settings, apply_settings, as_texts
from hil.timing.clock import TICK_S
from plant_sim.scene import Scene
from plant_sim.tables.quantities import Duration
from plant_sim.tables.table import Table
from plant_sim.validation_messages import messages_of
from text_input import TextInputError

MOST_FAULTS, MOST_COMMANDS = 100, 1000
"""Largest numbers of a script's faults and commands."""


class ScriptTable(Table):
    """Duration of the run, the operator's commands, and the faults."""

    duration_s: Duration = Field(gt=0.0, le=LONGEST_S, description="the run's length in s")
    longest_delay_s: Duration = Field(
        default=0.61,
        ge=0.0,
        le=LONGEST_S,
        description="the longest delay of the first fault and of all that follows, in s, which several "
        "seeds sample; by default a drive period at r = 1.1, so that faults come at every phase; it makes no "
        "run longer than a day",
    )
    commands: list[CommandTable] = Field(
        default=[], max_length=MOST_COMMANDS, description="the tables [[script.commands]]"
    )
    faults: list[AnyFault] = Field(
        default=[], max_length=MOST_FAULTS, description="the tables [[script.faults]]"
    )

    @model_validator(mode="after")
    def _commands_come_in_time(self) -> Self:
        for command in self.commands:
            if command.at_s >= self.duration_s:
                raise ValueError(
                    f"the command at {command.at_s} s comes after the end, script.duration_s = "
                    f"{self.duration_s}; give it earlier, or let the run last longer"
                )
        for fault in self.faults:
            if fault.at_s >= self.duration_s:
                raise ValueError(
                    f"the fault {fault.kind!r} at {fault.at_s} s comes after the end, script.duration_s = "
                    f"{self.duration_s}; let it begin earlier, or let the run last longer"
                )
            if isinstance(fault, ProcessFault) and fault.starts_anew and fault.end_s >= self.duration_s:
                raise ValueError(
                    f"the fault {fault.kind!r} at {fault.at_s} s starts the {fault.process} anew at "
                    f"{fault.end_s:g} s, after the end, script.duration_s = {self.duration_s}; let the run "
                    "last longer, or take the fault 'killed'"
                )
        return self

    @model_validator(mode="after")
    def _a_process_ends_once(self) -> Self:
        ended: set[str] = set()
        for fault in self.faults:
            if isinstance(fault, ProcessFault) and fault.ends_process:
                if fault.process in ended:
                    raise ValueError(f"the {fault.process} ends twice; kill or restart a process once a run")
                ended.add(fault.process)
        return self


class BusTable(Table):
    """The bus model of lockstep; a run in real time uses a real bus instead."""

    bitrate: int = Field(
        default=1_000_000, ge=10_000, le=1_000_000, description="the modelled bus's bits per second"
    )

    @field_validator("bitrate")
    @classmethod
    def _has_whole_nanoseconds(cls, bitrate: int) -> int:
        bit_ns_of(bitrate)
        return bitrate


class ScenarioTable(Table):
    """A scenario's file; its scene and its firmware's parameters are checked separately."""

    title: str = Field(min_length=1, description="the statement that the run must confirm, as a sentence")
    scene: dict[str, Any] = Field(description="the scene's tables, or the name or the file of a scene")
    firmware: dict[str, Any] = Field(
        default={}, description="parameters that differ from their defaults, or a file of `vibrohil tune`"
    )
    bus: BusTable | None = Field(
        default=None, description="the table [bus]: a modelled bus, on which frames take time"
    )
    script: ScriptTable = Field(description="the table [script] with duration_s and commands")
    seed: int = Field(default=1, ge=0, description="the default seed of a run")
    checks: list[Check] = Field(
        default=[],
        max_length=MOST_CHECKS,
        description="the checks, as tables or as names of sets; a check with the name of one in a set before "
        "it changes the given keys of that one",
    )

    @model_validator(mode="after")
    def _bus_faults_have_a_bus(self) -> Self:
        for fault in self.script.faults:
            if isinstance(fault, ModelledFault) and self.bus is None:
                raise ValueError(
                    f"the fault {fault.kind!r} acts in the bus model, and the scenario has none; "
                    "add the table [bus]"
                )
        return self


@dataclass(frozen=True)
class Scenario:
    """A checked scenario; `document` holds its raw tables for the run folder."""

    name: str
    title: str
    scene: Scene
    config: Config
    parameters: dict[str, Any]
    """The firmware's parameters that differ from their defaults."""
    bitrate: int | None
    """Bit rate of the modelled bus in bit/s; None: frames arrive at once."""
    duration_s: float
    longest_delay_s: float
    """Longest sampled delay of the first fault, and of all that follows, with several seeds."""
    commands: tuple[Command, ...]
    faults: tuple[Fault, ...]
    seed: int
    """Default seed of a run."""
    checks: tuple[Check, ...]
    document: Mapping[str, Any]
    changes: tuple[str, ...]
    """Changes to the file: parameter files by name, and settings as KEY=VALUE."""

    @property
    def period_s(self) -> float:
        """The control period in s, the same for plant and firmware."""
        return self.config.tick_s

    @property
    def ticks(self) -> int:
        """Ticks of the whole run."""
        return round(self.duration_s / self.period_s)


def load_scenario(
    source: str | Path, settings: Settings = (), parameter_files: Sequence[Path] = ()
) -> Scenario:
    """A checked scenario from a name or a file, with tuned parameters and, over them, `KEY=VALUE` changes.

    Raises `ScenarioError`, the scene's `SceneError`, a file's `TextInputError` or the firmware's
    `ParameterError`.
    """
    document = read_scenario(source)
    if parameter_files:
        document["firmware"] = merge_files(document["firmware"], parameter_files)
    changes = (*map(str, parameter_files), *as_texts(settings))
    return check_scenario(apply_settings(document, settings), scenario_name(source), changes)


def check_scenario(document: Mapping[str, Any], name: str, changes: Sequence[str] = ()) -> Scenario:
    """A checked scenario from raw tables; `changes` lists the changes to its file."""
    try:
        table = ScenarioTable.model_validate(document)
    except ValidationError as error:
        raise ScenarioError("\n".join(messages_of(error, ScenarioTable))) from error
    scene = BenchScene.load(table.scene)
    _refuse_without_motor_or_sensors(scene)
    config = config_from(table.firmware)
    _refuse_less_than_a_tick(table.script.duration_s, config.tick_s)
    _refuse_without_object(table.script.faults, scene)
    _refuse_small_jumps(table.script.faults, config.tick_s)
    commands = tuple(
        Command(
            command.at_s,
            Request(command.request),
            command.target_ratio or 0.0,
            command.target_impulse_n_s or 0.0,
        )
        for command in table.script.commands
    )
    checks = _take_limits(Judged(scene, config, commands, table.script.faults, table.checks))
    return Scenario(
        name=name,
        title=table.title,
        scene=scene,
        config=config,
        parameters=table.firmware,
        bitrate=None if table.bus is None else table.bus.bitrate,
        duration_s=table.script.duration_s,
        longest_delay_s=table.script.longest_delay_s,
        commands=commands,
        faults=tuple(table.script.faults),
        seed=table.seed,
        checks=checks,
        document={**document, **({"checks": [_as_table(check) for check in checks]} if checks else {})},
        changes=tuple(changes),
    )


def _take_limits(judged: Judged) -> tuple[Check, ...]:
    """The checks with the limits of their requirements; raises `ScenarioError`."""
    try:
        return take_limits(judged)
    except TextInputError as error:
        raise ScenarioError(str(error)) from error


def _as_table(check: Check) -> dict[str, Any]:
    """A check as a table of a scenario's file."""
    return check.model_dump(exclude_defaults=True, exclude_none=True)


def _refuse_without_motor_or_sensors(scene: Scene) -> None:
    """Raise `ScenarioError` if the scene has no motor that accepts torque, or no sensors."""
    if scene.drive.model == "ideal":
        raise ScenarioError(
            "scene.drive.model = 'ideal' turns at its own speed whatever the firmware commands; set "
            "'motor' or 'dq-motor' (without ratio, frequency_hz or speed_rad_s), or run the scene alone with "
            "`vibrohil simulate`"
        )
    if scene.sensors is None:
        raise ScenarioError("scene has no sensors for the firmware to read; add the table [scene.sensors]")


def _refuse_less_than_a_tick(duration_s: float, tick_s: float) -> None:
    if duration_s < tick_s:
        raise ScenarioError(
            f"script.duration_s = {duration_s:g} is shorter than a tick, "
            f"firmware.control.tick_s = {tick_s:g}; let the run last longer"
        )


def _refuse_without_object(faults: Sequence[Fault], scene: Scene) -> None:
    """Raise `ScenarioError` if a fault of the script cannot act on anything."""
    reasons = [(fault, fault.without_object(scene, faults)) for fault in faults]
    sentences = [
        f"the fault {fault.kind!r} at {fault.at_s:g} s cannot act: {reason}"
        for fault, reason in reasons
        if reason is not None
    ]
    if sentences:
        raise ScenarioError("\n".join(sentences))


def _refuse_small_jumps(faults: Sequence[Fault], tick_s: float) -> None:
    """Raise `ScenarioError` if a clock jumps by less than half a tick."""
    for fault in faults:
        if isinstance(fault, ClockFault) and not fault.latest_s and abs(fault.ahead_s) < 0.5 * tick_s:
            raise ScenarioError(
                f"the fault {fault.kind!r} at {fault.at_s:g} s cannot act: a jump of less than half a tick, "
                f"{tick_s:g} s, moves no tick"
            )


def refuse_other_periods(period_s: float) -> None:
    """Raise `ScenarioError` if the period is not the real bus's; only lockstep may vary it."""
    if period_s != TICK_S:
        raise ScenarioError(
            f"firmware.control.tick_s = {period_s}: in real time the bus carries one tick a "
            f"{TICK_S} s; leave it out, or run with --clock lockstep"
        )


def refuse_modelled_bus(scenario: Scenario) -> None:
    """Raise `ScenarioError` if the scenario has a modelled bus, which only lockstep supports."""
    if scenario.bitrate is not None:
        raise ScenarioError(
            f"scenario {scenario.name!r} has the table [bus], a modelled bus, which real time has not; "
            "run it with --clock lockstep"
        )
