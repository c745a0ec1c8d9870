"""The controller of mine.py as a program of its own on a CAN bus, with python-can alone.

Start `vibrohil run speed.toml --firmware none --bus local`, and this program with the bus that the run names:
`python on_the_bus.py vibrohil:PATH` after `local:PATH`, or for example `python on_the_bus.py socketcan:can0`.
"""

import sys
import time

import can
import mine

from firmware_py.interface.frame import Frame
from firmware_py.shell.parameters import config_from


def main() -> None:
    """Tick at 1 kHz until the bus ends."""
    interface, _, channel = sys.argv[1].partition(":")
    config, state = config_from({}), mine.INITIAL
    due_s = time.monotonic()
    with can.Bus(interface=interface, channel=channel) as bus:
        try:
            while True:
                received = []
                while (message := bus.recv(0.0)) is not None:
                    if not (message.is_extended_id or message.is_remote_frame or message.is_error_frame):
                        received.append(Frame(message.arbitration_id, bytes(message.data)))
                state, frames = mine.tick(config, state, received)
                for can_id, data in frames:
                    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))
                due_s += config.tick_s
                time.sleep(max(0.0, due_s - time.monotonic()))
        except can.CanError as error:
            print(f"the bus has ended: {error}", file=sys.stderr)


if __name__ == "__main__":
    main()
