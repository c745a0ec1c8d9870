"""Provides and joins the bus that an address names."""

import os
import shutil
import sys
import tempfile
from collections.abc import Collection, Iterator, Mapping
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from hil.bus.base import LOGGER, Bus, BusError
from hil.bus.bridge_process import BridgeProcess
from hil.bus.can_socket import (
    PRIVATE_INTERFACE,
    CanSocket,
    bind_can_socket,
    fetch_can_socket,
    has_kernel_can,
    new_can_socket,
)
from hil.bus.hub_socket import HELLO, HELLO_SEND_ONLY, HELLO_STAMPED, HubSocket, TurnSocket
from hil.bus.watched import WatchedBus
from hil.bus.wire import requests_in
from hil.processes.child import READY, Child, ChildError
from hil.timing.pacemaker import PACEMAKER

COUNT_LOSSES = ("local", "vcan", "socketcan")
"""Kinds of address where frames lost on the way to a node are counted."""


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
    bridge: BridgeProcess | None = None
    """The process that joins an adapter to the run's hub."""
    turns: Path | None = None
    """The socket of the pacemaker, which gives turns to the nodes of a run; None without one."""
    pacemaker: Child | None = None
    """The pacemaker's process: the hub of `local`, or one beside another bus."""
    said: str = field(default="", init=False)
    """The last output of the pacemaker, else of the process that provides the bus."""

    @property
    def processes(self) -> Mapping[str, Child]:
        """The processes that provide the bus and give the turns, by their names."""
        children = (self.bridge, self.holder, self.pacemaker)
        return {child.name: child for child in children if child is not None}

    @property
    def described(self) -> dict[str, str | bool]:
        """A run's record of its bus; the address of a private bus is a path of this machine and left out."""
        public = {} if self.folder is not None else {"bus_address": self.address}
        return {
            "bus": self.name,
            **public,
            "bus_reason": self.reason,
            "kernel_can": self.kernel_can,
            "counts_losses": self.bridge is None and self.address.partition(":")[0] in COUNT_LOSSES,
        }

    def close(self) -> None:
        """Stop the bus's processes and remove its folder."""
        for child in self.processes.values():
            self.said = child.stop()
        self.bridge = self.holder = self.pacemaker = None
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
    above = runtime if runtime and Path(runtime).is_dir() else None
    return Path(tempfile.mkdtemp(prefix="vibrohil-", dir=above))


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


def start_hub(name: str, path: Path, turn_times: int | None) -> Child:
    """Start a hub at `path`; as a pacemaker it writes the times of the turns to the memory `turn_times`."""
    command = [sys.executable, "-P", "-m", "hil.bus.hub", str(path)]
    if turn_times is None:
        return Child(name, command)
    return Child(name, [*command, "--turn-times", str(turn_times)], descriptors=[turn_times])


def provide_local(reason: str, turn_times: int | None = None) -> ProvidedBus:
    """Start a hub for this run alone."""
    folder = private_folder()
    path = folder / "bus"
    hub = start_hub("hub", path, turn_times)
    provided = ProvidedBus("local", f"local:{path}", False, reason, hub, folder)
    if turn_times is not None:
        provided.turns, provided.pacemaker = path, hub
    with closed_unless_up(provided):
        hub.wait_ready()
    return provided


def provide_vcan(reason: str, turn_times: int | None = None) -> ProvidedBus:
    """Make a vcan interface for this run alone; raises `BusError` if the machine supports none."""
    if not has_kernel_can():
        raise BusError(
            "bus vcan: this kernel has no CAN sockets; wanted one with the modules can, can-raw and vcan, or "
            "`vibrohil kernel -- vibrohil run … --bus vcan`"
        )
    folder = private_folder()
    holder = Child("vcan", [sys.executable, "-P", "-m", "hil.bus.vcan", str(folder)])
    provided = ProvidedBus("vcan", "", True, reason, holder, folder)
    with closed_unless_up(provided):
        word, _, rest = holder.read_line().partition(" ")
        if word != READY:
            raise BusError(f"bus vcan: {rest}")
        provided.address = rest
        if turn_times is not None:
            provided.turns = folder / "turns"
            provided.pacemaker = start_hub(PACEMAKER, provided.turns, turn_times)
            provided.pacemaker.wait_ready()
    return provided


def is_own_bus(spec: str) -> bool:
    """Whether `spec` names a bus that the bench provides, so that no real drive can be on it.

    >>> [is_own_bus(spec) for spec in ("auto", "vcan", "local:/run/bus", "socketcan:can0")]
    [True, True, True, False]
    """
    return spec.partition(":")[0] in ("auto", "local", "vcan")


def provide(spec: str, turn_times: int | None = None) -> ProvidedBus:
    """Make the bus that `spec` requests, or use the existing bus that it names.

    `auto`: vcan where it works, else local. `vcan`, `local`: a new private bus. `local:PATH`, `vcan:PATH`: a
    bus of another process. `socketcan:can0` or any `interface:channel` of python-can: used as it is.
    `turn_times`: the descriptor of `shared_turn_times`; a private bus then also has a pacemaker.
    """
    if spec == "auto":
        try:
            return provide_vcan("auto: vcan works here", turn_times)
        except BusError as error:
            return provide_local(f"auto: no vcan here, so a hub of our own ({error})", turn_times)
    if spec == "vcan":
        return provide_vcan("requested", turn_times)
    if spec == "local":
        return provide_local("requested", turn_times)
    interface, separator, channel = spec.partition(":")
    if not (separator and interface and channel):
        raise BusError(
            f"bus {spec!r} is not known; wanted auto, vcan, local, local:PATH, socketcan:can0 or any "
            "interface:channel of python-can"
        )
    if interface in COUNT_LOSSES:
        join(spec, ()).close()  # a wrong name is reported before any process starts
    return ProvidedBus(spec, spec, interface in ("socketcan", "vcan"), "requested")


def shared(provided: ProvidedBus) -> ProvidedBus:
    """The bus for several nodes of this machine: an adapter is joined to a hub where these nodes meet.

    Kernel CAN, hubs and a bus that is bridged already are handed back as they are.
    """
    interface, _, _ = provided.address.partition(":")
    if interface in COUNT_LOSSES:
        return provided
    bus = provide_local(f"{provided.reason}, and joined to a hub where the nodes of this machine meet")
    with closed_unless_up(bus):
        bus.name = provided.name
        bus.bridge = BridgeProcess(Path(bus.address.removeprefix("local:")), provided.address)
        bus.bridge.await_adapter()
    return bus


def join(address: str, accept: Collection[int] | None = None, stamped: bool = False) -> Bus:
    """Join the bus at `address`, made by `provide` or by another process; not an adapter of python-can.

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
        fetched = fetch_can_socket(Path(channel))
        try:
            return CanSocket(bind_can_socket(fetched, PRIVATE_INTERFACE, accept, stamped), requests)
        except OSError as error:
            raise BusError(f"bus {address} did not open: {error}; its holder may be shutting down") from error
    if interface != "socketcan":
        raise BusError(f"bus {address} is an adapter; its nodes meet at the hub that `shared` gives")
    try:
        if not has_kernel_can():
            raise OSError("this kernel has no CAN sockets")
        return CanSocket(bind_can_socket(new_can_socket(), channel, accept, stamped), requests)
    except OSError as error:
        raise BusError(
            f"bus {address} did not open: {error}; wanted a CAN interface that is up, see "
            f"`ip link show {channel}`"
        ) from error


def join_in_turns(
    address: str, turns: Path, member: str, accept: Collection[int] = ()
) -> tuple[Bus, TurnSocket]:
    """Join a run's own bus at `address` as a node that takes turns from the pacemaker at `turns`.

    On `local` both are one connection.
    """
    giver = TurnSocket(turns, member, requests_in(accept))
    return (giver if address == f"local:{turns}" else join(address, accept)), giver


@contextmanager
def open_bus(spec: str, accept: Collection[int] | None = None) -> Iterator[tuple[ProvidedBus, Bus]]:
    """Make or find the bus that `spec` names, and join it; a bus made for this call ends after the block.

    `receive` of the joined bus raises BusFailedError once it carries no more frames.
    """
    bus: Bus | None = None
    try:
        with shared(provide(spec)) as provided:
            bus = WatchedBus(join(provided.address, accept), provided.name, provided.bridge)
            with closing(bus):
                yield provided, bus
    finally:
        if bus is not None and (unsent := bus.counters.unsent):
            LOGGER.warning("%d frames were refused and not sent", unsent)
