"""What a function stores: values, members of records, whole records, and the results of calls.

A record that a call changes is handed over by pointer. It is copied first if another argument points to it or
to a part of it, and copied to its target after the call if that lies elsewhere.
"""

import ast
import inspect
from collections.abc import Callable, Mapping
from functools import partial
from types import FunctionType
from typing import Any, NamedTuple, get_args, get_origin

from firmware_py.builds.c99.expressions import (
    BRACES,
    CHOICE,
    PRIMARY,
    UNARY,
    Address,
    C,
    Items,
    Place,
    Variable,
    expression,
)
from firmware_py.builds.c99.lines import Line
from firmware_py.builds.c99.names import is_record
from firmware_py.builds.c99.operations import Operations
from firmware_py.builds.c99.shape import refuse, shape
from firmware_py.builds.flat import members


class Target(NamedTuple):
    """Where a result goes: nowhere, to a place, or to a variable that is declared with it."""

    place: Place | None
    declares: Variable | None = None


class Passed(NamedTuple):
    """The arguments of a call, and the variables that are copied to their targets after it."""

    arguments: dict[str, C]
    back: list[tuple[Target, C]]


TargetOf = Callable[[Any], Target]
"""The target of a result of this type."""


class Stores(Operations):
    """The stores of one function's translation."""

    # -- Records ---------------------------------------------------------------------------------------------

    def fixed(self, place: Place, _: Any) -> Target:
        """A target that exists."""
        return Target(place)

    def put(self, target: Target, value: C) -> None:
        """Write the assignment of a value to a target."""
        if target.place is None:
            self.lines.append(Line(("(void)", *value.within(UNARY), ";")))
        elif value.place is None or target.declares or value.place.resolve() != target.place.resolve():
            kind = target.place.root.kind if not target.place.path else value.kind
            is_bare = value.level == BRACES and target.declares is not None
            parts = value.parts if is_bare else expression(kind, 0, self.typed(value, kind)).parts
            self.lines.append(
                Line(parts, None if target.declares else target.place, declares=target.declares)
            )

    def store(self, place: Place, declares: Variable | None, node: ast.expr) -> None:
        """Write `place = node`, for records member by member where that saves copies."""
        target = Target(place, declares)
        if isinstance(node, ast.Call):
            called, function = self.value_of(node.func), self.function_of(node)
            if isinstance(node.func, ast.Attribute) and node.func.attr == "_replace":
                self.replace(target, node)
                return
            if function and (shape(function).in_place or shape(function).outs):
                self.call(node, {0: lambda _: target})
                return
            if is_record(called):
                self.construct(target, called, node)
                return
        if isinstance(node, ast.IfExp) and self.store_choice(target, node):
            return
        self.put(target, self.expression(node))

    def store_choice(self, target: Target, node: ast.IfExp) -> bool:
        """Write `place = a if test else b` as branches if the values need statements; whether they do."""
        with self.captured() as needed:
            kind = self.expression(node).kind
        if not needed or not is_record(kind) or target.place is None:
            return False
        if target.declares:
            self.lines.append(Line(declares=target.declares))
        test = self.expression(node.test)
        branches = [node.body, node.orelse]
        same = [
            self.look(one).place == target.place if isinstance(one, ast.Name) else False for one in branches
        ]
        if same[0]:
            branches.reverse()
            same.reverse()
            test = expression(bool, UNARY, "!", test.within(UNARY))
        self.lines.append(Line(("if (", *test.parts, ")"), opens=True))
        self.store(target.place, None, branches[0])
        if not same[1]:
            self.lines.append(Line(("else",), opens=True, closes=True))
            self.store(target.place, None, branches[1])
        self.lines.append(Line(closes=True))
        return True

    def replace(self, target: Target, node: ast.Call) -> None:
        """Write `place = record._replace(…)`: a value that reads what is assigned before it is read first."""
        if not isinstance(node.func, ast.Attribute) or target.place is None:
            raise refuse(self.module, node, "wanted a record to replace members of")
        place = target.place
        base = self.expression(node.func.value)
        is_same = base.place is not None and not target.declares and base.place.resolve() == place.resolve()
        named = {one.arg: one.value for one in node.keywords if one.arg}
        values = {name: self.value_in(base.kind, name, one) for name, one in named.items()}
        whole = C((place,), base.kind)
        for index, (name, value) in enumerate(values.items()):
            earlier = [self.member(whole, one).place for one in list(values)[:index]] if is_same else [place]
            if (
                not target.declares
                and isinstance(value, C)
                and any(one and value.reads(one) for one in earlier)
            ):
                values[name] = self.temporary(value, name)
        if not is_same:
            self.put(target, base)
        for name, value in values.items():
            self.set_member(self.member(whole, name), value)

    def set_member(self, member: C, value: C | Items) -> None:
        """Write the assignment of a record's member."""
        if isinstance(value, Items):
            for index, one in enumerate(value.items):
                self.put(Target(self.item(member, C((str(index),), int)).place), one)
            return
        if value.kind is int and member.kind is float:
            value = expression(float, UNARY, self.converted(value, float))
        self.put(Target(member.place), value)

    def value_in(self, record: Any, name: str, node: ast.expr) -> C | Items:
        """The value of a record's member."""
        kind = dict(members(record))[name]
        if get_origin(kind) is not tuple:
            self.hint = name
            value = self.expression(node)
            self.hint = ""
            return value
        if isinstance(node, ast.Tuple):
            return Items([self.expression(one) for one in node.elts], kind)
        if not isinstance(node, ast.Call):
            raise refuse(self.module, node, "wanted a tuple or a call for a member that is an array")
        held = [Variable(self.fresh(f"{name}_{index}"), item) for index, item in enumerate(get_args(kind))]
        self.lines += [Line(declares=one) for one in held]
        self.call(node, {index: partial(self.fixed, Place(one)) for index, one in enumerate(held)})
        return Items([C((Place(one),), one.kind) for one in held], kind)

    def construct(self, target: Target, kind: Any, node: ast.Call) -> None:
        """Write `place = Record(…)`: by members if these are records in memory, else by an initializer."""
        values = {name: self.value_in(kind, name, one) for name, one in self.given(kind, node).items()}
        place, parts = target.place, [one for one in values.values() if isinstance(one, C)]
        has_records = any(is_record(one.kind) and one.place for one in parts)
        is_whole = len(values) == len(kind._fields)
        if (
            place
            and not target.declares
            and has_records
            and is_whole
            and not any(one.reads(place) for one in parts)
        ):
            for name, value in values.items():
                self.set_member(self.member(C((place,), kind), name), value)
            return
        self.unit.c_type(kind)
        self.put(target, self.initializer(kind, values))

    # -- Calls -----------------------------------------------------------------------------------------------

    def call(self, node: ast.Call, targets: Mapping[int, TargetOf], keeps: int | None = None) -> C | None:
        """Write a call; `targets` of its results. The result `keeps` is returned as an expression instead."""
        function = self.function_of(node)
        if function is None:
            raise refuse(self.module, node, "this call is outside the subset")
        where, name = shape(function), self.unit.call(function)
        given, passed = self.given_arguments(function, node), Passed({}, [])
        for parameter, kind in where.parameters.items():
            if parameter not in where.in_place.values():
                value = self.expression(given[parameter])
                as_kind = expression(kind, CHOICE, self.converted(value, kind))
                passed.arguments[parameter] = self.reference(value, parameter) if is_record(kind) else as_kind
        goals = [
            targets[k](kind) if k in targets else Target(None)
            for k, kind in enumerate(where.results)
            if k != where.value
        ]
        goals.insert(len(goals) if where.value is None else where.value, Target(None))
        for index, parameter in where.in_place.items():
            passed.arguments[parameter] = self.changed(
                goals[index], given[parameter], parameter, where.results[index], passed
            )
        for index, out in where.outs.items():
            passed.arguments[out] = self.written(
                goals[index], out.removesuffix("_out"), where.results[index], passed
            )
        listed = [
            part
            for one in (*where.parameters, *where.outs.values())
            for part in (", ", passed.arguments[one])
        ]
        kind = None if where.value is None else where.results[where.value]
        called, result = expression(kind, PRIMARY, f"{name}(", *listed[1:], ")"), None
        if where.value is None:
            self.lines.append(Line((*called.parts, ";")))
        elif keeps == where.value:
            result = self.temporary(called, "result") if passed.back else called
        else:
            self.put(targets[where.value](kind) if where.value in targets else Target(None), called)
        for goal, held in passed.back:
            self.put(goal, held)
        return result

    def given_arguments(self, function: FunctionType, node: ast.Call) -> dict[str, ast.expr]:
        """The arguments by their parameters, with defaults."""
        signature = inspect.signature(function)
        bound = signature.bind(*node.args, **{one.arg: one.value for one in node.keywords if one.arg})
        defaults = {
            name: ast.copy_location(ast.Constant(one.default), node)
            for name, one in signature.parameters.items()
        }
        return defaults | bound.arguments

    def reference(self, value: C, hint: str) -> C:
        """A pointer to a record; a value that is none in memory gets a variable."""
        return C((Address(value.place or self.in_memory(value, hint)),), value.kind)

    def changed(self, goal: Target, given: ast.expr, hint: str, kind: Any, passed: Passed) -> C:
        """The pointer to a record that a call changes, which holds what is given to the call."""
        place = goal.place
        is_there = place is not None and not goal.declares and self.look(given).place == place
        for name, one in passed.arguments.items():
            if place is not None and one.reads(place):
                if one.is_pointer:
                    place = None
                elif not is_there:
                    passed.arguments[name] = self.temporary(one, name)
        if place is None:
            variable = Variable(self.fresh(hint), kind)
            self.store(Place(variable), variable, given)
            return self.pointer(goal, variable, passed)
        self.store(place, goal.declares, given)
        return C((Address(place, is_written=True),), kind)

    def written(self, goal: Target, hint: str, kind: Any, passed: Passed) -> C:
        """The pointer to a further result."""
        is_read = goal.place and any(
            one.is_pointer and one.reads(goal.place) for one in passed.arguments.values()
        )
        if goal.place is None or is_read:
            variable = Variable(self.fresh(hint if goal.place else f"unused_{hint}"), kind)
            self.lines.append(Line(declares=variable))
            return self.pointer(goal, variable, passed)
        if goal.declares:
            self.lines.append(Line(declares=goal.declares))
        return C((Address(goal.place, is_written=True),), kind)

    def pointer(self, goal: Target, variable: Variable, passed: Passed) -> C:
        """The pointer to a variable whose content goes to the target after the call."""
        if goal.place is not None:
            passed.back.append((goal, C((Place(variable),), variable.kind)))
        return C((Address(Place(variable), is_written=True),), variable.kind)
