"""The module advanced tick by tick: a torque as input, sensor readings as output."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from plant_sim.arrays import FloatArray
from plant_sim.kernels import entry_point, jit, subroutine
from plant_sim.parts.housing import housing_m_s2
from plant_sim.parts.parts import Parts
from plant_sim.parts.stop import is_rigid, origin_m, stop_position_m
from plant_sim.parts.walking import Walking
from plant_sim.result import ElectricalLedger, EnergyLedger, Impact, MotionState, Observation
from plant_sim.scene import Scene, require_scene
from plant_sim.sensors.gait import GaitSensors, GaitTruth, gait_at, gaits_at
from plant_sim.sensors.readings import Noise, Readers, SensorReading, read_sensors, readers
from plant_sim.sensors.sampled import SAMPLED
from plant_sim.sensors.sensing import NO_SENSING, allocate_sensing, sense_jump
from plant_sim.simulation import initial_state
from plant_sim.solvers.adaptive.adaptive import BUFFER_FULL, DONE, refusal, with_address
from plant_sim.solvers.adaptive.observation import (
    electrical_ledger,
    ledger,
    motion_state,
    observation,
    peak_felt_force_n,
)
from plant_sim.solvers.adaptive.state_layout import UNSETTLED, allocate, run_of
from plant_sim.tables.quantities import SPEED
from plant_sim.tick import MOST_IMPACTS, move
from plant_sim.validation_messages import real

GAIT_PERIOD_S = 5e-3
"""Period of the gait sensors."""

SAMPLED_STREAM = 11
"""First random stream of the sampled sensors; each has its own stream for its noise."""

_MOVE = jit(move)

POSITION_ROUNDING = 4e-16
"""Rounding of the difference of two positions, as a share of a position."""


class PlantError(ValueError):
    """A call that the plant cannot answer."""


class Plant:
    """A scene's module, advanced under a held torque; its sensors' noise is sampled from `seed`."""

    def __init__(
        self, scene: Scene, seed: int, parts: Parts | None = None, initial: MotionState | None = None
    ) -> None:
        """`parts` and `initial` replace those of the scene."""
        if not (real(seed) >= 0.0 and real(seed).is_integer()):
            raise PlantError(f"seed = {seed!r}: wanted a whole number of at least 0")
        seed = int(seed)
        self.scene = require_scene(scene)
        if scene.solver.method == "exact":
            raise PlantError(
                "solver.method = 'exact' simulates whole runs; a plant that is advanced tick by tick has the "
                "adaptive solver: set it to 'auto' or 'adaptive'"
            )
        self.parts = parts or scene.parts(seed)
        initial = initial or initial_state(scene, self.parts)
        _require_start(initial, self.parts)
        self._readers: Readers | None = None
        self.noise = Noise(np.random.default_rng(seed))
        """The noise of the sensors' samples."""
        probe = NO_SENSING
        if scene.sensors is not None:
            self._readers = readers(scene.sensors)
            probe = allocate_sensing(scene.sensors, initial.omega_rad_s, self.parts.housing)
        run = allocate(self.parts, initial, scene.solver.accuracy, MOST_IMPACTS, probe)
        start: Any = run.memory[0].progress
        start.t_s = initial.t_s
        self.sampled = () if scene.sensors is None else scene.sensors.sampled()
        """The sensors that are sampled on periods of their own."""
        streams = (SAMPLED_STREAM + SAMPLED.index(type(sensor)) for sensor in self.sampled)
        self._sampled_noise = [np.random.default_rng((seed, stream)) for stream in streams]
        self._gait_sensors: GaitSensors | None = None
        if scene.sensors is not None and isinstance(self.parts.housing, Walking):
            self._gait_sensors = GaitSensors(scene.sensors.gait, self.parts.housing, seed, GAIT_PERIOD_S)
        self._impacts: list[Impact] = []
        self.run = with_address(run)
        """The run for compiled code, which calls `take_back` after it has advanced it."""
        self._run_record: Any = getattr(self.run, "record", self.run)
        self._memory: Any = self.run.memory[0]
        self.observed: FloatArray = self._memory.observed
        """The present observation for sampled sensors, with places as in `state_layout.OBSERVED`."""
        self._move = entry_point(_MOVE, self.run, 0.0, 0.0)
        self.now: Observation
        """The present observation of the module."""
        self._call(0.0, 0.0)

    def advance(self, torque_n_m: float, dt_s: float) -> None:
        """Advance by `dt_s` under a constant motor torque command (an ideal drive ignores it)."""
        torque_n_m, dt_s = real(torque_n_m), real(dt_s)
        if not (math.isfinite(torque_n_m) and math.isfinite(dt_s) and dt_s >= 0.0):
            raise PlantError(
                f"torque_n_m = {torque_n_m}, dt_s = {dt_s}: both must be finite and the time not negative"
            )
        self._call(torque_n_m, dt_s)

    def replace_parts(self, parts: Parts) -> None:
        """Replace the parts by others of the same kinds; the motion continues from its present state.

        The change of stored energy comes from outside and is in no ledger.
        """
        if tuple(map(type, parts)) != tuple(map(type, self.parts)):
            kinds = [", ".join(type(part).__name__ for part in given) for given in (parts, self.parts)]
            raise PlantError(f"parts of kinds {kinds[0]}; this plant has {kinds[1]}, keep those")
        if not self.is_clear_of(parts):
            raise PlantError(
                f"the striker is at x = {self.now.x_m} m, beyond the rigid stop that would be at "
                f"{stop_position_m(parts.stop)} m; wait until the striker is clear of it (`is_clear_of`)"
            )
        depth_m = depth_after_m(self.parts, parts, float(self._memory.y.depth_m))
        self.parts, self.run = parts, run_of(parts, *self._run_record[1:])
        self._memory.y.depth_m = depth_m
        self._disturb()

    def is_clear_of(self, parts: Parts) -> bool:
        """Whether the striker is before the rigid stop of these parts, or at it; True without one."""
        depth_m = depth_after_m(self.parts, parts, float(self._memory.y.depth_m))
        return not is_rigid(parts.stop) or depth_m <= 0.0

    def kick(self, change_m_s: float) -> None:
        """Change the striker's velocity at once, as a kick does; the accelerometers measure it.

        Its work is in no ledger.
        """
        change_m_s, largest_m_s = real(change_m_s), SPEED.largest
        if not abs(change_m_s) <= largest_m_s:
            raise PlantError(f"change_m_s = {change_m_s}; wanted at most {largest_m_s:g} m/s, up or down")
        self._memory.y.v_m_s += change_m_s
        sense_jump(self.run.probe, -change_m_s)
        self._disturb()

    def _disturb(self) -> None:
        """Enter the phase that follows from the changed state, and exclude its energy from the ledger."""
        progress = self._memory.progress
        progress.stored_before_j = math.nan
        self._memory.mode.phase = UNSETTLED
        self._call(progress.torque_n_m, 0.0)

    def _call(self, torque_n_m: float, dt_s: float) -> None:
        while (status := self._move(self.run, torque_n_m, dt_s)) == BUFFER_FULL:
            self._impacts = self.take_impacts()
        self.take_back(status)

    def take_back(self, status: int) -> None:
        """Continue after kernels have advanced the module, with the solver's status.

        Raises SolverError if it failed.
        """
        if status != DONE:
            raise refusal(status, self.run)
        self.now = observation(self.observed)

    def sense(self) -> SensorReading:
        """Sample every sensor now, with new noise in each call."""
        filtered, noise = self.run.probe.readings.tolist(), self.noise.next()
        return read_sensors(self.readers, filtered, self.now.crank_rad, noise)

    @property
    def readers(self) -> Readers:
        """The readers of the sensors. Raises PlantError without sensors."""
        if self._readers is None:
            raise PlantError("the scene has no sensors; add the table [sensors]")
        return self._readers

    @property
    def has_gait_sensors(self) -> bool:
        """Whether the scene has a walking wearer and gait sensors."""
        return self._gait_sensors is not None

    def sample_noise(self, which: int, signals: int) -> FloatArray:
        """Standard normals for the next sample of one of `sampled`, one for each of its signals."""
        return self._sampled_noise[which].standard_normal(signals)

    def sense_gaits(self, times_s: FloatArray) -> FloatArray:
        """Sample the gait sensors at these times, every `GAIT_PERIOD_S`: rows of `GaitReading`.

        The module does not influence the gait, so that future times may be sampled.
        """
        if self._gait_sensors is None:
            raise PlantError("the scene has no gait sensors; add the tables [gait] and [sensors]")
        return self._gait_sensors.read(times_s)

    def gait_at(self, t_s: float) -> GaitTruth | None:
        """The gait at `t_s`; None without a walking wearer."""
        walking = self.parts.housing
        return gait_at(walking, t_s) if isinstance(walking, Walking) else None

    def gaits_at(self, times_s: FloatArray) -> FloatArray | None:
        """The gait at these times, shape (n,), as rows of `GaitTruth`; None without a walking wearer."""
        walking = self.parts.housing
        return gaits_at(walking, times_s) if isinstance(walking, Walking) else None

    @property
    def _impact_count(self) -> Any:
        memory: Any = self.run.memory  # a field of the array takes a fiftieth of the time of a record's
        return memory["mode"]["impacts"]

    def take_impact_rows(self) -> NDArray[np.void]:
        """Impacts as `take_impacts`, as records that are valid until the plant advances."""
        count = self._impact_count
        rows: NDArray[np.void] = self.run.impacts[: count[0]]
        count[0] = 0
        return rows

    def take_impacts(self) -> list[Impact]:
        """Impacts completed since the last call, oldest first (at a soft stop: after separation)."""
        if not (self._impacts or self._impact_count[0]):
            return []
        before, self._impacts = self._impacts, []
        return [*before, *(Impact(*row) for row in self.take_impact_rows().tolist())]

    @property
    def t_s(self) -> float:
        """Time since the start, s."""
        memory: Any = self.run.memory
        progress = memory["progress"]
        return float(progress["t_s"][0] + progress["t_rest_s"][0])

    @property
    def state(self) -> MotionState:
        """The true motion now."""
        return motion_state(self.now, self.t_s)

    @property
    def housing_m_s2(self) -> float:
        """The housing's true a_b, m/s²: its acceleration along the axis and gravity's part along it."""
        return housing_m_s2(self.parts.housing, self.t_s)

    @property
    def peak_felt_force_n(self) -> float | None:
        """The largest felt force so far, N; None without a wearer."""
        return peak_felt_force_n(self.parts, self._memory)

    @property
    def energy(self) -> EnergyLedger:
        """Energy ledger since the start."""
        return ledger(self.now, self._memory)

    @property
    def electrical(self) -> ElectricalLedger | None:
        """Electrical ledger since the start; None if the windings are not modelled."""
        return electrical_ledger(self.parts, self._memory)


@subroutine
def depth_after_m(before: Parts, after: Parts, depth_m: float) -> float:
    """The depth, m, from the stop's surface, as the parts `after` replace those of `before`."""
    before_m = origin_m(before.stop, before.striker)
    moved_m = before_m - origin_m(after.stop, after.striker)
    if moved_m == 0.0:
        return depth_m
    depth_m += moved_m
    # A depth within the rounding of the positions is none: the striker is at the stop.
    return 0.0 if abs(depth_m) <= POSITION_ROUNDING * abs(before_m) else depth_m


def _require_start(initial: MotionState, parts: Parts) -> None:
    """Refuse a start that is not finite, or beyond a rigid stop."""
    for name in ("t_s", "x_m", "v_m_s", "crank_rad", "omega_rad_s"):
        value = getattr(initial, name)
        if not math.isfinite(real(value)):
            raise PlantError(f"initial: {name} = {value!r}; wanted a finite number")
    if is_rigid(parts.stop) and initial.x_m > stop_position_m(parts.stop):
        raise PlantError(
            f"initial: x_m = {initial.x_m} is beyond the rigid stop at {stop_position_m(parts.stop)} m; "
            "start at or before it, or make the stop soft"
        )
