"""Branches of impact orbits against closed forms, direct simulation and perturbed starts."""

import json
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from plant_sim.scene import Scene, load_scene, read_scene
from plant_sim.simulation import simulate
from tools import cli
from tools.output import EXIT_BAD_INPUT, EXIT_PASSED, BadInputError
from tools.study.branches.boundaries import boundaries, margins
from tools.study.branches.branches import Branch, branches
from tools.study.branches.continuation import CurvePoint, correct, follow, locate, point_at
from tools.study.branches.impact_map import Orbit
from tools.study.branches.parameters import PARAMETERS, value_in, with_values
from tools.study.branches.saddle import after, portrait
from tools.study.orbits import State, classify

ROOT = Path(__file__).parents[3]
MASS_KG, SPRING_N_PER_M, REST_M = 0.8, 70.0, 0.12
OMEGA_0 = math.sqrt(SPRING_N_PER_M / MASS_KG)
ROUNDING, ROUNDING_M_S = 1e-12, 1e-12
"""Rounding errors of linear algebra, relative and of a speed near 0: they differ between processors."""


@dataclass(frozen=True)
class Viscous:
    """A module with viscous friction and a rigid stop, and the closed form of its orbits with one impact.

    Between two impacts apart by T, a whole number of turns, x(t) = s(t) + e^(Ft) (x⁺ − s⁰) with the steady
    motion s. From x⁺ = (g, −k v) to x⁻ = (g, v) after T, where s has returned to s⁰ = (p, q):

        (I − M)(p, q) = (g, v) − M (g, −k v),   M = e^(FT)

    so (p, q) is linear in v. It lies on the steady motion's ellipse p² + q²/Ω² = |H|², H = ω² A /
    (ω² − Ω² + 2iσΩ): a quadratic in v. Two orbits meet where its discriminant is zero.
    """

    b_n_s_m: float = 0.2
    restitution: float = 0.5
    amplitude_m: float = 0.02
    gap_m: float = 0.06
    turns: int = 1

    def scene(self, ratio: float = 1.1) -> Scene:
        return load_scene(
            {
                "striker": {"mass_kg": MASS_KG, "spring_n_m": SPRING_N_PER_M, "rest_length_m": REST_M},
                "drive": {"model": "ideal", "amplitude_m": self.amplitude_m, "ratio": ratio},
                "friction": {"law": "viscous", "b_n_s_m": self.b_n_s_m},
                "stop": {
                    "law": "rigid", "position_m": REST_M + self.gap_m, "restitution": self.restitution,
                },
            }
        )  # fmt: skip

    def steady(self, ratio: float) -> complex:
        Omega = ratio * OMEGA_0
        drag = self.b_n_s_m / MASS_KG * Omega
        return OMEGA_0**2 * self.amplitude_m / (OMEGA_0**2 - Omega**2 + 1j * drag)

    def quadratic(self, ratio: float):
        """Coefficients of the quadratic in v, M, and (p, q) at v = 0 and per v."""
        Omega, k, g = ratio * OMEGA_0, self.restitution, self.gap_m
        F = np.array([[0.0, 1.0], [-(OMEGA_0**2), -self.b_n_s_m / MASS_KG]])
        M = expm(F * self.turns * 2.0 * math.pi / Omega)
        inverse = np.linalg.inv(np.eye(2) - M)
        at_0 = inverse @ (np.eye(2) - M) @ (g, 0.0)
        per_v = inverse @ (np.array([0.0, 1.0]) + k * M @ (0.0, 1.0))
        scale = np.array([1.0, 1.0 / Omega])
        one, other = scale * per_v, scale * at_0
        return (one @ one, 2.0 * one @ other, other @ other - abs(self.steady(ratio)) ** 2), M, at_0, per_v

    def discriminant(self, ratio: float) -> float:
        a, b, c = self.quadratic(ratio)[0]
        return float(b * b - 4.0 * a * c)

    def orbits(self, ratio: float) -> list[tuple[float, np.ndarray]]:
        """v⁻ and multipliers of both orbits, by saltation at the impact: v⁻ ascending."""
        (a, b, c), M, at_0, per_v = self.quadratic(ratio)
        Omega, k, found = ratio * OMEGA_0, self.restitution, []
        root = math.sqrt(b * b - 4.0 * a * c)
        for v in ((-b - root) / (2.0 * a), (-b + root) / (2.0 * a)):
            p, q = at_0 + v * per_v
            piston = (self.amplitude_m * (q / Omega + 1j * p) / self.steady(ratio)).imag
            push = OMEGA_0**2 * (piston - self.gap_m)
            before, after = push - self.b_n_s_m / MASS_KG * v, push + self.b_n_s_m / MASS_KG * k * v
            # δv⁺ = −k δv⁻ + (a⁺ + k a⁻) δx⁻ / v⁻
            saltation = np.array([[-k, 0.0], [(after + k * before) / v, -k]])
            found.append((v, np.linalg.eigvals(M @ saltation)))
        return found

    def fold(self) -> float:
        grid = np.linspace(1.05, 2.4, 400)
        signs = [self.discriminant(r) for r in grid]
        place = next(i for i in range(len(grid) - 1) if signs[i] > 0.0 > signs[i + 1])
        root: float = brentq(self.discriminant, grid[place], grid[place + 1], xtol=1e-14)
        return root

    def grazing(self) -> tuple[float, float]:
        """Ratios at which |H| is the gap: a quadratic in r²."""
        zeta2 = (self.b_n_s_m / MASS_KG / OMEGA_0) ** 2
        middle, product = 1.0 - 0.5 * zeta2, 1.0 - (self.amplitude_m / self.gap_m) ** 2
        root = math.sqrt(middle**2 - product)
        return math.sqrt(middle - root), math.sqrt(middle + root)


def sampled(count: int, seed: int) -> list[Viscous]:
    rng = np.random.default_rng(seed)
    rows = rng.uniform((0.05, 0.3, 0.015, 0.045), (0.4, 0.7, 0.03, 0.07), (count, 4))
    return [Viscous(*map(float, row)) for row in rows]


def kinds(branch: Branch, kind: str) -> list[Orbit]:
    return [one.orbit for one in branch.special if one.kind == kind]


def test_the_closed_form_gives_the_published_numbers() -> None:
    module = Viscous()
    assert module.fold() == pytest.approx(1.408974292, abs=5e-10)
    assert module.grazing() == pytest.approx((0.816934812, 1.154081118), abs=6e-10)
    v, multipliers = module.orbits(1.3)[0]
    assert v == pytest.approx(0.361403550, abs=5e-10)
    assert sorted(multipliers.real) == pytest.approx([0.083117, 2.643330], abs=5e-7)


def compared_with_the_closed_form(branch: Branch, module: Viscous) -> int:
    """Check speed and multipliers of the orbits away from grazing and folds; return the number of them."""
    compared = 0
    for orbit in branch.orbits:
        ratio = orbit.values["ratio"]
        if orbit.v_m_s[0] > 0.05 and module.discriminant(ratio) > 1e-6:
            v, multipliers = min(module.orbits(ratio), key=lambda one: abs(one[0] - orbit.v_m_s[0]))
            assert orbit.v_m_s[0] == pytest.approx(v, abs=1e-10)
            assert sorted(np.abs(orbit.multipliers)) == pytest.approx(sorted(np.abs(multipliers)), abs=1e-9)
            compared += 1
    return compared


@pytest.mark.parametrize("module", [Viscous(), *sampled(3, seed=46)], ids=str)
def test_folds_grazing_and_multipliers_are_those_of_the_closed_form(module: Viscous) -> None:
    branch = max(branches(module.scene(), "ratio"), key=lambda one: len(one.orbits))
    assert min(abs(one.values["ratio"] - module.fold()) for one in kinds(branch, "fold")) < 1e-10
    grazed = [one.values["ratio"] for one in kinds(branch, "grazing") if one.v_m_s[0] < 1e-9]
    assert grazed
    for ratio in grazed:
        assert min(abs(ratio - one) for one in module.grazing()) < 1e-10
    assert compared_with_the_closed_form(branch, module) > 10


def test_the_operating_point_lies_on_the_stable_and_on_the_unstable_orbit() -> None:
    (branch,) = branches(Viscous().scene(1.3), "ratio")
    unstable, stable = sorted(branch.operating, key=lambda one: float(one.v_m_s[0]))
    assert (unstable.is_stable, stable.is_stable) == (False, True)
    assert unstable.v_m_s[0] == pytest.approx(0.361403550, abs=1e-9)
    assert sorted(unstable.multipliers.real) == pytest.approx([0.083117, 2.643330], abs=1e-6)


@pytest.mark.parametrize("over", ["gap", "amplitude", "restitution", "b"])
def test_a_branch_over_another_parameter_passes_the_same_orbit_and_ends_on_the_same_fold(over: str) -> None:
    module = Viscous()
    scene = module.scene(1.3)
    (fold,) = [
        one.at for one in margins(scene, (over,)) if one.kind == "fold" and one.at != value_in(scene, over)
    ]
    field = {"gap": "gap_m", "amplitude": "amplitude_m", "restitution": "restitution", "b": "b_n_s_m"}[over]
    moved = Viscous(**{**module.__dict__, field: fold})
    assert moved.fold() == pytest.approx(1.3, abs=1e-9)


def test_the_boundaries_of_two_parameters_are_those_of_the_closed_form() -> None:
    module = Viscous()
    scene = module.scene(1.3)
    curves = boundaries(scene, ("ratio", "b"), branches(scene, "ratio"))
    assert {curve.kind for curve in curves} == {"fold", "grazing", "period-doubling"}
    assert all(orbit.values["b"] >= 0.0 for curve in curves for orbit in curve.orbits)
    compared = 0
    for curve in curves:
        for orbit in curve.orbits[::7]:
            there = Viscous(b_n_s_m=orbit.values["b"])
            if 0.0 < there.b_n_s_m < 1.5:
                if curve.kind == "fold":
                    assert there.fold() == pytest.approx(orbit.values["ratio"], abs=1e-9)
                elif curve.kind == "grazing":
                    assert min(abs(orbit.values["ratio"] - one) for one in there.grazing()) < 1e-10
                else:
                    near = min(
                        there.orbits(orbit.values["ratio"]), key=lambda one: abs(one[0] - orbit.v_m_s[0])
                    )
                    assert min(near[1].real) == pytest.approx(-1.0, abs=1e-8)
                compared += 1
    assert compared > 9


def test_a_doubling_is_a_boundary_of_the_single_orbit_alone() -> None:
    scene = Viscous().scene()
    curves = boundaries(scene, ("ratio", "restitution"), branches(scene, "ratio", 2, 2))
    assert sorted(curve.kind for curve in curves) == ["fold", "grazing"]
    for curve in curves:
        assert all(0.0 <= one.values["restitution"] <= 1.0 for one in curve.orbits)
        assert min(abs(one.values["restitution"] - 0.5) for one in curve.orbits) < 0.05
        if curve.kind == "grazing":
            assert all(min(one.v_m_s) == pytest.approx(0.0, abs=1e-6) for one in curve.orbits)


def test_two_grazings_less_than_a_centimetre_apart_are_two_boundaries() -> None:
    scene = Viscous().scene(0.65)
    curves = boundaries(scene, ("gap", "b"), branches(scene, "gap"))
    assert [curve.kind for curve in curves].count("grazing") == 2


def started(scene: Scene, orbit: Orbit, phase_rad: float, v_m_s: float) -> Scene:
    """The scene of an orbit's parameters just after an impact at a phase with an approach speed."""
    there = with_values(scene, orbit.values)
    rebound_m_s = -there.stop.restitution * float(v_m_s)
    initial = there.initial.model_copy(update={"x_m": there.stop.position_m, "v_m_s": rebound_m_s})
    drive = there.drive.model_copy(update={"phase_rad": float(phase_rad) % (2.0 * math.pi)})
    return there.model_copy(update={"initial": initial, "drive": drive})


def impacts_at_the_end(scene: Scene, orbit: Orbit, ratio: float, turns: int) -> int:
    """Impacts in the last tenth of a simulation that starts on an orbit, at another ratio."""
    there = with_values(started(scene, orbit, orbit.crank_rad[0], orbit.v_m_s[0]), {"ratio": ratio})
    until_s = turns * 2.0 * math.pi / (ratio * there.natural_rad_s)
    return int(np.sum(simulate(there, until_s).impacts.t_s > 0.9 * until_s))


@pytest.mark.parametrize("name", ["table1-coulomb", "table1-stribeck"])
def test_the_fold_is_bracketed_by_direct_simulation(name: str) -> None:
    scene = load_scene(name)
    (branch,) = branches(scene, "ratio")
    fold = next(one for one in kinds(branch, "fold"))
    at = fold.values["ratio"]
    stable = min(
        (one for one in branch.orbits if one.is_stable and one.values["ratio"] < at),
        key=lambda one: at - one.values["ratio"],
    )
    assert impacts_at_the_end(scene, stable, at - 1e-6, 6000) > 0
    assert impacts_at_the_end(scene, stable, at + 1e-6, 6000) == 0


def test_orbits_that_impact_every_second_turn_are_those_of_the_closed_form() -> None:
    module = Viscous(turns=2)
    (branch,) = branches(module.scene(), "ratio", 2, 1)
    assert compared_with_the_closed_form(branch, module) > 20
    for doubling in kinds(branch, "period-doubling"):
        near = min(module.orbits(doubling.values["ratio"]), key=lambda one: abs(one[0] - doubling.v_m_s[0]))
        assert min(near[1].real) == pytest.approx(-1.0, abs=1e-8)


@pytest.mark.parametrize("name", ["table1-viscous", "table1-coulomb"])
def test_a_period_doubling_leads_to_an_impact_every_second_turn(name: str) -> None:
    """The branch of 2/2 runs from the doubling of 1/1 to the grazing of one impact, where 2/1 begins."""
    scene = load_scene(name)
    (single,), (double,), (second,) = (branches(scene, "ratio", *kind) for kind in ((1, 1), (2, 2), (2, 1)))
    (doubling,) = kinds(single, "period-doubling")
    first, last = double.special[0], double.special[-1]
    assert (first.kind, first.ends, last.kind, last.ends) == ("period-doubling", True, "grazing", True)
    assert first.orbit.values["ratio"] == pytest.approx(doubling.values["ratio"], rel=ROUNDING)
    assert first.orbit.v_m_s == pytest.approx(np.tile(doubling.v_m_s, 2), abs=1e-12)
    assert sorted(np.abs(first.orbit.multipliers)) == pytest.approx(
        sorted(np.abs(doubling.multipliers) ** 2), abs=1e-9
    )
    assert min(last.orbit.v_m_s) < 1e-9
    ratio = last.orbit.values["ratio"]
    touching = min(kinds(second, "grazing"), key=lambda one: abs(one.values["ratio"] - ratio))
    assert touching.values["ratio"] == pytest.approx(ratio, abs=1e-9)
    assert touching.v_m_s[0] == pytest.approx(max(last.orbit.v_m_s), abs=1e-8)


def test_a_branch_of_twice_the_period_can_run_from_one_period_doubling_to_another() -> None:
    scene = Viscous(restitution=0.48).scene()
    (parent,) = branches(scene, "ratio", 2, 1)
    lower, upper = sorted(one.values["ratio"] for one in kinds(parent, "period-doubling"))[1:]
    found = branches(scene, "ratio", 4, 2)
    ends = [pytest.approx(one, rel=ROUNDING) for one in (lower, upper)]
    between = next(branch for branch in found if branch.orbits[0].values["ratio"] in ends)
    assert [(one.kind, one.ends) for one in between.special] == [("period-doubling", True)] * 2
    assert sorted(one.orbit.values["ratio"] for one in between.special) == ends
    ratios = [one.values["ratio"] for one in between.orbits]
    assert (min(ratios), max(ratios)) == tuple(ends)
    assert all(one.is_stable for one in between.orbits[2:-2])


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        *((name, kind) for name in ("table1-viscous", "table1-coulomb") for kind in ((1, 1), (2, 1), (2, 2))),
        ("table1-stribeck", (1, 1)),
    ],
    ids=str,
)
def test_orbits_return_in_direct_simulation_with_the_derivative_that_is_stated(name: str, kind) -> None:
    scene = load_scene(name).with_({"solver.accuracy": 1e-12})
    turns, impacts = kind
    compared = 0
    for branch in branches(scene, "ratio", turns, impacts):
        for orbit in branch.orbits:
            if np.min(orbit.v_m_s) > 0.02 and orbit.clearance_m > 1e-3:
                start = np.array([orbit.crank_rad[0], orbit.v_m_s[0]])
                crank_rad, v_m_s = impacts_from(scene, orbit, start, turns, impacts)
                assert v_m_s == pytest.approx(np.roll(orbit.v_m_s, -1), abs=1e-9)
                wanted = np.append(orbit.crank_rad[1:], orbit.crank_rad[0] + 2.0 * math.pi * turns)
                assert crank_rad == pytest.approx(wanted, abs=1e-9)
                columns = []
                for step in 1e-6 * np.eye(2):
                    ahead, behind = (
                        np.array(impacts_from(scene, orbit, start + side * step, turns, impacts))[:, -1]
                        for side in (1.0, -1.0)
                    )
                    columns.append((ahead - behind) / 2e-6)
                measured = np.linalg.eigvals(np.column_stack(columns))
                stated = orbit.multipliers
                assert np.sum(measured) == pytest.approx(np.sum(stated), rel=1e-5, abs=1e-6)
                assert np.prod(measured) == pytest.approx(np.prod(stated), rel=1e-4, abs=1e-6)
                compared += 1
    assert compared > 4


def impacts_from(
    scene: Scene, orbit: Orbit, start: np.ndarray, turns: int, impacts: int
) -> tuple[np.ndarray, np.ndarray]:
    """Crank angles (rad, counted on) and v⁻ of the impacts that follow an impact at a phase with a v⁻."""
    there = started(scene, orbit, start[0], start[1])
    turn_s = 2.0 * math.pi / (value_in(there, "ratio") * there.natural_rad_s)
    found = simulate(there, (turns + 0.2) * turn_s).impacts
    crank_rad = start[0] + 2.0 * math.pi * found.t_s / turn_s
    return crank_rad[:impacts], found.v_m_s[:impacts]


def test_a_striker_that_sticks_has_a_multiplier_that_is_exactly_zero() -> None:
    table = read_scene("table1-coulomb")
    table["friction"]["mu"], table["stop"]["position_m"] = 0.1, REST_M + 0.03
    (branch,) = branches(load_scene(table), "ratio")
    (begins,) = kinds(branch, "stick")
    assert begins.margin_m == pytest.approx(0.0, abs=3e-10)  # it changes by 3 m per unit of the ratio
    sticking = [one for one in branch.orbits if one.margin_m < -1e-6 and one.v_m_s[0] > 1e-3]
    assert len(sticking) > 20
    assert all(one.multipliers[1] == 0.0 for one in sticking)
    assert all(one.multipliers[1] != 0.0 for one in branch.orbits if one.margin_m > 1e-6)
    grazing = [one for one in branch.orbits if one.v_m_s[0] < 1e-9]
    assert len(grazing) == 2
    assert all(np.all(np.isinf(one.multipliers)) for one in grazing)


def test_a_grazing_where_the_parameter_turns_round_is_no_fold() -> None:
    """There v⁻ grows as a root of the parameter, and the other half of the curve is behind the stop."""
    (branch,) = branches(load_scene("table1-coulomb"), "mu")
    assert [(one.kind, one.ends) for one in branch.special] == [("grazing", True)]


def test_a_branch_that_leaves_the_range_of_its_parameter_ends_there_by_no_grazing() -> None:
    """Without a rebound a flight begins on the stop: at k = 0 that is no touch between two impacts."""
    (branch,) = branches(load_scene("table1-coulomb"), "restitution")
    assert branch.special == []
    assert min(one.values["restitution"] for one in branch.orbits) < 0.05


def test_branches_of_a_crank_that_stands_are_refused() -> None:
    with pytest.raises(BadInputError, match="the drive's speed is 0"):
        branches(Viscous().scene(0.0), "gap")


@pytest.mark.parametrize(("mu", "mu_s", "changed_mu_s"), [(0.0, 0.1, 0.15), (0.1, 0.2, 0.1)])
def test_static_friction_changes_with_sliding_friction(mu: float, mu_s: float, changed_mu_s: float) -> None:
    """As its multiple, or by the same difference where there is no sliding friction."""
    law = {"law": "stribeck", "mu": mu, "mu_s": mu_s, "v_s_m_s": 0.05, "delta": 1.0}
    scene = with_values(load_scene(read_scene("table1-stribeck") | {"friction": law}), {"mu": 0.05})
    assert scene.friction.mu_s == pytest.approx(changed_mu_s)


@pytest.mark.parametrize(("over", "limit"), [("b", 0.0), ("restitution", 1.0), ("gap", 0.0)])
def test_a_branch_ends_at_the_limit_of_its_parameter(over: str, limit: float) -> None:
    """There is no negative damping, and no rebound faster than the approach."""
    (branch,) = branches(Viscous().scene(1.3), over)
    values = [orbit.values[over] for orbit in branch.orbits]
    assert min(abs(value - limit) for value in (values[0], values[-1])) < 1e-12
    assert all(PARAMETERS[over].low - 1e-12 <= value <= PARAMETERS[over].high + 1e-12 for value in values)
    assert all(one.is_admissible for one in branch.orbits[1:-1])


def test_a_curve_is_followed_round_its_folds() -> None:
    def circle(z: np.ndarray):
        return np.array([z @ z - 1.0]), 2.0 * z[None, :]

    start = point_at(circle, np.array([0.0, 1.0]), np.array([1.0, 0.0]))
    assert start is not None
    points = [start, *follow(circle, start, 0.1, 100)]
    turned = np.unwrap([math.atan2(*point.at) for point in points])
    assert turned[-1] > 2.0 * math.pi
    before, after = next(
        (one, other) for one, other in pairwise(points) if one.tangent[0] > 0.0 > other.tangent[0]
    )
    fold = locate(circle, before, after, lambda point: float(point.tangent[0]))
    assert fold is not None
    assert fold.at == pytest.approx([1.0, 0.0], abs=1e-12)


def test_a_guess_that_leads_nowhere_is_no_zero() -> None:
    def empty(z: np.ndarray):
        return np.array([z @ z + 1.0]), 2.0 * z[None, :]

    assert correct(empty, np.array([0.3, 0.1])) is None
    lost = CurvePoint(np.array([0.3, 0.1]), np.array([1.0, 0.0]))
    assert list(follow(empty, lost, 0.1, 5)) == []


def test_a_soft_stop_has_a_fold_of_its_own() -> None:
    pad = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
    (branch,) = branches(load_scene("table1-viscous").with_({"stop": pad}), "ratio")
    highest = max(one.values["ratio"] for one in kinds(branch, "fold"))
    assert highest == pytest.approx(1.3921982, abs=1e-6)


@pytest.mark.parametrize("name", ["table1-viscous", "table1-coulomb", "table1-stribeck"])
def test_no_special_point_of_a_soft_stop_lies_beyond_the_grazing_that_ends_the_branch(name: str) -> None:
    """Beyond it v⁻ is negative, and next to it the central differences reach beyond it."""
    pad = {"law": "hunt-crossley", "position_m": 0.18, "restitution": 0.5, "contact_s": 0.01}
    (branch,) = branches(load_scene({**read_scene(name), "stop": pad}), "ratio")
    ends = [branch.special[0], branch.special[-1]]
    assert [(one.kind, one.ends) for one in ends] == [("grazing", True)] * 2
    assert [one.orbit.v_m_s[0] for one in ends] == pytest.approx([0.0, 0.0], abs=ROUNDING_M_S)
    assert min(orbit.v_m_s[0] for orbit in branch.orbits) >= -ROUNDING_M_S
    assert min(one.orbit.v_m_s[0] for one in branch.special[1:-1]) > 1e-3


def test_the_commands_answer_in_json_and_draw_their_figures(tmp_path, capsys) -> None:
    assert cli.run(["study", "branches", "--json", "--out", str(tmp_path)]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    (branch,) = payload["branches"]
    assert {"ratio", "v_m_s", "multipliers", "stable"} <= set(branch["points"][0])
    assert [one["kind"] for one in branch["special"]] == ["grazing", "period-doubling", "fold", "grazing"]
    assert all((tmp_path / path.rpartition("/")[2]).stat().st_size > 5000 for path in payload["figures"])
    command = ["study", "boundaries", "table1-coulomb", "--over", "ratio,mu", "--json"]
    assert cli.run([*command, "--out", str(tmp_path)]) == EXIT_PASSED
    payload = json.loads(capsys.readouterr().out)
    assert {one["parameter"] for one in payload["margins"]} == {"ratio", "mu"}
    assert {curve["kind"] for curve in payload["boundaries"]} == {"fold", "grazing", "period-doubling"}


def test_an_orbit_that_grazes_is_shown_at_no_speed_without_a_sign(tmp_path, capsys) -> None:
    assert cli.run(["study", "branches", "--out", str(tmp_path)]) == EXIT_PASSED
    grazing = [line.split() for line in capsys.readouterr().out.splitlines() if " grazing " in line]
    assert [line[3] for line in grazing] == ["0.000000", "0.000000"]


def test_a_scene_without_a_stop_has_no_impact_orbits(tmp_path, capsys) -> None:
    scene = tmp_path / "free.toml"
    scene.write_text(
        "[striker]\nmass_kg = 0.8\nspring_n_m = 70.0\nrest_length_m = 0.12\n"
        '[drive]\nmodel = "ideal"\namplitude_m = 0.02\nratio = 1.1\n'
    )
    assert cli.run(["study", "branches", str(scene)]) == EXIT_BAD_INPUT
    assert "impact orbits need a stop" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["branches", "table1-motor-soft"], "drive.model = 'motor'"),
        (["branches", "--over", "mu"], "friction.law = 'viscous', which has no mu"),
        (["branches", "--orbit", "2"], "wanted n/m"),
        (["branches", "--orbit", "0/1"], "wanted n/m"),
        (["boundaries", "--over", "ratio"], "wanted two of"),
        (["boundaries", "--over", "ratio,ratio"], "wanted two of"),
    ],
)
def test_what_cannot_be_followed_is_refused_with_the_remedy(arguments, says, capsys) -> None:
    assert cli.run(["study", *arguments]) == EXIT_BAD_INPUT
    assert says in " ".join(capsys.readouterr().err.split())


def test_the_page_states_what_is_computed() -> None:
    page = (ROOT / "docs/explanation/branches.md").read_text(encoding="utf-8")
    scene = load_scene("table1-viscous")
    for turns, impacts in ((1, 1), (2, 2), (2, 1)):
        for branch in branches(scene, "ratio", turns, impacts):
            for special in branch.special:
                assert f"| {special.orbit.values['ratio']:.9f} |" in page
                assert f"{max(special.orbit.v_m_s):.6f}" in page or special.kind == "grazing"
            for orbit in branch.operating:
                assert f"{orbit.v_m_s[0]:.6f} m/s" in page
    for margin in margins(scene, ("ratio", "b", "gap", "amplitude", "restitution")):
        scale, digits = (1e3, 3) if margin.unit == "m" else (1.0, 6)
        if margin.kind == "fold":
            assert f"fold at {scale * margin.at:.{digits}f}" in page
            assert f"{scale * margin.distance:+.{digits}f}".replace("-", "−") in page


@pytest.mark.parametrize("name", ["table1-viscous", "table1-coulomb"])
def test_the_unstable_orbit_lies_on_the_border_of_the_basins(name: str) -> None:
    table = read_scene(name)
    if name == "table1-coulomb":
        table["friction"]["mu"], table["drive"]["ratio"] = 0.15, 1.2
    scene = load_scene(table)
    found = portrait(scene)
    assert (len(found.attractors), len(found.saddles)) == (2, 1)
    for point in (*found.attractors, *found.saddles):
        assert after(scene, State(*point, 0.0), 1.0)[:2] == pytest.approx(point, abs=1e-9)
    angles = np.linspace(0.0, 2.0 * math.pi, 360, endpoint=False)
    for radius_m in (1e-6, 1e-4):
        around = found.saddles[0] + radius_m * np.column_stack((np.cos(angles), 9.35 * np.sin(angles)))
        starts = np.column_stack((around, np.zeros(len(around))))
        in_impacts = classify(scene, starts)[1] > 0.0
        assert np.sum(in_impacts != np.roll(in_impacts, 1)) == 2
        assert 0.4 < np.mean(in_impacts) < 0.6
