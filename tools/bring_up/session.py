"""A bring-up in its folder: the steps in their order, each begun, resumed or repeated, and their findings."""

import json
import math
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from firmware_py.shell.parameters import DEFAULTS, ParameterError, with_overrides
from hil.record.damage import reading
from hil.record.formats import KEY, PARAMETERS, refuse_other_format
from hil.record.new_file import MOST_NOTE_BYTES, is_regular, write_anew
from hil.record.run_folder import FolderInUseError, locked, open_taken_over
from hil.show.report.picture import extrema
from tools.bring_up.at_rest import AT_REST
from tools.bring_up.below_impacts import BELOW_IMPACTS
from tools.bring_up.drive import DRIVE
from tools.bring_up.first_impacts import FIRST_IMPACTS
from tools.bring_up.listen import LISTEN
from tools.bring_up.module_fit import largest_in
from tools.bring_up.report import section, write_report
from tools.bring_up.step import NOTHING, Bench, Context, Curve, Findings, Largest, Step, StepFailedError
from tools.bring_up.twin import PARAMETER_FILE, SCENE, TWIN
from tools.output import BadInputError
from tools.tuning.result import Value, make_value

STEPS: tuple[Step, ...] = (LISTEN, AT_REST, DRIVE, BELOW_IMPACTS, FIRST_IMPACTS, TWIN)
STATE, REPORT = "bring-up.json", "bring-up.html"
STATE_FORMAT = 1
RESTS_ON = {"limit": FIRST_IMPACTS.name, "stop": FIRST_IMPACTS.name}
"""The first step that rests on the data sheet's values of a block; on the others the drive's step does."""
USUAL_RATIO = 1.25
"""The wanted ratio of a new folder."""


@dataclass(frozen=True)
class User:
    """How the session speaks: `says` prints a sentence, `agrees` asks one and returns whether it is a yes."""

    says: Callable[[str], None]
    agrees: Callable[[str], bool]


class State(NamedTuple):
    """A begun bring-up: the data sheet's values that were given, and the records of the steps."""

    settings: Mapping[str, float]
    records: list[dict[str, Any]]


def read_state(folder: Path) -> State:
    """The state of a begun bring-up; empty for a new folder.

    Raises BadInputError for a folder of others' files, RunFolderError for a state that another user may have
    written, and DamagedFileError.
    """
    path, remedy = folder / STATE, "name another folder with --out"
    try:
        opened = open_taken_over(path, remedy)
    except FileNotFoundError:
        if folder.exists() and any(folder.iterdir()):
            raise BadInputError(
                f"{folder} holds other files; name a new folder, or one that bring-up made"
            ) from None
        return State({}, [])
    with opened as file:
        if not is_regular(path) or os.fstat(file.fileno()).st_size > MOST_NOTE_BYTES:
            raise BadInputError(f"{path} is no state of a bring-up; {remedy}")
        with reading(path, remedy):
            return checked(json.loads(file.read()))


def checked(tables: dict[str, Any]) -> State:
    """The state in the tables of its file; raises any error for a file that no bring-up has written."""
    refuse_other_format(STATE, tables, STATE_FORMAT, "begin anew")
    settings, records = tables.get("settings", {}), tables["steps"]
    with_overrides(settings)
    for record in records:
        section(record)  # it can be shown
        dict(record.get("logs", {}))  # and the files of its frames be found
        if not math.isfinite(record.get("ratio", USUAL_RATIO)):
            raise ValueError("a step's ratio is no number")
    passed, names = passed_in(records), [step.name for step in STEPS]
    if [one["name"] for one in passed] != names[: len(passed)]:
        raise ValueError("a step is missing or has not passed, and others follow")
    if records[len(passed) :] and (records[:-1] != passed or records[-1]["name"] not in names):
        raise ValueError("a step that has failed is not the last one")
    if not parameters_in(records).keys() <= DEFAULTS.keys():
        raise ValueError("it has unknown parameters")
    return State(settings, records)


def thin(curve: Curve) -> dict[str, Any]:
    """A curve with the extrema that its picture shows, as a table."""
    x, y = extrema(np.asarray(curve.x, float), np.asarray(curve.y, float))
    return {"name": curve.name, "x": x.tolist(), "y": y.tolist()}


def record_of(step: Step, found: Findings, bound: Largest, reason: str, context: Context) -> dict[str, Any]:
    """The record of a step that has ended; an empty reason means that it has passed."""
    return {
        "name": step.name,
        "ratio": context.ratio,
        "passed": not reason,
        "reason": reason,
        "largest": found.largest._asdict(),
        "bound": bound._asdict(),
        "does": step.moves or step.does,
        "parameters": {name: value._asdict() for name, value in found.parameters.items()},
        "figures": [one._asdict() for one in found.figures],
        "notes": found.notes,
        "axes": list(found.axes),
        "curves": [thin(one) for one in found.curves],
        "logs": context.logs,
    }


def seen_in(logs: Iterable[Path], mass_kg: float) -> Largest:
    """The largest values in the frames of a step that has failed; NOTHING if its logs do not show them."""
    parts = [NOTHING]
    for log in logs:
        with suppress(ValueError):  # such as one without a frame of a sensor
            parts.append(largest_in(log, mass_kg))
    return Largest(*np.max(np.array(parts), axis=0).tolist())


def passed_in(records: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """The steps that have passed, without the last attempt if it has failed."""
    return [one for one in records if one["passed"] is True]


def parameters_in(records: Sequence[dict[str, Any]]) -> dict[str, Value]:
    """The parameters that the steps have found; a later step's value replaces an earlier one's.

    Those of a step that fails as it is repeated replace none.
    """
    passed = passed_in(records)
    names = {one["name"] for one in passed}
    counted = [*passed, *(one for one in records if one["name"] not in names)]
    return {name: Value(**value) for one in counted for name, value in one["parameters"].items()}


class Session:
    """A bring-up of one module.

    `settings`: the data sheet's values of the firmware's parameters; `ratio`: the wanted one. The folder
    keeps them for the next time; one that is given again replaces the former value.
    """

    def __init__(
        self, bench: Bench, folder: Path, settings: Mapping[str, float], ratio: float | None, user: User
    ) -> None:
        self._bench, self._folder, self._user = bench, folder, user
        state = read_state(folder)
        self._settings, self.records = {**state.settings, **settings}, state.records
        last_ratio = self.records[-1].get("ratio", USUAL_RATIO) if self.records else USUAL_RATIO
        self._ratio = last_ratio if ratio is None else ratio
        self._kept: Mapping[str, float] = state.settings
        """The data sheet's values with which the kept records were made."""

    def run(self, first: str | None, last: str | None) -> dict[str, Any]:
        """Run the steps from `first` (by default the first that has not passed) to `last`; the result."""
        names = [step.name for step in STEPS]
        passed = passed_in(self.records)
        failed = [names.index(one["name"]) for one in self.records[len(passed) :]]
        begin = names.index(first) if first else [*failed, len(passed)][0]
        if begin > len(passed):
            raise BadInputError(
                f"--from {first}: the step {names[len(passed)]} has not passed yet; begin there"
            )
        end = names.index(last) + 1 if last else len(names)
        if first and end <= begin:
            raise BadInputError(f"--until {last} ends before --from {first}; name that step or a later one")
        self._refuse_changes(names[:begin])
        self._folder.mkdir(parents=True, exist_ok=True)
        try:
            with locked(self._folder):
                for number in range(begin, end):
                    self._run(number)
                    if not self.records[-1]["passed"]:
                        break
        except FolderInUseError as error:
            raise BadInputError(f"{error}; two bring-ups must not move one module") from error
        return self.result()

    def _refuse_changes(self, kept: Sequence[str]) -> None:
        """Raise BadInputError if a value differs from that with which the steps that are kept were run."""
        used = {**DEFAULTS, **self._kept}
        changed = [
            (name, value, used[name], RESTS_ON.get(name.partition(".")[0], DRIVE.name))
            for name, value in self._settings.items()
            if value != used[name]
        ]
        ratios = [one.get("ratio") for one in passed_in(self.records) if one["name"] == FIRST_IMPACTS.name]
        if ratios and ratios[0] not in (None, self._ratio):  # None: of a folder older than this check
            changed.append(("the ratio", self._ratio, ratios[0], FIRST_IMPACTS.name))
        for name, value, before, rests in changed:
            if rests in kept:
                raise BadInputError(
                    f"{name} is {value:g}, and the steps from {rests} on have used {before:g}; repeat them "
                    f"by --from {rests}, leave the value out, or name another folder for another module"
                )

    def _run(self, number: int) -> None:
        """Run one step, and keep its record whatever happens.

        The former record goes once the step has passed anew, with those of later steps, which rest on it.
        """
        step, passed = STEPS[number], passed_in(self.records)
        before = passed[:number]
        bounds = parameters_in(before)
        values = with_overrides(self._settings | {name: value.value for name, value in bounds.items()})
        user = self._user
        logs = {name: file for one in before for name, file in one.get("logs", {}).items()}
        context = Context(
            self._bench, self._folder, values, bounds, user.agrees, user.says, self._ratio, logs
        )
        bound, found = step.bound(context), Findings()
        user.says(f"{step.name}: {step.does} It takes about {step.lasts_s:.0f} s.")
        if step.moves:
            user.says(f"{step.moves} Bounds: {describe(bound)}. Ctrl-C is an E-stop at any time.")
            if not user.agrees(f"Begin the step {step.name}?"):
                reason = "not agreed to; nothing has moved"
                self.records = [*passed, record_of(step, found, bound, reason, context)]
                user.says(f"{step.name}: {reason}")
                return
        old_logs = set(self._folder.glob("*.log"))
        reason = "interrupted: the module was stopped; the same command repeats the step"
        try:
            step.run(context, found)
            with_overrides(values | {name: one.value for name, one in found.parameters.items()})
            reason = ""
        except ParameterError as error:
            found.parameters.clear()
            reason = f"what was found cannot be: {error}; look at the report, then repeat the step"
        except (StepFailedError, BadInputError) as error:
            reason = str(error)
        except ConnectionError as error:
            reason = (
                f"the bus has failed: {error}; an E-stop was sent if it could be, and the drive's watchdog "
            )
            reason += "ends the torque without it; mend the bus, and the same command repeats the step"
            raise
        except Exception as error:
            reason = (
                f"ended by an error of this program, {type(error).__name__}: {error}; the module was stopped"
            )
            raise
        finally:
            if reason and step.moves and found.largest == NOTHING:
                mass_kg = values["striker.mass_kg"] if bound.force_n else 0.0
                found.largest = seen_in(set(self._folder.glob("*.log")) - old_logs, mass_kg)
            self.records = [*(passed if reason else before), record_of(step, found, bound, reason, context)]
            if not (reason and passed[number:]):
                self._kept = self._settings
            self._write()
        for sentence in [*found.notes, reason or "passed"]:
            user.says(f"{step.name}: {sentence}")

    def _write(self) -> None:
        """Write state, parameter file and report."""
        state = {KEY: STATE_FORMAT, "settings": self._kept, "steps": self.records}
        write_anew(unfinished := self._folder / f"{STATE}.new", json.dumps(state, allow_nan=False))
        unfinished.replace(self._folder / STATE)  # a full disk leaves the former state
        if found := parameters_in(self.records):
            given = {name: make_value(name, value) for name, value in self._kept.items()}
            table = {"format": PARAMETERS, "tuning": {"command": "bring-up"}}
            table["parameters"] = {name: value._asdict() for name, value in (given | found).items()}
            write_anew(self._folder / PARAMETER_FILE, tomli_w.dumps(table))
        write_report(self._folder / REPORT, self.result())

    def result(self) -> dict[str, Any]:
        """The command's JSON object, with what the report needs besides."""
        found = parameters_in(self.records)
        has_twin = any(one["name"] == TWIN.name for one in self.records)
        scene, parameter_file = self._folder / SCENE, self._folder / PARAMETER_FILE
        return {
            "steps": self.records,
            "parameters": {
                name: value._asdict() | {"default": DEFAULTS[name]} for name, value in found.items()
            },
            "scene": str(scene) if has_twin and scene.exists() else None,
            "parameter_file": str(parameter_file) if found else None,
            "report": str(self._folder / REPORT),
            "passed": bool(self.records) and all(one["passed"] for one in self.records),
        }


def describe(bound: Largest) -> str:
    """The bounds of a step in words."""
    parts = [f"{bound.torque_n_m:.3g} N m", f"{bound.speed_rad_s:.3g} rad/s"]
    parts += [f"{bound.force_n:.0f} N at the stop" if bound.force_n else "no impact"]
    parts += [f"{bound.angle_rad:.3g} rad of crank a pulse"] if bound.angle_rad else []
    return ", ".join(parts)
