"""Only the hub sends control records: those of a node are not forwarded."""

from hil.bus.hub import frames_alone
from hil.bus.wire import CAN_FRAME, CONTROL_ID, LOSS_KIND, STAMP_KIND, control

FRAMES = [CAN_FRAME.pack(can_id, 8, bytes([can_id & 0xFF] * 8)) for can_id in (0x001, 0x123, 0x7FF)]
DATA_LIKE_A_MARK = CAN_FRAME.pack(0x123, 8, b"\xff" * 8)


def test_control_records_of_a_node_are_dropped_and_its_frames_are_kept() -> None:
    forged = control(LOSS_KIND, 1000), control(STAMP_KIND, 1), CAN_FRAME.pack(CONTROL_ID, 0, b"vibro-1\0")
    sent = [forged[0], FRAMES[0], FRAMES[1], forged[1], DATA_LIKE_A_MARK, forged[2], FRAMES[2]]
    assert frames_alone(b"".join(sent)) == b"".join([*FRAMES[:2], DATA_LIKE_A_MARK, FRAMES[2]])


def test_frames_alone_pass_unchanged() -> None:
    frames = b"".join([*FRAMES, DATA_LIKE_A_MARK])
    assert frames_alone(frames) == frames
    assert frames_alone(b"") == b""
