"""The program `vibrohil`: its commands and exit statuses.

Exit statuses are pytest's: 0 all passed, 1 a check failed, 2 interrupted (by Ctrl-C, SIGTERM or SIGHUP), 3
internal error, 4 usage or bad input, 5 nothing ran.
"""

import errno
import functools
import os
import resource
import sys
import tempfile
import traceback
from importlib import import_module
from typing import Annotated

import typer
from typer.exceptions import TyperException
from typer.models import CommandInfo

from hil.timing.realtime import collect_rarely
from hil.timing.signals import Interrupted, ending_signals
from tools.examples import EXAMPLES
from tools.output import (
    EXIT_BAD_INPUT,
    EXIT_INTERNAL_ERROR,
    EXIT_INTERRUPTED,
    EXIT_PASSED,
    BadInputError,
    print_json,
    progress_console,
)
from tools.standard_streams import open_streams

LONGEST_MESSAGE = 4000
"""Length of the longest error message about an input, in characters."""
UNWRITABLE = (errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES)
"""Errors of the machine that are not defects of the program."""
GIB = 2**30
ADDRESS_SPACE_GIB = 3
"""Address space that the largest process of a run maps; most of it is never used."""


def print_version(wanted: bool) -> None:
    """Print the version and the commit of the code, and exit."""
    if not wanted:
        return
    from hil.record.provenance import commit, versions

    origin = commit()
    edited = ", edited since" if origin["edited"] else ""
    place = f" ({origin['commit'][:12]}{edited})" if origin["commit"] else ""
    typer.echo(f"vibrohil {versions()['vibrohil']}{place}")
    raise typer.Exit


COMMANDS = {
    "Test the firmware": ("testing.run", "testing.suite", "testing.campaign", "testing.fuzz"),
    "Look at runs": (
        *("logs.runs", "logs.view", "logs.inspect", "logs.compare"),
        *("logs.import_log", "logs.export"),
    ),
    "Design": ("design.tune", "design.trade", "design.schedule"),
    "The module alone": ("design.simulate", "design.study"),
    "One node on a bus": ("nodes.firmware", "nodes.plant", "nodes.operator"),
    "This machine": ("machine.doctor", "machine.kernel", "machine.list_names"),
}
"""The modules of the commands, in the groups of the help page."""


def register(app: typer.Typer, module: str, group: str) -> None:
    """Add one module's command, or its group of sub-commands, to the program."""
    commands, groups = len(app.registered_commands), len(app.registered_groups)
    import_module(f"tools.commands.{module}").register(app)
    for command in app.registered_commands[commands:]:
        command.rich_help_panel = group
        show_example(command, "")
    for sub_commands in app.registered_groups[groups:]:
        sub_commands.rich_help_panel = group
        program = sub_commands.typer_instance
        if program is not None:
            for command in program.registered_commands:
                show_example(command, f"{program.info.name} ")


def show_example(command: CommandInfo, prefix: str) -> None:
    """Put the command's example at the end of its help."""
    name = str(command.name or getattr(command.callback, "__name__", ""))
    command.epilog = f"Example: {EXAMPLES[prefix + name]}"


def vibrohil(
    version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version and the commit.", callback=print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Hardware-in-the-loop bench for a vibro-impact drive."""


@functools.cache
def program() -> typer.Typer:
    """The program with all its commands; KernelCacheError if the kernels' folder cannot be written."""
    app = typer.Typer(name="vibrohil", no_args_is_help=True, pretty_exceptions_enable=False)
    app.callback()(vibrohil)
    for group, modules in COMMANDS.items():
        for module in modules:
            register(app, module, group)
    return app


def bad_input_types() -> tuple[type[Exception], ...]:
    """The types of errors caused by the input; imported only after an error."""
    from firmware_py.shell.parameters import ParameterError
    from hil.bench.recorded_run import RunError
    from hil.bench.workers import WorkerDiedError
    from hil.bus import BusError
    from hil.bus.uml import UmlError
    from hil.record.damage import DamagedFileError
    from hil.record.rerun_program import RerunError
    from hil.record.run_folder import RunFolderError
    from hil.record.traces.trace import TraceError
    from hil.timing.processes import ChildRefusalError
    from plant_sim.text_input import TextInputError

    return (
        *(BadInputError, TextInputError, ParameterError),
        *solver_errors(),
        *board_errors(),
        *(BusError, TraceError, UmlError, ChildRefusalError, RunError, RunFolderError),
        *(DamagedFileError, RerunError, WorkerDiedError),
    )


def is_bad_input(error: Exception) -> bool:
    """Whether the input or the machine caused an error, and not a defect."""
    from plant_sim.kernels import KernelCacheError

    if isinstance(error, KernelCacheError):  # then the modules of the other types cannot be imported
        return True
    try:
        return isinstance(error, bad_input_types())
    except Exception:  # a defect in a module of the other types
        return False


def solver_errors() -> tuple[type[Exception], ...]:
    """The solvers' error types, if a solver has been loaded; loading one would take time."""
    if "plant_sim.solvers.cost" not in sys.modules:
        return ()
    from plant_sim.solvers.cost import SolverError
    from plant_sim.solvers.exact.exact import UnsupportedSceneError

    return SolverError, UnsupportedSceneError


def board_errors() -> tuple[type[Exception], ...]:
    """The error types of a build for a board, if such a build has been loaded."""
    if "firmware_py.builds.board" not in sys.modules:
        return ()
    from firmware_py.builds.board import BoardError

    return (BoardError,)


def unwritable(error: Exception) -> str:
    """A sentence about a file that the machine does not allow to be written; empty for another error."""
    if not isinstance(error, OSError) or error.errno not in UNWRITABLE:
        return ""
    place = "a file" if error.filename is None else error.filename
    return f"{place} cannot be written ({error.strerror}); make room or give permission, or write elsewhere"


def say_error(label: str, message: str, as_json: bool) -> None:
    """Print an error on the console and, if requested, in JSON."""
    progress_console.print(label, style="bold red", end=" ")
    progress_console.print(message, markup=False, soft_wrap=True)
    if as_json:
        print_json({"error": message})


def refuse(message: str, as_json: bool) -> int:
    """Print the error in the input in one sentence and, if requested, in JSON."""
    if len(message) > LONGEST_MESSAGE:  # the quoted input may have a megabyte
        half = LONGEST_MESSAGE // 2
        message = f"{message[:half]} … {message[-half:]}"
    say_error("error:", message, as_json)
    return EXIT_BAD_INPUT


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
    summary = " ".join(traceback.format_exception_only(error)[-1].split())
    message = f"{summary} (a defect of vibrohil; its traceback: {where})"
    say_error("internal error:", message, as_json)
    return EXIT_INTERNAL_ERROR


def small_address_space() -> str:
    """A sentence about a limit of the address space that is too small for a run; empty if it suffices."""
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY or limit >= ADDRESS_SPACE_GIB * GIB:
        return ""
    return (
        f"this process may map {limit / GIB:.1f} GiB of memory (ulimit -v), and a run maps "
        f"{ADDRESS_SPACE_GIB} GiB; raise the limit if the run ends for lack of memory"
    )


def refuse_other_bytes(arguments: list[str]) -> None:
    """Raise BadInputError for an argument that is not valid UTF-8 (e.g. a path): no log could hold it."""
    for argument in arguments:
        try:
            argument.encode()
        except UnicodeEncodeError as error:
            raise BadInputError(f"{argument!a} is not valid UTF-8; give paths and values that are") from error


def run(arguments: list[str]) -> int:
    """Run one command line and give its exit status."""
    as_json = "--json" in arguments
    if note := small_address_space():
        progress_console.print(f"note: {note}", markup=False)
    try:
        with ending_signals():
            refuse_other_bytes(arguments)
            return program()(arguments, standalone_mode=False) or EXIT_PASSED
    except (Interrupted, KeyboardInterrupt, typer.Abort) as error:
        progress_console.print(str(error) or "interrupted")
        if as_json:
            print_json({"error": str(error) or "interrupted"})
        return EXIT_INTERRUPTED
    except TyperException as error:
        message = error.format_message()
        return refuse(message, as_json) if message else EXIT_BAD_INPUT  # no message: the help was printed
    except MemoryError:
        say_error(
            "error:", f"out of memory; {small_address_space() or 'free some, or run less at once'}", as_json
        )
        return EXIT_INTERNAL_ERROR
    except Exception as error:
        sentence = str(error) if is_bad_input(error) else unwritable(error)
        return refuse(sentence, as_json) if sentence else report_internal_error(error, as_json)


def main() -> None:
    """Entry point of the installed program."""
    collect_rarely()
    output = open_streams()
    status = run(sys.argv[1:])
    sys.stdout.flush()
    if output.failure is not None and not isinstance(output.failure, BrokenPipeError):
        say_error("error:", f"standard output cannot be written ({output.failure.strerror})", as_json=False)
        status = EXIT_BAD_INPUT
    sys.exit(status)


if __name__ == "__main__":
    main()
