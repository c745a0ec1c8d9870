"""candump's lines: a block of one make is read as its lines are one by one; odd lines are left out."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hil.record import candump
from hil.record.candump import BusLog, StoredBus, alike, parse_candump, parse_lines

FRAMES = st.tuples(
    st.integers(0, 10**9 - 1), st.integers(0, 0x7FF), st.binary(max_size=candump.MOST_BYTES), st.booleans()
)
ODD_LINES = (
    b"\n",
    b"(1.5) can0 028#00\n",
    b"(1.000000) can0 028#0\n",
    b"(1.000000) can0 028#" + b"00" * 12 + b"\n",
    b"(1.000000) can0 0G8#00\n",
    b"(1.000000) can0 028#0X\n",
    b"(1.0000A0) can0 028#00\n",
    b"(1.000000) can0 028##100\n",
    b"1.000000) can0 028#00\n",
    b"(1.000000)  can0 028#00\n",
    b"(1.000000000) can0 028#00\n",
    b"(123456789012.000001) can0 028#00\n",
    b"(1.000000) can0 028#00\r\n",
    b"garbage\n",
)


def line(t_us: int, can_id: int, data: bytes, is_lower: bool) -> bytes:
    digits = data.hex() if is_lower else data.hex().upper()
    return f"({t_us // 10**6}.{t_us % 10**6:06}) can0 {can_id:03X}#{digits}\n".encode()


def same(one: BusLog, other: BusLog) -> bool:
    arrays = ((one.t_s, other.t_s), (one.can_id, other.can_id), (one.length, other.length))
    return one.content == other.content and all(np.array_equal(ours, theirs) for ours, theirs in arrays)


@given(frames=st.lists(FRAMES, min_size=1, max_size=20))
def test_lines_of_one_make_are_read_at_once(frames: list[tuple[int, int, bytes, bool]]) -> None:
    text = b"".join(line(*frame) for frame in frames)
    read = alike(text)
    assert read is not None
    assert same(read, parse_lines(text))
    assert read.t_s.tolist() == [float(f"{t_us // 10**6}.{t_us % 10**6:06}") for t_us, *_ in frames]
    assert read.payloads == tuple(data for _, _, data, _ in frames)


@pytest.mark.parametrize("odd", ODD_LINES)
def test_odd_lines_are_read_as_one_by_one(odd: bytes) -> None:
    text = line(1, 0x28, b"\x01\x02", False) + odd + line(2, 0x29, b"", True)
    assert same(parse_candump(text), parse_lines(text))
    assert len(parse_candump(text).t_s) >= 2


def test_a_log_is_read_in_pieces_and_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(candump, "BLOCK_BYTES", 100)
    lines = [line(1000 * tick, 0x28 + tick % 3, bytes([tick] * (tick % 9)), False) for tick in range(250)]
    text = b"".join(lines) + b"garbage\n(0.3"
    path = tmp_path / "can.log"
    path.write_bytes(text)
    bus = StoredBus(path)
    assert len(list(bus.pieces())) > 50
    assert same(bus.whole(), parse_lines(text))
    counts = bus.counts
    assert (counts.total, counts.lines, counts.read_bytes) == (250, 251, len(text))
    assert counts.tenth.tolist() == [0, 1, 2]
    assert counts.frame_bytes.sum() == sum(tick % 9 for tick in range(250))
