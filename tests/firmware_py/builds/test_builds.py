"""The builds of one source: the same bits from `compiled` and from `python` with the written-out algebra."""

import math
import random
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from closed_loop import Bench
from hypothesis import given
from hypothesis import strategies as st
from records import leaves
from walker import walk
from xcp_session import calibrate, commands_of

from firmware_py.builds import flat
from firmware_py.core.estimation import kalman
from firmware_py.interface import codec
from firmware_py.interface.enums import Mode, OperatorRequest, XcpError
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import GaitSensors
from firmware_py.node.tick import INITIAL, NodeState
from firmware_py.shell.builds import node_of
from firmware_py.shell.parameters import config_from
from hil.record.traces.firmware_trace import FirmwareTrace, fields_of
from hil.record.traces.trace import TraceWriter, read
from hil.timing.loop import LoopTiming


class Twins(Bench):
    """A closed loop on the interpreted firmware, with the compiled one listening to the same frames."""

    def __post_init__(self) -> None:
        super().__post_init__()
        one = self.node
        other = node_of("compiled")(config_from(self.parameters))
        self.other = other
        tick = one.tick

        def both(frames: list[Frame], elapsed_ticks: int) -> list[Frame]:
            sent = tick(frames, elapsed_ticks)
            assert other.tick(frames, elapsed_ticks) == sent, self.tick
            return sent

        one.tick = both  # type: ignore[method-assign,assignment]


def bits(record: tuple) -> dict[str, object]:
    return {
        name: struct.pack("<d", value) if isinstance(value, float) else int(value)
        for name, value in leaves(record).items()
    }


@pytest.fixture
def written_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kalman, "predict", kalman.predict_written_out)
    monkeypatch.setattr(kalman, "update", kalman.update_written_out)


@pytest.mark.usefixtures("written_out")
def test_both_builds_send_the_same_bytes_among_damaged_lost_and_late_frames() -> None:
    dice = random.Random(1)

    def change(_: int, frames: list[Frame]) -> list[Frame]:
        kept = []
        for sent in frames:
            frame, fate = sent, dice.random()
            if fate < 0.01:
                continue
            if fate < 0.02:
                frame = Frame(frame.can_id, bytes([frame.data[0] ^ dice.randrange(256)]) + frame.data[1:])
            kept += [frame, frame] if 0.02 <= fate < 0.03 else [frame]
        return kept

    missed = [False]

    def overrun(_: int) -> bool:
        missed[0] = dice.random() < (0.8 if missed[0] else 0.01)
        return missed[0]

    bench = Twins(
        {"start.rise_s": 2.0, "start.confirm_periods": 2}, change=change, overrun=overrun, build="python"
    )
    bench.started()
    bench.run(4.5, keep=False)
    assert bench.node.outputs.mode == Mode.RUN
    bench.request = OperatorRequest.IDLE
    bench.run(0.5, keep=False)
    bench.axis_error = 0x200
    bench.run(0.3, keep=False)
    assert bench.node.outputs.mode == Mode.FAULT
    assert bits(bench.node.state) == bits(bench.other.state)
    assert bits(bench.node.inputs) == bits(bench.other.inputs)
    assert bits(bench.node.outputs) == bits(bench.other.outputs)
    assert bench.node.counters == bench.other.counters
    assert bench.node.counters.rejected_crc > 10


class Recorded(Bench):
    """A closed loop that keeps the frames of each tick."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.received: list[list[Frame]] = []
        tick = self.node.tick

        def recorded(frames: list[Frame], elapsed_ticks: int) -> list[Frame]:
            self.received.append(frames)
            return tick(frames, elapsed_ticks)

        self.node.tick = recorded  # type: ignore[method-assign,assignment]


@pytest.fixture(scope="module")
def walked() -> Recorded:
    """A start into the impact regime with lost frames and a fault at the end; somebody walks."""
    bench = Recorded({"start.rise_s": 2.0, "start.confirm_periods": 2}, build="python")
    steps = walk(np.random.default_rng(1), stride_s=0.75, count=12)

    def changed(tick: int, frames: list[Frame]) -> list[Frame]:
        row = tick // 5 - 60
        if tick % 5 == 0 and 0 <= row < len(steps.t_s):
            sensors = GaitSensors(
                float(steps.rate_rad_s[row]), 9.8, int(steps.heel[row]), int(steps.toe[row])
            )
            frames = [*frames, codec.GAIT_SENSORS.encode(sensors, row)]
        return frames[:1] if tick % 97 == 0 else frames

    bench.change = changed
    bench.started()
    bench.run(6.0)
    bench.request = OperatorRequest.IDLE
    bench.run(0.8)
    bench.axis_error = 0x200
    bench.run(0.3)
    return bench


# The recorded crank does not follow what a firmware that follows the gait asks of it.
FOLLOWS = {"gait.follow": 1, "gait.lowest_ratio": 0.5, "start.rise_s": 2.0}


@pytest.mark.usefixtures("written_out")
@pytest.mark.parametrize("parameters", [None, FOLLOWS], ids=["as recorded", "follows the gait"])
def test_both_builds_keep_the_same_bits_while_somebody_walks(
    walked: Recorded, parameters: dict[str, float] | None
) -> None:
    parameters = walked.parameters if parameters is None else parameters
    python, compiled = (node_of(build)(config_from(parameters)) for build in ("python", "compiled"))  # type: ignore[arg-type]
    confidence, harmonic = 0.0, 0
    for tick, frames in enumerate(walked.received):
        assert compiled.tick(frames, 1) == python.tick(frames, 1), tick
        confidence = max(confidence, python.state.gait.confidence)
        harmonic = max(harmonic, python.state.gait_lock.harmonic)
        if tick % 10 == 0 or tick == len(walked.received) - 1:
            assert bits(compiled.inputs) == bits(python.inputs), tick
            assert bits(compiled.state) == bits(python.state), tick
            assert bits(compiled.outputs) == bits(python.outputs), tick
    assert confidence > 0.25
    assert (harmonic > 0) == (parameters == FOLLOWS)


def test_xcp_is_served_alike() -> None:
    """Calibration, its refusals, uploads and DAQ lists: the same frames in the same ticks."""
    nodes = [node_of(build)(config_from({})) for build in ("python", "compiled")]  # type: ignore[arg-type]
    for frame in commands_of(random.Random(1), 3000):
        sent = [one.tick([frame], 1) for one in nodes]
        assert sent[0] == sent[1], frame
    errors = [calibrate(one, "start.rise_s", 6.0) for one in nodes]
    assert errors == [XcpError.NONE, XcpError.NONE]
    assert nodes[0].values == nodes[1].values
    assert nodes[1].config == nodes[0].config
    assert nodes[1].values["start.rise_s"] == 6.0


def test_a_trace_gets_the_same_numbers(tmp_path: Path) -> None:
    bench = Twins(build="python")
    bench.run(0.3, keep=False)
    timing = LoopTiming(1_000, 2.5, 3.5, 4)
    for name, node in (("python", bench.node), ("compiled", bench.other)):
        trace = FirmwareTrace(TraceWriter(tmp_path / name, fields_of(walks=True)), walks=True)
        trace.append(node, 7, 0.0075, timing)
        trace.writer.close()
    rows = [read(tmp_path / name)[0] for name in ("python", "compiled")]
    assert rows[0].dtype == rows[1].dtype
    for column in rows[0].dtype.names:
        assert rows[1][column] == pytest.approx(rows[0][column], nan_ok=True), column
    assert (rows[1]["tick"], rows[1]["t_s"], rows[1]["overruns"]) == (7, 0.0075, 4)


def test_a_record_survives_the_way_into_flat_memory() -> None:
    memory = flat.to_flat(INITIAL)
    assert repr(flat.from_flat(NodeState, memory[0].item())) == repr(INITIAL)


class Odd(NamedTuple):
    whole: int
    flag: bool
    real: float
    pair: tuple[float, float]


@given(
    st.tuples(
        st.integers(-(2**63), 2**63 - 1), st.booleans(), st.floats(), st.tuples(st.floats(), st.floats())
    )
)
def test_every_number_survives_the_way_into_flat_memory(values: tuple) -> None:
    back = flat.from_flat(Odd, flat.to_flat(Odd(*values))[0].item())
    assert repr(back) == repr(Odd(*values))
    assert flat.layout(Odd).itemsize == 40
    assert [flat.layout(Odd).fields[name][1] for name in Odd._fields] == [0, 8, 16, 24]


def test_what_the_subset_has_not_has_no_flat_memory() -> None:
    with pytest.raises(TypeError, match="wanted a tuple of one type"):
        flat.layout(tuple[int, float])
    with pytest.raises(TypeError, match="wanted float, int, bool"):
        flat.layout(str)


def test_nothing_moves_on_in_a_tick_that_is_refused() -> None:
    one = node_of("compiled")(config_from({}))
    with pytest.raises(ValueError, match="elapsed_ticks = 0"):
        one.tick([], 0)
    assert math.isfinite(one.outputs.torque_n_m)
    assert one.memory.tobytes() == flat.to_flat(INITIAL).tobytes()  # type: ignore[attr-defined]
