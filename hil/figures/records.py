"""The figures of a finished run, each annotated with its unit (empty for names and shares) and its meaning.

A figure that a run does not have (no impact, no hold, no soft stop) is None, and a check on it fails. Checks,
report and tables take units and meanings from here. Times are simulated seconds from the start of the run
unless a name says otherwise.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from enum import Enum, auto
from typing import Annotated, Any, NamedTuple, TypeAlias, TypeVar, get_args, get_origin, get_type_hints

from hil.figures.gaps import Gap
from hil.record.formats import plain
from hil.timing.pacemaker import Hold

Group = TypeVar("Group")
Number: TypeAlias = float | None
"""A figure that some runs do not have."""


class Origin(Enum):
    """What a figure needs beyond the traces of plant and firmware; that of a group is that of its figures."""

    LOG = auto()
    """Computed from can.log: incomplete if frames are missing there."""
    HOLD = auto()
    """Computed over the hold: a run that never reaches mode RUN does not have it."""
    BENCH = auto()
    """Describes the bench, not the module."""
    TIMING = auto()
    """Describes the bench, and depends on the machine: it differs from run to run."""


def no_figures(kind: type[Group]) -> Group:
    """A group of figures that a run does not have: None; a count is 0 and a name `none`, which cannot be."""
    return kind(*map(no_figure, get_type_hints(kind).values()))


def no_figure(kind: Any) -> Any:
    """A figure of this type that a run does not have."""
    if is_dataclass(kind):
        return no_figures(kind)  # type: ignore[arg-type]
    if get_origin(kind) is tuple:
        return ()
    return {int: 0, float: 0.0, bool: False, str: "none"}.get(kind)


@dataclass(frozen=True, slots=True)
class Spread:
    """Two quantiles and the largest value of a sample."""

    p50: Annotated[Number, "µs", "median"]
    p99: Annotated[Number, "µs", "99th percentile"]
    max: Annotated[Number, "µs", "largest"]


@dataclass(frozen=True, slots=True)
class Latency:
    """Time from a touch-down to the tick that reports it."""

    p50: Annotated[Number, "ms", "median latency of a detection"]
    p95: Annotated[Number, "ms", "95th percentile of the detections' latency"]


@dataclass(frozen=True, slots=True)
class LoopFigures:
    """Timing of one loop."""

    ticks: Annotated[int, "", "ticks run"]
    overruns: Annotated[int, "", "ticks skipped because the next deadline had passed"]
    late_wakeups: Annotated[int, "", "wake-ups more than half a tick late"]
    long_work: Annotated[int, "", "ticks in which the node's own work, its CPU time, exceeded half a tick"]
    longest_hold_ms: Annotated[Number, "ms", "the loop's longest stall between two ticks"]
    longest_hold_at_s: Annotated[Number, "s", "the beginning of this stall"]
    work_us: Annotated[Spread, "", "work in a tick"]
    wake_us: Annotated[Spread, "", "wake-up latency"]


@dataclass(frozen=True, slots=True)
class Loops:
    """The two loops of the bench."""

    plant: Annotated[LoopFigures, "", "the plant's loop"]
    firmware: Annotated[LoopFigures, "", "the firmware's loop"]


@dataclass(frozen=True, slots=True)
class TrueImpact:
    """One touch-down of the true striker."""

    t_s: float
    v_m_s: float


@dataclass(frozen=True, slots=True)
class MemoryFigures:
    """Growth of memory after the processes have settled; None in short runs."""

    nodes_growth_mb: Annotated[Number, "MB", "largest growth of a process, without the recorder"]
    recorder_growth_mb_min: Annotated[Number, "MB/min", "the recorder's growth; it keeps the log's index"]


@dataclass(frozen=True, slots=True)
class EstimateFigures:
    """The firmware's estimate against the truth of the same tick, over the hold."""

    x_rmse_m: Annotated[Number, "m", "RMS error of the striker's position", Origin.HOLD]
    v_rmse_m_s: Annotated[Number, "m/s", "RMS error of the striker's velocity", Origin.HOLD]
    x_worst_m: Annotated[Number, "m", "largest error of the striker's position", Origin.HOLD]
    nis_mean: Annotated[
        Number, "", "mean normalised innovation squared; 1 if the filter's covariance is right", Origin.HOLD
    ]


@dataclass(frozen=True, slots=True)
class DetectorFigures:
    """The firmware's detections against the true touch-downs of at least 0.05 m/s, over the whole run."""

    precision: Annotated[Number, "", "share of the detections that belong to an impact"]
    recall: Annotated[Number, "", "share of the detectable impacts that were detected"]
    latency_ms: Annotated[Latency, "", "from touch-down to the tick that reports it"]
    speed_rmse_m_s: Annotated[Number, "m/s", "RMS error of the reported approach speed"]
    slept_through: Annotated[
        int, "", "impacts missed because the firmware stalled for 5 ms from touch-down; not in the recall"
    ]


@dataclass(frozen=True, slots=True)
class SpeedFigures:
    """The crank's true speed over the second half of the hold."""

    mean_rad_s: Annotated[Number, "rad/s", "mean crank speed", Origin.HOLD]
    error: Annotated[Number, "", "mean crank speed divided by its mean target, minus one", Origin.HOLD]
    ripple: Annotated[Number, "", "half of the peak-to-peak crank speed, divided by its mean", Origin.HOLD]


@dataclass(frozen=True, slots=True)
class LatchedFigures:
    """Stalls of the loops before the firmware latched its first fault; a stall looks like a silent sensor."""

    at_s: Annotated[Number, "s", "time at which the first fault was latched"]
    firmware_held_ms: Annotated[
        Number, "ms", "longest stall of the firmware's loop in the 0.2 s before the fault", Origin.TIMING
    ]
    plant_held_ms: Annotated[
        Number, "ms", "longest stall of the plant's loop in the same time", Origin.TIMING
    ]


@dataclass(frozen=True, slots=True)
class SafeStateFigures:
    """Torque and impacts after the drive must be off."""

    cause: Annotated[
        str | None,
        "",
        "cause: stop, fault, e-stop, firmware-silent or plant-silent; none if the drive stayed on",
    ]
    at_s: Annotated[Number, "s", "time from which the drive must be off"]
    torque_zero_after_s: Annotated[Number, "s", "time until the motor's torque was finally zero"]
    command_zero_after_s: Annotated[Number, "s", "time until the firmware's torque command was finally zero"]
    impacts_after: Annotated[
        int | None, "", "impacts after the drive must be off; some may follow at zero torque"
    ]


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """True torque, speed and impacts from the script's first fault on; None without a fault."""

    torque_zero_after_s: Annotated[
        Number, "s", "from the fault's beginning until the motor's torque was finally zero"
    ]
    impacts_after_zero: Annotated[int | None, "", "impacts after the torque was finally zero"]
    largest_torque_n_m: Annotated[Number, "N m", "largest motor torque from the fault's beginning on"]
    largest_speed_rad_s: Annotated[
        Number, "rad/s", "largest crank speed from the fault's beginning on, in either direction"
    ]
    peak_force_n: Annotated[
        Number, "N", "largest force of impacts on the stop from the fault's beginning on; 0 without impacts"
    ]
    impacts_again_after_s: Annotated[
        Number,
        "s",
        "longest time from a fault's end until every drive period up to the next fault had an impact again",
        Origin.HOLD,
    ]
    turning_at_end_rad_s: Annotated[Number, "rad/s", "mean crank speed over the run's last half second"]


@dataclass(frozen=True, slots=True)
class GateFigures:
    """What contacts had reached before the commanded torque ended; those that a fault hides do not count."""

    passed_n: Annotated[
        Number, "N", "largest force of a contact until 4 ms before the commanded torque ended"
    ]
    passed_n_s: Annotated[Number, "N s", "the same of the impulse"]


@dataclass(frozen=True, slots=True)
class FeltFigures:
    """The force of ankle spring and damper on the wearer, at the ticks; None without a wearer."""

    peak_n: Annotated[Number, "N", "largest force on the wearer, in either direction"]
    settled_low_n: Annotated[
        Number, "N", "smallest peak force of a crank turn in the second half of the hold", Origin.HOLD
    ]
    settled_high_n: Annotated[
        Number, "N", "largest peak force of a crank turn in the second half of the hold", Origin.HOLD
    ]


@dataclass(frozen=True, slots=True)
class GaitFigures:
    """Figures of a walk over the hold; strides count from the fifth whole one to a stop or a stumble."""

    phase_rmse_percent: Annotated[
        Number, "%", "RMS error of the estimated gait phase, as a share of the cycle", Origin.HOLD
    ]
    phase_worst_percent: Annotated[Number, "%", "largest error of the estimated gait phase", Origin.HOLD]
    strides: Annotated[int | None, "", "number of whole strides that count", Origin.HOLD]
    in_window: Annotated[
        Number, "", "share of the strides with a pulse in the firmware's window", Origin.HOLD
    ]
    pulses_per_stride: Annotated[Number, "", "mean number of pulses in a stride", Origin.HOLD]
    outside_per_stride: Annotated[
        Number, "", "mean number of pulses outside of the window in a stride", Origin.HOLD
    ]
    end: Annotated[str | None, "", "the end of the steady walk: stop or stumble"]
    end_s: Annotated[Number, "s", "time at which the leg stood still or the foot tripped"]
    last_pulse_after_s: Annotated[
        Number, "s", "from the end of the walk to the last pulse; 0 without a pulse"
    ]
    hardest_after: Annotated[
        Number,
        "",
        "largest approach speed after the end of the walk, divided by the largest in the steady half",
    ]
    undriven: Annotated[
        int | None, "", "pulses with the crank off for 2 s or more, caused by the leg's motion"
    ]


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Whether the log holds every frame that was on the bus, and whether every frame got there."""

    frames_lost: Annotated[
        int | None, "", "frames that the recorder lost; none if the bus does not count them"
    ]
    frames_foreign: Annotated[
        int | None, "", "frames that came from none of the run's own processes; none if that is not known"
    ]
    frames_unsent: Annotated[
        int | None,
        "",
        "frames of the run's own nodes that were not sent: a transmit queue was full, an adapter refused "
        "them, or the node was bus-off; none if that is not known",
    ]


@dataclass(frozen=True, slots=True)
class Figures:
    """All figures of a run."""

    scenario: Annotated[str, "", "the scenario's name"]
    clock: Annotated[str, "", "real or lockstep"]
    bus: Annotated[str, "", "the bus of the run"]
    kernel_can: Annotated[bool, "", "whether frames went through the kernel's CAN stack"]
    real_time: Annotated[
        bool | None, "", "whether a real-time run met its timing; none with other clocks", Origin.TIMING
    ]
    duration_s: Annotated[
        float, "s", "simulated duration; of an imported log the time from its first frame to its last"
    ]
    ticks: Annotated[int, "", "ticks that the firmware ran"]
    time: Annotated[str | None, "", "held or strict real time; none in lockstep"]
    held_s: Annotated[
        Number,
        "s",
        "total time for which the host held the run up; none where time is not held",
        Origin.TIMING,
    ]
    own_late_s: Annotated[
        Number, "s", "total time for which processes held the run up by their own work", Origin.TIMING
    ]
    time_held: Annotated[tuple[Hold, ...], "", "the holds of a millisecond or longer"]
    gaps: Annotated[tuple[Gap, ...], "", "in strict time: intervals in which the host held a process up"]
    overruns: Annotated[int, "", "ticks skipped, both loops", Origin.TIMING]
    baseline_overruns: Annotated[
        int | None, "", "ticks that a bare sleep loop beside the run skipped", Origin.TIMING
    ]
    late_wakeups: Annotated[int, "", "wake-ups more than half a tick late, both loops", Origin.TIMING]
    long_work: Annotated[
        int,
        "",
        "ticks in which a node's own work, its CPU time, exceeded half a tick, both loops",
        Origin.TIMING,
    ]
    tick_us: Annotated[Spread, "", "work in a firmware tick", Origin.TIMING]
    wake_us: Annotated[Spread, "", "wake-up latency of the firmware's loop", Origin.TIMING]
    loops: Annotated[Loops, "", "timing of each loop", Origin.TIMING]
    bus_load: Annotated[Number, "", "mean load of the bus at 1 Mbit/s, worst-case bit stuffing", Origin.LOG]
    realtime_factor: Annotated[Number, "", "simulated time divided by elapsed time", Origin.TIMING]
    memory: Annotated[MemoryFigures, "", "growth of the processes' own memory", Origin.TIMING]
    log: Annotated[LogFigures, "", "frames missing in can.log, and on the bus", Origin.BENCH]
    impacts: Annotated[tuple[TrueImpact, ...], "", "the true touch-downs"]
    impact_count: Annotated[int | None, "", "true touch-downs of the run"]
    impacts_reported: Annotated[int, "", "impacts that the firmware reported"]
    regime: Annotated[str, "", "the striker's true regime during the hold", Origin.HOLD]
    regime_estimated: Annotated[str, "", "the regime that the firmware reported at the end of the hold"]
    hold_start_s: Annotated[Number, "s", "end of the run-up", Origin.HOLD]
    hold_end_s: Annotated[Number, "s", "end of the hold", Origin.HOLD]
    impacts_per_period: Annotated[Number, "", "impacts per turn of the crank during the hold", Origin.HOLD]
    capture_s: Annotated[
        Number, "s", "first impact after which every drive period of the hold has an impact", Origin.HOLD
    ]
    largest_v_m_s: Annotated[Number, "m/s", "largest approach speed of the run"]
    largest_v_on_the_way_m_s: Annotated[Number, "m/s", "largest approach speed before the hold"]
    impact_v_m_s: Annotated[
        Number, "m/s", "median approach speed over the second half of the hold", Origin.HOLD
    ]
    impact_impulse_n_s: Annotated[
        Number, "N s", "median impulse of an impact over the second half of the hold", Origin.HOLD
    ]
    peak_force_n: Annotated[Number, "N", "largest force on the stop; none with a rigid stop"]
    felt: Annotated[FeltFigures, "", "the force on the wearer"]
    gait: Annotated[GaitFigures, "", "the walk: phase, pulses in the window, its end"]
    estimate: Annotated[EstimateFigures, "", "the firmware's estimate against the truth"]
    detector: Annotated[DetectorFigures, "", "the firmware's impact detector against the truth"]
    speed: Annotated[SpeedFigures, "", "the crank's speed"]
    fault: Annotated[str, "", "the first fault that the firmware latched, or none"]
    latched: Annotated[LatchedFigures, "", "stalls of the loops before that fault"]
    final_mode: Annotated[str, "", "the firmware's mode at the end"]
    motor_torque_after_stop_n_m: Annotated[
        Number, "N m", "largest motor torque from 0.1 s after the drive must be off"
    ]
    safe_state: Annotated[SafeStateFigures, "", "torque and impacts after the drive must be off"]
    after_fault: Annotated[FaultFigures, "", "torque, speed and impacts from the script's first fault on"]
    gate: Annotated[GateFigures, "", "what contacts reached before the commanded torque ended"]
    energy_residual: Annotated[
        Number, "", "unbalanced energy of the plant, as a share of the exchanged energy"
    ]

    def as_json(self) -> dict[str, Any]:
        """Nested dictionaries of JSON's types; values that are missing or not finite are None."""
        content: dict[str, Any] = plain(asdict(self))
        return content


SIGNED = (
    *("speed.error", "speed.mean_rad_s", "after_fault.turning_at_end_rad_s"),
    *("memory.nodes_growth_mb", "memory.recorder_growth_mb_min"),
)
"""Figures that may be negative; all other numbers are counts, times, sizes and shares."""
SHARES = ("detector.precision", "detector.recall", "gait.in_window")
"""Figures that are never above 1."""


class FigureSpec(NamedTuple):
    """Name, unit and meaning of a figure, and whether it is a text."""

    name: str
    unit: str
    meaning: str
    origin: Origin | None
    is_text: bool

    @property
    def range(self) -> tuple[float, float]:
        """The lowest and the highest value that any run can have."""
        return -math.inf if self.name in SIGNED else 0.0, 1.0 if self.name in SHARES else math.inf

    @property
    def describes_the_bench(self) -> bool:
        """Whether it describes the bench itself, so that it is judged in spite of a gap."""
        return self.origin in (Origin.LOG, Origin.BENCH, Origin.TIMING)


def walk(record: type, prefix: str = "", origin: Origin | None = None) -> Iterator[FigureSpec]:
    """The leaf figures below a record of this origin, by dotted name."""
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, *quantity = get_args(hint)
        unit, meaning, own = (*quantity, origin)[:3]
        if isinstance(kind, type) and is_dataclass(kind):
            yield from walk(kind, f"{prefix}{name}.", own)
        elif get_origin(kind) is not tuple:
            yield FigureSpec(f"{prefix}{name}", unit, meaning, own, is_text=str in (kind, *get_args(kind)))


CATALOGUE: Mapping[str, FigureSpec] = {spec.name: spec for spec in walk(Figures)}
"""Every figure that a check may name."""


def incomplete(figures: Figures) -> list[str]:
    """Names of the figures that are computed from a log which lacks frames."""
    if not figures.log.frames_lost:
        return []
    return [spec.name for spec in CATALOGUE.values() if spec.origin is Origin.LOG]


def value_of(figures: Any, name: str) -> Any:
    """The figure at a dotted name, in `Figures` or in its JSON; None for a number that is not finite."""
    value = figures
    for part in name.split("."):
        value = value[part] if isinstance(value, Mapping) else getattr(value, part)
    return plain(value)
