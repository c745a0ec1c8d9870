"""A parameter, a fault, an event frame and a mode take at most three files each.

Diffs on a copy show it: those of the folder `additions`, by name; `generate.py` makes the rest.
"""

from pathlib import Path

from patched_packages import applied, copied, files_of, python

MOST_FILES = 3
PROOFS = {
    "parameter": """
from firmware_py.core.control import speed
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.shell.parameters import config_from

def feedforward(parameters):
    rest = speed.INITIAL, crank.INITIAL, estimator_state.striker_of(estimator_state.INITIAL)
    return speed.step(config_from(parameters).p, *rest, 1.0, 0.0).feedforward_n_m

assert abs(feedforward({"belt.torque_n_m": 0.1}) - feedforward({}) - 0.1) < 1e-12
""",
    "fault": """
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.safety import monitors, supervisor
from firmware_py.interface import codec
from firmware_py.interface.enums import Fault, Mode
from firmware_py.interface.generated.records import FaultEvent
from firmware_py.shell.parameters import config_from

hurled = estimator_state.striker_of(estimator_state.INITIAL)._replace(v_m_s=6.0)
fault = monitors.find_watchdog_fault(config_from({}).monitors, crank.INITIAL, hurled)
assert fault == Fault.HURLED
assert codec.decode(codec.encode(FaultEvent(0, fault.value, 0))).fault == 25
assert supervisor.counts(fault, Mode.RUN)
""",
    "event": """
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
    "mode": """
from firmware_py.core.safety import drive_link, supervisor, watchdog_proof
from firmware_py.core.safety.gate import Findings
from firmware_py.core.safety.supervisor import Observed
from firmware_py.interface import codec, modes
from firmware_py.interface.enums import Fault, Mode, OperatorRequest
from firmware_py.interface.generated.records import FirmwareHeartbeat
from firmware_py.interface.zeroed import zeroed

stopping = supervisor.INITIAL._replace(mode=Mode.STOPPING)
NONE = Fault.NONE
nothing = zeroed(Findings, watchdog=NONE, limit=NONE, drive=NONE)
still = zeroed(Observed, request=OperatorRequest.RUN, standstill=True)
coasting = supervisor.step(stopping, nothing, still)
assert coasting.mode == Mode.COAST in modes.MOVING
assert drive_link.find_request(coasting.mode, watchdog_proof.REST) == modes.KEEP
beat = zeroed(FirmwareHeartbeat, mode=Mode.COAST.value)
assert codec.decode(codec.encode(beat)).mode == 8
""",
}
"""Programs that use what was added."""


def test_an_addition_takes_few_files(tmp_path: Path) -> None:
    copied(tmp_path, "firmware_py")
    for name in PROOFS:
        diff = Path(__file__).with_name("additions").joinpath(f"{name}.diff").read_text(encoding="utf-8")
        assert len(files_of(diff)) <= MOST_FILES
        applied(diff, tmp_path)
    python(tmp_path, "-m", "firmware_py.interface.generate")
    python(tmp_path, "-c", "".join(PROOFS.values()))
