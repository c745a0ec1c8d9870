"""The configuration of the drive, an ODrive axis, which the bench adds to a scene."""

from typing import Literal

from pydantic import Field

from plant_sim.scene import Scene
from plant_sim.tables.quantities import Duration
from plant_sim.tables.table import Table


class AxisTable(Table):
    """[axis]: the client's configuration of the drive, an ODrive axis."""

    # Half of the 100 ms in which the motor is to be free of torque.
    watchdog_s: Duration = Field(
        default=0.05, ge=1e-3, description="the time without a command after which the axis disarms, in s"
    )
    # A real ODrive's watchdog is fed by every frame to it, and ships disabled.
    watchdog_feed: Literal["setpoints", "frames", "off"] = Field(
        default="setpoints",
        description="what resets the watchdog: `setpoints` (torque and velocity commands), `frames` (every "
        "frame to the drive) or `off` (no watchdog)",
    )
    # ODrive's heartbeat_rate_ms, whose own default is 100 ms.
    heartbeat_s: Duration = Field(default=0.1, ge=1e-3, le=60.0, description="the heartbeat's period in s")
    # ODrive's encoder_msg_rate_ms, whose own default is 10 ms; the firmware needs a sample a tick.
    encoder_s: Duration | None = Field(
        default=None, ge=1e-3, le=60.0, description="the period of position and speed in s (default: a tick)"
    )
    control_mode: Literal["torque", "velocity"] = Field(
        default="torque", description="the drive's mode as its supply comes on: `torque` or `velocity`"
    )


class BenchScene(Scene):
    """A scene as the bench runs it: the module, and the configuration of its drive."""

    axis: AxisTable | None = Field(default=None, description="the table [axis]")
