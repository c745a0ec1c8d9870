"""`vibrohil`, the one program: commands, and what each exit status means.

Exit statuses are pytest's: 0 all passed, 1 a check failed, 2 interrupted, 3 internal error, 4 usage or bad
input, 5 nothing ran.
"""

import os
import sys
import tempfile
import traceback
from importlib import import_module

import typer
from typer.exceptions import TyperException

from tools.output import (
    EXIT_BAD_INPUT,
    EXIT_INTERNAL_ERROR,
    EXIT_INTERRUPTED,
    EXIT_PASSED,
    BadInputError,
    print_json,
    progress_console,
)

app = typer.Typer(
    name="vibrohil",
    help="Hardware-in-the-loop bench for a vibro-impact drive: run, simulate, look.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    add_completion=False,
)

COMMANDS = (
    "run",
    "suite",
    "firmware",
    "plant",
    "operator",
    "campaign",
    "simulate",
    "view",
    "inspect",
    "compare",
    "study",
    "trade",
    "tune",
    "import_log",
    "kernel",
    "schedule",
    "fuzz",
    "doctor",
)

for command in COMMANDS:
    import_module(f"tools.commands.{command}").register(app)


def bad_input_types() -> tuple[type[Exception], ...]:
    """The errors that blame the input; looked up only once one has been raised."""
    from firmware_py.shell.parameters import ParameterError
    from hil.bus import BusError
    from hil.processes import ChildRefusalError
    from hil.recorded_run import RunError
    from hil.scenario import ScenarioError
    from hil.trace import TraceError
    from hil.uml import UmlError
    from plant_sim.scene import SceneError

    return (
        *(BadInputError, SceneError, ScenarioError, ParameterError),
        *(BusError, TraceError, UmlError, ChildRefusalError, RunError),
    )


def refuse(message: str, as_json: bool) -> int:
    """Say what was wrong with the input, in a sentence and, where asked for, in JSON."""
    progress_console.print("error:", style="bold red", end=" ")
    progress_console.print(message, markup=False, highlight=False, soft_wrap=True)
    if as_json:
        print_json({"error": message})
    return EXIT_BAD_INPUT


def report_internal_error(error: Exception, as_json: bool) -> int:
    """Write the traceback to a file of its own, and say in one line what happened and where that file is."""
    text = "".join(traceback.format_exception(error))
    try:
        descriptor, where = tempfile.mkstemp(prefix="vibrohil-", suffix=".traceback")
        with os.fdopen(descriptor, "w", encoding="utf-8", errors="backslashreplace") as file:
            file.write(text)
    except OSError:  # a full or read-only disk: then it goes to the terminal
        where = "above"
        sys.stderr.write(text)
    summary = " ".join(traceback.format_exception_only(error)[-1].split())
    message = f"{summary} (a defect of vibrohil; its traceback: {where})"
    progress_console.print("internal error:", style="bold red", end=" ")
    progress_console.print(message, markup=False, highlight=False, soft_wrap=True)
    if as_json:
        print_json({"error": message})
    return EXIT_INTERNAL_ERROR


def run(arguments: list[str]) -> int:
    """Run one command line and give its exit status."""
    as_json = "--json" in arguments
    try:
        return app(arguments, standalone_mode=False) or EXIT_PASSED
    except (KeyboardInterrupt, typer.Abort):
        progress_console.print("interrupted")
        return EXIT_INTERRUPTED
    except TyperException as error:
        return refuse(error.format_message(), as_json)
    except Exception as error:
        if isinstance(error, bad_input_types()):
            return refuse(str(error), as_json)
        return report_internal_error(error, as_json)


def main() -> None:
    """Entry point of the installed program."""
    sys.exit(run(sys.argv[1:]))


if __name__ == "__main__":
    main()
