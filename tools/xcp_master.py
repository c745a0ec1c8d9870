"""A master of XCP on CAN for the firmware's slave: reads, writes and measures by name.

Any other master works too, with the A2L file of `vibrohil firmware build`. This one needs none: the
firmware's own tables give it names, types and addresses, and the slave's identification must match them.
"""

import time
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from firmware_py.interface.enums import XcpCommandCode as Code
from firmware_py.interface.enums import XcpError
from firmware_py.interface.float32 import float32_bits, float32_of
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import INDEX as PARAMETERS
from firmware_py.node import elements, xcp
from firmware_py.node.memory import file_name
from hil.bus.base import Bus
from text_input import RefusalError

ACCEPTED_IDS = (kinds.XCP_RESPONSE.can_id,)
"""The identifiers that a master receives."""
TIMEOUT_S = 1.0
"""The longest wait for a response, which the slave sends within a few ticks."""
LONGEST_NAME = 64
"""Length up to which the firmware's name is read, in bytes; whatever answers may claim four billion."""
ASKED_SHARE = 0.5
"""Share of it for the question whether a session is open: without one the slave does not answer."""
POLL_S = 1.0
"""Interval of the queries that keep the session open while samples arrive."""
CONNECTED = bytes(
    (xcp.RESPONSE, *xcp.CONNECTED_LOW.to_bytes(3, "little"), *xcp.CONNECTED_HIGH.to_bytes(4, "little"))
)
"""The response to CONNECT, by which a master notices that another one has begun a session."""
STAMP_TICKS = 1 << 16
"""Period of a sample's time stamp."""


class XcpMasterError(RefusalError, ConnectionError):
    """The slave does not answer, refuses a command, or is not the firmware of these sources."""


class SessionError(XcpMasterError):
    """Another master has a session with the slave, or has ended this one: a slave knows one master only."""


class RefusedError(XcpMasterError):
    """The slave has refused a command; `error` is its code."""

    def __init__(self, what: str, error: int) -> None:
        name = XcpError(error).name if error in set(XcpError) else f"0x{error:02X}"
        super().__init__(f"{what}: refused, {name}")
        self.error = name


class Sample(NamedTuple):
    """The values of one list, latched in one tick; `list_number` as in `XcpMaster.start`."""

    list_number: int
    tick: int
    values: tuple[float, ...]


class Sampled(NamedTuple):
    """The signals of one DAQ list, and the ticks between two samples."""

    names: Sequence[str]
    prescaler: int


class XcpMaster:
    """One session with the firmware's slave on a bus that accepts `ACCEPTED_IDS`."""

    def __init__(self, bus: Bus, timeout_s: float = TIMEOUT_S) -> None:
        self._bus = bus
        self._timeout_s = timeout_s
        self._packets: list[bytes] = []
        self._is_open = False

    def request(self, code: Code, low: int = 0, high: int = 0) -> tuple[int, int]:
        """Send a command and return the response's `(low, high)`; samples that arrive meanwhile are kept."""
        found = self._answer(code, low, high, self._timeout_s)
        missing = f"no answer to {code.name} within {self._timeout_s:g} s"
        if found is None and self._is_open:
            self._is_open = False
            self._send(Code.DISCONNECT, 0, 0)  # should only the answer have been lost
            raise SessionError(
                f"{missing}: another master has ended this session, the firmware has restarted, "
                "or the bus has lost a frame"
            )
        if found is None:
            raise XcpMasterError(
                f"{missing}; check that the firmware is on this bus, and that firmware.bus.own_node is its "
                "module's number"
            )
        if found[0] == xcp.ERROR:
            raise RefusedError(code.name, found[1])
        return int.from_bytes(found[1:4], "little"), int.from_bytes(found[4:8], "little")

    def _answer(self, code: Code, low: int, high: int, timeout_s: float) -> bytes | None:
        """Send a command and return the response or error packet; None if none has come in time."""
        self._take(0.0)  # responses to another master
        self._send(code, low, high)
        until_s = time.monotonic() + timeout_s
        while time.monotonic() < until_s:
            responses = self._take(until_s - time.monotonic())
            if responses:
                return responses[0]
        return None

    def _send(self, code: Code, low: int, high: int) -> None:
        data = bytes((code, *low.to_bytes(3, "little"), *high.to_bytes(4, "little")))
        self._bus.send_all((Frame(kinds.XCP_COMMAND.can_id, data),))

    def _take(self, timeout_s: float) -> list[bytes]:
        """The responses and errors that have arrived, waited for as by `_receive`; samples are kept."""
        packets = self._receive(timeout_s)
        self._packets += (packet for packet in packets if packet[0] < xcp.ERROR)
        return [packet for packet in packets if packet[0] >= xcp.ERROR]

    def _receive(self, timeout_s: float) -> list[bytes]:
        """The data of the slave's frames that have arrived; waits for one at most `timeout_s`.

        Raises SessionError if the slave has answered another master's CONNECT.
        """
        frames = self._bus.receive()
        if not frames and timeout_s > 0.0:
            self._bus.wait(timeout_s)
            frames = self._bus.receive()
        packets = [data for can_id, data in frames if can_id == kinds.XCP_RESPONSE.can_id and len(data) == 8]
        if self._is_open and CONNECTED in packets:
            self._is_open = False
            raise SessionError("another master has begun a session, which has ended this one")
        return packets

    def connect(self) -> None:
        """Begin a session, which would end that of another master.

        Raises SessionError if there is another session, XcpMasterError if the firmware has other measurements
        or parameters.
        """
        if self._answer(Code.GET_STATUS, 0, 0, ASKED_SHARE * self._timeout_s) is not None:
            raise SessionError(
                "another master has a session with this firmware, such as a running `vibrohil measure`; a "
                "slave of XCP has one master: end the other, or wait 10 s if it has died"
            )
        self.request(Code.CONNECT)
        self._is_open = True
        try:
            self._identify()
        except XcpMasterError:
            self.disconnect()
            raise

    def _identify(self) -> None:
        """Raise XcpMasterError unless the firmware is that of these sources."""
        _, length = self.request(Code.GET_ID, 1)
        name = b""
        while len(name) < min(length, LONGEST_NAME):
            size = min(length - len(name), xcp.MOST_BYTES)
            low, high = self.request(Code.UPLOAD, size)
            name += (low | high << 24).to_bytes(7, "little")[:size]
        if name.decode("ascii", "replace") != file_name():
            raise XcpMasterError(
                f"the firmware on the bus is {name!r}, these sources are {file_name()!r}; build and flash it "
                "from these sources, or measure with the version that built it"
            )

    def disconnect(self) -> None:
        """End the session, and with it all DAQ lists; raise SessionError if it has ended unnoticed."""
        if self._is_open:
            self.request(Code.DISCONNECT)
            self._is_open = False

    def read(self, name: str) -> float:
        """A measurement, or the staged value of a parameter."""
        if name in PARAMETERS:
            extension, index, is_float = xcp.CHARACTERISTICS, PARAMETERS[name], True
        else:
            index = place_of(name)
            extension, is_float = xcp.MEASUREMENTS, elements.ALL[index].kind is float
        low, high = self.request(
            Code.SHORT_UPLOAD, xcp.ELEMENT_BYTES | extension << 16, xcp.ELEMENT_BYTES * index
        )
        return value_of(low | (high & 0xFF) << 24, is_float)

    def write(self, name: str, value: float) -> None:
        """Stage the value of a parameter; `commit` applies it. Raises RefusedError."""
        self._download(PARAMETERS[name], float32_bits(value))

    def commit(self) -> None:
        """Apply all staged values together. Raises RefusedError."""
        self._download(xcp.COMMIT, 1)

    def _download(self, index: int, word: int) -> None:
        self.request(Code.SET_MTA, xcp.CHARACTERISTICS << 16, xcp.ELEMENT_BYTES * index)
        self.request(Code.DOWNLOAD, xcp.ELEMENT_BYTES | (word & 0xFFFF) << 8, word >> 16)

    def start(self, lists: Sequence[Sampled]) -> None:
        """Set up DAQ lists and start them in one tick. Raises RefusedError if they need too many frames."""
        self.request(Code.FREE_DAQ)
        self.request(Code.ALLOC_DAQ, len(lists) << 8)
        for number, one in enumerate(lists):
            self.request(Code.ALLOC_ODT, number << 8, len(one.names))
        for number, one in enumerate(lists):
            for odt in range(len(one.names)):
                self.request(Code.ALLOC_ODT_ENTRY, number << 8, odt | 1 << 8)
        for number, one in enumerate(lists):
            for odt, name in enumerate(one.names):
                self.request(Code.SET_DAQ_PTR, number << 8, odt)
                entry = 0xFF | xcp.ELEMENT_BYTES << 8 | xcp.MEASUREMENTS << 16
                self.request(Code.WRITE_DAQ, entry, xcp.ELEMENT_BYTES * place_of(name))
            self.request(Code.SET_DAQ_LIST_MODE, xcp.TIME_STAMPED | number << 8, one.prescaler << 16)
            self.request(Code.START_STOP_DAQ_LIST, 2 | number << 8)
        _, self._last_tick = self.request(Code.GET_DAQ_CLOCK)
        self._packets.clear()
        self.request(Code.START_STOP_SYNCH, 1)

    def samples(self, lists: Sequence[Sampled]) -> Iterator[Sample | None]:
        """Yield the samples of the started lists as they arrive; None when none has arrived for 0.1 s.

        A sample of which a frame was lost is left out. Raises SessionError if the lists have been stopped.
        """
        owners = [(number, odt) for number, one in enumerate(lists) for odt in range(len(one.names))]
        partial: dict[int, list[int]] = {}
        ticks: dict[int, int] = {}
        polled_s = time.monotonic()
        while True:
            packets = self._packets or self._receive(0.1)
            self._packets = []
            for packet in packets:
                if packet[0] >= len(owners):
                    continue
                number, odt = owners[packet[0]]
                if odt == 0:
                    self._last_tick += wrap_ticks(int.from_bytes(packet[1:3], "little") - self._last_tick)
                    ticks[number], partial[number] = self._last_tick, []
                start = 3 if odt == 0 else 1
                words = partial.get(number)
                if words is not None and len(words) == odt:
                    words.append(int.from_bytes(packet[start : start + 4], "little"))
                    if len(words) == len(lists[number].names):
                        kinds_of = (
                            elements.ALL[place_of(name)].kind is float for name in lists[number].names
                        )
                        values = tuple(map(value_of, words, kinds_of))
                        yield Sample(number, ticks[number], values)
            if not packets:
                yield None
            if time.monotonic() - polled_s > POLL_S:
                polled_s = time.monotonic()
                status, _ = self.request(Code.GET_STATUS)
                if not status & xcp.RUNNING:
                    self._is_open = False
                    raise SessionError("another master has begun a session, which has ended this measurement")


def wrap_ticks(ticks: int) -> int:
    """A difference of two time stamps, from half a period before to half a period after."""
    return (ticks + STAMP_TICKS // 2) % STAMP_TICKS - STAMP_TICKS // 2


def value_of(word: int, is_float: bool) -> float:
    """The value of an element's 32 bits: a float32, or a signed integer."""
    return float32_of(word) if is_float else float(word - (word >> 31 << 32))


def place_of(name: str) -> int:
    """The index of a measurement; raise XcpMasterError if there is none of this name."""
    index = elements.INDEX.get(name)
    if index is None:
        near = [one for one in elements.INDEX if name.rpartition(".")[2] in one][:3]
        hint = f"; did you mean {' or '.join(near)}?" if near else "; `vibrohil measure --list` lists them"
        raise XcpMasterError(f"there is no signal {name!r}{hint}")
    return index
