"""A parameter, a fault and an event frame take at most three files each, shown by patches to a copy.

Each patch inserts lines before a line of the sources; `generate.py` makes the rest.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import firmware_py

MOST_FILES = 3


class Patch(NamedTuple):
    """`edits`: file, a text that stands in it once, and what takes its place. `proof`: a program."""

    edits: tuple[tuple[str, str, str], ...]
    proof: str


PARAMETER = Patch(
    edits=(
        (
            "interface/parameters.toml",
            "\n[spin_down]\n",
            "\n[belt]\n"
            'torque_n_m = { tier = "module", unit = "N m", low = 0, high = 1, default = 0, meaning = "" }\n'
            "\n[spin_down]\n",
        ),
        (
            "core/control/speed.py",
            "    error_rad_s = target_omega_rad_s - crank.omega_rad_s\n",
            "    feedforward_n_m += config.p.belt.torque_n_m\n"
            "    error_rad_s = target_omega_rad_s - crank.omega_rad_s\n",
        ),
    ),
    proof="""
from firmware_py.core.control import speed
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.shell.parameters import config_from

def feedforward(parameters):
    rest = speed.INITIAL, crank.INITIAL, estimator_state.INITIAL
    return speed.step(config_from(parameters), *rest, 1.0, 0.0).feedforward_n_m

assert abs(feedforward({"belt.torque_n_m": 0.1}) - feedforward({}) - 0.1) < 1e-12
""",
)
FAULT = Patch(
    edits=(
        (
            "interface/vibro.dbc",
            ' 24 "DRIVE_WATCHDOG" ;\nVAL_ 104',
            ' 24 "DRIVE_WATCHDOG" 25 "BIASED" ;\nVAL_ 104',
        ),
        ("interface/vibro.dbc", "fault : 32|8@1+ (1,0) [0|24]", "fault : 32|8@1+ (1,0) [0|25]"),
        (
            "interface/vibro.dbc",
            ' 24 "DRIVE_WATCHDOG" ;\nVAL_ 117',
            ' 24 "DRIVE_WATCHDOG" 25 "BIASED" ;\nVAL_ 117',
        ),
        ("interface/enums.py", "    DRIVE_WATCHDOG = 24\n", "    DRIVE_WATCHDOG = 24\n    BIASED = 25\n"),
        (
            "core/safety/monitors.py",
            "    if estimate.sensor.missed_ticks > config.d.ticks.sensor:\n",
            "    if not abs(estimate.bias_m_s2) <= 5.0:\n"
            "        return Fault.BIASED\n"
            "    if estimate.sensor.missed_ticks > config.d.ticks.sensor:\n",
        ),
    ),
    proof="""
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.safety import monitors
from firmware_py.interface import codec
from firmware_py.interface.enums import Fault
from firmware_py.interface.generated.records import FaultEvent
from firmware_py.shell.parameters import config_from

biased = estimator_state.INITIAL._replace(bias_m_s2=6.0)
fault = monitors.watchdog_fault(config_from({}), crank.INITIAL, biased)
assert fault == Fault.BIASED
assert codec.decode(codec.encode(FaultEvent(0, fault.value, 0))).fault == 25
""",
)
EVENT = Patch(
    edits=(
        (
            "interface/vibro.dbc",
            "BO_ 117 FaultEvent: 7 Firmware\n",
            "BO_ 118 SeparationEvent: 4 Firmware\n"
            ' SG_ impulse_n_s : 0|16@1+ (0.0002,0) [0|13.107] "N s" Recorder\n'
            ' SG_ counter : 20|4@1+ (1,0) [0|15] "" Recorder\n'
            ' SG_ crc : 24|8@1+ (1,0) [0|255] "" Recorder\n\n'
            "BO_ 117 FaultEvent: 7 Firmware\n",
        ),
        (
            "interface/vibro.dbc",
            'BA_ "GenMsgSendType" BO_ 117 1;\n',
            'BA_ "GenMsgSendType" BO_ 118 1;\nBA_ "GenMsgSendType" BO_ 117 1;\n',
        ),
        (
            "interface/vibro.dbc",
            'BA_ "SignalKind" SG_ 117 counter 4;\n',
            'BA_ "SignalKind" SG_ 118 counter 4;\nBA_ "SignalKind" SG_ 118 crc 5;\n'
            'BA_ "SignalKind" SG_ 117 counter 4;\n',
        ),
        ("node/transmitter.py", "    GAIT = 6\n", "    GAIT = 6\n    SEPARATION = 7\n"),
        ("node/transmitter.py", " GAIT = Slow\n", " GAIT, SEPARATION = Slow\n"),
        (
            "node/transmitter.py",
            "    if outputs.separation:\n",
            "    if outputs.separation:\n        now, _ = queue(now, SEPARATION.value)\n",
        ),
        (
            "node/transmitter.py",
            "    if frame == IMPACT.value:\n",
            "    if frame == SEPARATION.value:\n"
            "        event = records.SeparationEvent(now.impact.impulse_n_s)\n"
            "        return packing.pack_separation_event(event, count)\n"
            "    if frame == IMPACT.value:\n",
        ),
        (
            "node/transmitter.py",
            "from firmware_py.interface.generated import kinds, packing\n",
            "from firmware_py.interface.generated import kinds, packing, records\n",
        ),
    ),
    proof="""
from firmware_py.core.state import INITIAL, INITIAL_OUTPUTS
from firmware_py.interface import codec
from firmware_py.interface.frame import Frame, bytes_of
from firmware_py.interface.generated.records import SeparationEvent
from firmware_py.node import transmitter
from firmware_py.shell.parameters import config_from

parted = INITIAL_OUTPUTS._replace(separation=True, impact_impulse_n_s=0.5)
waiting, _ = transmitter.queue_events(transmitter.INITIAL, 1, INITIAL_OUTPUTS, parted)
records = []
while waiting.waiting:
    waiting, frame = transmitter.next_frame(config_from({}), waiting, 1, INITIAL, parted)
    records.append(codec.decode(Frame(frame.can_id, bytes_of(frame.word, frame.length))))
assert SeparationEvent(0.5) in records, records
""",
)


def test_an_addition_takes_few_files(tmp_path: Path) -> None:
    package = Path(firmware_py.__file__).parent
    copy = tmp_path / package.name
    shutil.copytree(package, copy, ignore=shutil.ignore_patterns("__pycache__"))
    for patch in (PARAMETER, FAULT, EVENT):
        assert len({file for file, *_ in patch.edits}) <= MOST_FILES
        for file, before, after in patch.edits:
            text = (copy / file).read_text(encoding="utf-8")
            assert text.count(before) == 1, (file, before)
            (copy / file).write_text(text.replace(before, after), encoding="utf-8")
    python = [sys.executable, "-P"]
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    proofs = PARAMETER.proof + FAULT.proof + EVENT.proof
    for command in ([*python, "-m", "firmware_py.interface.generate"], [*python, "-c", proofs]):
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
