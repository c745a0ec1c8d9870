"""The figures of each claim, computed from the evidence. No verdict is given here."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from tools.study.cases import LAWS, PRESETS, VISCOUS_RANGE_N_S_M, case
from tools.study.claims.evidence import (
    CONTACTS_S,
    SOFT_RATIOS,
    Evidence,
    cycle_shape,
    grazing_amplitude_m,
    run_up,
    share_after_ramp,
    share_from_rest,
    soft_case,
)
from tools.study.orbits import PAPER, follow
from tools.study.sweep import Diagram, contains, width

LEAST_BAND = 1e-3
"""Smallest width in r of a multistable band."""

CLAIMED_HZ = (2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0, 6.0)
DAMPED_RATIOS = (1.05, 1.1, 1.2)
EVERY_START, SOME_STARTS, NO_START = "impacts", "depends on the start", "no impacts"


def in_hz(diagram: Diagram, ratio: float | None) -> float | None:
    """Return the frequency in Hz of a speed ratio of a diagram; None for None."""
    return None if ratio is None else ratio * diagram.case.natural_rad_s / (2.0 * math.pi)


def per_law(found: Sequence[Diagram], figure: Callable[[Diagram], Any]) -> dict[str, Any]:
    """Return a figure of each diagram, keyed by preset and friction law."""
    return {f"{diagram.case.preset} {diagram.case.law}": figure(diagram) for diagram in found}


def nominal(evidence: Evidence) -> list[Diagram]:
    """Return the diagrams of all presets with their nominal parameters."""
    return [diagram for preset in PRESETS for diagram in evidence.nominal(preset)]


def three_regimes(evidence: Evidence) -> dict[str, Any]:
    """Count the cases with non-impact motion, impact motion and multistability (C1)."""
    diagrams = evidence.diagrams.values()
    full = [d for d in diagrams if width(d.multistable()) > LEAST_BAND and d.onset() is not None]
    return {
        "cases": len(diagrams),
        "with_all_three": len(full),
        "with_all_three_by_law": {law: sum(d.case.law == law for d in full) for law in LAWS},
        "without_impacts": [f"{d.case.preset} {d.case.label}" for d in diagrams if d.onset() is None],
    }


def onset_ratio(evidence: Evidence) -> dict[str, Any]:
    """Measure the ratio at which impacts begin, and the amplitudes for an onset at r = 1 and 0.9 (C2)."""
    return {
        "onset_r": per_law(nominal(evidence), Diagram.onset),
        "amplitude_for_onset_at_r_1_and_r_0.9_mm": {
            f"{preset} {law}": [
                1e3 * grazing_amplitude_m(case(preset, law), 1.0),
                1e3 * grazing_amplitude_m(case(preset, law), 0.9),
            ]
            for preset in PRESETS
            for law in ("viscous", "coulomb")
        },
    }


def onset_frequency(evidence: Evidence) -> dict[str, Any]:
    """Compute the frequencies of r = 0.9 to 1.1, and the spring or mass that puts r = 1 at 4 Hz (C3)."""
    table1 = case("table1", "viscous")
    natural_hz = table1.natural_rad_s / (2.0 * math.pi)
    return {
        "natural_hz": natural_hz,
        "r_0.9_to_1.1_hz": [0.9 * natural_hz, 1.1 * natural_hz],
        "onset_hz": per_law(nominal(evidence), lambda d: in_hz(d, d.onset())),
        "spring_for_4_hz_n_m": table1.mass_kg * (2.0 * math.pi * 4.0) ** 2,
        "mass_for_4_hz_kg": table1.spring_n_m / (2.0 * math.pi * 4.0) ** 2,
    }


def widest_band(evidence: Evidence) -> dict[str, Any]:
    """Measure the width in r of the multistable bands (C4)."""
    reaching = [d for d in evidence.diagrams.values() if d.onset() is not None]
    widths = {
        preset: {
            law: [width(d.multistable()) for d in reaching if (d.case.preset, d.case.law) == (preset, law)]
            for law in LAWS
        }
        for preset in PRESETS
    }
    return {
        "least_and_greatest_width_r": {
            preset: {law: [min(some), max(some)] for law, some in laws.items()}
            for preset, laws in widths.items()
        },
        "width_r": {
            f"{d.case.preset} {d.case.label}, A = {1e3 * d.case.amplitude_m:g} mm": width(d.multistable())
            for d in reaching
        },
    }


def sharper_switching(evidence: Evidence) -> dict[str, Any]:
    """Measure hysteresis and jump at the ends of the impact motion (C5)."""
    found = nominal(evidence)
    return {
        "hysteresis_r": per_law(found, lambda d: width(d.multistable())),
        "impact_lost_at_the_fold_m_s": per_law(found, _jump),
    }


def _jump(diagram: Diagram) -> float | None:
    """Return v⁻ at the last ratio of the run-up with settled impact motion, m/s; None if there is none."""
    settled = diagram.up.column("regime") == "impact"
    return float(diagram.up.column("v_mean_m_s")[settled][-1]) if settled.any() else None


def same_shape(evidence: Evidence) -> dict[str, Any]:
    """Compare x over a cycle between the laws, and the strokes' sizes (C6)."""
    correlations, spreads = {}, {}
    for preset in PRESETS:
        for kind, ratio in (("impact", 1.1), ("non-impact", 1.5)):
            shapes, sizes = [], []
            for diagram in evidence.nominal(preset):
                start = diagram.up.state_at(ratio)
                settled = follow(diagram.case.scene(ratio), start, PAPER).end
                shapes.append(cycle_shape(diagram.case, ratio, settled))
                row = diagram.up.at(ratio)
                sizes.append(1e3 * (row["x_high_m"] - row["x_low_m"]))
            correlations[f"{preset} {kind}"] = float(np.min(np.corrcoef(shapes)))
            spreads[f"{preset} {kind}"] = sizes
    return {
        "least_correlation_of_x_over_a_cycle": correlations,
        "viscous_coulomb_stribeck_peak_to_peak_mm": spreads,
    }


def peak_force(evidence: Evidence) -> dict[str, Any]:
    """Measure the peak force on soft stops, and the contact times for 40 N (C7)."""
    return {
        "peak_n": {
            f"{preset}, {1e3 * contact_s:g} ms": {
                f"r = {ratio:g}": evidence.peak_n(preset, contact_s, ratio) for ratio in SOFT_RATIOS
            }
            for preset in PRESETS
            for contact_s in CONTACTS_S
        },
        "contact_for_40_n_ms": {
            f"{preset}, r = {ratio:g}": 1e3 * contact_s
            for (preset, ratio), contact_s in evidence.contacts.items()
        },
    }


def repeatability(evidence: Evidence) -> dict[str, Any]:
    """Measure the impulses' variation from cycle to cycle in settled and in other impact motions (C8)."""
    rows = [row for d in evidence.diagrams.values() for sweep in (d.up, d.down) for row in sweep.rows]
    settled = [row["repeatability"] for row in rows if row["regime"] == "impact"]
    others = [row["repeatability"] for row in rows if row["regime"] != "impact"]
    others = [spread for spread in others if math.isfinite(spread)]
    return {
        "motions_with_one_period": len(settled),
        "greatest_variation": max(settled, default=None),
        "other_impact_motions": len(others),
        "share_of_those_below_5_percent": float(np.mean(np.array(others) < 0.05)) if others else None,
        "greatest_variation_of_those": max(others, default=None),
    }


def energy(evidence: Evidence) -> dict[str, Any]:
    """Measure the energy per cycle of both motions at one ratio, and of each law's impact motion (C9)."""
    both: dict[str, Any] = {}
    for diagram in nominal(evidence):
        band = diagram.widest_multistable()
        if band is not None and band[1] - band[0] > LEAST_BAND:
            ratio = round(0.5 * (band[0] + band[1]), 2)
            impact, non_impact = sorted(
                (diagram.up.at(ratio), diagram.down.at(ratio)), key=lambda row: -row["impacts"]
            )
            both[f"{diagram.case.preset} {diagram.case.law}, r = {ratio:g}"] = {
                "non_impact_mj": 1e3 * non_impact["drive_j"],
                "impact_mj": 1e3 * impact["drive_j"],
                "times": impact["drive_j"] / non_impact["drive_j"],
            }
    return {
        "same_ratio": both,
        "impact_at_r_1.1": {
            preset: {
                d.case.law: {
                    "total_mj": 1e3 * d.up.at(1.1)["drive_j"],
                    "friction_mj": 1e3 * d.up.at(1.1)["friction_j"],
                }
                for d in evidence.nominal(preset)
            }
            for preset in PRESETS
        },
    }


def smooth_basins(evidence: Evidence) -> dict[str, Any]:
    """Measure the number of motions, and the border between their basins (C10)."""
    found = {law: evidence.basin(law) for law in ("viscous", "coulomb")}
    return {
        law: {
            "r": one.ratio,
            "impact_fraction": one.statistics["impact_fraction"],
            "uncertainty_exponent": one.statistics["uncertainty_exponent"],
            "bounds": one.statistics["uncertainty_exponent_bounds"],
            "border_entropy": one.statistics["border_entropy"],
            "motions": len(np.unique(np.round(one.impacts, 3))),
        }
        for law, one in found.items()
    }


def start_decides(_: Evidence) -> dict[str, Any]:
    """Measure the share of crank angles that lead to impacts, from rest at once and after a run-up (C11)."""
    at_once = (("viscous", 1.25), ("viscous", 1.3), ("viscous", 1.35), ("viscous", 1.4), ("coulomb", 1.2))
    after = (
        *(("viscous", ratio, rise_s) for ratio in (1.3, 1.35) for rise_s in (0.5, 2.0, 5.0)),
        *(("coulomb", 1.2, rise_s) for rise_s in (2.0, 5.0)),
    )
    return {
        "impact_share_from_rest_at_once": {
            f"{law}, r = {ratio:g}": share_from_rest(case("table1", law), ratio) for law, ratio in at_once
        },
        "impact_share_after_a_run_up": {
            f"{law}, r = {ratio:g}, {rise_s:g} s": share_after_ramp(case("table1", law), ratio, rise_s)
            for law, ratio, rise_s in after
        },
    }


def gait_frequencies(evidence: Evidence) -> dict[str, Any]:
    """Measure the motion at the frequencies of the claim, and the interval with impacts (C12)."""
    table: dict[str, Any] = {}
    for diagram in nominal(evidence):
        if diagram.case.law == "viscous":
            row = {}
            for hz in CLAIMED_HZ:
                ratio = 2.0 * math.pi * hz / diagram.case.natural_rad_s
                up = contains(diagram.up.with_impacts(), ratio)
                down = contains(diagram.down.with_impacts(), ratio)
                row[f"{hz:g} Hz"] = EVERY_START if up and down else SOME_STARTS if up or down else NO_START
            table[diagram.case.preset] = row
    return {
        "motion": table,
        "impact_in_a_run_up_hz": per_law(
            [d for d in nominal(evidence) if d.onset() is not None],
            lambda d: [in_hz(d, cut) for cut in d.up.with_impacts()[0]],
        ),
    }


def damping(evidence: Evidence) -> dict[str, Any]:
    """Measure peak acceleration and variation of the impulses on a soft stop for each b (C13)."""
    mass_kg = case("table1", "viscous").mass_kg
    return {
        "peak_acceleration_m_s2": {
            f"{preset}, r = {ratio:g}": {
                f"b = {b:g}": evidence.peak_n(preset, CONTACTS_S[1], ratio, b) / mass_kg
                for b in VISCOUS_RANGE_N_S_M
            }
            for preset in PRESETS
            for ratio in DAMPED_RATIOS
        },
        "greatest_variation_of_impulses": {
            f"b = {b:g}": max(
                row["repeatability"]
                for preset in PRESETS
                for row in evidence.soft[soft_case(preset, CONTACTS_S[1], b)]
                if row["cycle"] == 1 and row["impacts"] > 0.0
            )
            for b in VISCOUS_RANGE_N_S_M
        },
    }


def caps(evidence: Evidence) -> dict[str, Any]:
    """Measure the impulse over restitution, stop position, drive amplitude and speed ratio (C14)."""
    base, ratio = case("table1", "viscous"), 1.1
    return {
        "impulse_over_k_n_s": {
            f"k = {k:g}": run_up(replace(base, restitution=k), ratio).impulse_n_s for k in (0.4, 0.5, 0.6)
        },
        "impulse_over_stop_n_s": {
            f"x_stop = {stop:g} m": run_up(replace(base, stop_m=stop), ratio).impulse_n_s
            for stop in (0.16, 0.17, 0.18, 0.19, 0.2)
        },
        "impulse_over_amplitude_n_s": {
            f"A = {1e3 * a:g} mm": run_up(replace(base, amplitude_m=a), ratio).impulse_n_s
            for a in (0.015, 0.02, 0.03, 0.04, 0.06)
        },
        "impulse_over_ratio_n_s": {
            f"r = {r:g}": float(evidence.diagrams[base].up.at(r)["impulse_n_s"])
            for r in (1.0, 1.1, 1.2, 1.3, 1.4)
        },
    }
