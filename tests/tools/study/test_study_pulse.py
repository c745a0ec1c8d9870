"""One pulse a stride: the pump against the closed form, the gate, what counts, and what each way gives."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from firmware_py.core.control import spin_down
from firmware_py.shell.parameters import config_from
from hil.scenario.scenario import read_scenario
from plant_sim.parts.walking import Walking
from plant_sim.result import Impact
from plant_sim.scene import load_scene, read_scene
from tools import cli
from tools.output import EXIT_BAD_INPUT
from tools.study.feasibility.feasibility import STEP_S, Driven
from tools.study.pulse import gate
from tools.study.pulse.gate import WINDOW_MIDDLE, Gate, GateState, Stage
from tools.study.pulse.gated import SCENES, SETTLING, gated
from tools.study.pulse.judging import GATED, SUBHARMONIC, TURN, Walked, judged
from tools.study.pulse.orbits import Band, bands_of, once_in
from tools.study.pulse.turns import GROUNDS, MADE, WALK, Ground, Made, locked, made_for, made_piece
from tools.study.pulse.turns import scene as scene_of

FIRMWARE = read_scenario(SCENES["walking"][1])["firmware"]
CONFIG = config_from(FIRMWARE)
GATE = Gate(CONFIG.spin_down, CONFIG.gait_lock.lowest_confidence)
OMEGA = CONFIG.spin_down.natural_rad_s
L0, A = CONFIG.spin_down.rest_length_m, CONFIG.spin_down.amplitude_m
PARKED = -0.5 * math.pi


# --- the pump ----------------------------------------------------------------------------------------------


def test_a_crank_that_sets_out_at_resonance_pumps_as_the_closed_form_says() -> None:
    """y'' + y = sin(τ − π/2) from rest at −1, by scipy."""
    from scipy.integrate import solve_ivp

    tau = np.linspace(0.0, 3.5 * math.pi, 2000)
    solved = solve_ivp(
        lambda t, y: (y[1], math.sin(t - 0.5 * math.pi) - y[0]),
        (0.0, tau[-1]),
        (-1.0, 0.0),
        t_eval=tau,
        rtol=1e-10,
        atol=1e-12,
    )
    assert solved.y[0] == pytest.approx(-np.cos(tau) - 0.5 * tau * np.sin(tau), abs=1e-8)
    assert solved.y[0][tau < 2.0 * math.pi].max() == pytest.approx(2.41, abs=0.01)
    assert solved.y[0].max() == pytest.approx(5.52, abs=0.03)
    for gap in (2.42, 3.0, 3.38, 5.4):
        at = gate.impact_at_rad(gap)
        assert np.interp(at, tau, solved.y[0]) == pytest.approx(gap, abs=1e-3)
        assert solved.y[0][tau < at].max() < gap + 1e-3


@pytest.mark.parametrize("psi", [-2.5, -1.0, 0.3, 1.5, 3.0])
def test_pumping_is_the_mirror_of_braking(psi: float) -> None:
    """In step half a turn from each other; the piston's power on the striker differs in its sign alone."""
    swing_m = 2.0 * A
    striker = (L0 + swing_m * math.cos(psi), -swing_m * OMEGA * math.sin(psi))
    assert gate._pumping(GATE, 1.0, psi + math.pi, striker) == pytest.approx(OMEGA)
    behind = gate._pumping(GATE, 1.0, psi + math.pi - 0.1, striker)
    assert behind == pytest.approx(OMEGA * (1.0 + 0.1 * CONFIG.spin_down.gain))
    power = [A * math.sin(theta) * striker[1] for theta in (psi + math.pi, psi)]
    assert power[0] == pytest.approx(-power[1])
    assert power[0] > 0.0


def test_at_rest_the_crank_is_led_to_its_rear_dead_centre_and_damps_only_backward_swings() -> None:
    still = (L0 - A, 0.0)
    assert gate._resting(GATE, PARKED, still) == pytest.approx(0.0, abs=1e-9)
    assert gate._resting(GATE, PARKED + 0.2, still) < 0.0
    assert gate._resting(GATE, PARKED, (L0 - A, -A * OMEGA)) > 0.0
    assert gate._resting(GATE, PARKED, (L0 - A, A * OMEGA)) == pytest.approx(0.0, abs=1e-9)


# --- the gate ----------------------------------------------------------------------------------------------


def at_phase(state: GateState, phase: float, confidence: float = 1.0, touch_down: bool = False) -> GateState:
    """A tick of a stride of 1 s with the striker at rest under a parked crank."""
    return gate.step(GATE, state, (phase, confidence, 1.0), PARKED, (L0 - A, 0.0), touch_down)


def test_the_crank_sets_out_by_its_lead_before_the_middle_once_a_stride() -> None:
    first = gate.initial(GATE)
    sets_out = WINDOW_MIDDLE - first.lead_s
    assert first.lead_s * OMEGA == pytest.approx(gate.impact_at_rad(0.022 / A))
    assert at_phase(first, sets_out - 0.01).stage == Stage.REST
    assert at_phase(first, sets_out + 0.01, confidence=0.1).stage == Stage.REST
    pumping = at_phase(first, sets_out + 0.01)
    assert (pumping.stage, pumping.armed) == (Stage.PUMP, False)
    met_stop = at_phase(pumping, WINDOW_MIDDLE, touch_down=True)
    assert met_stop.stage != Stage.PUMP
    assert at_phase(met_stop, sets_out + 0.05).stage != Stage.PUMP
    assert at_phase(met_stop, (sets_out + 0.6) % 1.0).armed


@pytest.mark.parametrize("late", [-0.04, 0.0, 0.05])
def test_a_late_impact_lets_the_next_one_set_out_earlier(late: float) -> None:
    first = gate.initial(GATE)
    pumping = at_phase(first, WINDOW_MIDDLE - first.lead_s + 0.01)
    met_stop = at_phase(pumping, WINDOW_MIDDLE + late, touch_down=True)
    assert met_stop.lead_s - first.lead_s == pytest.approx(GATE.lead_gain * late)


def test_a_impact_that_does_not_come_ends_the_pumping() -> None:
    first = gate.initial(GATE)
    state = at_phase(first, WINDOW_MIDDLE - first.lead_s + 0.01)
    ticks = 0
    while state.stage == Stage.PUMP:
        state = at_phase(state, WINDOW_MIDDLE)
        ticks += 1
    assert ticks * CONFIG.spin_down.tick_s == pytest.approx(2.0 * first.lead_s, abs=0.002)


def test_the_brake_is_the_firmwares_own() -> None:
    state = gate.initial(GATE)._replace(stage=Stage.BRAKE, armed=False)
    striker = (L0 + 0.02, -0.4)
    after = gate.step(GATE, state, (0.6, 1.0, 1.0), 1.0, striker, False)
    assert after.stage == Stage.BRAKE
    assert after.braking.stage == spin_down.SpinDownStage.BRAKE
    assert after.target_rad_s == after.braking.target_omega_rad_s


# --- what counts -------------------------------------------------------------------------------------------


def walked(phases: Sequence[float]) -> Walked:
    """An impact at each of these cycles of an even walk of a stride a second; a pulse of 25 N after each."""
    gait = {"axis": "outward", "variability": 0.0, "pace": [{"at_s": 0.0, "stride_hz": 1.0}]}
    scene = load_scene(read_scene("walking") | {"gait": gait})
    walking = scene.parts().housing
    assert isinstance(walking, Walking)
    t_s = STEP_S * np.arange(1, 2501)
    felt = np.zeros(len(t_s))
    for at in phases:
        felt[(t_s > at + 0.01) & (t_s < at + 0.03)] += 25.0
    impacts = [Impact(at, 0.5, -0.2, 0.5, 20.0, 0.0) for at in phases]
    return Walked(Driven(impacts, t_s, np.zeros(len(t_s)), felt), walking)


def test_a_stride_is_right_with_one_impact_and_that_in_the_window() -> None:
    found = judged([walked([0.5, 1.5, 2.3, 3.46, 3.9])], 0)
    assert found["strides"] == 5
    assert (found["right"], found["without"], found["several"]) == (0.4, 0.2, 0.2)
    assert (found["felt_low_n"], found["felt_high_n"]) == (25.0, 25.0)
    assert judged([walked([1.5, 3.5])], 0)["without"] == 0.6
    assert judged([walked([1.5, 3.5])], 3)["strides"] == 2


def test_neighbouring_ratios_make_a_band_and_single_ones_none() -> None:
    def row(turns: int, ratio: float) -> dict[str, float]:
        return {"turns": turns, "gap_over_amplitude": 2.5, "ratio": ratio, "share": 1.0, "v_share": 1.1}

    found = bands_of([row(2, 0.8), row(2, 0.82), row(2, 0.84), row(2, 0.9), row(3, 0.86)])
    assert [(band.turns, band.low, band.high) for band in found] == [(2, 0.8, 0.84)]
    assert found[0].width == pytest.approx(0.02 / 0.82)


def test_once_in_n_turns_is_one_impact_a_cycle() -> None:
    assert [once_in(*pair) for pair in ((3, 1.0 / 3.0), (1, 1.0), (2, 1.0), (4, 0.5))] == [3, 0, 0, 0]


# --- what each way gives -----------------------------------------------------------------------------------


def test_a_gate_gives_one_impact_a_stride_in_push_off_where_the_swing_is_quick_enough() -> None:
    """On a walker that the study has not, at two cadences; Table 1's module needs longer than a stride."""
    for hertz in (0.7, 1.0):
        found = judged([gated("walking", hertz, 100, SETTLING + 14)], SETTLING)
        assert found["strides"] >= 12
        assert found["right"] >= 0.95
        assert 8.0 < found["felt_low_n"] < found["felt_high_n"] < 20.0
        assert found["phase_std"] < 0.02
    slow = judged([gated("table1", 0.8, 100, SETTLING + 14)], SETTLING)
    assert slow["right"] < 0.6


def made(name: str, way: str) -> Made:
    return next(kind for kind in MADE if (kind.name, kind.way, kind.axis) == (name, way, "outward"))


def right(kind: Made, ground: Ground) -> float:
    """The share of strides that come out right at 0.8 Hz, of one walker."""
    found = made_for(kind, 0.8)
    assert found is not None
    module, start = found
    scene = scene_of(module, kind.axis, 0.8, start, ground)
    return float(judged([locked(scene, kind.turns, 3, 90.0)], 50)["right"])


def test_a_subharmonic_that_is_found_is_followed_but_not_on_a_walk() -> None:
    kind = made("r 0.87", SUBHARMONIC)
    assert right(kind, GROUNDS[0]) == 1.0
    assert right(kind, WALK) < 0.5


def test_one_turn_a_stride_needs_a_spring_for_its_cadence() -> None:
    kind = made("60 mm", TURN)
    assert right(kind, WALK) > 0.9
    module, _ = made_for(kind, 0.8) or pytest.fail("no module")
    assert module.natural_rad_s == pytest.approx(2.0 * math.pi * 0.8 / 1.1)
    fixed = made("60 mm, for 0.8 Hz", TURN)
    assert made_for(fixed, 1.1) == made_for(kind, 0.8)


def test_an_unknown_way_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.run(["study", "pulse", "--way", "luck"]) == EXIT_BAD_INPUT
    assert "'luck' is not one of 'turn', 'subharmonic', 'gated'" in " ".join(capsys.readouterr().err.split())


def test_tables_and_chart_show_every_way_and_a_cadence_without_an_orbit(tmp_path) -> None:
    from tools.output import console
    from tools.study.pulse import figures

    kind = made("r 0.87", SUBHARMONIC)._replace(ratio=1.2)
    none = {"kind": kind._asdict(), "stride_hz": 0.8, "ground": WALK._asdict()}
    rows = made_piece(none)[0].to_pylist()
    assert rows[0]["strides"] == 0
    counted = judged([walked([0.5, 1.5, 2.5])], 0)
    named = {"way": GATED, "module": "walking", "axis": "outward", "turns": 0, "ground": WALK.name}
    rows.append({**named, "stride_hz": 0.9, "leg_alone_hz": math.nan, **counted})
    bands = [Band(2, 2.5, 0.8, 0.94, 1.0, 1.13)]
    with console.capture() as shown:
        console.print(figures.rows_table(rows), figures.bands_table(bands), width=120)
    lines = [line.split() for line in shown.get().splitlines()]
    assert ["2", "turns:", "r", "0.87", "—", "—"] in lines
    assert ["gated:", "walking", "60", "25.0–25.0"] in lines
    assert ["2", "2.5", "0.80–0.94", "8.0", "%", "100", "%", "1.13"] in lines
    assert all(path.endswith(("svg", "png")) for path in figures.chart(rows, bands, tmp_path, "pulse"))
    assert (tmp_path / "pulse.svg").stat().st_size > 0
