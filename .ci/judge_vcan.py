"""Checks that all runs on vcan used the kernel's CAN, were judged and passed; prints their timing.

`judge_vcan.py FOLDER STATUS COUNT`: FOLDER contains the suite's output, suite.json, and the suite's folder,
suite; STATUS is the suite's exit status, COUNT the number of scenarios that it was asked to run.
"""

import json
import sys
from pathlib import Path

folder, status, count = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
printed = (folder / "suite.json").read_text(encoding="utf-8")
try:
    suite = json.loads(printed)
except json.JSONDecodeError:
    sys.exit(f"ci: no result; exit status {status}, printed {printed!r}")
wrong = []
for scenario in suite.get("scenarios", []):
    name = scenario["name"]
    verdict = json.loads((folder / "suite" / name / "verdict.json").read_text(encoding="utf-8"))
    keys = ("real_time", "ticks", "held_s", "own_late_s", "baseline_overruns")
    timing = {key: verdict[key] for key in keys}
    print(f"ci: {'passed' if verdict['passed'] else 'FAILED'} {name}: {timing}, work {verdict['tick_us']}")
    for check in verdict["checks"]:
        if not check["passed"]:
            print(f"ci:     {check['name']} = {check['value']} {check['unit']}, wanted {check['limit']}")
    if not verdict["passed"]:
        print(f"ci:     fault {verdict['fault']}, {verdict['latched']}, wake-ups {verdict['wake_us']}")
    if verdict["kernel_can"] is not True:
        wrong.append(f"{name} was not on the kernel's own CAN")
    if not verdict["checks"]:
        wrong.append(f"{name} was judged by nothing")
    if verdict["passed"] is not True:
        wrong.append(f"{name} did not pass: {'; '.join(verdict['reasons']) or 'see its checks'}")
if len(suite.get("scenarios", [])) != count:
    wrong.append(f"{len(suite.get('scenarios', []))} scenarios ran, {count} were asked for")
if status != 0 and not wrong:
    wrong.append(f"exit status {status}")
if wrong:
    sys.exit("ci: " + "; ".join(wrong))
print(f"ci: {count} scenarios passed on the kernel's own CAN")
