"""What a function is in C: its syntax tree, its parameters and results, and its name."""

import ast
import functools
import importlib
import inspect
import io
import sys
import tokenize
from enum import IntEnum
from itertools import pairwise
from types import FunctionType, ModuleType
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

from firmware_py.builds.c99.names import is_record, snake
from firmware_py.core.estimation import kalman
from firmware_py.node.tick import NodeState

INSTEAD: dict[Any, Any] = {
    kalman.predict: kalman.predict_written_out,
    kalman.update: kalman.update_written_out,
}
"""Functions that compiled builds replace by others."""
NOT_FOR_READERS = ("noqa", "type:", "fmt:")
"""Comments for tools."""


class UntranslatableError(TypeError):
    """A construct that the emitter cannot translate; the message begins with file and line."""


class Shape(NamedTuple):
    """How a function passes its parameters and results.

    `in_place`: indices of the results that change a parameter, a record of the same type, and that parameter.
    `value`: index of the result that is returned; `outs`: those that are written through pointers.
    """

    parameters: dict[str, Any]
    results: tuple[Any, ...]
    in_place: dict[int, str]
    value: int | None
    outs: dict[int, str]


def refuse(module: ModuleType | str, node: ast.AST, reason: str) -> UntranslatableError:
    """The error for a construct."""
    name = module if isinstance(module, str) else module.__name__
    file = inspect.getsourcefile(sys.modules[name])
    return UntranslatableError(f"{file}:{getattr(node, 'lineno', 0)}: {reason}: {ast.unparse(node)}")


def short(module: str) -> str:
    """A module's name without its package."""
    return module.rpartition(".")[2]


def function_name(function: FunctionType) -> str:
    """A function's name in C."""
    return f"{short(function.__module__)}_{function.__name__.lstrip('_')}"


@functools.cache
def tree_of(module: str) -> ast.Module:
    """A module's syntax tree."""
    return ast.parse(inspect.getsource(sys.modules[module]))


@functools.cache
def source(function: FunctionType) -> ast.FunctionDef:
    """A function's syntax tree."""
    found = (one for one in tree_of(function.__module__).body if isinstance(one, ast.FunctionDef))
    return next(one for one in found if one.name == function.__name__)


@functools.cache
def comments(module: str) -> dict[int, str]:
    """A module's comments by their first lines."""
    lines = io.StringIO(inspect.getsource(sys.modules[module])).readline
    found = (one for one in tokenize.generate_tokens(lines) if one.type == tokenize.COMMENT)
    texts: dict[int, str] = {}
    first = last = -1
    for one in found:
        line, text = one.start[0], one.string[1:].strip()
        if text.startswith(NOT_FOR_READERS):
            continue
        first = first if line == last + 1 and not one.line[: one.start[1]].strip() else line
        texts[first] = f"{texts[first]} {text}" if first in texts else text
        last = line
    return texts


@functools.cache
def documents(module: str) -> dict[str, str]:
    """The docstrings of a module's constants."""
    found, body = {}, tree_of(module).body
    for one, behind in pairwise(body):
        document = behind.value if isinstance(behind, ast.Expr) else None
        if isinstance(one, ast.Assign) and isinstance(document, ast.Constant):
            names = [node.id for node in ast.walk(one.targets[0]) if isinstance(node, ast.Name)]
            found[names[0]] = str(document.value)  # of several names the first one carries the docstring
    return found


@functools.cache
def origin(module: ModuleType, name: str) -> tuple[ModuleType, str]:
    """The module and the name under which a global name was defined."""
    for node in ast.walk(tree_of(module.__name__)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("firmware_py"):
            for alias in node.names:
                if (alias.asname or alias.name) == name:
                    return origin(importlib.import_module(node.module or ""), alias.name)
    return module, name


@functools.cache
def shape(function: FunctionType) -> Shape:
    """How a function passes its parameters and results."""
    function = INSTEAD.get(function, function)
    hints = get_type_hints(function)
    kinds = {name: hints[name] for name in inspect.signature(function).parameters}
    kinds = {name: NodeState if kind in (object, Any) else kind for name, kind in kinds.items()}
    returned = hints["return"]
    listed = get_args(returned) if get_origin(returned) is tuple else (returned,)
    results = tuple(one for one in listed if one not in (Ellipsis, type(None)))
    in_place: dict[int, str] = {}
    for index, kind in enumerate(results):
        free = [name for name, other in kinds.items() if other is kind and name not in in_place.values()]
        if is_record(kind) and free:
            in_place[index] = free[0]
    others = [index for index in range(len(results)) if index not in in_place]
    outs: dict[int, str] = {}
    for index in others[1:]:
        name = result_name(function, index, results[index])
        outs[index] = f"{name}{index}_out" if f"{name}_out" in outs.values() else f"{name}_out"
    return Shape(kinds, results, in_place, others[0] if others else None, outs)


def result_name(function: FunctionType, index: int, kind: Any) -> str:
    """The name of a result: that of a variable which is returned as it, else that of its type."""
    for one in ast.walk(source(function)):
        if isinstance(one, ast.Return) and isinstance(one.value, ast.Tuple):
            element = one.value.elts[index]
            if isinstance(element, ast.Name):
                return element.id
            if isinstance(element, ast.Attribute) and not element.attr.isupper():
                return element.attr
    return snake(kind.__name__) if is_record(kind) or issubclass(kind, IntEnum) else "result"
