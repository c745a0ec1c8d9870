"""`vibrohil replay SOURCE…`: recorded frames into today's firmware."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tools.commands.options import FirmwareBuild, Json, ParameterFiles
from tools.output import (
    EXIT_CHECK_FAILED,
    EXIT_NOTHING_RAN,
    EXIT_PASSED,
    BadInputError,
    answer,
    console,
    marked,
    progress_console,
    table_of,
)

if TYPE_CHECKING:
    from tools.logs.replay import Decision, Replay


def replay(
    sources: Annotated[
        list[Path],
        typer.Argument(
            help="Run folders, CAN logs of another bench, or folders of such recordings.", metavar="LOG|RUN…"
        ),
    ],
    firmware: FirmwareBuild = "compiled",
    parameters: ParameterFiles = None,
    as_json: Json = False,
) -> None:
    """Feed recorded frames, tick by tick, to today's firmware, and compare what it sends with the record.

    The frames of a run must be equal to the bit; a log of another bench must show the same decisions (modes,
    regimes, impacts, faults) within stated times. The exit status is 1 if a replay differs, and 5 if the log
    does not show all that the firmware received.
    """
    from tools.logs.replay import recordings
    from tools.logs.replay import replay as replay_one

    found = [one for source in sources for one in recordings(source)]
    if not found:
        raise BadInputError(f"{sources[0]} holds no run folder and no CAN log; name one")
    done = []
    for number, source in enumerate(found):
        if len(found) > 1:
            progress_console.print(f"{number + 1} of {len(found)}  {source}", markup=False)
        done.append(replay_one(source, firmware, parameters or ()))
    status = EXIT_PASSED
    if any(not one.equal and not one.proves_nothing for one in done):
        status = EXIT_CHECK_FAILED
    elif any(one.proves_nothing for one in done):
        status = EXIT_NOTHING_RAN
    payload: dict[str, Any] = (
        done[0].as_json()
        if len(done) == 1
        else {"equal": status == EXIT_PASSED, "replays": [one.as_json() for one in done]}
    )
    answer(payload, as_json, lambda: show(done), status)


def show(done: "list[Replay]") -> None:
    """Print a row for each replay, then the first difference and the changed decisions."""
    rows = []
    for one in done:
        verdict = "not judged" if one.proves_nothing else "passed" if one.equal else "failed"
        compared = f"{one.frames} frames" if one.is_own else "decisions"
        rows.append((one.source, str(one.ticks), compared, str(one.different_frames), marked(verdict)))
    console.print(table_of(("recording", ">ticks", "compared", ">frames that differ", ""), rows))
    for one in done:
        payload = one.as_json()
        first = payload["first_difference"]
        if one.is_own and first is not None:
            recorded, replayed = (first[key] or "no frame" for key in ("recorded", "replayed"))
            console.print(
                f"{one.source}: first difference at {first['t_s']:.4f} s, {first['frame']}: "
                f"recorded {recorded}, replayed {replayed}",
                markup=False,
            )
        for changed in one.decisions:
            console.print(
                f"{one.source}: {changed.signal}: recorded {shown(changed.recorded)}, replayed "
                f"{shown(changed.replayed)}",
                markup=False,
            )
        if one.proves_nothing:
            console.print(f"{one.source}: not judged: {one.hidden}", markup=False)


def shown(decision: "Decision | None") -> str:
    """Return a decision as text."""
    return "nothing more" if decision is None else f"{decision.value} at {decision.t_s:.4f} s"
