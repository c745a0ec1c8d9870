"""A run whose firmware is measured by a master of XCP: the same decisions, and the same frames of control."""

from collections import deque
from collections.abc import Sequence
from pathlib import Path

from xcp_session import command, daq_commands, is_sample

from firmware_py.interface.enums import XcpCommandCode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.node import places
from firmware_py.shell.native import NativeNode
from hil.bench.lockstep import run_lockstep, silent
from hil.record.traces.trace import read
from hil.scenario.scenario import load_scenario
from tools.trade.decisions import decisions_of, differences

SIGNALS = [index for index, place in enumerate(places.ALL) if place.kind is float][:40]
PRESCALER = 40
COMMAND_TICKS = 4
"""Ticks between two commands, in which the firmware answers."""


class MeasuredNode(NativeNode):
    """A controller whose master sets up forty signals at 25 Hz and then only keeps the session open."""

    samples = 0

    def __init__(self, *arguments: object, **parameters: object) -> None:
        super().__init__(*arguments, **parameters)  # type: ignore[arg-type]
        start = command(XcpCommandCode.START_STOP_SYNCH, 1)
        commands = [command(XcpCommandCode.CONNECT), *daq_commands([(SIGNALS, PRESCALER)]), start]
        self._commands = deque(commands)

    def run_period(self, frames: Sequence[Frame], behind_ticks: int) -> list[Frame]:
        due: list[Frame] = []
        if self.ticks % COMMAND_TICKS == 0 and self._commands:
            due = [self._commands.popleft()]
        elif self.ticks % 1000 == 0:
            due = [command(XcpCommandCode.GET_STATUS)]
        sent = super().run_period([*frames, *due], behind_ticks)
        MeasuredNode.samples += sum(map(is_sample, sent))
        return sent


def test_forty_signals_at_25_hz_change_no_decision_and_no_other_frame(tmp_path: Path) -> None:
    scenario = load_scenario("quick-start-below-the-band")
    for name, make in (("alone", NativeNode), ("measured", MeasuredNode)):
        (tmp_path / name).mkdir()
        run_lockstep(scenario, tmp_path / name, 1, silent, make=make)
    traces = [read(tmp_path / name / "firmware.trace") for name in ("alone", "measured")]
    assert not differences(decisions_of(traces[0]), decisions_of(traces[1]))
    marks = [f" {kind.can_id:03X}#" for kind in (kinds.XCP_COMMAND, kinds.XCP_RESPONSE)]
    logs = [(tmp_path / name / "can.log").read_text().splitlines() for name in ("alone", "measured")]
    others = [line for line in logs[1] if not any(mark in line for mark in marks)]
    assert len(logs[1]) - len(others) > 0.9 * (scenario.ticks - 1000)
    assert MeasuredNode.samples > 0.9 * (scenario.ticks - 1000)
    assert others == logs[0]
