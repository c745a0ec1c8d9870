"""The XCP slave: measurement and calibration of the running firmware over CAN (ASAM MCD-1 XCP 1.x).

    exchange(pool, state, tick_s, now, tx) -> tx

serves a command, whose response waits in `pool`, and runs the DAQ lists, which send at most one packet.

A command consists of byte 0, bytes 1 to 3 as `low` and bytes 4 to 7 as `high`, little-endian; so does a
packet. Every frame has eight bytes (MAX_DLC_REQUIRED). `state` is the firmware's after this tick, only read
here. `pool` is memory of `POOL` integers that is changed in place: a list if interpreted, a pointer if
compiled. The functions that process a command return NONE, or the error by which it is refused; a refused
command has changed nothing.

Each address names an element of four bytes; the extension names the memory:

    0  measurements: the members of the firmware's state, floats as float32 and other members as int32
    1  characteristics: the parameters as float32, staged in `pool`; then `COMMIT`, which applies them
    2  text: the event's name and the name of the A2L file

A write is only checked for its form here. It waits in the pool for `node.calibration`, which judges it
between two ticks; therefore the tick contains neither bounds nor derived constants. Where nothing judges it,
as on a board that does not call `vibro_calibrate`, the next tick refuses it, and no parameter can be read.
"""

from typing import get_type_hints

from firmware_py.interface.enums import XcpCommandCode as Code
from firmware_py.interface.enums import XcpError
from firmware_py.interface.generated import packing
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.generated.records import XcpCommand, XcpResponse
from firmware_py.node.elements import ALL, latch, word_at
from firmware_py.node.tick import NodeState, Tx, add_frame

RESPONSE, ERROR = 0xFF, 0xFE
"""Packet identifiers of a response and of an error."""

MEASUREMENTS, CHARACTERISTICS, TEXT, ELEMENT_BYTES = 0, 1, 2, 4
"""Address extensions, and the size of each element."""
MEASURED, COUNT = len(ALL), sum(len(table._fields) for table in get_type_hints(Parameters).values())
"""Number of measurements and of characteristics."""
COMMIT = COUNT
"""Element of the characteristics' memory whose write applies all staged values together."""
MOST_BYTES, MOST_SUMMED_BYTES = 7, 64
"""Most data bytes of a response, and most bytes of one BUILD_CHECKSUM, which takes one tick."""

CONNECTED_LOW, CONNECTED_HIGH = 0x05 | 0x80 << 8 | 8 << 16, 8 | 1 << 16 | 1 << 24
"""Response to CONNECT: calibration and DAQ, GET_COMM_MODE_INFO exists, frames of eight bytes, version 1."""

MOST_LISTS, MOST_ODTS = 4, 48
"""Most DAQ lists, and most object descriptor tables (ODT) of all lists; an ODT holds one element."""
NO_ENTRY, UNWRITTEN = -2, -1
"""Contents of an ODT without an entry, and of an entry without an address."""
NO_POINTER = NO_ELEMENT = -1
"""In the place of an index, and of an element's bits."""
FIRST, ODTS, PRESCALER, MODE, WAIT, NEXT, STAMP, LIST_SIZE = range(8)
"""Members of a DAQ list: first ODT, number of ODTs, ticks between two samples, mode bits, ticks until the
next sample, number of sent ODTs of the present sample, and its time stamp."""

IS_CONNECTED, EXTENSION, ADDRESS, IS_FRESH, STAGE, LISTS, ALL_ODTS, POINTER, ENDS, WAKES = range(10)
"""Members of the session. `EXTENSION` and `ADDRESS` form the memory transfer address (MTA); it `IS_FRESH` if
SET_MTA was the last command that changed it. `STAGE`: the last command that allocated DAQ lists; `LISTS` and
`ALL_ODTS`: their number, and that of all their ODTs. `POINTER`: the ODT that WRITE_DAQ writes.
`ENDS`: the tick that ends the session if no command has come.
`WAKES`: the next tick in which the slave has something to do, even if no command comes."""
REQUEST, VALUE, WAITS, PACKET, LOW, HIGH, TICK, TICK_UNITS, TEXT_AT = range(10, 19)
"""What waits for `node.calibration`: kind of request and value to be written; whether a response waits, and
its content; the number of the state's tick, and its period in units of a time stamp."""
TEXT_WORDS, EVENT_NAME_BYTES, FILE_NAME_BYTES = 5, 4, 14
LISTS_AT = TEXT_AT + TEXT_WORDS
ENTRIES_AT = LISTS_AT + MOST_LISTS * LIST_SIZE
LATCHED_AT = ENTRIES_AT + MOST_ODTS
PAGE_AT = LATCHED_AT + MOST_ODTS
POOL = PAGE_AT + COUNT
"""Size of the pool: session, text, lists, each ODT's element and value, and the staged characteristics
as bits of a float32."""

SELECTED, TIME_STAMPED, RUNNING = 0x01, 0x10, 0x40
"""Mode bits of a DAQ list, as GET_DAQ_LIST_MODE reports them; the session's status has the last one, too."""
TIMESTAMP_UNIT_S, TIMESTAMP_MODE, UNIT_10_US = 1e-5, 0x42, 4
"""Time stamps count ticks in two bytes; a tick is given in units of 10 µs."""

SILENCE_S = 10.0
"""Silence after which a master is lost: session and DAQ lists end."""
NEVER, NOW = 1 << 62, 0
"""Ticks at which a session ends or the slave has something to do."""

STOP, START, SELECT = 0, 1, 2
"""Modes of START_STOP_DAQ_LIST. START_STOP_SYNCH stops all lists, or starts or stops the selected ones."""

NO_REQUEST, WRITE, REVERT = 0, 1, 2
"""Requests to `node.calibration`: to write one element, and to stage the values in use."""


def answer(pool: list[int], low: int, high: int) -> XcpError:
    """A positive response with data."""
    pool[LOW], pool[HIGH] = low & 0xFFFFFF, high & 0xFFFFFFFF
    return XcpError.NONE


def refuse(pool: list[int], error: XcpError) -> None:
    """Make the waiting response an error."""
    pool[PACKET], pool[LOW] = ERROR, error.value


def set_address(pool: list[int], extension: int, address: int, is_fresh: bool) -> XcpError:
    """Set the MTA."""
    pool[EXTENSION], pool[ADDRESS], pool[IS_FRESH] = extension, address, 1 if is_fresh else 0
    return XcpError.NONE


def read_element(pool: list[int], state: object, extension: int, index: int) -> int:
    """The 32 bits of an element, or NO_ELEMENT."""
    if extension == MEASUREMENTS and index < MEASURED:
        return word_at(state, index)
    if extension == CHARACTERISTICS and index < COUNT:
        return NO_ELEMENT if pool[REQUEST] == REVERT else pool[PAGE_AT + index]
    return pool[TEXT_AT + index] if extension == TEXT and index < TEXT_WORDS else NO_ELEMENT


def upload(pool: list[int], state: object, extension: int, address: int, size: int) -> XcpError:
    """UPLOAD and SHORT_UPLOAD: `size` bytes from `address` on; the MTA then points behind them."""
    if not 0 < size <= MOST_BYTES:
        return XcpError.OUT_OF_RANGE
    content = 0
    for index in range(size):
        word = read_element(pool, state, extension, (address + index) // ELEMENT_BYTES)
        if word == NO_ELEMENT:
            return XcpError.OUT_OF_RANGE
        content |= (word >> 8 * ((address + index) % ELEMENT_BYTES) & 0xFF) << 8 * index
    set_address(pool, extension, address + size, False)
    return answer(pool, content, content >> 24)


def build_checksum(pool: list[int], state: object, size: int) -> XcpError:
    """BUILD_CHECKSUM: the sum of whole elements (XCP_ADD_44)."""
    extension, address, total = pool[EXTENSION], pool[ADDRESS], 0
    if size > MOST_SUMMED_BYTES:
        pool[HIGH] = MOST_SUMMED_BYTES
    if not 0 < size <= MOST_SUMMED_BYTES or size % ELEMENT_BYTES != 0 or address % ELEMENT_BYTES != 0:
        return XcpError.OUT_OF_RANGE
    for index in range(size // ELEMENT_BYTES):
        word = read_element(pool, state, extension, address // ELEMENT_BYTES + index)
        if word == NO_ELEMENT:
            return XcpError.OUT_OF_RANGE
        total += word
    set_address(pool, extension, address + size, False)
    return answer(pool, 0x06, total)


def download(pool: list[int], size: int, value: int) -> XcpError:
    """DOWNLOAD: a request to write one whole element at an MTA that was set for this write."""
    if pool[IS_FRESH] == 0:
        return XcpError.SEQUENCE
    if pool[EXTENSION] != CHARACTERISTICS:
        return XcpError.WRITE_PROTECTED
    address = pool[ADDRESS]
    if size != ELEMENT_BYTES or address % ELEMENT_BYTES != 0 or address > ELEMENT_BYTES * COMMIT:
        return XcpError.OUT_OF_RANGE
    pool[IS_FRESH], pool[REQUEST], pool[VALUE] = 0, WRITE, value
    return XcpError.NONE


def list_at(number: int) -> int:
    """Index in the pool of a DAQ list."""
    return LISTS_AT + number * LIST_SIZE


def is_running(pool: list[int]) -> bool:
    """Whether any DAQ list runs."""
    modes = 0
    for number in range(pool[LISTS]):
        modes |= pool[list_at(number) + MODE]
    return modes & RUNNING != 0


def find_allocation_error(  # noqa: PLR0911 - a line a reason
    pool: list[int], code: int, number: int, second: int, third: int
) -> XcpError:
    """Why `allocate` is refused: not in the standard's order, in which the codes descend, or no room."""
    earliest = code + 1 if code == Code.ALLOC_DAQ else code
    if not earliest <= pool[STAGE] <= code + 1 and code != Code.FREE_DAQ:
        return XcpError.SEQUENCE
    if code >= Code.ALLOC_DAQ:
        return XcpError.MEMORY_OVERFLOW if code < Code.FREE_DAQ and number > MOST_LISTS else XcpError.NONE
    if number >= pool[LISTS]:
        return XcpError.OUT_OF_RANGE
    odts = pool[list_at(number) + ODTS]
    if code == Code.ALLOC_ODT and odts > 0:
        return XcpError.SEQUENCE
    if code == Code.ALLOC_ODT:
        return XcpError.MEMORY_OVERFLOW if pool[ALL_ODTS] + second > MOST_ODTS else XcpError.NONE
    if second >= odts:
        return XcpError.OUT_OF_RANGE
    return XcpError.MEMORY_OVERFLOW if third > 1 else XcpError.NONE


def allocate(pool: list[int], code: int, number: int, second: int, third: int) -> XcpError:
    """FREE_DAQ, ALLOC_DAQ: `number` lists, ALLOC_ODT: `second` ODTs of a list, ALLOC_ODT_ENTRY: `third`."""
    error = find_allocation_error(pool, code, number, second, third)
    if error != XcpError.NONE:
        return error
    at = list_at(number)
    if code >= Code.ALLOC_DAQ:
        for index in range(LISTS_AT, LATCHED_AT):
            pool[index] = 0 if index < ENTRIES_AT else NO_ENTRY
        pool[LISTS], pool[ALL_ODTS] = number if code == Code.ALLOC_DAQ else 0, 0
    elif code == Code.ALLOC_ODT:
        pool[at + FIRST], pool[at + ODTS], pool[at + PRESCALER] = pool[ALL_ODTS], second, 1
        pool[ALL_ODTS] += second
    else:
        pool[ENTRIES_AT + pool[at + FIRST] + second] = UNWRITTEN if third == 1 else NO_ENTRY
    pool[STAGE], pool[POINTER] = code, NO_POINTER
    return XcpError.NONE


def set_pointer(pool: list[int], at: int, odt: int, entry: int) -> XcpError:
    """SET_DAQ_PTR: the entry that WRITE_DAQ writes."""
    index = pool[at + FIRST] + odt
    if odt >= pool[at + ODTS] or entry > 0 or pool[ENTRIES_AT + index] == NO_ENTRY:
        return XcpError.OUT_OF_RANGE
    pool[POINTER] = index
    return XcpError.NONE


def write_entry(pool: list[int], low: int, address: int) -> XcpError:
    """WRITE_DAQ: the measurement of an entry. Each ODT has one entry, so the pointer becomes invalid."""
    if pool[POINTER] == NO_POINTER:
        return XcpError.SEQUENCE
    index = address // ELEMENT_BYTES
    is_element = low == 0xFF | ELEMENT_BYTES << 8 | MEASUREMENTS << 16 and address % ELEMENT_BYTES == 0
    if not is_element or index >= MEASURED:
        return XcpError.OUT_OF_RANGE
    pool[ENTRIES_AT + pool[POINTER]], pool[POINTER] = index, NO_POINTER
    return XcpError.NONE


def set_mode(pool: list[int], at: int, mode: int, high: int) -> XcpError:
    """SET_DAQ_LIST_MODE: time stamps and prescaler of a list; its event is the tick."""
    event, prescaler = high & 0xFFFF, high >> 16 & 0xFF
    if event != 0 or prescaler == 0:
        return XcpError.OUT_OF_RANGE
    if mode & ~TIME_STAMPED:
        return XcpError.MODE_NOT_VALID
    pool[at + MODE], pool[at + PRESCALER] = mode | pool[at + MODE] & SELECTED, prescaler
    return XcpError.NONE


def select_lists(pool: list[int], code: int, mode: int, number: int) -> int:
    """The lists that START_STOP_DAQ_LIST, on the list `number`, or START_STOP_SYNCH means: a bit for each."""
    if code == Code.START_STOP_DAQ_LIST:
        return 1 << number
    meant = 0
    for index in range(pool[LISTS]):
        if mode == STOP or pool[list_at(index) + MODE] & SELECTED:
            meant |= 1 << index
    return meant


def find_starting_error(pool: list[int], meant: int) -> XcpError:
    """Why the meant lists cannot start: incomplete, or with those that run over one packet per tick."""
    packets_a_tick = 0.0
    for index in range(pool[LISTS]):
        at, starts = list_at(index), meant >> index & 1
        if starts and pool[at + ODTS] == 0:
            return XcpError.DAQ_CONFIG
        for odt in range(pool[at + FIRST], pool[at + FIRST] + pool[at + ODTS]):
            if starts and pool[ENTRIES_AT + odt] < 0:
                return XcpError.DAQ_CONFIG
        if starts or pool[at + MODE] & RUNNING:
            packets_a_tick += pool[at + ODTS] / pool[at + PRESCALER]
    return XcpError.MEMORY_OVERFLOW if packets_a_tick > 1.0 + 1e-9 else XcpError.NONE


def start_stop(pool: list[int], code: int, mode: int, number: int) -> XcpError:
    """Start, stop or select lists, from the next tick on; a single one's first identifier is answered."""
    if mode > SELECT:
        return XcpError.MODE_NOT_VALID
    is_one, meant = code == Code.START_STOP_DAQ_LIST, select_lists(pool, code, mode, number)
    error = find_starting_error(pool, meant) if mode == START else XcpError.NONE
    if error != XcpError.NONE:
        return error
    for index in range(pool[LISTS]):
        at = list_at(index)
        if meant >> index & 1 and mode == SELECT and is_one:
            pool[at + MODE] |= SELECTED
        elif meant >> index & 1:
            pool[at + MODE] = pool[at + MODE] & TIME_STAMPED | (RUNNING if mode == START else 0)
            pool[at + WAIT], pool[at + NEXT] = 0, pool[at + ODTS]
    return answer(pool, pool[list_at(number) + FIRST] if is_one else 0, 0)


def next_packet(pool: list[int], at: int) -> XcpResponse:
    """The next packet of a list: identifier, in the first ODT the time stamp if any, and value."""
    odt = pool[at + FIRST] + pool[at + NEXT]
    value = pool[LATCHED_AT + odt]
    if pool[at + NEXT] == 0 and pool[at + MODE] & TIME_STAMPED:
        return XcpResponse(odt & 0xFF, pool[at + STAMP] & 0xFFFF | (value & 0xFF) << 16, value >> 8)
    return XcpResponse(odt & 0xFF, value & 0xFFFFFF, value >> 24)


def next_list(pool: list[int], state: object) -> int:
    """Run the DAQ lists for one tick; the index in the pool of the list that sends, or NO_POINTER.

    The list whose next sample is due first sends. Since the running lists need at most one packet per tick,
    this order (earliest deadline first) completes each sample before the next one.
    """
    urgent, least = NO_POINTER, 0
    for number in range(pool[LISTS]):
        at = list_at(number)
        if pool[at + MODE] & RUNNING:
            if pool[at + WAIT] <= 0 and pool[at + NEXT] >= pool[at + ODTS]:
                first = pool[at + FIRST]
                latch(state, pool, ENTRIES_AT + first, LATCHED_AT + first, pool[at + ODTS])
                pool[at + NEXT], pool[at + STAMP] = 0, pool[TICK]
                pool[at + WAIT] += pool[at + PRESCALER]
            pool[at + WAIT] -= 1
            if pool[at + NEXT] < pool[at + ODTS] and (urgent == NO_POINTER or pool[at + WAIT] < least):
                urgent, least = at, pool[at + WAIT]
    return urgent


def execute_daq(  # noqa: PLR0911, PLR0912 - a line a command
    pool: list[int], code: int, low: int, high: int
) -> XcpError:
    """Execute one command on the DAQ lists. All other commands are unknown."""
    mode, number, second, third = low & 0xFF, low >> 8, high & 0xFF, high >> 8 & 0xFF
    at, units, allocates = list_at(number), pool[TICK_UNITS], Code.ALLOC_ODT_ENTRY <= code <= Code.FREE_DAQ
    if (allocates or Code.SET_DAQ_LIST_MODE <= code <= Code.SET_DAQ_PTR) and is_running(pool):
        return XcpError.DAQ_ACTIVE
    if allocates:
        return allocate(pool, code, number, second, third)
    if code == Code.WRITE_DAQ:
        return write_entry(pool, low, high)
    if code == Code.START_STOP_SYNCH:
        return start_stop(pool, code, mode, 0)
    if code == Code.GET_DAQ_CLOCK:
        return answer(pool, 0, pool[TICK])
    if code == Code.GET_DAQ_PROCESSOR_INFO:  # dynamic lists, prescaler, time stamps; one event
        return answer(pool, 0x13 | pool[LISTS] << 8, 1)
    if code == Code.GET_DAQ_RESOLUTION_INFO:
        return answer(pool, ELEMENT_BYTES * 0x010101, TIMESTAMP_MODE << 8 | units << 16)
    if code == Code.GET_DAQ_EVENT_INFO and number == 0:
        set_address(pool, TEXT, 0, False)
        return answer(pool, 0x04 | MOST_LISTS << 8 | EVENT_NAME_BYTES << 16, units & 0xFF | UNIT_10_US << 8)
    is_on_list = Code.START_STOP_DAQ_LIST <= code <= Code.SET_DAQ_PTR or code == Code.GET_DAQ_LIST_INFO
    if not is_on_list and code != Code.GET_DAQ_EVENT_INFO:
        return XcpError.CMD_UNKNOWN
    if not is_on_list or number >= pool[LISTS]:
        return XcpError.OUT_OF_RANGE
    if code == Code.SET_DAQ_PTR:
        return set_pointer(pool, at, second, third)
    if code == Code.SET_DAQ_LIST_MODE:
        return set_mode(pool, at, mode, high)
    if code == Code.START_STOP_DAQ_LIST:
        return start_stop(pool, code, mode, number)
    if code == Code.GET_DAQ_LIST_INFO:
        return answer(pool, 0x04 | pool[at + ODTS] << 8 | 1 << 16, 0)
    return answer(pool, pool[at + MODE], pool[at + PRESCALER] << 16)  # GET_DAQ_LIST_MODE


def end_session(pool: list[int]) -> XcpError:
    """No session, no DAQ lists and no staged characteristics, as before CONNECT."""
    for member in range(WAITS + 1):
        pool[member] = 0
    pool[ENDS] = pool[WAKES] = NEVER
    pool[POINTER], pool[REQUEST] = NO_POINTER, REVERT
    return XcpError.NONE


def connect(pool: list[int]) -> XcpError:
    """CONNECT: a new session without DAQ lists; the staged characteristics become those in use."""
    end_session(pool)
    pool[IS_CONNECTED] = 1
    return answer(pool, CONNECTED_LOW, CONNECTED_HIGH)


def execute(  # noqa: PLR0911 - a line a command
    pool: list[int], state: object, command: XcpCommand
) -> XcpError:
    """Execute one command of a session."""
    code, low, high = command.command, command.low, command.high
    size = low & 0xFF
    if code == Code.CONNECT:
        return connect(pool)
    if code == Code.DISCONNECT:
        return end_session(pool)
    if code == Code.GET_STATUS:
        return answer(pool, RUNNING if is_running(pool) else 0, 0)
    if code == Code.SYNCH:
        return XcpError.CMD_SYNCH
    if code == Code.GET_COMM_MODE_INFO:
        return answer(pool, 0, 0x10 << 24)
    if code == Code.GET_ID:
        if size > 1:  # another kind of identification: none
            return XcpError.NONE
        set_address(pool, TEXT, EVENT_NAME_BYTES, False)
        return answer(pool, 0, FILE_NAME_BYTES)
    if code == Code.SET_MTA:
        return set_address(pool, low >> 16, high, True)
    if code == Code.UPLOAD:
        return upload(pool, state, pool[EXTENSION], pool[ADDRESS], size)
    if code == Code.SHORT_UPLOAD:
        return upload(pool, state, low >> 16, high, size)
    if code == Code.BUILD_CHECKSUM:
        return build_checksum(pool, state, high)
    if code == Code.DOWNLOAD:
        return download(pool, size, low >> 8 | (high & 0xFFFF) << 16)
    return execute_daq(pool, code, low, high)


def serve(pool: list[int], state: object, command: XcpCommand) -> None:
    """Process one command. Without a session only CONNECT is answered."""
    if pool[IS_CONNECTED] == 0 and command.command != Code.CONNECT:
        return
    pool[LOW] = pool[HIGH] = 0
    error = execute(pool, state, command)
    pool[WAKES], pool[WAITS], pool[PACKET] = NOW, 1, RESPONSE
    if error != XcpError.NONE:
        refuse(pool, error)


def exchange(pool: list[int], state: object, tick_s: float, now: NodeState, tx: Tx) -> Tx:
    """The slave's part of a tick, after `tick` has made the state `now`, which is also in `state`, and `tx`.

    A response is sent when the tick's second frame is free; a sample needs no free frame. The control frames
    in `tx` come first in any case.
    """
    has_arrived = now.received.xcp_command_arrival.tick == now.ticks
    if not has_arrived and now.ticks < pool[WAKES]:
        return tx
    pool[TICK] = now.ticks
    if pool[WAITS] != 0 and pool[REQUEST] == WRITE:
        pool[REQUEST] = REVERT
        refuse(pool, XcpError.ACCESS_DENIED)
    if has_arrived:
        pool[TICK_UNITS] = round(tick_s / TIMESTAMP_UNIT_S)
        serve(pool, state, now.received.xcp_command)
        pool[ENDS] = now.ticks + round(SILENCE_S / tick_s) if pool[IS_CONNECTED] != 0 else NEVER
    if pool[WAITS] != 0 and pool[REQUEST] != WRITE and tx.frame_count < 2:
        frame, _ = packing.pack_xcp_response(XcpResponse(pool[PACKET], pool[LOW], pool[HIGH]), 0)
        tx = add_frame(tx, frame)
        pool[WAITS], pool[WAKES] = 0, NOW if is_running(pool) else pool[ENDS]
    if now.ticks >= pool[ENDS]:
        end_session(pool)
    sending = next_list(pool, state)
    if sending != NO_POINTER:
        frame, _ = packing.pack_xcp_response(next_packet(pool, sending), 0)
        tx = add_frame(tx, frame)
        pool[sending + NEXT] += 1
    return tx
