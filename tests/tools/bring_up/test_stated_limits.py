"""A step of a bring-up keeps within the limits that it states, and reports what it has used of them."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from firmware_py.interface import codec
from firmware_py.interface.codec import FrameCodec
from firmware_py.interface.frame import Frame
from firmware_py.shell.parameters import config_from, with_overrides
from hil.bus.base import NodeBus
from hil.timing.clock import TICK_S
from tools.bring_up.drive import BOUND, LONGEST_S, Commander
from tools.bring_up.first_impacts import first_bound, hold
from tools.bring_up.step import Context, Findings, StepFailedError
from tools.bring_up.trials import bench_of, beyond_bounds, brought_up


class Firmwares:
    """A bench that keeps the parameters of each firmware, and ends each of its motions."""

    def __init__(self) -> None:
        self.parameters: list[Mapping[str, float]] = []

    def play(self, _: Any, _longest_s: float, _log: Path, parameters: Any = None) -> None:
        """End a motion at once."""
        if parameters:
            self.parameters.append(parameters)
            raise StepFailedError("it has ended")


@pytest.mark.parametrize("force_n", [60.0, 1000.0])
@pytest.mark.parametrize("speed_rad_s", [14.0, 24.0])
@pytest.mark.parametrize("ratio", [0.95, 1.25])
def test_a_hold_keeps_the_stated_limits_and_those_of_the_data_sheet(
    force_n: float, speed_rad_s: float, ratio: float, tmp_path: Path
) -> None:
    given = {"limit.force_n": force_n, "limit.overspeed_rad_s": speed_rad_s, "limit.speed_rad_s": 12.0}
    given["start.highest_ratio"] = 1.4
    values = with_overrides({"striker.mass_kg": 1.0, **given}) | {"stop.contact_s": 0.2}
    bench = Firmwares()
    context = Context(bench, tmp_path, values, {}, lambda _: True, lambda _: None, ratio)
    with pytest.raises(StepFailedError):
        hold(context, Findings(), values, [])
    (held,), stated = bench.parameters, first_bound(context)
    assert held["limit.force_n"] <= force_n
    assert held["speed.torque_limit_n_m"] == stated.torque_n_m == values["speed.torque_limit_n_m"]
    assert held["limit.speed_rad_s"] <= 12.0
    assert held["limit.overspeed_rad_s"] <= min(stated.speed_rad_s, speed_rad_s)
    # The drive takes torque away below its own limit, as if the load were larger: it is not lowered.
    assert held["limit.drive_speed_rad_s"] == values["limit.drive_speed_rad_s"]
    assert config_from(held)


def test_the_report_has_the_largest_angle_of_a_pulse(tmp_path: Path) -> None:
    """A heavy crank wanders by several rad in 40 swings, each of which stays within its bound."""
    bench = bench_of({"motor": {"inertia_kg_m2": 4e-3, "dry_n_m": 0.0}}, [], 1)
    step = brought_up(bench, tmp_path / "out", "drive")["steps"][-1]
    assert step["passed"], step["reason"]
    assert 0.5 < step["largest"]["angle_rad"] <= step["bound"]["angle_rad"]


def test_a_pulse_that_turns_the_crank_too_far_ends_the_step() -> None:
    commander = Commander(10.0)
    commander.begin_rad, commander.angle_rad = 1.0, 1.0 - 0.99 * BOUND.angle_rad
    commander.torque(0.0)
    commander.angle_rad = 1.0 - 1.015 * BOUND.angle_rad
    with pytest.raises(StepFailedError, match=r"turned the crank by 1\.52 rad"):
        commander.torque(0.0)


def test_pulses_without_an_end_are_an_e_stop() -> None:
    """Without an exception the bench would leave the drive armed."""
    commander, last = Commander(10.0), round(LONGEST_S / TICK_S) - 1
    commander.play(last - 1, [])
    with pytest.raises(StepFailedError, match="have not ended"):
        commander.play(last, [])


def test_a_light_crank_is_measured_within_the_bounds(tmp_path: Path) -> None:
    """With the torque for a heavier one its swings were too short to be measured."""
    bench = bench_of({"motor": {"inertia_kg_m2": 1e-4}}, [], 1)
    result = brought_up(bench, tmp_path / "out", "drive")
    assert result["passed"], result["steps"][-1]["reason"]
    found = result["parameters"]["motor.inertia_kg_m2"]
    assert found["low"] < 1e-4 < found["high"]
    assert beyond_bounds(bench, result["steps"]) == []


@pytest.mark.parametrize(
    ("lost", "reason"), [(codec.ENCODER_ESTIMATES, "encoder's frames"), (codec.DRIVE_HEARTBEAT, "silent")]
)
def test_a_drive_without_reports_gets_no_torque(lost: FrameCodec[Any], reason: str, tmp_path: Path) -> None:
    """Without the encoder neither speed nor angle would end a swing."""
    bench = bench_of({}, [], 1)
    line, inner = bench.own, bench.play

    def play(player: Any, *others: Any) -> None:
        if isinstance(player, Commander):
            bench.own = Without(line, player, lost.can_id)
        inner(player, *others)

    bench.play = play  # type: ignore[method-assign]
    result = brought_up(bench, tmp_path / "out", "drive")
    assert reason in result["steps"][-1]["reason"]
    assert beyond_bounds(bench, result["steps"]) == []


class Without:
    """A line that loses the frames of an identifier once the crank swings."""

    def __init__(self, line: NodeBus, player: Commander, can_id: int) -> None:
        self._line, self._player, self._can_id = line, player, can_id
        self.send_all = line.send_all

    def receive(self) -> list[Frame]:
        """The frames that have arrived."""
        frames = self._line.receive()
        return [one for one in frames if not self._player.swings or one.can_id != self._can_id]
