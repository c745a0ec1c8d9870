"""The beginning of a run: clears its folder and writes the scenario as run and a first `run.json`."""

import time
from pathlib import Path

import tomli_w

from hil.run_files import RunFile
from hil.record import provenance, run_folder
from hil.record.new_file import write_anew
from hil.scenario.scenario import Scenario
from hil.timing.realtime import is_user_mode_linux


def key_of(scenario: Scenario, clock: str, seed: int) -> str:
    """A digest of all inputs of a run's verdict: scenario, clock, seed, sources, packages, kernel."""
    return provenance.key(tomli_w.dumps(scenario.document), clock, seed, provenance.versions()["kernel"])


def begin(run_dir: Path, scenario: Scenario, clock: str, seed: int) -> None:
    """Clear a claimed folder, and write the scenario as run and `run.json` without bus and start."""
    run_folder.clear(run_dir)
    run_folder.note(
        run_dir,
        scenario=scenario.name,
        title=scenario.title,
        clock=clock,
        seed=seed,
        period_s=scenario.period_s,
        user_mode_linux=is_user_mode_linux(),
        begun_s=time.time(),
        created=time.strftime("%Y-%m-%dT%H:%M:%S%z"),
        key=key_of(scenario, clock, seed),
        changes=list(scenario.changes),
        faults=[fault.as_record()._asdict() for fault in scenario.faults],
        **provenance.commit(),
        versions=provenance.versions(),
    )
    write_anew(run_dir / RunFile.SCENARIO, tomli_w.dumps(scenario.document))
