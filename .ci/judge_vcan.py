"""Did all runs on vcan cross the kernel's own CAN, and were they judged and passed? Prints their timing.

`judge_vcan.py FOLDER STATUS COUNT`: FOLDER holds what the suite printed, suite.json, and the suite's own
folder, suite; then its exit status, and how many scenarios it was asked to run.

A run in real time says nothing of the product where the machine did not give it the CPU. So one whose verdict
names a host stall, while a bare sleep loop beside it lost ticks too, counts neither for nor against; more
than half must pass all the same.
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
BARE_LOOP_LOST = 0.01
"""Share of its ticks that the bare loop must have lost for the machine to be the cause."""

wrong = []
held_up = []
for scenario in suite.get("scenarios", []):
    name = scenario["name"]
    verdict = json.loads((folder / "suite" / name / "verdict.json").read_text(encoding="utf-8"))
    timing = {key: verdict[key] for key in ("real_time", "ticks", "overruns", "baseline_overruns")}
    lost = verdict["baseline_overruns"] / (verdict["ticks"] + verdict["overruns"] + 1)
    by_the_machine = bool(verdict["host_stall"]) and lost > BARE_LOOP_LOST and not verdict["reasons"]
    said = "passed" if verdict["passed"] else "held up" if by_the_machine else "FAILED"
    print(f"ci: {said} {name}: {timing}, work {verdict['tick_us']}")
    for check in verdict["checks"]:
        if not check["passed"]:
            print(f"ci:     {check['name']} = {check['value']} {check['unit']}, wanted {check['limit']}")
    if not verdict["passed"]:
        print(f"ci:     fault {verdict['fault']}, {verdict['latched']}, wake-ups {verdict['wake_us']}")
        print(f"ci:     {verdict['host_stall']}; the bare loop lost {lost:.1%} of its ticks")
    if verdict["kernel_can"] is not True:
        wrong.append(f"{name} was not on the kernel's own CAN")
    if not verdict["checks"]:
        wrong.append(f"{name} was judged by nothing")
    if by_the_machine:
        held_up.append(name)
    elif verdict["passed"] is not True:
        wrong.append(f"{name} did not pass: {'; '.join(verdict['reasons']) or 'see its checks'}")
if len(suite.get("scenarios", [])) != count:
    wrong.append(f"{len(suite.get('scenarios', []))} scenarios ran, {count} were asked for")
if 2 * len(held_up) >= count:
    wrong.append(f"the machine held up {len(held_up)} of {count}, too many to say that vcan works")
if status != 0 and not wrong and not held_up:
    wrong.append(f"exit status {status}")
if wrong:
    sys.exit("ci: " + "; ".join(wrong))
print(f"ci: {count - len(held_up)} of {count} scenarios passed on the kernel's own CAN")
if held_up:
    print(f"ci: held up by the machine, and so not judged: {', '.join(held_up)}")
