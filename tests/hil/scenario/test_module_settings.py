"""`--set module.KEY`: the module's truth and the firmware's nominal parameter in one."""

import pytest

from firmware_py.interface.enums import ParameterTier
from firmware_py.interface.parameter_table import TABLE
from hil.scenario.scenario import load_scenario
from hil.scenario.settings import SettingError, apply_settings

SCENARIO = "soft-start-multistable"


def test_both_get_the_value_and_the_scenario_says_what_was_changed():
    changed = load_scenario(SCENARIO, ["module.striker.mass_kg=1.6", "module.friction.b_n_s_m=0.3"])
    for side in ("scene", "firmware"):
        tables = changed.document[side]
        assert (tables["striker"]["mass_kg"], tables["friction"]["b_n_s_m"]) == (1.6, 0.3)
    assert changed.changes == ("module.striker.mass_kg=1.6", "module.friction.b_n_s_m=0.3")


def test_a_later_setting_of_one_side_alone_counts():
    tables = apply_settings(
        {"scene": {}, "firmware": {}}, ["module.stop.position_m=0.2", "firmware.stop.position_m=0.19"]
    )
    assert tables == {"scene": {"stop": {"position_m": 0.2}}, "firmware": {"stop": {"position_m": 0.19}}}


@pytest.mark.parametrize(
    ("document", "setting", "message"),
    [
        ({"scene": {}, "firmware": {}}, "module.striker.mas_kg=1", "striker.mass_kg"),
        ({"scene": {}, "firmware": {}}, "module.speed.gain_p_n_m_s=1", "no such nominal parameter"),
        ({"scene": {}}, "module.striker.mass_kg=1", "wanted one of scene."),
        ({"scene": {}, "firmware": {}}, "modul.striker.mass_kg=1", "module."),
    ],
)
def test_what_is_no_parameter_of_the_module_is_refused(document, setting, message):
    with pytest.raises(SettingError, match=message):
        apply_settings(document, [setting])


def test_the_parameters_of_the_module_that_a_scene_has_too_are_all_there():
    """The others of this tier describe sensors and limits, and fail as unknown keys of the scene."""
    names = {one.name for one in TABLE if one.tier is ParameterTier.MODULE}
    assert {"striker.spring_n_m", "drive.amplitude_m", "stop.contact_s", "motor.inertia_kg_m2"} <= names
