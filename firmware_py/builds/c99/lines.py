"""The lines of a C function: what each one assigns and reads, removal of needless copies, and line breaks."""

import textwrap
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any

from firmware_py.builds.c99.expressions import Address, Part, Place, Variable, read_places, text_of
from firmware_py.builds.c99.names import is_record

WIDTH = 110
OPERATORS = " && || + - * / ? : = < > == <= >= != | & << >> ^ += -= *= /= |= &= "
"""A line is broken behind these, or behind a comma."""


@dataclass
class Line:
    """A line without its indentation.

    `target` is assigned the value in `parts`. `declares`: the variable that is declared here. `opens` and
    `closes`: whether a block begins at its end, and one ends at its beginning.
    """

    parts: tuple[Part, ...] = ()
    target: Place | None = None
    operator: str = "="
    declares: Variable | None = None
    opens: bool = False
    closes: bool = False
    is_return: bool = False

    def written(self) -> Iterator[Place]:
        """The places that the line changes."""
        if self.target is not None:
            yield self.target
        yield from (one.place for one in self.parts if isinstance(one, Address) and one.is_written)

    def touched(self) -> Iterator[Place]:
        """The places that the line reads or changes."""
        yield from read_places(self.parts)
        yield from read_places(() if self.target is None else (self.target,))

    def text(self, type_of: Callable[[Any], str], is_constant: bool) -> str:
        """The line; `type_of`: C's name of a type."""
        value = text_of(self.parts)
        if self.declares is not None:
            const = "const " if is_constant or self.declares.is_pointer else ""
            star = "*" if self.declares.is_pointer else ""
            head = f"{const}{type_of(self.declares.kind)} {star}{self.declares.name}"
            return f"{head} = {value};" if self.parts else f"{head};"
        if self.target is not None:
            return f"{self.target.text} {self.operator} {value};"
        words = ["}"] * self.closes + [value] * bool(value) + ["{"] * self.opens
        return " ".join(words)


def remove_copies(lines: list[Line]) -> list[Line]:
    """The lines without each copy `x = p->member; …; p->member = x;` of a record that is changed in place.

    Between the two lines nothing else reads or changes the member or a record that contains it, and the
    function does not return; behind them only one of the two is used.
    """
    for start, line in enumerate(lines):
        copy, source = line.declares, line.parts[0] if len(line.parts) == 1 else None
        if copy is None or copy.is_pointer or not isinstance(source, Place) or not is_record(copy.kind):
            continue
        root = source.resolve().root
        if not source.path or not root.is_pointer or root.points_to:
            continue
        ends = [k for k in range(start + 1, len(lines)) if is_return_of(lines[k], copy, source)]
        if len(ends) == 1 and may_live_there(lines, start, ends[0], copy, source):
            copy.lives_at = source
            return remove_copies([one for k, one in enumerate(lines) if k not in (start, ends[0])])
    return lines


def is_return_of(line: Line, copy: Variable, source: Place) -> bool:
    """Whether the line writes the copy back."""
    is_there = line.target is not None and line.target.resolve() == source.resolve()
    return is_there and line.parts == (Place(copy),)


def may_live_there(lines: Sequence[Line], start: int, end: int, copy: Variable, source: Place) -> bool:
    """Whether all uses of the copy may use its source instead."""
    between, behind = lines[start + 1 : end], lines[end + 1 :]
    depths = [sum(one.opens - one.closes for one in lines[start:k]) for k in range(start, end + 1)]
    if depths[-1] != 0 or min(depths) < 0:
        return False
    if any(one.is_return or any(map(source.overlaps, one.touched())) for one in between):
        return False
    own = Place(copy)
    uses_both = [any(any(map(place.overlaps, one.touched())) for one in behind) for place in (own, source)]
    return not all(uses_both)


def render(lines: Sequence[Line], type_of: Callable[[Any], str]) -> str:
    """The text of a function's body."""
    writes: dict[Variable, int] = {}
    for line in lines:
        for place in line.written():
            root = place.resolve().root
            writes[root] = writes.get(root, 0) + 1
    depth, found = 1, []
    for line in lines:
        depth -= line.closes
        is_constant = bool(line.parts) and line.declares is not None and line.declares not in writes
        found += wrap(line.text(type_of, is_constant), "    " * depth)
        depth += line.opens
    return "\n".join(found)


def wrap(text: str, margin: str = "") -> list[str]:
    """The lines of a statement or comment; each member of a long initializer has its own line."""
    if len(margin + text) <= WIDTH:
        return [margin + text]
    if text.startswith("/*"):
        words = text.removesuffix(" */")
        *above, last = textwrap.wrap(
            words, WIDTH - 3, initial_indent=margin, subsequent_indent=f"{margin} * "
        )
        return [*above, f"{last} */"]
    begin, inside = text.find("{."), depths(text)
    if begin >= 0:
        depth = inside[begin]
        end = begin + inside[begin:].index(depth - 1)
        if not text[end:].strip("});,"):
            ends = [k + 1 for k in range(begin, end) if text[k] == "," and inside[k] == depth]
            members = (text[a:b].strip() for a, b in pairwise([begin + 1, *ends, end]))
            inner = [line for one in members for line in wrap(one, f"{margin}    ")]
            return [*wrap(text[: begin + 1], margin), *inner, margin + text[end:]]
    return list(fill(text, margin))


def depths(text: str) -> list[int]:
    """The number of open brackets behind each character."""
    return list(accumulate((one in "([{") - (one in ")]}") for one in text))


def fill(text: str, margin: str) -> Iterator[str]:
    """The lines of a statement, broken where the fewest brackets are open."""
    indent = margin
    while len(indent + text) > WIDTH:
        breaks, inside = [], depths(text)
        for index, one in enumerate(text[: WIDTH - len(indent) + 1]):
            before = text[:index].rpartition(" ")[2] if one == " " else "x"
            if f" {before} " in OPERATORS or before.endswith((",", ";")):
                breaks.append((inside[index], -index))
        late = [one for one in breaks if -one[1] > (WIDTH - len(indent)) // 2] or breaks
        if not late:
            break
        at = -min(late)[1]
        yield indent + text[:at]
        text, indent = text[at + 1 :], f"{margin}        "
    yield indent + text
