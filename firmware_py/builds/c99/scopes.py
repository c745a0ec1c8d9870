"""Where the local variables of a function begin."""

import ast
from collections import Counter
from collections.abc import Iterator

Chain = list[tuple[int, int, ast.stmt]]
"""The statements that contain a use, from the outermost on: identity of the block, index in it, statement."""


def count_assignments(tree: ast.FunctionDef) -> Counter[str]:
    """How often each name is assigned."""
    stores = (one for one in ast.walk(tree) if isinstance(one, ast.Name) and isinstance(one.ctx, ast.Store))
    return Counter(one.id for one in stores)


def beginnings(tree: ast.FunctionDef, names: set[str]) -> dict[int, list[str]]:
    """The variables that begin before each statement, by its identity: in the innermost block of all uses."""
    found: dict[int, list[str]] = {}
    chains: dict[str, list[Chain]] = {}
    for name, chain in uses(tree.body, []):
        chains.setdefault(name, []).append(chain)
    for name in sorted(names):
        found.setdefault(id(begin_of(chains[name])), []).append(name)
    return found


def uses(block: list[ast.stmt], outer: Chain) -> Iterator[tuple[str, Chain]]:
    """Each use of a name with its chain of statements."""
    for index, statement in enumerate(block):
        here = [*outer, (id(block), index, statement)]
        inner = [getattr(statement, part, []) for part in ("body", "orelse")]
        nested = {id(node) for part in inner for one in part for node in ast.walk(one)}
        for node in ast.walk(statement):
            if isinstance(node, ast.Name) and id(node) not in nested:
                yield node.id, here
        for part in inner:
            yield from uses(part, here)


def begin_of(chains: list[Chain]) -> ast.stmt:
    """The first statement, in the innermost block that contains all these uses, that contains one."""
    depth = 0
    while all(len(one) > depth + 1 and one[depth][:2] == chains[0][depth][:2] for one in chains):
        depth += 1
    depth -= len({one[depth][0] for one in chains}) > 1
    return min((one[depth] for one in chains), key=lambda one: one[1])[2]
