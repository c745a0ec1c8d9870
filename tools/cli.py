"""The entry point of the program `vibrohil`.

Exit statuses are pytest's: 0 all passed, 1 a check failed, 2 interrupted (by Ctrl-C, SIGTERM or SIGHUP), 3
internal error, 4 usage or bad input, 5 nothing ran. This module imports little: the signals are handled
before the other imports of the program, which take a third of a second.
"""

import os
import signal
import sys

from hil.processes.signals import Interrupted, delayed_signals, ending_signals
from tools.standard_streams import open_streams


def run(arguments: list[str]) -> int:
    """Run one command line and give its exit status."""
    as_json = "--json" in arguments
    with ending_signals() as signals:
        try:
            with delayed_signals():
                from hil.timing.realtime import collect_rarely
                from tools import error_report

                collect_rarely()
                from tools import program  # may fail, which the report must survive
                from tools.output import EXIT_PASSED

                error_report.note_small_address_space()
                program.check_surroundings(arguments)
                command = program.program(*arguments[:1])
            return command(arguments, standalone_mode=False) or EXIT_PASSED
        except (Interrupted, KeyboardInterrupt) as error:
            signals.raises = False  # a second signal does not interrupt the report
            return error_report.report_interruption(str(error), as_json)
        except Exception as error:
            signals.raises = False
            if signals.raised is not None:
                return error_report.report_interruption(str(signals.raised), as_json)
            return error_report.report(error, as_json)


def main() -> None:
    """Entry point of the installed program."""
    output = open_streams()
    # A script's shell starts programs in the background with SIGINT ignored, and no other signal is Ctrl-C's.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.umask(os.umask(0) | 0o022)  # nothing that the program writes may be changed by others
    status = run(sys.argv[1:])
    sys.stdout.flush()
    if output.failure is not None and not isinstance(output.failure, BrokenPipeError):
        from tools.error_report import refuse

        status = refuse(f"standard output cannot be written ({output.failure.strerror})", as_json=False)
    sys.exit(status)


if __name__ == "__main__":
    main()
