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
import os
import struct
import sys
from collections.abc import Callable, Sequence
from contextlib import redirect_stdout
from operator import index
from pathlib import Path
from typing import Any, NamedTuple

from firmware_py.core.config import Config
from firmware_py.interface.frame import Frame
from hil.bus.wire import MAX_STANDARD_ID
from hil.record.traces.own_trace import refuse_state
from hil.record.traces.trace import flatten, numbers_of
from hil.run_files import OWN
from text_input import RefusalError, TextInputError

Tick = Callable[[Config, Any, Sequence[Frame]], tuple[Any, Sequence[Frame]]]
"""One control period: the next state, and the frames to be sent."""


class OwnFile(NamedTuple):
    """What a user's file gives."""

    tick: Tick
    initial: Any


class OwnControllerError(RefusalError, RuntimeError):
    """A user's controller has failed in a tick; the message names the tick, the error and the line."""


def load_own(firmware: str) -> OwnFile:
    """The controller that `FILE.py:FUNCTION` names. Raises TextInputError with the remedy."""
    path, _, name = firmware.rpartition(":")
    file = Path(os.path.realpath(path))
    if not file.is_file():
        raise TextInputError(f"--firmware {firmware}: there is no file {path}; wanted FILE.py:FUNCTION")
    spec = importlib.util.spec_from_file_location(f"own_controller_{file.stem}", file)
    if spec is None or spec.loader is None:
        raise TextInputError(f"--firmware {firmware}: {path} is no Python file; wanted FILE.py:FUNCTION")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        with redirect_stdout(sys.stderr):  # standard output has the result alone
            spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:
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


def classic_frame(can_id: int, data: bytes) -> Frame:
    """The frame; raises ValueError if it is none of classic CAN."""
    if not 0 <= can_id <= MAX_STANDARD_ID or len(data) > 8:
        raise ValueError(f"a frame with the identifier 0x{can_id:X} and {len(data)} bytes")
    return Frame(can_id, data)


class OwnController:
    """A user's controller, called once for each control period."""

    damage: str = ""

    def __init__(self, file: OwnFile, config: Config) -> None:
        self.config = config
        self._tick, self.state = file
        codes = "".join(column.code for column in flatten(OWN, type(file.initial)))
        self._record = struct.Struct(f"<{codes}")

    def tick(self, frames_in: Sequence[Frame], elapsed_ticks: int) -> list[Frame]:
        """Run every period since the last call, the missed ones without frames; return what is to be sent.

        Raises OwnControllerError.
        """
        sent: list[Frame] = []
        for behind_ticks in range(elapsed_ticks - 1, -1, -1):
            received = [] if behind_ticks else list(frames_in)
            try:
                with redirect_stdout(sys.stderr):
                    returned = self._tick(self.config, self.state, received)
            except (Exception, SystemExit) as error:
                raise OwnControllerError(f"the controller failed: {describe(error)}") from error
            try:
                state, tx = returned
                self._record.pack(*numbers_of(state, []))
                sent = [classic_frame(index(can_id), bytes(data)) for can_id, data in tx]
                self.state = state
            except Exception as error:
                raise OwnControllerError(
                    f"the controller returned {returned!r}: {error}; wanted (state, frames), the numbers of "
                    "INITIAL, and identifiers of 11 bits with at most 8 bytes"
                ) from error
        return sent
