"""A parameter, a fault and an event frame take at most three files each, shown by diffs on a copy.

The diffs are those of the folder `additions`, by name; `generate.py` makes the rest.
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
    rest = speed.INITIAL, crank.INITIAL, estimator_state.INITIAL
    return speed.step(config_from(parameters), *rest, 1.0, 0.0).feedforward_n_m

assert abs(feedforward({"belt.torque_n_m": 0.1}) - feedforward({}) - 0.1) < 1e-12
""",
    "fault": """
from firmware_py.core.estimation import crank, estimator_state
from firmware_py.core.safety import monitors
from firmware_py.interface import codec
from firmware_py.interface.enums import Fault
from firmware_py.interface.generated.records import FaultEvent
from firmware_py.shell.parameters import config_from

biased = estimator_state.INITIAL._replace(bias_m_s2=6.0)
fault = monitors.find_watchdog_fault(config_from({}), crank.INITIAL, biased)
assert fault == Fault.BIASED
assert codec.decode(codec.encode(FaultEvent(0, fault.value, 0))).fault == 25
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
