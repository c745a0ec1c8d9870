"""The claims' verdicts, on sweeps of 23 ratios, and the page; the commands and what they refuse."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import pytest

from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, plain
from tools.study import work
from tools.study.cases import case
from tools.study.claims import page
from tools.study.claims.claim import CONTRADICTED, REPRODUCED, Claim
from tools.study.claims.claims import UNDER_PARAMETERS, judge
from tools.study.claims.evidence import Evidence, grazing_amplitude_m

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


@pytest.fixture(scope="module")
def claims(tmp_path_factory: pytest.TempPathFactory) -> list[Claim]:
    return judge(Evidence(work.here(tmp_path_factory.mktemp("studies")), ratios=23))


def test_verdicts(claims: list[Claim]) -> None:
    assert {claim.id: claim.verdict for claim in claims} == VERDICTS


def test_figures_that_others_found_too(claims: list[Claim]) -> None:
    value = {claim.id: claim.value for claim in claims}
    assert value["C3"]["natural_hz"] == pytest.approx(math.sqrt(70.0 / 0.8) / (2.0 * math.pi))
    assert value["C3"]["spring_for_4_hz_n_m"] == pytest.approx(505.3, abs=0.1)
    onsets = value["C2"]["onset_r"]
    assert all(0.88 < onsets[f"gait {law}"] < 1.1 for law in ("viscous", "coulomb", "stribeck"))
    assert value["C11"]["impact_share_from_rest_at_once"] == {
        "r = 1.25": 1.0,
        "r = 1.3": 0.0,
        "r = 1.35": 0.0,
        "r = 1.4": 0.0,
    }
    assert value["C11"]["impact_share_after_a_run_up"]["viscous, r = 1.35, 2 s"] == 1.0
    assert 20.0 < value["C7"]["peak_n"]["table1, 50 ms"]["r = 1"] < 40.0


def test_grazing_amplitude_is_the_linear_one() -> None:
    # A = gap |1 − r² + 2 i ζ r|
    one = case("table1", "viscous")
    zeta = 0.2 / (2.0 * 0.8 * one.natural_rad_s)
    assert grazing_amplitude_m(one, 0.9) == pytest.approx(0.06 * abs(1 - 0.81 + 1.8j * zeta), rel=1e-6)


def test_the_page_says_it_all(claims: list[Claim], tmp_path: Path) -> None:
    path = tmp_path / "claims.md"
    page.write(claims, path)
    text = path.read_text(encoding="utf-8")
    for claim in claims:
        assert f"## {claim.id}\n" in text
        assert claim.reason in text
    assert "natural [Hz] | 1.489" in text


def test_claims_are_plain_json(claims: list[Claim]) -> None:
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


def test_basin_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    found = run(capsys, "basin", "--size", "40", "--plane", "state", "--out", str(tmp_path))
    (one,) = found["basins"]
    low, high = one["impact_fraction_wilson"]
    assert low < one["impact_fraction"] < high
    assert one["impact_fraction"] == pytest.approx(0.784, abs=0.02)
    assert one["parameters"]["amplitude_m"] == 0.02
    assert (tmp_path / "basin-table1-viscous-r1.3-state.parquet").exists()


def test_map_command(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    found = run(capsys, "map", "--over", "r,k", "--size", "6", "--out", str(tmp_path))
    assert 0.0 < found["map"]["share_certain_of_impacts"] < found["map"]["share_with_impact"] < 1.0
    assert (tmp_path / "map-table1-viscous-r-k.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["sweep", "--preset", "table2"], "'--preset': Value error, 'table2' is not one of 'table1', 'gait'"),
        (["sweep", "--law", "dry"], "'--law': Value error, 'dry' is not one of 'viscous', 'coulomb'"),
        (["basin", "--size", "1"], "'--size': Input should be greater than or equal to 2"),
        (["basin", "--ratio", "-1"], "'--ratio': Input should be greater than or equal to 0.000001"),
        (["basin", "--value", "nan"], "'--value': Input should be greater than or equal to 0"),
        (["sweep", "--amplitude", "inf"], "'--amplitude': inf is not a finite number"),
        (["map", "--over", "r,x"], "'--over': Value error, 'r,x' is not one of 'r,A'"),
        (["map", "--over", "r,mu"], "that law has no mu"),
        (
            ["sweep", "--cores", "0"],
            "'--cores': Input should be greater than or equal to 1",
        ),
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
