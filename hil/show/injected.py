"""The faults of a run, as log and report show them."""

from collections.abc import Mapping, Sequence
from typing import Any

from hil.record.run_faults import RunFault, faults_of

NONE = "none"


def injected_in(run: Mapping[str, Any]) -> list[RunFault]:
    """The faults of a run in the order of time, from the content of its run.json."""
    return sorted(faults_of(run), key=lambda fault: (fault.from_s, fault.end_s, fault.text))


def since(faults: Sequence[RunFault], at_s: float) -> str:
    """The time since the latest injected fault, as the end of a sentence; empty without one.

    >>> since([RunFault("sensor-stuck", None, False, 4.0, 4.5, "sensor-stuck")], 4.03)
    ', 30 ms after the injected fault sensor-stuck'
    """
    before = [fault for fault in faults if fault.from_s <= at_s]
    if not before:
        return ""
    delay_s = at_s - before[-1].from_s
    delay = f"{1e3 * delay_s:.0f} ms" if delay_s < 1.0 else f"{delay_s:.3g} s"
    return f", {delay} after the injected fault {before[-1].text}"


def timeline(faults: list[RunFault], end_s: float) -> list[tuple[float, str]]:
    """The times in s at which the set of acting faults changes, with its description, to the run's end.

    >>> timeline([RunFault("", "", False, 1.0, 3.0, "a"), RunFault("", "", False, 2.0, None, "b")], 9.0)
    [(0.0, 'none'), (1.0, 'a'), (2.0, 'a + b'), (3.0, 'b')]
    """
    edges = sorted(
        {0.0, *(edge for fault in faults for edge in (fault.from_s, fault.end_s) if edge <= end_s)}
    )
    acting = [[one.text for one in faults if one.from_s <= edge < one.end_s] for edge in edges]
    return [(edge, " + ".join(texts) or NONE) for edge, texts in zip(edges, acting, strict=True)]
