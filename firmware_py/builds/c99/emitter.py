"""The firmware as one C source file: what its functions need, in the order of its definition."""

import functools
import inspect
import sys
import textwrap
from collections import Counter
from collections.abc import Iterator
from enum import IntEnum
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, get_args, get_origin

from firmware_py.builds.c99 import header
from firmware_py.builds.c99.body import Body
from firmware_py.builds.c99.expressions import C, Place, Variable
from firmware_py.builds.c99.lines import WIDTH, wrap
from firmware_py.builds.c99.names import c_identifier, first_paragraph, is_record
from firmware_py.builds.c99.shape import UntranslatableError, documents, function_name, origin, shape, short
from firmware_py.builds.c99.single_precision import in_single_precision
from firmware_py.builds.flat import Precision, members
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.node import calibration, inbox, tick, xcp
from firmware_py.node.memory import INITIAL

ROOTS: tuple[Any, ...] = (
    *(inbox.receive, inbox.advance, tick.tick),
    *(inbox.end_period, xcp.exchange, calibration.calibrate),
)
"""The functions that the entry points call."""
GIVEN: Any = header.TEMPLATES.get_template("given.c.j2").module


class Translated(NamedTuple):
    """A function in C: its declaration, its text, and the functions that it calls."""

    head: str
    text: str
    calls: list[FunctionType]


class Emitter:
    """The file while it is made."""

    count, page_at = xcp.COUNT, xcp.PAGE_AT

    def __init__(self, precision: Precision, has_gait: bool) -> None:
        self.precision, self.has_gait = precision, has_gait
        self.real, self.suffix = ("double", "") if precision == "double" else ("float", "f")
        self.constants: dict[str, str] = {}
        self.kinds: dict[Any, None] = {}
        self.functions: dict[FunctionType, Translated] = {}
        self.calls: list[list[FunctionType]] = [[]]
        """The functions that those in translation call, the innermost last."""
        self.declared = {kind for record in header.RECORDS for kind in header.list_needed(record)}
        for root in ROOTS:
            self.call(root)
        names = Counter(map(header.c_name, (*self.declared, *self.kinds)))
        if twice := [name for name, count in names.items() if count > 1]:
            raise UntranslatableError(f"two types would be {', '.join(twice)} in C: rename one")

    # -- Types and constants ---------------------------------------------------------------------------------

    def c_type(self, kind: Any) -> str:
        """The name of a type, which is then declared."""
        if is_record(kind):
            self.need(kind)
            return header.c_name(kind)
        if get_origin(kind) is tuple:  # of one record, which stands for the tuple
            return self.c_type(get_args(kind)[0])
        return {float: self.real, bool: "bool", bytes: "const uint8_t *"}.get(kind, "int64_t")

    def need(self, kind: Any) -> None:
        """Declare a record or an enum and what it contains, if the header does not."""
        for one in header.list_needed(kind):
            if one not in self.declared:
                self.kinds[one] = None

    def number(self, value: float, written: str = "") -> str:
        """A float constant; `written`: as it stands in Python."""
        if self.precision == "single":
            value = in_single_precision(value)
        return header.number(value, self.precision, written)

    def constant(self, module: ModuleType, name: str, value: Any) -> C:
        """A reference to a constant of a module, which is then defined."""
        if isinstance(value, IntEnum):
            self.need(type(value))
            return C((f"{header.c_name(type(value)).upper()}_{value.name}",), type(value))
        if module.__name__ == "math":
            return C(("PI" if name == "pi" else self.number(value),), float)
        module, name = origin(module, name)
        own = f"{short(module.__name__)}_{name.lstrip('_')}".upper()
        if own not in self.constants:
            above = first_paragraph(documents(module.__name__).get(name))
            text = [*(wrap(above) if above else []), *wrap(f"static const {self.definition(own, value)}")]
            self.constants[own] = "\n".join(text)
        kind: Any = type(value)
        if kind is tuple:
            kind = tuple.__class_getitem__(tuple(map(type, value)))
        return C((Place(Variable(own, kind)),), kind)

    def definition(self, own: str, value: Any) -> str:
        """The definition of a constant without its qualifiers."""
        if isinstance(value, bytes):
            return f"uint8_t {own}[{len(value)}] = {{{', '.join(map(str, value))}}};"
        if isinstance(value, tuple) and not is_record(value):
            return f"{self.c_type(type(value[0]))} {own}[{len(value)}] = {self.initial(value)};"
        return f"{self.c_type(type(value))} {own} = {self.initial(value)};"

    def initial(self, value: Any) -> str:
        """A value's initializer."""
        if is_record(value):
            fields = (
                f".{c_identifier(name)} = {self.initial(one)}"
                for name, one in zip(value._fields, value, strict=True)
            )
            return f"{{{', '.join(fields)}}}"
        if isinstance(value, tuple):
            return f"{{{', '.join(map(self.initial, value))}}}"
        if isinstance(value, IntEnum):
            return self.constant(sys.modules[__name__], "", value).text
        return self.number(value) if isinstance(value, float) else header.number(value, self.precision)

    # -- Functions -------------------------------------------------------------------------------------------

    def call(self, function: FunctionType) -> str:
        """The name of a function, which is then translated."""
        name = function_name(function)
        self.calls[-1].append(function)
        if function not in self.functions:
            self.calls.append([])
            self.functions[function] = Translated("", "", [])
            for kind in (*shape(function).parameters.values(), *shape(function).results):
                self.c_type(kind)
            head, text = self.given(function) if hasattr(GIVEN, name) else Body(self, function).translate()
            self.functions[function] = Translated(head, text, self.calls.pop())
        return name

    def given(self, function: FunctionType) -> tuple[str, str]:
        """The declaration and the text of a function that is written in C."""
        name = function_name(function)
        text = getattr(GIVEN, name)(self)
        for one in vars(sys.modules[function.__module__]).values():
            if isinstance(one, FunctionType) and one is not function and f"{function_name(one)}(" in text:
                self.call(one)
        return next(line[:-2] for line in text.splitlines() if f" {name}(" in line), text

    def modules(self) -> list[ModuleType]:
        """The modules in the order of their definition: each behind those that it calls if possible."""
        found: dict[ModuleType, None] = {}
        pending: set[ModuleType] = set()

        def visit(module: ModuleType) -> None:
            if module in pending:
                return
            pending.add(module)
            for function, translated in self.functions.items():
                if inspect.getmodule(function) is module:
                    for called in translated.calls:
                        visit(inspect.getmodule(called) or module)
            found[module] = None

        for root in ROOTS:
            visit(sys.modules[root.__module__])
        return list(found)

    def ordered(self) -> dict[ModuleType, list[FunctionType]]:
        """The functions by their modules, in the order of the sources."""
        found: dict[ModuleType, list[FunctionType]] = {module: [] for module in self.modules()}
        for one in sorted(self.functions, key=lambda one: one.__code__.co_firstlineno):
            found[sys.modules[one.__module__]].append(one)
        return found

    def prototypes(self) -> str:
        """The declarations of the functions that are called above their definition."""
        order = [one for functions in self.ordered().values() for one in functions]
        number = {one: index for index, one in enumerate(order)}
        early = {
            called for one in order for called in self.functions[one].calls if number[called] >= number[one]
        }
        heads = (self.functions[one].head for one in order if one in early)
        return "\n".join(line for head in heads for line in wrap(f"{head};"))

    # -- Tables for the functions that are written in C ------------------------------------------------------

    def measurements(self) -> Iterator[tuple[str, int]]:
        """Each measurement's member and kind."""
        return ((name, {float: 0, bool: 2}.get(kind, 1)) for name, kind in paths(tick.NodeState))

    def parameters(self) -> Iterator[tuple[str, int]]:
        """Each parameter's member, and whether it is a count."""
        return ((name, calibration.WHOLES[index]) for index, (name, _) in enumerate(paths(Parameters)))

    def power_up(self) -> str:
        """Assignments of the numbers of the state that are not 0 at power-up."""
        values = zip(paths(tick.NodeState), numbers(INITIAL.node), strict=True)
        lines = [f"    state->node.{name} = {self.initial(one)};" for (name, _), one in values if one != 0]
        begin, page = INITIAL.pool[: self.page_at], INITIAL.pool[self.page_at :]
        lines += [f"    state->pool[{index}] = {value};" for index, value in enumerate(begin) if value]
        lines += wrap(f"static const uint32_t PAGE[{len(page)}] = {{{', '.join(map(str, page))}}};", "    ")
        lines.append(f"    for (int index = 0; index < {len(page)}; index++) {{")
        return "\n".join([*lines, f"        state->pool[{self.page_at} + index] = PAGE[index];", "    }"])

    # -- The whole -------------------------------------------------------------------------------------------

    def text(self) -> str:
        """The source file."""
        sections, ordered = [], self.ordered()
        titles = {short(module.__name__): title(module) for module in ordered}
        for (name, about), functions in zip(titles.items(), ordered.values(), strict=True):
            sections += [*wrap(f"/* ---- {name}: {about} ---- */"), ""]
            sections += [self.functions[one].text for one in functions]
        return header.TEMPLATES.get_template("firmware.c.j2").render(
            contents="\n".join(contents_line(name, about) for name, about in titles.items()),
            real=self.real,
            pi=self.number(3.141592653589793),
            types="\n".join(map(self.declaration, self.kinds)),
            constants="\n".join(self.constants.values()),
            prototypes=self.prototypes(),
            functions="\n".join(sections),
            power_up=self.power_up(),
        )

    def declaration(self, kind: Any) -> str:
        """The declaration of a type that only the source needs."""
        if issubclass(kind, IntEnum):
            return header.enum_text(kind)
        above, *rest = header.struct_text(kind, self.precision).splitlines(keepends=True)
        return "".join([*(f"{line}\n" for line in wrap(above.rstrip())), *rest])


def title(module: ModuleType) -> str:
    """The first line of a module's docstring, without how the Python source is made."""
    return (inspect.getdoc(module) or "").partition("\n")[0].partition(": written by")[0].rstrip(":.")


def contents_line(name: str, about: str) -> str:
    """A module's line in the table at the beginning of the file."""
    begin, further = f" *   {name:16} ", f" *   {'':16} "
    return textwrap.fill(about, WIDTH, initial_indent=begin, subsequent_indent=further)


def paths(kind: Any, name: str = "") -> list[tuple[str, Any]]:
    """Paths and types of all numbers within a record."""
    if get_origin(kind) is tuple:
        return [one for index, item in enumerate(get_args(kind)) for one in paths(item, f"{name}[{index}]")]
    if is_record(kind):
        named = ((f"{name}.{c_identifier(key)}".lstrip("."), item) for key, item in members(kind))
        return [one for key, item in named for one in paths(item, key)]
    return [(name, kind)]


def numbers(value: Any) -> list[Any]:
    """All numbers within a record, in the order of `paths`."""
    return [one for item in value for one in numbers(item)] if isinstance(value, tuple) else [value]


@functools.cache
def emit(precision: Precision, has_gait: bool = True) -> Emitter:
    """The firmware in C; raise UntranslatableError with file and line for what is outside the subset."""
    return Emitter(precision, has_gait)
