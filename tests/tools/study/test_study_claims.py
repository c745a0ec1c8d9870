"""The claims' verdicts, on few ratios and small basins, and the page; the commands and what they refuse."""

import copy
import json
import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from pyarrow import parquet

from plant_sim.scene import Scene
from tools import cli
from tools.commands import study
from tools.commands.study_branches import scene_name
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, plain
from tools.study import work
from tools.study.branches import saddle
from tools.study.cases import LAWS, PRESETS, case
from tools.study.claims import evidence, page
from tools.study.claims.claims import CLAIMS, CONTRADICTED, REPRODUCED, UNDER_PARAMETERS, JudgedClaim, judge
from tools.study.claims.evidence import Evidence, grazing_amplitude_m
from tools.study.claims.measures import CLAIMED_HZ, EVERY_START, NO_START

VERDICTS = {
    "C1": UNDER_PARAMETERS,
    "C2": UNDER_PARAMETERS,
    "C3": CONTRADICTED,
    "C4": REPRODUCED,
    "C5": UNDER_PARAMETERS,
    "C6": UNDER_PARAMETERS,
    "C7": UNDER_PARAMETERS,
    "C8": REPRODUCED,
    "C9": CONTRADICTED,
    "C10": REPRODUCED,
    "C11": REPRODUCED,
    "C12": CONTRADICTED,
    "C13": CONTRADICTED,
    "C14": CONTRADICTED,
}

VISCOUS_ZERO = {"table1 viscous": 0.0, "gait viscous": 0.0}
SAME_SIZES = {
    f"{preset} {kind}": [20.0, 20.1, 20.0] for preset in PRESETS for kind in ("impact", "non-impact")
}
AS_CLAIMED_ENERGY = {
    "same_ratio": {"table1 viscous, r = 1.2": {"non_impact_mj": 10.0, "impact_mj": 15.0, "times": 1.5}},
    "impact_at_r_1.1": {
        "table1": {law: {"total_mj": 1.0, "friction_mj": 3.0 if law == "viscous" else 1.0} for law in LAWS}
    },
}
SUITED = {f"{hz:g} Hz": EVERY_START if hz <= 5.0 else NO_START for hz in CLAIMED_HZ}

Change = Callable[[dict[str, Any]], None]
PLANTED: dict[str, list[tuple[Change, str]]] = {
    "C1": [
        (lambda v: v.update(with_all_three=v["cases"]), REPRODUCED),
        (lambda v: v["with_all_three_by_law"].update(stribeck=0), CONTRADICTED),
    ],
    "C2": [
        (lambda v: v.update(onset_r=dict.fromkeys(v["onset_r"], 1.0)), REPRODUCED),
        (lambda v: v.update(onset_r=dict.fromkeys(v["onset_r"], 0.5)), CONTRADICTED),
    ],
    "C3": [(lambda v: v.update({"r_0.9_to_1.1_hz": [3.6, 4.4]}), REPRODUCED)],
    "C4": [
        (lambda v: v["least_and_greatest_width_r"]["gait"].update(coulomb=[0.1, 0.9]), UNDER_PARAMETERS),
        (
            lambda v: [row.update(viscous=[0.0, 0.5]) for row in v["least_and_greatest_width_r"].values()],
            CONTRADICTED,
        ),
    ],
    "C5": [
        (lambda v: v["impact_lost_at_the_fold_m_s"].update(VISCOUS_ZERO), REPRODUCED),
        (lambda v: v["hysteresis_r"].update(VISCOUS_ZERO), CONTRADICTED),
    ],
    "C6": [
        (lambda v: v["least_correlation_of_x_over_a_cycle"].update({"table1 non-impact": 0.99}), REPRODUCED),
        (lambda v: v["least_correlation_of_x_over_a_cycle"].update({"gait impact": 0.5}), CONTRADICTED),
        (lambda v: v.update(viscous_coulomb_stribeck_peak_to_peak_mm=SAME_SIZES), CONTRADICTED),
    ],
    "C7": [
        (lambda v: v.update(peak_n={"table1, 10 ms": {"r = 1": 20.0}}), REPRODUCED),
        (lambda v: v.update(peak_n={"table1, 10 ms": {"r = 1": 90.0}}), CONTRADICTED),
    ],
    "C8": [
        (lambda v: v.update(greatest_variation=0.06), CONTRADICTED),
        (lambda v: v.update(greatest_variation=None, motions_with_one_period=0), CONTRADICTED),
    ],
    "C9": [(lambda v: v.update(AS_CLAIMED_ENERGY), REPRODUCED)],
    "C10": [
        (lambda v: v["viscous"].update(uncertainty_exponent=0.8), UNDER_PARAMETERS),
        (lambda v: v["viscous"].update(border_entropy=0.7), UNDER_PARAMETERS),
        (lambda v: [one.update(motions=3) for one in v.values()], CONTRADICTED),
    ],
    "C11": [
        (lambda v: v["impact_share_after_a_run_up"].update({"viscous, r = 1.3, 5 s": 0.9}), UNDER_PARAMETERS),
        (
            lambda v: v.update(
                impact_share_after_a_run_up=dict.fromkeys(v["impact_share_after_a_run_up"], 0.0)
            ),
            CONTRADICTED,
        ),
    ],
    "C12": [
        (lambda v: v["motion"].update(table1=SUITED), REPRODUCED),
        (lambda v: v["motion"].update(gait=SUITED), UNDER_PARAMETERS),
    ],
    "C13": [(lambda v: v["greatest_variation_of_impulses"].update({"b = 0.3": 0.04}), REPRODUCED)],
    "C14": [
        (
            lambda v: v.update(
                impulse_over_amplitude_n_s={"A = 15 mm": 0.60, "A = 60 mm": 0.61},
                impulse_over_ratio_n_s={"r = 1": 0.60, "r = 1.4": 0.62},
            ),
            REPRODUCED,
        )
    ],
}


@pytest.fixture(scope="module")
def claims(tmp_path_factory: pytest.TempPathFactory) -> list[JudgedClaim]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evidence, "BASIN_SIZE", 80)
        patch.setattr(evidence, "RAMP_STEPS_PER_S", 40)
        return judge(Evidence(work.Where(tmp_path_factory.mktemp("studies")), ratios=23))


def test_verdicts(claims: list[JudgedClaim]) -> None:
    assert {claim.id: claim.verdict for claim in claims} == VERDICTS


@pytest.mark.parametrize("name", VERDICTS)
def test_planted_figures_change_the_verdict(claims: list[JudgedClaim], name: str) -> None:
    (measured,) = (claim for claim in claims if claim.id == name)
    (claim,) = (claim for claim in CLAIMS if claim.id == name)
    assert claim.decide(measured.value) == (VERDICTS[name], measured.reason)
    for change, verdict in PLANTED[name]:
        value = copy.deepcopy(measured.value)
        change(value)
        found = claim.decide(value)
        assert found.verdict == verdict != VERDICTS[name]
        assert found.reason != measured.reason  # the reason's numbers are the planted ones


def test_a_damping_that_lowers_no_peak_contradicts(claims: list[JudgedClaim]) -> None:
    (measured,) = (claim for claim in claims if claim.id == "C13")
    (claim,) = (claim for claim in CLAIMS if claim.id == "C13")
    value = copy.deepcopy(measured.value)
    value["greatest_variation_of_impulses"]["b = 0.3"] = 0.04
    for row in value["peak_acceleration_m_s2"].values():
        row["b = 0.3"] = 1e4
    found = claim.decide(value)
    assert found.verdict == CONTRADICTED
    fails = found.reason.partition("Does not hold: ")[2]
    assert fails.startswith("the peak acceleration falls at every ratio (measured: by")


def test_figures_that_others_found_too(claims: list[JudgedClaim]) -> None:
    value = {claim.id: claim.value for claim in claims}
    assert value["C3"]["natural_hz"] == pytest.approx(math.sqrt(70.0 / 0.8) / (2.0 * math.pi))
    assert value["C3"]["spring_for_4_hz_n_m"] == pytest.approx(505.3, abs=0.1)
    onsets = value["C2"]["onset_r"]
    assert all(0.88 < onsets[f"gait {law}"] < 1.1 for law in ("viscous", "coulomb", "stribeck"))
    assert value["C11"]["impact_share_from_rest_at_once"] == {
        "viscous, r = 1.25": 1.0,
        "viscous, r = 1.3": 0.0,
        "viscous, r = 1.35": 0.0,
        "viscous, r = 1.4": 0.0,
        "coulomb, r = 1.2": value["C11"]["impact_share_from_rest_at_once"]["coulomb, r = 1.2"],
    }
    assert value["C11"]["impact_share_after_a_run_up"]["viscous, r = 1.35, 2 s"] == 1.0
    assert 20.0 < value["C7"]["peak_n"]["table1, 50 ms"]["r = 1"] < 40.0


def test_grazing_amplitude_is_the_linear_one() -> None:
    # A = gap |1 − r² + 2 i ζ r|
    one = case("table1", "viscous")
    zeta = 0.2 / (2.0 * 0.8 * one.natural_rad_s)
    assert grazing_amplitude_m(one, 0.9) == pytest.approx(0.06 * abs(1 - 0.81 + 1.8j * zeta), rel=1e-6)


def test_the_page_says_it_all(claims: list[JudgedClaim], tmp_path: Path) -> None:
    path = tmp_path / "claims.md"
    page.write(claims, path)
    text = path.read_text(encoding="utf-8")
    for claim in claims:
        assert f"## {claim.id}\n" in text
        assert claim.reason in text
        assert claim.judgement in text
    assert "`natural_hz` | 1.489" in text


def test_claims_are_plain_json(claims: list[JudgedClaim]) -> None:
    text = json.dumps(plain({"claims": [asdict(claim) for claim in claims]}), allow_nan=False)
    assert [claim["id"] for claim in json.loads(text)["claims"]] == list(VERDICTS)


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    assert cli.run(["study", *arguments, "--json"]) == EXIT_PASSED
    return json.loads(capsys.readouterr().out)


def test_sweep_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    wanted = ["sweep", "--preset", "table1", "--law", "viscous", "--quick", "--out", str(tmp_path)]
    found = run(capsys, *wanted)
    (regimes,) = found["regimes"]
    assert regimes["up_r"][0] == pytest.approx([0.817, 1.409], abs=2e-3)
    assert regimes["down_r"][0] == pytest.approx([0.814, 1.154], abs=2e-3)
    assert regimes["multistable_r"][-1] == pytest.approx([1.154, 1.409], abs=2e-3)
    assert found["wall_s"] > 0.0
    assert {Path(path).suffix for path in found["figures"]} == {".svg", ".png"}
    assert all(Path(path).stat().st_size > 0 for path in found["figures"])
    assert run(capsys, *wanted)["regimes"] == found["regimes"]
    table = parquet.read_table(tmp_path / "sweep-table1-viscous-0.2-20mm-up.parquet")
    assert table.num_rows == 111
    assert json.loads(table.schema.metadata[b"vibrohil"])["parameters"]["b_n_s_m"] == 0.2


def test_basin_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    found = run(capsys, "basin", "--size", "40", "--plane", "state", "--out", str(tmp_path))
    (one,) = found["basins"]
    low, high = one["uncertainty_exponent_bounds"]
    assert low <= one["uncertainty_exponent"] <= high
    low, high = one["impact_fraction_bootstrap"]
    assert low < one["impact_fraction"] < high
    assert one["impact_fraction"] == pytest.approx(0.784, abs=0.02)
    assert one["parameters"]["amplitude_m"] == 0.02
    assert (tmp_path / "basin-table1-viscous-0.2-20mm-r1.3-state-40.parquet").exists()


def test_studies_with_other_parameters_write_other_files(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    small = ["basin", "--plane", "phase", "--size", "4"]
    others = (["--size", "5"], ["--value", "0.1"], ["--amplitude", "0.0200001"], ["--ratio", "1.3000001"])
    found = [run(capsys, *small, *other, "--out", str(tmp_path))["figures"] for other in ([], *others)]
    assert len({path for paths in found for path in paths}) == 2 * len(found)
    sweeps = [
        run(capsys, "sweep", "--preset", "table1", "--law", law, "--quick", *more, "--out", str(tmp_path))
        for law, more in (("viscous", []), ("viscous", ["--amplitude", "0.021"]), ("coulomb", []))
    ]
    assert len({path for found in sweeps for path in found["figures"]}) == 2 * len(sweeps)
    scenes = [scene_name("a/x.toml", None), scene_name("b/x.toml", None), scene_name("x", None)]
    assert len({*scenes, scene_name("x", ["scene.stop.restitution=0.6"])}) == 4


def test_the_cost_of_a_basin_includes_the_saddle_s_portrait(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    hour_s = 3600.0
    now_s = [0.0]
    monkeypatch.setattr(study, "time", SimpleNamespace(perf_counter=lambda: now_s[0]))

    def portrait(_: Scene) -> None:
        now_s[0] += hour_s

    monkeypatch.setattr(saddle, "portrait", portrait)
    found = run(capsys, "basin", "--size", "4", "--plane", "state", "--out", str(tmp_path))
    assert found["wall_s"] == hour_s


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sweep", "--preset", "table2"], "'--preset': Value error, 'table2' is not one of 'table1', 'gait'"),
        (["sweep", "--law", "dry"], "'--law': Value error, 'dry' is not one of 'viscous', 'coulomb'"),
        (["basin", "--size", "1"], "'--size': Input should be greater than or equal to 2"),
        (["basin", "--ratio", "-1"], "'--ratio': Input should be greater than or equal to 0.000001"),
        (["basin", "--value", "nan"], "'--value': Input should be greater than or equal to 0"),
        (["sweep", "--amplitude", "inf"], "'--amplitude': inf is not a finite number"),
        (["sweep", "--workers", "0"], "'--workers': Input should be greater than or equal to 1"),
        (["feasibility", "--preset", "table2"], "'table2' is not one of 'table1', 'gait', 'walking'"),
    ],
)
def test_nonsense_is_refused(capsys: pytest.CaptureFixture[str], arguments: list[str], message: str) -> None:
    assert cli.run(["study", *arguments, "--json"]) == EXIT_BAD_INPUT
    assert message in json.loads(capsys.readouterr().out)["error"]


def test_the_page_in_the_repository_has_these_verdicts() -> None:
    text = (Path(__file__).parents[3] / "docs" / "claims.md").read_text(encoding="utf-8")
    for name, verdict in VERDICTS.items():
        (row,) = (line for line in text.splitlines() if line.startswith(f"| [{name}]"))
        assert row.endswith(f"| {verdict} |")
