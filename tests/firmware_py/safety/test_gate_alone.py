"""The gate with noise in the place of estimators, detector and control: no limit is missed."""

import math
import random
from typing import Any

import pytest
from records import HEALTHY, replaced

from firmware_py.core import step as core
from firmware_py.core.config import Config
from firmware_py.core.estimation import detector
from firmware_py.core.estimation.estimator_state import Contact
from firmware_py.core.inputs import Inputs
from firmware_py.core.safety import gate
from firmware_py.core.safety.consent import ConsentState
from firmware_py.core.state import INITIAL, Outputs, State
from firmware_py.interface.arrivals import Counters, Now
from firmware_py.interface.enums import AxisState, Fault, Mode, OperatorRequest
from firmware_py.interface.frame import WordFrame
from firmware_py.interface.generated import kinds
from firmware_py.interface.generated.received import Received
from firmware_py.interface.generated.records import Accelerometer
from firmware_py.node import inbox
from firmware_py.node import tick as node
from firmware_py.shell.parameters import config_from

CONFIG = config_from({})
OBSERVERS = ("crank", "estimator", "detector", "regime")
RUNNING = INITIAL._replace(
    supervisor=INITIAL.supervisor._replace(mode=Mode.RUN),
    consent=ConsentState(OperatorRequest.RUN, OperatorRequest.RUN, 0),
)
CLOSED = replaced(
    replaced(HEALTHY, "drive.axis_state", AxisState.CLOSED_LOOP_CONTROL),
    "operator.request",
    OperatorRequest.RUN,
)
WILD = (math.nan, math.inf, -math.inf, 0.0, 1e300)


def noisy(record: Any, dice: random.Random) -> Any:
    """The record with noise in every float, now and then no number."""
    if isinstance(record, float):
        return dice.choice(WILD) if dice.random() < 0.1 else dice.gauss(0.0, 10.0)
    if not hasattr(record, "_fields"):
        return record
    return type(record)(*(noisy(one, dice) for one in record))


def inputs_at(tick: int, changes: dict[str, Any]) -> Inputs:
    """The inputs of a healthy module that turns at 12 rad/s, but for the changes."""
    inputs = replaced(CLOSED, "encoder.position_rev", (12e-3 * tick / math.tau) % 1.0)
    inputs = replaced(inputs, "encoder.velocity_rev_s", 12.0 / math.tau)
    for channel in ("low", "high", "housing"):
        inputs = replaced(inputs, f"accelerometer.{channel}_m_s2", 0.01 * (tick % 7))
    for path, value in changes.items():
        inputs = replaced(inputs, path, value)
    return inputs


class NodeNow:
    """The tick in RUN, on inputs that no frame can carry."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.state, self.inputs = node.INITIAL._replace(core=RUNNING), HEALTHY
        monkeypatch.setattr(node, "inputs_of", lambda *_: self.inputs)
        monkeypatch.setattr(node, "receive", self.receive)

    def receive(self, _now: Now, received: Received, counters: Counters, _frame: WordFrame) -> Any:
        """Receive the inputs' sample in the place of the frame."""
        arrival = received.accelerometer_arrival
        arrival = arrival._replace(counter=(arrival.counter + 1) % gate.COUNTER_MODULUS)
        sample = Accelerometer(*self.inputs.accelerometer[:3])
        return received._replace(accelerometer=sample, accelerometer_arrival=arrival), counters, True

    def run(self, inputs: Inputs) -> Outputs:
        """One tick, in which a sample has come if it has no age."""
        self.inputs, waiting = inputs, [0] * inbox.SIZE
        if inputs.accelerometer.age_ticks == 0:
            inbox.receive(waiting, WordFrame(kinds.ACCELEROMETER.can_id, 8, 0))
        self.state, _ = node.tick(CONFIG, self.state, waiting)
        return self.state.outputs


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("changes", "ticks", "fault"),
    [
        ({}, 400, Fault.NONE),
        ({"accelerometer.high_m_s2": -1900.0}, 1, Fault.FORCE_LIMIT),
        ({"accelerometer.high_m_s2": 1960.0}, 1, Fault.FORCE_LIMIT),
        ({"accelerometer.high_m_s2": math.nan}, 1, Fault.FORCE_LIMIT),
        ({"accelerometer.high_m_s2": -450.0}, 5, Fault.IMPULSE_LIMIT),
        ({"encoder.velocity_rev_s": 6.0}, 1, Fault.OVERSPEED),
        ({"encoder.velocity_rev_s": math.nan}, 1, Fault.OVERSPEED),
        ({"power.current_a": 13.0}, 21, Fault.OVERCURRENT),
        ({"power.motor_degc": 91.0}, 1, Fault.OVERTEMPERATURE),
        ({"power.voltage_v": 31.0}, 151, Fault.OVERVOLTAGE),
        ({"power.voltage_v": 17.0}, 151, Fault.UNDERVOLTAGE),
        ({"drive.axis_error": 0x200}, 1, Fault.DRIVE_ERROR),
        ({"accelerometer.age_ticks": 31}, 1, Fault.SENSOR_TIMEOUT),
        ({"encoder.age_ticks": 31}, 1, Fault.ENCODER_TIMEOUT),
        ({"drive.age_ticks": 351}, 1, Fault.DRIVE_TIMEOUT),
        ({"operator.age_ticks": 351}, 1, Fault.OPERATOR_TIMEOUT),
        ({"encoder.position_rev": 29 * 12e-3 / math.tau}, 22, Fault.DRIVE_FROZEN),
    ],
)
@pytest.mark.requirement("S-04")
def test_no_limit_is_missed(
    changes: dict[str, Any], ticks: int, fault: Fault, seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    dice = random.Random(seed)

    def sense_noise(_config: Config, state: State, _inputs: Inputs, _touching: bool) -> tuple[State, Contact]:
        observed = {name: noisy(getattr(INITIAL, name), dice) for name in OBSERVERS}
        return state._replace(**observed), noisy(detector.FLYING, dice)

    monkeypatch.setattr(core, "sense", sense_noise)
    # The monitors, which read the noise, are silent: what is found, the gate has found.
    watch = core.monitors.step

    def silent(*arguments: Any) -> Any:
        state, _ = watch(*arguments)
        return state._replace(freewheel_ticks=0), arguments[3]

    monkeypatch.setattr(core.monitors, "step", silent)
    monkeypatch.setattr(
        core.speed, "step", lambda _, state, *__: state._replace(torque_n_m=dice.choice((*WILD, 0.3, -0.3)))
    )
    for block in (core.start, core.hold):
        state_of = {core.start: "start", core.hold: "hold"}[block]
        monkeypatch.setattr(block, "step", lambda *_, name=state_of, **__: getattr(RUNNING, name))
    now = NodeNow(monkeypatch)
    for number in range(30):
        outputs = now.run(inputs_at(number, {}))
        assert (outputs.mode, outputs.fault) == (Mode.RUN, Fault.NONE)
        assert abs(outputs.torque_n_m) <= 0.6
    for number in range(30, 30 + ticks):
        outputs = now.run(inputs_at(number, changes))
    assert outputs.fault == fault
    if fault != Fault.NONE:
        assert (outputs.mode, outputs.torque_n_m) == (Mode.FAULT, 0.0)
