"""The paper's fourteen claims, each with the rule that computes its verdict from measured figures.

A claim is `reproduced` if it holds as printed, `reproduced-under-parameters` if it holds for stated values
that the paper does not give or gives differently, and `contradicted` if it does not hold or holds only in
part. The reasons take every number and every finding from the figures.
"""

import math
from collections.abc import Iterable, Mapping

from tools.output import figure
from tools.study.cases import LAWS, PRESETS
from tools.study.claims import measures
from tools.study.claims.claim import Claim, Figures, JudgedClaim, Verdict, verdict_of
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
"""Smallest variation that counts: what is left of the transient reaches 1.2e-3 after 30 s."""
CAPPED_GROWTH = 1.1
"""Largest growth of an impulse that counts as capped."""


def judge(evidence: Evidence) -> list[JudgedClaim]:
    """Measure and judge all claims in order."""
    return [claim.judge(evidence) for claim in CLAIMS]


def holds(condition: bool) -> str:
    """Return the verb of a part of a claim."""
    return "holds" if condition else "does not hold"


def span(values: Iterable[float], unit: str = "") -> str:
    """Return the smallest and the greatest value as text.

    >>> span([2.0, 1.0], "Hz")
    '1 to 2 Hz'
    """
    some = list(values)
    return f"{figure(min(some))} to {figure(max(some), unit)}"


def by_preset(figures: Mapping[str, float], preset: str) -> dict[str, float]:
    """Return one preset's figures by friction law."""
    return {law: figures[f"{preset} {law}"] for law in LAWS}


def three_regimes(found: Figures) -> Verdict:
    """Judge C1: all three regimes with every friction law."""
    laws, none = found["with_all_three_by_law"], found["without_impacts"]
    verdict = verdict_of(found["with_all_three"] == found["cases"], all(laws.values()))
    missing = [law for law, count in laws.items() if not count]
    reason = f"All three regimes exist in {found['with_all_three']} of {found['cases']} cases"
    reason += f", but in none with {', '.join(missing)} friction." if missing else ", and with every law."
    if none:
        reason += (
            f" {len(none)} cases have no impacts: dry friction holds the striker where μ m g approaches the "
            "drive's force c A."
        )
    return Verdict(verdict, reason)


def onset_ratio(found: Figures) -> Verdict:
    """Judge C2: the ratio at which impacts begin."""
    onsets = {preset: by_preset(found["onset_r"], preset) for preset in PRESETS}
    inside = [
        preset
        for preset, laws in onsets.items()
        if all(onset is not None and ONSET_LOW_R <= onset <= ONSET_HIGH_R for onset in laws.values())
    ]
    measured = "; ".join(
        f"{preset} {span([onset for onset in laws.values() if onset is not None] or [math.nan])}"
        for preset, laws in onsets.items()
    )
    return Verdict(
        verdict_of(len(inside) == len(PRESETS), bool(inside)),
        f"Impacts begin at r = {measured}; near 0.9 to 1.1 with every law: {', '.join(inside) or 'none'}. "
        "They begin at the ratio at which the non-impact motion just reaches the stop. This ratio depends on "
        "the drive amplitude A, which the paper does not give; a larger amplitude lowers it. The table lists "
        "the amplitudes for an onset at r = 1 and at r = 0.9.",
    )


def onset_frequency(found: Figures) -> Verdict:
    """Judge C3: the frequencies of r = 0.9 to 1.1."""
    low, high = found["r_0.9_to_1.1_hz"]
    inside = low >= CLAIMED_LOW_HZ and high <= CLAIMED_HIGH_HZ
    return Verdict(
        verdict_of(inside),
        f"√(c/m_B) of Table 1 is {figure(found['natural_hz'], 'Hz')}, so r = 0.9 to 1.1 is "
        f"{span([low, high], 'Hz')}, which {'lies' if inside else 'does not lie'} within "
        f"{span([CLAIMED_LOW_HZ, CLAIMED_HIGH_HZ], 'Hz')}. r = 1 is 4 Hz with a spring of "
        f"{figure(found['spring_for_4_hz_n_m'], 'N/m')} or a striker of "
        f"{figure(found['mass_for_4_hz_kg'], 'kg')}; the preset `gait` has this spring. The page "
        "docs/feasibility.md lists the crank frequencies that suit each cadence of a walk.",
    )


def widest_band(found: Figures) -> Verdict:
    """Judge C4: the law with the widest multistable interval."""
    wider, text = [], []
    for preset, laws in found["least_and_greatest_width_r"].items():
        viscous, dry = laws["viscous"][0], max(laws["coulomb"][1], laws["stribeck"][1])
        wider.append(viscous > dry)
        text.append(f"{preset}: {figure(viscous)} against {figure(dry)}")
    return Verdict(
        verdict_of(all(wider), any(wider)),
        "The narrowest multistable interval with viscous friction against the widest with dry friction, in "
        f"r: {'; '.join(text)}. This covers Table 1's ranges of b and μ (Coulomb–Stribeck friction with the "
        "stiffer spring: only μ = 0.15), and one case with the same drive amplitude.",
    )


def sharper_switching(found: Figures) -> Verdict:
    """Judge C5: the sharpness of the switching between regimes."""
    less, larger = [], []
    for preset in PRESETS:
        hysteresis = by_preset(found["hysteresis_r"], preset)
        less.append(hysteresis["viscous"] > max(hysteresis["coulomb"], hysteresis["stribeck"]))
        jumps = by_preset(found["impact_lost_at_the_fold_m_s"], preset)
        known = [jump for jump in jumps.values() if jump is not None]
        larger.append(
            len(known) == len(jumps) and jumps["viscous"] < min(jumps["coulomb"], jumps["stribeck"])
        )
    return Verdict(
        verdict_of(all(less) and all(larger), all(less) or all(larger)),
        "Two readings were measured. That dry friction has less hysteresis between run-up and run-down "
        f"{holds(all(less))}; that it loses faster impacts at the end of the impact motion "
        f"{holds(all(larger))}.",
    )


def same_shape(found: Figures) -> Verdict:
    """Judge C6: the shape of the attractors with different laws."""
    correlations = found["least_correlation_of_x_over_a_cycle"]
    alike = [name for name, correlation in correlations.items() if correlation > SAME_SHAPE]
    sizes = found["viscous_coulomb_stribeck_peak_to_peak_mm"]
    other = [name for name, some in sizes.items() if max(some) > (1.0 + OTHER_SIZE) * min(some)]
    whole = [
        preset
        for preset in PRESETS
        if {f"{preset} impact", f"{preset} non-impact"} <= set(alike)
        and any(name in other for name in (f"{preset} impact", f"{preset} non-impact"))
    ]
    return Verdict(
        verdict_of(len(whole) == len(PRESETS), bool(whole)),
        "The position over a cycle, normalised to zero mean and unit variance, is compared between any two "
        f"laws at r = 1.1 (impact) and 1.5 (non-impact). The correlation is above {figure(SAME_SHAPE)} for: "
        f"{', '.join(alike) or 'none'}. The strokes differ by more than {100.0 * OTHER_SIZE:g} % for: "
        f"{', '.join(other) or 'none'}.",
    )


def peak_force(found: Figures) -> Verdict:
    """Judge C7: the peak force of impacts."""
    peaks = [peak for row in found["peak_n"].values() for peak in row.values() if math.isfinite(peak)]
    inside = sum(FORCE_LOW_N <= peak <= FORCE_HIGH_N for peak in peaks)
    return Verdict(
        verdict_of(0 < len(peaks) == inside, inside > 0),
        f"{inside} of {len(peaks)} measured peaks are within 10 to 40 N; they range over "
        f"{span(peaks or [math.nan], 'N')}. Newton's rigid stop has no finite peak force. The peak force "
        "depends on the contact time, which the paper does not give. The table lists the peak force on a "
        "Hunt–Crossley stop for elastic contact times of 10, 30 and 50 ms (at 0.9 m/s, k = 0.5, "
        "b = 0.2 N s/m, run-up), and the contact times for a peak of 40 N (a dash: none up to 150 ms). The "
        "page docs/feasibility.md has the force that a walking wearer feels.",
    )


def repeatability(found: Figures) -> Verdict:
    """Judge C8: the variation of impulses from cycle to cycle."""
    greatest, share = found["greatest_variation"], found["share_of_those_below_5_percent"]
    others = "" if share is None else f"; {100.0 * share:.0f} % of them vary by less than 5 %"
    return Verdict(
        verdict_of(greatest is not None and greatest < MOST_VARIATION),
        f"{found['motions_with_one_period']} impact motions have the drive's period; their impulses vary by "
        f"at most {figure(greatest)}. The model has no noise, so this is the rest of the transient after "
        f"30 s. {found['other_impact_motions']} impact motions have longer periods or are irregular{others}. "
        "The paper's model does not include the variation that sensors and wearers add.",
    )


def energy(found: Figures) -> Verdict:
    """Judge C9: the energy per cycle."""
    pairs = found["same_ratio"].values()
    lowest = bool(pairs) and all(pair["non_impact_mj"] < pair["impact_mj"] for pair in pairs)
    times = [pair["times"] for pair in pairs]
    moderate = bool(times) and max(times) <= MODERATE_TIMES
    highest = all(
        laws["viscous"]["friction_mj"] > max(laws["coulomb"]["friction_mj"], laws["stribeck"]["friction_mj"])
        for laws in found["impact_at_r_1.1"].values()
    )
    return Verdict(
        verdict_of(lowest and moderate and highest),
        f"That non-impact motion takes the least energy {holds(lowest)}. That impact motion takes moderately "
        f"more at the same ratio {holds(moderate)}: it takes {span(times or [math.nan])} times as much. That "
        f"viscous friction dissipates the most {holds(highest)}. At 0.5 m/s, b v is 0.1 N, while μ m g is "
        "1.2 N.",
    )


def smooth_basins(found: Figures) -> Verdict:
    """Judge C10: the number of attractors and the border between their basins."""
    smooth = {
        law: one["motions"] == 2
        and one["border_entropy"] < math.log(2.0)
        and one["uncertainty_exponent"] > LEAST_EXPONENT
        for law, one in found.items()
    }
    text = "; ".join(
        f"{law}: {one['motions']} motions, exponent {figure(one['uncertainty_exponent'])}, entropy "
        f"{figure(one['border_entropy'])}"
        for law, one in found.items()
    )
    return Verdict(
        verdict_of(all(smooth.values()), any(smooth.values())),
        f"In the middle of the multistable band above resonance, {text}. The uncertainty exponent of a "
        "smooth border is 1. If the entropy of boxes on the border exceeds ln 2 = 0.693, the border must be "
        "fractal.",
    )


def start_decides(found: Figures) -> Verdict:
    """Judge C11: the effect of the state at start-up, and of a run-up."""
    at_once, after = found["impact_share_from_rest_at_once"], found["impact_share_after_a_run_up"]
    slow = {name.removesuffix(", 5 s"): share for name, share in after.items() if name.endswith(", 5 s")}
    decides = [name for name, share in slow.items() if at_once[name] < share]
    ensured = [name for name in decides if slow[name] == 1.0]
    lost = ", ".join(f"{name}: {figure(at_once[name])}" for name in slow)
    ramped = ", ".join(f"{name}: {figure(share)}" for name, share in slow.items())
    return Verdict(
        verdict_of(len(ensured) == len(slow), bool(ensured)),
        "Share of the initial crank angles from which a striker at rest reaches impact motion. If the crank "
        f"starts at full speed: {lost}. If its speed rises from standstill within 5 s: {ramped}. The run-up "
        f"ensures impacts that a start at once does not in {len(ensured)} of {len(slow)} cases.",
    )


def gait_frequencies(found: Figures) -> Verdict:
    """Judge C12: the frequencies for slow and normal walking."""
    parts: dict[str, list[bool]] = {}
    for preset, motion in found["motion"].items():
        reached = {float(name.removesuffix(" Hz")): one != measures.NO_START for name, one in motion.items()}
        parts[preset] = [
            all(on for hz, on in reached.items() if 2.0 <= hz <= 3.0),
            all(on for hz, on in reached.items() if 3.0 <= hz <= 5.0),
            motion["6 Hz"] != measures.EVERY_START,
        ]
    text = " ".join(
        f"{preset}: impacts from some start at each of 2 to 3 Hz: {figure(slow)}, at each of 3 to 5 Hz: "
        f"{figure(normal)}; impacts can be lost at 6 Hz: {figure(fast)}."
        for preset, (slow, normal, fast) in parts.items()
    )
    wide = [high / low for low, high in found["impact_in_a_run_up_hz"].values()]
    return Verdict(
        verdict_of(all(parts["table1"]), any(all(one) for one in parts.values())),
        f"{text} In a run-up, the interval with impacts spans a factor of {span(wide or [math.nan])} in "
        "frequency; 2 to 5 Hz is a factor of 2.5. A crank with n turns per stride serves slow and fast "
        "walking at nearly the same crank frequency (docs/feasibility.md).",
    )


def damping(found: Figures) -> Verdict:
    """Judge C13: the effect of damping on peak acceleration and variability."""
    peaks = [list(row.values()) for row in found["peak_acceleration_m_s2"].values()]
    falls = all(row[0] > row[-1] for row in peaks)
    changes = [100.0 * (1.0 - row[-1] / row[0]) for row in peaks]
    variation = list(found["greatest_variation_of_impulses"].values())
    rises = variation[-1] - variation[0] > RESOLVED_VARIATION
    return Verdict(
        verdict_of(falls and rises),
        "On a Hunt–Crossley stop of 30 ms, from b = 0.1 to 0.3 N s/m: the peak acceleration falls at every "
        f"ratio: {figure(falls)} (by {span(changes, '%')}); the variation of the impulses rises: "
        f"{figure(rises)} (from {figure(variation[0])} to {figure(variation[-1])}; changes below "
        f"{figure(RESOLVED_VARIATION)} are the rest of the transient). The model has no noise.",
    )


def caps(found: Figures) -> Verdict:
    """Judge C14: whether restitution and stop position limit the impulse."""
    growth = {
        name: max(found[f"impulse_over_{name}_n_s"].values())
        / min(found[f"impulse_over_{name}_n_s"].values())
        for name in ("amplitude", "ratio", "k", "stop")
    }
    capped = max(growth["amplitude"], growth["ratio"]) <= CAPPED_GROWTH
    return Verdict(
        verdict_of(capped),
        f"At fixed k and x_stop the impulse changes by a factor of {figure(growth['amplitude'])} with the "
        f"drive amplitude and of {figure(growth['ratio'])} with the speed ratio: k and x_stop "
        f"{'cap' if capped else 'do not cap'} it. It changes by a factor of {figure(growth['k'])} with k "
        f"from 0.4 to 0.6, and of {figure(growth['stop'])} with the stop from 0.16 to 0.2 m. The impulse is "
        "(1 + k) m v⁻, and v⁻ follows from the drive.",
    )


CLAIMS = (
    Claim(
        "C1",
        "Non-impact motion, impact motion and multistability exist for every friction law.",
        "Reproduced if every case has all three; under parameters if each law has a case with all three.",
        measures.three_regimes,
        three_regimes,
    ),
    Claim(
        "C2",
        "In a run-up, impacts begin near Ω/ω = 0.9 to 1.1.",
        "Reproduced if both modules have onsets of 0.88 to 1.1 with every law; under parameters if one has.",
        measures.onset_ratio,
        onset_ratio,
        "The word `near` is taken to mean within 0.02.",
    ),
    Claim(
        "C3",
        "The range Ω/ω = 0.9 to 1.1 is 3 to 5 Hz for the parameters of Table 1.",
        "Reproduced if the range lies within 3 to 5 Hz. The claim names Table 1, so no other values count.",
        measures.onset_frequency,
        onset_frequency,
    ),
    Claim(
        "C4",
        "Viscous friction gives the widest multistable interval.",
        "Reproduced if the narrowest viscous interval exceeds the widest dry one with both springs; under "
        "parameters if it does with one.",
        measures.widest_band,
        widest_band,
    ),
    Claim(
        "C5",
        "Coulomb and Coulomb–Stribeck friction switch more sharply between regimes.",
        "Reproduced if dry friction has both less hysteresis and a faster last impact with both springs; "
        "under parameters if it has one of the two.",
        measures.sharper_switching,
        sharper_switching,
        "The paper does not say by what measure the switching is sharper; both readings are ours.",
    ),
    Claim(
        "C6",
        "Attractors keep their shape across friction laws; amplitudes differ.",
        "Reproduced if, with both springs, both motions have correlations above 0.98 and a stroke differs "
        "by more than 1 %; under parameters if this is so with one spring.",
        measures.same_shape,
        same_shape,
        "The correlation of 0.98 for the same shape and the 1 % for another amplitude are ours.",
    ),
    Claim(
        "C7",
        "Impulses have peak forces of 10 to 40 N.",
        "Reproduced if every measured peak is within 10 to 40 N; under parameters if some are.",
        measures.peak_force,
        peak_force,
    ),
    Claim(
        "C8",
        "In the stable impact regime impulses vary by less than 5 % from cycle to cycle.",
        "Reproduced if every impact motion with the drive's period varies by less than 5 %.",
        measures.repeatability,
        repeatability,
        "Impact motion with the drive's period is taken as the stable impact regime.",
    ),
    Claim(
        "C9",
        "Energy per cycle: non-impact lowest, impact moderately higher, viscous friction highest.",
        "Reproduced if all three parts hold; moderately higher is at most twice as much.",
        measures.energy,
        energy,
        "The factor of two for `moderately` is ours.",
    ),
    Claim(
        "C10",
        "In the multistable band there are two attractors, with a smooth border between their basins.",
        "Reproduced if there are two motions, the border's entropy is below ln 2 and its exponent above 0.9, "
        "with both laws; under parameters with one.",
        measures.smooth_basins,
        smooth_basins,
        "The exponent of 0.9 that counts as near 1 is ours.",
    ),
    Claim(
        "C11",
        "The state at start-up decides; an initialisation routine ensures the wanted motion.",
        "Reproduced if, in every case, a run-up of 5 s reaches impacts from all crank angles and a start at "
        "once does not; under parameters if this is so in some.",
        measures.start_decides,
        start_decides,
    ),
    Claim(
        "C12",
        "2 to 3 Hz suits slow walking, 3 to 5 Hz normal cadence, 6 Hz risks losing the impacts.",
        "Reproduced if Table 1's module has impacts from some start at each listed frequency of 2 to 5 Hz, "
        "and not from every start at 6 Hz; under parameters if the retuned module does.",
        measures.gait_frequencies,
        gait_frequencies,
        "That a frequency with impacts suits a walk, the paper asserts and no figure here decides.",
    ),
    Claim(
        "C13",
        "More damping lowers the peak acceleration but raises variability.",
        "Reproduced if the peak falls from the least to the greatest b at every ratio, and the variation "
        "rises by more than 0.002.",
        measures.damping,
        damping,
    ),
    Claim(
        "C14",
        "Restitution and stop position cap the impulse, a safety layer independent of control.",
        "Reproduced if at fixed k and x_stop the impulse changes by at most 10 % with amplitude and speed.",
        measures.caps,
        caps,
        "The 10 % within which an impulse counts as capped are ours.",
    ),
)
