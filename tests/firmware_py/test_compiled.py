"""One source, two ways to run it: the same inputs give the same bits compiled and interpreted."""

import os
import pickle
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from closed_loop import Bench
from records import leaves
from walker import walk

from firmware_py.core import compiled, kalman
from firmware_py.core.step import INITIAL, Config, Outputs, State, step
from firmware_py.interface import codec
from firmware_py.interface.enums import OperatorRequest
from firmware_py.interface.frame import Frame
from firmware_py.interface.records import GaitSensors
from firmware_py.shell.parameters import config_from

REPLAY = """
import pickle, sys
from firmware_py.core.compiled import COMPILED
from firmware_py.core.step import INITIAL, step
assert COMPILED
configs, inputs = pickle.load(open(sys.argv[1], "rb"))
kept = []
for config in configs:
    state, rows = INITIAL, []
    for one in inputs:
        state, outputs = step(config, state, one)
        rows.append((state, outputs))
    kept += rows[:: int(sys.argv[3])] + rows[-1:]
pickle.dump(kept, open(sys.argv[2], "wb"))
"""


@pytest.fixture(scope="module")
def frames() -> Bench:
    """A start into the impact regime with lost frames and a fault at the end; somebody walks."""
    bench = Bench({"start.rise_s": 2.0, "start.confirm_periods": 2})
    walked = walk(np.random.default_rng(1), stride_s=0.75, count=12)

    def changed(tick: int, frames: list[Frame]) -> list[Frame]:
        row = tick // 5 - 60
        if tick % 5 == 0 and 0 <= row < len(walked.t_s):
            sensors = GaitSensors(
                float(walked.rate_rad_s[row]), 9.8, int(walked.heel[row]), int(walked.toe[row])
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


def replay_interpreted(config: Config, bench: Bench) -> list[tuple[State, Outputs]]:
    state, rows = INITIAL, []
    for inputs in bench.inputs:
        state, outputs = step(config, state, inputs)
        rows.append((state, outputs))
    return rows


def bits(record: tuple) -> dict[str, object]:
    flat = leaves(record)
    return {k: struct.pack("<d", v) if isinstance(v, float) else int(v) for k, v in flat.items()}


def test_compiled_and_interpreted_are_equal_bit_for_bit(
    frames: Bench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kalman, "predict", kalman.predict_written_out)
    monkeypatch.setattr(kalman, "update", kalman.update_written_out)
    # The recorded crank does not follow what a firmware that follows the gait asks of it.
    following = config_from({"gait.follow": 1, "gait.lowest_ratio": 0.5, "start.rise_s": 2.0})
    rows = []
    for config in (frames.node.config, following):
        replayed = replay_interpreted(config, frames)
        rows += replayed[::10] + replayed[-1:]
    assert max(state.gait.confidence for state, _ in rows) > 0.25
    assert max(state.lock.harmonic for state, _ in rows) > 0
    source, target = tmp_path / "inputs.pickle", tmp_path / "states.pickle"
    source.write_bytes(pickle.dumps(((frames.node.config, following), frames.inputs)))
    subprocess.run(
        [sys.executable, "-c", REPLAY, str(source), str(target), "10"],
        check=True,
        env=os.environ | {"VIBROHIL_COMPILED": "1"},
        cwd=Path(__file__).parents[2],
    )
    others = pickle.loads(target.read_bytes())
    for (state, outputs), (other_state, other_outputs) in zip(rows, others, strict=True):
        assert bits(state) == bits(other_state)
        assert bits(outputs) == bits(other_outputs)


def test_filterpy_and_the_written_out_algebra_give_one_run(
    frames: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped = list(zip(frames.states, frames.outputs, strict=True))
    monkeypatch.setattr(kalman, "predict", kalman.predict_written_out)
    monkeypatch.setattr(kalman, "update", kalman.update_written_out)
    for (state, outputs), (other_state, other_outputs) in zip(
        shipped, replay_interpreted(frames.node.config, frames), strict=True
    ):
        assert outputs.mode == other_outputs.mode
        assert outputs.impact == other_outputs.impact
        assert state.estimator.x_m == pytest.approx(other_state.estimator.x_m, abs=1e-12)
        assert state.estimator.v_m_s == pytest.approx(other_state.estimator.v_m_s, abs=1e-11)
        assert outputs.torque_n_m == pytest.approx(other_outputs.torque_n_m, abs=1e-10)


def test_the_decorator_does_nothing_in_a_process_that_was_not_started_for_it() -> None:
    def function() -> int:
        return 1

    assert compiled.compiled(function) is function


def test_the_cache_folder_is_named_by_the_sources(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("VIBROHIL_CACHE_DIR", str(tmp_path))
    assert compiled.cache_folder().parent == tmp_path
    assert compiled.source_hash() in compiled.cache_folder().name


def test_a_node_refuses_to_run_compiled() -> None:
    script = (
        "from firmware_py.shell.node import FirmwareNode, NodeError\n"
        "from firmware_py.shell.parameters import config_from\n"
        "try:\n    FirmwareNode(config_from({}))\nexcept NodeError as error:\n    print(error)\n"
    )
    run = subprocess.run(
        [sys.executable, "-c", script],
        check=True,
        capture_output=True,
        text=True,
        env=os.environ | {"VIBROHIL_COMPILED": "1"},
        cwd=Path(__file__).parents[2],
    )
    assert "unset it" in run.stdout
