"""Intervals of the firmware's expressions, from syntax trees, bounds of parameters and conditions.

An interval says: the number is NaN or lies within. A division by NaN gives NaN and fails on no build.
"""

import ast
import functools
import inspect
import math
import sys
from collections.abc import Iterator, Sequence
from types import FunctionType
from typing import Any, NamedTuple, get_type_hints

from firmware_py.builds.c99.scopes import count_assignments
from firmware_py.builds.c99.shape import source
from firmware_py.core.config import Config
from firmware_py.interface.generated.parameters import Parameters
from firmware_py.interface.parameter_table import INDEX, TABLE

TABLES = {kind: table for table, kind in get_type_hints(Parameters).items()}


class Interval(NamedTuple):
    low: float
    high: float

    @property
    def is_apart_from_zero(self) -> bool:
        return self.low > 0.0 or self.high < 0.0

    def join(self, other: "Interval") -> "Interval":
        return Interval(min(self.low, other.low), max(self.high, other.high))

    def meet(self, other: "Interval") -> "Interval":
        return Interval(max(self.low, other.low), min(self.high, other.high))


ANY = Interval(-math.inf, math.inf)
ABOVE_ZERO = Interval(math.ulp(0.0), math.inf)


def corners(one: Interval, other: Interval, apply: Any) -> Interval:
    """The interval of an operation that is monotonic in both operands."""
    found = [apply(a, b) for a in one for b in other]
    return ANY if any(map(math.isnan, found)) else Interval(min(found), max(found))


def divide(a: float, b: float) -> float:
    return a / b if b != 0.0 else math.nan


class Prover:
    """The intervals of the expressions in these functions, which call each other."""

    def __init__(self, functions: list[FunctionType], invariants: dict[tuple[str, str], Interval]) -> None:
        self.functions, self.invariants = functions, invariants
        self.known: dict[ast.expr, Interval] = {}
        self.calls: dict[str, list[tuple[FunctionType, ast.Call]]] = {}
        for function in functions:
            for node in ast.walk(source(function)):
                if isinstance(node, ast.Call):
                    name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
                    self.calls.setdefault(name, []).append((function, node))

    def divisors(self) -> Iterator[tuple[FunctionType, ast.expr]]:
        for function in self.functions:
            for node in ast.walk(source(function)):
                operator = getattr(node, "op", None)
                if isinstance(operator, (ast.Div, ast.Mod, ast.FloorDiv)):
                    yield function, node.right if isinstance(node, ast.BinOp) else node.value  # type: ignore[attr-defined]

    def interval(self, function: FunctionType, node: ast.expr) -> Interval:
        """The interval of an expression where it stands; ANY while it is being computed, as in a loop."""
        if node not in self.known:
            self.known[node] = ANY
            found, text = ANY, ast.unparse(node)
            is_steady = not isinstance(node, ast.Name) or count_assignments(source(function))[node.id] < 2
            for test, holds in facts_of(function).get(node, ()) if is_steady else ():
                for one, truth in conjuncts(test, holds):
                    found = found.meet(self.bound(function, text, one, truth))
            evaluate = getattr(self, f"of_{type(node).__name__.lower()}", None)
            self.known[node] = found.meet(evaluate(function, node)) if evaluate else found
        return self.known[node]

    def bound(self, function: FunctionType, text: str, test: ast.expr, holds: bool) -> Interval:
        """What a condition says of the expression with this text; a false comparison also holds for NaN."""
        if not isinstance(test, ast.Compare):
            return ANY
        operands, found = [test.left, *test.comparators], ANY
        for left, operator, right in zip(operands, test.ops, operands[1:], strict=False):
            pairs = ((left, right, type(operator)), (right, left, MIRRORED.get(type(operator))))
            for one, other, kind in pairs:
                if ast.unparse(one) != text or kind is None or (not holds and len(test.ops) > 1):
                    continue
                said, limit = kind if holds else OPPOSITE.get(kind), self.interval(function, other)
                if said in (ast.Gt, ast.GtE):
                    strict = limit.low == 0.0 and said is ast.Gt
                    found = found.meet(ABOVE_ZERO if strict else Interval(limit.low, math.inf))
        return found

    def is_never_zero(self, function: FunctionType, node: ast.expr) -> bool:
        """Whether a divisor is NaN or differs from 0."""
        if self.interval(function, node).is_apart_from_zero:
            return True
        facts = (fact for test, holds in facts_of(function)[node] for fact in conjuncts(test, holds))
        zero = f"{ast.unparse(node)} == 0.0"
        return any(ast.unparse(test) == zero and not holds for test, holds in facts)

    # -- Expressions

    def of_constant(self, function: FunctionType, node: ast.Constant) -> Interval:
        return Interval(node.value, node.value) if isinstance(node.value, (int, float)) else ANY

    def of_unaryop(self, function: FunctionType, node: ast.UnaryOp) -> Interval:
        inner = self.interval(function, node.operand)
        return Interval(-inner.high, -inner.low) if isinstance(node.op, ast.USub) else ANY

    def of_binop(self, function: FunctionType, node: ast.BinOp) -> Interval:
        one, other = (self.interval(function, side) for side in (node.left, node.right))
        if isinstance(node.op, ast.Mult):
            if ast.unparse(node.left) == ast.unparse(node.right):
                one = other = one if one.low >= 0.0 else Interval(0.0, max(abs(one.low), abs(one.high)))
            return corners(one, other, lambda a, b: 0.0 if 0.0 in (a, b) else a * b)
        if isinstance(node.op, ast.Add):
            return Interval(one.low + other.low, one.high + other.high)
        if isinstance(node.op, ast.Sub):
            return Interval(one.low - other.high, one.high - other.low)
        if isinstance(node.op, ast.Div) and other.is_apart_from_zero:
            return corners(one, other, divide)
        if isinstance(node.op, ast.LShift) and one.low > 0:
            return one
        return ANY

    def of_ifexp(self, function: FunctionType, node: ast.IfExp) -> Interval:
        return self.interval(function, node.body).join(self.interval(function, node.orelse))

    def of_call(self, function: FunctionType, node: ast.Call) -> Interval:  # noqa: PLR0911 - a line each
        name = node.func.id if isinstance(node.func, ast.Name) else getattr(node.func, "attr", "")
        given = [self.interval(function, one) for one in node.args]
        if name == "max":
            return Interval(max(one.low for one in given), max(one.high for one in given))
        if name == "min":
            return Interval(min(one.low for one in given), min(one.high for one in given))
        if name == "at_least":
            return Interval(given[1].low, max(given[0].high, given[1].high))
        if name == "abs":
            low = max(given[0].low, -given[0].high, 0.0)
            return Interval(low, max(abs(given[0].low), abs(given[0].high)))
        if name == "sqrt":
            return Interval(math.sqrt(max(given[0].low, 0.0)), math.sqrt(max(given[0].high, 0.0)))
        if name == "round" and given[0].low >= 1.0:
            return Interval(math.floor(given[0].low), math.ceil(given[0].high))
        if name == "float":
            return given[0]
        if name == "clamp":
            return Interval(-max(given[1].high, 0.0), max(given[1].high, 0.0))
        called = next((one for one in self.functions if one.__name__ == name), None)
        if called is None or self.value_of(function, node.func) is not called:
            return ANY
        returned = [one.value for one in ast.walk(source(called)) if isinstance(one, ast.Return)]
        found = [self.interval(called, one) for one in returned if one is not None]
        return functools.reduce(Interval.join, found) if found else ANY

    def value_of(self, function: FunctionType, node: ast.expr) -> Any:
        """The object that a dotted name means."""
        first, *others = ast.unparse(node).split(".")
        return functools.reduce(
            lambda one, name: getattr(one, name, None), others, vars(inspect.getmodule(function)).get(first)
        )

    def broken_invariants(self, initial: Any) -> Iterator[str]:
        """Where a member of a record gets a value outside its invariant, or has one at power-up."""
        for function in self.functions:
            for node in (one for one in ast.walk(source(function)) if isinstance(one, ast.Call)):
                if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
                    kind, given = self.type_of(function, node.func.value), {}
                else:
                    kind = self.value_of(function, node.func)
                    given = dict(zip(getattr(kind, "_fields", ()), node.args, strict=False))
                given |= {one.arg: one.value for one in node.keywords}
                for name, value in given.items():
                    bound = self.invariants.get((getattr(kind, "__name__", ""), name))
                    if bound and (found := self.interval(function, value)).meet(bound) != found:
                        yield f"{function.__name__}: {name}={ast.unparse(value)} in {found}"
        for kind, name, value in members_in(initial):
            bound = self.invariants.get((kind, name))
            if bound and not (math.isnan(value) or bound.low <= value <= bound.high):
                yield f"{kind}.{name} = {value} at power-up"

    def of_name(self, function: FunctionType, node: ast.Name) -> Interval:
        tree, name = source(function), node.id
        stores = [
            one
            for one in ast.walk(tree)
            if isinstance(one, ast.Name) and one.id == name and isinstance(one.ctx, ast.Store)
        ]
        if name in inspect.signature(function).parameters and not stores:
            return self.of_parameter(function, name)
        if not stores:
            value = vars(inspect.getmodule(function)).get(name)
            return Interval(value, value) if isinstance(value, (int, float)) else ANY
        values = list(assigned(tree, name))
        if len(values) != len(stores):
            return ANY
        found = self.interval(function, values[0])
        for one in values[1:]:
            found = found.join(self.interval(function, one))
        return found

    def of_parameter(self, function: FunctionType, name: str) -> Interval:
        places = self.calls.get(function.__name__, [])
        found: Interval | None = None
        for caller, call in places:
            called = vars(inspect.getmodule(caller)).get(ast.unparse(call.func).split(".")[0])
            if called is not function and called is not inspect.getmodule(function):
                continue
            bound = inspect.signature(function).bind(
                *call.args, **{one.arg: one.value for one in call.keywords if one.arg}
            )
            one = self.interval(caller, bound.arguments[name]) if name in bound.arguments else ANY
            found = one if found is None else found.join(one)
        return ANY if found is None else found

    def of_attribute(self, function: FunctionType, node: ast.Attribute) -> Interval:
        kind = self.type_of(function, node.value)
        if kind is not None and (kind.__name__, node.attr) in self.invariants:
            return self.invariants[kind.__name__, node.attr]
        if kind in TABLES:
            entry = TABLE[INDEX[f"{TABLES[kind]}.{node.attr}"]]
            return Interval(entry.low, entry.high)
        if kind is not None and kind.__name__ in ("Config", "Constants", "Nominal", "GateLimits"):
            derive, value = derived(kind, node.attr)
            return self.interval(derive, value) if value else ANY
        base = vars(inspect.getmodule(function)).get(ast.unparse(node.value))
        value = getattr(base, node.attr, None) if inspect.ismodule(base) else None
        return Interval(value, value) if isinstance(value, (int, float)) else ANY

    def type_of(self, function: FunctionType, node: ast.expr) -> Any:
        if isinstance(node, ast.Attribute):
            whole = self.type_of(function, node.value)
            return get_type_hints(whole).get(node.attr) if hasattr(whole, "_fields") else None
        if isinstance(node, ast.Name):
            values = list(assigned(source(function), node.id))
            return (
                self.type_of(function, values[0])
                if len(values) == 1
                else get_type_hints(function).get(node.id)
            )
        return None


def derived(kind: Any, name: str) -> tuple[FunctionType, ast.expr | None]:
    """The function that derives a block's constants, and the expression of one of them."""
    module = sys.modules[kind.__module__]
    derive: FunctionType = module.config_of if kind is Config else module.derive  # type: ignore[attr-defined]
    for one in (one for one in ast.walk(source(derive)) if isinstance(one, ast.Call)):
        if ast.unparse(one.func) in (kind.__name__, "zeroed"):
            given = dict(zip(kind._fields, one.args, strict=False))
            given |= {keyword.arg: keyword.value for keyword in one.keywords}
            return derive, given.get(name)
    return derive, None


MIRRORED: dict[Any, Any] = {
    ast.Lt: ast.Gt,
    ast.LtE: ast.GtE,
    ast.Gt: ast.Lt,
    ast.GtE: ast.LtE,
    ast.NotEq: ast.NotEq,
}
OPPOSITE: dict[Any, Any] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
}


def members_in(record: Any) -> Iterator[tuple[str, str, Any]]:
    """Type, name and value of each number in a record and in those that it contains."""
    for name, value in zip(getattr(record, "_fields", ()), record, strict=False):
        if hasattr(value, "_fields"):
            yield from members_in(value)
        elif isinstance(value, (int, float)):
            yield type(record).__name__, name, value


def assigned(tree: ast.FunctionDef, name: str) -> Iterator[ast.expr]:
    """The values that are assigned to a name alone, or as a part of a tuple that is written out."""
    for node in ast.walk(tree):
        for target in node.targets if isinstance(node, ast.Assign) else ():
            if isinstance(target, ast.Name) and target.id == name:
                yield node.value  # type: ignore[attr-defined]
            elif isinstance(target, ast.Tuple):
                for index, one in enumerate(target.elts):
                    if isinstance(one, ast.Name) and one.id == name:
                        value: Any = node.value  # type: ignore[attr-defined]
                        if isinstance(value, ast.Tuple):
                            yield value.elts[index]
                        elif isinstance(value, ast.IfExp) and isinstance(value.body, ast.Tuple):
                            yield value.body.elts[index]


def conjuncts(test: ast.expr, holds: bool) -> Iterator[tuple[ast.expr, bool]]:
    """The conditions that follow from one that holds or not."""
    if isinstance(test, ast.UnaryOp) and isinstance(test.op, ast.Not):
        yield from conjuncts(test.operand, not holds)
    elif isinstance(test, ast.BoolOp) and isinstance(test.op, ast.And if holds else ast.Or):
        for one in test.values:
            yield from conjuncts(one, holds)
    else:
        yield test, holds


Facts = tuple[tuple[ast.expr, bool], ...]
"""Conditions, each with whether it holds."""


@functools.cache
def facts_of(function: FunctionType) -> dict[ast.AST, Facts]:
    """The conditions under which each expression of a function is evaluated."""
    found: dict[ast.AST, Facts] = {}

    def visit(node: ast.AST, facts: Facts) -> None:
        found[node] = facts
        if isinstance(node, (ast.If, ast.While, ast.IfExp)):
            visit(node.test, facts)
            for part, holds in ((node.body, True), (getattr(node, "orelse", []), False)):
                visit_block(part if isinstance(part, list) else [part], (*facts, (node.test, holds)))
        elif isinstance(node, ast.BoolOp):
            for index, value in enumerate(node.values):
                holds = isinstance(node.op, ast.And)
                visit(value, (*facts, *((before, holds) for before in node.values[:index])))
        else:
            for _, part in ast.iter_fields(node):
                if isinstance(part, list):
                    visit_block([one for one in part if isinstance(one, ast.AST)], facts)
                elif isinstance(part, ast.AST):
                    visit(part, facts)

    def visit_block(block: Sequence[ast.AST], facts: Facts) -> None:
        for one in block:
            visit(one, facts)
            if isinstance(one, ast.If) and isinstance(one.body[-1], ast.Return) and not one.orelse:
                facts = (*facts, (one.test, False))

    visit(source(function), ())
    return found
