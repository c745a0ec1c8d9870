"""A new fault and a new set of checks are one file each, shown by patches to a copy of the bench."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import hil

FAULT = '''
--- /dev/null
+++ b/hil/faults/kinds/sensor_scaled.py
@@ -0,0 +1,20 @@
+"""A sensor with another gain."""
+
+from typing import Literal
+
+import numpy as np
+from pydantic import Field
+
+from hil.faults.on_sensor import Past, SensorFault
+from plant_sim.sensors.readings import SensorReading
+
+
+class SensorScaled(SensorFault):
+    """Readings that are multiplied by a factor."""
+
+    kind: Literal["sensor-scaled"]
+    factor: float = Field(description="the readings' factor")
+
+    def disturbed(self, reading: SensorReading, past: Past, noise: np.random.Generator) -> SensorReading:
+        """The reading times the factor."""
+        return reading._replace(**{name: self.factor * getattr(reading, name) for name in self.fields})
'''
CHECK_SET = """
--- a/hil/scenario/check_sets.toml
+++ b/hil/scenario/check_sets.toml
@@ -0,0 +1,4 @@
+[rests]
+title = "Nothing moves"
+checks = [{ name = "impact_count", equals = 0 }]
+
"""
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
    shutil.copytree(Path(hil.__file__).parent, tmp_path / "hil", ignore=shutil.ignore_patterns("__pycache__"))
    for patch in (FAULT, CHECK_SET):
        assert len(re.findall(r"^\+\+\+ b/", patch, re.MULTILINE)) == 1
        applied = ["git", "apply", "--unidiff-zero", "-"]
        subprocess.run(applied, input=patch.lstrip(), cwd=tmp_path, text=True, check=True)
    (tmp_path / "mine.toml").write_text(SCENARIO)
    ran = subprocess.run(
        [sys.executable, "-c", RUN],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ran.returncode == 0, ran.stderr
    used, verdict = json.loads(ran.stdout.splitlines()[-1])
    assert Path(used).parent == tmp_path / "hil"
    assert verdict["verdict"] == "passed"
    assert [(one["kind"], one["acted_on"]) for one in verdict["faults"]] == [("sensor-scaled", 50)]
    assert [(check["name"], check["limit"]) for check in verdict["checks"]] == [("impact_count", "= 0")]
