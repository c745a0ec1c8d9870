"""The kernel's own CAN: private vcan interfaces, as root and as an ordinary user.

Where the machine's kernel has no CAN, the last test runs the others under user-mode Linux, with those of
three other files: none of them is ever skipped unseen.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from kernel_interface import needs_kernel_can
from waiting import frames_within

from firmware_py.interface.frame import Frame
from hil.bus import BusError, join, provide
from hil.bus.can_socket import has_kernel_can

NETWORK = Path("/sys/class/net")
WHOLE_FILES = (Path(__file__).name, "test_client_programs.py")
PARTS = ("test_bus.py", "test_xcp_masters.py")
"""Their tests with `vcan` in their names need the kernel's CAN."""


@needs_kernel_can
def test_private_vcan_is_no_interface_of_the_machine() -> None:
    """Root's too: on the machine's own network every local user might open a CAN socket."""
    before = set(NETWORK.iterdir())
    with provide("vcan") as provided:
        assert provided.kernel_can
        assert provided.address.startswith("vcan:")
        assert set(NETWORK.iterdir()) == before
        with pytest.raises(BusError, match="wanted a CAN interface that is up"):
            join("socketcan:vcan0" if not (NETWORK / "vcan0").exists() else "socketcan:nosuch0")
    assert set(NETWORK.iterdir()) == before


@needs_kernel_can
def test_auto_takes_vcan_where_it_works() -> None:
    with provide("auto") as provided:
        assert provided.name == "vcan"
        assert provided.reason == "auto: vcan works here"


@needs_kernel_can
def test_kernel_filters_let_only_a_nodes_own_identifiers_through() -> None:
    with provide("vcan") as provided:
        sender, picky, deaf = (
            join(provided.address),
            join(provided.address, [0x100, 0x1FF]),
            join(provided.address, []),
        )
        sender.send_all([Frame(can_id, b"") for can_id in (0x0FF, 0x100, 0x101, 0x1FF, 0x7FF)])
        assert [received.can_id for received in frames_within(picky, 2)] == [0x100, 0x1FF]
        assert deaf.receive() == []
        for node in (sender, picky, deaf):
            node.close()


TOOL = """
import can
with can.Bus("vcan0", "socketcan") as tool:
    print("joined", flush=True)
    message = tool.recv(20.0)
    print(message.arbitration_id, bytes(message.data).hex())
    tool.send(can.Message(arbitration_id=0x12345, data=b"\\x03", is_extended_id=True))
    tool.send(can.Message(arbitration_id=0x456, data=b"\\x03", is_extended_id=False))
"""


@needs_kernel_can
def test_socketcan_tools_share_the_bus_and_their_extended_frames_are_counted() -> None:
    """A tool joins from within the namespace, as docs/how-to/other-tools.md says."""
    with provide("vcan") as provided:
        node = join(provided.address)
        namespace = f"/proc/{provided.processes['vcan'].pid}/ns/net"
        command = ["nsenter", f"--net={namespace}", sys.executable, "-P", "-c", TOOL]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as tool:
            assert tool.stdout is not None
            assert tool.stdout.readline() == "joined\n"
            node.send(Frame(0x123, b"\x01\x02"))
            assert tool.stdout.readline() == "291 0102\n"
            assert tool.wait(20.0) == 0
            assert frames_within(node, 1) == [Frame(0x456, b"\x03")]
            assert node.counters.foreign == 1
        node.close()


@needs_kernel_can
def test_interface_that_goes_away_leaves_nodes_that_count() -> None:
    provided = provide("vcan")
    node = join(provided.address)
    provided.close()
    node.send(Frame(0x101, b""))
    assert node.receive() == []
    assert node.counters.unsent == 1
    node.close()


AS_ORDINARY_USER = """
import ctypes, os
libc = ctypes.CDLL(None, use_errno=True)
PR_SET_KEEPCAPS, PR_CAP_AMBIENT, PR_CAP_AMBIENT_RAISE = 8, 47, 2
CAP_DAC_READ_SEARCH, VERSION_3 = 2, 0x20080522
# The one right left is to read files: Python itself may lie in a folder of root's.
assert libc.prctl(PR_SET_KEEPCAPS, 1, 0, 0, 0) == 0
os.setgroups([])
os.setgid(65534)
os.setuid(65534)
bit = 1 << CAP_DAC_READ_SEARCH
assert libc.capset((ctypes.c_uint32 * 2)(VERSION_3, 0), (ctypes.c_uint32 * 6)(bit, bit, bit)) == 0
assert libc.prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_RAISE, CAP_DAC_READ_SEARCH, 0, 0) == 0
from firmware_py.interface.frame import Frame
from hil.bus import join, provide
with provide("vcan") as provided:
    first, second = join(provided.address), join(provided.address, accept=[0x123])
    first.send_all([Frame(0x122, b""), Frame(0x123, b"12345678")])
    second.wait(2.0)
    print(provided.address.partition(":")[0], second.receive()[0].data.decode())
"""


@needs_kernel_can
def test_ordinary_user_gets_a_private_vcan_too() -> None:
    before = set(NETWORK.iterdir())
    user = subprocess.run(
        [sys.executable, "-c", AS_ORDINARY_USER],
        env={**os.environ, "XDG_RUNTIME_DIR": "/dev/shm"},  # user-mode Linux's /tmp is the host's
        capture_output=True,
        text=True,
        check=False,
    )
    assert user.stdout == "vcan 12345678\n", user.stderr
    assert set(NETWORK.iterdir()) == before


WITHOUT_IMPORTS = """
import sys
from hil.bus import vcan
from hil.processes.own_network import enter_own_network
enter_own_network()
sys.meta_path.clear()
vcan.make_interface("vcan0")
vcan.remove_interface("vcan0")
print("made")
"""


@needs_kernel_can
def test_nothing_is_imported_in_the_namespace_of_a_private_vcan() -> None:
    """In a user namespace a Python in a folder of root's can no longer be read."""
    made = subprocess.run(
        [sys.executable, "-c", WITHOUT_IMPORTS], capture_output=True, text=True, check=False
    )
    assert made.stdout == "made\n", made.stderr


@pytest.mark.uml
@pytest.mark.skipif(has_kernel_can(), reason="this kernel has CAN: the tests ran on it")
def test_all_that_needs_the_kernels_can_under_user_mode_linux() -> None:
    """This file, other people's ODrive clients, pyXCP, and all buses' common tests, in one guest."""
    files = [Path(__file__).with_name(name) for name in (*WHOLE_FILES, *PARTS)]
    selected = " or ".join([*(name.removesuffix(".py") for name in WHOLE_FILES), "vcan"])
    program = Path(sys.executable).with_name("vibrohil")
    tests = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "not uml", "-k", selected]
    inside = subprocess.run(
        [program, "kernel", "--", *tests, *files], capture_output=True, text=True, check=False, timeout=580
    )
    assert inside.returncode == 0, inside.stdout + inside.stderr
    for name in (*WHOLE_FILES, *PARTS):
        assert f"{name} ." in inside.stdout, inside.stdout
    skipped = [line for line in inside.stdout.splitlines() if line.startswith("SKIPPED")]
    assert all("install can-utils" in line for line in skipped), skipped
