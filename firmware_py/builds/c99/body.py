"""The translation of one function: its statements, calls and records.

A record that a function takes and returns changed is passed by pointer and changed in place; of the other
results the first is returned and the rest go to pointers named `…_out`. Before a call, a record that is about
to change is copied if another argument points to it or to a part of it.
"""

import ast
from types import FunctionType
from typing import Any, get_args, get_origin

from firmware_py.builds.c99.expressions import Address, C, Level, Place, Variable, expression
from firmware_py.builds.c99.lines import Line, remove_copies, render, wrap
from firmware_py.builds.c99.names import c_identifier, first_paragraph, is_record, snake
from firmware_py.builds.c99.operations import BINARY, FALSE, TRUE
from firmware_py.builds.c99.scopes import beginnings, count_assignments
from firmware_py.builds.c99.shape import comments, function_name, refuse, shape, source
from firmware_py.builds.c99.stores import Stores


class Body(Stores):
    """The translation of one function."""

    def __init__(self, unit: Any, function: FunctionType) -> None:
        super().__init__(unit, function, source(function))
        self.shape = shape(function)
        self.counts = count_assignments(self.tree)
        self.begins = beginnings(self.tree, set(self.counts) - set(self.shape.parameters) - {"_"})
        self.pending = sorted(line for line in comments(function.__module__) if line >= self.tree.lineno)
        self.outs = {
            index: Variable(name, self.shape.results[index], is_pointer=True, is_declared=True)
            for index, name in self.shape.outs.items()
        }
        self.copied: list[str] = []
        """Parameters that are records and are assigned; they are copied first."""
        changed = self.shape.in_place.values()
        for name, kind in self.shape.parameters.items():
            is_pointer = is_record(kind)
            variable = Variable(c_identifier(name), kind, is_pointer, is_declared=True)
            if is_pointer and name in self.counts and name not in changed:
                self.copied.append(name)
                variable.is_pointer = False
                given = Variable(f"{variable.name}_in", kind, is_pointer=True, is_declared=True)
                self.lines.append(Line((Place(given),), declares=variable))
            self.variables[name] = variable

    # -- The whole -------------------------------------------------------------------------------------------

    def head(self) -> str:
        """The function's declaration."""
        where, parts = self.shape, []
        for name, kind in where.parameters.items():
            own = f"{self.variables[name].name}{'_in' if name in self.copied else ''}"
            if kind == list[int]:
                parts.append(f"int64_t *{own}")
            elif is_record(kind):
                const = "" if name in where.in_place.values() else "const "
                parts.append(f"{const}{self.unit.c_type(kind)} *{own}")
            else:
                parts.append(f"{self.unit.c_type(kind)} {own}".replace("* ", "*"))
        parts += [f"{self.unit.c_type(one.kind)} *{one.name}" for one in self.outs.values()]
        result = "void" if where.value is None else self.unit.c_type(where.results[where.value])
        return f"static {result} {function_name(self.function)}({', '.join(parts) or 'void'})"

    def translate(self) -> tuple[str, str]:
        """The function's declaration and its whole text."""
        head = self.head()
        self.block(self.tree.body)
        if self.lines[-1].parts == ("return;",):
            self.lines.pop()
        lines = remove_copies(self.lines)
        used = {place.resolve(True).root for line in lines for place in (*line.touched(), *line.written())}
        given = (self.variables[name] for name in self.shape.parameters)
        lines = [*(Line((f"(void){one.name};",)) for one in given if one not in used), *lines]
        body = render(lines, self.unit.c_type)
        above = first_paragraph(ast.get_docstring(self.tree))
        begin = "\n".join([*(wrap(above) if above else []), *wrap(f"{head} {{")])
        return head, f"{begin}\n{body}\n}}\n"

    def block(self, body: list[ast.stmt]) -> bool:
        """Write statements; whether the function returns among them by a condition that is known here."""
        for statement in body:
            while self.pending and self.pending[0] <= statement.lineno:
                text = comments(self.function.__module__)[self.pending.pop(0)]
                self.lines.append(Line((f"/* {text} */",)))
            targets = [getattr(statement, "target", None), *getattr(statement, "targets", [])]
            own = {node.id for one in targets if one for node in ast.walk(one) if isinstance(node, ast.Name)}
            for name in self.begins.get(id(statement), ()):
                self.variables[name] = Variable(c_identifier(name))
                if name not in own:
                    self.declare(self.variables[name])
            write = getattr(self, f"do_{snake(type(statement).__name__)}", None)
            if write is None:
                raise refuse(self.module, statement, "this statement is outside the subset")
            if write(statement):
                return True
        return False

    def nested(self, body: list[ast.stmt]) -> None:
        """Write the statements of a block, whose temporary variables end with it."""
        names = set(self.names)
        self.block(body)
        self.names = names

    # -- Statements ------------------------------------------------------------------------------------------

    def do_pass(self, node: ast.Pass) -> None:
        """Nothing."""

    def do_expr(self, node: ast.Expr) -> None:
        """A call without a result; docstrings are left out."""
        if isinstance(node.value, ast.Call):
            self.call(node.value, {})

    def do_assign(self, node: ast.Assign) -> None:
        """An assignment."""
        for target in node.targets:
            self.assign(target, node.value)

    def assign(self, target: ast.expr, value: ast.expr) -> None:
        """Write the assignment of a value to a name, an element or a tuple of them."""
        if isinstance(value, ast.IfExp) and isinstance(target, ast.Tuple):
            halves: Any = value.body, value.orelse
            sides = zip(*(one.elts for one in halves), strict=True)
            value = ast.Tuple([ast.copy_location(ast.IfExp(value.test, *side), value) for side in sides])
        if not isinstance(target, ast.Tuple):
            goal = self.target(target)
            if goal is not None and not self.point(target, value):
                self.store(goal, value)
        elif isinstance(value, ast.Tuple):
            self.assign_each(target.elts, value.elts)
        elif self.function_of(value) and isinstance(value, ast.Call):
            self.call(value, {index: self.target(one) for index, one in enumerate(target.elts)})
        else:
            whole = self.expression(value)
            for index, one in enumerate(target.elts):
                if not (isinstance(one, ast.Name) and one.id == "_"):
                    part = self.item(whole, C((str(index),), int))
                    self.put(self.target(one), part)

    def assign_each(self, targets: list[ast.expr], values: list[ast.expr]) -> None:
        """Write `a, b = x, y`; all values are read first where a later one reads an earlier target."""
        with self.captured():
            places = [
                place if (place := self.target(one)) and place.root.is_declared else None for one in targets
            ]
            clashes = any(
                place is not None and any(self.look(later).reads(place) for later in values[index + 1 :])
                for index, place in enumerate(places)
            )
        if not clashes:
            for one, part in zip(targets, values, strict=True):
                self.assign(one, part)
            return
        hints = [one.id if isinstance(one, ast.Name) else "value" for one in targets]
        held = [self.temporary(self.expression(one), hint) for one, hint in zip(values, hints, strict=True)]
        for one, value in zip(targets, held, strict=True):
            self.put(self.target(one), value)

    def target(self, node: ast.expr) -> Place | None:
        """The place that an assignment changes; none for the name `_`."""
        if isinstance(node, ast.Name):
            return None if node.id == "_" else Place(self.variables[node.id])
        return self.expression(node).place

    def point(self, target: ast.expr, value: ast.expr) -> bool:
        """Write a pointer for a name that means a part of a record which this function does not change."""
        variable = self.variables.get(target.id) if isinstance(target, ast.Name) else None
        if variable is None or variable.is_declared or not isinstance(value, (ast.Attribute, ast.Name)):
            return False
        found = self.look(value)
        if not is_record(found.kind) or found.place is None or self.counts[variable.name.rstrip("_")] != 1:
            return False
        root = found.place.resolve(True).root
        changed = [*(self.variables[name] for name in self.shape.in_place.values()), *self.outs.values()]
        if not root.is_pointer or root in changed:
            return False
        variable.kind, variable.is_pointer, variable.points_to = found.kind, True, found.place
        variable.is_declared = True
        self.lines.append(Line((Address(found.place),), declares=variable))
        return True

    def do_aug_assign(self, node: ast.AugAssign) -> None:
        """An assignment such as `+=`."""
        place, value = self.expression(node.target), self.expression(node.value)
        if type(node.op) not in BINARY or place.place is None:
            raise refuse(self.module, node, "this assignment is outside the subset")
        parts = expression(place.kind, 0, self.converted(value, place.kind)).parts
        self.lines.append(Line(parts, place.place, f"{BINARY[type(node.op)][0]}="))

    def do_return(self, node: ast.Return) -> None:
        """The end of the function: results that change parameters are stored first."""
        where, value = self.shape, node.value
        if value is None:
            self.leave(None)
            return
        hands_on = self.function_of(value) and (len(where.results) > 1 or where.in_place)
        if hands_on and isinstance(value, ast.Call):
            goals = {index: Place(one) for index, one in self.outs.items()}
            goals |= {index: Place(self.variables[name]) for index, name in where.in_place.items()}
            self.leave(self.call(value, goals, keeps=where.value))
            return
        parts = value.elts if isinstance(value, ast.Tuple) else [value]
        changed = {
            self.variables[name]: parts[index]
            for index, name in where.in_place.items()
            if not (isinstance(one := parts[index], ast.Name) and one.id == name)
        }
        result = self.expression(parts[where.value]) if where.value is not None else None
        if result is not None and any(result.reads(Place(one)) for one in changed):
            result = self.temporary(result, "result")
        for index, out in self.outs.items():
            self.store(Place(out), parts[index])
        for done, variable in enumerate(changed):
            if any(self.look(changed[variable]).reads(Place(one)) for one in list(changed)[:done]):
                raise refuse(self.module, node, "a result reads a record that an earlier one has changed")
            self.store(Place(variable), changed[variable])
        self.leave(result)

    def leave(self, result: C | None) -> None:
        """Write the end of the function."""
        if result is None or self.shape.value is None:
            self.lines.append(Line(("return;",), is_return=True))
        else:
            parts = expression(result.kind, 0, self.typed(result, self.shape.results[self.shape.value])).parts
            self.lines.append(Line(("return ", *parts, ";"), is_return=True))

    def do_if(self, node: ast.If) -> bool:
        """A branch; whether it surely returns, if its condition is known here."""
        test = self.expression(node.test)
        if test in (TRUE, FALSE):
            chosen = node.body if test == TRUE else node.orelse
            return self.block(chosen) or (bool(chosen) and isinstance(chosen[-1], ast.Return))
        self.lines.append(Line(("if (", *test.parts, ")"), opens=True))
        self.nested(node.body)
        while len(node.orelse) == 1 and isinstance(inner := node.orelse[0], ast.If):
            if id(inner) in self.begins:
                break
            with self.captured() as needed:
                test = self.expression(inner.test)
            if needed or test in (TRUE, FALSE):
                break
            node = inner
            self.lines.append(Line(("else if (", *test.parts, ")"), opens=True, closes=True))
            self.nested(node.body)
        if node.orelse:
            self.lines.append(Line(("else",), opens=True, closes=True))
            self.nested(node.orelse)
        self.lines.append(Line(closes=True))
        return False

    def do_while(self, node: ast.While) -> None:
        """A loop with a condition."""
        with self.captured() as needed:
            test = self.expression(node.test)
        if needed:
            raise refuse(self.module, node, "the condition of this loop needs statements of its own")
        with self.braces("while (", *test.parts, ")"):
            self.block(node.body)

    def do_for(self, node: ast.For) -> None:
        """A loop over a range, or over a tuple that is written out."""
        if not isinstance(node.target, ast.Name) or node.orelse:
            raise refuse(self.module, node, "this loop is outside the subset")
        name = node.target.id
        variable = Variable("count" if name == "_" else c_identifier(name), int, is_declared=True)
        own = variable.name
        if isinstance(node.iter, ast.Tuple):
            items = [self.expression(one) for one in node.iter.elts]
            choices, at = self.fresh(f"{own}_choices"), self.fresh("at")
            listed = [part for one in items for part in (", ", *one.parts)][1:]
            self.lines.append(Line((f"const int64_t {choices}[] = {{", *listed, "};")))
            self.lines.append(Line((f"for (int {at} = 0; {at} < {len(items)}; {at}++)",), opens=True))
            variable.kind = items[0].kind
            self.lines.append(Line((f"{choices}[{at}]",), declares=variable))
        elif isinstance(node.iter, ast.Call) and self.value_of(node.iter.func) is range:
            bounds = [self.expression(one) for one in node.iter.args]
            if self.needs_index(node, name):
                self.write_out(node, name, int(bounds[-1].text))
                return
            start = bounds[0].parts if len(bounds) > 1 else ("0",)
            condition = (f"; {own} < ", *bounds[-1].within(Level.ORDER + 1), f"; {own}++)")
            self.lines.append(Line((f"for (int64_t {own} = ", *start, *condition), opens=True))
        else:
            raise refuse(self.module, node.iter, "wanted a range or a tuple to iterate over")
        self.variables[name] = variable
        self.nested(node.body)
        self.lines.append(Line(closes=True))

    def needs_index(self, node: ast.For, name: str) -> bool:
        """Whether a loop variable numbers the members of a record, which C has no index for."""
        subscripts = [one for one in ast.walk(node) if isinstance(one, ast.Subscript)]
        wanted = ast.dump(ast.Name(name, ast.Load()))
        kinds = [self.look(one.value).kind for one in subscripts if ast.dump(one.slice) == wanted]
        return any(
            is_record(kind) or (get_origin(kind) is tuple and len(get_args(kind)) == 1) for kind in kinds
        )

    def write_out(self, node: ast.For, name: str, count: int) -> None:
        """Write the body of a loop once for each value of its variable."""
        begins = any(id(one) in self.begins for one in node.body)
        for index in range(count):
            self.known[name] = index
            if begins:
                self.lines.append(Line(opens=True))
            self.block(node.body)
            if begins:
                self.lines.append(Line(closes=True))
        del self.known[name]
