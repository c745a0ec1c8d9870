"""Mutation testing of one module: counts the small changes of its code that no test detects.

    python -m tools.dev.mutation MODULE TEST [TEST…]

Each mutant has one change (a comparison's operator or edge, and/or, a sign, a number, an enumeration's
member, the branches of a conditional expression) and its own forked process, which runs the named tests until
one fails. The unchanged code must pass the tests first: tests that fail anyway, or are not found, would kill
every mutant. mutmut is not used, because it does not mutate decorated functions, such as the plant's kernels.
"""

import argparse
import ast
import faulthandler
import gc
import importlib
import importlib.abc
import importlib.machinery
import importlib.util
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from enum import Enum
from pathlib import Path
from types import CodeType, ModuleType
from typing import NamedTuple

import filterpy.kalman  # noqa: F401 - loaded once, before the forks
import pytest

LONGEST_S = 120
"""Limit of processor time in s: a mutant that takes longer hangs, and so does not survive."""

COMPARISONS: dict[type[ast.cmpop], tuple[type[ast.cmpop], ...]] = {
    ast.Lt: (ast.LtE, ast.GtE),
    ast.LtE: (ast.Lt, ast.Gt),
    ast.Gt: (ast.GtE, ast.LtE),
    ast.GtE: (ast.Gt, ast.Lt),
    ast.Eq: (ast.NotEq,),
    ast.NotEq: (ast.Eq,),
    ast.In: (ast.NotIn,),
    ast.NotIn: (ast.In,),
}
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
}


class Mutant(NamedTuple):
    """One change: its line, the code before and after, and the whole module with the change."""

    line: int
    before: str
    after: str
    code: ast.Module


def changes(node: ast.AST, members: dict[str, list[str]]) -> Iterator[ast.AST]:
    """Every mutation of `node`; `members` has the names of the members of each enumeration."""
    match node:
        case ast.Compare(ops=[operator], left=left, comparators=comparators):
            for other in COMPARISONS.get(type(operator), ()):
                yield ast.Compare(left, [other()], comparators)
        case ast.Compare(ops=operators, left=left, comparators=comparators):
            for k, operator in enumerate(operators):
                for other in COMPARISONS.get(type(operator), ()):
                    yield ast.Compare(left, [*operators[:k], other(), *operators[k + 1 :]], comparators)
        case ast.BoolOp(op=operation, values=values):
            yield ast.BoolOp(ast.Or() if isinstance(operation, ast.And) else ast.And(), values)
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.BinOp(op=operator, left=left, right=right) if type(operator) in ARITHMETIC:
            yield ast.BinOp(left, ARITHMETIC[type(operator)](), right)
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1)
        case ast.IfExp(test=test, body=body, orelse=orelse):
            yield ast.IfExp(test, orelse, body)
        case ast.Attribute(value=ast.Name(id=name)) if name in members:
            others = members[name]
            following = others[(others.index(node.attr) + 1) % len(others)]
            yield ast.Attribute(ast.Name(name, ast.Load()), following, ast.Load())


def mutants(source: str, members: dict[str, list[str]]) -> Iterator[Mutant]:
    """Every mutant of a module's source, in order of its lines."""
    count = len(list(_places(ast.parse(source))))
    for number in range(count):
        parent, field, index, node = list(_places(ast.parse(source)))[number]
        for k in range(len(list(changes(node, members)))):
            tree = ast.parse(source)
            parent, field, index, node = list(_places(tree))[number]
            other = list(changes(node, members))[k]
            before, after = ast.unparse(node), ast.unparse(ast.fix_missing_locations(other))
            if index is None:
                setattr(parent, field, other)
            else:
                getattr(parent, field)[index] = other
            yield Mutant(node.lineno, before, after, ast.fix_missing_locations(tree))


def _places(tree: ast.Module) -> Iterator[tuple[ast.AST, str, int | None, ast.expr]]:
    """Every expression with its parent, field and index, except in annotations and decorators."""
    for parent in ast.walk(tree):
        for field, value in ast.iter_fields(parent):
            if field in ("annotation", "returns", "decorator_list"):
                continue
            if isinstance(value, ast.expr):
                yield parent, field, None, value
            elif isinstance(value, list):
                for index, item in enumerate(value):
                    if isinstance(item, ast.expr):
                        yield parent, field, index, item


def members_of(module: ModuleType) -> dict[str, list[str]]:
    """The enumerations in a module's namespace, and their members."""
    return {
        name: [member.name for member in value]
        for name, value in vars(module).items()
        if isinstance(value, type) and issubclass(value, Enum)
    }


def passes(name: str, code: ast.Module, tests: Sequence[str]) -> bool:
    """Whether the tests pass with `code` as the module; they run in a forked process."""
    compiled = compile(code, name, "exec")  # here, because an error in the child would count as a kill
    faulthandler.cancel_dump_traceback_later()  # it waits for a thread, which a fork does not copy
    child = os.fork()
    if child == 0:
        os._exit(_run_in_child(name, compiled, tests))
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) == pytest.ExitCode.OK


def _run_in_child(name: str, code: CodeType, tests: Sequence[str]) -> int:
    signal.setitimer(signal.ITIMER_PROF, LONGEST_S)
    silent = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silent, 1)
    os.dup2(silent, 2)
    sys.meta_path.insert(0, _Finder(name, code))
    # Import the whole package again: loaded modules refer to the unchanged module.
    for loaded in list(sys.modules):
        if loaded.split(".")[0] == name.split(".", maxsplit=1)[0]:
            del sys.modules[loaded]
    os.environ["PYTEST_DISABLE_PLUGIN_AUTOLOAD"] = "1"
    gc.freeze()  # pytest collects garbage at its end, which would copy all memory that the parent holds
    return int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", *tests]))


class _Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Imports one module with code that differs from its file."""

    def __init__(self, name: str, code: CodeType) -> None:
        self.name, self.code = name, code
        self.origin = getattr(importlib.util.find_spec(name), "origin", None)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The specification of the changed module, with its file; None for other modules."""
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.origin, loader=self)

    def exec_module(self, module: ModuleType) -> None:
        """Run the changed code."""
        exec(self.code, module.__dict__)


def main(name: str, tests: Sequence[str]) -> int:
    """Try all mutants and print the survivors. The exit status is 1 if any survives, 4 for unusable tests."""
    specification = importlib.util.find_spec(name)
    assert specification is not None
    assert specification.origin is not None
    source = Path(specification.origin).read_text()
    if not passes(name, ast.parse(source), tests):
        print(
            f"{name} does not pass {' '.join(tests)} as it is; check the path and mend the tests first",
            file=sys.stderr,
        )
        return int(pytest.ExitCode.USAGE_ERROR)
    everything = list(mutants(source, members_of(importlib.import_module(name))))
    survivors = 0
    for mutant in everything:
        if passes(name, mutant.code, tests):
            survivors += 1
            print(f"{name}:{mutant.line}: {mutant.before}  →  {mutant.after}", flush=True)
    print(f"{name}: {len(everything)} mutants, {survivors} survive")
    return 1 if survivors else 0


if __name__ == "__main__":
    parser = argparse.ArgumentParser(prog="python -m tools.dev.mutation", description=__doc__)
    parser.add_argument("module", metavar="MODULE")
    parser.add_argument("tests", nargs=argparse.REMAINDER, metavar="TEST", help="as pytest takes them")
    asked = parser.parse_args()
    sys.exit(main(asked.module, asked.tests))
