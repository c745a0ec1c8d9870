"""The bring-up on simulated modules that are wired wrongly, or broken, in lockstep."""

import json
import math
import shlex
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tomli_w

from firmware_py.interface import codec
from firmware_py.interface.enums import AxisState, Fault, Mode, Refusal
from firmware_py.interface.generated.records import (
    Accelerometer,
    EncoderEstimates,
    FaultEvent,
    FirmwareHeartbeat,
)
from firmware_py.shell.parameters import ParameterError, with_overrides
from hil.record.formats import PARAMETERS
from hil.record.run_folder import RunFolderError, locked
from hil.scenario.parameter_file import read_document, values_of
from hil.timing.clock import TICK_S
from tools import cli
from tools.bring_up import below_impacts, session
from tools.bring_up.first_impacts import Watched, approach, hold
from tools.bring_up.listen import LISTEN
from tools.bring_up.module_fit import value_with_bounds
from tools.bring_up.operated import (
    BEGUN_S,
    LatchedFaultError,
    Operated,
    RatioTooHighError,
    Resting,
    operate,
)
from tools.bring_up.session import STATE, Session, User, read_state
from tools.bring_up.step import NOTHING, Context, Findings, StepFailedError
from tools.bring_up.trials import BROKEN as BROKEN_MODULES
from tools.bring_up.trials import bench_of, beyond_bounds, brought_up, fault
from tools.bring_up.twin import PARAMETER_FILE, SCENE, run_next
from tools.campaign.campaigns import CAMPAIGNS, trial_of
from tools.campaign.identified import explain_no_hold, read_spread, refuse_other_axes, settings_on_twin
from tools.output import EXIT_BAD_INPUT, BadInputError
from tools.tuning.identification.friction_laws import Law
from tools.tuning.result import make_value

WIRED = {
    "as it should be": ([], set()),
    "encoder backward": ([fault("sensor-wrong-sign", sensor="encoder")], {"wiring.torque_reversed"}),
    "encoder turned on its shaft": ([fault("sensor-biased", sensor="encoder", bias=2.0)], set()),
    "low range and housing exchanged": (
        [fault("sensor-swapped", sensors=["striker-low", "housing"])],
        {"wiring.low_exchanged"},
    ),
}


@pytest.mark.parametrize("name", WIRED)
def test_the_drives_step_finds_wiring_and_inertia(name: str, tmp_path: Path) -> None:
    faults, wanted = WIRED[name]
    bench = bench_of({"motor": {"inertia_kg_m2": 4e-4}}, faults, 1)
    result = brought_up(bench, tmp_path / "out", "drive")
    assert result["passed"], result["steps"][-1]["reason"]
    found = result["parameters"]
    assert {one for one in found if one.startswith("wiring.")} == wanted
    assert found["motor.inertia_kg_m2"]["low"] < 4e-4 < found["motor.inertia_kg_m2"]["high"]
    assert 0.9 < found["motor.inertia_kg_m2"]["value"] / 4e-4 < 1.1
    assert beyond_bounds(bench, result["steps"]) == []
    assert bench.largest["drive"].force_n == 0.0
    narrow = {"name": "drive", "bound": {**result["steps"][-1]["bound"], "angle_rad": 0.01}}
    assert len(beyond_bounds(bench, [narrow])) == 1


def test_a_script_begins_once_the_crank_rests() -> None:
    """The striker may turn the crank after a stop, and the drive's proof waits for that."""
    player, tick = Resting(), 0
    for speed_rev_s, ticks in ((0.5, 700), (0.0, 900), (0.5, 1), (0.0, 1000)):
        for _ in range(ticks):
            assert (
                player.play(tick, [codec.ENCODER_ESTIMATES.encode(EncoderEstimates(0.1, speed_rev_s))]) == ()
            )
            tick += 1
    assert player.play(tick, [codec.ENCODER_ESTIMATES.encode(EncoderEstimates(0.1, 0.0))]) is None


def test_a_motion_waits_for_a_crank_that_still_turns(tmp_path: Path) -> None:
    bench = bench_of({"initial": {"v_m_s": 0.8}}, [], 1)  # the striker shakes the crank
    context = Context(bench, tmp_path, with_overrides({}), {}, lambda _: True, lambda _: None, 1.25)
    begun_s: list[float] = []
    play = bench.play

    def noted(*given: Any) -> None:
        begun_s.append(bench.tick * TICK_S)
        play(*given)

    bench.play = noted  # type: ignore[method-assign]
    operate(context, Operated([], 0.1), tmp_path / "motion.log", context.values)
    assert begun_s[-1] > 1.5
    assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.2


@pytest.mark.parametrize("speed_rev_s", [None, 0.5])
def test_a_crank_that_turns_or_is_not_seen_begins_no_script(speed_rev_s: float | None) -> None:
    player = Resting()
    frames = (
        [] if speed_rev_s is None else [codec.ENCODER_ESTIMATES.encode(EncoderEstimates(0.1, speed_rev_s))]
    )
    for tick in range(40_000):
        assert player.play(tick, frames) == ()
    with pytest.raises(StepFailedError, match="does not rest within 40 s"):
        player.play(40_000, frames)


@pytest.mark.parametrize(("way_m", "mu", "is_missing"), [(0.07, 0.086, False), (0.09, 0.086, True)])
def test_dry_friction_is_not_taken_for_a_swing_beyond_the_stop(
    way_m: float, mu: float, is_missing: bool
) -> None:
    """The acceleration of a striker that turns round has the friction besides the way's."""
    omega_rad_s = 7.0
    beat = FirmwareHeartbeat(*[0] * len(FirmwareHeartbeat._fields))._replace(
        mode=Mode.RUN, target_omega_rad_s=omega_rad_s
    )
    player = Watched([], 10.0, with_overrides({"friction.mu": mu}), 14)
    reason = ""
    for tick in range(3000):
        angle_rad = omega_rad_s * TICK_S * tick
        felt_m_s2 = way_m * omega_rad_s**2 * math.sin(angle_rad) + 9.81 * mu * math.tanh(
            3.0 * math.sin(angle_rad)
        )
        frames = [codec.ACCELEROMETER.encode(Accelerometer(felt_m_s2, felt_m_s2, 0.0), tick % 256)]
        if tick % 100 == 0:
            frames.append(codec.FIRMWARE_HEARTBEAT.encode(beat))
        try:
            player.play(tick, frames)
        except StepFailedError as error:
            reason = str(error)
            break
    assert ("missing or displaced" in reason) == is_missing


@pytest.mark.parametrize(("speed_m_s", "ends"), [(0.05, False), (0.3, True)])
def test_an_approach_goes_on_until_impacts_are_no_grazing_ones(speed_m_s: float, ends: bool) -> None:
    """Those of a soft stop are seen from a few m/s² on; slow ones do not show where the stop is."""
    player, contact_s = Watched([], 30.0, with_overrides({}), 14), 0.02
    beat = FirmwareHeartbeat(*[0] * len(FirmwareHeartbeat._fields))._replace(mode=Mode.RUN)
    ended_tick = 0
    for tick in range(20_000):
        phase = (tick % 1000 - 500) * TICK_S / contact_s
        push_m_s2 = math.sin(math.pi * phase) * math.pi / 2.0 * 1.5 * speed_m_s / contact_s
        felt_m_s2 = -2.0 - (push_m_s2 if 0.0 < phase < 1.0 else 0.0)
        frames = [codec.ACCELEROMETER.encode(Accelerometer(felt_m_s2, felt_m_s2, 0.0), tick % 256)]
        if tick % 100 == 0:
            frames.append(codec.FIRMWARE_HEARTBEAT.encode(beat))
        player.play(tick, frames)
        if player.ended_tick == tick:
            ended_tick = tick
            break
    assert len(player.seen) >= 14
    assert bool(ended_tick) == ends


def test_a_striker_that_friction_holds_in_the_drives_step_shows_its_channel_in_the_sweep(
    tmp_path: Path,
) -> None:
    friction = {"law": "stribeck", "mu": 0.0257, "mu_s": 0.0334, "v_s_m_s": 0.1, "delta": 1.0}
    bench = bench_of({"friction": friction}, [fault("sensor-swapped", sensors=["striker-low", "housing"])], 1)
    result = brought_up(bench, tmp_path / "out", "below-impacts")
    assert result["passed"], result["steps"][-1]["reason"]
    assert "wiring.low_exchanged" in result["parameters"]
    assert result["parameters"]["striker.spring_n_m"]["value"] == pytest.approx(70.0, rel=0.02)


@pytest.mark.parametrize(
    "friction",
    [
        {"law": "coulomb", "mu": 0.08},
        {"law": "stribeck", "mu": 0.0545, "mu_s": 0.0708, "v_s_m_s": 0.1, "delta": 1.0},
    ],
)
def test_a_striker_that_sticks_twice_in_each_turn_is_measured(
    friction: dict[str, Any], tmp_path: Path
) -> None:
    """Its spring exceeds dry friction by little: of the crank's turn it moves for a part only."""
    scene = {
        "striker": {"mass_kg": 1.27, "spring_n_m": 66.1},
        "drive": {"amplitude_m": 0.0168},
        "friction": friction,
    }
    found = brought_up(bench_of(scene, [], 1), tmp_path / "out", "below-impacts", mass_kg=1.27)["parameters"]
    for name, truth in (
        ("striker.spring_n_m", 66.1),
        ("drive.amplitude_m", 0.0168),
        ("friction.mu", friction["mu"]),
    ):
        one = found[name]
        width = one["high"] - one["low"]
        assert one["low"] - 0.25 * width < truth < one["high"] + 0.25 * width
        assert width < 0.15 * truth


@pytest.mark.parametrize(("law", "high"), [(Law.COULOMB, 0.05 + 1.96 * 0.01), (Law.STRIBECK, 0.0)])
def test_a_viscous_part_may_exist_only_beside_a_law_that_permits_it(law: Law, high: float) -> None:
    """A start with Stribeck's dry friction and a viscous part that it has instead would have both."""
    both = SimpleNamespace(spread={"damping_1_s": 0.01}, striker=SimpleNamespace(damping_1_s=0.05))
    none = {"damping_1_s": 0.0}
    found: Any = SimpleNamespace(
        law=law, values=none, spread=none, fits={Law.BOTH: both}, fit=SimpleNamespace(spread={})
    )
    assert value_with_bounds(found, "damping_1_s")[2] == pytest.approx(high)


def test_a_heavy_striker_on_a_dry_guide_is_no_implausible_load(tmp_path: Path) -> None:
    scene = {
        "striker": {"mass_kg": 1.29, "spring_n_m": 98.0},
        "drive": {"amplitude_m": 0.0241},
        "friction": {"law": "stribeck", "mu": 0.1154, "mu_s": 0.15, "v_s_m_s": 0.1, "delta": 1.0},
    }
    result = brought_up(bench_of(scene, [], 1), tmp_path / "out", "below-impacts", mass_kg=1.29)
    assert result["passed"], result["steps"][-1]["reason"]


BROKEN = {
    "no watchdog": (*BROKEN_MODULES["no watchdog"][:2], "drive", "no watchdog"),
    "silent drive": (*BROKEN_MODULES["silent drive"][:2], "listen", "no frame DriveHeartbeat"),
    "slow encoder": ({"axis": {"encoder_s": 0.01}}, [], "listen", "encoder_msg_rate_ms"),
    "high range exchanged": (
        {},
        [fault("sensor-swapped", sensors=["striker-low", "striker-high"])],
        "at-rest",
        "Exchange their plugs",
    ),
    "low voltage": ({}, [fault("supply-sag", supply_v=14.0)], "at-rest", "14.0 V"),
    "jammed crank": ({}, [fault("motor-stall")], "drive", "does not move"),
    "stuck striker": (*BROKEN_MODULES["striker stuck"][:2], "below-impacts", "hardly moves"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_module_ends_the_step_that_sees_it_and_rests(name: str, tmp_path: Path) -> None:
    scene, faults, step, reason = BROKEN[name]
    bench = bench_of(scene, faults, 1)
    result = brought_up(bench, tmp_path / "out", "below-impacts")
    assert not result["passed"]
    assert result["steps"][-1]["name"] == step
    assert reason in result["steps"][-1]["reason"]
    assert beyond_bounds(bench, result["steps"]) == []
    assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.5


NO_HOLD = {
    "friction": ({"friction.mu": 0.12, "friction.b_n_s_m": 0.0}, "no impacts last"),
    "the fold": ({"friction.mu": 0.047, "friction.b_n_s_m": 0.0, "striker.mass_kg": 1.27}, "dead centre"),
    "nothing": ({}, ""),
}


@pytest.mark.parametrize("name", NO_HOLD)
def test_a_module_without_steady_impacts_there_is_refused_with_the_reason(name: str) -> None:
    changes, reason = NO_HOLD[name]
    found = explain_no_hold(with_overrides({**changes, "limit.force_n": 1000.0}), 1.25)
    assert reason in found
    assert bool(found) == bool(reason)


def test_a_campaign_samples_a_module_within_the_intervals_of_its_file(tmp_path: Path) -> None:
    found = {
        "striker.mass_kg": make_value("striker.mass_kg", 0.6),
        "limit.force_n": make_value("limit.force_n", 1000.0),
        "striker.spring_n_m": make_value("striker.spring_n_m", 90.0, 88.2, 91.8),
        "friction.mu": make_value("friction.mu", 0.02, 0.018, 0.022),
        "stop.position_m": make_value("stop.position_m", 0.178, 0.1779, 0.1782),
        "crank.zero_rad": make_value("crank.zero_rad", 2.0, 1.9, 2.1),
    }
    table = {"format": PARAMETERS, "parameters": {name: one._asdict() for name, one in found.items()}}
    path = tmp_path / "parameters.toml"
    path.write_text(tomli_w.dumps(table))
    plan = CAMPAIGNS["start-up"].plan(read_spread(path), 7)
    (cell, *others), numbers = plan.cells, plan.numbers
    assert {one.scene["friction"]["law"] for one in others} == {"coulomb"}
    assert (cell.scene["striker"]["mass_kg"], cell.firmware["striker"]["mass_kg"]) == (0.6, 0.6)
    assert "crank" not in cell.firmware
    assert numbers["mismatch_spring"] == pytest.approx(0.02)
    assert numbers["mismatch_dry_friction"] == pytest.approx(0.1)
    assert numbers["mismatch_stop_m"] == pytest.approx(0.00015)
    for unknown in (
        "mismatch_damping",
        "mismatch_restitution",
        "mismatch_amplitude",
        "mismatch_rest_length_m",
    ):
        assert numbers[unknown] == 0.0
    scenes = [trial_of(plan, number).scenario.scene for number in range(40)]
    springs, stops = [one.striker.spring_n_m for one in scenes], [one.stop.position_m for one in scenes]
    assert 88.2 <= min(springs) < 89.0
    assert 91.0 < max(springs) <= 91.8
    assert 0.1779 <= min(stops) < max(stops) <= 0.1782


@pytest.mark.parametrize(("value", "low", "high"), [(0.01, 0.0, 0.05), (0.0, 0.0, 0.05), (0.01, -0.02, 0.05)])
def test_a_sampled_friction_stays_within_its_interval_and_is_never_negative(
    value: float, low: float, high: float
) -> None:
    settings = settings_on_twin({"friction.mu": make_value("friction.mu", value, low, high)})
    plan = CAMPAIGNS["start-up"].plan(settings, 7)
    found = [trial_of(plan, number).scenario.scene.friction.mu for number in range(0, 160, 4)]
    assert 0.0 <= min(found) < 0.01
    assert 0.04 < max(found) <= 0.05


@pytest.mark.parametrize(
    "bounds", ['low = "a"', "low = [1.0]", "high = nan", "low = true", "low = 0.4\nhigh = 0.3"]
)
def test_bad_bounds_of_a_file_are_named(bounds: str, tmp_path: Path) -> None:
    path = tmp_path / "parameters.toml"
    path.write_text(
        f'format = {PARAMETERS}\n[parameters."friction.mu"]\nvalue = 0.01\nunit = "1"\n{bounds}\n'
    )
    with pytest.raises(ParameterError, match=r"parameters\.toml: friction\.mu"):
        read_spread(path)


@pytest.mark.parametrize("campaign", CAMPAIGNS)
def test_a_spread_is_for_campaigns_with_friction_laws(campaign: str, tmp_path: Path, capsys: Any) -> None:
    if campaign in ("walk", "limits"):
        assert cli.run(["campaign", campaign, "--spread", str(tmp_path / "none.toml")]) == EXIT_BAD_INPUT
        assert "samples modules of its own" in " ".join(capsys.readouterr().err.split())
    else:
        refuse_other_axes(campaign, CAMPAIGNS[campaign].sampler.axes)


STOPS = {"silent": (0, "nothing shows"), "turning": (10**6, "still turns"), "at rest after 2 s": (2000, "")}


@pytest.mark.parametrize("name", STOPS)
def test_a_stop_that_fails_passes_only_if_the_encoder_shows_rest(name: str) -> None:
    turning, reason = STOPS[name]
    player = Operated([], 0.0)
    heartbeat = codec.FIRMWARE_HEARTBEAT.encode(FirmwareHeartbeat(*[0] * len(FirmwareHeartbeat._fields)))
    failed = codec.FAULT_EVENT.encode(
        FaultEvent(*[0] * len(FaultEvent._fields))._replace(fault=Fault.STOP_FAILED)
    )
    stop = round(BEGUN_S / TICK_S) + 500

    def to_its_end() -> None:
        for tick in range(round(player.longest_s / TICK_S)):
            speed = 1.0 if tick < stop + turning else 0.0
            encoder = [codec.ENCODER_ESTIMATES.encode(EncoderEstimates(0.0, speed))] if turning else []
            if player.play(tick, [heartbeat, *encoder, *([failed] if tick == stop else [])]) is None:
                return
        pytest.fail("the stop did not end")

    if reason:
        with pytest.raises(StepFailedError, match=reason):
            to_its_end()
        assert player.notes == []
    else:
        to_its_end()
        assert "STOP_FAILED" in player.notes[0]
        assert "2.0 s later" in player.notes[0]


class Ends:
    """A bench whose hold ends with an error at once."""

    def __init__(self, error: Exception) -> None:
        self.error, self.played = error, 0

    def play(self, *_: Any) -> None:
        self.played += 1
        raise self.error


HOLDS = {
    "a fault": (LatchedFaultError("it stopped", Fault.OVERSPEED), {}, "it stopped"),
    "a fault of a module without impacts": (
        LatchedFaultError("it stopped", Fault.OVERSPEED),
        {"friction.mu": 0.12},
        "lower --ratio",
    ),
    "a ratio that the firmware refuses": (
        RatioTooHighError("refused"),
        {},
        "refused; ask for a lower --ratio",
    ),
    "a silent firmware": (StepFailedError("silent"), {"friction.mu": 0.12}, "silent"),
    "too hard an impact": (StepFailedError(""), {"striker.mass_kg": 4.0}, "ceiling.impulse_n_s = 5"),
}


@pytest.mark.parametrize("name", HOLDS)
def test_a_hold_that_fails_says_why_and_keeps_no_raised_limit(name: str, tmp_path: Path) -> None:
    error, changes, reason = HOLDS[name]
    values = with_overrides({"striker.mass_kg": 1.0, "limit.force_n": 1000.0})
    values |= {"stop.restitution": 0.6, "friction.b_n_s_m": 0.2} | changes
    bench, found = Ends(error), Findings()
    context = Context(bench, tmp_path, values, {}, lambda _: True, lambda _: None, 1.25)
    with pytest.raises(StepFailedError) as raised:
        hold(context, found, values, [])
    said = str(raised.value)
    assert said == reason or (reason in said and not said.endswith("; "))
    assert found.parameters == {}
    assert bench.played == (name != "too hard an impact")


def test_the_command_to_run_next_names_file_and_ratio(tmp_path: Path) -> None:
    bench = Ends(StepFailedError(""))
    context = Context(bench, tmp_path / "a b", {}, {}, lambda _: True, lambda _: None, 1.1)
    words = shlex.split(run_next(context).removeprefix("run next: vibrohil "))
    assert words[1:] == [
        "start-up",
        "--spread",
        str(tmp_path / "a b" / PARAMETER_FILE),
        "--set",
        "campaign.ratios=[1.1]",
    ]


def test_values_of_the_data_sheet_are_kept_and_replaced_one_by_one(tmp_path: Path) -> None:
    user = User(lambda _: None, lambda _: False)

    def resumed(**given: float) -> dict[str, float]:
        settings = {name.replace("__", "."): value for name, value in given.items()}
        Session(bench_of({}, [], 1), tmp_path / "out", settings, 1.25, user).run("listen", "listen")
        return dict(read_state(tmp_path / "out").settings)

    assert resumed(striker__mass_kg=0.7, limit__force_n=900.0) == {
        "striker.mass_kg": 0.7,
        "limit.force_n": 900.0,
    }
    assert resumed() == {"striker.mass_kg": 0.7, "limit.force_n": 900.0}
    assert resumed(striker__mass_kg=0.6) == {"striker.mass_kg": 0.6, "limit.force_n": 900.0}


STEP = {"name": "listen", "passed": True, "parameters": {}}
DAMAGED = {
    "cut": b'{"steps": [',
    "a list": b"[1]",
    "no steps": b'{"settings": {}}',
    "nested": b"[" * 100_000,
    "not UTF-8": b"\xff\xfe{",
    "another format": b'{"format": 9, "steps": []}',
    "an unknown value": b'{"settings": {"evil": 1}, "steps": []}',
    "a value that is no number": b'{"settings": {"striker.mass_kg": NaN}, "steps": []}',
    "a step without a record": json.dumps({"steps": [STEP]}).encode(),
    "a ratio that is no number": json.dumps({"steps": [STEP | {"ratio": "1.25"}]}).encode(),
    "all steps passed": json.dumps({"steps": [STEP] * 6}).encode(),
}


@pytest.mark.parametrize("damage", DAMAGED)
def test_a_damaged_state_is_refused(damage: str, tmp_path: Path, capsys) -> None:
    (tmp_path / STATE).write_bytes(DAMAGED[damage])
    command = ["bring-up", "--bus", "local:nowhere", "--out", str(tmp_path), "--yes"]
    assert cli.run(command) == EXIT_BAD_INPUT
    assert f"{STATE} is damaged, or of another version (" in " ".join(capsys.readouterr().err.split())


def test_steps_that_another_user_may_have_written_are_not_continued(tmp_path: Path, monkeypatch) -> None:
    """A forged state would say that each step has passed, and move the module with its own values."""
    session = Session(bench_of({}, [], 1), tmp_path / "out", {}, 1.25, User(lambda _: None, lambda _: False))
    session.run("listen", "listen")
    state = tmp_path / "out" / STATE
    for place in (state, state.parent):
        before = place.stat().st_mode
        place.chmod(before | 0o020)
        with pytest.raises(RunFolderError, match="another user may have written"):
            read_state(state.parent)
        place.chmod(before)
    assert [one["name"] for one in read_state(state.parent).records] == ["listen"]
    state.rename(tmp_path / "forged")
    state.symlink_to(tmp_path / "forged")
    with pytest.raises(RunFolderError, match="is no file of a result"):
        read_state(state.parent)


def test_nothing_moves_without_a_yes_and_the_folder_is_resumed(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    refused = brought_up(bench, tmp_path / "out", "drive", agree=False)
    assert [one["passed"] for one in refused["steps"]] == [True, True, False]
    assert set(bench.largest.values()) == {NOTHING}
    listened = (tmp_path / "out" / "listen.log").stat().st_mtime_ns
    assert brought_up(bench, tmp_path / "out", "drive")["passed"]
    assert (tmp_path / "out" / "listen.log").stat().st_mtime_ns == listened
    found = values_of(read_document(tmp_path / "out" / PARAMETER_FILE), tmp_path)
    assert {"striker.mass_kg", "motor.inertia_kg_m2"} <= set(found), "the data sheet's and the found ones"
    assert "<svg" in (tmp_path / "out" / "bring-up.html").read_text()


def test_a_repeated_step_that_is_declined_or_fails_at_once_discards_nothing(tmp_path: Path) -> None:
    bench, out = bench_of({}, [], 1), tmp_path / "out"
    found = brought_up(bench, out, "drive")["parameters"]
    before = (out / STATE).read_bytes()
    user = User(lambda _: None, lambda _: False)
    assert not Session(bench, out, {}, 1.25, user).run("drive", "drive")["passed"]
    assert (out / STATE).read_bytes() == before
    bench.play = Ends(StepFailedError("at once")).play  # type: ignore[method-assign]
    result = Session(bench, out, {}, 1.25, user).run("at-rest", None)
    assert [one["name"] for one in result["steps"] if one["passed"]] == ["listen", "at-rest", "drive"]
    assert result["steps"][-1]["reason"] == "at once"
    assert result["parameters"] == found
    del bench.play
    bench.rest(8.0)
    assert [one["name"] for one in read_state(out).records] == ["listen", "at-rest", "drive", "at-rest"]
    repeated = Session(bench, out, {}, 1.25, user).run(None, "at-rest")["steps"]
    assert [(one["name"], one["passed"]) for one in repeated] == [("listen", True), ("at-rest", True)]
    assert {one["logs"]["at-rest"] for one in repeated[1:]} == {"at-rest-2.log"}


def test_a_value_that_passed_steps_have_used_does_not_change_under_them(tmp_path: Path) -> None:
    bench, out, user = bench_of({}, [], 1), tmp_path / "out", User(lambda _: None, lambda _: False)
    brought_up(bench, out, "drive")
    before = read_state(out)
    differs = (
        r"striker.mass_kg is 0.85, .* from drive on have used 0.8; repeat them by --from drive, .* folder"
    )
    with pytest.raises(BadInputError, match=differs):
        Session(bench, out, {"striker.mass_kg": 0.85}, 1.25, user).run(None, None)
    assert read_state(out) == before
    play, bench.play = bench.play, Ends(StepFailedError("at once")).play  # type: ignore[method-assign]
    Session(bench, out, {"striker.mass_kg": 0.85}, 1.25, user).run("at-rest", None)
    assert read_state(out).settings == before.settings  # with which the steps that are kept were run
    bench.play = play  # type: ignore[method-assign]
    # No step that has passed rests on the limit, and the repeated ones not on the mass.
    assert not Session(bench, out, {"limit.force_n": 900.0}, 1.25, user).run(None, None)["passed"]
    Session(bench, out, {"striker.mass_kg": 0.85}, 1.25, user).run("at-rest", "at-rest")
    assert read_state(out).settings["striker.mass_kg"] == 0.85


def test_the_ratio_is_kept_and_is_that_of_the_hold_that_the_twin_repeats(tmp_path: Path) -> None:
    bench, user = bench_of({}, [], 1), User(lambda _: None, lambda _: False)
    Session(bench, tmp_path, {}, 1.1, user).run("listen", "listen")
    tables = json.loads((tmp_path / STATE).read_text())
    [listened] = tables["steps"]
    tables["steps"] = [listened | {"name": step.name} for step in session.STEPS[:5]]
    (tmp_path / STATE).write_text(json.dumps(tables))
    before = read_state(tmp_path)
    with pytest.raises(
        BadInputError, match=r"the ratio is 1.25, .* used 1.1; repeat them by --from first-impacts"
    ):
        Session(bench, tmp_path, {}, 1.25, user).run(None, None)
    assert read_state(tmp_path) == before
    Session(bench, tmp_path, {}, None, user).run("listen", "listen")
    assert read_state(tmp_path).records[-1]["ratio"] == 1.1


def test_a_motion_that_fails_states_the_largest_values_that_its_frames_show(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: Any) -> None:
        raise StepFailedError("after the motion")

    monkeypatch.setattr(below_impacts, "largest_in", fail)
    failed = brought_up(bench_of({}, [], 1), tmp_path, "below-impacts")["steps"][-1]
    assert failed["reason"] == "after the motion"
    assert 1.0 < failed["largest"]["speed_rad_s"] <= failed["bound"]["speed_rad_s"]
    assert 0.01 < failed["largest"]["torque_n_m"] <= failed["bound"]["torque_n_m"]
    (tmp_path / "empty.log").touch()
    assert session.seen_in([tmp_path / "empty.log"], 0.8) == NOTHING


def test_an_error_of_the_program_is_recorded_as_such(tmp_path: Path) -> None:
    bench, user = bench_of({}, [], 1), User(lambda _: None, lambda _: False)
    bench.play = Ends(ZeroDivisionError("a defect")).play  # type: ignore[method-assign]
    with pytest.raises(ZeroDivisionError):
        Session(bench, tmp_path / "out", {}, 1.25, user).run(None, None)
    assert "ZeroDivisionError: a defect" in read_state(tmp_path / "out").records[-1]["reason"]


def test_a_folder_in_use_by_another_bring_up_is_refused(tmp_path: Path) -> None:
    with locked(tmp_path), pytest.raises(BadInputError, match="must not move one module"):
        Session(bench_of({}, [], 1), tmp_path, {}, 1.25, User(lambda _: None, lambda _: False)).run(
            None, None
        )


def test_files_of_steps_that_were_repeated_anew_are_no_result(tmp_path: Path) -> None:
    bench, out = bench_of({}, [], 1), tmp_path / "out"
    assert brought_up(bench, out, "at-rest")["passed"]
    for name in (SCENE, PARAMETER_FILE):
        (out / name).write_text("left by a step that is to be repeated")
    result = Session(bench, out, {}, 1.25, User(lambda _: None, lambda _: True)).run("at-rest", "at-rest")
    assert result["passed"]
    assert (result["scene"], result["parameter_file"]) == (None, None)


def test_every_frame_of_a_repeated_step_is_kept(tmp_path: Path) -> None:
    bench, out = bench_of({}, [], 1), tmp_path / "out"
    for _ in range(3):
        Session(bench, out, {}, 1.25, User(lambda _: None, lambda _: False)).run("listen", "listen")
    logs = sorted(out.glob("*.log"))
    assert [one.name for one in logs] == ["listen-2.log", "listen-3.log", "listen.log"]
    assert min(one.stat().st_size for one in logs) > 100_000


def test_a_report_that_is_missing_at_rest_is_named(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    brought_up(bench, tmp_path / "out", "listen")
    line = bench.own
    lost = {codec.DRIVE_SUPPLY.can_id, codec.DRIVE_TEMPERATURE.can_id}
    bench.own = SimpleNamespace(
        send_all=line.send_all, receive=lambda: [one for one in line.receive() if one.can_id not in lost]
    )
    assert "no frame Drive" in brought_up(bench, tmp_path / "out", "at-rest")["steps"][-1]["reason"]


def test_steps_that_end_before_they_begin_are_refused(tmp_path: Path) -> None:
    """They would run nothing, and say that all has passed."""
    bench, user = bench_of({}, [], 1), User(lambda _: None, lambda _: False)
    assert Session(bench, tmp_path / "out", {}, 1.25, user).run(None, "at-rest")["passed"]
    with pytest.raises(BadInputError, match="--until listen ends before --from at-rest"):
        Session(bench, tmp_path / "out", {}, 1.25, user).run("at-rest", "listen")


def test_an_interruption_in_motion_is_an_e_stop_and_the_step_is_repeated(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    assert brought_up(bench, tmp_path / "out", "at-rest")["passed"]
    inner = bench.play

    def interrupted(player: Any, *others: Any) -> None:
        play = player.play

        def until_it_turns(tick: int, received: Any) -> Any:
            if tick > 2000 and abs(player.speed_rad_s) > 1.0:
                raise KeyboardInterrupt
            return play(tick, received)

        player.play = until_it_turns
        inner(player, *others)

    bench.play = interrupted  # type: ignore[method-assign]
    with pytest.raises(KeyboardInterrupt):
        brought_up(bench, tmp_path / "out", "drive")
    bench.play = inner  # type: ignore[method-assign]
    bench.rest(1.0)
    assert bench.plant.node.drive.axis.state == AxisState.IDLE
    assert abs(bench.plant.node.plant.now.omega_rad_s) < 0.5
    assert brought_up(bench, tmp_path / "out", "drive")["passed"]


@pytest.mark.parametrize("is_asked", [True, False])
def test_a_ratio_that_is_too_high_says_that_the_impacts_end(is_asked: bool) -> None:
    refusal = Refusal.RATIO_TOO_HIGH if is_asked else Refusal.CRANK_TOO_FAST
    event = FaultEvent(*[0] * len(FaultEvent._fields))
    refused = codec.FAULT_EVENT.encode(event._replace(fault=Fault.REQUEST_REFUSED, refusal=refusal))
    with pytest.raises(StepFailedError, match="no impacts last" if is_asked else "CRANK_TOO_FAST"):
        Operated([], 0.0).play(0, [refused])


@pytest.mark.parametrize("fault", [Fault.SENSOR_TIMEOUT, Fault.DRIVE_WATCHDOG])
def test_frames_that_come_late_name_the_remedy(fault: Fault) -> None:
    event = FaultEvent(*[0] * len(FaultEvent._fields))._replace(fault=fault)
    with pytest.raises(LatchedFaultError, match="End other work on this machine"):
        Operated([], 0.0).play(0, [codec.FAULT_EVENT.encode(event)])


class HardStop:
    """A bench on which each approach ends at its force limit; `limits_n` has that of each approach's log."""

    def __init__(self) -> None:
        self.limits_n: dict[str, float] = {}

    def play(self, _: Any, _longest_s: float, log: Path, parameters: Any = None) -> None:
        """End an approach, which has parameters; what comes before and between has none."""
        if parameters:
            assert log.stem not in self.limits_n, "the first approach's log is overwritten"
            self.limits_n[log.stem] = parameters["limit.force_n"]
            log.touch()
            raise LatchedFaultError("it stopped: FORCE_LIMIT", Fault.FORCE_LIMIT)


@pytest.mark.parametrize("agreed", [0, 1, 2])
def test_a_hard_stop_is_approached_again_after_each_yes(agreed: int, tmp_path: Path) -> None:
    values = with_overrides({"limit.force_n": 1000.0})
    bench, answers = HardStop(), [True] * agreed + [False]
    context = Context(bench, tmp_path, values, {}, lambda _: answers.pop(0), lambda _: None, 1.25)
    with pytest.raises(LatchedFaultError, match="FORCE_LIMIT"):
        approach(context, Findings())
    limits_n = {"first-impacts": 250.0, "first-impacts-2": 500.0, "first-impacts-3": 1000.0}
    assert bench.limits_n == dict(list(limits_n.items())[: agreed + 1])


def test_found_values_that_no_module_has_end_the_step_and_are_not_kept(
    tmp_path: Path, monkeypatch: Any
) -> None:
    def find_a_large_crank(_: Context, found: Findings) -> None:
        found.parameters["drive.amplitude_m"] = make_value("drive.amplitude_m", 3.6)

    monkeypatch.setattr(session, "STEPS", (LISTEN._replace(run=find_a_large_crank), *session.STEPS[1:]))
    result = brought_up(bench_of({}, [], 1), tmp_path / "out", "listen")
    assert not result["passed"]
    assert "drive.amplitude_m = 3.6" in result["steps"][0]["reason"]
    assert result["parameters"] == {}


class Fails:
    """A player that ends in motion, as its bus fails, so that an E-stop follows."""

    moves = True

    def play(self, *_: Any) -> None:
        """The bus fails at once."""
        raise ConnectionError


def test_a_step_of_the_firmware_begins_after_the_e_stop_of_the_step_before(tmp_path: Path) -> None:
    bench = bench_of({}, [], 1)
    with pytest.raises(ConnectionError):
        bench.play(Fails(), 1.0, tmp_path / "failed.log")
    player = Operated([], 0.0)
    context = Context(bench, tmp_path, with_overrides({}), {}, lambda _: True, lambda _: None, 1.25)
    operate(context, player, tmp_path / "again.log", context.values)
    assert player.beat is not None
    assert Mode(player.beat.mode) == Mode.READY
