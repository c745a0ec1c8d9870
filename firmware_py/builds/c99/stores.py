"""What a function stores: values, members of records, whole records, and the results of calls.

A record that a call changes is handed over by pointer. It is copied first if another argument points to it or
to a part of it, and copied to its target after the call if that lies elsewhere.
"""

import ast
import inspect
from collections.abc import Mapping
from types import FunctionType
from typing import Any, NamedTuple, get_args, get_origin

from firmware_py.builds.c99.expressions import Address, C, Level, Place, Variable, expression
from firmware_py.builds.c99.lines import Line
from firmware_py.builds.c99.names import is_record
from firmware_py.builds.c99.operations import Operations, is_replace
from firmware_py.builds.c99.shape import refuse, shape
from firmware_py.builds.flat import members


class Passed(NamedTuple):
    """The arguments of a call, and the variables that are copied to their targets after it."""

    arguments: dict[str, C]
    back: list[tuple[Place, C]]


class Stores(Operations):
    """The stores of one function's translation."""

    # -- Records ---------------------------------------------------------------------------------------------

    def declare(self, variable: Variable) -> None:
        """Write a declaration without a value, if it has not been declared."""
        if not variable.is_declared:
            self.lines.append(Line(declares=variable))
            variable.is_declared = True

    def put(self, target: Place | None, value: C) -> None:
        """Write the assignment of a value to a place, which declares a new variable."""
        if target is None:
            self.lines.append(Line(("(void)", *value.within(Level.UNARY), ";")))
            return
        root = target.root
        is_new = not root.is_declared
        if value.place is None or is_new or value.place.resolve() != target.resolve():
            root.kind, root.is_declared = root.kind or value.kind, True
            kind = value.kind if target.path else root.kind
            parts = value.parts if value.level == Level.BRACES and is_new else self.typed(value, kind)
            self.lines.append(
                Line(
                    expression(kind, 0, parts).parts,
                    None if is_new else target,
                    declares=root if is_new else None,
                )
            )

    def store(self, target: Place, node: ast.expr) -> None:
        """Write `target = node`, for records member by member where that saves copies."""
        if isinstance(node, ast.Call):
            called, function = self.value_of(node.func), self.function_of(node)
            if is_replace(node):
                self.replace(target, node)
                return
            if function and (shape(function).in_place or shape(function).outs):
                self.call(node, {0: target})
                return
            if is_record(called):
                self.construct(target, called, node)
                return
        if not (isinstance(node, ast.IfExp) and self.store_choice(target, node)):
            self.put(target, self.expression(node))

    def store_choice(self, target: Place, node: ast.IfExp) -> bool:
        """Write `target = a if test else b` as branches if the values need statements; whether they do."""
        with self.captured() as needed:
            kind = self.expression(node).kind
        if not needed or not is_record(kind):
            return False
        self.declare(target.root)
        test, branches = self.expression(node.test), [node.body, node.orelse]
        same = [isinstance(one, ast.Name) and self.look(one).place == target for one in branches]
        if same[0]:
            branches.reverse()
            same.reverse()
            test = expression(bool, Level.UNARY, "!", test.within(Level.UNARY))
        with self.braces("if (", *test.parts, ")"):
            self.store(target, branches[0])
            if not same[1]:
                self.lines.append(Line(("else",), opens=True, closes=True))
                self.store(target, branches[1])
        return True

    def replace(self, target: Place, node: ast.Call) -> None:
        """Write `target = record._replace(…)`: values that read what is assigned before are read first."""
        replaced: Any = node.func
        base, is_new = self.expression(replaced.value), not target.root.is_declared
        is_same = base.place is not None and not is_new and base.place.resolve() == target.resolve()
        values = {one.arg: self.value_in(base.kind, one.arg, one.value) for one in node.keywords if one.arg}
        whole = C((target,), base.kind)
        for index, (name, value) in enumerate(values.items()):
            earlier = [self.member(whole, one).place for one in list(values)[:index]] if is_same else [target]
            if not is_new and any(one and value.reads(one) for one in earlier):
                values[name] = self.temporary(value, name)
        if not is_same:
            self.put(target, base)
        for name, value in values.items():
            self.put(self.member(whole, name).place, value)

    def value_in(self, record: Any, name: str, node: ast.expr) -> C:
        """The value of a record's member."""
        kind = dict(members(record))[name]
        if get_origin(kind) is not tuple:
            self.hint = name
            value = self.expression(node)
            self.hint = ""
            as_float = kind is float and value.kind is int
            return expression(float, Level.UNARY, self.converted(value, float)) if as_float else value
        if not isinstance(node, ast.Call):
            raise refuse(self.module, node, "wanted a call for a member that is an array")
        held = [Variable(self.fresh(f"{name}_{index}"), item) for index, item in enumerate(get_args(kind))]
        for one in held:
            self.declare(one)
        self.call(node, {index: Place(one) for index, one in enumerate(held)})
        listed = [part for one in held for part in (", ", Place(one))]
        return expression(kind, Level.BRACES, "{", *listed[1:], "}")

    def construct(self, target: Place, kind: Any, node: ast.Call) -> None:
        """Write `target = Record(…)`: by members if these are records in memory, else by an initializer."""
        values = self.given(kind, node)
        parts, is_whole = list(values.values()), len(values) == len(kind._fields)
        has_records = any(is_record(one.kind) and one.place for one in parts)
        reads = any(one.reads(target) for one in parts)
        if target.root.is_declared and has_records and is_whole and not reads:
            for name, value in values.items():
                self.put(self.member(C((target,), kind), name).place, value)
            return
        self.put(target, self.initializer(kind, values))

    # -- Calls -----------------------------------------------------------------------------------------------

    def call(self, node: ast.Call, targets: Mapping[int, Place | None], keeps: int | None = None) -> C | None:
        """Write a call; `targets` of its results. The result `keeps` is returned as an expression instead."""
        function = self.function_of(node)
        if function is None:
            raise refuse(self.module, node, "this call is outside the subset")
        where, name = shape(function), self.unit.call(function)
        given, passed = self.given_arguments(function, node), Passed({}, [])
        for parameter, kind in where.parameters.items():
            if parameter not in where.in_place.values():
                value = self.expression(given[parameter])
                as_kind = expression(kind, Level.CHOICE, self.converted(value, kind))
                passed.arguments[parameter] = self.reference(value, parameter) if is_record(kind) else as_kind
        goals = dict.fromkeys(range(len(where.results))) | dict(targets)
        for index, parameter in where.in_place.items():
            changed = self.changed(goals[index], given[parameter], parameter, where.results[index], passed)
            passed.arguments[parameter] = changed
        for index, out in where.outs.items():
            passed.arguments[out] = self.written(goals[index], out[:-4], where.results[index], passed)
        names = (*where.parameters, *where.outs.values())
        listed = [part for one in names for part in (", ", passed.arguments[one])]
        kind = None if where.value is None else where.results[where.value]
        called, result = expression(kind, Level.PRIMARY, f"{name}(", *listed[1:], ")"), None
        if where.value is None:
            self.lines.append(Line((*called.parts, ";")))
        elif keeps == where.value:
            result = self.temporary(called, "result") if passed.back else called
        else:
            self.put(goals[where.value], called)
        for goal, held in passed.back:
            self.put(goal, held)
        return result

    def given_arguments(self, function: FunctionType, node: ast.Call) -> dict[str, ast.expr]:
        """The arguments by their parameters, with defaults."""
        signature = inspect.signature(function)
        bound = signature.bind(*node.args, **{one.arg: one.value for one in node.keywords if one.arg})
        defaults = ((name, ast.Constant(one.default)) for name, one in signature.parameters.items())
        return {name: ast.copy_location(one, node) for name, one in defaults} | bound.arguments

    def reference(self, value: C, hint: str) -> C:
        """A pointer to a record; a value that is none in memory gets a variable."""
        return C((Address(value.place or self.in_memory(value, hint)),), value.kind)

    def changed(self, goal: Place | None, given: ast.expr, hint: str, kind: Any, passed: Passed) -> C:
        """The pointer to a record that a call changes, which holds what is given to the call."""
        place = goal
        is_there = place is not None and place.root.is_declared and self.look(given).place == place
        for name, one in passed.arguments.items():
            if place is not None and one.reads(place):
                if one.is_pointer:
                    place = None
                elif not is_there:
                    passed.arguments[name] = self.temporary(one, name)
        place = place or self.instead(goal, hint, kind, passed)
        self.store(place, given)
        return C((Address(place, is_written=True),), kind)

    def written(self, goal: Place | None, hint: str, kind: Any, passed: Passed) -> C:
        """The pointer to a further result."""
        is_read = goal and any(one.is_pointer and one.reads(goal) for one in passed.arguments.values())
        if goal is None or is_read:
            place = self.instead(goal, hint if goal else f"unused_{hint}", kind, passed)
        else:
            place = goal
        place.root.kind = place.root.kind or kind
        self.declare(place.root)
        return C((Address(place, is_written=True),), kind)

    def instead(self, goal: Place | None, hint: str, kind: Any, passed: Passed) -> Place:
        """A variable whose content goes to the target after the call."""
        variable = Variable(self.fresh(hint), kind)
        if goal is not None:
            passed.back.append((goal, C((Place(variable),), kind)))
        return Place(variable)
