"""The kernel's own CAN: private vcan interfaces, as root and as an ordinary user.

Where the machine's kernel has no CAN, the last test runs the others under user-mode Linux, with those of two
other files: none of them is ever skipped unseen.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from firmware_py.interface.frame import Frame
from hil.bus import Bus, BusError, join, provide
from hil.bus.can_socket import has_kernel_can

needs_kernel_can = pytest.mark.skipif(
    not has_kernel_can(), reason="this kernel has no CAN; runs under user-mode Linux below"
)
NETWORK = Path("/sys/class/net")
WHOLE_FILES = (Path(__file__).name, "test_client_programs.py")
PYXCP = "test_xcp_masters.py"
"""Its tests with `vcan` in their names need the kernel's CAN."""


def arrived(node: Bus, count: int) -> list[Frame]:
    """The next `count` frames, which may arrive a moment after they were sent; fewer after 2 s."""
    frames: list[Frame] = []
    deadline_s = time.monotonic() + 2.0
    while len(frames) < count and time.monotonic() < deadline_s:
        node.wait(0.1)
        frames += node.receive()
    return frames


def frame(number: int) -> Frame:
    return Frame(0x100 + number % 0x100, number.to_bytes(4, "little"))


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
def test_frames_reach_all_others_unchanged_and_never_their_sender() -> None:
    frames = [Frame(0x7FF, b""), Frame(0, b"\0" * 8), Frame(0x123, b"\x01\x02\x03")]
    with provide("vcan") as provided:
        first, second, third = (join(provided.address) for _ in range(3))
        first.send(frames[0])
        first.send_all(frames[1:])
        assert arrived(second, len(frames)) == frames
        assert arrived(third, len(frames)) == frames
        assert first.receive() == []
        for node in (first, second, third):
            node.close()


@needs_kernel_can
def test_two_private_buses_never_receive_from_each_other() -> None:
    with provide("vcan") as one, provide("vcan") as other:
        a, b, c, d = join(one.address), join(one.address), join(other.address), join(other.address)
        a.send(frame(1))
        c.send(frame(2))
        assert [arrived(b, 1), arrived(d, 1)] == [[frame(1)], [frame(2)]]
        assert [node.receive() for node in (a, b, c, d)] == [[], [], [], []]
        for node in (a, b, c, d):
            node.close()


@needs_kernel_can
def test_kernel_filters_let_only_a_nodes_own_identifiers_through() -> None:
    with provide("vcan") as provided:
        sender, picky, deaf = (
            join(provided.address),
            join(provided.address, [0x100, 0x1FF]),
            join(provided.address, []),
        )
        sender.send_all([Frame(can_id, b"") for can_id in (0x0FF, 0x100, 0x101, 0x1FF, 0x7FF)])
        assert [received.can_id for received in arrived(picky, 2)] == [0x100, 0x1FF]
        assert deaf.receive() == []
        for node in (sender, picky, deaf):
            node.close()


@needs_kernel_can
def test_burst_of_a_thousand_frames_arrives_whole_and_in_order() -> None:
    burst = [frame(number) for number in range(1000)]
    with provide("vcan") as provided:
        sender, reader = join(provided.address), join(provided.address)
        sender.send_all(burst)
        assert arrived(reader, len(burst)) == burst
        assert sender.counters.unsent == 0
        sender.close()
        reader.close()


@needs_kernel_can
def test_arrivals_carry_the_kernels_wall_clock() -> None:
    with provide("vcan") as provided:
        sender, recorder = join(provided.address), join(provided.address, stamped=True)
        before_ns = time.time_ns()
        sender.send_all([frame(1), frame(2)])
        stamped: list[tuple[int, Frame]] = []
        while len(stamped) < 2 and time.time_ns() < before_ns + 2_000_000_000:
            recorder.wait(0.1)
            stamped += recorder.receive_stamped()
        assert [received for _, received in stamped] == [frame(1), frame(2)]
        assert all(before_ns <= stamp_ns <= time.time_ns() for stamp_ns, _ in stamped)
        sender.close()
        recorder.close()


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
            assert arrived(node, 1) == [Frame(0x456, b"\x03")]
            assert node.counters.foreign == 1
        node.close()


@needs_kernel_can
def test_interface_that_is_not_there_is_refused() -> None:
    with pytest.raises(BusError, match="wanted a CAN interface that is up"):
        join("socketcan:nosuch0")


@needs_kernel_can
def test_interface_that_goes_away_leaves_nodes_that_count() -> None:
    provided = provide("vcan")
    node = join(provided.address)
    provided.close()
    node.send(frame(1))
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
vcan.enter_own_network()
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
    """This file, other people's ODrive clients and pyXCP, in one guest."""
    files = [Path(__file__).with_name(name) for name in (*WHOLE_FILES, PYXCP)]
    selected = " or ".join([*(name.removesuffix(".py") for name in WHOLE_FILES), "vcan"])
    program = Path(sys.executable).with_name("vibrohil")
    tests = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "-m", "not uml", "-k", selected]
    inside = subprocess.run(
        [program, "kernel", "--", *tests, *files], capture_output=True, text=True, check=False, timeout=580
    )
    assert inside.returncode == 0, inside.stdout + inside.stderr
    for name in (*WHOLE_FILES, PYXCP):
        assert f"{name} ." in inside.stdout, inside.stdout
    skipped = [line for line in inside.stdout.splitlines() if line.startswith("SKIPPED")]
    assert all("in no package" in line or "install can-utils" in line for line in skipped), skipped
