"""What a script says happens: faults have an object, settings are whole, windows move with the script."""

from pathlib import Path

import numpy as np
import pytest

from firmware_py.shell.parameters import ParameterError
from hil.faults.kinds.disturbed import Disturbed
from hil.record.traces.trace import no_trace
from hil.runs.modelled_bus import BusAsModelled
from hil.scenario.files import ScenarioError, read_scenario
from hil.scenario.scenario import check_scenario, load_scenario
from hil.scenario.seeds import delay_faults
from hil.scenario.settings import SettingError, as_texts, keys_and_values
from plant_sim.scene import read_scene
from tools.cli import run
from tools.output import EXIT_BAD_INPUT

WHOLE_S = {"at_s": 1.0, "duration_s": 1.0}


def document(*faults, scene="table1-motor-soft", **script):
    """A scenario of 3 s with these faults."""
    return {
        "title": "It rests",
        "scene": read_scene(scene),
        "script": {"duration_s": 3.0, "faults": list(faults), **script},
        "checks": [{"name": "impact_count", "high": 99}],
    }


@pytest.mark.parametrize(
    ("fault", "scene", "reason"),
    [
        ({"kind": "dropped", "frames": ["GaitSensors"]}, {}, "do not send GaitSensors"),
        ({"kind": "delayed", "frames": ["CoarsePosition"], "delay_s": 0.1}, {}, "do not send CoarsePosition"),
        ({"kind": "stop-moved", "by_m": 0.01}, {"stop": {"law": "none"}}, "the scene has no stop"),
        ({"kind": "stop-moved", "by_m": 0.0}, {}, "it changes nothing"),
        ({"kind": "friction-changed", "factor": 3.0}, {"friction": {"law": "none"}}, "factor = 3 does not"),
        ({"kind": "friction-changed", "factor": 1.0}, {}, "factor = 1 does not"),
        ({"kind": "stiffness-changed", "factor": 1.0}, {}, "it changes nothing"),
        ({"kind": "kick", "change_m_s": 0.0}, {}, "it changes nothing"),
        ({"kind": "encoder-slip", "slip_rev": 0.0}, {}, "it changes nothing"),
        ({"kind": "sensor-biased", "sensor": "striker", "bias": 0.0}, {}, "it changes nothing"),
        (
            {"kind": "encoder-wrap", "count_rev": 8, "wraps_at_rev": 8},
            {},
            "count_rev = 8 is not below wraps_at_rev = 8; begin with a lower count, or let it wrap",
        ),
        ({"kind": "sensor-clipped", "sensor": "encoder", "limit_m_s2": 1.0}, {}, "the encoder measures"),
        ({"kind": "parameters-damaged"}, {}, "no firmware starts while the parameter file is damaged"),
    ],
)
def test_a_fault_without_an_object_is_refused_with_the_reason(fault, scene, reason):
    tables = {**read_scenario("soft-start-multistable")["scene"], **scene}
    with pytest.raises(ScenarioError, match=f"the fault '{fault['kind']}' at 1 s cannot act: .*{reason}"):
        check_scenario(document({**fault, **WHOLE_S}, scene=tables), "mine")


JUMP = {"kind": "clock-jumped", "at_s": 1.0}


@pytest.mark.parametrize(
    ("faults", "script", "said"),
    [
        (
            [{"kind": "restarted", "process": "plant", "at_s": 1.0, "duration_s": 2.0}],
            {},
            "starts the plant anew at 3 s, after the end",
        ),
        *(
            ([JUMP | {"by_s": by_s}], {}, r"a jump of less than half a tick, 0\.001 s, moves no tick")
            for by_s in (0.0, 0.0004, -0.0004)
        ),
        ([], {"duration_s": 4e-4}, r"duration_s = 0.0004 is shorter than a tick"),
    ],
)
def test_what_has_no_place_in_the_script_is_refused(faults, script, said):
    with pytest.raises(ScenarioError, match=said):
        check_scenario(document(*faults, **script), "mine")


@pytest.mark.parametrize("end", [{"kind": "killed"}, {"kind": "restarted", "duration_s": 1.2}])
def test_a_dead_process_is_not_paused(end):
    end |= {"process": "firmware", "at_s": 1.0}
    pause = {"kind": "paused", "process": "firmware", "at_s": 1.5, "duration_s": 0.5}
    reason = f"the firmware does not run after the fault '{end['kind']}' at 1 s"
    with pytest.raises(ScenarioError, match=f"'paused' at 1.5 s cannot act: {reason}"):
        check_scenario(document(end, pause), "mine")
    for other in (
        {"process": "plant"},
        {"at_s": 0.9},
        {"duration_s": 1.0} if "duration_s" in end else {"at_s": 0.5},
    ):
        assert len(check_scenario(document(end, pause | other), "mine").faults) == 2


def test_a_table_in_place_of_a_parameter_is_refused():
    tables = {**document(), "firmware": {"start": {"rise_s": {}}}}
    with pytest.raises(ParameterError, match=r"start.rise_s = \{\} is no number"):
        check_scenario(tables, "mine")
    assert check_scenario({**document(), "firmware": {"start": {}}}, "mine").duration_s == 3.0


def test_parameters_damaged_act_on_a_firmware_that_starts_during_them():
    damage = {"kind": "parameters-damaged", **WHOLE_S}
    restart = {"kind": "restarted", "process": "firmware", "at_s": 0.5, "duration_s": 0.7}
    assert len(check_scenario(document(damage, restart), "mine").faults) == 2
    assert len(check_scenario(document({**damage, "at_s": 0.0}), "mine").faults) == 1


def test_each_of_two_overlapping_disturbances_ends_itself(tmp_path):
    both = [
        Disturbed(kind="disturbed", frames=["OperatorCommand"], at_s=1.0, duration_s=1.0),
        Disturbed(kind="disturbed", frames=["OperatorCommand", "Accelerometer"], at_s=1.5, duration_s=2.0),
    ]
    bus = BusAsModelled(1_000_000, no_trace, both)
    hit = {}
    for t_s in (0.5, 1.2, 1.7, 2.5, 3.6):
        bus.pass_time(round(t_s * 1e9), round(t_s * 1e9) + 1)
        hit[t_s] = sorted(bus._bus._destroyed_ids)
    assert hit == {0.5: [], 1.2: [0x48], 1.7: [0x28, 0x48], 2.5: [0x28, 0x48], 3.6: []}
    bus.close()


@pytest.mark.parametrize(
    "text",
    [
        "script.duration_s=2\nscene.striker.mass_kg=5",
        "scene.stop.law=rigid\nscene.striker.mass_kg=5",
        "script.duration_s=2\nvalue = 3",
    ],
)
def test_a_setting_with_a_second_line_is_refused(text, capsys):
    with pytest.raises(SettingError, match="it has a second line"):
        list(keys_and_values([text]))
    assert run(["run", "soft-start-multistable", "--clock", "lockstep", "--set", text]) == EXIT_BAD_INPUT
    assert "it has a second line" in " ".join(capsys.readouterr().err.split())


def test_values_from_python_may_be_numpy_s_and_never_none():
    values = {"a.b": np.int64(3), "a.c": np.float32(0.5), "a.d": np.array([1, 2]), "a.e": (1, np.True_)}
    assert dict(keys_and_values(values)) == {"a.b": 3, "a.c": 0.5, "a.d": [1, 2], "a.e": [1, True]}
    with pytest.raises(SettingError, match=r"'script.duration_s' = None: wanted a number"):
        list(keys_and_values({"script.duration_s": None}))


def test_a_scenario_s_changes_are_written_as_a_person_types_them():
    typed = [
        'script.commands=[{at_s = 0.5, request = "run", target_ratio = 1.3}]',
        'scene.friction={law = "viscous", "b \'n\'" = [1, 2]}',
        "firmware.gait.enabled=true",
        "scene.stop.law=rigid",
        "firmware.start.rise_s=0.1",
    ]
    assert as_texts(typed) == typed
    assert as_texts(dict(keys_and_values(typed))) == typed
    assert as_texts({"a.b": [float("inf"), 1e-9, 'a "b"\n']}) == ['a.b=[inf, 1e-09, "a \\"b\\"\\n"]']


OWN = {"expression": "max(plant.x_m)", "high": 1.0, "unit": "m"}
WINDOWS = [
    {"name": "before", **OWN, "from_s": 0.5, "to_s": 2.0},
    {"name": "across", **OWN, "from_s": 0.5, "to_s": 2.8},
    {"name": "after", **OWN, "from_s": 2.5, "to_s": 3.0},
    {"name": "open", **OWN, "from_s": 2.6},
    {"name": "whole", **OWN},
]


def windows(scenario):
    """Begin and end of each own check; None where the default stands."""
    return {
        check.name: tuple(
            getattr(check, key) if key in check.model_fields_set else None for key in ("from_s", "to_s")
        )
        for check in scenario.checks
        if check.expression is not None
    }


def test_the_windows_of_checks_move_along_with_a_seed():
    kick = {"kind": "kick", "at_s": 2.5, "change_m_s": 0.1}
    written = check_scenario({**document(kick), "checks": WINDOWS}, "mine")
    moved = delay_faults(written, 5)
    by_s = moved.faults[0].at_s - 2.5
    assert by_s > 0.0
    assert windows(moved) == {
        "before": (0.5, 2.0),
        "across": (0.5, pytest.approx(2.8 + by_s)),
        "after": (pytest.approx(2.5 + by_s), pytest.approx(3.0 + by_s)),
        "open": (pytest.approx(2.6 + by_s), None),
        "whole": (None, None),
    }


def test_a_scene_s_file_is_looked_for_beside_the_scenario(tmp_path: Path, monkeypatch):
    (tmp_path / "bench").mkdir()
    scene = tmp_path / "bench" / "own.toml"
    named = Path(__file__).parents[3] / "plant_sim" / "scenes" / "table1-motor-soft.toml"
    scene.write_text(named.read_text())
    path = tmp_path / "bench" / "mine.toml"
    path.write_text('title = "It rests"\nscene = "own.toml"\n[script]\nduration_s = 0.5\n')
    monkeypatch.chdir(tmp_path)
    assert load_scenario("bench/mine.toml").scene == load_scenario("soft-start-multistable").scene
