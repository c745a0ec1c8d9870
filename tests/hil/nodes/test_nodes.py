"""What a loop does around a node after ticks were lost."""

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import files_of_a_run
import pytest

from firmware_py.interface import codec
from firmware_py.interface.enums import Mode
from firmware_py.interface.frame import Frame
from firmware_py.interface.generated.records import DriveErrors, DriveEstop
from hil.bus.in_process import InProcessBus, InProcessNode
from hil.nodes.firmware.runner import FirmwareRunner, ParameterMemory
from hil.nodes.main import NodeProcess, node_main
from hil.nodes.plant.node import PlantNode
from hil.nodes.plant.runner import PlantRunner
from hil.nodes.runner import Pace
from hil.record.run_folder import RunFolderError
from hil.scenario.scenario import load_scenario
from plant_sim.scene import load_scene

MOST_FILES = 47
"""Files of hil and tools with a call before the first tick of lockstep; to be lowered, never raised. They are
46, and one more, tools/output.py, where a slow machine prints progress."""
ESTOP = codec.DRIVE_ESTOP.encode(DriveEstop())
ERRORS = codec.DRIVE_ERRORS.encode(DriveErrors(0x200, 0x200))


def plant_node() -> PlantNode:
    return PlantNode(load_scene("table1-motor-soft"), seed=1)


class Wire(InProcessNode):
    """The firmware's connection: what it receives is put into `pending`, and what it sends is kept."""

    def __init__(self) -> None:
        super().__init__()
        self.sent: list[Frame] = []

    def send_all(self, frames: Sequence[Frame]) -> None:  # type: ignore[override]
        self.sent += frames


class Paused:
    """A firmware and a plant that ran for twenty ticks together before a pause."""

    def __init__(self) -> None:
        self.plant = plant_node()
        self.bus = Wire()
        self.firmware = FirmwareRunner(ParameterMemory({}), Pace(1e-3, 1.0), self.bus)
        self.tick = -1
        for _ in range(20):
            self.step(self.publish())
        self.bus.sent.clear()

    def publish(self) -> list[Frame]:
        frames = self.plant.publish()
        self.plant.advance([])
        return frames

    def step(self, frames: Sequence[Frame], elapsed_ticks: int = 1) -> tuple[int, int]:
        """Run the firmware on frames that have arrived; return the ages of its newest sample, in ticks."""
        self.tick += elapsed_ticks
        self.bus.pending += frames
        self.firmware.step(self.tick)
        inputs = self.firmware.node.inputs
        return inputs.accelerometer.age_ticks, inputs.encoder.age_ticks

    def begin_anew(self, silent_ticks: int) -> None:
        """After half a turn of the counter, less 20 ms, two samples are lost before a new sequence counts."""
        for _ in range(2 if silent_ticks > 107 else 0):
            self.step(self.publish())

    def uses(self, sample: Sequence[Frame]) -> bool:
        """Whether the firmware has this encoder reading."""
        return self.firmware.node.inputs.encoder[:2] == codec.ENCODER_ESTIMATES.decode(sample[1].data)


@pytest.mark.parametrize("pause_ticks", [2, 9, 16, 80, 252])
def test_a_sample_from_before_the_pause_does_not_pass_for_new(pause_ticks: int) -> None:
    run = Paused()
    old = run.publish()  # of tick 20, in which the machine stops
    run.plant.sleep_through(pause_ticks - 1, [])
    assert run.step([*old, ESTOP], pause_ticks) == (pause_ticks - 1, pause_ticks - 1)
    assert run.firmware.node.outputs.mode == Mode.E_STOP  # nothing else is lost
    run.begin_anew(pause_ticks)
    now = run.publish()
    assert run.step(now) == (0, 0)
    assert run.uses(now)


@pytest.mark.parametrize(("silent_ticks", "pause_ticks"), [(10, 16), (9, 17), (10, 6), (3, 14), (3, 240)])
def test_what_a_bus_held_up_before_the_pause_does_not_pass_for_new(
    silent_ticks: int, pause_ticks: int
) -> None:
    """The bus stops first, then the machine: a backlog lies there, older than the pause is long."""
    run = Paused()
    backlog = []
    for _ in range(silent_ticks):
        backlog += run.publish()
        ages = run.step([])
    assert ages == (silent_ticks, silent_ticks)
    run.plant.sleep_through(pause_ticks - 1, [])
    assert run.step(backlog, pause_ticks) == (pause_ticks - 1, pause_ticks - 1)
    run.begin_anew(pause_ticks)
    now = run.publish()
    assert run.step(now) == (0, 0)
    assert run.uses(now)


@pytest.mark.parametrize("order", [1, -1])
def test_a_sample_of_the_next_tick_counts_as_the_newest(order: int) -> None:
    """A firmware that woke up late finds it, whichever of the sensors comes first on the bus."""
    run = Paused()
    run.plant.sleep_through(7, [])
    own, early = run.publish()[:2], run.publish()[:2]
    assert run.step([*own[::order], *early[::order], ERRORS], 8) == (0, 0)
    assert run.uses(early)
    assert run.firmware.node.inputs.drive.disarm_reason == 0x200
    assert run.step([]) == (1, 1)
    late = run.publish()[:2]
    assert run.step(late[::order]) == (0, 0)
    assert run.uses(late)


def test_a_firmware_that_paused_alone_uses_all_that_has_come() -> None:
    run = Paused()
    before = run.firmware.node.counters
    frames = [frame for _ in range(30) for frame in run.publish()[:2]]
    assert run.step(frames, 30) == (0, 0)
    assert run.firmware.node.elapsed_ticks == 30
    assert run.firmware.node.counters == before._replace(frames=before.frames + 60, skipped_ticks=29)


def test_a_plant_that_does_not_come_back_is_silent() -> None:
    run = Paused()
    assert run.step([], 41) == (41, 41)
    assert run.step([]) == (42, 42)
    assert len(run.bus.sent) >= 2


def test_a_sample_that_was_a_tick_late_before_the_pause_does_not_make_later_ones_wrong() -> None:
    run = Paused()
    late = run.publish()
    run.step([])  # the plant is late: nothing has arrived yet
    run.step(late)
    run.plant.sleep_through(6, [])
    assert run.step(run.publish(), 6) == (0, 0)


def test_the_plant_obeys_what_came_in_its_pause_before_it_moves_on() -> None:
    bus = InProcessBus()
    plant_end, firmware_end = bus.join(), bus.join()
    firmware = FirmwareRunner(ParameterMemory({}), Pace(1e-3, 1.0), firmware_end)
    plant = plant_node()
    plant_end.send_all(plant.publish())
    plant.advance([])
    for tick in range(40):
        firmware.step(tick)
    setpoint = plant.drive.setpoint._replace(age_s=0.04)
    plant.state = plant.state._replace(drive=plant.drive._replace(setpoint=setpoint))
    plant.sleep_through(40, plant_end.receive())
    assert plant.drive.setpoint.age_s == 0.0


def test_a_firmware_alone_says_why_it_refuses_its_parameters():
    command = [sys.executable, "-m", "tools.cli", "firmware", "damaged-parameters-arm-nothing"]
    done = subprocess.run(
        [*command, "--bus", "local", "--until", "0.02"], check=True, capture_output=True, text=True
    )
    assert "is out of bounds" in done.stderr or "it is damaged or was edited by hand" in done.stderr


def test_a_node_alone_writes_no_traces_into_the_folder_of_a_run_that_has_ended(tmp_path: Path):
    """Its verdict and its log would be of one run, and its traces of another."""
    (tmp_path / "verdict.json").write_text("{}")
    process = NodeProcess("local", tmp_path, 1, until_s=0.001)
    with pytest.raises(RunFolderError, match="holds a run that has ended; name another folder"):
        node_main("plant", "soft-start-multistable", (), process)
    assert [one.name for one in tmp_path.iterdir()] == ["verdict.json"]


def test_a_nodes_process_loads_no_reader_of_databases_no_tables_and_no_linear_algebra():
    """They take longer to load than everything else, in each process of each run."""
    heavy = ("cantools", "can", "pandas", "pyarrow", "rerun", "scipy.linalg", "numba.np.linalg")
    load = "from hil.nodes import main; from hil.nodes.plant.runner import PlantRunner; "
    load += "PlantRunner.warm(main.load_scenario('soft-start-multistable'))"
    PlantRunner.warm(load_scenario("soft-start-multistable"))  # a process that compiles loads more
    assert loaded_by(load, heavy) == "[]\n"


def test_a_run_loads_neither_log_nor_report_before_its_first_tick():
    """The figures, the log and the readers of databases take longer to load than all that simulates."""
    heavy = ("cantools", "can", "pandas", "pyarrow", "rerun", "matplotlib", "hil.show.rerun_log")
    load = "import hil.runs.bench, tools.commands.run; from hil.scenario.scenario import load_scenario; "
    load += "from hil.runs.job import Job; from hil.runs.segments import segments; "
    load += "next(segments(Job(load_scenario('soft-start-multistable'), 1)))"
    assert loaded_by(load, heavy) == "[]\n"


def test_a_run_passes_through_few_files_before_its_first_tick(tmp_path: Path):
    """Whoever reads the way from the command to the first tick opens them all; the aim is 25."""
    watched = [sys.executable, files_of_a_run.__file__, str(tmp_path / "run")]
    files = subprocess.run(watched, check=True, capture_output=True, text=True).stderr.split()
    ours = [name for name in files if name.startswith(("hil/", "tools/")) and name.endswith(".py")]
    assert {"hil/runs/segments.py", "hil/runs/lockstep.py", "tools/commands/run.py"} <= set(ours)
    assert len(ours) <= MOST_FILES, ours


def test_a_recorders_process_loads_no_kernels_and_no_scenes():
    assert loaded_by("import hil.show.recorder", ("numba", "scipy", "plant_sim.scene")) == "[]\n"


def loaded_by(program: str, names: tuple[str, ...]) -> str:
    """Those of the modules that a program loads, as it prints them."""
    look = f"import sys; {program}; print([name for name in {names} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", look], check=True, capture_output=True, text=True)
    return done.stdout
