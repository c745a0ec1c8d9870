"""A user's own controller in place of the firmware, in lockstep or as a process of real time.

    vibrohil run SCENARIO --firmware mine.py:tick

`mine.py` has the function `tick(config, state, rx) -> (state, tx)` and `INITIAL`, its state before the first
tick: a NamedTuple of numbers. `config` is the firmware's `Config`, of which `config.tick_s` is the period and
`config.p` the nominal parameters. `rx` and `tx` are lists of frames (`firmware_py.interface.frame.Frame`),
those received since the last tick and those to be sent. The file is code that runs as its user.

The state of each tick is recorded. What the controller decides is judged by the frames that it sends, as on a
log of a real bench (`hil.record.traces.own_trace`).
"""

import importlib.util
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, Protocol, cast

from firmware_py.core.config import Config
from firmware_py.interface.frame import Frame
from firmware_py.shell.builds import Build, node_of
from firmware_py.shell.node import MakeNode, power_up
from hil.faults.line import FaultyBus
from hil.faults.memory import ParameterMemory
from hil.nodes.runners import FirmwareRunner, Making, Pace
from hil.record.traces.own_trace import OWN, OwnTrace, is_build, own_fields, refuse_state
from hil.record.traces.trace import OpenTrace
from text_input import TextInputError

Tick = Callable[[Config, Any, Sequence[Frame]], tuple[Any, Sequence[Frame]]]
"""One control period: the next state, and the frames to be sent."""


class OwnFile(NamedTuple):
    """What a user's file gives."""

    tick: Tick
    initial: Any


class OwnControllerError(RuntimeError):
    """A user's controller has failed in a tick; the message names the tick, the error and the line."""


def load_own(firmware: str) -> OwnFile:
    """The controller that `FILE.py:FUNCTION` names. Raises TextInputError with the remedy."""
    path, _, name = firmware.rpartition(":")
    file = Path(path).resolve()
    if not file.is_file():
        raise TextInputError(f"--firmware {firmware}: there is no file {path}; wanted FILE.py:FUNCTION")
    spec = importlib.util.spec_from_file_location(f"own_controller_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise TextInputError(f"--firmware {firmware}: {path} is no Python file; wanted FILE.py:FUNCTION")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise TextInputError(
            f"--firmware {firmware}: {path} fails when imported: {describe(error)}"
        ) from error
    tick, initial = getattr(module, name, None), getattr(module, "INITIAL", None)
    if not callable(tick):
        raise TextInputError(f"--firmware {firmware}: {path} has no function {name}")
    if initial is None:
        raise TextInputError(f"--firmware {firmware}: {path} has no INITIAL, the state before the first tick")
    refuse_state(initial, firmware)
    return OwnFile(tick, initial)


def describe(error: BaseException) -> str:
    """An error of a user's code in one sentence, with the line in which it was raised."""
    at = error.__traceback__
    while at is not None and at.tb_next is not None:
        at = at.tb_next
    where = "" if at is None else f" ({Path(at.tb_frame.f_code.co_filename).name}, line {at.tb_lineno})"
    return f"{type(error).__name__}: {error}{where}"


class OwnController:
    """A user's controller, called once for each control period."""

    damage: str = ""

    def __init__(self, file: OwnFile, config: Config) -> None:
        self.config = config
        self._tick, self.state = file

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run every period since the last call, the missed ones without frames; return what is to be sent.

        Raises OwnControllerError.
        """
        sent: list[Frame] = []
        for behind_ticks in range(elapsed_ticks - 1, -1, -1):
            received = [] if behind_ticks else list(frames_in)
            try:
                self.state, tx = self._tick(self.config, self.state, received)
                sent = [Frame(can_id, bytes(data)) for can_id, data in tx]
            except Exception as error:
                raise OwnControllerError(f"the controller failed: {describe(error)}") from error
        return sent


class OwnRunner(FirmwareRunner):
    """The node of a user's controller at t_k + T/2."""

    def __init__(
        self,
        file: OwnFile,
        memory: ParameterMemory,
        pace: Pace,
        bus: FaultyBus,
        traces: OpenTrace,
        walks: bool = True,
        say: Callable[[str], object] = lambda _: None,
    ) -> None:
        """The arguments after `file` are those of `FirmwareRunner`."""
        self._file = file
        super().__init__(memory, pace, bus, traces, walks, say=say)

    def make_node(self, parameter_file: str) -> OwnController:
        """The controller after power-up."""
        return power_up(parameter_file, self.memory.of_the_build, partial(OwnController, self._file))

    def open_trace(self, traces: OpenTrace, walks: bool) -> OwnTrace | None:
        """The trace of the controller's state; None if it is not kept."""
        writer = traces(OWN, own_fields(type(self._file.initial)), is_ticked=True)
        return None if writer is None else OwnTrace(writer)


class MakeRunner(Protocol):
    """A function or class that makes the runner of a run's controller."""

    def __call__(
        self,
        memory: ParameterMemory,
        pace: Pace,
        bus: Any,
        traces: OpenTrace,
        walks: bool = True,
        say: Callable[[str], object] = lambda _: None,
    ) -> FirmwareRunner:
        """The arguments are those of `FirmwareRunner`."""


def node_maker(firmware: str) -> Callable[[Config], Any]:
    """What makes the node of a build of the firmware, or of `FILE.py:FUNCTION`. Raises TextInputError."""
    if is_build(firmware):
        return node_of(cast(Build, firmware))
    return partial(OwnController, load_own(firmware))


def runner_of(firmware: str | MakeNode) -> MakeRunner:
    """What makes the runner of a build of the firmware, of `FILE.py:FUNCTION`, or of a function's nodes.

    Raises TextInputError.
    """
    if callable(firmware):
        return partial(FirmwareRunner, make=firmware)
    if is_build(firmware):
        return partial(FirmwareRunner, make=node_of(cast(Build, firmware)))
    return partial(OwnRunner, load_own(firmware))


def make_firmware(making: Making) -> FirmwareRunner:
    """The firmware's runner, of the bench's own or of a user's. Raises TextInputError."""
    scenario, seed, pace, bus, faults, traces, firmware, say = making
    memory = ParameterMemory(scenario.parameters, faults, seed)
    walks = scenario.scene.gait is not None
    return runner_of(firmware)(memory, pace, bus, traces, walks, say=say)
