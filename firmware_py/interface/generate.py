"""Writes one frame's encoder and decoder as straight-line Python.

A codec that loops over a description of its signals costs several times what the packing does, in every tick
of both loops. So each frame gets the few lines that someone would write by hand; `encoder_source` and
`decoder_source` return them as text to read.
"""

import math
import struct
from collections.abc import Callable, Sequence
from typing import Any, Protocol, TypeVar, cast

from firmware_py.interface.crc import FINAL_XOR, INITIAL, TABLE
from firmware_py.interface.frame import Frame
from firmware_py.interface.layout import Layout, Part, Signal, SignalKind, Word
from firmware_py.interface.refusals import Refusals

R = TypeVar("R", bound=tuple[Any, ...])
R_contra = TypeVar("R_contra", bound=tuple[Any, ...], contravariant=True)
R_co = TypeVar("R_co", bound=tuple[Any, ...], covariant=True)


class Encoder(Protocol[R_contra]):
    """Packs a record; quantities saturate at full scale, everything else outside its range is refused."""

    def __call__(self, record: R_contra, counter: int = 0) -> Frame:
        """Return the frame. `counter` counts this identifier's frames; its low four bits are sent."""


class Decoder(Protocol[R_co]):
    """Unpacks a frame's data."""

    def __call__(self, data: bytes) -> R_co:
        """Return the record; raise `FrameError` if the data must not be used."""


def encoder(layout: Layout, record: type[R]) -> Encoder[R]:
    """Compile the encoder of a frame."""
    return cast("Encoder[R]", _compiled(encoder_source(layout, _fields(record)), layout, record))


def decoder(layout: Layout, record: type[R]) -> Decoder[R]:
    """Compile the decoder of a frame."""
    return cast("Decoder[R]", _compiled(decoder_source(layout, _fields(record)), layout, record))


def encoder_source(layout: Layout, fields: Sequence[str]) -> str:
    """Return the text of `generated(record, counter=0) -> Frame`."""
    signals = layout.signals
    lines = ["def generated(record, counter=0):"]
    if fields:
        lines += ["    try:", f"        {', '.join(fields)}, = record"]
        for field in fields:
            lines += [f"        {line}" for line in _to_counts(signals[field])]
        lines += [f"        body = pack({', '.join(_packed(word) for word in layout.words if word.parts)})"]
        lines += ["    except (ValueError, OverflowError, TypeError, struct_error) as error:"]
        lines += ["        raise unencodable(record, error) from None"]
    else:
        lines += ["    body = b''"]
    if layout.protected:
        lines += [f"    {_bytes_of(layout)} = body", f"    body += last_byte[{_crc_index(layout)}]"]
    lines += ["    return new(Frame, (can_id, body))"]
    return "\n".join(lines) + "\n"


def decoder_source(layout: Layout, fields: Sequence[str]) -> str:
    """Return the text of `generated(data) -> record`."""
    signals = layout.signals
    lines = [
        "def generated(data):",
        f"    if len(data) != {layout.length}:",
        "        raise wrong_length(data)",
    ]
    if layout.protected:
        lines += [f"    {_bytes_of(layout)}, crc = data", f"    if last[{_crc_index(layout)}] != crc:"]
        lines += ["        raise wrong_crc(data)"]
    if fields:
        targets = [
            f"word_{index}" if word.parts[0].mask else word.parts[0].signal.name
            for index, word in _kept(layout)
        ]
        lines += [f"    {', '.join(targets)}, = unpack(data)"]
    for index, word in _kept(layout):
        for part in word.parts:
            if part.signal.kind is SignalKind.COUNTER:
                continue
            if part.mask:
                lines += [f"    {part.signal.name} = {_shifted_down(f'word_{index}', part)}"]
            lines += [f"    {line}" for line in _checks(word, part)]
    values = "".join(f"{_to_value(signals[field])}, " for field in fields)
    lines += [f"    return new(Record, ({values}))"]
    return "\n".join(lines) + "\n"


def _to_counts(signal: Signal) -> list[str]:
    """Lines that turn the field's value into its counts, under the same name."""
    name = signal.name
    if signal.is_float:
        return [f"if not isfinite({name}):", f"    raise ValueError('{name}')"]
    if signal.kind is SignalKind.QUANTITY:
        value = name if signal.scale == 1 else f"{name} / {signal.scale!r}"
        return [
            f"{name} = round({value})",
            f"if {name} > {signal.high_counts}:",
            f"    {name} = {signal.high_counts}",
            f"elif {name} < {signal.low_counts}:",
            f"    {name} = {signal.low_counts}",
        ]
    if signal.kind is SignalKind.ENUMERATION:
        return [f"if {name} not in {_constant(signal)}:", f"    raise ValueError('{name}')"]
    return [
        f"if not {signal.low_counts} <= {name} <= {signal.high_counts}:",
        f"    raise ValueError('{name}')",
    ]


def _packed(word: Word) -> str:
    """Expression of a word from its signals' counts."""
    terms = []
    for part in word.parts:
        counts = "(counter & 15)" if part.signal.kind is SignalKind.COUNTER else part.signal.name
        terms.append(f"{counts} << {part.shift}" if part.shift else counts)
    return " | ".join(terms)


def _shifted_down(word: str, part: Part) -> str:
    """Expression of a small signal's counts out of its byte."""
    return f"{word} >> {part.shift} & {part.mask}" if part.shift else f"{word} & {part.mask}"


def _checks(word: Word, part: Part) -> list[str]:
    """Lines that refuse counts which the signal cannot have; none if its bits hold nothing else."""
    signal = part.signal
    if signal.is_float:
        return [f"if not isfinite({signal.name}):", f"    raise not_finite('{signal.name}', {signal.name})"]
    if signal.kind is SignalKind.ENUMERATION:
        return [
            f"if {signal.name} not in {_constant(signal)}:",
            f"    raise unknown_value('{signal.name}', {signal.name})",
        ]
    span = (0, part.mask) if part.mask else (word.low_counts, word.high_counts)
    if span == (signal.low_counts, signal.high_counts):
        return []
    return [
        f"if not {signal.low_counts} <= {signal.name} <= {signal.high_counts}:",
        f"    raise out_of_range('{signal.name}', {signal.name})",
    ]


def _to_value(signal: Signal) -> str:
    """Expression of the physical value from the counts."""
    return signal.name if signal.is_float or signal.scale == 1 else f"{signal.name} * {signal.scale!r}"


def _constant(signal: Signal) -> str:
    """Name under which the generated code finds the signal's listed values."""
    return f"values_of_{signal.name}"


def _kept(layout: Layout) -> list[tuple[int, Word]]:
    """Words that struct hands out: all but pad bytes."""
    return [(index, word) for index, word in enumerate(layout.words) if word.parts]


def _bytes_of(layout: Layout) -> str:
    return ", ".join(f"byte_{index}" for index in range(layout.length - 1))


def _crc_index(layout: Layout) -> str:
    """Expression of the table index that the last protected byte leads to: CRC = table[index] ^ final XOR."""
    index = str(TABLE[INITIAL ^ (layout.can_id & 0xFF)])
    for position in range(layout.length - 1):
        index = f"table[{index}] ^ byte_{position}" if position else f"{index} ^ byte_0"
    return index


def _fields(record: type[tuple[Any, ...]]) -> tuple[str, ...]:
    """Fields of a NamedTuple class, in order."""
    return cast("tuple[str, ...]", record._fields)  # type: ignore[attr-defined]  # every NamedTuple has them


def _compiled(source: str, layout: Layout, record: type[tuple[Any, ...]]) -> Callable[..., Any]:
    """Compile generated text with the names that it uses."""
    refusals = Refusals(layout, _fields(record))
    names: dict[str, Any] = {
        "Frame": Frame,
        "Record": record,
        "can_id": layout.can_id,
        "isfinite": math.isfinite,
        "last": bytes(entry ^ FINAL_XOR for entry in TABLE),
        "last_byte": [bytes([entry ^ FINAL_XOR]) for entry in TABLE],
        "new": tuple.__new__,
        "not_finite": refusals.not_finite,
        "out_of_range": refusals.out_of_range,
        "pack": struct.Struct(layout.body_format).pack,
        "struct_error": struct.error,
        "table": TABLE,
        "unencodable": refusals.unencodable,
        "unknown_value": refusals.unknown_value,
        "unpack": struct.Struct(layout.body_format + ("x" if layout.protected else "")).unpack,
        "wrong_crc": refusals.wrong_crc,
        "wrong_length": refusals.wrong_length,
    }
    names |= {_constant(signal): signal.values for signal in layout.signals.values() if signal.values}
    exec(compile(source, f"<codec of {layout.name}>", "exec"), names)
    return cast("Callable[..., Any]", names["generated"])
