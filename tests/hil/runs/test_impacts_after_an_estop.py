"""The impacts that follow an E-stop, over ratio and phase: the table of docs/safety.md."""

import re
from pathlib import Path

import numpy as np
import pytest

from hil.runs.job import Job
from hil.runs.segments import segments
from hil.scenario.scenario import load_scenario
from plant_sim.result import Impact

PAGE = (Path(__file__).parents[3] / "docs/safety.md").read_text("utf-8")
ROW = re.compile(r"^\| (1\.\d) \| (\d) \| ([\d., ]+) \| ([\d.]+) s \|$", re.MULTILINE)
ROWS = {float(ratio): row for ratio, *row in ROW.findall(PAGE)}
WORST_S = {1.1: 12.516, 1.2: 12.413, 1.3: 12.658, 1.4: 12.423}
"""An E-stop at the phase after which the most impacts follow, or the latest of them."""


@pytest.mark.requirement("S-03")
@pytest.mark.parametrize("ratio", WORST_S)
def test_the_impacts_after_an_e_stop_are_those_of_the_page(ratio: float) -> None:
    """At the worst phase and two others: their number, speed over that of the steady ones, and last time."""
    count, speeds, last_s = ROWS[ratio]
    most = [float(speed) for speed in speeds.split(", ")]
    found = []
    for at_s in (WORST_S[ratio], WORST_S[ratio] + 0.15, WORST_S[ratio] + 0.3):
        run = f'{{at_s=0.5,request="run",target_ratio={ratio}}}'
        script = f'script.commands=[{run},{{at_s={at_s:.3f},request="e-stop"}}]'
        scenario = load_scenario("e-stop-in-the-hold", [script, f"script.duration_s={at_s + 3.0:.3f}"])
        kept = {"impacts": Impact._fields}
        done = segments(Job(scenario, 1, kept=kept))
        impacts = [Impact._make(row) for segment in done for row in segment.rows["impacts"].tolist()]
        steady_m_s = max(abs(one.v_m_s) for one in impacts if at_s - 2.0 < one.t_s <= at_s)
        after = [one for one in impacts if one.t_s > at_s]
        assert len(after) <= int(count), at_s
        assert all(abs(one.v_m_s) <= (most[k] + 0.01) * steady_m_s for k, one in enumerate(after)), at_s
        assert all(one.t_s - at_s <= float(last_s) + 0.01 for one in after), at_s
        found.append(len(after))
    assert max(found) == int(count)


def test_the_requirement_permits_what_the_page_states() -> None:
    assert max(int(row[0]) for row in ROWS.values()) == 3
    assert np.all([len(row[1].split(", ")) == int(row[0]) for row in ROWS.values()])
