"""The worst run of a requirement among the runs of a search."""

from types import SimpleNamespace

import numpy as np

from tools.dev.worst_cases import worst_of
from tools.falsify.objective import Result, Task
from tools.falsify.search import Start
from tools.falsify.space_of_scenario import space_of

KICK = "a-kick-towards-the-stop-does-not-lose-the-impacts"


def test_the_worst_run_of_a_requirement_is_the_judged_one_with_its_smallest_margin() -> None:
    space = space_of(KICK, [])
    names = [one.name for one in space.checks]
    again, force = names.index("after_fault.impacts_again_after_s"), names.index("after_fault.peak_force_n")

    def result(why: str = "", **margins: float) -> Result:
        return Result(tuple(margins.get(f"m{place}") for place in range(len(names))), why)

    known = {
        Task(KICK, (1.0,)): result(**{f"m{again}": 0.3, f"m{force}": 0.1}),
        Task(KICK, (2.0,)): result(**{f"m{again}": 0.2, f"m{force}": 0.5}),
        Task(KICK, (3.0,)): result("the host was busy", **{f"m{again}": -1.0}),
    }
    evaluations, starts = SimpleNamespace(known=known), {KICK: Start(space, np.zeros((0, 0)), [])}
    worst = worst_of("P-07", evaluations, starts)
    assert worst is not None
    assert (worst.best.margin, worst.best.values, worst.best.name) == (0.2, (2.0,), names[again])
    assert worst.runs == 2
    assert worst_of("P-04", evaluations, starts) is None
