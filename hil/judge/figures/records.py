"""What is known about a run once it is over: each figure with its unit and meaning.

A figure that the run cannot give (no impact, no hold, no soft stop) is None, and a check on it fails. Checks,
report and tables take units and meanings from here. Times are simulated seconds from the run's start unless a
name says otherwise.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from hil.record.run_traces import LogLoss


class Quantity(NamedTuple):
    """A figure's unit, empty for numbers without one and for names, and its meaning."""

    unit: str
    meaning: str
    from_log: bool = False
    """Whether it rests on can.log, and is incomplete where frames are missing there."""


def plain(value: Any) -> Any:
    """`value` with None for each float that is not finite, to any depth."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


@dataclass(frozen=True, slots=True)
class Spread:
    """Two quantiles and the largest of a sample."""

    p50: Annotated[float | None, Quantity("µs", "median")]
    p99: Annotated[float | None, Quantity("µs", "99th percentile")]
    max: Annotated[float | None, Quantity("µs", "largest")]


@dataclass(frozen=True, slots=True)
class Latency:
    """From a touch-down to the tick that reports it."""

    p50: Annotated[float | None, Quantity("ms", "median latency of a detection")]
    p95: Annotated[float | None, Quantity("ms", "95th percentile of the detections' latency")]


@dataclass(frozen=True, slots=True)
class LoopTiming:
    """One loop's own clockwork."""

    ticks: Annotated[int, Quantity("", "ticks run")]
    overruns: Annotated[int, Quantity("", "ticks skipped because the next deadline had passed")]
    late_wakeups: Annotated[int, Quantity("", "wake-ups more than half a tick late")]
    long_work: Annotated[int, Quantity("", "ticks whose work took more than half a tick")]
    longest_hold_ms: Annotated[
        float | None, Quantity("ms", "the longest the loop was held up between two of its ticks")
    ]
    longest_hold_at_s: Annotated[float | None, Quantity("s", "when that began")]
    work_us: Annotated[Spread, Quantity("", "work in a tick")]
    wake_us: Annotated[Spread, Quantity("", "wake-up latency")]


@dataclass(frozen=True, slots=True)
class Loops:
    """The two loops of the bench."""

    plant: Annotated[LoopTiming, Quantity("", "the plant's loop")]
    firmware: Annotated[LoopTiming, Quantity("", "the firmware's loop")]


@dataclass(frozen=True, slots=True)
class TrueImpact:
    """One touch-down of the true striker."""

    t_s: float
    v_m_s: float


@dataclass(frozen=True, slots=True)
class MemoryFigures:
    """Growth since the processes had settled; none in short runs and in lockstep."""

    nodes_growth_mb: Annotated[float | None, Quantity("MB", "the largest of all but the recorder's")]
    recorder_growth_mb_min: Annotated[
        float | None, Quantity("MB/min", "the recorder's, which keeps the log's index")
    ]


@dataclass(frozen=True, slots=True)
class EstimateFigures:
    """The firmware's estimate against the truth of the same tick, over the hold."""

    x_rmse_m: Annotated[float | None, Quantity("m", "RMS error of the striker's position")]
    v_rmse_m_s: Annotated[float | None, Quantity("m/s", "RMS error of the striker's velocity")]
    x_worst_m: Annotated[float | None, Quantity("m", "largest error of the striker's position")]
    nis_mean: Annotated[
        float | None,
        Quantity("", "mean normalised innovation squared; 1 if the filter's covariance is honest"),
    ]


@dataclass(frozen=True, slots=True)
class DetectorFigures:
    """The firmware's detections against the true touch-downs of at least 0.05 m/s, over the whole run."""

    precision: Annotated[float | None, Quantity("", "detections that belong to an impact, of all detections")]
    recall: Annotated[float | None, Quantity("", "impacts that were detected, of all that should have been")]
    latency_ms: Annotated[Latency, Quantity("", "from touch-down to the tick that reports it")]
    speed_rmse_m_s: Annotated[float | None, Quantity("m/s", "RMS error of the reported approach speed")]
    slept_through: Annotated[
        int,
        Quantity(
            "", "impacts missed since the firmware did not run for 5 ms from touch-down: not in the recall"
        ),
    ]


@dataclass(frozen=True, slots=True)
class SpeedFigures:
    """The crank's true speed over the second half of the hold."""

    mean_rad_s: Annotated[float | None, Quantity("rad/s", "mean crank speed")]
    error: Annotated[float | None, Quantity("", "mean crank speed over its mean target, less one")]
    ripple: Annotated[float | None, Quantity("", "half of the peak-to-peak crank speed over its mean")]


@dataclass(frozen=True, slots=True)
class LatchedFigures:
    """Before the first fault the firmware latched: loops held up look like silent sensors."""

    at_s: Annotated[float | None, Quantity("s", "when the first fault was latched")]
    firmware_held_ms: Annotated[
        float | None, Quantity("ms", "the longest the firmware's loop was held up in the 0.2 s before it")
    ]
    plant_held_ms: Annotated[float | None, Quantity("ms", "the longest the plant's loop was, then")]


@dataclass(frozen=True, slots=True)
class SafeStateFigures:
    """What happened once the drive was to be off."""

    cause: Annotated[
        str | None,
        Quantity("", "stop, fault, e-stop, firmware-silent or plant-silent; none while still driving"),
    ]
    at_s: Annotated[float | None, Quantity("s", "when the drive was to be off")]
    torque_zero_after_s: Annotated[float | None, Quantity("s", "until the motor's torque was zero for good")]
    command_zero_after_s: Annotated[
        float | None, Quantity("s", "until the firmware's torque command was zero for good")
    ]
    impacts_after: Annotated[
        int | None, Quantity("", "impacts after that moment: a torque of zero is no promise of none")
    ]


@dataclass(frozen=True, slots=True)
class FaultFigures:
    """What followed the first fault of the script, on the truth alone; none without a fault."""

    torque_zero_after_s: Annotated[
        float | None, Quantity("s", "from the fault's begin until the motor's torque was zero for good")
    ]
    impacts_after_zero: Annotated[int | None, Quantity("", "impacts after the torque was zero for good")]
    largest_torque_n_m: Annotated[
        float | None, Quantity("N m", "largest motor torque from the fault's begin on")
    ]
    largest_speed_rad_s: Annotated[
        float | None, Quantity("rad/s", "largest crank speed from the fault's begin on, either way round")
    ]
    peak_force_n: Annotated[
        float | None,
        Quantity("N", "largest force of impacts on the stop from the fault's start on; 0 without any"),
    ]
    impacts_again_after_s: Annotated[
        float | None,
        Quantity("s", "from the fault's end until every drive period of the hold had an impact again"),
    ]
    turning_at_end_rad_s: Annotated[
        float | None, Quantity("rad/s", "mean crank speed over the run's last half second")
    ]


@dataclass(frozen=True, slots=True)
class FeltFigures:
    """The force of ankle spring and damper on the wearer, at the ticks; none where there is no wearer."""

    peak_n: Annotated[float | None, Quantity("N", "largest force on the wearer, pushed or pulled")]
    settled_low_n: Annotated[
        float | None,
        Quantity("N", "smallest of the peaks of each turn of the crank over the second half of the hold"),
    ]
    settled_high_n: Annotated[float | None, Quantity("N", "largest of them")]


@dataclass(frozen=True, slots=True)
class GaitFigures:
    """Somebody walks: over the hold; strides from its fifth whole one on, until a stop or a stumble."""

    phase_rmse_percent: Annotated[
        float | None, Quantity("%", "RMS error of the estimated gait phase, of the cycle")
    ]
    phase_worst_percent: Annotated[float | None, Quantity("%", "largest error of the estimated gait phase")]
    strides: Annotated[int | None, Quantity("", "whole strides that are counted")]
    in_window: Annotated[
        float | None, Quantity("", "strides with a pulse within the firmware's window, of all")
    ]
    pulses_per_stride: Annotated[float | None, Quantity("", "pulses in a stride, on average")]
    outside_per_stride: Annotated[float | None, Quantity("", "those outside of the window, on average")]
    end: Annotated[str | None, Quantity("", "what ended the steady walk: stop or stumble")]
    end_s: Annotated[float | None, Quantity("s", "when the leg stood still, or the foot tripped")]
    last_pulse_after_s: Annotated[
        float | None,
        Quantity("s", "from that moment to the last pulse that follows; 0 without any"),
    ]
    hardest_after: Annotated[
        float | None,
        Quantity("", "approach speed of the hardest of them over that of the hardest in the steady half"),
    ]
    undriven: Annotated[
        int | None, Quantity("", "pulses with the crank off for 2 s or more: the leg's own doing")
    ]


@dataclass(frozen=True, slots=True)
class LogFigures:
    """Whether the log holds every frame that was on the bus."""

    frames_lost: Annotated[
        int | None, Quantity("", "frames the recorder lost; none where the bus does not count them")
    ]
    lost_s: Annotated[float | None, Quantity("s", "time around the lost frames, in all")]


@dataclass(frozen=True, slots=True)
class Figures:
    """All figures of a run."""

    scenario: Annotated[str, Quantity("", "the scenario's name")]
    clock: Annotated[str, Quantity("", "real, patient or lockstep")]
    bus: Annotated[str, Quantity("", "the bus it ran on")]
    kernel_can: Annotated[bool, Quantity("", "whether frames went through the kernel's CAN stack")]
    real_time: Annotated[
        bool | None, Quantity("", "whether a real-time run met its timing; none on other clocks")
    ]
    duration_s: Annotated[float, Quantity("s", "simulated duration")]
    ticks: Annotated[int, Quantity("", "ticks the firmware ran")]
    overruns: Annotated[int, Quantity("", "ticks skipped, both loops")]
    baseline_overruns: Annotated[int | None, Quantity("", "ticks a bare sleep loop skipped beside the run")]
    late_wakeups: Annotated[int, Quantity("", "wake-ups more than half a tick late, both loops")]
    long_work: Annotated[int, Quantity("", "ticks whose work took more than half a tick, both loops")]
    tick_us: Annotated[Spread, Quantity("", "work in a firmware tick")]
    wake_us: Annotated[Spread, Quantity("", "wake-up latency of the firmware's loop")]
    loops: Annotated[Loops, Quantity("", "timing of each loop")]
    bus_load: Annotated[
        float | None,
        Quantity("", "mean load of the bus at 1 Mbit/s, worst-case bit stuffing", from_log=True),
    ]
    realtime_factor: Annotated[float | None, Quantity("", "simulated over elapsed time")]
    memory: Annotated[MemoryFigures, Quantity("", "growth of the processes' own memory")]
    log: Annotated[LogFigures, Quantity("", "what can.log lacks")]
    losses: Annotated[tuple[LogLoss, ...], Quantity("", "when the recorder lost frames")]
    impacts: Annotated[tuple[TrueImpact, ...], Quantity("", "the true touch-downs")]
    impact_count: Annotated[int, Quantity("", "true touch-downs of the run")]
    regime: Annotated[str, Quantity("", "what the striker truly did during the hold")]
    regime_estimated: Annotated[
        str, Quantity("", "the regime that the firmware reported at the end of the hold")
    ]
    hold_start_s: Annotated[float | None, Quantity("s", "end of the run-up")]
    hold_end_s: Annotated[float | None, Quantity("s", "end of the hold")]
    impacts_per_period: Annotated[float | None, Quantity("", "impacts per turn of the crank during the hold")]
    capture_s: Annotated[
        float | None, Quantity("s", "first impact from which on every drive period of the hold had one")
    ]
    largest_v_m_s: Annotated[float | None, Quantity("m/s", "largest approach speed of the run")]
    largest_v_on_the_way_m_s: Annotated[
        float | None, Quantity("m/s", "largest approach speed before the hold")
    ]
    impact_v_m_s: Annotated[
        float | None, Quantity("m/s", "median approach speed over the second half of the hold")
    ]
    impact_impulse_n_s: Annotated[
        float | None, Quantity("N s", "median impulse of an impact over the second half of the hold")
    ]
    peak_force_n: Annotated[float | None, Quantity("N", "largest force on the stop; none at a rigid stop")]
    felt: Annotated[FeltFigures, Quantity("", "the force on the wearer")]
    gait: Annotated[GaitFigures, Quantity("", "the walk: phase, pulses in the window, how it ended")]
    estimate: Annotated[EstimateFigures, Quantity("", "the firmware's estimate against the truth")]
    detector: Annotated[DetectorFigures, Quantity("", "the firmware's impact detector against the truth")]
    speed: Annotated[SpeedFigures, Quantity("", "the crank's speed")]
    fault: Annotated[str, Quantity("", "the first fault the firmware latched, or none")]
    latched: Annotated[LatchedFigures, Quantity("", "how the loops kept their pace before that fault")]
    final_mode: Annotated[str, Quantity("", "the mode the firmware ended in")]
    motor_torque_after_stop_n_m: Annotated[
        float | None, Quantity("N m", "largest motor torque from 0.1 s after the drive was to be off")
    ]
    safe_state: Annotated[SafeStateFigures, Quantity("", "what happened once the drive was to be off")]
    after_fault: Annotated[FaultFigures, Quantity("", "what followed the first fault of the script")]
    energy_residual: Annotated[
        float | None, Quantity("", "what the plant's energy ledger leaves unbalanced, of all exchanged")
    ]

    def as_json(self) -> dict[str, Any]:
        """Nested dictionaries of JSON's own types; what is not finite is None, as what is not there."""
        content: dict[str, Any] = plain(asdict(self))
        return content


class FigureSpec(NamedTuple):
    """What a figure is called, measured in, and means."""

    name: str
    unit: str
    meaning: str
    from_log: bool


def walk(record: type, prefix: str = "") -> Iterator[FigureSpec]:
    """The leaf figures below a record, by dotted name."""
    for name, hint in get_type_hints(record, include_extras=True).items():
        kind, quantity = get_args(hint)
        if isinstance(kind, type) and is_dataclass(kind):
            yield from walk(kind, f"{prefix}{name}.")
        elif get_origin(kind) is not tuple:
            yield FigureSpec(f"{prefix}{name}", *quantity)


CATALOGUE: Mapping[str, FigureSpec] = {spec.name: spec for spec in walk(Figures)}
"""Every figure a check may name."""


def incomplete(figures: Mapping[str, Any]) -> list[str]:
    """Names of the figures that rest on a log which lacks frames; of `Figures.as_json()`."""
    if not figures["log"]["frames_lost"]:
        return []
    return [spec.name for spec in CATALOGUE.values() if spec.from_log]


def value_of(figures: Mapping[str, Any], name: str) -> Any:
    """The figure at a dotted name of `Figures.as_json()`."""
    value: Any = figures
    for part in name.split("."):
        value = value[part]
    return value
