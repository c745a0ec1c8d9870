"""The paper's fourteen claims, and the rule from the measured figures to the verdict of each.

A claim is `reproduced` if it holds as printed, `reproduced-under-parameters` if it holds for stated values
that the paper does not give or gives differently, and `contradicted` if it does not hold or holds only in
part. Each has parts, which are decided by measured figures; the reasons take every number and every finding
from the figures.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

from tools.output import figure
from tools.study.cases import LAWS, PRESETS
from tools.study.claims import measures
from tools.study.claims.evidence import Evidence

ONSET_LOW_R, ONSET_HIGH_R = 0.88, 1.1
"""0.9 to 1.1, with 0.02 for the word `near`."""
CLAIMED_LOW_HZ, CLAIMED_HIGH_HZ = 3.0, 5.0
FORCE_LOW_N, FORCE_HIGH_N = 10.0, 40.0
SAME_SHAPE = 0.98
"""Correlation above which two motions count as having the same shape."""
OTHER_SIZE = 0.01
"""Relative difference above which two amplitudes count as different."""
MOST_VARIATION = 0.05
MODERATE_TIMES = 2.0
"""Largest ratio of two energies that counts as moderately higher."""
LEAST_EXPONENT = 0.9
"""Smallest uncertainty exponent of a border that counts as smooth; a smooth border has 1."""
RESOLVED_VARIATION = 2e-3
"""Smallest variation that counts: what is left of the transient reaches 4e-4 after 30 s."""
CAPPED_GROWTH = 1.1
"""Largest growth of an impulse that counts as capped."""


REPRODUCED = "reproduced"
UNDER_PARAMETERS = "reproduced-under-parameters"
CONTRADICTED = "contradicted"

Figures = Mapping[str, Any]
Parts = Callable[[Figures], dict[str, bool]]


class Verdict(NamedTuple):
    """A verdict, and the reason with the figures that decided it."""

    verdict: str
    reason: str


@dataclass(frozen=True)
class Claim:
    """A claim. `parts` states its parts with the figures of `measure` alone, and whether each part holds.

    It is reproduced if all parts hold, reproduced under parameters if `partly` and some hold, and otherwise
    contradicted.
    """

    id: str
    statement: str
    measure: Callable[[Evidence], dict[str, Any]]
    parts: Parts
    partly: bool = False
    judgement: str = ""
    """Our own choices in the parts, which no measured number decides."""
    remark: str = ""
    """Background of the measurement, for the reader of the verdict."""

    def decide(self, found: Figures) -> Verdict:
        """Judge the figures by the rule; the reason states each part."""
        parts = self.parts(found)
        verdict = CONTRADICTED
        if all(parts.values()):
            verdict = REPRODUCED
        elif self.partly and any(parts.values()):
            verdict = UNDER_PARAMETERS
        stated = ""
        for words, which in (("Holds", True), ("Does not hold", False)):
            these = [part for part, holds in parts.items() if bool(holds) is which]
            stated += f"{words}: {'; '.join(these)}. " if these else ""
        return Verdict(verdict, f"{stated}{self.remark}".rstrip())

    def judge(self, evidence: Evidence) -> "JudgedClaim":
        """Measure the figures and judge the claim by its rule."""
        value = self.measure(evidence)
        verdict, reason = self.decide(value)
        return JudgedClaim(self.id, self.statement, self.judgement, verdict, value, reason)


@dataclass(frozen=True)
class JudgedClaim:
    """A claim with its verdict, the measured figures and the reason for the verdict."""

    id: str
    statement: str
    judgement: str
    verdict: str
    value: dict[str, Any]
    reason: str


CLAIMS: list[Claim] = []
"""All claims in order."""


def claim(
    name: str, measure: Callable[[Evidence], dict[str, Any]], **options: Any
) -> Callable[[Parts], Parts]:
    """Make a claim of a function of its parts, whose docstring is the claim's statement."""

    def add(parts: Parts) -> Parts:
        CLAIMS.append(Claim(name, parts.__doc__ or "", measure, parts, **options))
        return parts

    return add


def judge(evidence: Evidence) -> list[JudgedClaim]:
    """Measure and judge all claims in order."""
    return [one.judge(evidence) for one in CLAIMS]


def span(values: Iterable[float | None], unit: str = "") -> str:
    """Return the smallest and the greatest value as text; a dash for no values.

    >>> span([2.0, 1.0], "Hz")
    '1 to 2 Hz'
    """
    some = [value for value in values if value is not None] or [math.nan]
    return f"{figure(min(some))} to {figure(max(some), unit)}"


def by_preset(figures: Figures) -> dict[str, dict[str, float]]:
    """Return figures by preset and then by friction law."""
    return {preset: {law: figures[f"{preset} {law}"] for law in LAWS} for preset in PRESETS}


@claim(
    "C1",
    measures.three_regimes,
    partly=True,
    remark="Without impacts, dry friction holds the striker: μ m g approaches the drive's force c A.",
)
def three_regimes(found: Figures) -> dict[str, bool]:
    """Non-impact motion, impact motion and multistability exist for every friction law."""
    full, laws = found["with_all_three"], found["with_all_three_by_law"]
    counts = ", ".join(f"{law} {count}" for law, count in laws.items())
    return {
        f"all three regimes in each case (measured: {full} of {found['cases']})": full == found["cases"],
        f"all three regimes with each law in some case (measured: {counts})": all(laws.values()),
    }


@claim(
    "C2",
    measures.onset_ratio,
    partly=True,
    judgement="The word `near` is taken to mean within 0.02.",
    remark="Impacts begin where the non-impact motion just reaches the stop. This ratio falls with the "
    "drive amplitude A, which the paper does not give; the table has A for onsets at r = 1 and 0.9.",
)
def onset_ratio(found: Figures) -> dict[str, bool]:
    """In a run-up, impacts begin near Ω/ω = 0.9 to 1.1."""
    return {
        f"{preset}: with every law impacts begin near 0.9 to 1.1 (measured: {span(onsets.values())})": all(
            onset is not None and ONSET_LOW_R <= onset <= ONSET_HIGH_R for onset in onsets.values()
        )
        for preset, onsets in by_preset(found["onset_r"]).items()
    }


@claim(
    "C3",
    measures.onset_frequency,
    remark="The claim names Table 1, so no other values count. The preset `gait` has the spring that "
    "puts r = 1 at 4 Hz. The page docs/feasibility.md lists the crank frequencies for each cadence.",
)
def onset_frequency(found: Figures) -> dict[str, bool]:
    """The range Ω/ω = 0.9 to 1.1 is 3 to 5 Hz for the parameters of Table 1."""
    low, high = found["r_0.9_to_1.1_hz"]
    part = (
        f"r = 0.9 to 1.1 is within {span([CLAIMED_LOW_HZ, CLAIMED_HIGH_HZ], 'Hz')} (measured: "
        f"{span([low, high], 'Hz')}; r = 1 is √(c/m_B) = {figure(found['natural_hz'], 'Hz')})"
    )
    return {part: low >= CLAIMED_LOW_HZ and high <= CLAIMED_HIGH_HZ}


@claim(
    "C4",
    measures.widest_band,
    partly=True,
    remark="This covers Table 1's ranges of b and μ (Coulomb–Stribeck friction with the stiffer spring: "
    "only μ = 0.15), and one case with the same drive amplitude.",
)
def widest_band(found: Figures) -> dict[str, bool]:
    """Viscous friction gives the widest multistable interval."""
    parts = {}
    for preset, laws in found["least_and_greatest_width_r"].items():
        viscous, dry = laws["viscous"][0], max(laws["coulomb"][1], laws["stribeck"][1])
        part = f"{preset}: the narrowest viscous interval, {figure(viscous)} in r, exceeds {figure(dry)}"
        parts[f"{part}, the widest with dry friction"] = viscous > dry
    return parts


@claim(
    "C5",
    measures.sharper_switching,
    partly=True,
    judgement="The paper does not say by what measure the switching is sharper; both readings are ours.",
)
def sharper_switching(found: Figures) -> dict[str, bool]:
    """Coulomb and Coulomb–Stribeck friction switch more sharply between regimes."""
    hysteresis = by_preset(found["hysteresis_r"]).values()
    lost = by_preset(found["impact_lost_at_the_fold_m_s"]).values()
    return {
        "dry friction has less hysteresis between run-up and run-down": all(
            one["viscous"] > max(one["coulomb"], one["stribeck"]) for one in hysteresis
        ),
        "dry friction loses faster impacts at the end of the impact motion": all(
            None not in one.values() and one["viscous"] < min(one["coulomb"], one["stribeck"]) for one in lost
        ),
    }


@claim(
    "C6",
    measures.same_shape,
    partly=True,
    judgement="The correlation of 0.98 for the same shape and the 1 % for another amplitude are ours.",
    remark="The position over a cycle, normalised to zero mean and unit variance, is compared between "
    "any two laws at r = 1.1 (impact) and 1.5 (non-impact).",
)
def same_shape(found: Figures) -> dict[str, bool]:
    """Attractors keep their shape across friction laws; amplitudes differ."""
    correlations = found["least_correlation_of_x_over_a_cycle"]
    sizes = found["viscous_coulomb_stribeck_peak_to_peak_mm"]
    parts = {}
    for preset in PRESETS:
        names = (f"{preset} impact", f"{preset} non-impact")
        least = min(correlations[name] for name in names)
        growth = max(max(sizes[name]) / min(sizes[name]) for name in names)
        part = (
            f"{preset}: same shapes, but strokes that differ (measured: correlations from {figure(least)} on"
        )
        parts[f"{part}, strokes by up to {100.0 * (growth - 1.0):.1f} %)"] = (
            least > SAME_SHAPE and growth > 1.0 + OTHER_SIZE
        )
    return parts


@claim(
    "C7",
    measures.peak_force,
    partly=True,
    remark="Newton's rigid stop has no finite peak force; it depends on the contact time, which the "
    "paper does not give. The table has the peaks on a Hunt–Crossley stop for elastic contact times of "
    "10, 30 and 50 ms (at 0.9 m/s, k = 0.5, b = 0.2 N s/m, run-up), and the contact times for 40 N (a "
    "dash: none up to 150 ms). The page docs/feasibility.md has the force that a walking wearer feels.",
)
def peak_force(found: Figures) -> dict[str, bool]:
    """Impulses have peak forces of 10 to 40 N."""
    peaks = [peak for row in found["peak_n"].values() for peak in row.values() if math.isfinite(peak)]
    inside = sum(FORCE_LOW_N <= peak <= FORCE_HIGH_N for peak in peaks)
    return {
        f"every peak is within 10 to 40 N (measured: {span(peaks, 'N')})": 0 < len(peaks) == inside,
        f"some peak is within 10 to 40 N (measured: {inside} of {len(peaks)})": inside > 0,
    }


@claim(
    "C8",
    measures.repeatability,
    judgement="Impact motion with the drive's period is taken as the stable impact regime.",
    remark="The model has no noise, so this is the rest of the transient after 30 s; the variation that "
    "sensors and wearers add is not in it. All others have longer periods or are irregular.",
)
def repeatability(found: Figures) -> dict[str, bool]:
    """In the stable impact regime impulses vary by less than 5 % from cycle to cycle."""
    greatest, motions = found["greatest_variation"], found["motions_with_one_period"]
    return {
        f"impulses vary by less than 5 % (measured: by at most {figure(greatest)} in {motions} impact "
        "motions with the drive's period)": greatest is not None and greatest < MOST_VARIATION
    }


@claim(
    "C9",
    measures.energy,
    judgement="The factor of two for `moderately` is ours.",
    remark="At 0.5 m/s, b v is 0.1 N, while μ m g is 1.2 N.",
)
def energy(found: Figures) -> dict[str, bool]:
    """Energy per cycle: non-impact lowest, impact moderately higher, viscous friction highest."""
    pairs = found["same_ratio"].values()
    times = [pair["times"] for pair in pairs]
    friction_mj = [
        {law: one["friction_mj"] for law, one in laws.items()} for laws in found["impact_at_r_1.1"].values()
    ]
    return {
        "non-impact motion takes the least energy": bool(pairs)
        and all(pair["non_impact_mj"] < pair["impact_mj"] for pair in pairs),
        f"impact motion takes moderately more at the same ratio (measured: {span(times)} times)": bool(times)
        and max(times) <= MODERATE_TIMES,
        "viscous friction dissipates the most": all(
            one["viscous"] > max(one["coulomb"], one["stribeck"]) for one in friction_mj
        ),
    }


@claim(
    "C10",
    measures.smooth_basins,
    partly=True,
    judgement="The exponent of 0.9 above which a border counts as smooth is ours.",
    remark="The exponent of a smooth border is 1. If the entropy of boxes on the border exceeds "
    "ln 2 = 0.693, the border must be fractal.",
)
def smooth_basins(found: Figures) -> dict[str, bool]:
    """In the multistable band there are two attractors, with a smooth border between their basins."""
    return {
        f"{law}: {one['motions']} motions, border of exponent {figure(one['uncertainty_exponent'])} and "
        f"entropy {figure(one['border_entropy'])}": one["motions"] == 2
        and one["border_entropy"] < math.log(2.0)
        and one["uncertainty_exponent"] > LEAST_EXPONENT
        for law, one in found.items()
    }


@claim(
    "C11",
    measures.start_decides,
    partly=True,
    remark="The striker starts at rest; the crank turns at full speed at once, or its speed rises.",
)
def start_decides(found: Figures) -> dict[str, bool]:
    """The state at start-up decides; an initialisation routine ensures the wanted motion."""
    at_once, after = found["impact_share_from_rest_at_once"], found["impact_share_after_a_run_up"]
    slow = {name.removesuffix(", 5 s"): share for name, share in after.items() if name.endswith(", 5 s")}
    return {
        f"{name}: the run-up leads from all crank angles to impacts (share {figure(share)}), a start at "
        f"once does not ({figure(at_once[name])})": at_once[name] < share == 1.0
        for name, share in slow.items()
    }


@claim(
    "C12",
    measures.gait_frequencies,
    partly=True,
    judgement="That a frequency with impacts suits a walk, the paper asserts and no figure here decides.",
    remark="A crank with n turns per stride serves slow and fast walking at nearly the same crank "
    "frequency (docs/feasibility.md).",
)
def gait_frequencies(found: Figures) -> dict[str, bool]:
    """2 to 3 Hz suits slow walking, 3 to 5 Hz normal cadence, 6 Hz risks losing the impacts."""
    suits = {
        preset: all(motion[f"{hz:g} Hz"] != measures.NO_START for hz in measures.CLAIMED_HZ if hz <= 5.0)
        and motion["6 Hz"] != measures.EVERY_START
        for preset, motion in found["motion"].items()
    }
    factors = span(high / low for low, high in found["impact_in_a_run_up_hz"].values())
    return {
        "Table 1's module has impacts from some start at each of 2 to 5 Hz, a factor of 2.5 (in a run-up "
        f"they span a factor of {factors}), and can lose them at 6 Hz": suits["table1"],
        "one of the two modules has such impacts and can lose them": any(suits.values()),
    }


@claim(
    "C13",
    measures.damping,
    remark="On a Hunt–Crossley stop of 30 ms, from b = 0.1 to 0.3 N s/m. The model has no noise; changes "
    "of the variation below 0.002 are the rest of the transient and do not count.",
)
def damping(found: Figures) -> dict[str, bool]:
    """More damping lowers the peak acceleration but raises variability."""
    peaks = [list(row.values()) for row in found["peak_acceleration_m_s2"].values()]
    changes = [100.0 * (1.0 - row[-1] / row[0]) for row in peaks]
    variation = list(found["greatest_variation_of_impulses"].values())
    change = variation[-1] - variation[0]
    shown = "by less" if abs(change) <= RESOLVED_VARIATION else f"by {figure(change)}, more"
    return {
        f"the peak acceleration falls at every ratio (measured: by {span(changes, '%')})": all(
            row[0] > row[-1] for row in peaks
        ),
        f"the variation of the impulses rises (measured: it changes {shown} than {RESOLVED_VARIATION:g})": (
            change > RESOLVED_VARIATION
        ),
    }


@claim(
    "C14",
    measures.caps,
    judgement="The 10 % within which an impulse counts as capped are ours.",
    remark="The impulse is (1 + k) m v⁻, and v⁻ follows from the drive.",
)
def caps(found: Figures) -> dict[str, bool]:
    """Restitution and stop position cap the impulse, a safety layer independent of control."""
    growth = {}
    for name in ("amplitude", "ratio", "k", "stop"):
        impulses = found[f"impulse_over_{name}_n_s"].values()
        growth[name] = max(impulses) / min(impulses)
    times = ", ".join(f"{figure(factor)} with {name}" for name, factor in growth.items())
    capped = max(growth["amplitude"], growth["ratio"]) <= CAPPED_GROWTH
    return {f"k and the stop cap the impulse (measured: it changes by the factors {times})": capped}
