"""Step 5, first impacts: the stop, from the lowest speed with impacts; then the hold at the wanted speed.

The first part raises the speed slowly, with a quarter of the module's force limit, until `ENOUGH` impacts,
`FEWEST` of them no grazing ones, have been seen in the raw readings, which need no model. Their direction
shows the accelerometers' signs: at the stop the striker is pushed back. A striker that swings further than
the stop can be has no stop.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from firmware_py.core.estimation.striker_model import STANDARD_GRAVITY_M_S2
from firmware_py.interface import codec
from firmware_py.interface.codec import FrameError
from firmware_py.interface.enums import Fault, Regime
from firmware_py.interface.frame import Frame
from firmware_py.shell.parameters import with_overrides
from hil.scenario.commands import Command, Request
from hil.timing.clock import TICK_S
from tools.bring_up.below_impacts import FORCE_SHARE, cautious, within
from tools.bring_up.listen import Listener
from tools.bring_up.module_fit import fit_module, largest_in, natural_rad_s
from tools.bring_up.operated import LatchedFaultError, Operated, RatioTooHighError, operate
from tools.bring_up.step import Context, Curve, Findings, Largest, Step, StepFailedError
from tools.campaign.identified import PER_TURN, explain_no_hold
from tools.tuning.identification.identify import GRAZING_M_S
from tools.tuning.result import make_value

ENOUGH, FEWEST = 14, 7
FIRST_RATIO, LAST_RATIO, STEP_RATIO, STEP_S = 0.65, 1.0, 0.005, 0.3
STEEP_M_S2, STEEP_TICKS, AGAIN_TICKS = 4.0, 6, 80
"""An impact changes the reading by this within these periods; the next one is at least 80 periods away."""
CLEAR_M_S = 2.0 * GRAZING_M_S
"""Change of the striker's speed by an impact that is no grazing one, at any restitution."""
GAP_MARGIN_M = 0.02
"""A striker that swings this far beyond the data sheet's gap has no stop there."""
FORCE_SHARES = (FORCE_SHARE, 0.5, 1.0)
"""Shares of the module's force limit of an approach; beyond the first only for a hard stop, after a yes."""
RESTING_S = 10.0
"""Time in which the module comes to rest after a fault."""
HARD_M_S = 1.2
"""Approach speed that the hold's force limit allows for, with a factor of 1.5."""
LOWEST_LIMIT_N = 100.0
"""The hold's force limit is not lowered further."""
HOLD_S, JUDGED_S, SHOWN = 16.0, 8.0, 400
REVERSED = "wiring.striker_reversed"


class Watched(Operated):
    """An operator that counts impacts in the raw readings of the low range, and the swing between them."""

    def __init__(
        self, commands: Sequence[Command], end_s: float, values: dict[str, float], enough: int
    ) -> None:
        super().__init__(commands, end_s, lambda _: len(self.seen) >= enough and self.clear >= FEWEST)
        self._exchanged, self._omega_rad_s = values["wiring.low_exchanged"] == 1.0, natural_rad_s(values)
        gap_m = values["stop.position_m"] - values["striker.rest_length_m"]
        self._farthest_m = gap_m + GAP_MARGIN_M
        self._dry_m_s2 = values["friction.mu"] * STANDARD_GRAVITY_M_S2
        self._last: list[tuple[float, float]] = []
        self._offset, self._seen_tick = 0.0, 0
        self._before = self._extreme = np.zeros(2)
        self._beyond = [-math.inf, -math.inf]
        """The last ticks with a swing beyond the stop, backward and forward."""
        self.seen: list[tuple[float, float]] = []
        """The change of the low and of the high range at each impact."""
        self._changes_m_s: list[float] = []

    @property
    def clear(self) -> int:
        """The number of impacts that are no grazing ones."""
        return sum(abs(one) >= CLEAR_M_S for one in self._changes_m_s)

    def _follow(self, frame: Frame) -> None:
        super()._follow(frame)
        if frame.can_id != codec.ACCELEROMETER.can_id:
            return
        try:
            sample = codec.ACCELEROMETER.decode(frame.data)
        except FrameError:
            return
        low = sample.housing_m_s2 if self._exchanged else sample.striker_low_m_s2
        self._last = [*self._last[-AGAIN_TICKS:], (low, sample.striker_high_m_s2)]
        if len(self._last) < AGAIN_TICKS:
            return
        change = low - self._last[-1 - STEEP_TICKS][0]
        is_new = not self.seen or self.tick - self._seen_tick > AGAIN_TICKS
        if abs(change) > STEEP_M_S2 and is_new:
            self._seen_tick = self.tick
            self._before, self._extreme = np.mean(self._last[:-10], axis=0), np.zeros(2)
            self.seen.append((0.0, 0.0))
            self._changes_m_s.append(0.0)
        if self.seen and self.tick - self._seen_tick < AGAIN_TICKS // 2:
            moved = np.array(self._last[-1]) - self._before
            self._changes_m_s[-1] += float(moved[0]) * TICK_S
            if abs(moved[0]) > abs(self._extreme[0]):
                self._extreme = moved
                self.seen[-1] = (float(moved[0]), float(moved[1]))
        elif not self.seen and self.beat is not None and self.beat.target_omega_rad_s > 1.0:
            self._offset += (low - self._offset) * 1e-4
            # A sample from before any contact that may have begun: a soft one shows late.
            # Dry friction adds to the acceleration as the striker turns round, and not to its way.
            felt_m_s2 = self._last[0][0] - self._offset
            reach_m = (abs(felt_m_s2) - self._dry_m_s2) / self.beat.target_omega_rad_s**2
            if reach_m > self._farthest_m and self.beat.target_omega_rad_s > 0.7 * self._omega_rad_s:
                self._beyond[felt_m_s2 > 0.0] = self.tick
            # A soft contact that begins looks like a long way, on its side alone.
            turn = 2.0 * math.pi / self.beat.target_omega_rad_s / TICK_S
            if all(self.tick - one < turn for one in self._beyond):
                raise StepFailedError(
                    f"the striker swings {reach_m * 1e3:.0f} mm to either side without an impact, "
                    "further than the data sheet's stop: it is missing or displaced. Mend it, or give its "
                    "position by --set firmware.stop.position_m"
                )


def first_bound(context: Context) -> Largest:
    """A share of the module's force for the first impacts, the module's own for the hold."""
    speed_rad_s = context.ratio * natural_rad_s(context.values)
    limit_n = context.values["limit.force_n"]
    # With less torque the monitors would take a soft contact of a heavy striker for an implausible load.
    torque_n_m = context.values["speed.torque_limit_n_m"]
    return Largest(force_n=limit_n, torque_n_m=torque_n_m, speed_rad_s=1.5 * speed_rad_s)


def approach(context: Context, found: Findings) -> tuple[dict[str, float], list[Path]]:
    """Raise the speed until enough impacts were seen.

    The parameters with the striker's sign, and the logs: of a hard stop, that of each approach.
    """
    logs: list[Path] = []
    count = round((LAST_RATIO - FIRST_RATIO) / STEP_RATIO)
    commands = [
        Command(0.0 if number == 0 else 5.0 + number * STEP_S, Request.RUN, FIRST_RATIO + number * STEP_RATIO)
        for number in range(count + 1)
    ]
    for share, harder in zip(FORCE_SHARES, (*FORCE_SHARES[1:], None), strict=True):
        player = Watched(commands, 5.0 + (count + 8) * STEP_S, context.values, ENOUGH)
        logs.append(context.log("first-impacts"))
        limit_n = share * context.values["limit.force_n"]
        try:
            operate(context, player, logs[-1], cautious(context, first_bound(context), limit_n))
            break
        except LatchedFaultError as error:
            if error.fault != Fault.FORCE_LIMIT or harder is None:
                raise
            if not context.asks(
                f"{error}: the stop is hard, and its first impacts exceed {share:.0%} of the module's force "
                f"limit. Repeat the approach at {harder:.0%}?"
            ):
                raise
        context.bench.play(Listener(), RESTING_S, context.log("rest"))
    found.notes += player.notes
    if player.clear < FEWEST:
        raise StepFailedError(
            f"{len(player.seen)} impacts up to a ratio of {LAST_RATIO:g}, {player.clear} of them more than a "
            "touch: friction keeps the striker from the stop, or the stop is missing, or further than the "
            "data sheet's; this module has no impacts there"
        )
    values = dict(context.values)
    low, high = np.median(np.array(player.seen), axis=0).tolist()
    if low * high < 0.0:
        raise StepFailedError(
            f"at the impacts the low range reads {low:+.0f} m/s^2 and its high range {high:+.0f}: one "
            "of the two is the wrong way round; turn the one that reads a positive value"
        )
    if (low > 0.0) != (values[REVERSED] == 1.0):
        if not context.asks(
            f"At the impacts the striker's accelerometers read {low:+.0f} m/s^2, and the stop pushes the "
            f"striker back: they are mounted the wrong way round. Set {REVERSED} = 1?"
        ):
            raise StepFailedError("the striker's accelerometers are the wrong way round; turn them")
        values[REVERSED] = 1.0
        found.parameters[REVERSED] = make_value(REVERSED, 1.0)
    found.add("impacts of the approach", len(player.seen), "1")
    return values, logs


def first_impacts(context: Context, found: Findings) -> None:
    """The approach, its fit, the hold at the wanted ratio, and the fit of the hold."""
    values, logs = approach(context, found)
    new, identified, readings = fit_module(logs[-1:], values)
    if "stop.position_m" not in new:
        raise StepFailedError(
            f"{len(identified.impacts)} impacts faster than {GRAZING_M_S} m/s are too few for the stop; "
            "repeat the step"
        )
    last = round(identified.impacts[-1].at_s / readings.period_s)
    shown = slice(max(last - SHOWN, 0), last + SHOWN)
    t_s = np.arange(len(readings.angle_rad))[shown] * readings.period_s
    found.curves = [Curve("acceleration, first impacts", t_s, readings.acceleration_m_s2[shown])]
    found.axes = ("time in s", "acceleration in m/s²")
    found.parameters |= new
    values |= {name: one.value for name, one in found.parameters.items()}
    hold(context, found, with_overrides(values), logs)


def allow_impulse(context: Context, values: Mapping[str, float]) -> dict[str, float]:
    """The limit of the impulse, raised to that of an impact at `HARD_M_S`; empty if that is not needed.

    Raises StepFailedError above the firmware's ceiling.
    """
    name, ceiling_n_s = "limit.impulse_n_s", values["ceiling.impulse_n_s"]
    needed = values["striker.mass_kg"] * (1.0 + values["stop.restitution"]) * HARD_M_S
    if needed <= values[name]:
        return {}
    about = f"An impact at {HARD_M_S:g} m/s has {needed:.2f} N s"
    if needed > ceiling_n_s:
        raise StepFailedError(
            f"{about}, and this firmware permits at most ceiling.impulse_n_s = {ceiling_n_s:g}: if the "
            "module bears it, build the firmware with a higher ceiling"
        )
    asked = f"{about}, above {name} = {values[name]:g}, which would end the hold. Set {name} = {needed:.2f}?"
    return {name: needed} if context.asks(asked) else {}


def with_reason(error: StepFailedError, values: Mapping[str, float], ratio: float) -> str:
    """How a hold ended, with why the module cannot be held at the ratio if that is so."""
    remedy = "ask for a lower --ratio" if isinstance(error, RatioTooHighError) else ""
    return "; ".join(filter(None, (str(error), explain_no_hold(values, ratio) or remedy)))


def hold(context: Context, found: Findings, values: dict[str, float], logs: Sequence[Path]) -> None:
    """Hold the wanted ratio with the parameters found, and fit them again, with the approach's last log."""
    raised = allow_impulse(context, values)
    values = values | raised
    hard_n = 1.5 * HARD_M_S * math.pi * values["striker.mass_kg"] / values["stop.contact_s"]
    held = within(values, first_bound(context), max(hard_n, LOWEST_LIMIT_N))
    found.add("force limit of the hold", held["limit.force_n"], "N")
    player = Operated([Command(0.0, Request.RUN, context.ratio)], HOLD_S)
    log = context.log("hold")
    try:
        operate(context, player, log, held)
    except (LatchedFaultError, RatioTooHighError) as error:
        raise StepFailedError(with_reason(error, values, context.ratio)) from error
    found.notes += player.notes
    end = player.ended_tick
    hits = [one for tick, one in player.impacts if end - JUDGED_S * 1000 < tick <= end]
    turns = JUDGED_S * context.ratio * natural_rad_s(values) / (2.0 * math.pi)
    found.add("impacts a turn in the hold", len(hits) / turns, "1")
    if player.held_regime != Regime.IMPACT or not PER_TURN <= len(hits) / turns <= 2.0 - PER_TURN:
        seen = f"{len(hits)} impacts in {turns:.1f} turns at a ratio of {context.ratio:g}"
        seen += f", regime {player.held_regime.name}"
        raise StepFailedError(with_reason(StepFailedError(seen), values, context.ratio))
    found.parameters |= {name: make_value(name, value) for name, value in raised.items()}
    speed_m_s, impulse_n_s = np.median([(one.approach_speed_m_s, one.impulse_n_s) for one in hits], axis=0)
    found.add("approach speed in the hold", speed_m_s, "m/s")
    found.add("impulse in the hold", impulse_n_s, "N s")
    found.parameters |= fit_module([logs[-1], log], values)[0]
    parts = [largest_in(one, values["striker.mass_kg"]) for one in (*logs, log)]
    found.largest = Largest(*np.max(np.array(parts), axis=0).tolist())


FIRST_IMPACTS = Step(
    "first-impacts",
    "It raises the speed to the first impacts, fits the stop, and then holds the wanted speed.",
    "The firmware turns the crank faster until the striker meets the stop, at a quarter of the module's "
    "force limit, or of a hard stop at a half and at the whole, after another yes each; then it starts to "
    "the wanted speed and holds it.",
    50.0,
    first_bound,
    first_impacts,
)
