"""An animation of the module: crank, yoke, spring, striker and stop, and the estimated striker's outline.

Shapes are drawn once and moved by transforms at 50 Hz. It is a side view in millimetres, with the striker's
axis pointing right. The crank is drawn as a Scotch yoke, which x_A = A sin θ describes exactly.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import rerun as rr

from hil.record.run_traces import column
from hil.record.state_timeline import ALARM, ESTIMATE, NEUTRAL, TRUTH
from hil.record.traces.stored_trace import Records
from hil.show.log_stream import LogStream, colors
from plant_sim.arrays import FloatArray

EVERY_TICKS = 20
CRANK_MM = -90.0
"""Position of the crank's axle, left of the piston's middle position at 0."""
STRIKER_MM = 26.0
COILS = 7
FLASH_S = 0.08
METAL, FLASH = 0xB8BCC4FF, 0xFFD60AFF


def box(left_mm: float, right_mm: float, half_height_mm: float) -> list[list[float]]:
    """The closed outline of a rectangle about the axis."""
    h = half_height_mm
    return [[left_mm, -h], [right_mm, -h], [right_mm, h], [left_mm, h], [left_mm, -h]]


def zigzag() -> list[list[float]]:
    """A spring of length 1 along x, to be stretched."""
    turns = np.linspace(0.08, 0.92, 2 * COILS)
    heights = np.where(np.arange(2 * COILS) % 2 == 0, -8.0, 8.0)
    inner = np.column_stack([turns, heights]).tolist()
    return [[0.0, 0.0], *inner, [1.0, 0.0]]


def translate(x_mm: FloatArray) -> FloatArray:
    """Translations along the axis, shape (n, 3)."""
    return np.column_stack([x_mm, np.zeros_like(x_mm), np.zeros_like(x_mm)])


class Drawing:
    """The module of one scenario, drawn into a recording."""

    def __init__(self, out: LogStream, scenario: Mapping[str, Any]) -> None:
        scene = scenario.get("scene", {})
        self.out = out
        self.amplitude_mm = 1e3 * float(scene.get("drive", {}).get("amplitude_m", 0.02))
        stop_m = scene.get("stop", {}).get("position_m")
        self.stop_mm = None if stop_m is None else 1e3 * float(stop_m)

    def _strips(self, entity: str, lines: list[Any], rgba: int, width: float) -> None:
        """Declare lines that are `width` points wide on the screen at any scale."""
        shape = rr.LineStrips2D(lines, colors=colors([rgba]), radii=rr.Radius.ui_points(0.5 * width))
        self.out.declare(f"module/{entity}", shape)

    def _declare_truth(self) -> None:
        """Declare the shapes of the true module, which do not change; once."""
        a, slot = self.amplitude_mm, self.amplitude_mm + 6.0
        angle = np.linspace(0.0, 2.0 * np.pi, 48)
        circle = np.column_stack([CRANK_MM + a * np.cos(angle), a * np.sin(angle)])
        self._strips("frame", [circle.tolist(), [[CRANK_MM - 40.0, 36.0], [215.0, 36.0]]], NEUTRAL, 1.0)
        self._strips("crank", [[[0.0, 0.0], [0.0, -a]]], METAL, 4.0)
        yoke = [[[CRANK_MM, -slot], [CRANK_MM, slot]], [[CRANK_MM, 0.0], [0.0, 0.0]]]
        self._strips("yoke", [*yoke, [[0.0, -14.0], [0.0, 14.0]]], METAL, 3.0)
        self._strips("spring", [zigzag()], METAL, 1.6)
        self._strips("striker", [box(-STRIKER_MM, 0.0, 16.0)], TRUTH, 4.0)
        if self.stop_mm is not None:
            x = self.stop_mm
            hatching = [[[x, y], [x + 7.0, y - 7.0]] for y in np.arange(-21.0, 29.0, 7.0).tolist()]
            self._strips("wall", [[[x, -28.0], [x, 28.0]], *hatching], ALARM, 2.0)

    def _move(self, entity: str, t_s: FloatArray, **transform: Any) -> None:
        self.out.send(f"module/{entity}", t_s, rr.Transform3D.columns(**transform))

    def draw_truth(self, plant: Records) -> None:
        """Move crank, yoke, spring and striker to their true positions."""
        shown = plant[column(plant, "tick") % EVERY_TICKS == 0]
        if len(shown) == 0:
            return
        self._declare_truth()
        t_s, half = column(shown, "t_s"), 0.5 * column(shown, "crank_rad")
        piston_mm = self.amplitude_mm * np.sin(2.0 * half)
        striker_mm = 1e3 * column(shown, "x_m")
        zero, one = np.zeros_like(half), np.ones_like(half)
        turn = np.column_stack([zero, zero, np.sin(half), np.cos(half)])
        self._move("crank", t_s, translation=translate(zero + CRANK_MM), quaternion=turn)
        self._move("yoke", t_s, translation=translate(piston_mm))
        stretch = np.column_stack([striker_mm - STRIKER_MM - piston_mm, one, one])
        self._move("spring", t_s, translation=translate(piston_mm), scale=stretch)
        self._move("striker", t_s, translation=translate(striker_mm))

    def draw_estimate(self, firmware: Records) -> None:
        """Move the outline of the striker to its estimated position."""
        shown = firmware[column(firmware, "tick") % EVERY_TICKS == 0]
        if len(shown):
            self._strips("ghost", [box(-STRIKER_MM, 0.0, 20.0)], ESTIMATE, 2.0)
            ghost_mm = 1e3 * column(shown, "state.estimator.x_m")
            self._move("ghost", column(shown, "t_s"), translation=translate(ghost_mm))

    def draw_flashes(self, impacts: Records) -> None:
        """Show a flash at the stop for `FLASH_S` from each touch-down."""
        if len(impacts) == 0 or self.stop_mm is None:
            return
        lit_s = column(impacts, "t_s")
        t_s = np.concatenate([lit_s, lit_s + FLASH_S])
        radius_mm = np.concatenate([np.full(len(lit_s), 9.0), np.zeros(len(lit_s))])
        order = np.argsort(t_s, kind="stable")
        columns = rr.Points2D.columns(
            positions=np.tile([self.stop_mm, 0.0], (len(t_s), 1)),
            radii=radius_mm[order],
            colors=np.full(len(t_s), FLASH, np.uint32),
        )
        self.out.send("module/flash", t_s[order], columns)
