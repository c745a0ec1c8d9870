"""An interface of the kernel's CAN that a test makes for programs that join by name."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pyroute2 import IPRoute

from hil.bus.can_socket import has_kernel_can

needs_kernel_can = pytest.mark.skipif(
    not has_kernel_can(), reason="this kernel has no CAN; test_kernel_can.py runs it under user-mode Linux"
)


@contextmanager
def made_interface(name: str) -> Iterator[None]:
    """A vcan interface of this name, which is up; fails if one of this name exists already."""
    if Path("/sys/class/net", name).exists():
        pytest.fail(f"{name} exists: a drive may hang on it; run this in a network namespace of its own")
    with IPRoute() as route:
        route.link("add", ifname=name, kind="vcan")
        index = route.link_lookup(ifname=name)[0]
        try:
            route.link("set", index=index, state="up")
            yield
        finally:
            route.link("del", index=index)
