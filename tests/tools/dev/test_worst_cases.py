"""The worst run of a requirement among the runs of a search."""

from types import SimpleNamespace

import numpy as np
import pytest

from tools.dev.worst_cases import searched, shares, worst_of
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


def test_every_requirement_has_its_runs_and_every_scenario_a_fifth_of_them() -> None:
    """A run counts for all requirements that it has checks of, so there are fewer than one each."""
    spaces = searched()
    proved = [{check.requirement for check in space.checks} for space in spaces]
    wanted = sorted(set.union(*proved) - {None, "B-01"})
    counts = shares(spaces, wanted, 100)
    assert all(sum(n for n, some in zip(counts, proved, strict=True) if one in some) >= 100 for one in wanted)
    assert min(counts) == 20
    assert sum(counts) < 100 * len(wanted)
    longer = shares(spaces, wanted, 300)
    assert all(more >= fewer for more, fewer in zip(longer, counts, strict=True))  # it continues


def test_a_requirement_without_a_scenario_is_said() -> None:
    with pytest.raises(ValueError, match="no scenario has a check of S-09"):
        shares([space_of(KICK, [])], ["P-07", "S-09"], 100)
