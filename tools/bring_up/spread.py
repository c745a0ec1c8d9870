"""A module's parameter file as the settings of a campaign on its twin, sampled within the intervals."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from firmware_py.shell.parameters import with_overrides
from hil.scenario.parameter_file import read_document, values_of
from tools.bring_up.model import scene_of
from tools.campaign.campaign import Outcome
from tools.campaign.campaigns import CAMPAIGNS, run_trial
from tools.tuning.result import Value

WIDTHS = {
    "striker.spring_n_m": ("mismatch_spring", True),
    "drive.amplitude_m": ("mismatch_amplitude", True),
    "friction.b_n_s_m": ("mismatch_damping", True),
    "friction.mu": ("mismatch_dry_friction", True),
    "stop.position_m": ("mismatch_stop_m", False),
    "stop.restitution": ("mismatch_restitution", False),
}
"""The campaign's half-width for each parameter, and whether it is a share of the value."""
NOT_OF_A_TWIN = ("wiring.", "crank.")
"""Beginnings of the parameters of the real module's wiring and encoder, which its twin has not."""


def without_wiring(values: Mapping[str, float]) -> dict[str, float]:
    """The parameters for the firmware on the twin."""
    return {name: value for name, value in values.items() if not name.startswith(NOT_OF_A_TWIN)}


def settings_on_twin(parameters: Mapping[str, Value]) -> list[str]:
    """The settings KEY=VALUE of a campaign: the twin's scene, the firmware's parameters, the half-widths.

    The rest length is the scale from which the stop is measured, so it has no width of its own.
    """
    values = without_wiring({name: float(one.value) for name, one in parameters.items()})
    settings = [f"firmware.{name}={value!r}" for name, value in values.items()]
    for table, keys in scene_of(with_overrides(values)).items():
        settings += [f"scene.{table}.{key}={as_toml(value)}" for key, value in keys.items()]
    settings += ['campaign.laws=["viscous"]', "campaign.mismatch_rest_length_m=0.0"]
    for name, (key, is_share) in WIDTHS.items():
        if one := parameters.get(name):
            half = max(one.high - one.value, one.value - one.low)
            wide = half / one.value if is_share and one.value else half if not is_share else 0.0
            settings.append(f"campaign.{key}={float(wide)!r}")
    return settings


def as_toml(value: Any) -> str:
    """A number or a word as TOML has it."""
    return f'"{value}"' if isinstance(value, str) else repr(value)


def read_spread(path: Path) -> list[str]:
    """The settings for a parameter file. Raises TextInputError or ParameterError."""
    document = read_document(path)
    tables = document["parameters"]
    return settings_on_twin(
        {
            name: Value(
                value, "", float(tables[name].get("low", value)), float(tables[name].get("high", value))
            )
            for name, value in values_of(document, path).items()
        }
    )


def start_up_on_twin(
    parameters: Mapping[str, Value], ratio: float, trials: int, seed: int, settings: Sequence[str] = ()
) -> list[Outcome]:
    """The outcomes of starts on modules within the intervals, at the ratio."""
    settings = [*settings_on_twin(parameters), f"campaign.ratios=[{ratio!r}]", *settings]
    plan = CAMPAIGNS["start-up"].plan(settings, seed)
    return [run_trial(plan, number) for number in range(trials)]
