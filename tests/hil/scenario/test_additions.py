"""A new fault and a new set of checks are one file each, shown by diffs on a copy of the bench."""

import json
from pathlib import Path

from patched_packages import applied, copied, files_of, python

SCENARIO = """
title = "It rests, whatever a sensor reports"
scene = "table1-motor-soft"
checks = ["rests"]

[script]
duration_s = 0.1

[[script.faults]]
kind = "sensor-scaled"
sensor = "encoder"
factor = 1.5
at_s = 0.05
"""
RUN = """
import json, sys, hil
run = hil.run("mine.toml", out="run", firmware="python")
print(json.dumps([hil.__file__, run.verdict]))
"""


def test_a_fault_and_a_set_of_checks_take_one_file_each(tmp_path: Path) -> None:
    copied(tmp_path, "hil")
    for path in Path(__file__).with_name("additions").iterdir():
        diff = path.read_text(encoding="utf-8")
        assert len(files_of(diff)) == 1
        applied(diff, tmp_path, "--unidiff-zero")
    (tmp_path / "mine.toml").write_text(SCENARIO)
    ran = python(tmp_path, "-c", RUN)
    used, verdict = json.loads(ran.splitlines()[-1])
    assert Path(used).parent == tmp_path / "hil"
    assert verdict["verdict"] == "passed"
    assert [(one["kind"], one["acted_on"]) for one in verdict["faults"]] == [("sensor-scaled", 50)]
    assert [(check["name"], check["limit"]) for check in verdict["checks"]] == [("impact_count", "= 0")]
