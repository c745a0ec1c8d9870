"""C expressions as they are built: text between the places in memory that it reads.

A place is a variable and a path of members and indices. Two places overlap if one path begins with the other;
from this follows where a record may be changed in place, and where a copy is needed first.
"""

from collections.abc import Iterable, Iterator
from enum import IntEnum
from typing import Any, NamedTuple, Union

Part = Union[str, "Place", "Address"]


class Level(IntEnum):
    """Precedences of C's operators; `BITS` is that of `&`, above `^` and `|`.

    `BRACES`: an initializer in braces, which needs its type before it outside a declaration.
    """

    BRACES, CHOICE, OR, AND, BITS = 0, 2, 3, 4, 7
    EQUAL, ORDER, SHIFT, SUM, PRODUCT, UNARY, PRIMARY = 8, 9, 10, 11, 12, 14, 15


class Variable:
    """A variable of a C function, or a constant of the file.

    `points_to`: the record to which a pointer of the function points. `lives_at`: the member of which the
    variable is a copy, if the copy is not needed; the variable is then a name for that member.

    A variable without a type gets that of its first value, which declares it unless `is_declared`.
    """

    def __init__(
        self, name: str, kind: Any = None, is_pointer: bool = False, is_declared: bool = False
    ) -> None:
        self.name, self.kind, self.is_pointer, self.is_declared = name, kind, is_pointer, is_declared
        self.points_to: Place | None = None
        self.lives_at: Place | None = None


class Place(NamedTuple):
    """A variable, or a member or an element of it."""

    root: Variable
    path: tuple[Any, ...] = ()
    """Names of members, and indices as expressions."""

    def resolve(self, through_pointers: bool = False) -> "Place":
        """The place where the variable lives; `through_pointers`: in the record to which it points."""
        at = self.root.lives_at or (self.root.points_to if through_pointers else None)
        return Place(at.root, at.path + self.path).resolve(through_pointers) if at else self

    def overlaps(self, other: "Place") -> bool:
        """Whether a change of one place may change the other; elements of an array count as one."""
        (root, path), (its_root, its_path) = self.resolve(True), other.resolve(True)
        pairs = zip(path, its_path, strict=False)
        return root is its_root and all(a == b for a, b in pairs if isinstance(a, str) and isinstance(b, str))

    @property
    def text(self) -> str:
        """The place in C."""
        root, path = self.resolve()
        if root.is_pointer and not path:
            return f"*{root.name}"
        text = root.name
        for index, step in enumerate(path):
            arrow = "->" if root.is_pointer and index == 0 else "."
            text += f"{arrow}{step}" if isinstance(step, str) else f"[{step.text}]"
        return text


class Address(NamedTuple):
    """A pointer to a place, through which a function reads or, if `is_written`, changes it."""

    place: Place
    is_written: bool = False

    @property
    def text(self) -> str:
        """The pointer in C."""
        root, path = self.place.resolve()
        return root.name if root.is_pointer and not path else f"&{self.place.text}"


def text_of(parts: Iterable[Part]) -> str:
    """The text of parts."""
    return "".join(one if isinstance(one, str) else one.text for one in parts)


def read_places(parts: Iterable[Part]) -> Iterator[Place]:
    """The places that parts read, those of indices included."""
    for one in parts:
        if not isinstance(one, str):
            place = one if isinstance(one, Place) else one.place
            yield place
            for step in place.path:
                yield from read_places(() if isinstance(step, str) else step.parts)


class C(NamedTuple):
    """A C expression: its parts, its type in Python, and the precedence of its operator."""

    parts: tuple[Part, ...]
    kind: Any
    level: int = Level.PRIMARY

    @property
    def text(self) -> str:
        """The expression in C."""
        return text_of(self.parts)

    @property
    def place(self) -> Place | None:
        """The place, if the expression is one."""
        only = self.parts[0] if len(self.parts) == 1 else None
        return only if isinstance(only, Place) else None

    @property
    def is_number(self) -> bool:
        """Whether it is a whole number in digits."""
        return len(self.parts) == 1 and isinstance(self.parts[0], str) and self.parts[0].isdigit()

    @property
    def is_pointer(self) -> bool:
        """Whether it is the address of a record."""
        return any(isinstance(one, Address) for one in self.parts)

    def within(self, level: int) -> tuple[Part, ...]:
        """The parts as an operand of an operator of this precedence."""
        return ("(", *self.parts, ")") if self.level < level else self.parts

    def reads(self, place: Place) -> bool:
        """Whether it reads this place, a part of it or a record that contains it."""
        return any(place.overlaps(one) for one in read_places(self.parts))


def expression(kind: Any, level: int, *parts: Any) -> C:
    """An expression of strings, places, other expressions, and tuples of these."""
    return C(tuple(flatten(parts)), kind, level)


def flatten(parts: Iterable[Any]) -> Iterator[Part]:
    """The parts within expressions and tuples."""
    for one in parts:
        if isinstance(one, C):
            yield from one.parts
        elif type(one) is tuple:
            yield from flatten(one)
        else:
            yield one
