"""The expressions of a user's own figures: numbers, signals, operators and calls of listed functions.

    expression  number | pi | signal | function(expression) | (expression)
                | + - expression | expression + - * / // % ** expression | expression < <= > >= expression
    signal      dotted name, such as plant.omega_rad_s

A scenario, and so its expressions, may come from somebody else: no other form of Python is evaluated, and
nothing is evaluated before the whole expression is known to be of these forms. All numbers are floats and all
arrays have the length of the signals, so that powers overflow to infinity and no expression outgrows the run.
"""

import ast
import math
import operator
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from plant_sim.validation_messages import nearest

Signal = NDArray[np.float64]
Names = Mapping[str, Sequence[str]]
"""The names of the signals by trace."""
Read = Callable[[str, str], Signal]
"""Reads a signal, by trace and name; all have one length."""

MOST_CHARACTERS: Final = 1_000
MOST_NESTED: Final = 100
"""Operations within one another; a sum of n numbers counts n."""

UNARY: Final[Mapping[type[ast.unaryop], Callable[[Any], Any]]] = {
    ast.UAdd: operator.pos,
    ast.USub: operator.neg,
}


def make_comparison(compare: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """A comparison that gives 1 or 0, and NaN where one side is NaN: what is not known meets no limit."""

    def known(first: Any, second: Any) -> Any:
        unknown = np.isnan(first) | np.isnan(second)
        return np.where(unknown, np.nan, compare(first, second))[()]

    return known


BINARY: Final[Mapping[type[ast.operator | ast.cmpop], Callable[[Any, Any], Any]]] = {
    ast.Add: np.add,
    ast.Sub: np.subtract,
    ast.Mult: np.multiply,
    ast.Div: np.divide,
    ast.FloorDiv: np.floor_divide,
    ast.Mod: np.mod,
    ast.Pow: np.power,
    ast.Lt: make_comparison(np.less),
    ast.LtE: make_comparison(np.less_equal),
    ast.Gt: make_comparison(np.greater),
    ast.GtE: make_comparison(np.greater_equal),
}
FORMS: Final = (
    "numbers, pi, signals, + - * / // % **, < <= > >=, and calls of functions of one signal or number"
)


class ExpressionError(ValueError):
    """An expression cannot be evaluated; the message says why."""


@dataclass(frozen=True)
class Expression:
    """An expression and the meaning of its names."""

    text: str
    names: Names
    read: Read
    reducers: Mapping[str, Callable[[Signal], float]]
    """Functions from a signal to a number."""
    elementwise: Mapping[str, Callable[[Any], Any]]
    """Functions of a signal or a number, to the same."""

    def evaluate(self) -> float:
        """The number that the expression gives; raises ExpressionError."""
        value = self.over_time()
        if np.ndim(value) != 0:
            functions = ", ".join(self.reducers)
            raise ExpressionError(f"{self.text!r} is a signal; make a number of it, by {functions}")
        return float(value)

    def over_time(self) -> Signal:
        """The value at each instant of the signals, or a number without one; raises ExpressionError."""
        value_of_all = self._translate(self._parse())
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            return np.asarray(value_of_all())

    def _error(self, why: str) -> ExpressionError:
        return ExpressionError(f"{self.text[:MOST_CHARACTERS]!r} cannot be worked out: {why}")

    def _parse(self) -> ast.expr:
        if len(self.text) > MOST_CHARACTERS:
            raise self._error(f"it has {len(self.text)} characters; wanted {MOST_CHARACTERS} at most")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return ast.parse(self.text.strip(), mode="eval").body
        except SyntaxError as error:
            raise self._error(error.msg) from None
        except (ValueError, MemoryError, RecursionError) as error:  # null bytes; too deep for Python's parser
            raise self._error(f"Python cannot read it ({error})") from None

    def _translate(self, node: ast.expr, nested: int = 0) -> Callable[[], Any]:
        """A function that gives the node's value: a float of numpy, or an array of them.

        Raises ExpressionError if the node has another form than those listed, or an unknown name.
        """
        if nested > MOST_NESTED:
            raise self._error(f"more than {MOST_NESTED} operations within one another; write it shorter")
        match node:
            case ast.Constant(value=int() | float() as number) if not isinstance(number, bool):
                return partial(_as_float, number)
            case ast.Name(id="pi"):
                return partial(np.float64, math.pi)
            case ast.Name() | ast.Attribute():
                return partial(self.read, *self._signal(node))
            case ast.UnaryOp(op=sign, operand=operand) if type(sign) in UNARY:
                change, inner = UNARY[type(sign)], self._translate(operand, nested + 1)
                return lambda: change(inner())
            case (
                ast.BinOp(left=left, op=operation, right=right)
                | ast.Compare(left=left, ops=[operation], comparators=[right])
            ) if type(operation) in BINARY:
                joined, first, second = (
                    BINARY[type(operation)],
                    self._translate(left, nested + 1),
                    self._translate(right, nested + 1),
                )
                return lambda: np.float64(1.0) * joined(first(), second())
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]):
                if name not in (known := [*self.reducers, *self.elementwise]):
                    raise self._error(f"{name!r} is not defined; functions are {', '.join(known)}")
                return partial(self._call, name, self._translate(argument, nested + 1))
            case _:
                part = ast.get_source_segment(self.text.strip(), node) or type(node).__name__
                raise self._error(f"{part!r} is not allowed; wanted {FORMS}")

    def _call(self, name: str, argument_of: Callable[[], Any]) -> Any:
        argument = argument_of()
        if name in self.elementwise:
            return self.elementwise[name](argument)
        if np.ndim(argument) != 1:
            raise self._error(f"{name} is a function of a signal; got a number")
        try:
            return np.float64(self.reducers[name](argument))
        except (ArithmeticError, IndexError, ValueError) as error:
            raise self._error(f"{name} finds no figure in the signal ({error})") from error

    def _signal(self, node: ast.expr) -> tuple[str, str]:
        """The trace of a signal and its name within it; raises ExpressionError if there is none."""
        names: list[str] = []
        inner = node
        while isinstance(inner, ast.Attribute):
            names.insert(0, inner.attr)
            inner = inner.value
        if not isinstance(inner, ast.Name):
            raise self._error(f"a dot only stands in the name of a signal; wanted {FORMS}")
        trace, name = inner.id, ".".join(names)
        if trace not in self.names:
            raise self._error(f"{trace!r} is not defined; signals begin with {', '.join(self.names)}")
        if name in self.names[trace]:
            return trace, name
        listing = f"`vibrohil inspect RUN --table {trace}` lists its signals"
        raise self._error(
            f"no signal {'.'.join([trace, *names])}; {nearest(name, self.names[trace], listing)}"
        )


def _as_float(value: int | float) -> np.float64:
    try:
        return np.float64(float(value))
    except OverflowError:
        return np.float64(math.inf)
