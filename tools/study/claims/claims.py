"""The paper's claims, each with a measured verdict.

A claim is `reproduced` if it holds as printed, `reproduced-under-parameters` if it holds for stated values
that the paper does not give or gives differently, and `contradicted` if it does not hold or holds only in
part.
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from plant_sim.orbits.sections import PAPER
from tools.study.cases import LAWS, PRESETS, case
from tools.study.claims.claim import CONTRADICTED, REPRODUCED, Claim, in_hz, nominal, per_law
from tools.study.claims.evidence import (
    CONTACTS_S,
    SOFT_RATIOS,
    Evidence,
    cycle_shape,
    grazing_amplitude_m,
    least_correlation,
)
from tools.study.claims.start_claims import caps, damping, gait_frequencies, smooth_basins, start_decides
from tools.study.intervals import width
from tools.study.orbits import follow
from tools.study.sweep import Diagram, end_state

UNDER_PARAMETERS = "reproduced-under-parameters"


FORCE_LOW_N, FORCE_HIGH_N = 10.0, 40.0

SAME_SHAPE = 0.98
"""Correlation above which two motions count as having the same shape."""

FEWEST_BAND = 1e-3
"""Smallest width in r of a multistable band."""


def judge(evidence: Evidence) -> list[Claim]:
    """Judge all claims in order."""
    claims: list[Callable[[Evidence], Claim]] = [
        three_regimes,
        onset_ratio,
        onset_frequency,
        widest_band,
        sharper_switching,
        same_shape,
        peak_force,
        repeatability,
        energy,
        smooth_basins,
        start_decides,
        gait_frequencies,
        damping,
        caps,
    ]
    return [claim(evidence) for claim in claims]


def three_regimes(evidence: Evidence) -> Claim:
    """Judge C1: the existence of all three regimes for every friction law."""
    full = [d for d in evidence.diagrams if width(d.multistable()) > FEWEST_BAND and d.onset() is not None]
    never = [d for d in evidence.diagrams if d.onset() is None]
    laws = {law: sum(d.case.law == law for d in full) for law in LAWS}
    return Claim(
        "C1",
        "Non-impact motion, impact motion and multistability exist for every friction law.",
        UNDER_PARAMETERS if all(laws.values()) else CONTRADICTED,
        {
            "cases": len(evidence.diagrams),
            "with_all_three": len(full),
            "with_all_three_by_law": laws,
            "without_impacts": [f"{d.case.preset} {d.case.label}" for d in never],
        },
        "This holds for every law if the drive is strong enough. With Table 1's soft spring and A = 30 mm, "
        "dry friction in the upper part of Table 1's range prevents the striker from reaching the stop, "
        "because μ m g approaches c A = 2.1 N. With a stiffer spring (505 N/m, A = 12 mm) all cases have "
        "impacts.",
    )


def onset_ratio(evidence: Evidence) -> Claim:
    """Judge C2: the ratio at which impacts begin."""
    onsets = per_law(nominal(evidence), Diagram.onset)
    gait = [onset for name, onset in onsets.items() if name.startswith("gait")]
    amplitudes = {
        f"{preset} {law}": [
            1e3 * grazing_amplitude_m(case(preset, law), 1.0),
            1e3 * grazing_amplitude_m(case(preset, law), 0.9),
        ]
        for preset in PRESETS
        for law in ("viscous", "coulomb")
    }
    near = all(onset is not None and 0.88 <= onset <= 1.1 for onset in gait)
    return Claim(
        "C2",
        "In a run-up, impacts begin near Ω/ω = 0.9 to 1.1.",
        UNDER_PARAMETERS if near else CONTRADICTED,
        {"onset_r": onsets, "amplitude_for_onset_at_r_1_and_r_0.9_mm": amplitudes},
        "Impacts begin at the ratio at which the non-impact motion just reaches the stop. This ratio depends "
        "on the drive amplitude A, which the paper does not give. The table lists the amplitudes for an "
        "onset at r = 1 and at r = 0.9; a larger amplitude moves it below 0.9. No amplitude moves the onset "
        "of a run-up above r = 1, because the amplitude of the non-impact motion is largest there.",
    )


def onset_frequency(evidence: Evidence) -> Claim:
    """Judge C3: the frequency at which impacts begin."""
    found = nominal(evidence)
    onset_hz = per_law(found, lambda d: in_hz(d, d.onset()))
    table1 = case("table1", "viscous")
    natural_hz = table1.natural_rad_s / (2.0 * math.pi)
    return Claim(
        "C3",
        "The range Ω/ω = 0.9 to 1.1 is 3 to 5 Hz for the parameters of Table 1.",
        CONTRADICTED,
        {
            "natural_hz": natural_hz,
            "r_0.9_to_1.1_hz": [0.9 * natural_hz, 1.1 * natural_hz],
            "onset_hz": onset_hz,
            "spring_for_4_hz_n_m": table1.mass_kg * (2.0 * math.pi * 4.0) ** 2,
            "mass_for_4_hz_kg": table1.spring_n_m / (2.0 * math.pi * 4.0) ** 2,
        },
        "√(c/m_B) of Table 1 is 9.35 rad/s or 1.49 Hz. Therefore r = 0.9 to 1.1 is 1.34 to 1.64 Hz, and 2 to "
        "8 Hz is r = 1.34 to 5.37. With a spring of about 505 N/m (or a striker of 0.11 kg) r = 1 is 4 Hz, "
        "and text and table agree; the preset `gait` has this spring. The page docs/feasibility.md lists the "
        "crank frequencies that suit each cadence of a walk.",
    )


def widest_band(evidence: Evidence) -> Claim:
    """Judge C4: the law with the widest multistable interval."""
    bands = {
        f"{d.case.preset} {d.case.label}, A = {1e3 * d.case.amplitude_m:g} mm": width(d.multistable())
        for d in evidence.diagrams
        if d.onset() is not None
    }
    widest = {
        preset: {
            law: [
                f(
                    width(d.multistable())
                    for d in evidence.diagrams
                    if (d.case.preset, d.case.law) == (preset, law) and d.onset() is not None
                )
                for f in (min, max)
            ]
            for law in LAWS
        }
        for preset in PRESETS
    }
    holds = all(one["viscous"][0] > max(one["coulomb"][1], one["stribeck"][1]) for one in widest.values())
    return Claim(
        "C4",
        "Viscous friction gives the widest multistable interval.",
        REPRODUCED if holds else CONTRADICTED,
        {"least_and_greatest_width_r": widest, "width_r": bands},
        "The narrowest multistable interval with viscous friction is wider than the widest interval with dry "
        "friction. This holds with Table 1's spring and with the stiffer spring, over Table 1's ranges of b "
        "and μ (Coulomb–Stribeck friction with the stiffer spring: only μ = 0.15), and also with the same "
        "drive amplitude. Dry friction dissipates several times as much energy per cycle, and the impact "
        "motion ends at a lower ratio.",
    )


def sharper_switching(evidence: Evidence) -> Claim:
    """Judge C5: the sharpness of the switching between regimes."""
    found = nominal(evidence)
    bands = per_law(found, lambda d: width(d.multistable()))
    irregular = per_law(
        found, lambda d: float(np.mean([r == "uncertain" for r in d.up.table["regime"].to_pylist()]))
    )
    jumps = per_law(found, _jump)
    holds = all(
        bands[f"{preset} viscous"] > max(bands[f"{preset} coulomb"], bands[f"{preset} stribeck"])
        for preset in PRESETS
    )
    return Claim(
        "C5",
        "Coulomb and Coulomb–Stribeck friction switch more sharply between regimes.",
        UNDER_PARAMETERS if holds else CONTRADICTED,
        {
            "hysteresis_r": bands,
            "impact_lost_at_the_fold_m_s": jumps,
            "share_of_ratios_without_settled_motion": irregular,
        },
        "This holds in the sense that the ratios at which run-up and run-down switch are closer to each "
        "other (less hysteresis), which is the same statement as C4. With all three laws each switch is a "
        "jump: at the fold the impacts end at their full approach speed, which is larger with viscous "
        "friction.",
    )


def _jump(diagram: Diagram) -> float | None:
    """Return v⁻ at the last ratio of the run-up with settled impact motion, m/s; None if there is none."""
    settled = np.array(diagram.up.table["regime"].to_pylist()) == "impact"
    return float(diagram.up.column("v_mean_m_s")[settled][-1]) if settled.any() else None


def same_shape(evidence: Evidence) -> Claim:
    """Judge C6: the shape of the attractors with different laws."""
    correlations, spreads = {}, {}
    for preset in PRESETS:
        for kind, ratio, sweep in (("impact", 1.1, "up"), ("non-impact", 1.5, "up")):
            shapes, sizes = [], []
            for diagram in evidence.nominal(preset):
                way = getattr(diagram, sweep)
                settled = end_state(follow(diagram.case, ratio, way.state_at(ratio), PAPER))
                shapes.append(cycle_shape(diagram.case, ratio, settled))
                row = way.at(ratio)
                sizes.append(1e3 * (row["x_high_m"] - row["x_low_m"]))
            correlations[f"{preset} {kind}"] = least_correlation(shapes)
            spreads[f"{preset} {kind}"] = sizes
    alike = [name for name, correlation in correlations.items() if correlation > SAME_SHAPE]
    verdict = CONTRADICTED
    if len(alike) == len(correlations):
        verdict = REPRODUCED
    elif alike:
        verdict = UNDER_PARAMETERS
    return Claim(
        "C6",
        "Attractors keep their shape across friction laws; amplitudes differ.",
        verdict,
        {
            "least_correlation_of_x_over_a_cycle": correlations,
            "viscous_coulomb_stribeck_peak_to_peak_mm": spreads,
        },
        "The position over a cycle, normalised to zero mean and unit variance, is compared between any two "
        "laws at r = 1.1 (impact) and 1.5 (non-impact). The correlation is above "
        f"{SAME_SHAPE:g} for: {', '.join(alike)}. "
        "The non-impact motions with Table 1's soft spring differ most: dry friction takes most of the "
        "drive's force there, and the strokes have sharper reversals.",
    )


def peak_force(evidence: Evidence) -> Claim:
    """Judge C7: the peak force of impacts."""
    peaks = {
        f"{preset}, {1e3 * contact_s:g} ms": {
            f"r = {ratio:g}": evidence.peak_n(preset, contact_s, ratio) for ratio in SOFT_RATIOS
        }
        for preset in PRESETS
        for contact_s in CONTACTS_S
    }
    needed = {
        f"{preset}, r = {ratio:g}": 1e3 * contact_s
        for (preset, ratio), contact_s in evidence.contacts.items()
    }
    inside = [
        f"{name}, {ratio}"
        for name, row in peaks.items()
        for ratio, peak in row.items()
        if FORCE_LOW_N <= peak <= FORCE_HIGH_N
    ]
    return Claim(
        "C7",
        "Impulses have peak forces of 10 to 40 N.",
        UNDER_PARAMETERS if inside else CONTRADICTED,
        {"peak_n": peaks, "peaks_within_10_and_40": inside, "contact_for_40_n_ms": needed},
        "Newton's rigid stop has no finite peak force. The peak force depends on the contact time, which the "
        "paper does not give. The table lists the peak force on a Hunt–Crossley stop for elastic contact "
        "times of 10, 30 and 50 ms (at 0.9 m/s, k = 0.5, b = 0.2 N s/m, run-up), and the contact times for a "
        "peak of 40 N (a dash: none up to 150 ms). With short contacts and with the stiffer spring the peak "
        "is several times 40 N, unless the wearer's compliance reduces it: docs/feasibility.md has the force "
        "that a walking wearer feels.",
    )


def repeatability(evidence: Evidence) -> Claim:
    """Judge C8: the variation of impulses from cycle to cycle."""
    settled, others = [], []
    for diagram in evidence.diagrams:
        for sweep in (diagram.up, diagram.down):
            for regime, spread in zip(
                sweep.table["regime"].to_pylist(), sweep.column("repeatability"), strict=True
            ):
                if regime == "impact":
                    settled.append(spread)
                elif math.isfinite(spread):
                    others.append(spread)
    return Claim(
        "C8",
        "In the stable impact regime impulses vary by less than 5 % from cycle to cycle.",
        REPRODUCED if max(settled) < 0.05 else CONTRADICTED,
        {
            "motions_with_one_period": len(settled),
            "greatest_variation": max(settled),
            "other_impact_motions": len(others),
            "share_of_those_below_5_percent": float(np.mean([spread < 0.05 for spread in others])),
            "greatest_variation_of_those": max(others),
        },
        "The model has no noise. A settled impact motion with the drive's period therefore repeats exactly; "
        "the listed variation is the rest of the transient after 30 s. Impact motions with longer periods "
        "and irregular impact motions occur between the onset and r = 0.98 and at the ends of the band; "
        "about half of them vary by more than 5 %. The paper's model does not include the variation that "
        "sensors and wearers add.",
    )


def energy(evidence: Evidence) -> Claim:
    """Judge C9: the energy per cycle."""
    both: dict[str, Any] = {}
    for diagram in nominal(evidence):
        band = diagram.widest_multistable()
        if band is not None and band[1] - band[0] > FEWEST_BAND:
            ratio = round(0.5 * (band[0] + band[1]), 2)
            impact, non_impact = sorted(
                (diagram.up.at(ratio), diagram.down.at(ratio)), key=lambda row: -row["impacts"]
            )
            both[f"{diagram.case.preset} {diagram.case.law}, r = {ratio:g}"] = {
                "non_impact_mj": 1e3 * non_impact["drive_j"],
                "impact_mj": 1e3 * impact["drive_j"],
                "times": impact["drive_j"] / non_impact["drive_j"],
            }
    at_r = {
        preset: {
            d.case.law: {
                "total_mj": 1e3 * d.up.at(1.1)["drive_j"],
                "friction_mj": 1e3 * d.up.at(1.1)["friction_j"],
            }
            for d in evidence.nominal(preset)
        }
        for preset in PRESETS
    }
    lowest = all(row["non_impact_mj"] < row["impact_mj"] for row in both.values())
    highest = all(
        row["viscous"]["friction_mj"] > max(row["coulomb"]["friction_mj"], row["stribeck"]["friction_mj"])
        for row in at_r.values()
    )
    return Claim(
        "C9",
        "Energy per cycle: non-impact lowest, impact moderately higher, viscous friction highest.",
        REPRODUCED if lowest and highest else CONTRADICTED,
        {
            "non_impact_lowest": lowest,
            "viscous_highest": highest,
            "same_ratio": both,
            "impact_at_r_1.1": at_r,
        },
        "Non-impact motion does take the least energy. With viscous friction, however, impact motion takes "
        "many times as much at the same ratio, which is not moderate. Viscous friction of Table 1's size "
        "dissipates the least energy of the three laws, not the most: at 0.5 m/s b v is 0.1 N, while μ m g "
        "is 1.2 N.",
    )
