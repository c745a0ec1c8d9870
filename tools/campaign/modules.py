"""The modules of all campaigns but `walk` and `limits`: a friction law, a speed ratio and an impulse each."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from hil.scenario.scenario import Scenario
from plant_sim.scene import read_scene
from tools.campaign.campaign import BASE_SCENE, Cell, Plan, Sampler, first_tick_s, scenario_of, script_of
from tools.campaign.sampling import sample

CLEAR_S, IDLE_S, RUN_S = 1.0, 1.5, 1.6
"""Times of the commands, s: CLEAR_FAULTS, as a moving striker may cause faults at power-up; IDLE; RUN.

The firmware takes a request that was repeated for 0.3 s.
"""
SETTLED_S = RUN_S + 15.0
"""Time from which a hold is judged and a kick may occur, s."""

DRY_AMPLITUDE_M = 0.03
"""Amplitude of the drive with dry friction, m; at 20 mm dry friction holds the striker."""


class Law(NamedTuple):
    """Friction of the true module, and the amplitude of the drive that moves the striker against it."""

    friction: Mapping[str, Any]
    amplitude_m: float = DRY_AMPLITUDE_M

    @property
    def nominal(self) -> dict[str, Any]:
        """Nominal parameters of the firmware; of a dry friction law they contain μ only."""
        friction = {name: self.friction.get(name, 0.0) for name in ("b_n_s_m", "mu")}
        return {"friction": friction, "drive": {"amplitude_m": self.amplitude_m}}

    def cell(self, law: str, ratio: float, impulse_n_s: float = 0.0) -> Cell:
        """Return the cell of a module with this friction law, called `law`."""
        scene = read_scene(BASE_SCENE)
        scene["friction"] = dict(self.friction)
        scene["drive"]["amplitude_m"] = self.amplitude_m
        asked = f" {impulse_n_s:g} N s" if impulse_n_s > 0.0 else ""
        values = law, float(ratio), float(impulse_n_s)
        return Cell(f"{law} r={ratio:g}{asked}", values, scene, self.nominal, *values[1:])


LAWS = {
    "viscous": Law({"law": "viscous", "b_n_s_m": 0.2}, 0.02),
    "coulomb": Law({"law": "coulomb", "mu": 0.15}),
    "coulomb-0.2": Law({"law": "coulomb", "mu": 0.2}),
    "coulomb-0.3": Law({"law": "coulomb", "mu": 0.3}),
    "stribeck": Law({"law": "stribeck", "mu": 0.15, "mu_s": 0.2, "v_s_m_s": 0.05, "delta": 1.0}),
}


def module_cell(law: str, ratio: float, impulse_n_s: float = 0.0) -> Cell:
    """Return the cell of a module with one of LAWS."""
    return LAWS[law].cell(law, ratio, impulse_n_s)


def module_script(cell: Cell, duration_s: float, faults: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """Return the script of a trial: the operator's commands and the faults."""
    script = script_of(cell, RUN_S, duration_s, faults)
    script["commands"][1:1] = [
        {"at_s": CLEAR_S, "request": "clear-faults"},
        {"at_s": IDLE_S, "request": "idle"},
    ]
    return script


def kick(numbers: Mapping[str, Any], dice: np.random.Generator) -> dict[str, Any]:
    """Return a kick fault of sampled size and sign at a sampled tick in the settled hold."""
    size = float(dice.uniform(numbers["kick_low_m_s"], numbers["kick_high_m_s"]))
    sign = 1.0 if dice.uniform() < 0.5 else -1.0
    at_s = first_tick_s(SETTLED_S + float(dice.uniform(0.0, 1.0)))
    return {"kind": "kick", "at_s": at_s, "change_m_s": sign * size}


def module_scenario(plan: Plan, cell: Cell, number: int) -> Scenario:
    """Sample a module, and a kick if the campaign has some."""
    numbers = plan.numbers
    tables, seed = sample(cell.scene, numbers, plan.seed, number)
    duration_s = SETTLED_S + float(numbers["hold_s"]) if "hold_s" in numbers else numbers["duration_s"]
    faults = []
    if "kick_low_m_s" in numbers:
        faults = [kick(numbers, np.random.default_rng((plan.seed, number, 2)))]
    return scenario_of(
        plan.name_of(number), tables, cell.firmware, module_script(cell, duration_s, faults), seed
    )


MODULES = Sampler({"laws": LAWS, "ratios": None, "impulses": None}, module_cell, module_scenario)
