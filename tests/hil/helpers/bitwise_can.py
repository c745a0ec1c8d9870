"""CAN nodes bit by bit: the slow reference that the bus model is held against.

Every node is a state machine that sends one level and sees one level in each bit time; the bus is dominant
if anyone is. Written from Bosch, "CAN Specification 2.0", 1991, part A, without a look at whole frames: no
length, flag or retransmission time is computed here. Overload frames and remote frames are left out, and what
follows where an error-passive node is still within its delimiter when the others go on.
"""

from collections.abc import Callable
from enum import Enum, auto

from firmware_py.interface.frame import Frame

RECESSIVE, DOMINANT = 1, 0
CRC_POLYNOMIAL = 0x4599


class LeftOutError(Exception):
    """What this reference leaves out: error-passive nodes that are not yet done when the others are."""


class Phase(Enum):
    IDLE = auto()
    FRAME = auto()
    FLAG = auto()
    AFTER_FLAG = auto()
    DELIMITER = auto()
    INTERMISSION = auto()
    SUSPEND = auto()
    OFF = auto()


def crc15(bits: list[int]) -> int:
    register = 0
    for bit in bits:
        following = bit ^ (register >> 14 & 1)
        register = register << 1 & 0x7FFF
        if following:
            register ^= CRC_POLYNOMIAL
    return register


def number_of(bits: list[int]) -> int:
    value = 0
    for bit in bits:
        value = value << 1 | bit
    return value


def bits_of(value: int, width: int) -> list[int]:
    return [value >> place & 1 for place in reversed(range(width))]


class Node:
    """One controller."""

    def __init__(self, transmit_errors: int = 0, receive_errors: int = 0) -> None:
        self.tec = transmit_errors
        self.rec = receive_errors
        self.waiting: list[tuple[int, int, Frame]] = []
        self.received: list[tuple[int, Frame]] = []
        self.sent: list[tuple[int, Frame]] = []
        self.back_on: list[int] = []
        self.phase = Phase.IDLE
        self.count = 0
        self.transmitter = False
        self.deaf_to: Callable[[Frame], bool] = lambda frame: False
        self.outgoing: list[int] = []
        self.current: tuple[int, int, Frame] | None = None
        self.flag_level = RECESSIVE
        self.flag_run: list[int] = []
        self.saw_dominant = False
        self.lenient = False
        self.overloaded = False
        self.recessive_run = 0
        self.sequences = 0
        self._start_reading()

    @property
    def passive(self) -> bool:
        return self.tec >= 128 or self.rec >= 128

    # --- what it sends in this bit ---------------------------------------------------------------------

    def level(self) -> int:
        if self.phase is Phase.IDLE and self.waiting:
            self._start_sending()
        if self.phase is Phase.FLAG:
            return self.flag_level
        if self.phase is not Phase.FRAME:
            return RECESSIVE
        if self.transmitter:
            return self._next_to_send()
        return DOMINANT if self.place == "ack" and self.checksum_right else RECESSIVE

    def _start_sending(self) -> None:
        self.current = min(self.waiting)
        frame = self.current[2]
        body = [0, *bits_of(frame.can_id, 11), 0, 0, 0, *bits_of(len(frame.data), 4)]
        for byte in frame.data:
            body += bits_of(byte, 8)
        self.outgoing = body + bits_of(crc15(body), 15)
        self.transmitter = True
        self.phase = Phase.FRAME
        self._start_reading()

    def _next_to_send(self) -> int:
        if self.place != "stuffed":
            return RECESSIVE
        if self.run == 5:
            return 1 - self.last
        return self.outgoing[len(self.bits)]

    @property
    def just_started(self) -> bool:
        return self.phase is Phase.FRAME and not self.bits

    # --- what it makes of the level on the bus ---------------------------------------------------------

    def see(self, sent: int, seen: int, now: int) -> None:
        if self.phase is Phase.OFF:
            self._count_towards_recovery(seen, now)
        elif self.phase in (Phase.IDLE, Phase.SUSPEND):
            self._see_idle(seen, now)
        elif self.phase is Phase.FRAME:
            self._see_frame(sent, seen, now)
        elif self.phase is Phase.FLAG:
            self._see_flag(seen)
        elif self.phase is Phase.AFTER_FLAG:
            self._see_after_flag(seen)
        elif self.phase is Phase.DELIMITER:
            if seen == DOMINANT:
                raise LeftOutError("a delimiter is cut short")
            self._count_down(Phase.INTERMISSION, 3)
        elif self.phase is Phase.INTERMISSION:
            if seen == DOMINANT:
                raise LeftOutError("an overload frame")
            suspended = self.transmitter and self.passive
            self._count_down(Phase.SUSPEND if suspended else Phase.IDLE, 8)

    def _count_down(self, following: Phase, bits: int) -> None:
        self.count -= 1
        if self.count == 0:
            self.phase, self.count = following, bits

    def _see_idle(self, seen: int, now: int) -> None:
        if seen == DOMINANT:
            self.phase = Phase.FRAME
            self.transmitter = False
            self._start_reading()
            self._see_frame(RECESSIVE, seen, now)
        elif self.phase is Phase.SUSPEND:
            self._count_down(Phase.IDLE, 0)

    def _start_reading(self) -> None:
        self.bits: list[int] = []
        self.run = 0
        self.last = RECESSIVE
        self.place = "stuffed"
        self.tail = 0
        self.checksum_right = False
        self.understood = True

    @property
    def arbitrating(self) -> bool:
        return len(self.bits) < 13

    @property
    def frame(self) -> Frame:
        return Frame(
            number_of(self.bits[1:12]),
            bytes(number_of(self.bits[at : at + 8]) for at in range(19, len(self.bits) - 15, 8)),
        )

    def _see_frame(self, sent: int, seen: int, now: int) -> None:
        if self.place == "stuffed":
            self._see_stuffed(sent, seen)
        elif self.place == "checksum delimiter":
            self.place = "ack"
            if seen == DOMINANT:
                self._error()
        elif self.place == "ack":
            self.place = "ack delimiter"
            if self.transmitter and seen == RECESSIVE:
                self._error(missing_acknowledgement=True)
        elif self.place == "ack delimiter":
            self.place = "end"
            if seen == DOMINANT or not (self.transmitter or self.checksum_right):
                self._error()
        else:
            self._see_end(seen, now)

    def _see_stuffed(self, sent: int, seen: int) -> None:
        if self.transmitter and sent != seen:
            if self.arbitrating and self.run != 5:
                self.transmitter = False  # lost arbitration: it reads on
            else:
                self._error()
                return
        if self.run == 5:
            if seen == self.last:
                self._error()
                return
        else:
            self.bits.append(seen)
        self.run = self.run + 1 if seen == self.last else 1
        self.last = seen
        length = 19 + 15 + 8 * min(number_of(self.bits[15:19]), 8) if len(self.bits) >= 19 else 1000
        if len(self.bits) == length and self.run != 5:
            self._stuffed_part_ends()

    def _stuffed_part_ends(self) -> None:
        self.place = "checksum delimiter"
        right = crc15(self.bits[:-15]) == number_of(self.bits[-15:])
        self.checksum_right = right and not self.deaf_to(self.frame)

    def _see_end(self, seen: int, now: int) -> None:
        self.tail += 1
        if self.tail == 6 and seen == RECESSIVE and not self.transmitter:
            self.received.append((now + 1, self.frame))
            self.rec = 119 if self.rec >= 128 else max(self.rec - 1, 0)
        if seen == DOMINANT:
            self._error(overload=self.tail == 7 and not self.transmitter)
        elif self.tail == 7:
            if self.transmitter:
                assert self.current is not None
                self.waiting.remove(self.current)
                self.sent.append((now + 1, self.current[2]))
                self.tec = max(self.tec - 1, 0)
            self.phase, self.count = Phase.INTERMISSION, 3

    def _error(self, missing_acknowledgement: bool = False, overload: bool = False) -> None:
        self.phase = Phase.FLAG
        self.flag_level = RECESSIVE if self.passive and not overload else DOMINANT
        self.flag_run = []
        self.saw_dominant = False
        self.overloaded = overload
        self.lenient = missing_acknowledgement and self.transmitter and self.passive
        if overload or self.lenient:
            return
        if self.transmitter:
            self._charge_transmitter()
        elif self.rec < 128:
            self.rec += 1

    def _charge_transmitter(self) -> None:
        self.tec += 8
        if self.tec >= 256:
            self.phase = Phase.OFF
            self.waiting = []
            self.recessive_run = self.sequences = 0

    def _see_flag(self, seen: int) -> None:
        if seen == DOMINANT:
            self.saw_dominant = True
        self.flag_run = [*self.flag_run, seen] if self.flag_run[-1:] == [seen] else [seen]
        if len(self.flag_run) < 6:
            return
        self.phase = Phase.AFTER_FLAG
        self.count = 0
        if self.lenient and self.saw_dominant:
            self._charge_transmitter()

    def _see_after_flag(self, seen: int) -> None:
        if seen == RECESSIVE:
            self.phase, self.count = Phase.DELIMITER, 7
            return
        if self.count == 0 and not self.transmitter and not self.overloaded and self.rec < 128:
            self.rec += 8
        self.count += 1

    def _count_towards_recovery(self, seen: int, now: int) -> None:
        self.recessive_run = self.recessive_run + 1 if seen == RECESSIVE else 0
        if self.recessive_run == 11:
            self.recessive_run = 0
            self.sequences += 1
        if self.sequences == 128:
            self.tec = self.rec = 0
            self.phase = Phase.IDLE
            self.back_on.append(now + 1)


class Bus:
    """Nodes on a wire."""

    def __init__(self, nodes: list[Node]) -> None:
        self.nodes = nodes
        self.now = 0
        self.queued = 0
        self.starts: list[int] = []
        self.flips: dict[int, int] = {}
        """By number of the transmission: which of its bits is inverted for all."""

    def queue(self, node: int, frame: Frame) -> None:
        if self.nodes[node].phase is not Phase.OFF:
            self.nodes[node].waiting.append((frame.can_id, self.queued, frame))
        self.queued += 1

    def run(self, until: int) -> None:
        while self.now < until:
            sent = [node.level() for node in self.nodes]
            if any(node.just_started for node in self.nodes):
                self.starts.append(self.now)
            seen = min(sent)
            if self.starts and self.now - self.starts[-1] == self.flips.get(len(self.starts) - 1):
                seen = 1 - seen
            for node, level in zip(self.nodes, sent, strict=True):
                node.see(level, seen, self.now)
            self.now += 1
