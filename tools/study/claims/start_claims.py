"""Claims about starts, basins, the gait and the settings."""

import math
from dataclasses import replace
from typing import Any

import numpy as np

from tools.study.cases import PRESETS, VISCOUS_RANGE_N_S_M, case
from tools.study.claims import claim
from tools.study.claims.evidence import CONTACTS_S, Evidence, run_up, share_after_ramp, share_from_rest
from tools.study.intervals import contains


def smooth_basins(evidence: Evidence) -> claim.Claim:
    """Judge C10: the number of attractors and the border between their basins."""
    found = {law: evidence.basin(law) for law in ("viscous", "coulomb")}
    numbers = {
        law: {
            "r": one.ratio,
            "impact_fraction": one.statistics["impact_fraction"],
            "uncertainty_exponent": one.statistics["uncertainty_exponent"],
            "bounds": one.statistics["uncertainty_exponent_bounds"],
            "border_entropy": one.statistics["border_entropy"],
            "motions": len(np.unique(np.round(one.table["impacts"].to_numpy(), 3))),
        }
        for law, one in found.items()
    }
    smooth = all(
        one["border_entropy"] < math.log(2.0) and one["uncertainty_exponent"] > 0.9
        for one in numbers.values()
    )
    two = all(one["motions"] == 2 for one in numbers.values())
    return claim.Claim(
        "C10",
        "In the multistable band there are two attractors, with a smooth border between their basins.",
        claim.REPRODUCED if smooth and two else claim.CONTRADICTED,
        numbers,
        "In the middle of the multistable band above resonance every start ends in one of two motions. The "
        "uncertainty exponent is close to 1, its value for a smooth border, and approaches 1 with finer "
        "cells. The entropy of boxes on the border is below ln 2 = 0.693; above this value the border would "
        "have to be fractal.",
    )


def start_decides(evidence: Evidence) -> claim.Claim:
    """Judge C11: the effect of the state at start-up."""
    viscous, coulomb = case("table1", "viscous"), case("table1", "coulomb")
    from_rest = {f"r = {ratio:g}": share_from_rest(viscous, ratio) for ratio in (1.25, 1.3, 1.35, 1.4)}
    ramps = {
        f"viscous, r = {ratio:g}, {duration_s:g} s": share_after_ramp(viscous, ratio, duration_s)
        for ratio in (1.3, 1.35)
        for duration_s in (0.5, 2.0, 5.0)
    } | {
        f"coulomb, r = 1.2, {duration_s:g} s": share_after_ramp(coulomb, 1.2, duration_s)
        for duration_s in (2.0, 5.0)
    }
    holds = from_rest["r = 1.3"] == 0.0 and ramps["viscous, r = 1.3, 5 s"] == 1.0
    return claim.Claim(
        "C11",
        "The state at start-up decides; an initialisation routine ensures the wanted motion.",
        claim.REPRODUCED if holds else claim.CONTRADICTED,
        {"impact_share_from_rest_at_once": from_rest, "impact_share_after_a_run_up": ramps},
        "If the crank starts at full speed, a striker at rest ends in the non-impact motion at r = 1.3 and "
        "above, for any initial crank angle. If the speed rises from standstill within some seconds, the "
        "motion enters the impact regime at a lower ratio and stays in it.",
    )


def gait_frequencies(evidence: Evidence) -> claim.Claim:
    """Judge C12: the frequencies for slow and normal walking."""
    table: dict[str, Any] = {}
    for diagram in claim.nominal(evidence):
        if diagram.case.law == "viscous":
            row = {}
            for hz in (2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0):
                ratio = 2.0 * math.pi * hz / diagram.case.natural_rad_s
                up = contains(diagram.up.with_impacts(), ratio)
                down = contains(diagram.down.with_impacts(), ratio)
                row[f"{hz:g} Hz"] = (
                    "impacts" if up and down else "depends on the start" if up or down else "no impacts"
                )
            table[diagram.case.preset] = row
    spans = claim.per_law(
        [d for d in claim.nominal(evidence) if d.onset() is not None],
        lambda d: [claim.in_hz(d, cut) for cut in d.up.with_impacts()[0]],
    )
    return claim.Claim(
        "C12",
        "2 to 3 Hz suits slow walking, 3 to 5 Hz normal cadence, 6 Hz risks losing the impacts.",
        claim.CONTRADICTED,
        {"motion": table, "impact_in_a_run_up_hz": spans},
        "The module as printed has impacts from about 1.2 to 2.1 Hz. Of the frequencies in the table it has "
        "impacts only at 2 Hz, and only from some starts. The module retuned to 4 Hz has impacts in most of "
        "3.6 to 5.3 Hz and none at 6 Hz, as claimed, but none at 2 to 3 Hz: the interval with impacts spans "
        "a factor of 1.4 to 1.7 in frequency, while 2 to 5 Hz is a factor of 2.5. One spring cannot serve "
        "both ranges. This is not necessary either: a crank with n turns per stride serves slow and fast "
        "walking at nearly the same crank frequency (docs/feasibility.md).",
    )


def damping(evidence: Evidence) -> claim.Claim:
    """Judge C13: the effect of damping on peak acceleration and variability."""
    rows = {
        f"{preset}, r = {ratio:g}": {
            f"b = {b:g}": {"peak_m_s2": evidence.peak_n(preset, CONTACTS_S[1], ratio, b) / 0.8}
            for b in VISCOUS_RANGE_N_S_M
        }
        for preset in PRESETS
        for ratio in claim.DAMPED_RATIOS
    }
    falls = [
        evidence.peak_n(preset, CONTACTS_S[1], ratio, VISCOUS_RANGE_N_S_M[0])
        > evidence.peak_n(preset, CONTACTS_S[1], ratio, VISCOUS_RANGE_N_S_M[-1])
        for preset in PRESETS
        for ratio in claim.DAMPED_RATIOS
    ]
    spreads = {
        f"b = {b:g}": max(
            row["repeatability"]
            for row in evidence.soft
            if row["case"].b_n_s_m == b
            and row["case"].contact_s == CONTACTS_S[1]
            and row["cycle"] == 1
            and row["impacts"] > 0.0
        )
        for b in VISCOUS_RANGE_N_S_M
    }
    return claim.Claim(
        "C13",
        "More damping lowers the peak acceleration but raises variability.",
        claim.CONTRADICTED,
        {
            "peak_falls_with_b": all(falls),
            "peak_acceleration": rows,
            "greatest_variation_of_impulses": spreads,
        },
        "With a Hunt–Crossley stop of 30 ms the peak acceleration does fall from b = 0.1 to 0.3 N s/m, but "
        "only by a few per cent. Variability does not rise: the model has no noise, and settled impact "
        "motion repeats exactly for every b.",
    )


def caps(evidence: Evidence) -> claim.Claim:
    """Judge C14: the limitation of the impulse by restitution and stop position."""
    base, ratio = case("table1", "viscous"), 1.1
    by_k = {f"k = {k:g}": run_up(replace(base, restitution=k), ratio).impulse_n_s for k in (0.4, 0.5, 0.6)}
    by_stop = {
        f"x_stop = {stop:g} m": run_up(replace(base, stop_m=stop), ratio).impulse_n_s
        for stop in (0.16, 0.17, 0.18, 0.19, 0.2)
    }
    by_amplitude = {
        f"A = {1e3 * a:g} mm": run_up(replace(base, amplitude_m=a), ratio).impulse_n_s
        for a in (0.015, 0.02, 0.03, 0.04, 0.06)
    }
    by_ratio = {
        f"r = {r:g}": float(evidence.of(base).up.at(r)["impulse_n_s"]) for r in (1.0, 1.1, 1.2, 1.3, 1.4)
    }
    growth = by_amplitude["A = 60 mm"] / by_amplitude["A = 15 mm"]
    return claim.Claim(
        "C14",
        "Restitution and stop position cap the impulse, a safety layer independent of control.",
        claim.CONTRADICTED if growth > 1.5 else claim.REPRODUCED,
        {"impulse_n_s": by_k | by_stop | by_amplitude | by_ratio, "growth_with_amplitude": growth},
        "The impulse is (1 + k) m v⁻, and k and x_stop do not limit v⁻: at fixed k and x_stop the impulse "
        "grows with the drive amplitude and, in the impact motion, with the crank's speed. A change of k "
        "from 0.4 to 0.6 changes the impulse by only 2 %, because v⁻ decreases as k increases. A stop at a "
        "larger distance increases the impulse. The impulse is limited by the drive's amplitude and by the "
        "control of its speed.",
    )
