"""Reading a CAN log of another program, in the format that its name's ending says."""

import logging
from pathlib import Path

from tools.exchange.foreign_blf import read_blf
from tools.exchange.foreign_logs import FORMATS, ForeignLog
from tools.exchange.foreign_text import TEXT_READERS, read_text
from tools.output import BadInputError


def read_log(path: Path, tolerant: bool = False) -> ForeignLog:
    """Read a log in the format given by its name's ending; `BadInputError` if it cannot be read.

    A tolerant reading leaves unreadable lines out, and of a .blf log what follows an error.
    """
    if not path.is_file():
        state = "no file" if path.exists() else "not there"
        raise BadInputError(f"{path} is {state}; wanted {FORMATS}")
    logging.getLogger("can").setLevel(logging.CRITICAL)  # what its readers skip is counted here
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = suffixes[-1:] == [".gz"]
    kind = suffixes[-2] if packed and len(suffixes) > 1 else path.suffix.lower()
    if kind in TEXT_READERS:
        return read_text(path, kind, packed, tolerant)
    if packed:
        raise BadInputError(f"{path}: of packed logs only text is read; wanted {FORMATS}")
    if kind == ".mf4":
        raise BadInputError(
            f"{path}: .mf4 is not imported, because its reader evaluates formulas of the file, and "
            f"such a formula can run any program; convert the log to one of {FORMATS}"
        )
    if kind != ".blf":
        raise BadInputError(f"{path} is no CAN log by its name; wanted {FORMATS}")
    return read_blf(path, tolerant)
