"""The exported FMU under a foreign master: the same bits as the plant, FMI's statuses, no Python inside."""

import json
import math
import threading
from pathlib import Path

import pytest
from fmpy.validation import validate_fmu
from fmus import (
    SCENES,
    SEED,
    FmiError,
    Fmu,
    Instance,
    exported,
    outputs_of,
    readings_of,
    require_no_runtime,
    run_alone,
    shifted,
)

from plant_sim.plant import Plant
from plant_sim.scene import Scene, load_scene
from tools.fmu.build import Version, header
from tools.fmu.plant import PlantModel
from tools.fmu.variables import FmuError

FMUS: dict[tuple[str, Version], tuple[Scene, Path, Fmu]] = {}
Exported = tuple[Scene, Path, Fmu]


def fmu_of(name: str, folders: pytest.TempPathFactory, version: Version = 2) -> Exported:
    """A scene's FMU, built once; the export compiles even where Python interprets the kernels."""
    if (name, version) not in FMUS:
        scene = load_scene(SCENES[name])
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv("NUMBA_DISABLE_JIT", "1")
            file = exported(scene, folders.mktemp(name), version)
        FMUS[name, version] = scene, file, Fmu(file)
    return FMUS[name, version]


@pytest.fixture(params=[2, 3])
def module(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """The bench's own scene, for both versions of FMI."""
    return fmu_of("table1-motor-soft", tmp_path_factory, request.param)


def same(plant: Plant, one: Instance) -> None:
    """Observation and readings equal to the bit; nan equals nan."""
    wanted = outputs_of(plant) | readings_of(plant)
    assert one.outputs("now.") | one.outputs("reading.") == wanted


def drive(plant: Plant, one: Instance, torque_n_m: float, h_s: float) -> None:
    one.set("motor.torque_n_m", torque_n_m)
    one.step(h_s)
    plant.advance(torque_n_m, h_s)


def test_a_scene_gives_the_same_unit_each_time() -> None:
    """No address of this process is in it, or its token would differ."""
    first, again = (PlantModel(load_scene("table1-motor-soft"), 1) for _ in range(2))
    assert header(first, 3, "") == header(again, 3, "")


@pytest.mark.parametrize("name", SCENES)
def test_the_plant_bit_by_bit_under_disturbances(name: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    scene, file, fmu = fmu_of(name, tmp_path_factory)
    assert validate_fmu(str(file)) == []
    begin = shifted(fmu, ("fixed", "tunable"), 1)
    one = fmu.instance(**begin)
    begun = scene.with_(begin)
    plant = Plant(begun, SEED)
    same(plant, one)
    later = begin | shifted(fmu, ("tunable",), 2)
    for tick in range(1200):
        if tick == 500:
            for key, value in later.items():
                if begin[key] != value:
                    one.set(key, value)
            plant.replace_parts(scene.with_(later).parts(SEED))
        if tick in (400, 900):
            one.set("kicks.v_m_s", 1.25 if tick == 400 else 2.5)
            plant.kick(1.25)
        drive(plant, one, 0.3 if tick < 300 else 0.02, (1e-3, 2.5e-3, 4e-4)[tick % 3])
        same(plant, one)
    impacts = plant.take_impacts()
    assert one.get("impact.count") == len(impacts) > 0
    last = {key: value for key, value in impacts[-1]._asdict().items() if not math.isnan(value)}
    assert {key: one.get(f"impact.{key}") for key in last} == last


def test_the_housing_accelerated_by_the_master(tmp_path_factory: pytest.TempPathFactory) -> None:
    scene, _, fmu = fmu_of("housed", tmp_path_factory)
    one, plant = fmu.instance(), Plant(scene, SEED)
    same(plant, one)
    parts = plant.parts
    for tick in range(300):
        push_m_s2 = 2.0 * math.sin(0.05 * tick)
        one.set("housing.acceleration_m_s2", push_m_s2)
        along_m_s2 = parts.housing.along_m_s2 + push_m_s2  # type: ignore[union-attr]  # it moves
        if push_m_s2 != 0.0:
            plant.replace_parts(parts._replace(housing=parts.housing._replace(along_m_s2=along_m_s2)))  # type: ignore[union-attr,call-arg]
        drive(plant, one, 0.1, 1e-3)
        same(plant, one)


SIMULATE = """
import json, sys, fmpy
result = fmpy.simulate_fmu(
    sys.argv[1],
    stop_time=2.0,
    step_size=1e-3,
    output_interval=1e-3,
    start_values={"motor.torque_n_m": 0.02, "initial.v_m_s": 0.9},
    output=["now.x_m", "now.v_m_s", "now.crank_rad", "impact.count"],
)
print(json.dumps([float(value).hex() for value in list(result[-1])[1:]]))
"""


def test_a_process_without_this_project_simulates_it(module: Exported) -> None:
    scene, file, _ = module
    assert validate_fmu(str(file)) == []
    printed = run_alone(SIMULATE, str(file))
    plant = Plant(scene.with_({"initial.v_m_s": 0.9}), SEED)
    for tick in range(2000):
        plant.advance(0.02, (tick + 1) * 1e-3 - tick * 1e-3)  # the steps of FMPy
    impacts = len(plant.take_impacts())
    wanted = [plant.now.x_m, plant.now.v_m_s, plant.now.crank_rad, float(impacts)]
    assert json.loads(printed) == [value.hex() for value in wanted]
    assert impacts > 0


def test_no_symbol_of_a_runtime_and_no_fused_multiply_add(module: Exported) -> None:
    require_no_runtime(module[2])


@pytest.mark.parametrize("h_s", [1e-5, 1e-4, 1e-3, 1e-2, 0.05])
def test_any_step_agrees_within_the_accuracy(h_s: float, tmp_path_factory: pytest.TempPathFactory) -> None:
    scene, _, fmu = fmu_of("table1-motor-soft", tmp_path_factory)
    one, plant = fmu.instance(), Plant(scene, SEED)
    one.set("motor.torque_n_m", 0.1)
    for _ in range(round(1.0 / h_s)):
        one.step(h_s)
    plant.advance(0.1, 1.0)
    turns = 1.0 * abs(plant.now.omega_rad_s) / (2.0 * math.pi) + 1.0
    assert one.get("now.x_m") == pytest.approx(plant.now.x_m, abs=scene.solver.accuracy * turns)


def test_snapshots_restored_serialised_and_in_another_instance(module: Exported) -> None:
    one, other = module[2].instance(), module[2].instance()
    one.set("motor.torque_n_m", 0.2)
    for _ in range(800):
        one.step(1e-3)
    state = one.slave.getFMUState()
    content = one.slave.serializeFMUState(state)
    at_s = one.t_s

    def on(which: Instance) -> dict[str, float]:
        which.t_s = at_s
        for _ in range(500):
            which.step(1e-3)
        return which.outputs("")

    first = on(one)
    one.slave.setFMUState(state)
    assert on(one) == first
    restored = other.slave.deserializeFMUState(content)
    other.slave.setFMUState(restored)
    assert other.slave.serializeFMUState(restored) == content
    one.slave.freeInstance()
    assert on(other) == first


def test_a_state_of_another_fmu_is_refused(
    module: Exported, tmp_path_factory: pytest.TempPathFactory
) -> None:
    stranger = fmu_of("table1-viscous", tmp_path_factory)[2].instance()
    content = stranger.slave.serializeFMUState(stranger.slave.getFMUState())
    one = module[2].instance()
    with pytest.raises(FmiError):
        one.slave.deserializeFMUState(content)


def runs(fmu: Fmu, count: int, threads: bool) -> list[dict[str, float]]:
    """The outputs of `count` instances with torques of their own, one after the other or in threads."""
    instances = [fmu.instance() for _ in range(count)]
    found: list[dict[str, float]] = [{}] * count

    def run(which: int) -> None:
        one = instances[which]
        one.set("motor.torque_n_m", 0.05 * (which + 1))
        for _ in range(1000):
            one.step(1e-3)
        found[which] = one.outputs("now.") | one.outputs("reading.")

    workers = [threading.Thread(target=run, args=(which,)) for which in range(count)]
    for which, worker in enumerate(workers):
        if threads:
            worker.start()
        else:
            run(which)
    for worker in workers if threads else ():
        worker.join()
    return found


def test_ten_instances_in_threads_are_those_one_by_one(module: Exported) -> None:
    together = runs(module[2], 10, threads=True)
    assert together == runs(module[2], 10, threads=False)
    assert len({one["now.x_m"] for one in together}) == 10


def test_reset_is_a_new_instance(module: Exported) -> None:
    one = module[2].instance()
    one.set("motor.torque_n_m", 0.2)
    one.set("stop.position_m", 0.17)
    for _ in range(300):
        one.step(1e-3)
    one.slave.terminate()
    with pytest.raises(FmiError):
        one.step(1e-3)
    one.slave.reset()
    one.t_s = 0.0
    one.start()
    assert one.outputs("") == module[2].instance().outputs("")


REFUSED = (
    ("motor.torque_n_m", math.nan, "wanted a finite number"),
    ("motor.torque_n_m", math.inf, "wanted a finite number"),
    ("striker.mass_kg", 0.0, "below its minimum"),
    ("stop.restitution", 1.5, "above its maximum"),
    ("initial.x_m", 0.1, "fixed"),
    ("now.x_m", 0.1, "an output"),
)


@pytest.mark.parametrize(("name", "value", "reason"), REFUSED)
def test_a_bad_value_is_refused_and_changes_nothing(
    name: str, value: float, reason: str, module: Exported
) -> None:
    one = module[2].instance()
    before = one.get(name)
    with pytest.raises(FmiError, match="error"):
        one.set(name, value)
    assert reason in one.messages[-1]
    assert name in one.messages[-1]
    assert one.get(name) == before
    one.step(1e-3)


@pytest.mark.parametrize("h_s", [0.0, -1e-3, math.nan, math.inf])
def test_a_bad_step_is_refused(h_s: float, module: Exported) -> None:
    one = module[2].instance()
    with pytest.raises(FmiError):
        one.slave.doStep(0.0, h_s)
    with pytest.raises(FmiError):
        one.slave.doStep(1.0, 1e-3)
    assert "wanted a positive one" in one.messages[0]
    assert "the instance is at 0 s" in one.messages[1]
    one.step(1e-3)


def test_parameters_that_do_not_fit_each_other(tmp_path_factory: pytest.TempPathFactory) -> None:
    rigid = fmu_of("table1-stribeck", tmp_path_factory)[2]
    for values, reason in (
        ({"initial.x_m": 0.19}, "beyond the rigid stop"),
        ({"friction.mu_s": 0.1}, "friction.mu_s is below friction.mu"),
        ({"striker.spring_n_m": 1e10, "striker.mass_kg": 1e-6}, "is above 100000 rad/s"),
    ):
        one = rigid.instance(start=False, **values)
        with pytest.raises(FmiError):
            one.start()
        assert reason in one.messages[-1]
    one = rigid.instance()
    one.set("stop.position_m", 0.05)
    with pytest.raises(FmiError, match="discard"):
        one.step(1e-3)
    assert "beyond the rigid stop" in one.messages[-1]
    one.set("stop.position_m", 0.18)
    one.step(1e-3)


def test_without_a_linker_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("shutil.which", lambda _: None)
    with pytest.raises(FmuError, match="apt-get install gcc"):
        exported(load_scene("table1-viscous"), tmp_path)
