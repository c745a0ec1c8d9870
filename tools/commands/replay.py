"""`vibrohil replay SOURCE…`: recorded frames into today's firmware."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any

import typer

from tools.commands.options import Json, ParameterFiles, ReplayedController
from tools.output import (
    EXIT_CHECK_FAILED,
    EXIT_NOTHING_RAN,
    EXIT_PASSED,
    BadInputError,
    answer,
    progress_console,
)


def replay(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Run folders, CAN logs of another bench, or folders of such recordings.", metavar="LOG|RUN…"
        ),
    ],
    firmware: ReplayedController = None,
    parameters: ParameterFiles = None,
    as_json: Json = False,
) -> None:
    """Feed recorded frames, tick by tick, to today's firmware, and compare what it sends with the record.

    The firmware's build is by default the recorded one, of a log `compiled`.

    The frames of a run must be equal to the bit; a log of another bench must show the same decisions (modes,
    regimes, impacts, faults) within stated times. The exit status is 1 if a replay differs, and 5 if the log
    does not show all that the firmware received.
    """
    from hil.record.traces.own_trace import NONE
    from tools.runs.replay import recordings
    from tools.runs.replay import replay as replay_one

    if firmware == NONE:
        raise BadInputError("--firmware none: a replay has no bus to join; name a build or FILE.py:FUNCTION")
    found = [one for source in sources for one in recordings(source)]
    if not found:
        raise BadInputError(f"{sources[0]} holds no run folder and no CAN log; name one")
    done = []
    for number, source in enumerate(found):
        if len(found) > 1:
            progress_console.print(f"{number + 1} of {len(found)}  {source}", markup=False)
        done.append(replay_one(source, firmware, parameters or ()))
    status = EXIT_PASSED
    if any(one.equal is False for one in done):
        status = EXIT_CHECK_FAILED
    elif any(one.equal is None for one in done):
        status = EXIT_NOTHING_RAN
    results: list[dict[str, Any]] = [asdict(one) for one in done]
    payload = results[0] if len(results) == 1 else {"equal": status == EXIT_PASSED, "replays": results}
    answer(payload, as_json, status=status)
