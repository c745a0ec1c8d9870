"""Provides and joins the bus that an address names."""

import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from hil.bus.base import Bus, BusError
from hil.bus.can_socket import CanSocket, fetch_can_socket, has_kernel_can, open_can_socket
from hil.bus.hub_socket import HELLO, HELLO_SEND_ONLY, HELLO_STAMPED, HubSocket
from hil.bus.wire import requests_in
from hil.timing.processes import READY, Child, ChildError

READY_TIMEOUT_S = 20.0


@dataclass
class ProvidedBus:
    """A bus that exists while this object is open; its nodes join it at `address`."""

    name: str
    """The bus's name in a result: local, vcan, socketcan:can0, …"""
    address: str
    kernel_can: bool
    """Whether frames go through the kernel's own CAN."""
    reason: str
    """Reason for the choice of this bus."""
    holder: Child | None = None
    folder: Path | None = None
    said: str = field(default="", init=False)
    """The last output of the holder process, reported when it ended."""

    @property
    def processes(self) -> Mapping[str, Child]:
        """The process that provides the bus, by its name; empty if there is none."""
        return {} if self.holder is None else {self.holder.name: self.holder}

    @property
    def described(self) -> dict[str, str | bool]:
        """A run's record of its bus."""
        return {
            "bus": self.name,
            "bus_address": self.address,
            "bus_reason": self.reason,
            "kernel_can": self.kernel_can,
            "counts_losses": self.address.partition(":")[0] in ("local", "vcan", "socketcan"),
        }

    def close(self) -> None:
        """Stop the holder process and remove the bus's folder."""
        if self.holder is not None:
            self.said = self.holder.stop()
            self.holder = None
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder = None

    def __enter__(self) -> "ProvidedBus":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def private_folder() -> Path:
    """A new folder that only this user may enter, with a path short enough for a Unix socket."""
    runtime = os.environ.get("XDG_RUNTIME_DIR", "")
    return Path(
        tempfile.mkdtemp(prefix="vibrohil-", dir=runtime if Path(runtime).is_dir() and runtime else None)
    )


@contextmanager
def closed_unless_up(provided: ProvidedBus) -> Iterator[None]:
    """Close the bus if the block raises, by Ctrl-C too; a `ChildError` becomes a `BusError`."""
    try:
        yield
    except ChildError as error:
        name = provided.name
        provided.close()
        raise BusError(f"bus {name} did not start: {error}") from error
    except BaseException:
        provided.close()
        raise


def provide_local(reason: str) -> ProvidedBus:
    """Start a hub for this run alone."""
    folder = private_folder()
    path = folder / "bus"
    hub = Child("hub", [sys.executable, "-m", "hil.bus.hub", str(path)])
    provided = ProvidedBus("local", f"local:{path}", False, reason, hub, folder)
    with closed_unless_up(provided):
        hub.wait_ready(READY_TIMEOUT_S)
    return provided


def provide_vcan(reason: str) -> ProvidedBus:
    """Make a vcan interface for this run alone; raises `BusError` if the machine supports none."""
    if not has_kernel_can():
        raise BusError(
            "bus vcan: this kernel has no CAN sockets; wanted one with the modules can, can-raw and vcan, or "
            "`vibrohil kernel -- vibrohil run … --bus vcan`"
        )
    folder = private_folder()
    holder = Child("vcan", [sys.executable, "-m", "hil.bus.vcan", str(folder)])
    provided = ProvidedBus("vcan", "", True, reason, holder, folder)
    with closed_unless_up(provided):
        word, _, rest = holder.read_line(READY_TIMEOUT_S).partition(" ")
        if word != READY:
            raise BusError(f"bus vcan: {rest}")
        provided.address = rest
    return provided


def provide(spec: str) -> ProvidedBus:
    """Make the bus that `spec` requests, or use the existing bus that it names.

    `auto`: vcan where it works, else local. `vcan`, `local`: a new private bus. `local:PATH`, `vcan:PATH`: a
    bus of another process. `socketcan:can0` or any `interface:channel` of python-can: used as it is.
    """
    if spec == "auto":
        try:
            return provide_vcan("auto: vcan works here")
        except BusError as error:
            return provide_local(f"auto: no vcan here, so a hub of our own ({error})")
    if spec == "vcan":
        return provide_vcan("requested")
    if spec == "local":
        return provide_local("requested")
    interface, separator, channel = spec.partition(":")
    if not (separator and interface and channel):
        raise BusError(
            f"bus {spec!r} is not known; wanted auto, vcan, local, local:PATH, socketcan:can0 or any "
            "interface:channel of python-can"
        )
    return ProvidedBus(spec, spec, interface in ("socketcan", "vcan"), "requested")


def join(address: str, accept: Collection[int] | None = None, stamped: bool = False) -> Bus:
    """Join the bus at `address`, made by `provide` or by another process.

    `accept`: receive only these identifiers, where the bus can filter; empty for a node that only sends. An
    identifier with the remote flag accepts remote frames, which arrive as empty frames.
    `stamped`: `receive_stamped` gives each frame's arrival on the wall clock.
    """
    interface, _, channel = address.partition(":")
    requests = requests_in(accept)
    if interface == "local":
        only_sends = accept is not None and len(accept) == 0
        greeting = HELLO_SEND_ONLY if only_sends else HELLO_STAMPED if stamped else HELLO
        return HubSocket(Path(channel), greeting, requests)
    if interface == "vcan":
        return CanSocket(fetch_can_socket(Path(channel), accept, stamped), requests)
    if interface == "socketcan" and has_kernel_can():
        try:
            return CanSocket(open_can_socket(channel, accept, stamped), requests)
        except OSError as error:
            raise BusError(
                f"bus {address} did not open: {error}; wanted a CAN interface that is up, see "
                f"`ip link show {channel}`"
            ) from error
    from hil.bus.adapter import AdapterBus  # noqa: PLC0415  python-can takes 0.1 s to import

    return AdapterBus(interface, channel, accept)


@contextmanager
def open_bus(spec: str, accept: Collection[int] | None = None) -> Iterator[tuple[ProvidedBus, Bus]]:
    """Make or find the bus that `spec` names, and join it; a bus made for this call ends after the block."""
    with provide(spec) as provided:
        bus = join(provided.address, accept)
        try:
            yield provided, bus
        finally:
            bus.close()
