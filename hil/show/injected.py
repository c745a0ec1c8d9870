"""The faults that a scenario injects, as log and report show them."""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

NONE = "none"


class Injected(NamedTuple):
    """One fault: its interval in simulated seconds, and its description."""

    from_s: float
    to_s: float
    text: str


def find_injected(scenario: Mapping[str, Any]) -> list[Injected]:
    """The faults of a scenario in the order of time, from its raw tables.

    >>> fault = {"kind": "sensor-stuck", "sensor": "striker", "at_s": 4.0, "duration_s": 0.5}
    >>> find_injected({"script": {"faults": [fault]}})
    [Injected(from_s=4.0, to_s=4.5, text='sensor-stuck (sensor striker)')]
    """
    return sorted(_describe(fault) for fault in scenario.get("script", {}).get("faults", []))


def _describe(fault: Mapping[str, Any]) -> Injected:
    given = [
        f"{key} {', '.join(map(str, value)) if isinstance(value, list) else value}"
        for key, value in fault.items()
        if key not in ("kind", "at_s", "duration_s")
    ]
    text = f"{fault['kind']} ({'; '.join(given)})" if given else str(fault["kind"])
    return Injected(fault["at_s"], fault["at_s"] + fault.get("duration_s", math.inf), text)


def timeline(faults: list[Injected], end_s: float) -> list[tuple[float, str]]:
    """The times in s at which the set of acting faults changes, with its description, to the run's end.

    >>> timeline([Injected(1.0, 3.0, "a"), Injected(2.0, math.inf, "b")], 9.0)
    [(0.0, 'none'), (1.0, 'a'), (2.0, 'a + b'), (3.0, 'b')]
    """
    edges = sorted({0.0, *(edge for fault in faults for edge in fault[:2] if edge <= end_s)})
    acting = [[one.text for one in faults if one.from_s <= edge < one.to_s] for edge in edges]
    return [(edge, " + ".join(texts) or NONE) for edge, texts in zip(edges, acting, strict=True)]
