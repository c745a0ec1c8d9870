"""All kinds of faults: the classes in the files of `hil.faults.kinds`."""

import pkgutil
from importlib import import_module
from typing import TYPE_CHECKING, Annotated, TypeAlias, Union

from pydantic import Field

from hil.faults import kinds
from hil.faults.fault import Fault

PLACES = (
    "On the bus",
    "At the sensors",
    "In the drive and the module",
    "In processes, clocks and memory",
)


def found_kinds() -> tuple[type[Fault], ...]:
    """The classes in `hil.faults.kinds`, by place and kind."""
    modules = [import_module(f"{kinds.__name__}.{one.name}") for one in pkgutil.iter_modules(kinds.__path__)]
    classes = [
        one
        for module in modules
        for one in vars(module).values()
        if isinstance(one, type) and issubclass(one, Fault) and one.__module__ == module.__name__
    ]
    return tuple(sorted(classes, key=lambda one: PLACES.index(one.place)))


KINDS = found_kinds()

if TYPE_CHECKING:
    AnyFault: TypeAlias = Fault
else:
    AnyFault = Annotated[Union[KINDS], Field(discriminator="kind")]  # noqa: UP007 - made of a tuple
