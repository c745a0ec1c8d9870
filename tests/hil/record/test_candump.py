"""candump's lines are read as they were written; odd lines are left out."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.record import candump
from hil.record.bus_load import load_from_log
from hil.record.candump import BusLog, StoredBus, parse_candump

FRAMES = st.tuples(
    st.integers(0, 10**9 - 1), st.integers(0, 0x7FF), st.binary(max_size=candump.MOST_BYTES), st.booleans()
)
ODD_LINES = {
    b"\n": 0,
    b"(1.5) can0 028#00\n": 0,
    b"(1.000000) can0 028#0\n": 0,
    b"(1.000000) can0 028#" + b"00" * 12 + b"\n": 1,
    b"(1.000000) can0 0G8#00\n": 0,
    b"(1.000000) can0 028#0X\n": 0,
    b"(1.0000A0) can0 028#00\n": 0,
    b"(1.000000) can0 028##100\n": 0,
    b"1.000000) can0 028#00\n": 0,
    b"(1.000000)  can0 028#00\n": 0,
    b"(1.000000000) can0 028#00\n": 1,
    b"(123456789012.000001) can0 028#00\n": 1,
    b"(1.000000) can0 028#00\r\n": 1,
    b"garbage\n": 0,
}
"""Lines, and the number of frames in each."""


def line(t_us: int, can_id: int, data: bytes, is_lower: bool) -> bytes:
    digits = data.hex() if is_lower else data.hex().upper()
    return f"({t_us // 10**6}.{t_us % 10**6:06}) can0 {can_id:03X}#{digits}\n".encode()


def same(one: BusLog, other: BusLog) -> bool:
    arrays = ((one.t_s, other.t_s), (one.can_id, other.can_id), (one.length, other.length))
    return one.content == other.content and all(np.array_equal(ours, theirs) for ours, theirs in arrays)


@given(frames=st.lists(FRAMES, min_size=1, max_size=20))
def test_lines_are_read_as_they_were_written(frames: list[tuple[int, int, bytes, bool]]) -> None:
    read = parse_candump(b"".join(line(*frame) for frame in frames))
    assert read.t_s.tolist() == [float(f"{t_us // 10**6}.{t_us % 10**6:06}") for t_us, *_ in frames]
    assert read.can_id.tolist() == [can_id for _, can_id, *_ in frames]
    assert read.payloads == tuple(data for _, _, data, _ in frames)


@pytest.mark.parametrize(("odd", "frames"), ODD_LINES.items())
def test_an_odd_line_is_left_out_unless_it_is_a_frame(odd: bytes, frames: int) -> None:
    text = line(1, 0x28, b"\x01\x02", False) + odd + line(2, 0x29, b"", True)
    assert parse_candump(text).can_id.tolist() == [0x28, *[0x28] * frames, 0x29]


def test_a_log_is_read_in_pieces_and_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "BLOCK_BYTES", 100)
    lines = [line(1000 * tick, 0x28 + tick % 3, bytes([tick] * (tick % 9)), False) for tick in range(250)]
    text = b"".join(lines) + b"garbage\n(0.3"
    path = tmp_path / "can.log"
    path.write_bytes(text)
    bus = StoredBus(path)
    assert len(list(bus.pieces())) > 50
    assert same(bus.whole(), parse_candump(text))
    load = bus.load
    assert (bus.frames, bus.lines, bus.read_bytes) == (250, 251, len(text))
    assert load.tenth.tolist() == [0, 1, 2]
    assert load.bits.sum() == sum(55 + 10 * (tick % 9) for tick in range(250))
    assert np.array_equal(load_from_log(load.middle_s, load.shares), load)
