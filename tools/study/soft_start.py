"""Basins with the firmware in the loop: each cell is a closed loop with a soft start to r = Ω/ω.

The scene has the case's striker and friction, and the motor, soft stop and sensors of the bench's scene; the
firmware's nominal parameters are the case's. The operator requests RUN `RUN_S` after power-up. A cell counts
as impact motion if the firmware ends in mode RUN with lasting impacts. For comparison, each cell also has the
result of an instant start, with the crank at full speed at once.
"""

from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
import pyarrow as pa

from plant_sim.scene import read_scene
from tools.campaign.statistics import wilson
from tools.output import BadInputError
from tools.study import store, work
from tools.study.basin import Basin, axes, keep, specs, statistics
from tools.study.cases import Case

PRESET = "table1"
"""Preset for which the firmware's limits are set."""

DURATION_S = 32.0
"""Duration of a cell's run, as in the start-up campaign: all attempts to start, and 8 s of impacts."""

ROWS_AT_ONCE = 2
NOISE_SEED = 1


def check(case: Case, ratio: float) -> None:
    """Raise BadInputError for a preset or a ratio that the firmware does not accept."""
    from firmware_py.shell.parameters import config_from

    if case.preset != PRESET:
        raise BadInputError(
            f"--start soft with --preset {case.preset}: the firmware's limits are {PRESET}'s; "
            f"take --preset {PRESET}"
        )
    known = config_from({}).start
    if not known.lowest_ratio <= ratio <= known.highest_ratio:
        raise BadInputError(
            f"--start soft with --ratio {ratio:g}: the firmware starts from {known.lowest_ratio:g} to "
            f"{known.highest_ratio:g}"
        )


def scene_of(case: Case, x_m: float, v_m_s: float, crank_rad: float) -> dict[str, Any]:
    """Return the bench's scene with the case's striker, friction and stop, and the state at power-up."""
    scene = read_scene(f"{PRESET}-motor-soft")
    scene["striker"] |= case.striker_table()
    scene["drive"] |= {"amplitude_m": case.amplitude_m, "phase_rad": crank_rad}
    scene["friction"] = case.friction_table()
    scene["stop"] |= {"position_m": case.stop_m, "restitution": case.restitution}
    scene["initial"] = {"x_m": x_m, "v_m_s": v_m_s}
    return scene


def nominal_of(case: Case) -> dict[str, Any]:
    """Return the firmware's nominal parameters: those of the case, with only μ of a dry friction law."""
    return {
        "striker": case.striker_table(),
        "drive": {"amplitude_m": case.amplitude_m},
        "friction": {"b_n_s_m": case.b_n_s_m, "mu": case.mu},
        "stop": {"position_m": case.stop_m, "restitution": case.restitution},
    }


def compute(case: Case, ratio: float, plane: str, size: int, where: work.Where) -> Basin:
    """Compute the whole map and write it as one file."""
    check(case, ratio)
    pieces = specs(case, ratio, plane, size, ROWS_AT_ONCE)
    paths = work.run(f"soft-{plane}", piece, pieces, where, in_processes=True)
    table = pa.concat_tables([store.read(path)[0] for path in paths])
    reaches_stop = table["impacts"].to_numpy() > 0.0
    instant = wilson(int(table["instant"].to_numpy(zero_copy_only=False).sum()), size * size)
    captured_s = table["captured_s"].to_numpy()[reaches_stop]
    numbers = statistics(reaches_stop.reshape(size, size)) | {
        "instant_fraction": instant.value,
        "instant_fraction_wilson": [instant.low, instant.high],
        "captured_s": [float(np.quantile(captured_s, q)) for q in (0.5, 1.0)] if len(captured_s) else [],
        "failures": dict(Counter(why for why in table["why"].to_pylist() if why)),
    }
    found = Basin(case, ratio, plane, size, table, 0, numbers, start="soft")
    keep(found, where)
    return found


def piece(spec: Mapping[str, Any]) -> tuple[pa.Table, dict[str, Any]]:
    """Compute some rows of a map."""
    from firmware_py.interface.enums import Mode
    from firmware_py.shell.parameters import config_from
    from tools.campaign.trial.cells import Cell
    from tools.campaign.trial.judges import lost_by
    from tools.campaign.trial.reference import JUDGED_S, instant_start_captures
    from tools.campaign.trial.run import run
    from tools.campaign.trial.sampling import LARGEST_RUN_SEED
    from tools.campaign.trial.scenarios import RUN_S, scenario_of, script

    case, ratio, size = Case(**spec["case"]), spec["ratio"], spec["size"]
    nominal = nominal_of(case)
    config = config_from(nominal)
    omega_rad_s = ratio * config.start.natural_rad_s
    y_m, other = axes(case, spec["plane"], size)
    rows = []
    for row in range(*spec["rows"]):
        for column in range(size):
            v_m_s, crank_rad = (other[row], 0.0) if spec["plane"] == "state" else (0.0, other[row])
            x_m = float(y_m[column]) + case.rest_length_m
            sampled = scene_of(case, x_m, float(v_m_s), float(crank_rad))
            seed = int(np.random.default_rng([NOISE_SEED, row, column]).integers(LARGEST_RUN_SEED))
            commands = script(Cell(case.law, ratio, 0.0, sampled, nominal))
            scenario = scenario_of("soft-start", sampled, nominal, commands, DURATION_S, seed)
            done = run(scenario, seed)
            why = lost_by(done, DURATION_S, omega_rad_s)
            late = int((done.impacts["t_s"] >= DURATION_S - JUDGED_S).sum())
            running = done.first_in(Mode.RUN)
            rows.append(
                {
                    "x_m": x_m,
                    "v_m_s": float(v_m_s),
                    "crank_rad": float(crank_rad),
                    "impacts": 0.0 if why else late / JUDGED_S / (omega_rad_s / (2.0 * np.pi)),
                    "why": why,
                    "captured_s": np.nan if running is None else running.t_s - RUN_S,
                    "largest_m_s": float(np.max(done.impacts["v_m_s"], initial=0.0)),
                    "instant": instant_start_captures(scenario.scene, omega_rad_s),
                }
            )
    return pa.Table.from_pylist(rows), {}
