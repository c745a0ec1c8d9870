"""The frames that wait in a firmware's inbox."""

from firmware_py.interface.frame import Frame, bytes_of
from firmware_py.interface.generated import kinds
from firmware_py.node import inbox


def due_frames(waiting: list[int]) -> list[Frame]:
    """The frames of the period that the next tick runs, an E-stop first; those taken have identifier 0."""
    found = [Frame(kinds.DRIVE_ESTOP.can_id, b"")] if waiting[inbox.ESTOP] else []
    for number in range(waiting[inbox.TAKEN], waiting[inbox.RECEIVED]):
        index = inbox.index_of(number)
        can_id, length, word = inbox.frame_at(waiting, index)
        if can_id > 0 and waiting[index] >> inbox.BEHIND_BIT == inbox.behind_ticks(waiting):
            found.append(Frame(int(can_id), bytes_of(int(word), int(length))))
    return found
