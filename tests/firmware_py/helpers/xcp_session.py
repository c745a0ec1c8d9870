"""A master of XCP that ticks one node until it answers."""

import random
import struct
from collections.abc import Iterator, Sequence

from firmware_py.interface.enums import XcpCommandCode, XcpError
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated import kinds
from firmware_py.interface.parameter_table import INDEX
from firmware_py.node import xcp
from firmware_py.shell.node import Node

TICKS = 10
"""Ticks within which the node answers."""


def command(code: XcpCommandCode, *data: int) -> Frame:
    """The frame of a command."""
    return Frame(kinds.XCP_COMMAND.can_id, bytes((code, *data)).ljust(8, b"\0"))


def ask(node: Node, code: XcpCommandCode, *data: int, others: Sequence[Frame] = ()) -> bytes:
    """The response to a command; the node receives `others` in each tick."""
    return answered(node, node.tick([*others, command(code, *data)], 1), others)


def answered(node: Node, sent: Sequence[Frame], others: Sequence[Frame] = ()) -> bytes:
    """The response in `sent`, the frames of a tick that received a command, or in those of the next ticks."""
    for _ in range(TICKS):
        for frame in sent:
            if frame.can_id == kinds.XCP_RESPONSE.can_id and frame.data[0] >= xcp.ERROR:
                return frame.data
        sent = node.tick(others, 1)
    raise AssertionError(f"no answer within {TICKS} ticks")


def daq_commands(lists: Sequence[tuple[Sequence[int], int]]) -> list[Frame]:
    """The commands that set up DAQ lists of `(places, prescaler)` and select them."""
    code, lengths = XcpCommandCode, [len(found) for found, _ in lists]
    commands = [command(code.FREE_DAQ), command(code.ALLOC_DAQ, 0, len(lists), 0)]
    commands += [command(code.ALLOC_ODT, 0, k, 0, length) for k, length in enumerate(lengths)]
    commands += [
        command(code.ALLOC_ODT_ENTRY, 0, k, 0, odt, 1)
        for k, length in enumerate(lengths)
        for odt in range(length)
    ]
    for k, (found, prescaler) in enumerate(lists):
        for odt, place in enumerate(found):
            commands.append(command(code.SET_DAQ_PTR, 0, k, 0, odt, 0))
            commands.append(command(code.WRITE_DAQ, 0xFF, 4, 0, *struct.pack("<I", 4 * place)))
        commands.append(command(code.SET_DAQ_LIST_MODE, xcp.TIME_STAMPED, k, 0, 0, 0, prescaler, 0))
        commands.append(command(code.START_STOP_DAQ_LIST, 2, k, 0))
    return commands


def configure(node: Node, lists: Sequence[tuple[Sequence[int], int]]) -> None:
    """Set up DAQ lists of `(places, prescaler)` and select them."""
    for frame in daq_commands(lists):
        assert answered(node, node.tick([frame], 1))[0] == xcp.RESPONSE, frame


def is_sample(frame: Frame) -> bool:
    """Whether a frame is a packet of a DAQ list."""
    return frame.can_id == kinds.XCP_RESPONSE.can_id and frame.data[0] < xcp.ERROR


def write(node: Node, place: int, data: bytes) -> XcpError:
    """Write an element of the characteristics; NONE, or why it is refused."""
    ask(node, XcpCommandCode.SET_MTA, 0, 0, xcp.CHARACTERISTICS, *struct.pack("<I", 4 * place))
    answer = ask(node, XcpCommandCode.DOWNLOAD, len(data), *data)
    return XcpError.NONE if answer[0] == xcp.RESPONSE else XcpError(answer[1])


def calibrate(node: Node, name: str, value: float) -> XcpError:
    """Write one parameter and commit it; NONE, or why it is refused."""
    ask(node, XcpCommandCode.CONNECT)
    error = write(node, INDEX[name], struct.pack("<f", value))
    return error if error is not XcpError.NONE else write(node, xcp.COMMIT, struct.pack("<I", 1))


def staged(node: Node, name: str) -> float:
    """The staged value of a parameter."""
    place = struct.pack("<I", 4 * INDEX[name])
    answer = ask(node, XcpCommandCode.SHORT_UPLOAD, 4, 0, xcp.CHARACTERISTICS, *place)
    return float(struct.unpack_from("<f", answer, 1)[0])


def commands_of(dice: random.Random, count: int) -> Iterator[Frame]:
    """Commands in any order, with plausible and with random arguments, some of them of another length."""
    codes = [code for code in XcpCommandCode if code != XcpCommandCode.DISCONNECT]
    yield command(XcpCommandCode.CONNECT)
    for _ in range(count - 1):
        code = dice.choice(codes) if dice.random() < 0.98 else dice.randrange(256)
        small = [dice.choice((0, 0, 0, 1, 1, 2, 3, 4, 8, 16, 40, 255)) for _ in range(7)]
        data = small if dice.random() < 0.8 else [dice.randrange(256) for _ in range(7)]
        if code == XcpCommandCode.WRITE_DAQ and dice.random() < 0.8:
            data[:3] = 0xFF, 4, 0
        length = 7 if dice.random() < 0.98 else dice.randrange(8)
        if code != XcpCommandCode.CONNECT or dice.random() < 0.1:
            yield Frame(kinds.XCP_COMMAND.can_id, bytes((code, *data[:length])))
