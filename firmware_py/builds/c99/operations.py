"""Python's expressions in C, within one function.

An expression that needs statements of its own, such as a call that changes a record, writes them into `lines`
first and is then the variable that holds its result.
"""

import ast
import builtins
import functools
import inspect
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from enum import IntEnum
from types import FunctionType, ModuleType
from typing import Any, get_args, get_origin, get_type_hints

from firmware_py.builds.c99.expressions import C, Level, Place, Variable, expression
from firmware_py.builds.c99.lines import Line
from firmware_py.builds.c99.names import c_identifier, is_record, snake
from firmware_py.builds.c99.shape import INSTEAD, refuse, shape
from firmware_py.builds.flat import members
from firmware_py.core.gait.follow import is_built_in
from firmware_py.interface.enums import axis_state_of, operator_request_of

BINARY: dict[type, tuple[str, int]] = {
    ast.Add: ("+", Level.SUM), ast.Sub: ("-", Level.SUM),
    ast.Mult: ("*", Level.PRODUCT), ast.Div: ("/", Level.PRODUCT),
    ast.LShift: ("<<", Level.SHIFT), ast.RShift: (">>", Level.SHIFT),
    ast.BitAnd: ("&", Level.BITS), ast.BitXor: ("^", Level.BITS - 1), ast.BitOr: ("|", Level.BITS - 2),
}  # fmt: skip
COMPARED: dict[type, tuple[str, int]] = {
    ast.Eq: ("==", Level.EQUAL), ast.NotEq: ("!=", Level.EQUAL), ast.Lt: ("<", Level.ORDER),
    ast.LtE: ("<=", Level.ORDER), ast.Gt: (">", Level.ORDER), ast.GtE: (">=", Level.ORDER),
}  # fmt: skip
SAME_NUMBER = (axis_state_of, operator_request_of)
"""Functions from a number to the enum of the same number."""
TRUE, FALSE = C(("true",), bool), C(("false",), bool)


def is_replace(node: ast.expr) -> bool:
    """Whether it replaces members of a record."""
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(called, ast.Attribute) and called.attr == "_replace"


class Operations:
    """The expressions of one function."""

    call: Any
    store: Any
    value_in: Any
    """Methods of `Body`, which write the statements that an expression needs."""

    def __init__(self, unit: Any, function: FunctionType, tree: ast.FunctionDef) -> None:
        self.unit, self.function, self.tree = unit, function, tree
        self.constant: Callable[[ModuleType, str, Any], C] = unit.constant
        self.module = inspect.getmodule(function) or ast  # every function has one
        self.lines: list[Line] = []
        self.variables: dict[str, Variable] = {}
        self.known: dict[str, int] = {}
        """Loop variables whose loop is written out."""
        self.hint = ""
        """The member whose value is translated, for the names of variables that hold it."""
        self.names = {node.id for node in ast.walk(tree) if isinstance(node, ast.Name)}

    # -- Variables -------------------------------------------------------------------------------------------

    def fresh(self, hint: str) -> str:
        """A name that the function does not use."""
        hints = (hint, f"new_{hint}", *(f"{hint}_{count}" for count in range(2, 100)))
        name = next(one for one in hints if one not in self.names)
        self.names.add(name)
        return c_identifier(name)

    def in_memory(self, value: C, hint: str) -> Place:
        """A variable that holds a value."""
        variable = Variable(self.fresh(hint), value.kind, is_declared=True)
        self.lines.append(Line(value.parts, declares=variable))
        return Place(variable)

    def temporary(self, value: C, hint: str) -> C:
        """An expression that means a variable which holds a value."""
        return C((self.in_memory(value, hint),), value.kind)

    @contextmanager
    def captured(self) -> Iterator[list[Line]]:
        """The lines that are written within the context."""
        kept, self.lines = self.lines, []
        try:
            yield self.lines
        finally:
            self.lines = kept

    @contextmanager
    def braces(self, *head: Any) -> Iterator[None]:
        """The lines of a block behind its head; names of temporary variables end with it."""
        names = set(self.names)
        self.lines.append(Line(head, opens=True))
        yield
        self.lines.append(Line(closes=True))
        self.names = names

    def look(self, node: ast.expr) -> C:
        """An expression that is only looked at."""
        names = set(self.names)
        with self.captured():
            found = self.expression(node)
        self.names = names
        return found

    def value_of(self, node: ast.expr) -> Any:
        """The Python object that a name or a module's attribute means; None for anything else."""
        if isinstance(node, ast.Name) and node.id not in self.variables and node.id not in self.known:
            return vars(self.module).get(node.id, getattr(builtins, node.id, None))
        if isinstance(node, ast.Attribute):
            base = self.value_of(node.value)
            return getattr(base, node.attr, None) if isinstance(base, (ModuleType, type)) else None
        return None

    def function_of(self, node: ast.expr) -> FunctionType | None:
        """The function that a call calls; None for anything else."""
        called = self.value_of(node.func) if isinstance(node, ast.Call) else None
        replaced = INSTEAD.get(called, called)
        return replaced if isinstance(replaced, FunctionType) else None

    # -- Names, members and elements -------------------------------------------------------------------------

    def expression(self, node: ast.expr) -> C:
        """The expression of a node; raise UntranslatableError for a node outside the subset."""
        translate = getattr(self, f"of_{snake(type(node).__name__)}", None)
        if translate is None:
            raise refuse(self.module, node, "this expression is outside the subset")
        found: C = translate(node)
        return found

    def of_constant(self, node: ast.Constant) -> C:
        """A number or truth value."""
        if isinstance(node.value, bool):
            return TRUE if node.value else FALSE
        if isinstance(node.value, float):
            line = inspect.getsource(self.module).split("\n")[node.lineno - 1].encode()
            written = line[node.col_offset : node.end_col_offset].decode()
            return C((self.unit.number(node.value, written),), float)
        if not isinstance(node.value, int):
            raise refuse(self.module, node, "this constant is outside the subset")
        return C((hex(node.value) if node.value > 255 else str(node.value),), int)

    def of_name(self, node: ast.Name) -> C:
        """A variable or a constant of the module."""
        if node.id in self.known:
            return C((str(self.known[node.id]),), int)
        if node.id in self.variables:
            variable = self.variables[node.id]
            return C((Place(variable),), variable.kind)
        if node.id not in vars(self.module):
            raise refuse(self.module, node, "this name has no value here")
        return self.constant(self.module, node.id, vars(self.module)[node.id])

    def of_attribute(self, node: ast.Attribute) -> C:
        """A member of a record, a constant of another module, or an enum."""
        value, base = self.value_of(node), self.value_of(node.value)
        if isinstance(base, ModuleType) or isinstance(value, IntEnum):
            return self.constant(base if isinstance(base, ModuleType) else self.module, node.attr, value)
        whole = self.expression(node.value)
        return C(whole.parts, int) if node.attr == "value" else self.member(whole, node.attr)

    def member(self, whole: C, name: str) -> C:
        """A member of a record."""
        kind = dict(members(whole.kind))[name]
        place = whole.place or self.in_memory(whole, snake(whole.kind.__name__))
        return C((Place(place.root, (*place.path, c_identifier(name))),), kind)

    def of_subscript(self, node: ast.Subscript) -> C:
        """An element, or one of a call's results."""
        function = self.function_of(node.value)
        if function is not None and isinstance(node.value, ast.Call):
            index = node.slice.value if isinstance(node.slice, ast.Constant) else None
            result: C | None = self.call(node.value, {}, keeps=index)
            if result is None:
                raise refuse(self.module, node, "of a call's results only the returned one can be taken")
            return result
        return self.item(self.expression(node.value), self.expression(node.slice))

    def item(self, whole: C, index: C) -> C:
        """An element of an array, or a member of a record by its number."""
        if is_record(whole.kind):
            return self.member(whole, whole.kind._fields[int(index.text)])
        if whole.kind is bytes:
            return expression(int, Level.UNARY, ("(int64_t)", whole, "[", index, "]"))
        kinds = [one for one in get_args(whole.kind) if one is not Ellipsis]
        if get_origin(whole.kind) is tuple and len(kinds) == 1:  # one record, which stands for the tuple
            return C(whole.parts, kinds[0])
        if whole.place is None:
            return expression(kinds[0], Level.PRIMARY, whole, "[", index, "]")
        return C((Place(whole.place.root, (*whole.place.path, index)),), kinds[0])

    # -- Operators -------------------------------------------------------------------------------------------

    def of_unary_op(self, node: ast.UnaryOp) -> C:
        """A sign, a negation or the inverted bits."""
        value = self.expression(node.operand)
        if isinstance(node.op, ast.Not):
            if value in (TRUE, FALSE):
                return FALSE if value == TRUE else TRUE
            return expression(bool, Level.UNARY, "!", value.within(Level.UNARY))
        operator = "-" if isinstance(node.op, ast.USub) else "~"
        operand = ("(", *value.parts, ")") if value.text.startswith("-") else value.within(Level.UNARY)
        return expression(value.kind, Level.UNARY, operator, operand)

    def of_bin_op(self, node: ast.BinOp) -> C:
        """An arithmetic operation."""
        left, right = self.expression(node.left), self.expression(node.right)
        if isinstance(node.op, (ast.Mod, ast.FloorDiv)):
            name = "floor_mod" if isinstance(node.op, ast.Mod) else "floor_div"
            return expression(int, Level.PRIMARY, (f"{name}(", left, ", ", right, ")"))
        if type(node.op) not in BINARY:
            raise refuse(self.module, node, "this operator is outside the subset")
        operator, level = BINARY[type(node.op)]
        kind = float if float in (left.kind, right.kind) or operator == "/" else int
        if operator == "<<" and left.is_number:
            left = expression(int, Level.PRIMARY, "INT64_C(", left, ")")
        elif operator == "<<":
            return expression(int, Level.PRIMARY, ("shift_left(", left, ", ", right, ")"))
        is_tight = level <= Level.SHIFT  # parentheses around all operands of shifts and bit operations
        is_chain = isinstance(node.left, ast.BinOp) and type(node.left.op) is type(node.op)
        left_level = Level.UNARY if is_tight and not is_chain else level
        sides = (
            self.converted(left, kind, left_level),
            self.converted(right, kind, Level.UNARY if is_tight else level + 1),
        )
        return expression(kind, level, sides[0], f" {operator} ", sides[1])

    def converted(self, value: C, kind: Any, level: int = Level.CHOICE) -> tuple[Any, ...]:
        """The parts of an operand of this precedence, as a float if that is wanted."""
        if kind is not float or value.kind is float:
            return value.parts if value.level == Level.BRACES else value.within(level)
        if value.is_number:
            return (f"{value.text}.0{self.unit.suffix}",)
        return (f"({self.unit.real})", *value.within(Level.UNARY))

    def of_bool_op(self, node: ast.BoolOp) -> C:
        """Conditions joined by `and` or `or`; what a later one needs is written in a branch."""
        is_and = isinstance(node.op, ast.And)
        operator, level = (" && ", Level.AND) if is_and else (" || ", Level.OR)
        neutral, absorbing = (TRUE, FALSE) if is_and else (FALSE, TRUE)
        found: list[C] = []
        for one in node.values:
            with self.captured() as needed:
                value = self.expression(one)
            if value == absorbing:
                return absorbing
            if value == neutral:
                continue
            if needed and found:
                before = self.joined(found, operator, level)
                holds = self.temporary(before, "holds")
                test = holds.parts if is_and else ("!", *holds.parts)
                with self.braces("if (", *test, ")"):
                    self.lines += [*needed, Line(value.parts, holds.place)]
                found = [holds]
            else:
                self.lines += needed
                found.append(value)
        return self.joined(found, operator, level) if found else neutral

    def joined(self, values: Sequence[C], operator: str, level: int) -> C:
        """Conditions joined by && or ||; mixtures of the two are put in parentheses."""
        if len(values) == 1:
            return values[0]
        parts: list[Any] = []
        for one in values:
            is_mixed = one.level <= Level.AND and one.level != level
            parts += [operator, ("(", *one.parts, ")") if is_mixed else one.within(level)]
        return expression(bool, level, *parts[1:])

    def of_compare(self, node: ast.Compare) -> C:
        """Comparisons, or membership in a tuple."""
        left, found = self.expression(node.left), []
        for operator, right_node in zip(node.ops, node.comparators, strict=True):
            if isinstance(operator, (ast.In, ast.NotIn)):
                is_in, own = isinstance(operator, ast.In), left.within(Level.ORDER)
                items = (one.within(Level.ORDER) for one in self.items(right_node))
                tests = [
                    expression(bool, Level.EQUAL, own, " == " if is_in else " != ", one) for one in items
                ]
                return self.joined(tests, *(" || ", Level.OR) if is_in else (" && ", Level.AND))
            if type(operator) not in COMPARED:
                raise refuse(self.module, node, "this comparison is outside the subset")
            right, (sign, level) = self.expression(right_node), COMPARED[type(operator)]
            kind = float if float in (left.kind, right.kind) else int
            sides = (self.converted(one, kind, Level.ORDER + 1) for one in (left, right))
            found.append(expression(bool, level, next(sides), f" {sign} ", next(sides)))
            left = right
        return self.joined(found, " && ", Level.AND)

    def items(self, node: ast.expr) -> list[C]:
        """The elements of a tuple that is written out, or of a module's."""
        if isinstance(node, ast.Tuple):
            return [self.expression(one) for one in node.elts]
        return [C((self.unit.initial(one),), type(one)) for one in self.value_of(node)]

    def of_if_exp(self, node: ast.IfExp) -> C:
        """A choice of two values."""
        test = self.expression(node.test)
        if test in (TRUE, FALSE):
            return self.expression(node.body if test == TRUE else node.orelse)
        with self.captured() as needed:
            first = self.expression(node.body)
        with self.captured() as needed_else:
            second = self.expression(node.orelse)
        kind = (
            float if float in (first.kind, second.kind) else second.kind if first.kind is int else first.kind
        )
        first, second = (
            expression(kind, max(one.level, Level.CHOICE), self.typed(one, kind)) for one in (first, second)
        )
        if not needed and not needed_else:
            sides = first.within(Level.CHOICE + 1), " : ", second.within(Level.CHOICE + 1)
            return expression(kind, Level.CHOICE, test.within(Level.CHOICE + 1), " ? ", sides)
        chosen = Variable(self.fresh("chosen"), kind, is_declared=True)
        place = Place(chosen)
        self.lines.append(Line(declares=chosen))
        with self.braces("if (", *test.parts, ")"):
            self.lines += [*needed, Line(first.parts, place), Line(("else",), opens=True, closes=True)]
            self.lines += [*needed_else, Line(second.parts, place)]
        return C((place,), kind)

    def typed(self, value: C, kind: Any) -> tuple[Any, ...]:
        """The parts of a value outside a declaration: an initializer gets its type."""
        if value.level == Level.BRACES:
            return (f"({self.unit.c_type(value.kind)})", *value.parts)
        return self.converted(value, kind)

    # -- Calls -----------------------------------------------------------------------------------------------

    def of_call(self, node: ast.Call) -> C:  # noqa: PLR0911 - a line a kind of call
        """A call as an expression."""
        if is_replace(node):
            return self.in_a_variable(self.look(node.func.value).kind, node)  # type: ignore[attr-defined]
        called, function = self.value_of(node.func), self.function_of(node)
        if is_record(called):
            return self.compound(called, node)
        if called is len:
            kind = self.look(node.args[0]).kind
            return C((str(len(kind._fields if is_record(kind) else get_args(kind))),), int)
        if called is is_built_in:
            return TRUE if self.unit.has_gait else FALSE
        if called in SAME_NUMBER:
            return self.expression(node.args[0])._replace(kind=get_type_hints(called)["return"])
        if function is None:
            return self.builtin(called, node)
        where = shape(function)
        if where.in_place:
            return self.in_a_variable(where.results[0], node)
        result: C | None = self.call(node, {}, keeps=where.value)
        if result is None:
            raise refuse(self.module, node, "a function without a result is no expression")
        if len(where.results) == 1 and get_origin(get_type_hints(function)["return"]) is tuple:
            return result._replace(kind=get_type_hints(function)["return"])
        return result

    def in_a_variable(self, kind: Any, node: ast.Call) -> C:
        """A record that a call or `_replace` changes, in a variable of its own."""
        variable = Variable(self.fresh(self.hint or snake(kind.__name__)), kind)
        self.store(Place(variable), node)
        return C((Place(variable),), kind)

    def compound(self, kind: Any, node: ast.Call) -> C:
        """A record's initializer."""
        return self.initializer(kind, self.given(kind, node))

    def initializer(self, kind: Any, values: dict[str, C]) -> C:
        """An initializer of these members; the others are 0."""
        self.unit.c_type(kind)
        parts: list[Any] = []
        for name, one in values.items():
            parts += [", ", f".{c_identifier(name)} = ", self.converted(one, dict(members(kind))[name])]
        return expression(kind, Level.BRACES, "{", *(parts[1:] or ["0"]), "}")

    def given(self, kind: Any, node: ast.Call) -> dict[str, C]:
        """The values of a record's members, in the order of the record."""
        found = dict(zip(kind._fields, node.args, strict=False)) | {
            one.arg: one.value for one in node.keywords
        }
        return {name: self.value_in(kind, name, found[name]) for name in kind._fields if name in found}

    def builtin(self, called: Any, node: ast.Call) -> C:  # noqa: PLR0911 - a line a function
        """A call of Python's own functions or of `math`."""
        values, suffix = [self.expression(one) for one in node.args], self.unit.suffix
        kind = float if any(one.kind is float for one in values) else int
        operands = [self.converted(one, kind) for one in values]
        name = called.__name__ if callable(called) else ""
        if name in ("min", "max"):
            function = f"{name}_{'real' if kind is float else 'int'}"
            both = lambda one, other: (f"{function}(", *one, ", ", *other, ")")  # noqa: E731
            return expression(kind, Level.PRIMARY, functools.reduce(both, operands))
        real = self.converted(values[0], float)
        if name == "abs" and kind is int:
            return expression(int, Level.PRIMARY, "abs_int(", operands[0], ")")
        if name in ("abs", "sqrt"):
            function = f"{'fabs' if name == 'abs' else name}{suffix}"
            return expression(float, Level.PRIMARY, f"{function}(", real, ")")
        if name in ("isnan", "isfinite"):
            return expression(bool, Level.PRIMARY, f"{name}(", real, ")")
        if name == "float":
            return expression(float, Level.UNARY, real)
        if name == "radians":
            return expression(
                float, Level.PRODUCT, values[0].within(Level.PRODUCT), f" * (PI / 180.0{suffix})"
            )
        if name in ("int", "round", "floor"):
            if kind is int:
                return values[0]
            function = {"int": "", "round": f"rint{suffix}", "floor": f"floor{suffix}"}[name]
            argument = (f"{function}(", real, ")") if function else values[0].within(Level.UNARY)
            # all within 32 bits, for which processors have an instruction
            return expression(int, Level.UNARY, "(int64_t)(int32_t)", argument)
        raise refuse(self.module, node, "this call is outside the subset")
