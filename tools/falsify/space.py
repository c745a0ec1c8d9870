"""What a search varies of a scenario: the values, their ranges, and the scenario with each of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from hil.scenario.checks import Check
from hil.scenario.scenario import Scenario, check_scenario
from hil.scenario.seeds import shift_times
from hil.scenario.settings import apply_settings

DELAY = "delay_s"
"""The key that delays the first fault, or else the last command, and all that follows."""
IDLE = "idle_before_s"
"""The key of the time from an operator's IDLE to a fault that ends the motion; 0: no IDLE."""
TURNING_S = 1.2
"""Least time from RUN to this IDLE: the crank is fast enough to turn on until the fault."""
INSTANT = "instant_s"
"""The key that moves all disturbances of the default space together, so that they meet."""
SEED = "seed"
"""The key of a walk's seed, which samples its strides."""


@dataclass(frozen=True)
class Dimension:
    """One searched value: its key, its value in the scenario, and its range or its choices."""

    key: str
    default: Any
    low: float = 0.0
    high: float = 0.0
    choices: tuple[Any, ...] = ()

    @property
    def is_whole(self) -> bool:
        """Whether the values are whole numbers."""
        return isinstance(self.low, int) and isinstance(self.high, int)

    def value(self, share: float) -> Any:
        """The value at a place from 0 to 1 of its range."""
        if self.choices:
            return self.choices[min(int(share * len(self.choices)), len(self.choices) - 1)]
        if self.is_whole:
            return min(self.low + int(share * (self.high - self.low + 1)), self.high)
        return float(self.low + share * (self.high - self.low))

    @property
    def text(self) -> str:
        """The range in words."""
        if self.choices:
            return ", ".join(map(str, self.choices))
        return f"{self.low:.6g} … {self.high:.6g}"


@dataclass(frozen=True)
class Space:
    """A scenario, what a search varies in it, and the checks whose margins count, by their places."""

    name: str
    document: Mapping[str, Any]
    dimensions: tuple[Dimension, ...]
    chosen: tuple[int, ...]
    since_s: float = 0.0
    """The time from which `DELAY` delays."""
    optional: Mapping[str, tuple[int, str]] = field(default_factory=dict)
    """Lines of the script that are left out where a value is the default: list, place and key."""

    @cached_property
    def defaults(self) -> tuple[Any, ...]:
        """The scenario's own values."""
        return tuple(one.default for one in self.dimensions)

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """The chosen checks, with their limits in the unchanged scenario."""
        return tuple(self.scenario(self.defaults).checks[place] for place in self.chosen)

    @property
    def own_faults(self) -> int:
        """The number of the scenario's own faults; those of the default space follow."""
        added = sum(lines == "faults" for _, lines in self.optional.values())
        return len(self.document["script"].get("faults", [])) - added

    def values(self, place: Sequence[float]) -> tuple[Any, ...]:
        """The values at a place of the unit cube, one number for each dimension."""
        return tuple(one.value(share) for one, share in zip(self.dimensions, place, strict=True))

    def changed(self, values: Sequence[Any]) -> dict[str, Any]:
        """The values that differ from the scenario's own, by their keys; none of lines that are left out."""
        pairs = zip(self.dimensions, values, strict=True)
        found = {one.key: value for one, value in pairs if value != one.default}
        lines = ((key, f"script.{lines}.{n}.") for key, (n, lines) in self.optional.items())
        out = tuple(line for key, line in lines if key not in found)
        if IDLE in found:
            is_late = self.idle_at_s(found) >= self.asked_s + TURNING_S
            ended = (f"script.{lines}.{n}." for n, lines in self.optional.values() if lines == "commands")
            out = (*out, *ended) if is_late else (*out, IDLE)
        kept = {key: value for key, value in found.items() if not key.startswith(out)}
        if not self.optional.keys() & kept.keys():
            kept.pop(INSTANT, None)
        return kept

    @property
    def asked_s(self) -> float:
        """The time of the last command before the fault."""
        commands = self.document["script"]["commands"]
        return max(float(one["at_s"]) for one in commands if one["at_s"] < self.since_s)

    def idle_at_s(self, changed: Mapping[str, Any]) -> float:
        """The time of the operator's IDLE before the delayed fault."""
        return float(self.since_s + changed.get(DELAY, 0.0) - changed[IDLE])

    def kind_of(self, key: str) -> str:
        """The kind of the fault, or the request, to which a key of the script belongs; empty for others."""
        parts = key.split(".")
        if len(parts) < 4 or parts[0] != "script":
            return ""
        line = self.document["script"][parts[1]][int(parts[2])]
        return str(line.get("kind") or line["request"])

    def tables(self, values: Sequence[Any]) -> dict[str, Any]:
        """The scenario's tables with these values; lines of the script that change nothing are left out."""
        changed = self.changed(values)
        delay_s, instant_s = changed.get(DELAY, 0.0), changed.get(INSTANT, 0.0)
        seed = changed.get(SEED, self.document.get(SEED))
        keys = {key: value for key, value in changed.items() if key not in (DELAY, IDLE, INSTANT, SEED)}
        document = {**apply_settings(self.document, keys), SEED: seed}
        script = document["script"]
        for key, (place, lines) in reversed(list(self.optional.items())):
            if key in changed:
                script[lines][place]["at_s"] = round(script[lines][place]["at_s"] + instant_s, 6)
            else:
                del script[lines][place]
        document = shift_times(document, self.since_s, delay_s) if delay_s else document
        return with_idle(document, self.idle_at_s(changed)) if IDLE in changed else document

    def scenario(self, values: Sequence[Any]) -> Scenario:
        """The checked scenario with these values."""
        return check_scenario(self.tables(values), self.name)


def with_idle(document: dict[str, Any], at_s: float) -> dict[str, Any]:
    """The tables with an operator who asks for IDLE at a time, and for nothing afterwards."""
    earlier = [one for one in document["script"]["commands"] if one["at_s"] < at_s]
    commands = [*earlier, {"at_s": round(at_s, 6), "request": "idle"}]
    return {**document, "script": {**document["script"], "commands": commands}}
