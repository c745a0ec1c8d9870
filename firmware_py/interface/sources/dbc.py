"""`vibro.dbc`, read by cantools: the only source of identifiers, scaling, units, ranges and periods."""

from functools import cache
from importlib.resources import files
from typing import cast

import cantools.database
from cantools.database.can import Database


@cache
def database() -> Database:
    """Read the bus description; once per process."""
    text = files("firmware_py.interface").joinpath("vibro.dbc").read_text(encoding="ascii")
    return cast(Database, cantools.database.load_string(text, database_format="dbc"))
