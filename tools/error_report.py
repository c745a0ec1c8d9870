"""Reports of errors: a sentence about bad input; a line about a defect, and a file with its traceback."""

import errno
import os
import re
import resource
import sys
import tempfile
import traceback

import typer
from typer.exceptions import TyperException

from text_input import RefusalError
from tools import output

LONGEST_MESSAGE = 4000
"""Length of the longest error message about an input, in characters."""
LONG_WORD = re.compile(r"(\S{79})\S{222,}")
"""A word of more than 300 characters, longer than paths are: a name or key of somebody else's file."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS)
"""Errors of a file that the machine does not let the program write."""
UNUSABLE = (errno.EPERM, errno.EISDIR, errno.ENOTDIR, errno.ENAMETOOLONG, errno.ELOOP)
"""Errors of a file that may not be read or written; an error without a file's name is a defect."""
GIB = 2**30
ADDRESS_SPACE_GIB = 3
"""Address space that the largest process of a run maps; most of it is never used."""


def describe_refusal(error: Exception) -> str:
    """A sentence about a file or memory that the machine does not give the program; empty for others."""
    if isinstance(error, OSError) and error.errno in (errno.EMFILE, errno.ENFILE):
        files = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
        return f"more than {files} open files are needed; raise the limit, for example with ulimit -n 256"
    if isinstance(error, ImportError):
        return small_address_space()
    if not isinstance(error, OSError):
        return ""
    place = "a file" if error.filename is None else error.filename
    if error.errno in NO_ROOM:
        return f"{place} cannot be written ({error.strerror}); make room, or write elsewhere"
    if error.errno == errno.EACCES or (error.errno in UNUSABLE and error.filename is not None):
        return f"{place} cannot be used ({error.strerror}); give permission, or name another"
    return ""


def say_error(label: str, message: str, as_json: bool) -> None:
    """Print an error on the console and, if requested, in JSON."""
    output.progress_console.print(label, style="bold red", end=" ")
    output.progress_console.print(message, markup=False, soft_wrap=True)
    if as_json:
        output.print_json({"error": message})


def refuse(message: str, as_json: bool) -> int:
    """Print the error in the input in one sentence and, if requested, in JSON."""
    message = LONG_WORD.sub(r"\1…", message)
    if len(message) > LONGEST_MESSAGE:  # the quoted input may have a megabyte
        half = LONGEST_MESSAGE // 2
        message = f"{message[:half]} … {message[-half:]}"
    say_error("error:", message, as_json)
    return output.EXIT_BAD_INPUT


def report_internal_error(error: Exception, as_json: bool) -> int:
    """Write the traceback to a file, and print the error and the file's path in one line."""
    text = "".join(traceback.format_exception(error))
    try:
        descriptor, where = tempfile.mkstemp(prefix="vibrohil-", suffix=".traceback")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:  # a full or read-only disk: print the traceback on the terminal
        where = "above"
        sys.stderr.write(text)
    summary = " ".join(f"{type(error).__name__}: {error}".split())
    message = f"{summary} (a defect of vibrohil; its traceback: {where})"
    say_error("internal error:", message, as_json)
    return output.EXIT_INTERNAL_ERROR


def small_address_space() -> str:
    """A sentence about a limit of the address space that is too small for a run; empty if it suffices."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= ADDRESS_SPACE_GIB * GIB:
        return ""
    return (
        f"this process may map {limit / GIB:.1f} GiB of memory (ulimit -v), and a run maps "
        f"{ADDRESS_SPACE_GIB} GiB; raise the limit if the run ends for lack of memory"
    )


def note_small_address_space() -> None:
    """Print a note if the limit of the address space is too small for a run."""
    if note := small_address_space():
        output.progress_console.print(f"note: {note}", markup=False)


def report_interruption(reason: str, as_json: bool) -> int:
    """Print that the program was interrupted, and by which signal."""
    message = reason or "interrupted"
    output.progress_console.print(message)
    if as_json:
        output.print_json({"error": message})
    return output.EXIT_INTERRUPTED


def report(error: Exception, as_json: bool) -> int:
    """Print the error that ended the program, and give the exit status."""
    if isinstance(error, typer.Abort):
        return report_interruption(str(error), as_json)
    if isinstance(error, TyperException):
        message = error.format_message()
        return (
            refuse(message, as_json) if message else output.EXIT_BAD_INPUT
        )  # no message: the help was printed
    if isinstance(error, MemoryError):
        remedy = small_address_space() or "free some, or run less at once"
        say_error("error:", f"out of memory; {remedy}", as_json)
        return output.EXIT_INTERNAL_ERROR
    sentence = str(error) if isinstance(error, RefusalError) else describe_refusal(error)
    return refuse(sentence, as_json) if sentence else report_internal_error(error, as_json)
